"""Logs whose clock steps, lies or is missing replay completely, by the vehicle's own clock."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from arva_hil.cli.main import main
from arva_hil.links.tlog import TlogReader, tlog_record
from arva_hil.links.tlog_timeline import Record

DATA = Path(__file__).parents[1] / "data"
HOUR_US, DAY_US = 3_600_000_000, 86_400_000_000


class Replayed(NamedTuple):
    frames: list[tuple[float | None, int]]  # boot time of each [s], d of the nearest [cm]
    counters: dict[str, Any]
    said: str


Replay = Callable[[bytes], Replayed]


@pytest.fixture(scope="module")
def replayed() -> dict[bytes, Replayed]:
    """What came of each log: the flight as it was recorded is what most tests compare with."""
    return {}


@pytest.fixture
def replay(tmp_path: Path, capfd: pytest.CaptureFixture[str], replayed: dict[bytes, Replayed]) -> Replay:
    """At 10 Hz; gives back what the record says."""

    def go(data: bytes) -> Replayed:
        if data not in replayed:
            replayed[data] = once(data)
        return replayed[data]

    def once(data: bytes) -> Replayed:
        folder = tmp_path / f"record{len(replayed)}"
        (log := tmp_path / "flight.tlog").write_bytes(data)
        assert main(["replay", str(log), "--rate", "10", "--record", str(folder)]) == 0
        with (folder / "readings.csv").open(newline="") as file:
            rows = [row for row in csv.DictReader(file) if row["slot"] == "1"]
        frames = [(float(boot) / 1e3 if (boot := row["boot_ms"]) else None, int(row["d_cm"])) for row in rows]
        return Replayed(frames, json.loads((folder / "run.json").read_text())["counters"], capfd.readouterr().err)

    return go


@pytest.fixture
def records(request: pytest.FixtureRequest) -> list[Record]:
    """Of each message at most 5 a second: PX4 has sent 50, and the clocks are the same."""
    newest: dict[bytes, int] = {}
    kept = []
    with closing(TlogReader(DATA / f"{getattr(request, 'param', 'arducopter')}.tlog")) as log:
        for one in log:
            kind = one.raw[7:10] if one.raw[0] == 0xFD else one.raw[5:6]
            if one.time_us - newest.get(kind, 0) >= 195_000:
                newest[kind] = one.time_us
                kept.append(one)
    return kept


def encode(records: list[Record]) -> bytes:
    return b"".join(tlog_record(*record) for record in records)


def from_middle(records: list[Record], offset_us: int) -> list[Record]:
    half = len(records) // 2
    return records[:half] + [Record(r.time_us + offset_us, r.raw) for r in records[half:]]


def same(found: Replayed, wanted: Replayed) -> None:
    """As many frames, of the same moments, hearing the same."""
    assert abs(len(found.frames) - len(wanted.frames)) <= 1
    for (boot, d_cm), (wanted_boot, wanted_d_cm) in zip(found.frames, wanted.frames, strict=False):
        assert boot == pytest.approx(wanted_boot, abs=0.1)
        assert (d_cm > 0) == (wanted_d_cm > 0)
        assert abs(d_cm - wanted_d_cm) < 60  # the vehicle moves at some m/s, and noise is drawn once a frame
    assert abs(found.counters["no_pose"] - wanted.counters["no_pose"]) <= 1
    assert found.counters["packets_received"] == wanted.counters["packets_received"]
    assert found.counters["reboots"] == found.counters["clock_leaps"] == 0


@pytest.mark.parametrize(
    ("records", "offset_us"),
    [
        ("arducopter", 30 * DAY_US),
        ("arducopter", -5_000_000),
        ("arducopter", 20_000_000),
    ],
    ids=["30 days on", "5 s back", "20 s on"],
    indirect=["records"],
)
def test_a_clock_that_was_set_in_the_middle_costs_no_frame_and_adds_none(
    records: list[Record], replay: Replay, offset_us: int
) -> None:
    found = replay(encode(from_middle(records, offset_us)))
    same(found, replay(encode(records)))
    assert (found.counters["log_clock_steps"], found.counters["log_stray_times"]) == (1, 0)
    assert found.said.count("the clock of its computer was set during the recording") == 1


@pytest.mark.parametrize("offset_us", [-23 * HOUR_US], ids=["back"])
def test_one_record_with_a_time_of_its_own_changes_nothing(
    records: list[Record], replay: Replay, offset_us: int
) -> None:
    half = len(records) // 2
    odd = [*records[:half], Record(records[half].time_us + offset_us, records[half].raw), *records[half + 1 :]]
    found, wanted = replay(encode(odd)), replay(encode(records))
    assert found.frames == wanted.frames
    assert (found.counters["log_clock_steps"], found.counters["log_stray_times"]) == (0, 1)


def test_a_log_of_1971_replays_as_any_other(records: list[Record], replay: Replay) -> None:
    back = records[0].time_us - 400 * DAY_US
    found, wanted = replay(encode([Record(r.time_us - back, r.raw) for r in records])), replay(encode(records))
    assert found.frames == wanted.frames
    assert found.counters["log_clock_steps"] == wanted.counters["log_clock_steps"] == 0


def test_a_clock_that_is_set_again_and_again(records: list[Record], replay: Replay) -> None:
    fifth = len(records) // 5
    offsets = [0, -HOUR_US, 30 * DAY_US, -400 * DAY_US, 0]
    stepped = [Record(r.time_us + offsets[min(i // fifth, 4)], r.raw) for i, r in enumerate(records)]
    found = replay(encode(stepped))
    same(found, replay(encode(records)))
    assert found.counters["log_clock_steps"] == 4


def test_a_pause_that_the_vehicles_clock_confirms_is_one(records: list[Record], replay: Replay) -> None:
    """Nothing was recorded for 10 s of the flight."""
    middle = records[len(records) // 2].time_us
    gap = [r for r in records if not middle <= r.time_us < middle + 10_000_000]
    found, wanted = replay(encode(gap)), replay(encode(records))
    assert len(found.frames) == len(wanted.frames)
    assert 70 <= found.counters["no_pose"] - wanted.counters["no_pose"] <= 100
    assert found.counters["log_clock_steps"] == 0


@pytest.mark.parametrize("records", ["px4"], indirect=True)
def test_a_pause_that_the_logs_clock_denies_is_one_all_the_same(records: list[Record], replay: Replay) -> None:
    """Nothing was recorded for 10 s of the flight, and then the clock is an hour back."""
    middle = records[len(records) // 2].time_us
    before = [r for r in records if r.time_us < middle]
    behind = [Record(r.time_us - HOUR_US, r.raw) for r in records if r.time_us >= middle + 10_000_000]
    found, wanted = replay(encode(before + behind)), replay(encode(records))
    assert abs(len(found.frames) - len(wanted.frames)) <= 3  # PX4's simulator runs 1.5 % slow
    assert found.counters["log_clock_steps"] == 1


def test_times_with_the_low_byte_first(records: list[Record], replay: Replay) -> None:
    found = replay(b"".join(r.time_us.to_bytes(8, "little") + r.raw for r in records))
    assert found.frames == replay(encode(records)).frames
    assert "it has little-endian times" in found.said


@pytest.mark.parametrize("records", ["arducopter", "px4"], indirect=True)
def test_packets_without_times(records: list[Record], replay: Replay) -> None:
    found, wanted = replay(b"".join(r.raw for r in records)), replay(encode(records))
    assert "it has no time stamps: times come from the vehicles' boot times" in found.said
    begin = next(boot for boot, _ in found.frames if boot is not None)
    late = next(i for i, (boot, _) in enumerate(wanted.frames) if boot is not None and boot > begin - 0.1)
    assert len(wanted.frames) - late - len(found.frames) < 25  # what came before the first boot time has no time
    hearing = sum(d_cm > 0 for _, d_cm in found.frames)
    assert abs(hearing - sum(d_cm > 0 for _, d_cm in wanted.frames)) < 8
    assert found.counters["packets_received"] == len(records)


def test_a_record_that_is_damaged_costs_no_other(records: list[Record], replay: Replay) -> None:
    """It is a station's of MAVLink 1, and its number the other magic: 267 bytes of an unknown message, by its looks."""
    wrong = b"\xfe\x1c\xfd\xff\x00\x1e" + bytes(30)
    half = len(records) // 2
    for place in (half,):
        hurt = [*records[:place], Record(records[place].time_us, wrong), *records[place:]]
        found = replay(encode(hurt))
        assert found.counters["packets_received"] == len(records)
        assert found.counters["bytes_skipped"] == len(wrong)


def test_what_a_stall_held_up_is_read_as_of_its_own_time(records: list[Record], replay: Replay) -> None:
    """The link delivers nothing for 1.5 s of the flight, and then all of it at once."""
    begin = records[len(records) // 2].time_us
    late = [Record(max(r.time_us, begin + 1_500_000) if r.time_us >= begin else r.time_us, r.raw) for r in records]
    found, wanted = replay(encode(late)), replay(encode(records))
    assert len(found.frames) == len(wanted.frames)
    for (boot, d_cm), (wanted_boot, wanted_d_cm) in zip(found.frames, wanted.frames, strict=True):
        assert boot == pytest.approx(wanted_boot, abs=0.2)  # 1.3 s older, if the burst passes for fresh
        assert (d_cm > 0) == (wanted_d_cm > 0)
        assert abs(d_cm - wanted_d_cm) < 60
