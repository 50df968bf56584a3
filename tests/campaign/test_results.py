"""The results' file: what was whole is kept, what was torn is run again, whatever the campaign was stopped by."""

from __future__ import annotations

import errno
import os
import resource
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from arva_hil.campaign.results import NAME, ResultsError, Row, opened, row
from arva_hil.campaign.trial import Result

from .fakes import fake, planned

EVERY = planned()
ROWS = [row(one, fake(one.trial)) for one in EVERY]
KEYS = [one.key for one in EVERY]


def written(folder: Path, rows: list[Row]) -> bytes:
    with opened(folder) as results:
        for one in rows:
            results.add(one)
    return (folder / NAME).read_bytes()


with TemporaryDirectory() as _folder:
    WHOLE = written(Path(_folder), ROWS)


@settings(max_examples=50)
@given(st.integers(0, len(WHOLE)))
@example(0)
@example(len(WHOLE) - 1)
@example(len(WHOLE))
def test_a_file_cut_at_any_byte_goes_on_without_loss_or_repetition(cut: int) -> None:
    with TemporaryDirectory() as name:
        path = Path(name) / NAME
        path.write_bytes(WHOLE[:cut])
        with opened(path.parent) as results:
            whole = max(WHOLE[:cut].count(b"\n") - 1, 0)
            assert list(results.rows.values()) == ROWS[:whole]
            left = [one for one in ROWS if not results.done(one.key)]
            assert left == ROWS[whole:]
            for one in left:
                results.add(one)
        assert path.read_bytes() == WHOLE


@settings(max_examples=20)
@given(st.permutations(range(len(ROWS))))
def test_sorted_it_is_the_same_whatever_the_order_of_the_ends(order: list[int]) -> None:
    with TemporaryDirectory() as name:
        with opened(Path(name)) as results:
            for n in order:
                results.add(ROWS[n])
            results.sort(KEYS)
            assert list(results.rows.values()) == ROWS
        assert (Path(name) / NAME).read_bytes() == WHOLE
        assert not list(Path(name).glob("*.new"))


def test_rows_of_other_plans_are_kept_behind_those_of_this_one(tmp_path: Path) -> None:
    written(tmp_path, ROWS)
    with opened(tmp_path) as results:
        results.sort(KEYS[::-2])
    with opened(tmp_path) as results:
        assert list(results.rows) == KEYS[::-2] + KEYS[::2]


def test_a_trial_that_failed_is_run_again_and_its_row_replaced(tmp_path: Path) -> None:
    failed = replace(ROWS[0], outcome="failed: OSError: no luck")
    with opened(tmp_path) as results:
        results.add(failed)
        results.add(ROWS[1])
        assert (results.done(KEYS[0]), results.done(KEYS[1])) == (False, True)
        results.add(ROWS[0])
        assert results.done(KEYS[0])
    with opened(tmp_path) as results:
        assert results.done(KEYS[0])
        results.sort(KEYS)
    with opened(tmp_path) as results:
        assert list(results.rows.values()) == ROWS[:2]


@settings(max_examples=40)
@given(
    st.builds(
        Result,
        outcome=st.text(),
        error_m=st.none() | st.floats(allow_nan=False),
        hover_m=st.none() | st.floats(allow_nan=False),
        time_s=st.floats(allow_nan=False),
        path_m=st.floats(allow_nan=False),
        frames=st.integers(),
    )
)
@example(Result('failed: E: a, "b"\r\nc\0\x85\ud800', None, -0.0, 1e-300, 0.1 + 0.2, 0))
def test_every_row_is_one_line_and_is_read_as_it_was_written(result: Result) -> None:
    with TemporaryDirectory() as name:
        new = row(EVERY[0], result)
        assert written(Path(name), [new]).count(b"\n") == 2
        with opened(Path(name)) as results:
            assert list(results.rows.values()) == [new]


def test_a_row_says_what_was_flown() -> None:
    one = planned("strategies: flux\nscenarios: {random: {within_m: 50}}\nwind_m_s: 3\ngps_noise_m: 0.5\nnoise: off")[0]
    (transmitter,) = one.trial.scenario.transmitters
    assert transmitter.ned is not None
    new = row(one, Result("found", 1.0, 0.5, 60.0, 55.0, 61))
    assert new == Row(
        key=one.key,
        seed=1,
        scenario="random within 50 m at 0 to 2 m",
        noise="off",
        wind_m_s=3.0,
        gps_noise_m=0.5,
        take_off_m=3.0,
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


@pytest.mark.parametrize(
    ("data", "why"),
    [
        (b"my,own,table\n1,2,3\n", "not the results of a campaign"),
        (b"no line at all", "not the results of a campaign"),
        (b"\n", "not the results of a campaign"),
        (WHOLE.replace(b"error_m", b"mistake", 1), "or of another version of arva-hil"),
        (WHOLE.replace(b"\n", b"\nx,y\n", 1), f"{NAME}:2: not a row of results"),
        (WHOLE + WHOLE, f"{NAME}:{len(ROWS) + 2}: not a row of results"),
        (WHOLE + b"\xff,\n", f"{NAME}:{len(ROWS) + 2}: not a row of results"),
        (WHOLE + b'"open\n', f"{NAME}:{len(ROWS) + 2}: not a row of results"),
    ],
)
def test_what_is_not_ours_is_left_as_it_is(tmp_path: Path, data: bytes, why: str) -> None:
    (tmp_path / NAME).write_bytes(data)
    with pytest.raises(ResultsError, match=why), opened(tmp_path):
        pass
    assert (tmp_path / NAME).read_bytes() == data


def test_two_campaigns_do_not_write_one_file(tmp_path: Path) -> None:
    taken = pytest.raises(ResultsError, match=rf"another campaign \(process {os.getpid()}\)")
    with opened(tmp_path), taken, opened(tmp_path):
        pass
    with opened(tmp_path) as results:  # the lock goes with who had it
        results.add(ROWS[0])


def test_a_folder_that_cannot_be_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    for folder in (tmp_path / "file", tmp_path / "file" / "below"):
        with pytest.raises(ResultsError, match=rf"{folder}: (File exists|Not a directory)"), opened(folder):
            pass
    (tmp_path / NAME).mkdir()
    with pytest.raises(ResultsError, match=rf"{tmp_path / NAME}: Is a directory"), opened(tmp_path):
        pass


def test_a_full_disk_is_said_and_what_is_whole_stays(tmp_path: Path) -> None:
    size = len(written(tmp_path, ROWS[:3]))
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    with opened(tmp_path) as results:
        resource.setrlimit(resource.RLIMIT_FSIZE, (size + 20, limits[1]))  # a disk with room for 20 bytes more
        try:
            with pytest.raises(ResultsError, match=f"{NAME}: cannot be written: File too large"):
                results.add(ROWS[3])
            results.close()
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert (tmp_path / NAME).stat().st_size == size + 20
    with opened(tmp_path) as results:
        assert list(results.rows.values()) == ROWS[:3]


def test_when_the_sorted_file_cannot_be_written_the_other_stays(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    written(tmp_path, ROWS[:3])

    def full(_: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with opened(tmp_path) as results:
        monkeypatch.setattr(os, "fsync", full)
        with pytest.raises(ResultsError, match=f"{NAME}: cannot be written: No space left"):
            results.sort(KEYS)
    monkeypatch.undo()
    with opened(tmp_path) as results:
        assert list(results.rows.values()) == ROWS[:3]
