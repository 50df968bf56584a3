"""Exported records are read back, by libraries that others wrote, with the values of readings.csv."""

from __future__ import annotations

import csv
import io
import json
import math
import os
import re
import subprocess
import tracemalloc
from collections.abc import Callable, Iterator
from datetime import datetime
from itertools import pairwise
from pathlib import Path
from typing import Any

import fastkml
import geojson
import gpxpy
import numpy as np
import pytest
from fastkml.validator import validate
from lxml import etree
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader

from arva_hil.config import DEFAULT, parse
from arva_hil.model.field import LocalFrame
from arva_hil.records.pictures.style import look_of
from arva_hil.records.reading import Recording, load
from arva_hil.registry import EXPORTS
from tests.files import rows as table
from tests.files import written
from tests.made_records import HOME, SILENT, frames, write, write_search, write_team
from tests.records.ros_messages.oracle import plain

COUNT = 20
EVIL = "</name><script>\x1b[31m=1+1&\u202e"


def exported(name: str, recording: Recording) -> bytes:
    out = io.BytesIO()
    EXPORTS[name](recording, out)
    return out.getvalue()


def where(n: int) -> list[float]:
    """Latitude, longitude, altitude of a frame of `write`."""
    return [float(value) for value in LocalFrame(*HOME).lla(frames(DEFAULT, COUNT)[n].pose.position)]


def placemarks(data: bytes) -> dict[str, Any]:
    document = fastkml.KML.from_string(data.decode().partition("\n")[2]).features[0]
    return {feature.name: feature for feature in document.features}


def test_kml_has_the_track_with_its_times_and_the_place_found_with_its_ellipse(tmp_path: Path) -> None:
    data = exported("kml", load(write(tmp_path / "flight", COUNT)))
    assert validate(file_to_validate=written(tmp_path / "flight.kml", data))
    marks = placemarks(data)
    track = marks["receiver"].kml_geometry
    assert len(track.track_items) == COUNT - SILENT
    for n, item in enumerate(track.track_items, SILENT):
        lat, lon, alt = where(n)
        assert item.coord.coords[0][:2] == pytest.approx((lon, lat), abs=6e-9)
        assert item.coord.coords[0][2] == pytest.approx(alt, abs=6e-4)
        assert item.when.dt.isoformat() == f"2027-01-01T00:00:{2 + n:02}+00:00"
    found, edge = marks["place found: transmitter 1"], marks["place found: transmitter 1, 95 %"]
    assert "95% inside an ellipse of 1.00 m × 0.44 m (semi-axes), long axis 13°" in found.description
    centre = LocalFrame(*HOME).ned(found.geometry.y, found.geometry.x, HOME[2])
    assert centre[:2].tolist() == pytest.approx([20.5, 5.25], abs=1e-3)
    around = [LocalFrame(*HOME).ned(lat, lon, HOME[2])[:2] - centre[:2] for lon, lat in edge.geometry.exterior.coords]
    lengths = np.hypot(*np.transpose(around))
    assert (lengths.max(), lengths.min()) == pytest.approx((1.0, 0.444), abs=0.005)
    assert len(marks["search"].kml_geometry.track_items) == COUNT
    colour = look_of(1)[0]
    style = re.search(r'<Style id="transmitter1"><IconStyle><color>ff(..)(..)(..)</color>', data.decode())
    assert f"#{style[3]}{style[2]}{style[1]}" == colour
    assert b"<styleUrl>#transmitter1</styleUrl>" in data
    assert b"href" not in data  # a viewer loads nothing
    places = re.findall(r"coord(?:inates)?>(.*?)<", data.decode())
    assert all(len(number) <= 8 for number in re.findall(r"\d\.(\d+)", " ".join(places)))


def test_each_place_of_several_is_there_with_its_ellipse_and_its_order(tmp_path: Path) -> None:
    places = [
        {
            "id": id_,
            "north": n,
            "east": e,
            "down": 1.0,
            "earth_covariance": [v, 0.0, v],
            "lat_lon": [46.0 + id_ / 1e4, 7.7],
        }
        | {"sure": id_ != 3}
        for id_, n, e, v in ((7, 1.0, 2.0, 0.04), (3, 9.0, 4.0, 0.25))
    ]
    recording = load(write_search(tmp_path, how="2 of 2", victims=places))
    marks = placemarks(exported("kml", recording))
    assert [name for name in marks if name.startswith("place found")] == [
        "place found: transmitter 7",
        "place found: transmitter 7, 95 %",
        "place found: transmitter 3",
        "place found: transmitter 3, 95 %",
    ]
    first = marks["place found: transmitter 7"].description
    assert first.startswith("1 of 2 in the order of probing; 2 of 2; on Earth 95% ")
    assert marks["place found: transmitter 3"].description.startswith("2 of 2 in the order of probing; not sure; ")
    gpx = gpxpy.parse(exported("gpx", recording).decode())
    assert [point.latitude for point in gpx.waypoints] == [46.0007, 46.0003]
    assert len(gpx.routes) == 2
    features = geojson.loads(exported("geojson", recording)).features
    kinds = [feature["properties"]["kind"] for feature in features]
    assert (kinds.count("found"), kinds.count("ellipse")) == (2, 2)


