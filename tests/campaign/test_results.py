"""The results' database: what was committed is kept, the rest is run again, whatever the campaign was stopped by."""

from __future__ import annotations

import contextlib
import csv
import os
import resource
import signal
import sqlite3
from collections.abc import Callable
from contextlib import AbstractContextManager, closing
from dataclasses import astuple, fields, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from arva_hil.campaign import results as module
from arva_hil.campaign.results import (
    EARTH,
    NAME,
    REPORT,
    TABLE,
    VEHICLE,
    Errors,
    ResultsError,
    TrialRow,
    opened,
    row,
    summary,
)
from arva_hil.campaign.trial import Result
from tests.files import rows as table
from tests.waiting import no_file_beyond

from .fakes import PLAN, fake, planned

JOURNAL = f"{NAME}-journal"
EVERY = planned()[:8]
MANY = [row(one, fake(one.trial)) for one in planned(PLAN.replace("seeds: 6", "seeds: 40"))]
ROWS = [row(one, fake(one.trial)) for one in EVERY]
KEYS = [one.key for one in EVERY]


def written(folder: Path, rows: list[TrialRow]) -> None:
    with opened(folder) as results:
        for one in rows:
            results.add(one)


def kept(folder: Path) -> list[TrialRow]:
    with opened(folder) as results:
        return list(results.rows.values())


def refused(folder: Path, why: str) -> None:
    """The results in a folder cannot be opened; `why` is said."""
    with pytest.raises(ResultsError, match=why), opened(folder):
        pass


def killed_at(size: int, folder: Path) -> int:
    """A process of its own writes MANY rows, and the kernel kills it in the write that makes a file longer than `size`:
    how many rows it was told that it has."""
    told, tells = os.pipe()
    if not (process := os.fork()):
        signal.signal(signal.SIGXFSZ, signal.SIG_DFL)
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))
        with contextlib.suppress(ResultsError), opened(folder) as results:
            for one in MANY:
                results.add(one)
                os.write(tells, b".")
        os._exit(0)
    os.close(tells)
    with os.fdopen(told, "rb") as dots:
        count = len(dots.read())
    _, status = os.waitpid(process, 0)
    assert status == signal.SIGXFSZ
    return count


with TemporaryDirectory() as _folder:
    written(Path(_folder), ROWS)
    WHOLE = (Path(_folder) / NAME).read_bytes()


@pytest.mark.parametrize("size", [0, 100, 512, 1000, 4096, 5000, 12287, 13000, 16384, 20000, 24577, 30000, 36000])
def test_killed_in_the_middle_of_a_write_it_goes_on_without_loss_or_repetition(tmp_path: Path, size: int) -> None:
    told = killed_at(size, tmp_path)
    with opened(tmp_path) as results:
        assert told <= len(results.rows) <= told + 1  # one may be written and not told yet
        assert list(results.rows.values()) == MANY[: len(results.rows)]
        for one in MANY:
            if not results.done(one.key):
                results.add(one)
    assert kept(tmp_path) == MANY


def test_such_a_kill_leaves_a_part_of_a_row_and_the_journal_to_take_it_back(tmp_path: Path) -> None:
    assert killed_at(20000, tmp_path) > len(MANY) // 10
    assert (tmp_path / NAME).stat().st_size == 20000  # no whole number of pages
    assert (tmp_path / JOURNAL).stat().st_size


@settings(max_examples=10)
@given(st.permutations(range(len(ROWS))))
def test_the_table_is_the_same_whatever_the_order_of_the_ends(order: list[int]) -> None:
    with TemporaryDirectory() as name:
        with opened(Path(name)) as results:
            for n in order:
                results.add(ROWS[n])
            results.export(KEYS)
        with (Path(name) / TABLE).open(newline="") as file:
            head, *lines = csv.reader(file)
        assert head == [field.name for field in fields(TrialRow)]
        assert lines == [["" if value is None else str(value) for value in astuple(one)] for one in ROWS]
        assert not list(Path(name).glob("*.new"))


