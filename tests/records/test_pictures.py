"""Pictures of records show what is in readings.csv, and every record has one."""

from __future__ import annotations

import io
import itertools
import re
import warnings
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray
from PIL import Image

from arva_hil.config import DEFAULT, parse
from arva_hil.links.tlog import tlog_record
from arva_hil.mavlink.codec import Encoder, dialect
from arva_hil.records.pictures import over_time, run
from arva_hil.records.pictures.flight_map import draw_map
from arva_hil.records.pictures.over_time import draw_distance, draw_lateness, draw_streams, draw_timeline
from arva_hil.records.pictures.run import of_search
from arva_hil.records.pictures.style import LOOKS, MOST_POINTS, SHAPES, look_of, thinned
from arva_hil.records.reading import load
from arva_hil.records.reading.streams import streams
from tests.every import every
from tests.made_records import EPOCH_US, SILENT, frames, write, write_search

COUNT = 20


@pytest.fixture(autouse=True)
def _no_warning() -> Iterator[None]:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        yield


@pytest.fixture
def axes() -> Axes:
    return Figure().add_subplot()


def labelled(axes: Axes) -> dict[str, np.ndarray]:
    """The points (N, 2) of each curve that has a label."""
    return {
        str(line.get_label()): np.asarray(line.get_xydata()) for line in axes.lines if str(line.get_label())[0] != "_"
    }


def test_the_map_has_the_track_the_place_found_and_the_transmitters(axes: Axes, tmp_path: Path) -> None:
    recording = load(write(tmp_path / "flight", COUNT))
    draw_map(axes, recording, recording.receivers[0])
    curves = labelled(axes)
    poses = [made.pose.position for made in frames(DEFAULT, COUNT) if made.pose]
    np.testing.assert_allclose(curves["mid zone"], [(east, north) for north, east, _ in poses])
    assert curves["place found, 95 % on Earth"].tolist()[0] == pytest.approx([5.25, 20.5], abs=1e-3)
    assert curves["transmitter 1, dipole"].tolist() == [[5.0, 20.0]]
    assert curves["search: its own position"][0].tolist() == pytest.approx([0.0, 2.0], abs=1e-3)
    assert {text.get_text() for text in axes.texts} >= {"1", "10 m", "20 m"}
    assert axes.get_xlabel().endswith(", m")
    assert axes.get_aspect() == 1.0


def test_the_map_has_every_victim(axes: Axes, tmp_path: Path) -> None:
    folder = write(tmp_path / "flight", COUNT, search=False)
    places = [{"north": north, "east": 5.25, "down": 0.0, "covariance": None, "lat_lon": None} for north in (18.5, 8.5)]
    write_search(folder, COUNT, victims=places, wanted=2)
    recording = load(folder)
    draw_map(axes, recording, recording.receivers[0])
    crosses = [line.get_xydata() for line in axes.lines if line.get_marker() == "x"]
    assert np.concatenate(crosses).tolist() == [pytest.approx([5.25, n], abs=1e-3) for n in (20.5, 10.5)]
    assert {text.get_text() for text in axes.texts} >= {"victim 1", "victim 2"}


def test_a_search_that_ended_before_its_first_step_is_drawn(tmp_path: Path) -> None:
    folder = write_search(write(tmp_path / "flight", COUNT, search=False), 0, outcome="failed", found=None)
    assert of_search(load(folder)).startswith(b"\x89PNG")


def test_d_is_drawn_as_read_beside_the_true_range(axes: Axes, tmp_path: Path) -> None:
    recording = load(write(tmp_path / "flight", COUNT))
    draw_distance(axes, recording, recording.receivers[0])
    curves = labelled(axes)
    made = frames(DEFAULT, COUNT)[SILENT:]
    assert curves["d, mid zone"].tolist() == [[m.instant_s, m.reading.channels[0].d_cm / 100] for m in made]
    shown = curves["transmitter 1: true range"][SILENT:]
    assert shown.tolist() == [[m.instant_s, m.reading.channels[0].true_range_m] for m in made]


def test_the_true_range_goes_on_where_nothing_is_heard(axes: Axes, tmp_path: Path) -> None:
    scenario = parse("transmitters: [{id: 5, enu: [0, 500, 0]}]\n", "x")
    recording = load(write(tmp_path / "flight", COUNT, scenario, search=False))
    draw_distance(axes, recording, recording.receivers[0])
    assert labelled(axes)["transmitter 5: true range"][SILENT:, 1].tolist() == pytest.approx(
        [np.hypot(500 - 0.9 * n, np.hypot(0.3 * n, 3)) for n in range(SILENT, COUNT)]
    )