def test_a_search_that_was_killed_has_its_places_from_its_events(tmp_path: Path) -> None:
    folder = write_search(tmp_path, ended=False)
    found = {"event": "place_found", "earth_covariance": [0.04, 0.0, 0.04], "sure": True}
    events: list[dict[str, Any]] = [
        {"event": "take_off_point", "time_s": 0.0, **dict(zip(("lat", "lon", "alt"), HOME, strict=True))},
        {"event": "search_begun", "time_s": 1.0, "wanted": None},
        {"time_s": 2.0, "transmitter": 7, "north_m": 10.0, "east_m": -3.0, "down_m": 0.5, **found},
        {"time_s": 4.5, "transmitter": 3, "north_m": -5.0, "east_m": 2.0, **found},
        {"time_s": 4.6, "transmitter": [], "north_m": "x", "east_m": None, **found},
    ]
    written(folder / "search.jsonl", "".join(json.dumps(event) + "\n" for event in events))
    recording = load(folder)
    assert recording.search is not None
    assert [(one.id, one.time_s, one.down) for one in recording.search.places] == [(7, 1.0, 0.5), (3, 3.5, None)]
    features = json.loads(exported("geojson", recording))["features"]
    places = [one["geometry"]["coordinates"] for one in features if one["properties"]["kind"] == "found"]
    frame = LocalFrame(*HOME)
    for place, ned in zip(places, ([10.0, -3.0, 0.0], [-5.0, 2.0, 0.0]), strict=True):
        lat, lon, _ = frame.lla(ned)
        assert place[:2] == pytest.approx([lon, lat], abs=1e-8)
    assert "track" in [one["properties"]["kind"] for one in features]
    assert "2 of 2 in the order of probing; the search has not ended; on Earth" in str(features)


@pytest.mark.parametrize(("code", "how"), [(0, "it did not end"), (130, "interrupted")])
def test_the_places_of_a_team_are_those_of_its_events(tmp_path: Path, code: int, how: str) -> None:
    recording = load(write_team(tmp_path / "team", COUNT, code=code))
    assert {name: (len(one.places), one.how) for name, one in recording.searches.items()} == {
        "drone-1": (1, "found"),
        "drone-2": (0, how),
    }
    place = placemarks(exported("kml", recording))["place found: transmitter 1"]
    assert place.description.startswith("by drone-1; found; on Earth 95% inside an ellipse of ")
    lat, lon, _ = LocalFrame(*HOME).lla([20.5, 5.25, 0.0])
    (found, *_) = (
        point for point in gpxpy.parse(exported("gpx", recording).decode()).waypoints if "found" in point.name
    )
    assert (found.latitude, found.longitude) == pytest.approx((lat, lon), abs=1e-8)


def test_a_place_that_was_doubted_is_not_one_of_a_search_that_was_killed(tmp_path: Path) -> None:
    """The transmitter has no id: its second place is of the same one."""
    folder = write_search(tmp_path, ended=False)
    place = {"transmitter": None, "north_m": 10.0, "east_m": -3.0, "sure": True}
    events = [
        {"event": "place_found", "time_s": 2.0, **place},
        {"event": "place_doubted", "time_s": 3.0, **place},
        {"event": "place_found", "time_s": 4.0, **place, "north_m": 12.0},
        {"event": "victim_noted", "time_s": 5.0, **place, "north_m": 12.0, "sure": False},
        {"event": "place_doubted", "time_s": 6.0, **place, "east_m": 30.0},
    ]
    written(folder / "search.jsonl", "".join(json.dumps(event) + "\n" for event in events))
    search = load(folder).search
    assert search is not None
    assert [(one.north, one.sure) for one in search.places] == [(12.0, False)]