@pytest.mark.parametrize("text", ["=1+1", "+1", "-1", "@SUM(A1)", " =1"])
def test_a_text_is_no_formula_in_the_table_and_itself_in_the_database(tmp_path: Path, text: str) -> None:
    one = replace(ROWS[0], scenario=text, outcome=text, strategy=text, error_m=-0.5)
    written(tmp_path, [one])
    with opened(tmp_path) as results:
        assert list(results.rows.values()) == [one]
        results.export([one.key])
    (line,) = table(tmp_path / TABLE)
    assert [line[name] for name in ("scenario", "outcome", "strategy", "error_m")] == [f"'{text}"] * 3 + ["-0.5"]


def test_rows_of_other_plans_come_behind_those_of_this_one(tmp_path: Path) -> None:
    written(tmp_path, ROWS)
    with opened(tmp_path) as results:
        results.export(KEYS[::-2])
    assert [line["key"] for line in table(tmp_path / TABLE)] == KEYS[::-2] + KEYS[::2]


def test_a_trial_that_failed_is_run_again_and_its_row_replaced(tmp_path: Path) -> None:
    failed = replace(ROWS[0], outcome="failed: OSError: no luck")
    with opened(tmp_path) as results:
        results.add(failed)
        results.add(ROWS[1])
        assert (results.done(KEYS[0]), results.done(KEYS[1])) == (False, True)
        results.add(ROWS[0])
        assert results.done(KEYS[0])
    with opened(tmp_path) as results:
        assert results.rows == {KEYS[0]: ROWS[0], KEYS[1]: ROWS[1]}


@settings(max_examples=8)
@given(
    st.builds(
        Result,
        outcome=st.text(),
        error_m=st.none() | st.floats(allow_nan=False),
        hover_m=st.none() | st.floats(allow_nan=False),
        time_s=st.floats(allow_nan=False),
        path_m=st.floats(allow_nan=False),
        frames=st.integers(0, 2**63 - 1),
    )
)
@example(Result('failed: E: a, "b"\r\nc\0\x85\ud800', None, -0.0, 1e-300, 0.1 + 0.2, 0))
def test_every_row_is_one_line_and_is_read_as_it_was_written(result: Result) -> None:
    with TemporaryDirectory() as name:
        new = row(EVERY[0], result)
        written(Path(name), [new])
        with opened(Path(name)) as results:
            assert list(results.rows.values()) == [new]
            results.export([new.key])
        assert (Path(name) / TABLE).read_bytes().count(b"\n") == 2


def test_a_row_says_what_was_flown() -> None:
    one = planned("strategies: flux\nscenarios: {random: {within_m: 50}}\nwind_m_s: 3\ngps_noise_m: 0.5\nnoise: off")[0]
    (transmitter,) = one.trial.scenario.transmitters
    assert row(one, Result("found", 1.0, 0.5, 60.0, 55.0, 61)) == TrialRow(
        key=one.key,
        seed=1,
        scenario="random within 50 m at 0 to 2 m",
        noise="off",
        wind_m_s=3.0,
        gps_noise_m=0.5,
        take_off_m=3.0,
        drones=1,
        strategy="flux",
        height_m=3.0,
        speed_m_s=1.0,
        limit_s=900.0,
        distance_m=pytest.approx((transmitter.ned[0] ** 2 + transmitter.ned[1] ** 2) ** 0.5, abs=0.001),
        outcome="found",
        error_m=1.0,
        hover_m=0.5,
        time_s=60.0,
        path_m=55.0,
        frames=61,
    )


@pytest.mark.parametrize(
    ("outcome", "error", "success"), [("found", 2.0, True), ("found", 2.01, False), ("no", 1.0, False)]
)
def test_a_success_is_found_and_near(outcome: str, error: float, success: bool) -> None:
    assert replace(ROWS[0], outcome=outcome, error_m=error).success(2.0) is success
    assert replace(ROWS[0], outcome=outcome, error_m=None).success(2.0) is False


