"""The programs around the emulator: fuzzing, the figures of the receiver, the bench."""

from __future__ import annotations

import json
import math
import re
import subprocess
import sys
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.figure import Figure
from PIL import Image

from arva_hil.autopilot.commanding.authority import BOUND_MS
from arva_hil.model.receiver import Antennas, Zone
from tests.paper_receiver import Receiver
from tools.bench import finds
from tools.bench import speed as bench
from tools.bench.table import Row, conditions, ratio, read, slower, write
from tools.figures import fits, paper
from tools.figures.receivers import FIGURES, OURS, novices, overlaps
from tools.fuzz import decoder, loader, session
from tools.fuzz import python as tool
from tools.sitl import fly
from tools.sitl.judge import BEGINS, Flight, judge
from tools.sitl.relay import Place


@pytest.mark.parametrize(
    ("target", "count"),
    [("loader", 30), ("session", 40), ("decoder", 300), ("commands", 300), ("log", 40), ("team", 60)],
)
def test_what_has_to_hold_holds_on_the_seeds_and_on_damaged_ones(target: str, count: int) -> None:
    module = tool.module(target)
    every = list(module.seeds())
    assert len(every) >= 5
    for data in every + list(tool.damaged(every, count, 457)):
        try:
            module.fuzz(data)
        except Exception as error:
            raise AssertionError(f"{target}: {data.hex()}") from error


FOUND = [  # inputs that once failed
    ("loader", b"transmitters: []\rseed: 1 # caf\xe9\r"),
    ("decoder", bytes.fromhex("08 00 1f 02 d204000000000000 0000c07f 00000000 00000000 61 000000000000000000 00")),
    ("decoder", bytes.fromhex("08 00 1f 02 d204000000000000 0000807f 00000000 00000000 61 000000000000000000 00")),
    ("decoder", bytes.fromhex("06 00 13 01 01000000 01000000 41525641315f58000000 00 13 01 01000000 01000000")
     + b"ARVA1_D\0\0\0"),
    ("team", bytes.fromhex("00000000471f00000000000000000094000000002e68")),  # a transmitter heard far outside the area
    ("team", bytes.fromhex(  # two vehicles: out of the way of the second one is the way to the first one
        "0032" + 19 * "00" + "ae" + 11 * "00" + "c0" + 35 * "00" + "a7a6a9f10087" + 4 * "00" + "65" + 8 * "00"
        "0c00ceb36f55000100000000b5ef00000000005e000000f100000000000000000000006a00000000000000008e000087000a2700ba0910a1"
        "00000017" + 8 * "00" + "98")),
]  # fmt: skip


@pytest.mark.parametrize(("target", "data"), FOUND)
def test_what_was_found_once(target: str, data: bytes) -> None:
    tool.module(target).fuzz(data)


def wrong_session(monkeypatch: pytest.MonkeyPatch) -> str:
    """Knows more than its twin, as if it had listened to somebody else."""
    monkeypatch.setattr(session.Bench, "_alone", lambda self, twin, packet: [packet])
    return "session"


def wrong_loader(monkeypatch: pytest.MonkeyPatch) -> str:
    """Reads back another seed than was written."""
    plain = loader.to_dict
    monkeypatch.setattr(loader, "to_dict", lambda scenario: {**plain(scenario), "seed": 7})
    return "loader"


def wrong_decoder(monkeypatch: pytest.MonkeyPatch) -> str:
    """Says another distance than was sent."""

    class Wrong(decoder.DECODERS["binary"]):  # type: ignore[misc]
        def feed(self, chunk: bytes, now: float) -> Any:
            return [f._replace(channels=(f.channels[0]._replace(d=5),)) for f in super().feed(chunk, now)]

    monkeypatch.setitem(decoder.DECODERS, "binary", Wrong)
    return "decoder"


@pytest.mark.parametrize("make", [wrong_session, wrong_loader, wrong_decoder])
def test_what_is_wrong_is_found(make: Callable[[pytest.MonkeyPatch], str], monkeypatch: pytest.MonkeyPatch) -> None:
    module = tool.module(make(monkeypatch))
    with pytest.raises(AssertionError):
        list(map(module.fuzz, module.seeds()))


