"""The time line of a log: what its stamps, and the boot times in its packets, make of it."""

from __future__ import annotations

from collections.abc import Iterable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from arva_hil.links.tlog_timeline import Record, Timeline
from tests.every import every

T0 = 1_700_000_000.0
HOUR, DAY = 3600.0, 86400.0
BEAT = b"\xfe\x09\x00\x01\x01\x00" + bytes(11)  # tells no boot time


def attitude(boot: float, source: tuple[int, int] = (1, 1), version: int = 2) -> bytes:
    """As far as it matters here."""
    body = round(boot * 1e3).to_bytes(4, "little") + bytes(24)
    if version == 1:
        return bytes([0xFE, 28, 0, *source, 30]) + body + bytes(2)
    cut = body.rstrip(b"\0") or b"\0"
    return bytes([0xFD, len(cut), 0, 0, 0, *source, 30, 0, 0]) + cut + bytes(2)


def flight(
    start: float, end: float, stamp: float = T0, boot: float = 50.0, step: float = 0.1
) -> list[tuple[float, bytes]]:
    """Stamped `stamp` later than it was; the vehicle was switched on `boot` s before 0."""
    times = [start + step * i for i in range(round((end - start) / step))]
    return [(stamp + t, attitude(boot + t)) for t in times]


def run(records: Iterable[tuple[float, bytes]], *, stamped: bool = True) -> tuple[list[float], Timeline]:
    """Times [s] from the first record."""
    line = Timeline((Record(round(t * 1e6), raw) for t, raw in records), stamped=stamped)
    times = [record.time_us / 1e6 for record in line]
    return [t - times[0] for t in times], line


def test_stamps_that_go_on_are_kept_as_they_are() -> None:
    stamps = [0.0, 0.5, 0.2, 3.0, 2.9, 5.9]
    records = [Record(round((T0 + t) * 1e6) + 7, bytes([0xFE, 0, i, 1, 1, 0, 0, 0])) for i, t in enumerate(stamps)]
    line = Timeline(records)
    assert list(line) == records
    assert (line.steps, line.strays) == (0, 0)


@pytest.mark.parametrize("pause", [0.1, 7.0, 600.0])
@every("offset", [-78.0, -HOUR, -30 * DAY, 30 * DAY, 60.0, 1800.0])
def test_a_step_is_taken_out_and_a_pause_stays(offset: float, pause: float) -> None:
    behind = flight(9.9 + pause, 20 + pause, T0 + offset)
    times, line = run(flight(0, 10) + behind)
    assert times[100] == pytest.approx(9.9 + pause, abs=0.02)
    assert times[-1] == pytest.approx(19.9 + pause, abs=0.02)
    assert line.steps == 1


@pytest.mark.parametrize("pause", [5.0, 60.0, 3500.0, 20 * HOUR])
def test_a_pause_that_both_clocks_tell_is_no_step(pause: float) -> None:
    times, line = run(flight(0, 10) + flight(10 + pause, 20 + pause))
    assert times[100] == pytest.approx(10 + pause)
    assert line.steps == line.strays == 0


@pytest.mark.parametrize(("ahead", "pause"), [(60.0, 60.0), (3590.0, 3590.0), (3700.0, 0.0), (-60.0, 0.0)])
@pytest.mark.parametrize("boot", [None, 1.0])
def test_when_no_vehicle_tells_a_pause_of_an_hour_at_most_is_believed(
    ahead: float, pause: float, boot: float | None
) -> None:
    """Only heartbeats; or the vehicle has rebooted."""
    behind = [(T0 + 9.9 + ahead + i / 10, BEAT if boot is None else attitude(boot + i / 10)) for i in range(50)]
    times, _ = run(flight(0, 10) + behind)
    assert times[100] == pytest.approx(9.9 + pause)
    assert times[-1] == pytest.approx(14.8 + pause)


def test_a_burst_behind_a_stall_is_no_step() -> None:
    """The link held everything up for 8 s, and delivers it within half a second."""
    held = [(T0 + 18 + (t - T0 - 10) / 16, raw) for t, raw in flight(10, 18)]
    times, line = run(flight(0, 10) + held + flight(18.6, 30))
    assert times[100] == pytest.approx(18.0)
    assert times[-1] == pytest.approx(29.9, abs=0.11)
    assert line.steps == 0


def test_of_two_writers_with_two_clocks_neither_holds_up_the_other() -> None:
    mixed = [record for a in flight(0, 20) for record in (a, (a[0] - HOUR, BEAT))]
    times, line = run(mixed)
    assert times[-1] == pytest.approx(19.9)
    assert (line.steps, line.strays) == (0, 200)


def test_a_single_lie_about_boot_time_moves_nothing() -> None:
    behind = flight(10, 20, T0 - HOUR)
    behind[3] = (behind[3][0], attitude(9000.0))
    times, _ = run(flight(0, 10) + behind)
    assert times[100] == pytest.approx(10, abs=0.02)


@pytest.mark.parametrize("version", [1, 2])
def test_without_stamps_boot_time_is_time(version: int) -> None:
    records = [(0.0, BEAT)]
    for i in range(100):
        records += [(0.0, attitude(7 + i / 10, version=version)), (0.0, attitude(900 + i / 10, (2, 1))), (0.0, BEAT)]
    times, line = run(records, stamped=False)
    assert times[::3] == pytest.approx([0.0, *(i / 10 for i in range(100))])
    assert line.steps == 0


def test_without_stamps_a_reboot_goes_on_and_a_lie_moves_nothing() -> None:
    first = [attitude(7 + i / 10) for i in range(100)]
    second = [attitude(1 + i / 10) for i in range(100)]
    first[50] = attitude(4_000_000.0)
    times, line = run(((0.0, raw) for raw in first + second), stamped=False)
    assert times[99] == pytest.approx(9.9)
    assert times[-1] == pytest.approx(19.7, abs=0.11)
    assert line.steps == 1


def test_without_stamps_a_pause_is_one() -> None:
    records = [attitude(7 + i / 10) for i in range(100)] + [attitude(77 + i / 10) for i in range(100)]
    times, _ = run(((0.0, raw) for raw in records), stamped=False)
    assert times[-1] == pytest.approx(79.9)


@given(st.lists(st.tuples(st.integers(0, 4_000_000_000_000_000), st.binary(min_size=8, max_size=40)), max_size=60))
def test_whatever_is_in_a_log_every_record_comes_in_order_and_time_goes_on(content: list[tuple[int, bytes]]) -> None:
    for stamped in (True, False):
        records = [Record(time_us, b"\xfd" + raw) for time_us, raw in content]
        made = list(Timeline(records, stamped=stamped))
        assert [r.raw for r in made] == [r.raw for r in records]
        newest = 0
        for record in made:
            assert record.time_us >= newest - 1_000_000
            newest = max(newest, record.time_us)