@pytest.mark.parametrize("name", [TABLE, REPORT])
def test_a_folder_of_an_older_version_or_of_somebody_else_is_left_as_it_is(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_text("mine\n")
    refused(tmp_path, f"{name}: not from a campaign, or of an older arva-hil .*another")
    assert [(path.name, path.read_text()) for path in tmp_path.iterdir()] == [(name, "mine\n")]


@pytest.mark.parametrize(
    ("statement", "why"),
    [
        ("CREATE TABLE own (a)", "not from a campaign"),
        ("CREATE TABLE results (key, mine)", "not from a campaign"),
        ("CREATE VIEW results AS SELECT 1 AS key", "not from a campaign"),
        ("PRAGMA user_version = 2", "format 2 of another arva-hil, not 4"),
        ("ALTER TABLE results DROP COLUMN frames", "cannot be opened: no such column: frames"),
    ],
)
def test_a_database_of_somebody_else_or_of_a_newer_version_is_left_as_it_is(
    tmp_path: Path, statement: str, why: str
) -> None:
    if "CREATE" not in statement:
        written(tmp_path, ROWS)
    with closing(sqlite3.connect(tmp_path / NAME)) as other:
        other.execute(statement)
    before = (tmp_path / NAME).read_bytes()
    refused(tmp_path, f"{NAME}: {why}")
    assert (tmp_path / NAME).read_bytes() == before
    assert not (tmp_path / JOURNAL).exists()


@pytest.mark.parametrize(
    "data",
    [b"no database at all", WHOLE[: len(WHOLE) // 2], WHOLE[:4096] + bytes(len(WHOLE) - 4096)],
    ids=["foreign", "cut", "zeros"],
)
def test_a_damaged_database_is_said_and_left_as_it_is(tmp_path: Path, data: bytes) -> None:
    (tmp_path / NAME).write_bytes(data)
    refused(tmp_path, rf"{NAME}: damaged, or not from a campaign \(.+\): it is left")
    assert (tmp_path / NAME).read_bytes() == data


@given(st.integers(0, len(WHOLE) - 1), st.integers(1, 255))
def test_whatever_byte_is_wrong_there_are_rows_or_a_clear_error(at: int, flip: int) -> None:
    data = bytearray(WHOLE)
    data[at] ^= flip
    with TemporaryDirectory() as name:
        (Path(name) / NAME).write_bytes(data)
        with contextlib.suppress(ResultsError), opened(Path(name)) as results:
            assert all(isinstance(one.outcome, str) for one in results.rows.values())
            results.add(ROWS[0])
            results.export(KEYS)


def test_two_campaigns_do_not_write_one_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_WAIT_S", 0.0)
    taken = f"{NAME}: another campaign or another program is at work there"
    with opened(tmp_path) as first:
        refused(tmp_path, taken)
        first.add(ROWS[0])  # the second one took nothing from it
        refused(tmp_path, taken)
    assert kept(tmp_path) == ROWS[:1]  # the lock goes with who had it


def test_a_program_that_reads_keeps_a_campaign_waiting_not_for_ever(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "_WAIT_S", 0.0)
    written(tmp_path, ROWS)
    with closing(sqlite3.connect(tmp_path / NAME)) as other, closing(other.execute("SELECT * FROM results")) as cursor:
        assert cursor.fetchone()
        refused(tmp_path, "another program is at work there")
    assert kept(tmp_path) == ROWS


def test_results_that_may_not_be_written_are_said_and_kept(
    tmp_path: Path, ordinary: Callable[[], AbstractContextManager[None]]
) -> None:
    with TemporaryDirectory() as name:  # pytest's own folder is closed to others
        folder = Path(name)
        written(folder, ROWS)
        folder.chmod(0o755)
        (folder / NAME).chmod(0o444)
        with ordinary():
            refused(folder, r"cannot be opened: .*readonly")
        (folder / NAME).chmod(0)
        with ordinary():
            refused(folder, f"{NAME}: cannot be opened: ")
            refused(folder / "below", "below: Permission denied")
        assert kept(folder) == ROWS


def test_a_folder_that_cannot_be_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    refused(tmp_path / "file", "/file: is no folder: it is left as it is; name another folder with --out")
    refused(tmp_path / "file" / "below", f"{tmp_path / 'file' / 'below'}: Not a directory")
    for name in (NAME, TABLE, REPORT):
        folder = tmp_path / f"with {name}"
        (folder / name).mkdir(parents=True)
        refused(folder, rf"{folder / name}: is not a regular file")


@pytest.mark.parametrize("name", [NAME, JOURNAL, TABLE, REPORT])
def test_nothing_is_written_through_a_symlink(tmp_path: Path, name: str) -> None:
    folder, target = tmp_path / "out", tmp_path / "of somebody"
    written(folder, ROWS)
    target.touch()
    (folder / name).unlink(missing_ok=True)
    (folder / name).symlink_to(target)
    refused(folder, str(folder / NAME.removesuffix(".sqlite")) + f"|{folder / name}")
    assert target.read_bytes() == b""
    assert (folder / name).is_symlink()


def test_a_full_disk_is_said_and_what_was_committed_stays(tmp_path: Path) -> None:
    with opened(tmp_path) as results:
        for one in ROWS[:3]:
            results.add(one)
        with no_file_beyond(20):
            with pytest.raises(ResultsError, match=f"{NAME}: cannot be written: "):
                results.add(ROWS[3])
            results.close()
    assert kept(tmp_path) == ROWS[:3]


def test_a_disk_that_is_full_from_the_start_is_said(tmp_path: Path) -> None:
    with no_file_beyond(100):
        refused(tmp_path, f"{NAME}: cannot be opened: ")
    written(tmp_path, ROWS[:1])


def test_when_the_table_cannot_be_written_the_one_before_stays(tmp_path: Path) -> None:
    with opened(tmp_path) as results:
        results.add(ROWS[0])
        results.export(KEYS[:1])
        before = (tmp_path / TABLE).read_bytes()
        results.add(ROWS[1])
        with no_file_beyond(100), pytest.raises(ResultsError, match=f"{TABLE}: cannot be written: File too large"):
            results.export(KEYS[:2])
    assert (tmp_path / TABLE).read_bytes() == before
    assert kept(tmp_path) == ROWS[:2]


def test_results_that_differ_as_between_processors_are_alike() -> None:
    one = row(EVERY[0], Result("found", 0.123456, 0.5, 60.0004, 55.0, 61))
    assert (one.error_m, one.time_s) == (0.123, 60.0)
    assert one.difference(replace(one, error_m=0.17)) == ""
    assert one.difference(replace(one, error_m=0.18)) == "error_m 0.18 instead of 0.123"
    assert one.difference(replace(one, numpy="2.0.0")) == ""
    assert one.difference(replace(one, error_m=None)) == "error_m None instead of 0.123"
    assert one.difference(replace(one, outcome="not sure")) == "outcome not sure instead of found"


@pytest.mark.parametrize(("frame", "error", "sigma"), [("earth", *EARTH), ("vehicle", *VEHICLE)])
def test_the_summary_says_how_often_places_are_inside_their_uncertainty_and_how_many_are_false(
    frame: str, error: str, sigma: str
) -> None:
    """On Earth and relative to the vehicle, each by its own numbers."""
    nothing: dict[str, Any] = dict.fromkeys((*EARTH, *VEHICLE))
    found = [(0.5, 1.0), (1.5, 1.0), (2.5, 2.0), (3.5, 1.0)]
    rows = [replace(ROWS[0], outcome="found", **nothing | {error: off, sigma: spread}) for off, spread in found]
    unsure = replace(ROWS[0], outcome="not sure", **nothing | {error: 50.0, sigma: 1.0})
    some: Errors = getattr(summary([*rows, unsure], 2.0), frame)
    assert some.error_m == (2.5, pytest.approx(31.4))
    assert (some.inside, some.false) == ((0.25, 0.75), (2, 1))
    assert some.sigma_m == (1.0, pytest.approx(1.7))
    assert getattr(summary([replace(rows[0], **{sigma: None})], 2.0), frame).inside is None
    other = summary(rows, 2.0).vehicle if frame == "earth" else summary(rows, 2.0).earth
    assert other == Errors(None, None, None, (0, 0))