def run(*arguments: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "tools", "fuzz", "python", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=60)


def test_an_input_is_tried_again(tmp_path: Path) -> None:
    good = tmp_path / "good"
    good.write_bytes(b"seed: 1")
    done = run("loader", "--reproduce", good)
    assert (done.returncode, done.stdout) == (0, f"{good}: passes\n")


def test_without_atheris_damaged_seeds_are_tried_and_what_fails_is_kept(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert tool.run_damaged("team", 3, 1) == 0
    assert capsys.readouterr().out == "team: 43 runs, seed 1, 0 findings\n"
    assert tool.run_damaged(wrong_decoder(monkeypatch), 3, 1) == 1
    assert len(list(tmp_path.glob("crash-decoder-1-*"))) == 1


def test_without_atheris_it_says_what_to_install() -> None:
    hide = "import runpy, sys; sys.modules['atheris'] = None; "
    hide += "runpy.run_module('tools', run_name='__main__')"
    command = [sys.executable, "-c", hide, "fuzz", "python", "loader", "--seconds", "1"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert done.returncode == 2
    assert re.search(r"atheris is not installed: pip install 'arva-hil\[fuzz\]'", done.stderr)


def test_a_wrong_target_is_refused() -> None:
    done = run("lodaer")
    assert done.returncode == 2
    assert "invalid choice: 'lodaer'" in done.stderr


# The figures of the receiver that listens to pulses are those of the literature, or those that we say are ours


QUICK = {name: figure for name, figure in FIGURES.items() if name != "overlaps"}


@pytest.mark.parametrize("name", QUICK)
def test_a_figure_is_within_its_tolerance(name: str) -> None:
    rows = list(QUICK[name]())
    assert rows
    assert [row for row in rows if not row.good] == []
    assert all(row.source for row in rows)


def test_pulses_of_several_sets_touch_as_often_as_the_table_says() -> None:
    """Of some of the trials of the tool, with its tolerances."""
    rows = list(overlaps(300))
    assert [row for row in rows if not row.good] == []
    assert all(row.source.startswith(OURS) for row in rows)


def test_marks_fail_for_who_follows_the_nearest_of_four_old_sets_now_and_then() -> None:
    missed = int(novices(12).split(": ")[1].split(" of")[0])
    assert 1 <= missed <= 11


# -- The benchmark's rows: what is reached, and what got slower since another run -------------------------


ROW = ratio("work", "peer", 1.0, 4.0, "s", 0.25)


def test_a_row_is_judged_by_ours_over_the_peers() -> None:
    assert ROW.cost == 0.25
    assert ROW.reached
    assert not replace(ROW, cost=0.26).reached
    assert "MISSED" in replace(ROW, cost=0.26).line()


def test_rows_are_written_and_read_again(tmp_path: Path) -> None:
    rows = [ROW, Row("größer", "peer", 1, 2, "µs", 0.5, 1)]
    write(rows, tmp_path / "rows.json")
    found = read(tmp_path / "rows.json")
    assert found.rows == {row.work: row for row in rows}
    assert found.conditions == conditions()
    assert found.conditions.keys() == {"machine", "Python", "commit"}


NO_COST = json.dumps({"with": {}, "rows": [asdict(ROW) | {"cost": "0.25"}]})


@pytest.mark.parametrize("text", ["", "{}x", "{}", "[1]", '{"with": {}, "rows": [{"work": "alone"}]}', NO_COST])
def test_a_file_without_rows_is_refused_by_name(text: str, tmp_path: Path) -> None:
    (tmp_path / "rows.json").write_text(text)
    with pytest.raises(ValueError, match=r"rows\.json: is no baseline \(.+\); write one with --json$"):
        read(tmp_path / "rows.json")


def test_a_baseline_that_is_missing_is_refused_by_name_once() -> None:
    with pytest.raises(ValueError, match=r"^none\.json: No such file or directory; write a baseline with --json$"):
        read(Path("none.json"))


def test_what_got_slower_is_named_and_nothing_else() -> None:
    before = {"work": ROW}
    assert slower([replace(ROW, cost=0.3)], before) == []  # as two runs differ
    assert slower([replace(ROW, cost=0.35)], before) == ["work: 0.35, before 0.25"]
    assert slower([replace(ROW, work="new", cost=9.0)], before) == []


def test_check_names_what_got_slower_than_the_baseline_and_ends_with_1(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    write([ROW], tmp_path / "before.json")
    for cost, code, said in (0.25, 0, ""), (0.5, 1, "slower: work: 0.5, before 0.25\n"):
        group = [replace(ROW, cost=cost)]
        monkeypatch.setattr(bench, "_GROUPS", {"model": lambda _, rows=group: iter(rows)})
        monkeypatch.setattr(sys, "argv", ["bench", "--check", str(tmp_path / "before.json"), "model"])
        assert bench.main() == code
        assert capsys.readouterr().out.endswith(said)


def test_check_says_what_it_did_not_compare_and_what_else_was_different(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    path = tmp_path / "before.json"
    path.write_text(json.dumps({"with": conditions() | {"commit": "0123abc"}, "rows": [asdict(ROW)]}))
    for new, code, said in (
        ("also", 0, ""),
        ("only", 1, f"error: {path} has none of these rows: nothing was compared\n"),
    ):
        group = [replace(ROW, work=new)] if new == "only" else [ROW, replace(ROW, work=new)]
        monkeypatch.setattr(bench, "_GROUPS", {"model": lambda _, rows=group: iter(rows)})
        monkeypatch.setattr(sys, "argv", ["bench", "--check", str(path), "model"])
        assert bench.main() == code
        out = capsys.readouterr().out
        assert out.endswith(f"not compared: {new}: {path} has no such row\n{said}")
        assert f"{path}: measured with another commit 0123abc, now " in out
        assert "another machine" not in out


def test_the_kept_baseline_has_the_work_that_does_not_need_an_idle_machine() -> None:
    works = " ".join(read(Path(bench.__file__).with_name("baseline.json")).rows)
    for work in (
        "field of 4",
        "1,000,000 readings",
        "one reading",
        "MAVLink in",
        "whole replay",
        "closed loop",
        "--help",
    ):
        assert work in works


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--flight", "none.tlog", "starts"], "--flight: none.tlog: no such file"),
        (["--flight", __file__, "--seconds", "2", "live"], "--seconds 2: 5 at least"),
    ],
)
def test_what_cannot_be_measured_is_said_before_anything_is(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], words: list[str], said: str
) -> None:
    monkeypatch.setattr(sys, "argv", ["bench", *words])
    with pytest.raises(SystemExit) as ended:
        bench.main()
    assert ended.value.code == 2
    assert said in capsys.readouterr().err


# Judges of many flights: what cannot be compared with the truth does not count as good


@pytest.mark.parametrize(
    ("outcome", "error_m", "kind"),
    [("found", 3.0, "found"), ("found", 3.01, "false"), ("found", None, "false"), ("failed: x", None, "failed")],
)
def test_a_find_without_an_error_is_false(outcome: str, error_m: float | None, kind: str) -> None:
    assert finds.Flown(1, (), outcome, error_m, 60.0).kind == kind


def test_a_second_flight_without_common_readings_does_not_agree(capsys: pytest.CaptureFixture[str]) -> None:
    one = {"misses": {"latency": 0.5}, "scatter": 0.05, "doubts": [], "cpu_s": 1.0}
    fits.tell([one | {"second_ratio": ratio} for ratio in (1.04, 1.06, None)])
    assert "second flight agrees within the scatter: 1 of 3\n" in capsys.readouterr().out


# tools/sitl/fly.py: a real search, and a pilot who takes over while its process stands still


def test_no_order_comes_later_than_the_bound(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    monkeypatch.setenv("ARVA_HIL_COUNTDOWN", "0")
    monkeypatch.setattr(fly.signal, "signal", lambda *_: None)  # a handler of the tool would stay with all other tests
    fly.main(["vehicle", "pause", "--runs", "1", "--seed", "16", "--folder", str(tmp_path)])
    row, total = capsys.readouterr().out.splitlines()
    assert row.split()[:3] == ["vehicle", "pause", "16"]
    assert " kept True " in row
    assert " late 0 " in row
    assert total == f"1 flights, 0 bad; 0 orders later than {BOUND_MS} ms"


@pytest.mark.parametrize(
    ("kind", "heights", "good"),
    [("anywhere", [2.9], True), ("lie", [2.9], True), ("lie", [1.4], False)]
    + [(kind, heights, False) for kind in ("anywhere", "lie", "fence") for heights in ([], [math.nan])],
)
def test_without_a_true_height_in_the_search_no_flight_is_good(
    kind: str, heights: list[float], good: bool, tmp_path: Path
) -> None:
    places = [Place(1.0 + n, 47.0, 8.0, 490.0) for n in range(len(heights))]
    relay = SimpleNamespace(armed=False, notes=[], places=places)
    simulator: Any = SimpleNamespace(relay=relay, heights=lambda places: heights)
    said: Any = {BEGINS: 0.5}
    search: Any = SimpleNamespace(
        process=SimpleNamespace(poll=lambda: 0), out="", lines=[], began=0.0, said=lambda pattern: said.get(pattern)
    )
    flight = Flight("px4", kind, 1, 3.0, str(tmp_path))
    judge(flight, simulator, search, None, {1: (0.0, 0.0, 0.0)})
    assert flight.good is good


# The data behind the figures of tools/figures/paper.py, against the paper's equations; and that the files are made


KAPPA, MID_M, BOUND = 1.542, 50.0, 1 / (2 * np.pi * 80**3)
SILENT = Antennas(noise="off")
ON_AXIS, ON_EQUATOR = 2.0, 1.0  # 4π‖h‖ at 1 m
LAST_M = (ON_AXIS / (KAPPA / MID_M**3 - 2 / 80**3)) ** (1 / 3)  # the farthest that can be heard, noise at its worst
SURE_M = (ON_EQUATOR / (KAPPA / MID_M**3 + 2 / 80**3)) ** (1 / 3)  # a level receiver always hears up to here


def analytic(places: np.ndarray) -> np.ndarray:
    """Eq. 1 in the dipole's own plane, x being east."""
    x, y = places.T
    r = np.hypot(x, y)
    return (np.array([2 * x**2 - y**2, 3 * x * y]) / (4 * np.pi * r**5)).T


def test_the_field_is_that_of_a_dipole_that_points_east() -> None:
    places = np.random.default_rng(1).uniform(-60, 60, (500, 2))
    np.testing.assert_allclose(paper.field(places), analytic(places), rtol=1e-9, atol=1e-18)


@given(st.lists(st.floats(1, 1000), min_size=1, max_size=5))
@settings(max_examples=6)
def test_a_flux_line_keeps_its_apex(apexes: list[float]) -> None:
    lines = paper.flux_lines(apexes)
    assert lines.shape[0] == len(apexes)
    for apex, line in zip(apexes, lines, strict=True):
        r, sine = np.hypot(*line.T), line[:, 1] / np.hypot(*line.T)
        np.testing.assert_allclose(r, apex * sine**2, rtol=1e-5)
        assert r.max() == pytest.approx(apex)
        assert max(r[0], r[-1]) < 0.003 * apex
        assert line[0, 0] > 0 > line[-1, 0]  # leaves by the dipole's head, comes back to its tail
        along = (np.diff(line, axis=0) * analytic((line[1:] + line[:-1]) / 2)).sum(axis=1)
        assert (along > 0).all()


@given(st.floats(3.5, 49.9))
@settings(max_examples=25)
def test_an_iso_power_line_is_of_one_power_and_bears_what_is_shown_there(d: float) -> None:
    line = paper.iso_power_line(d)
    np.testing.assert_allclose(np.linalg.norm(analytic(line), axis=1), KAPPA / (4 * np.pi * d**3), rtol=1e-9)
    np.testing.assert_allclose(line[0], line[-1], atol=1e-9)
    assert line[:, 0].max() == pytest.approx(d / (KAPPA / ON_AXIS) ** (1 / 3), rel=1e-3)
    shown = paper.directions(line, antennas=SILENT)
    assert (shown.zones == Zone.MID).all()
    np.testing.assert_allclose(shown.d, d, atol=0.00501)


def test_level_poses_are_level_in_the_plane_and_the_others_turned_in_every_way() -> None:
    rng = np.random.default_rng(2)
    quarters = [0.25, 0.5, 0.75]
    places, R = paper.poses(20_000, rng, level=True)
    assert (places[:, 2] == 0).all()
    np.testing.assert_allclose(R[:, 2], np.broadcast_to([0, 0, 1], (20_000, 3)), atol=1e-12)
    for x, y in (places.T[:2], R[:, :2, 0].T):
        np.testing.assert_allclose(np.quantile(np.arctan2(y, x) / np.pi, quarters), [-0.5, 0, 0.5], atol=0.03)
    free, free_R = paper.poses(20_000, rng, level=False)
    for p in (places, free):
        np.testing.assert_allclose(np.quantile(np.linalg.norm(p, axis=1), quarters), [22.5, 45, 67.5], atol=1.5)
    ways = free / np.linalg.norm(free, axis=1, keepdims=True)
    for unit in (ways, *np.moveaxis(free_R, 2, 0)):  # on a sphere each coordinate is uniform
        np.testing.assert_allclose(np.quantile(unit, quarters, axis=0), np.outer([-0.5, 0, 0.5], [1, 1, 1]), atol=0.03)


@pytest.mark.parametrize("level", [True, False])
@pytest.mark.parametrize("kind", ["uniform", "gaussian", "off"])
def test_readings_are_what_a_receiver_says(level: bool, kind: str) -> None:
    antennas = Antennas(noise=kind)  # type: ignore[arg-type]
    places, R = paper.poses(300, np.random.default_rng(3), level, farthest=60.0)
    receiver = Receiver(paper.TRANSMITTER, antennas, channels=1, seed=9)
    said = [receiver.read(p, r).channels[0] for p, r in zip(places, R, strict=True)]
    d_cm, delta, zone = paper.readings(places, R, 9, antennas)
    assert [(c.d_cm, c.delta_deg, c.zone) for c in said] == list(zip(d_cm, delta, zone, strict=True))
    assert {Zone.INNER, Zone.MID, Zone.OUTER} == set(zone.tolist())


def test_level_receivers_all_hear_near_and_none_hears_far() -> None:
    distance, d = paper.distances(60_000, level=True)
    heard = d != -1
    assert heard[distance < SURE_M].all()
    assert not heard[distance < SURE_M + 3].all()
    assert not heard[distance > LAST_M].any()
    assert heard[distance > 57].any()
    assert 0 < d[heard].min() < d[heard].max() == MID_M
    beyond = heard & (distance > 0.01)  # nearer than a centimetre the field grows no more
    r, shown = distance[beyond], d[beyond]
    assert (KAPPA / (shown + 0.0051) ** 3 <= ON_AXIS / r**3 + 2 / 80**3).all()
    assert (KAPPA / (shown - 0.0051) ** 3 >= ON_EQUATOR / r**3 - 2 / 80**3).all()


def test_a_turned_receiver_may_be_deaf_outside_the_inner_zone_and_hears_no_farther() -> None:
    distance, d = paper.distances(60_000, level=False)
    heard = d != -1
    assert heard[distance < 2.5].all()
    assert not heard[distance < 20].all()
    assert not heard[distance > LAST_M].any()
    level_distance, level_d = paper.distances(60_000, level=True)
    edges = np.arange(0, 91, 5.0)
    turned, level = paper.share_heard(distance, d, edges), paper.share_heard(level_distance, level_d, edges)
    assert (turned <= level).all()
    assert (level[:7] == 1).all()
    assert (turned[4:7] < 1).all()


def test_share_heard() -> None:
    share = paper.share_heard(
        np.array([1.0, 2.0, 3.0, 11.0, 31.0]), np.array([1.0, -1, 3.0, -1, 0.0]), np.arange(0, 41, 10.0)
    )
    np.testing.assert_array_equal(share, [2 / 3, 0, np.nan, 1])


def test_a_grid_reaches_both_sides_and_has_the_transmitter() -> None:
    places = paper.grid(11, 5, 5)
    assert sorted(map(tuple, places.tolist())) == [(x, y) for x in (-10, -5, 0, 5, 10) for y in (-5, 0, 5)]


@pytest.mark.parametrize("antennas", [Antennas(), SILENT], ids=["noise", "silent"])
def test_directions_are_the_field_s_as_far_as_noise_and_whole_degrees_allow(antennas: Antennas) -> None:
    places = paper.grid(65, 45, 1.3)
    shown = paper.directions(places, antennas=antennas)
    mid = shown.zones == Zone.MID
    field, ways = analytic(places[mid]), shown.ways[mid]
    strength = np.linalg.norm(field, axis=1)
    np.testing.assert_allclose(np.linalg.norm(ways, axis=1), 1)
    off = np.arccos(np.clip((ways * field).sum(axis=1) / strength, -1, 1))
    noise = 0.0 if antennas is SILENT else np.arcsin(BOUND / strength)
    clamped = np.radians(1.001)  # δ that rounds to 90 is 89
    assert (off <= noise + clamped).all()
    assert off.mean() < np.radians(0.3 if antennas is SILENT else 3)
    assert (shown.ways[~mid] == 0).all()
    assert ((shown.d == -1) == (shown.zones == Zone.OUTER)).all()
    near = np.hypot(*places.T)
    assert (near[shown.zones == Zone.INNER] < 3.4).all()
    assert (shown.zones[near < 2.5] == Zone.INNER).all()


def test_the_same_seed_gives_the_same_data_and_another_gives_others() -> None:
    places = paper.grid(60, 40, 5)
    for draw in (
        lambda *seed: paper.distances(500, True, *seed)[1],
        lambda *seed: paper.directions(places, *seed).ways,
    ):
        np.testing.assert_array_equal(draw(), draw())
        assert not np.array_equal(draw(), draw(1))


@pytest.mark.parametrize("name", ["figure2", "figure3", "figure5"])
def test_a_figure_is_a_small_file(name: str, tmp_path: Path) -> None:
    one, two = tmp_path / "one.png", tmp_path / "two.png"
    paper.save(paper.FIGURES[name], one)
    if name == "figure5":  # drawn twice it is the same; that the data of each is: above
        paper.save(paper.FIGURES[name], two)
        assert one.read_bytes() == two.read_bytes()
    assert one.stat().st_size < 80_000
    with Image.open(one) as image:
        assert image.width == paper.WIDTH_PX
        assert len(image.convert("RGB").getcolors(256) or ()) > 20


@pytest.mark.parametrize("name", paper.FIGURES)
def test_every_figure_is_kept_beside_the_tools(name: str) -> None:
    path = Path(paper.__file__).with_name(f"{name}.png")
    assert path.stat().st_size < 80_000
    with Image.open(path) as image:
        assert image.width == paper.WIDTH_PX


def test_the_command_writes_every_figure_where_it_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def line(figure: Figure) -> None:
        figure.add_subplot().plot([0, 1])

    monkeypatch.setattr(paper, "FIGURES", {"one": line, "two": line})
    monkeypatch.setattr(sys, "argv", ["paper", "--out", str(tmp_path / "new" / "folder")])
    paper.main()
    made = sorted((tmp_path / "new" / "folder").iterdir())
    assert [path.name for path in made] == ["one.png", "two.png"]
    assert [text.split(": ")[0] for text in capsys.readouterr().out.splitlines()] == list(map(str, made))