def test_the_timeline_has_each_fault_when_it_struck(axes: Axes, tmp_path: Path) -> None:
    recording = load(write(tmp_path / "flight", COUNT))
    lanes = dict(over_time._lanes(recording, recording.receivers[0]))
    assert list(lanes) == ["pose", "zone", "stuck", "drop", "search"]
    assert [(begin, end) for begin, end, _ in lanes["stuck"]] == [(6.0, 7.0), (13.0, 14.0)]
    assert [(begin, end) for begin, end, _ in lanes["pose"]] == [(3.0, 20.0)]
    assert [time_s for span in lanes["search"] for time_s in span[:2]] == pytest.approx([1, 2, 2, 4, 4, 4.8])
    draw_timeline(axes, recording, recording.receivers[0])
    assert [label.get_text() for label in axes.get_yticklabels()] == list(lanes)


def test_dollars_are_no_formula(tmp_path: Path) -> None:
    name = r"$\frac$"
    folder = write(tmp_path / name, COUNT, search=False)
    readings = folder / "readings.csv"
    readings.write_text(readings.read_text().replace("stuck+drop", name))
    ((_, data),) = run.sheets(load(folder), "png")
    assert data


def test_the_lateness_is_that_of_all_frames(axes: Axes, tmp_path: Path) -> None:
    draw_lateness(axes, load(write(tmp_path / "flight", COUNT)).receivers[0])
    assert sum(bar.get_height() for bar in axes.patches) == COUNT  # type: ignore[attr-defined]
    assert "50 % of the frames: up to 2 ms" in labelled(axes)
    assert axes.get_xlabel().endswith(", ms")


def test_rates_are_those_of_the_vehicle_s_packets_in_each_second(axes: Axes, tmp_path: Path) -> None:
    folder = write(tmp_path / "flight", COUNT, search=False)
    ours, others = Encoder(1, 1), Encoder(1, 190)
    log = b""
    for n in range(100):
        message = dialect.MAVLink_attitude_message(n, 0, 0, 0, 0, 0, 0)
        beat = dialect.MAVLink_heartbeat_message(2, 3, 0, 0, 3, 3)
        log += tlog_record(EPOCH_US + 2_000_000 + n * 50_000, ours.pack(message))
        log += tlog_record(EPOCH_US + 2_000_000 + n * 50_000, others.pack(beat))
    (folder / "autopilot.tlog").write_bytes(log)
    (stream,) = streams(load(folder))
    assert (stream.name, stream.hz.tolist()) == ("ATTITUDE", [20.0] * 5)
    assert stream.time_s.tolist() == [0.0, 1.0, 2.0, 3.0, 4.0]
    draw_streams(axes, [stream])
    assert labelled(axes)["ATTITUDE, 20 Hz"].tolist() == [[n, 20] for n in range(5)]


def damaged(folder: Path) -> Path:
    """A scenario that nobody can read, and poses of NaN."""
    (folder / "run.json").write_text((folder / "run.json").read_text().replace('"kappa_eq"', '"x"'))
    rows = [line.split(",") for line in (folder / "readings.csv").read_text().splitlines()]
    rows = [rows[0], *([*row[:3], *["nan"] * 6, *row[9:]] for row in rows[1:])]
    (folder / "readings.csv").write_text("\n".join(map(",".join, rows)) + "\n")
    return folder


def test_every_record_has_a_picture_whatever_is_missing_in_it(tmp_path: Path) -> None:
    records = [
        write(tmp_path / "none", 0, search=False),
        write(tmp_path / "one", 1, search=False),
        write(tmp_path / "killed", 9, ended=False),
        damaged(write(tmp_path / "damaged", 9, search=False)),
        write_search(tmp_path / "search"),
        write_search(tmp_path / "step", 1, found=None),
    ]
    for folder in records:
        for _, draws in run._draws(load(folder)):
            for draw in draws.values():
                axes = Figure().add_subplot()
                draw(axes)
                assert axes.get_title()
    ((_, data),) = run.sheets(load(records[0]), "png")
    width, height = Image.open(io.BytesIO(data)).size
    assert width > height > 900


def test_svg_needs_nothing_else_and_is_the_same_again(tmp_path: Path) -> None:
    recording = load(write(tmp_path / "flight", 5))
    (_, name, first), (_, _, again) = (next(run.pictures(recording, "svg")) for _ in range(2))
    assert name == "map"
    assert first == again
    links = re.findall(r'(?:href|src)="([^"]*)"|url\(([^)]*)\)', first.decode())
    assert links
    assert all((a or b).startswith("#") for a, b in links)


def test_a_long_record_is_thinned_and_its_ends_stay() -> None:
    rows = thinned(1_000_000)
    assert len(rows) <= MOST_POINTS
    assert (rows[0], rows[-1]) == (0, 999_999)
    assert thinned(3).tolist() == [0, 1, 2]
    assert thinned(0).tolist() in ([], [0])
    struck = np.zeros(1_000_000, bool)
    struck[123_456] = True
    spans = over_time._spans(np.arange(1e6), struck, 1e6)
    assert len(spans) == 1
    assert spans[0][0] <= 123_456 < spans[0][1]  # also one frame of a million is seen


