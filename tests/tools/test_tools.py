"""The programs around the emulator: fuzzing, the figures of the receiver, the bench."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import pytest

from tools.bench import speed as bench
from tools.bench.table import Row, conditions, ratio, read, slower, write
from tools.figures.receivers import FIGURES, OURS, novices, overlaps
from tools.fuzz import decoder, loader, session
from tools.fuzz import python as tool


@pytest.mark.parametrize(
    ("target", "count"),
    [("loader", 120), ("session", 150), ("decoder", 1000), ("commands", 1000), ("log", 150), ("team", 200)],
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
    failed = 0
    for data in module.seeds():
        try:
            module.fuzz(data)
        except AssertionError:
            failed += 1
    assert failed


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
    rows = list(overlaps(400))
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
