"""A record as MCAP, read back by two libraries that others wrote, and by ROS 2's own where there is one."""

from __future__ import annotations

import csv
import io
import json
import os
import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from datetime import datetime
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("mcap")

from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader

from arva_hil.cli.main import main
from arva_hil.config import DEFAULT, parse
from arva_hil.records.reading import load
from arva_hil.registry import EXPORTS
from tests.made_records import write, write_search
from tests.records.ros_messages.oracle import plain

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


def exported(folder: Path) -> Path:
    path = folder.with_suffix(".mcap")
    with path.open("wb") as out:
        EXPORTS["mcap"](load(folder), out)
    return path


def expected(folder: Path) -> list[tuple[int, list[tuple[float, ...]], tuple[float, ...] | None]]:
    """Each frame of the tables: milliseconds since 1970, its slots, and its place ENU."""
    rows: dict[str, list[dict[str, str]]] = {}
    for row in csv.DictReader((folder / "readings.csv").open()):
        rows.setdefault(row["time_s"], []).append(row)
    frames = []
    for frame in csv.DictReader((folder / "frames.csv").open()):
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
    every = list(read(exported(folder)))
    readings = [(stamp, message) for topic, stamp, message in every if topic == "/arva"]
    frames = expected(folder)
    assert len(readings) == len(frames) == 40
    for (stamp, message), (utc_ms, heard, _) in zip(readings, frames, strict=True):
        assert stamp / 1e6 == pytest.approx(utc_ms, abs=1)
        assert message["header"]["stamp"]["sec"] * 10**9 + message["header"]["stamp"]["nanosec"] == stamp
        told = [(s["id"], s["distance"], s["delta"], s["zone"]) for s in message["arva_signals"]]
        assert told == heard
    poses = [message["pose"]["position"] for topic, _, message in every if topic == "/arva/pose"]
    assert [(p["x"], p["y"], p["z"]) for p in poses] == [place for _, _, place in frames if place]


@READERS
def test_the_place_found_is_there(read: Read, tmp_path: Path) -> None:
    every = {topic: message for topic, _, message in read(exported(write(tmp_path / "run")))}
    found = json.loads((tmp_path / "run" / "search.json").read_text())["found"]
    assert (every["/search/found"]["latitude"], every["/search/found"]["longitude"]) == pytest.approx(
        found["lat_lon"], abs=1e-9
    )


def test_the_settings_of_the_run_are_attached(tmp_path: Path) -> None:
    folder = write(tmp_path / "run", 5)
    with exported(folder).open("rb") as file:
        attached = {one.name: one.data for one in make_reader(file).iter_attachments()}
    for name in ("run.json", "search.json"):
        assert json.loads(attached[name]) == json.loads((folder / name).read_text())
    assert parse(attached["scenario.yaml"].decode(), "x").transmitters == DEFAULT.transmitters


@READERS
def test_a_run_without_a_frame_is_an_empty_file_that_can_be_read(read: Read, tmp_path: Path) -> None:
    assert list(read(exported(write(tmp_path / "run", 0, search=False)))) == []


def test_one_reading_and_a_search_alone(tmp_path: Path) -> None:
    assert [topic for topic, _, _ in by_mcap(exported(write(tmp_path / "one", 1, search=False)))].count("/arva") == 1
    (tmp_path / "search").mkdir()
    topics = {topic for topic, _, _ in by_mcap(exported(write_search(tmp_path / "search")))}
    assert "/search/arva" in topics


def test_it_says_that_it_is_of_ros_2_and_which_schemas_it_has(tmp_path: Path) -> None:
    with exported(write(tmp_path / "run", 5)).open("rb") as file:
        reader = make_reader(file)
        assert reader.get_header().profile == "ros2"
        summary = reader.get_summary()
    assert summary is not None
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
    path = exported(folder)
    script = Path(__file__).with_name("ros_messages") / "deserialize.py"
    ended = subprocess.run([PYTHON, script, path], capture_output=True, text=True, check=True, timeout=100)
    told = json.loads(ended.stdout)
    frames = expected(folder)
    assert [[tuple(slot) for slot in reading] for reading in told["readings"]] == [heard for _, heard, _ in frames]
    assert told["left_out"] in ([], ["tf2_msgs"])  # which PyPI's build of ROS 2 has not
    assert sum(told["counts"].values()) >= len(list(by_mcap(path))) * (0.8 if told["left_out"] else 1)


def test_without_the_package_the_command_to_install_it_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(EXPORTS, "loaded", {})
    for name in ("arva_hil.records.exports.mcap", "mcap.writer"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    monkeypatch.setitem(sys.modules, "mcap", None)
    assert main(["export", str(write(tmp_path / "run", 3)), "--out", str(tmp_path / "x.mcap")]) == 2
    said = r"--format mcap needs mcap(\.writer)?, which is missing: pip install 'arva-hil\[mcap\]'"
    assert re.search(said, capsys.readouterr().err)
    assert not (tmp_path / "x.mcap").exists()