# -- transmitters look the same everywhere, and no two of 42 alike, whatever colours an eye can tell apart -----


PAGE = Path(__file__).parents[2] / "arva_hil/observers/web/page"
DIFFERENT = 15.0  # CIEDE2000: "just noticed" is 1
SIMULATED = {  # G. Machado, M. Oliveira, L. Fernandes, 2009: severity 1.0, of linear RGB
    "normal": [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
    "protanopia": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
    "deuteranopia": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.01182, 0.04294, 0.968881]],
    "tritanopia": [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.3039]],
}
XYZ = np.array([[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.072175], [0.0193339, 0.119192, 0.9503041]])


def linear(colour: str) -> NDArray[np.float64]:
    rgb = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255
    return np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)


def lab(rgb: NDArray[np.float64]) -> NDArray[np.float64]:
    x = XYZ @ np.clip(rgb, 0, 1) / [0.95047, 1, 1.08883]
    f = np.where(x > 216 / 24389, np.cbrt(x), (24389 / 27 * x + 16) / 116)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


def difference(one: NDArray[np.float64], other: NDArray[np.float64]) -> float:
    """CIEDE2000 (G. Sharma, W. Wu, E. Dalal, 2005)."""
    (l1, a1, b1), (l2, a2, b2) = one, other
    mean = (np.hypot(a1, b1) + np.hypot(a2, b2)) / 2
    g = 1.5 - 0.5 * np.sqrt(mean**7 / (mean**7 + 25**7))
    c1, c2 = np.hypot(g * a1, b1), np.hypot(g * a2, b2)
    h1, h2 = np.degrees(np.arctan2(b1, g * a1)) % 360, np.degrees(np.arctan2(b2, g * a2)) % 360
    dh = (h2 - h1 + 180) % 360 - 180 if c1 * c2 else 0.0
    hue = np.radians((h1 + dh / 2) % 360)
    lm, cm = (l1 + l2) / 2, (c1 + c2) / 2
    t = 1 - 0.17 * np.cos(hue - np.radians(30)) + 0.24 * np.cos(2 * hue)
    t += 0.32 * np.cos(3 * hue + np.radians(6)) - 0.2 * np.cos(4 * hue - np.radians(63))
    dl = (l2 - l1) / (1 + 0.015 * (lm - 50) ** 2 / np.sqrt(20 + (lm - 50) ** 2))
    dc = (c2 - c1) / (1 + 0.045 * cm)
    dh = 2 * np.sqrt(c1 * c2) * np.sin(np.radians(dh) / 2) / (1 + 0.015 * cm * t)
    turn = -2 * np.sqrt(cm**7 / (cm**7 + 25**7))
    turn *= np.sin(np.radians(60 * np.exp(-(((np.degrees(hue) - 275) / 25) ** 2))))
    return float(np.sqrt(dl**2 + dc**2 + dh**2 + turn * dc * dh))


def palettes() -> list[list[str]]:
    """Those of the page: light, dark, and the receiver's display."""
    css = (PAGE / "style.css").read_text()
    return [re.findall("#[0-9a-f]{6}", colours) for colours in re.findall(r"(?:--c\d: #[0-9a-f]{6}; ?){6}", css)]


def test_the_measure_is_that_of_its_authors() -> None:
    pairs = [((50, 2.6772, -79.7751), (50, 0, -82.7485), 2.0425), ((50, 2.5, 0), (73, 25, -18), 27.1492)]
    for one, other, expected in pairs:
        assert difference(np.array(one), np.array(other)) == pytest.approx(expected, abs=1e-4)


def test_pictures_and_page_have_the_same_colours_and_as_many_shapes() -> None:
    light, dark, display = palettes()
    assert light == list(LOOKS)
    assert dark == display
    assert (PAGE / "store.js").read_text().split("SHAPES = [")[1].split("]")[0].count('"M') == len(SHAPES)


@every("sight", SIMULATED)
@every("at", [0, 1])
def test_no_two_of_42_look_alike(sight: str, at: int) -> None:
    colours = {c: lab(np.array(SIMULATED[sight]) @ linear(c)) for c in palettes()[at]}
    apart = {pair: difference(*(colours[c] for c in pair)) for pair in itertools.combinations(colours, 2)}
    assert min(apart.values()) >= DIFFERENT, min(apart.items(), key=lambda pair: pair[1])
    looks = [look_of(id_) for id_ in range(len(LOOKS) * len(SHAPES))]
    assert len(set(looks)) == 42
    assert all(a[0] != b[0] and a[1] != b[1] for a, b in itertools.pairwise(looks))