def test_kml_has_d_beside_each_point_and_nothing_where_nothing_is_heard(tmp_path: Path) -> None:
    root = etree.fromstring(exported("kml", load(write(tmp_path / "flight", COUNT, search=False))))
    gx = "{http://www.google.com/kml/ext/2.2}"
    arrays = {array.get("name"): [value.text for value in array] for array in root.iter(f"{gx}SimpleArrayData")}
    assert [float(text) for text in arrays["d_m"]] == [
        made.reading.channels[0].d_cm / 100 for made in frames(DEFAULT, COUNT)[SILENT:]
    ]
    assert len(arrays["true_range_m"]) == COUNT - SILENT


def test_gpx_has_every_point_and_the_ellipse_as_a_route(tmp_path: Path) -> None:
    parsed = gpxpy.parse(exported("gpx", load(write(tmp_path / "flight", COUNT))).decode())
    receiver, search = parsed.tracks
    (segment,) = receiver.segments
    assert len(segment.points) == COUNT - SILENT
    for n, point in enumerate(segment.points, SILENT):
        lat, lon, alt = where(n)
        assert (point.latitude, point.longitude) == pytest.approx((lat, lon), abs=6e-9)
        assert point.elevation == pytest.approx(alt, abs=6e-4)
        assert point.time.isoformat() == f"2027-01-01T00:00:{2 + n:02}+00:00"
        (d,) = point.extensions
        assert float(d.text) == frames(DEFAULT, COUNT)[n].reading.channels[0].d_cm / 100
    assert [point.name for point in parsed.waypoints] == ["place found: transmitter 1", "transmitter 1"]
    truth = parsed.waypoints[1]
    there = LocalFrame(*HOME).ned(truth.latitude, truth.longitude, truth.elevation)
    assert there.tolist() == pytest.approx([20, 5, 0], abs=1e-3)
    assert len(parsed.routes[0].points) == 49
    assert search.name == "search"


def test_gpx_begins_a_new_segment_where_the_pose_was_lost(tmp_path: Path) -> None:
    folder = write(tmp_path / "flight", COUNT, search=False)
    lines = (folder / "readings.csv").read_text().splitlines(keepends=True)
    for n in range(1 + 4 * 10, 1 + 4 * 12):
        cells = lines[n].split(",")
        lines[n] = ",".join([*cells[:3], *[""] * 7, *cells[10:]])
    (folder / "readings.csv").write_text("".join(lines))
    (track,) = gpxpy.parse(exported("gpx", load(folder)).decode()).tracks
    assert [len(segment.points) for segment in track.segments] == [7, 8]


def test_geojson_is_valid_and_has_each_reading_as_a_point(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(geojson.geometry, "DEFAULT_PRECISION", 15)
    collection = geojson.loads(exported("geojson", load(write(tmp_path / "flight", COUNT))))
    assert collection.is_valid, collection.errors()
    kinds: dict[str, list[Any]] = {}
    for feature in collection.features:
        kinds.setdefault(feature.properties["kind"], []).append(feature)
    assert {kind: len(features) for kind, features in kinds.items()} == {
        "found": 1,
        "ellipse": 1,
        "transmitter": 1,
        "track": 2,
        "reading": COUNT - SILENT,
    }
    for n, feature in enumerate(kinds["reading"], SILENT):
        lat, lon, alt = where(n)
        assert feature.geometry.coordinates[:2] == pytest.approx([lon, lat], abs=6e-9)
        assert feature.geometry.coordinates[2] == pytest.approx(alt, abs=6e-4)
        channel = frames(DEFAULT, COUNT)[n].reading.channels[0]
        (heard,) = feature.properties["heard"]
        assert (heard["id"], heard["d_cm"], heard["delta_deg"]) == (channel.id, channel.d_cm, channel.delta_deg)
        assert heard["true_range_m"] == channel.true_range_m
    (ring,) = kinds["ellipse"][0].geometry.coordinates
    assert ring[0] == ring[-1]
    area = sum(x1 * y2 - x2 * y1 for (x1, y1), (x2, y2) in pairwise(ring))
    assert area > 0  # anticlockwise, as RFC 7946 wants it


def test_csv_has_every_reading_once_with_what_the_search_did_then(tmp_path: Path) -> None:
    folder = write(tmp_path / "flight", COUNT)
    rows = list(csv.DictReader(io.StringIO(exported("csv", load(folder)).decode())))
    readings = table(folder / "readings.csv")
    assert len(rows) == len(readings) == 4 * COUNT
    for row, reading in zip(rows, readings, strict=True):
        for name, value in reading.items():
            if name == "id" and not value:
                assert row[name] == "-1"
            elif name == "faults" or not value:
                assert row[name] == value
            else:
                assert float(row[name]) == float(value)
    for n in range(SILENT, COUNT):
        assert [float(rows[4 * n][name]) for name in ("lat_deg", "lon_deg")] == pytest.approx(where(n)[:2], abs=6e-9)
        assert float(rows[4 * n]["alt_m"]) == pytest.approx(where(n)[2], abs=6e-4)
        assert rows[4 * n]["utc"] == f"2027-01-01T00:00:{2 + n:02}.000Z"
    assert [rows[4 * n]["search_phase"] for n in range(5)] == ["", "climbing", "flying", "flying", "landing"]


@pytest.mark.parametrize("name", EXPORTS)
def test_two_receivers_and_a_search_alone_and_an_empty_run_are_written(name: str, tmp_path: Path) -> None:
    for folder in (write(tmp_path / "none", 0, search=False), write(tmp_path / "one", 4), write_search(tmp_path / "s")):
        data = exported(name, load(folder))
        if name in ("kml", "gpx"):
            etree.fromstring(data)
        elif name == "geojson":
            assert geojson.loads(data).is_valid
        else:
            assert data.count(b"\n") >= 1


@pytest.mark.parametrize("name", ["kml", "gpx", "geojson", "csv"])  # MCAP is binary
def test_text_from_outside_is_data_and_nothing_else(name: str, tmp_path: Path) -> None:
    how = write_search(write(tmp_path / EVIL.replace("/", "-"), 10, search=False), how=EVIL)
    data = exported(name, load(how))
    assert b"\x1b" not in data
    assert "\u202e".encode() not in data
    if name == "csv":
        assert all(not cell.startswith("=") for row in csv.reader(io.StringIO(data.decode())) for cell in row)
    elif name == "geojson":
        assert geojson.loads(data).is_valid
    else:
        assert not list(etree.fromstring(data).iter("{*}script"))


@pytest.mark.parametrize("name", [*EXPORTS])
@pytest.mark.parametrize("huge", ["1e308", "-1e308", "1e14"])
@pytest.mark.parametrize("of_search", [(5,), (2, 3, 4, 9, 10, 11, 12)])
def test_numbers_that_no_flight_has_are_written_or_left_out(
    name: str, huge: str, of_search: tuple[int, ...], tmp_path: Path
) -> None:
    folder = write(tmp_path / "flight", 5)
    for table_name, columns in (("readings.csv", (3, 5)), ("search.csv", of_search)):
        header, *rows = [line.split(",") for line in (folder / table_name).read_text().splitlines()]
        for row in rows:
            for column in columns:
                row[column] = huge
        written(folder / table_name, "".join(",".join(row) + "\n" for row in (header, *rows)))
    said = json.loads((folder / "search.json").read_text())
    said["found"] |= {"down": float(huge), "earth_covariance": [float(huge)] * 3}
    written(folder / "search.json", json.dumps(said))
    with open(folder / "events.jsonl", "a") as file:
        file.write('{"event": "status", "time_s": 1e14, "vehicles": []}\n')
    assert exported(name, load(folder))


@pytest.mark.parametrize("name", [*EXPORTS])
@pytest.mark.parametrize("place", [[91.0, 7.0, 0.0], [46.0, 181.0, 0.0]])
def test_a_place_that_is_not_on_earth_is_not_known(name: str, place: list[float], tmp_path: Path) -> None:
    folder = write(tmp_path / "flight", 5)
    search, run = (json.loads((folder / file).read_text()) for file in ("search.json", "run.json"))
    search["origin"], search["found"]["lat_lon"], run["datums"][0]["lat_lon_alt"] = place, place[:2], place
    written(folder / "search.json", json.dumps(search))
    written(folder / "run.json", json.dumps(run))
    read = load(folder)
    assert exported(name, read)
    assert (read.search.origin, read.search.found.lat_lon, read.datums) == (None, None, {"": ()})


def test_a_run_whose_datum_nobody_knows_has_no_place_on_earth_and_the_table_has_the_rest(tmp_path: Path) -> None:
    folder = write(tmp_path / "flight", 5, ended=False, search=False)
    (folder / "events.jsonl").unlink()
    recording = load(folder)
    assert gpxpy.parse(exported("gpx", recording).decode()).tracks == []
    rows = list(csv.DictReader(io.StringIO(exported("csv", recording).decode())))
    assert (rows[12]["lat_deg"], rows[12]["north_m"]) == ("", repr(0.9 * 3))
    assert math.isfinite(float(rows[12]["d_cm"]))


def one_wide_frame(folder: Path, count: int) -> Path:
    """A record of a frame with 255 slots and so many with one slot."""
    path = write(folder, 0, search=False) / "readings.csv"
    columns = path.read_text().strip().split(",")
    filled = dict.fromkeys(("id", "north_m", "east_m", "down_m"), "1") | {"zone": "0", "d_cm": "-1", "delta_deg": "-1"}
    rows = [("0", "0", slot + 1) for slot in range(255)] + [("1", str(n), 1) for n in range(count)]
    with open(path, "a") as file:
        for seq, time_s, slot in rows:
            cells = filled | {"seq": seq, "time_s": time_s, "slot": str(slot)}
            file.write(",".join(cells.get(name, "") for name in columns) + "\n")
    return folder


@pytest.mark.parametrize("name", ["csv", "geojson", "gpx", "kml"])
def test_memory_follows_the_file_and_slots_that_are_not_there_cost_nothing(tmp_path: Path, name: str) -> None:
    exported(name, load(one_wide_frame(tmp_path / "small", 10)))  # whatever is imported and cached once
    folder = one_wide_frame(tmp_path / "flight", 1500)
    with open(os.devnull, "wb") as nowhere:
        tracemalloc.start()
        EXPORTS[name](load(folder), nowhere)
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
    assert peak < 20 * (folder / "readings.csv").stat().st_size


def test_a_table_has_the_slots_that_the_receiver_has_shown(tmp_path: Path) -> None:
    rows = list(csv.DictReader(exported("csv", load(one_wide_frame(tmp_path / "flight", 10))).decode().splitlines()))
    assert [int(row["slot"]) for row in rows] == [*range(1, 256), *[1] * 10]


def test_a_long_track_is_several_lines_end_to_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("arva_hil.records.exports.geojson._LONGEST_LINE", 10)
    document = geojson.loads(exported("geojson", load(one_wide_frame(tmp_path / "flight", 21))))
    lines = [f["geometry"]["coordinates"] for f in document["features"] if f["properties"]["kind"] == "track"]
    assert [len(line) for line in lines] == [11, 11, 2]
    assert lines[0][-1] == lines[1][0]


# -- a record as MCAP, read back by two libraries that others wrote, and by ROS 2's own where there is one -----


PYTHON = os.environ.get("ARVA_ROS2_PYTHON", "")
Read = Callable[[Path], Iterator[tuple[str, int, Any]]]


def by_mcap(path: Path) -> Iterator[tuple[str, int, Any]]:
    """(topic, nanoseconds, message) by the readers of MCAP's own authors."""
    with path.open("rb") as file:
        for _, channel, message, decoded in make_reader(
            file, decoder_factories=[DecoderFactory()]
        ).iter_decoded_messages():
            yield channel.topic, message.log_time, slots(decoded)


def by_rosbags(path: Path) -> Iterator[tuple[str, int, Any]]:
    """The same by rosbags."""
    with AnyReader([path]) as bag:
        for connection, stamp_ns, data in bag.messages():
            yield connection.topic, stamp_ns, plain(bag.deserialize(data, connection.msgtype))


def slots(message: Any) -> Any:
    """A message of mcap_ros2 as numbers, texts, lists and dictionaries."""
    if hasattr(message, "__slots__"):
        return {name: slots(getattr(message, name)) for name in message.__slots__}
    return [slots(one) for one in message] if isinstance(message, list | tuple) else plain(message)


READERS = pytest.mark.parametrize("read", [by_mcap, by_rosbags], ids=["mcap", "rosbags"])


def mcap_of(folder: Path) -> Path:
    path = folder.with_suffix(".mcap")
    with path.open("wb") as out:
        EXPORTS["mcap"](load(folder), out)
    return path


def expected(folder: Path) -> list[tuple[int, list[tuple[float, ...]], tuple[float, ...] | None]]:
    """Each frame of the tables: milliseconds since 1970, its slots, and its place ENU."""
    rows: dict[str, list[dict[str, str]]] = {}
    for row in table(folder / "readings.csv"):
        rows.setdefault(row["time_s"], []).append(row)
    frames = []
    for frame in table(folder / "frames.csv"):
        of_frame = rows[frame["time_s"]]
        heard = [(int(r["id"] or -1), float(r["d_cm"]), int(r["delta_deg"]), int(r["zone"])) for r in of_frame]
        first = of_frame[0]
        place = None
        if first["north_m"]:
            place = (float(first["east_m"]), float(first["north_m"]), -float(first["down_m"]))
        frames.append((round(datetime.fromisoformat(frame["utc"]).timestamp() * 1e3), heard, place))
    return frames


@READERS
def test_every_reading_is_there_once_with_the_values_of_the_tables(read: Read, tmp_path: Path) -> None:
    folder = write(tmp_path / "run", 40)
    every = list(read(mcap_of(folder)))
    readings = [(stamp, message) for topic, stamp, message in every if topic == "/arva"]
    frames = expected(folder)
    assert len(readings) == len(frames) == 40
    for (stamp, message), (utc_ms, heard, _) in zip(readings, frames, strict=True):
        assert stamp / 1e6 == pytest.approx(utc_ms, abs=1)
        assert message["header"]["stamp"]["sec"] * 10**9 + message["header"]["stamp"]["nanosec"] == stamp
        assert [(s["id"], s["distance"], s["delta"], s["zone"]) for s in message["arva_signals"]] == heard
    poses = [message["pose"]["position"] for topic, _, message in every if topic == "/arva/pose"]
    assert [(p["x"], p["y"], p["z"]) for p in poses] == [place for _, _, place in frames if place]


@READERS
def test_the_place_found_is_there(read: Read, tmp_path: Path) -> None:
    every = {topic: message for topic, _, message in read(mcap_of(write(tmp_path / "run")))}
    assert (every["/search/found"]["latitude"], every["/search/found"]["longitude"]) == pytest.approx(
        json.loads((tmp_path / "run" / "search.json").read_text())["found"]["lat_lon"], abs=1e-9
    )


def test_the_settings_of_the_run_are_attached(tmp_path: Path) -> None:
    folder = write(tmp_path / "run", 5)
    with mcap_of(folder).open("rb") as file:
        attached = {one.name: one.data for one in make_reader(file).iter_attachments()}
    for name in ("run.json", "search.json"):
        assert json.loads(attached[name]) == json.loads((folder / name).read_text())
    assert parse(attached["scenario.yaml"].decode(), "x").transmitters == DEFAULT.transmitters


@READERS
def test_a_run_without_a_frame_is_an_empty_file_that_can_be_read(read: Read, tmp_path: Path) -> None:
    assert list(read(mcap_of(write(tmp_path / "run", 0, search=False)))) == []


def test_one_reading_and_a_search_alone(tmp_path: Path) -> None:
    assert [topic for topic, _, _ in by_mcap(mcap_of(write(tmp_path / "one", 1, search=False)))].count("/arva") == 1
    (tmp_path / "search").mkdir()
    assert "/search/arva" in {topic for topic, _, _ in by_mcap(mcap_of(write_search(tmp_path / "search")))}


def test_it_says_that_it_is_of_ros_2_and_which_schemas_it_has(tmp_path: Path) -> None:
    with mcap_of(write(tmp_path / "run", 5)).open("rb") as file:
        reader = make_reader(file)
        assert reader.get_header().profile == "ros2"
        summary = reader.get_summary()
    assert {schema.encoding for schema in summary.schemas.values()} == {"ros2msg"}
    assert {channel.message_encoding for channel in summary.channels.values()} == {"cdr"}


def test_the_same_record_gives_the_same_bytes(tmp_path: Path) -> None:
    recording = load(write(tmp_path / "run"))
    twice = [io.BytesIO(), io.BytesIO()]
    for out in twice:
        EXPORTS["mcap"](recording, out)
    assert twice[0].getvalue() == twice[1].getvalue()


@pytest.mark.skipif(not PYTHON, reason="ARVA_ROS2_PYTHON names no Python with rclpy and arva_msgs")
def test_ros_2_itself_reads_every_message(tmp_path: Path) -> None:
    folder = write(tmp_path / "run")
    path = mcap_of(folder)
    script = Path(__file__).with_name("ros_messages") / "deserialize.py"
    ended = subprocess.run([PYTHON, script, path], capture_output=True, text=True, check=True, timeout=100)
    told = json.loads(ended.stdout)
    frames = expected(folder)
    assert [[tuple(slot) for slot in reading] for reading in told["readings"]] == [heard for _, heard, _ in frames]
    assert told["left_out"] in ([], ["tf2_msgs"])  # which PyPI's build of ROS 2 has not
    assert sum(told["counts"].values()) >= len(list(by_mcap(path))) * (0.8 if told["left_out"] else 1)
