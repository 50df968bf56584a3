"""Faults on purpose: each does what its name says, on time, the same again, and is counted and marked."""

from __future__ import annotations

import csv
import functools
import itertools
import json
import math
from argparse import Namespace
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from arva_hil.autopilot.following.session import COMPONENT, Session
from arva_hil.cli.main import main
from arva_hil.clock import StepClock
from arva_hil.config import Fault, Scenario, ScenarioError, load, parse, parse_fault, to_dict
from arva_hil.config.constraints import Number
from arva_hil.emulator.engine import Emulator
from arva_hil.emulator.faults.sending import resample
from arva_hil.emulator.formats import MavlinkDecoder
from arva_hil.emulator.setup import one_vehicle
from arva_hil.events import BytesSent, FrameMade
from arva_hil.links import Link, LinkError, memory
from arva_hil.links.tlog import TlogReader
from arva_hil.mavlink.codec import Parser
from arva_hil.registry import FAULTS
from arva_hil.runtime.audience import Audience
from arva_hil.runtime.drivers import LOOK_AHEAD_S, replay
from arva_hil.runtime.loop import run
from firmware_proto import INTERFERENCE, SELF_TEST_FAULT, Decoder, Frame
from tests.every import every
from tests.one_receiver import Diary, Flown, OneReceiver
from tools.soak.run import long_run

ROOT = Path(__file__).parents[2]
LOG = ROOT / "tests" / "data" / "arducopter.tlog"
VALUES = {  # one value for every fault, strong enough to be met within seconds
    "transmitter_off": "1",
    "transmitter_moved": "1, by_ned: [-5, 5, 0]",
    "transmitter_fading": "1, over_s: 10",
    "interference": "20",
    "antenna_x": "0.5",
    "antenna_y": "0",
    "antenna_z": "0",
    "cold_battery_db": "6",
    "saturation_na_m": "10",
    "electronics_na_m": "20",
    "delay_s": "0.25",
    "jitter_s": "0.25",
    "baud_ratio": "0.5",
    "drop_bytes": "0.01",
    "insert_bytes": "0.01",
    "flip_bytes": "0.01",
} | dict.fromkeys(["stuck", "silence", "self_test"], "true")


class Wire(Link):
    """Keeps what is written and when."""

    name = "wire"

    def __init__(self, clock: StepClock) -> None:
        self._clock = clock
        self.writes: list[tuple[float, bytes]] = []

    def read(self) -> bytes:
        return b""

    def write(self, data: bytes) -> bool:
        self.writes.append((self._clock.now(), data))
        return True

    def close(self) -> None: ...


class Bench(Flown):
    """The built-in vehicle on the ground, an emulator under faults, and what came out of it after some seconds."""

    def __init__(self, *faults: str, seconds: float = 20.0, **kwargs: str) -> None:
        super().__init__(scenario(*faults, **kwargs), session=Session(rate_hz=10))
        self._taken = b""
        self.run(seconds)
        self.snapshots = self.diary.frames

    @property
    def writes(self) -> list[tuple[float, bytes]]:
        """When bytes were written."""
        return [(event.time_s, event.data) for event in self.diary.events if isinstance(event, BytesSent)]

    @property
    def data(self) -> bytes:
        """All that the consumer has."""
        self._taken += self.consumer.read()
        return self._taken

    @property
    def decoder(self) -> Decoder:
        decoder = Decoder()
        for at, data in self.writes:
            decoder.feed(data, at)
        decoder.feed(b"", math.inf)
        return decoder

    @property
    def frames(self) -> list[tuple[float, Frame]]:
        """Whole frames, and when they were written."""
        decoder = Decoder()
        return [(at, frame) for at, data in self.writes for frame in decoder.feed(data, at)]

    def met(self, name: str) -> list[int]:
        """The numbers of the frames that met a fault."""
        return [s.number for s in self.snapshots if name in s.faults]


TWO = "[{id: 1, ned: [20, 5, 0]}, {id: 2, ned: [10, -8, 0]}]"


def scenario(
    *faults: str, transmitters: str = TWO, noise: str = "{kind: uniform}", model: str = "paper", seed: str = "1"
) -> Scenario:
    receiver = f"{{rate_hz: 10, noise: {noise}, model: {model}}}"
    return parse(
        f"spec: 2\ntransmitters: {transmitters}\nreceiver: {receiver}\nseed: {seed}\n"
        f"faults: [{', '.join(f'{{{fault}}}' for fault in faults)}]",
        "test",
    )


def fault(name: str, when: str = "") -> str:
    return f"{name}: {VALUES.get(name, '0.2')}{when}"


@functools.cache
def harmless(seconds: float = 20.0) -> Bench:
    """Without faults."""
    return Bench(seconds=seconds)


# -- whatever the fault ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", FAULTS)
def test_every_frame_is_accounted_for_and_every_fault_counted_and_marked(name: str) -> None:
    bench = Bench(fault(name), seconds=4.0, seed="5")
    c = bench.emulator.counters
    assert c.frames == len(bench.snapshots) == 41
    assert c.frames + c.duplicated == c.delivered + c.damaged + c.withheld + c.dropped + c.waiting
    assert len(bench.writes) == c.delivered + c.damaged
    assert bench.decoder.good == c.delivered
    assert bench.diary.bytes == bench.data
    assert {s.faults for s in bench.snapshots} <= {(), (name,)}
    count = bench.emulator.fault_counts()
    assert count[name]["frames"] == len(bench.met(name)) > 0
    assert (count[name].get("bytes", 0) > 0) == (FAULTS[name].stage == "wire")
    assert list(count) == [name]


def test_all_faults_at_once_strike_the_same_again() -> None:
    every = [fault(name) for name in FAULTS if name not in ("silence", "baud_ratio", "stuck", "transmitter_off")]
    one, again = (Bench(*every, seconds=8.0, seed="5") for _ in range(2))
    assert one.writes == again.writes
    assert [s.faults for s in one.snapshots] == [s.faults for s in again.snapshots]
    assert len(one.writes) > 20


@pytest.mark.parametrize("name", FAULTS)
def test_before_and_after_a_fault_the_frames_are_what_they_would_be_without(name: str) -> None:
    without, bench = harmless(4.0), Bench(fault(name, ", from_s: 1, until_s: 3"), seconds=4.0)
    times = [s.instant_s for s in bench.snapshots if s.faults]
    assert times
    assert 1 <= min(times) <= max(times) < 3
    for said, plain in zip(bench.snapshots, without.snapshots, strict=True):
        if not 1 <= said.time_s < 3:
            assert (said.frame, said.reading) == (plain.frame, plain.reading)
    before = [data for at, data in without.writes if at < 1]
    after = [data for at, data in without.writes if at > 3.5]
    assert [data for _, data in bench.writes[: len(before)]] == before
    assert [data for _, data in bench.writes[-len(after) :]] == after


FREE = ["drop", "duplicate", "corrupt", "flip_bytes"]  # of each stage that draws


@pytest.mark.parametrize("name", FREE)
def test_another_fault_does_not_change_whom_this_one_strikes(name: str) -> None:
    alone = Bench(fault(name), seconds=4.0)
    assert alone.met(name) != Bench(fault(name), seconds=4.0, seed="6").met(name)
    others = "interference: 20", "delay_s: 0.05", "jitter_s: 0.3", "stuck: true", "reorder: 0.2"
    assert Bench(*others, fault(name), seconds=4.0).met(name) == alone.met(name)


def test_what_a_fault_withholds_no_other_meets() -> None:
    bench = Bench("drop: 0.3", "duplicate: 1", "flip_bytes: 1")
    assert {s.faults for s in bench.snapshots} == {("drop",), ("duplicate", "flip_bytes")}
    assert {s.sent for s in bench.snapshots if "drop" in s.faults} == {False}
    assert bench.emulator.counters.withheld == len(bench.met("drop"))


def test_two_of_a_kind_strike_differently_and_a_frame_that_meets_both_is_counted_once() -> None:
    bench = Bench("flip_bytes: 0.02", "flip_bytes: 0.02")
    one = Bench("flip_bytes: 0.02")
    assert len(bench.met("flip_bytes")) > 1.3 * len(one.met("flip_bytes"))
    assert bench.emulator.fault_counts()["flip_bytes"]["frames"] == len(bench.met("flip_bytes"))
    assert max(len(s.faults) for s in bench.snapshots) == 1


def test_a_fault_that_is_never_on_leaves_every_byte_as_it_was() -> None:
    never = [fault(name, ", from_s: 1000") for name in FAULTS]
    bench = Bench(*never)
    assert bench.data == harmless().data
    assert all(count["frames"] == 0 for count in bench.emulator.fault_counts().values())


def test_nobody_takes_the_frames_and_they_are_accounted_for_all_the_same() -> None:
    chosen = scenario("drop: 0.2", "duplicate: 0.2", "delay_s: 0.15", "corrupt: 0.2")
    flown = Flown(chosen, capacity=500)
    flown.run(20.0)
    c = flown.emulator.counters
    assert c.dropped > 100
    assert min(c.delivered, c.damaged, c.withheld, c.duplicated, c.waiting) > 0
    assert c.frames + c.duplicated == c.delivered + c.damaged + c.withheld + c.dropped + c.waiting


def test_a_frame_on_its_way_is_not_taken_for_one_that_nobody_takes() -> None:
    port, _ = memory.pair(capacity=0)
    diary = Diary()
    emulator = OneReceiver(
        scenario("delay_s: 0.1, until_s: 1"), Session(passive=True), None, port, start=0.0, observers=[diary]
    )
    run([emulator], StepClock(), until=2.0)
    assert [s.sent for s in diary.frames] == [True] * 10 + [False] * 11
    assert emulator.counters.dropped == 21


@pytest.mark.parametrize("faults", [(), ("delay_s: 0.25", "duplicate: 0.2")])
def test_frames_are_accounted_for_when_the_link_is_lost(faults: tuple[str, ...]) -> None:
    clock = StepClock()
    port, consumer = memory.pair()
    emulator = OneReceiver(scenario(*faults), Session(passive=True), None, port, start=0.0)
    run([emulator], clock, until=5.0)
    consumer.close()
    with pytest.raises(LinkError, match="lost"):
        run([emulator], clock, until=10.0)
    c = emulator.counters
    assert c.frames > 50
    assert c.frames + c.duplicated == c.delivered + c.damaged + c.withheld + c.dropped + c.waiting


# -- when ----------------------------------------------------------------------------------------------------------


@given(
    start=st.integers(0, 100),
    length=st.integers(1, 100),
    period=st.none() | st.tuples(st.integers(2, 30), st.integers(1, 29)).filter(lambda p: p[1] < p[0]),
    time=st.integers(0, 300),
)
def test_a_fault_is_on_from_then_until_then(start: int, length: int, period: tuple[int, int] | None, time: int) -> None:
    """In tenths of a second, where floating-point numbers are never exact."""
    every, on = period or (None, None)
    one = Fault(
        "silence",
        1,
        start / 10,
        (start + length) / 10,
        None if every is None else every / 10,
        None if on is None else on / 10,
    )
    wanted = start <= time < start + length and (every is None or on is None or (time - start) % every < on)
    since = one.since(round(time * 1e5))
    assert (since is not None) == wanted
    if since is not None:
        assert since == ((time - start) % every if every else time - start) * 100_000


def test_it_repeats() -> None:
    bench = Bench("silence: true, from_s: 2, until_s: 15, every_s: 5, for_s: 0.3")
    times = [s.instant_s for s in bench.snapshots if s.faults]
    assert times == pytest.approx([2.0, 2.1, 2.2, 7.0, 7.1, 7.2, 12.0, 12.1, 12.2])


def test_a_period_below_a_microsecond_is_no_error() -> None:
    assert not any(s.faults for s in Bench("stuck: true, every_s: 1e-7, for_s: 1e-8").snapshots)


def test_it_keeps_the_runs_time_wherever_the_clock_began() -> None:
    clock = StepClock(12345.678)
    wire, diary = Wire(clock), Diary()
    emulator = OneReceiver(
        scenario("silence: true, from_s: 1, until_s: 2"),
        Session(passive=True),
        None,
        wire,
        start=clock.now(),
        observers=[diary],
    )
    run([emulator], clock, until=clock.now() + 3)
    assert [s.number for s in diary.frames if s.faults] == list(range(10, 20))


# -- what is sent --------------------------------------------------------------------------------------------------


def sequences(bench: Bench) -> list[int]:
    return [frame.sequence for _, frame in bench.frames]


def test_dropped_frames_are_the_only_ones_missing() -> None:
    bench = Bench("drop: 0.2")
    assert sequences(bench) == [n for n in range(201) if n not in bench.met("drop")]
    assert 20 < len(bench.met("drop")) < 60
    assert bench.decoder.lost == sum(n < sequences(bench)[-1] for n in bench.met("drop"))


def test_silence_is_silence() -> None:
    bench = Bench("silence: true, from_s: 5, until_s: 10")
    assert sequences(bench) == [*range(50), *range(100, 201)]


def test_duplicates_follow_at_once_and_say_the_same() -> None:
    bench = Bench("duplicate: 0.2")
    twice = bench.met("duplicate")
    assert sequences(bench) == [n for n in range(201) for _ in range(1 + (n in twice))]
    assert bench.emulator.counters.duplicated == len(twice)


def test_delayed_frames_come_late_and_hold_up_those_behind() -> None:
    bench = Bench("delay_s: 0.25, from_s: 5, until_s: 10")
    assert sequences(bench) == list(range(201))
    wanted = [n / 10 + (0.25 if 50 <= n < 100 else 0.0) for n in range(201)]
    assert [at for at, _ in bench.frames] == pytest.approx(list(itertools.accumulate(wanted, max)))
    assert [s.late_s for s in bench.snapshots] == pytest.approx([0.0] * 201, abs=1e-9)


def test_jitter_is_anything_up_to_its_limit() -> None:
    bench = Bench("jitter_s: 0.09")
    late = [at - n / 10 for n, (at, _) in enumerate(bench.frames)]
    assert -1e-9 <= min(late) < 0.01
    assert 0.08 < max(late) <= 0.09 + 1e-9
    assert bench.emulator.schedule.deadline == pytest.approx(20.1)


@pytest.mark.parametrize("share", ["0.2", "1"])
def test_reordered_frames_change_places_with_the_next(share: str) -> None:
    bench = Bench(f"reorder: {share}")
    wanted, swapped = list(range(201)), bench.met("reorder")
    for n in swapped:
        if n < 200:
            wanted[n : n + 2] = n + 1, n
    assert sequences(bench) == wanted[: len(bench.frames)]
    assert len(bench.frames) == 201 - bench.emulator.counters.waiting >= 200
    assert all(later - n > 1 for n, later in itertools.pairwise(swapped))


def test_wrong_sequence_numbers_are_wrong_and_the_right_ones_go_on() -> None:
    bench = Bench("sequence: 0.2")
    wrong = [n for n, sequence in enumerate(sequences(bench)) if sequence != n]
    assert wrong == bench.met("sequence")
    assert [s.frame.sequence for s in bench.snapshots] == sequences(bench)


def test_impulses_are_ghosts_where_nobody_is_received_and_nearer_signals_elsewhere() -> None:
    there = "[{id: 1, ned: [20, 5, 0]}, {id: 2, ned: [3000, 0, 0]}]"
    plain, struck = Bench(transmitters=there), Bench("impulses: 0.3", transmitters=there)
    own = [frame.channels[0].d for _, frame in plain.frames]
    shown = [frame.channels[0].d for _, frame in struck.frames]
    assert {impulse < d for impulse, d in zip(shown, own, strict=True) if impulse != d > 0} == {True}
    ghosts = [frame.channels[1] for _, frame in struck.frames if frame.channels[1].valid]
    assert len(struck.met("impulses")) / len(struck.frames) == pytest.approx(0.4, abs=0.12)
    assert {abs(one.delta) <= 89 for _, frame in struck.frames for one in frame.channels} == {True}
    assert len(ghosts) / len(struck.frames) == pytest.approx(0.3, abs=0.1)
    assert {ghost.zone for ghost in ghosts} == {1}
    assert min(ghost.d for ghost in ghosts) >= 300


def test_the_self_test_bit() -> None:
    bench = Bench("self_test: true, from_s: 5, until_s: 10")
    assert [n for n, (_, frame) in enumerate(bench.frames) if frame.status & SELF_TEST_FAULT] == list(range(50, 100))


def test_a_late_loop_sends_the_same_bytes_in_the_same_order() -> None:
    faults = ("delay_s: 0.25, every_s: 2, for_s: 1", "jitter_s: 0.15", "reorder: 0.2", "duplicate: 0.2", "drop: 0.1")
    in_time = Bench(*faults)
    late = Bench(*faults, seconds=5.0)
    for until in (*np.arange(5.9, 20.0, 0.87), 20.0):
        late.clock.wait(until)
        late.run(until)
    assert late.emulator.counters.latest_s > 0.5
    assert late.emulator.counters.skipped == 0
    assert late.data == in_time.data


# -- what is heard -------------------------------------------------------------------------------------------------


def quiet(*faults: str, transmitters: str = TWO, seconds: float = 20.0, model: str = "paper") -> Bench:
    return Bench(*faults, seconds=seconds, transmitters=transmitters, noise="{kind: off}", model=model)


def test_a_transmitter_off_is_not_heard_and_the_other_is_as_before() -> None:
    bench = quiet("transmitter_off: 2, from_s: 5, until_s: 10")
    for s in bench.snapshots[20:]:
        assert [c.id for c in s.frame.channels[:2]] == ([1, None] if 5 <= s.instant_s < 10 else [2, 1])
    off = [s.frame.channels[0] for s in bench.snapshots if s.faults]
    assert set(off) == {bench.snapshots[-1].frame.channels[1]}


def test_a_moved_transmitter_is_heard_where_it_is_then() -> None:
    bench = quiet("transmitter_moved: 1, by_ned: [-5, 10, 1], from_s: 5, until_s: 10")
    there = quiet(transmitters="[{id: 1, ned: [15, 15, 1]}, {id: 2, ned: [10, -8, 0]}]")
    stays = quiet()
    for s, moved, plain in zip(bench.snapshots, there.snapshots, stays.snapshots, strict=True):
        assert s.reading == (moved.reading if 5 <= s.instant_s < 10 else plain.reading)
    assert there.snapshots[-1].reading != stays.snapshots[-1].reading


def test_a_fading_transmitter_sounds_farther_and_farther_away_until_it_is_gone() -> None:
    bench = quiet("transmitter_fading: 1, over_s: 10, from_s: 5", transmitters="[{id: 1, ned: [20, 0, 0]}]")
    d = [s.frame.channels[0].d for s in bench.snapshots]
    full = d[50]
    assert d[100] == pytest.approx(full * 2 ** (1 / 3), abs=2)  # half the field
    heard = d[50 : d.index(-1, 50)]
    assert heard == sorted(heard)
    assert set(d[50 + len(heard) :]) == {-1}
    assert 0.9 < len(heard) / 100 < 1


def test_interference_is_said_and_makes_readings_wild() -> None:
    bench = Bench("interference: 30, from_s: 5, until_s: 15", transmitters="[{id: 1, ned: [30, 0, 0]}]")
    d: dict[bool, set[int]] = {True: set(), False: set()}
    for s in bench.snapshots[20:]:
        assert s.faults or not s.frame.status & INTERFERENCE
        d[bool(s.faults)].add(s.frame.channels[0].d)
    said = [bool(s.frame.status & INTERFERENCE) for s in bench.snapshots if s.faults]
    assert said.count(True) > 80
    assert max(d[True]) - min(d[True]) > 5 * (max(d[False]) - min(d[False])) > 0


@pytest.mark.parametrize("model", ["paper", "pulsed", "rssi"])
def test_interference_is_heard_by_a_receiver_without_noise_too(model: str) -> None:
    one = "[{id: 1, ned: [20, 0, 0], keying: {kind: modern}}]"
    bench = quiet("interference: 30, from_s: 5, until_s: 15", transmitters=one, model=model)
    during = [s for s in bench.snapshots if s.faults]
    after = [s for s in bench.snapshots if s.instant_s > 17]  # no pulse heard during it is shown any more
    assert sum(bool(s.frame.status & INTERFERENCE) for s in during) > 5
    assert not any(s.frame.status & INTERFERENCE for s in after)
    assert spread(during) > spread(after)


def spread(snapshots: list[FrameMade]) -> float:
    """Of the nearest transmitter's d, cm."""
    return float(np.std([s.frame.channels[0].d for s in snapshots]))


def test_two_bursts_of_interference_at_once_add_up_whatever_their_order() -> None:
    strong, weak = "interference: 200, from_s: 5, until_s: 15", "interference: 1.1, from_s: 10"
    both, other_way, of_the_strong, of_the_weak = (
        Bench(*faults).snapshots for faults in ([strong, weak], [weak, strong], [strong], [weak])
    )
    for one in (both, other_way):
        assert [s.number for s in one if "interference" in s.faults] == list(range(50, 201))
        assert spread(one[100:150]) == pytest.approx(spread(of_the_strong[100:150]), rel=0.5)
        assert spread(one[100:150]) > 5 * spread(of_the_weak[100:150])
    # one of a kind is drawn from the same numbers with a second one and without
    assert [s.frame for s in both[:100]] == [s.frame for s in of_the_strong[:100]]
    assert any(a.frame != b.frame for a, b in zip(both[100:150], of_the_strong[100:150], strict=True))


def test_a_cold_battery_makes_everything_sound_farther_away() -> None:
    cold = quiet("cold_battery_db: 18.062, from_s: 10")
    before, then = ([s.frame.channels[0].d for s in cold.snapshots[n : n + 50]] for n in (40, 140))
    assert set(before) == set(before[:1])
    assert then == pytest.approx([2 * before[0]] * 50, abs=1)


def test_a_stuck_receiver_repeats_its_last_reading_and_the_true_range_goes_on() -> None:
    moved = "transmitter_moved: 1, by_ned: [-10, 0, 0], from_s: 10, until_s: 15"
    bench = Bench("stuck: true, from_s: 5, until_s: 12", moved)
    last = bench.snapshots[49].frame
    for s in bench.snapshots[50:120]:
        assert s.frame == last._replace(sequence=s.number)
    ranges = {round(c.true_range_m or 0, 1) for s in bench.snapshots[100:120] for c in s.reading.channels if c.id == 1}
    assert ranges == {round(math.hypot(10, 5), 1)}
    assert bench.snapshots[120].frame.channels != last.channels


def test_a_receiver_stuck_from_the_start_repeats_its_first_reading() -> None:
    bench = Bench("stuck: true")
    assert {s.frame.channels for s in bench.snapshots} == {bench.snapshots[0].frame.channels}


# -- the bytes on the wire -----------------------------------------------------------------------------------------


def unharmed() -> list[bytes]:
    """The bytes of each frame when there are no faults."""
    return [data for _, data in harmless().writes]


def test_truncated_frames_are_beginnings() -> None:
    bench, whole = Bench("truncate: 0.2"), unharmed()
    cut = bench.met("truncate")
    for n, ((_, data), frame) in enumerate(zip(bench.writes, whole, strict=True)):
        assert frame.startswith(data)
        assert (0 < len(data) < len(frame)) == (n in cut)
    missing = sum(map(len, whole)) - len(bench.data)
    assert bench.emulator.fault_counts()["truncate"]["bytes"] == missing


def differences(a: bytes, b: bytes) -> list[int]:
    assert len(a) == len(b)
    return [x ^ y for x, y in zip(a, b, strict=True) if x != y]


def test_corrupt_frames_have_one_byte_wrong() -> None:
    bench = Bench("corrupt: 0.2")
    pairs = zip(bench.writes, unharmed(), strict=True)
    wrong = [differences(data, whole) for (_, data), whole in pairs]
    assert [n for n, each in enumerate(wrong) if each] == bench.met("corrupt")
    assert {len(each) for each in wrong} == {0, 1}
    assert bench.emulator.counters.damaged == len(bench.met("corrupt"))


@given(data=st.binary(max_size=60), share=st.floats(0, 1), random=st.randoms(use_true_random=False))
def test_bytes_flip_vanish_and_come_and_their_number_is_told(data: bytes, share: float, random: Any) -> None:
    flipped, hits = FAULTS["flip_bytes"].strike(data, share, random)
    bits = differences(flipped, data)
    assert len(bits) == hits
    assert all(bit.bit_count() == 1 for bit in bits)
    fewer, hits = FAULTS["drop_bytes"].strike(data, share, random)
    assert len(fewer) == len(data) - hits
    assert within(fewer, data)
    more, hits = FAULTS["insert_bytes"].strike(data, share, random)
    assert len(more) == len(data) + hits
    assert within(data, more)
    assert (more[:1], more[-1:]) == (data[:1], data[-1:])


def within(few: bytes, many: bytes) -> bool:
    """Whether few is what is left of many."""
    left = iter(many)
    return all(byte in left for byte in few)


@pytest.mark.parametrize("name", ["drop_bytes", "insert_bytes", "flip_bytes"])
def test_bytes_are_hit_at_the_rate_asked_for(name: str) -> None:
    bench = Bench(f"{name}: 0.02", seconds=10.0)
    hits, every = bench.emulator.fault_counts()[name]["bytes"], 101 * 33
    assert hits == pytest.approx(0.02 * every, abs=4 * math.sqrt(0.02 * every))


def test_a_frame_of_which_no_byte_is_left_is_withheld() -> None:
    bench = Bench("drop_bytes: 1")
    c = bench.emulator.counters
    assert (c.withheld, c.damaged, c.delivered, bench.writes) == (201, 0, 0, [])


@given(data=st.binary(max_size=40), ratio=st.floats(0.955, 1.045))
def test_a_small_mismatch_of_the_baud_rate_changes_nothing(data: bytes, ratio: float) -> None:
    assert resample(data, ratio) == data


@given(data=st.binary(max_size=20))
def test_a_host_at_half_the_receivers_baud_rate_hears_what_its_bits_say(data: bytes) -> None:
    """Against a line drawn sample by sample, eight to a bit of the receiver's."""
    assert resample(data, 2.0) == sampled(data, 8, 16)
    assert resample(data, 0.5) == sampled(data, 16, 8)


def sampled(data: bytes, sender: int, host: int) -> bytes:
    """A UART, slowly: `sender` and `host` are the samples that each takes for a bit."""
    bits = [bit for byte in data for bit in (0, *(byte >> n & 1 for n in range(8)), 1)]
    line = [1, *(bit for bit in bits for _ in range(sender)), *[1] * 12 * host]
    heard, at = bytearray(), 1
    while at < len(line) - 10 * host:
        if line[at - 1] == 1 and line[at] == 0 and line[at + host // 2] == 0:
            middle = [line[at + host // 2 + host * (1 + n)] for n in range(8)]
            heard.append(sum(bit << n for n, bit in enumerate(middle)))
            at += host // 2 + 9 * host
        at += 1
    return bytes(heard)


def test_a_wrong_baud_rate_leaves_no_frame_and_recovers_at_once() -> None:
    bench = Bench("baud_ratio: 0.5, from_s: 5, until_s: 10")
    assert sequences(bench) == [*range(50), *range(100, 201)]
    assert bench.emulator.counters.damaged == 50


# -- over MAVLink --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("format", ["tunnel", "named"])
def test_frames_inside_mavlink_meet_what_is_sent_and_the_link_stays_whole(
    format: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = f"transmitters: {TWO}\nreceiver: {{rate_hz: 5}}\noutput: {{format: {format}}}\nfaults:\n"
    text += "".join(f"  - {{{each}}}\n" for each in ["drop: 0.1", "duplicate: 0.1", "jitter_s: 0.3", "reorder: 0.1"])
    flown, heard = Flown(parse(text, "test"), inside=True), bytearray()
    feed = flown.vehicle.feed
    monkeypatch.setattr(flown.vehicle, "feed", lambda chunk, *more: (heard.extend(chunk), feed(chunk, *more)))
    flown.run(15.0)
    heard.extend(flown.far.read())
    decoder = MavlinkDecoder(format)
    frames = decoder.feed(bytes(heard), 0.0)
    c = flown.emulator.counters
    assert min(c.withheld, c.duplicated) > 2
    assert decoder.bad_crc == decoder.dropped == 0
    assert c.delivered - len(frames) in (0, 1)  # a named frame ends where the next begins
    ours = [p.raw[4] for p in Parser().feed(bytes(heard)) if p.component == COMPONENT]
    assert {(b - a) % 256 for a, b in itertools.pairwise(ours)} == {1}  # MAVLink's own sequence has no gap


# -- how they are written ----------------------------------------------------------------------------------------


ONE = "transmitters: [{id: 1, ned: [1, 2, 3]}, {id: 9, ned: [1, 2, 3]}]\n"
NAMES = ", ".join(FAULTS)
KEYS = f"{NAMES}, by_ned, over_s, from_s, until_s, every_s, for_s"


@every(
    "text, expected",
    [
        ("faults: {drop: 0.1}", ["2:9: faults: a mapping, expected a list of 0 to 1000 faults"]),
        ("faults: [5]", [f"2:10: faults: '5', expected a mapping with {KEYS}"]),
        ("faults: [{}]", [f"2:10: no fault, expected one of {NAMES}"]),
        ("faults: [{from_s: 5}]", [f"2:10: no fault, expected one of {NAMES}"]),
        ("faults: [{dorp: 1}]", [f"2:11: unknown key 'dorp', expected one of {KEYS}, did you mean 'drop'?"]),
        ("faults: [{drop: 0.1, drop: 0.2}]", ["2:22: key 'drop' again (first on line 2), expected each key once"]),
        ("faults: [{drop: 0.1, stuck: true}]", ["2:22: both drop and stuck, expected one fault an item"]),
        ("faults: [{drop: 0}]", ["2:17: drop: '0', expected a probability above 0, at most 1"]),
        ("faults: [{flip_bytes: 1.1}]", ["2:23: flip_bytes: '1.1', expected a probability above 0, at most 1"]),
        ("faults: [{delay_s: 61}]", ["2:20: delay_s: '61', expected seconds above 0, at most 60"]),
        ("faults: [{interference: 1}]", ["2:25: interference: '1', expected a number above 1, at most 1000000"]),
        ("faults: [{silence: yes}]", ["2:20: silence: 'yes', expected true"]),
        ("faults: [{transmitter_off: 2}]", ["2:10: transmitter_off of transmitter 2, expected one of 1, 9"]),
        ("faults: [{transmitter_moved: 1}]", ["2:10: no by_ned, expected a mapping with by_ned"]),
        ("faults: [{transmitter_fading: 1, over_s: 0}]",
         ["2:42: over_s: '0', expected seconds above 0, at most 1000000"]),
        (
            "faults: [{drop: 0.1, over_s: 3}]",
            ["2:22: unknown key 'over_s', expected one of drop, from_s, until_s, every_s, for_s, "
             "did you mean 'every_s'?"],
        ),
        (
            "faults:\n- {drop: 0.1, from_s: 5, until_s: 5}\n- {drop: 0.1, every_s: 5}\n- {drop: 0.1, for_s: 5}\n"
            "- {drop: 0.1, every_s: 2, for_s: 2}\n- {drop: 0.1, from_s: -1}",
            [
                "3:35: until_s 5, expected later than from_s (5)",
                "4:3: every_s without for_s, expected both or neither",
                "5:3: for_s without every_s, expected both or neither",
                "6:34: for_s 2, expected less than every_s (2)",
                "7:23: from_s: '-1', expected seconds from 0 to 1000000",
            ],
        ),
        (
            "output: {format: tunnel}\nfaults: [{drop: 0.1}, {self_test: true}, {corrupt: 0.1}]",
            ["3:42: corrupt with the format tunnel, expected binary or nmea or text or handheld or vector or rssi, "
             "because it would break the autopilot's own link"],
        ),
        (
            "output: {format: text}\nfaults: [{self_test: true}, {sequence: 0.1}, {flip_bytes: 0.1}]",
            [
                "3:10: self_test with the format text, expected binary or nmea or vector or rssi or tunnel, "
                "which carry it",
                "3:29: sequence with the format text, expected binary or nmea or vector or rssi or tunnel, "
                "which carry it",
            ],
        ),
    ],
)  # fmt: skip
def test_a_mistake_in_a_scenarios_faults(text: str, expected: list[str]) -> None:
    with pytest.raises(ScenarioError) as caught:
        parse(ONE + text, "f.yaml")
    assert str(caught.value).split("\n") == [f"f.yaml:{line}" for line in expected]


def test_a_transmitter_whose_id_is_wrong_is_not_complained_about_twice() -> None:
    with pytest.raises(ScenarioError) as caught:
        parse("transmitters: [{id: x, ned: [1, 2, 3]}]\nfaults: [{transmitter_off: 4}]", "f.yaml")
    assert len(caught.value.problems) == 1


times = st.floats(0, 1e6)
spans = st.floats(0.001, 1e6)


@st.composite
def any_fault(draw: st.DrawFn) -> Fault:
    name = draw(st.sampled_from(list(FAULTS)))
    valid = FAULTS[name].valid
    from_s, every = draw(times), draw(st.none() | st.tuples(spans, spans).filter(lambda pair: pair[0] > pair[1]))
    return Fault(
        name,
        value=1 if valid is None else draw(st.sampled_from([1, 9]) if name.startswith("trans") else numbers(valid)),
        from_s=from_s,
        until_s=draw(st.just(math.inf) | times.filter(lambda until: until > from_s)),
        every_s=every and every[0],
        for_s=every and every[1],
        by_ned=draw(st.tuples(*[st.floats(-1e6, 1e6)] * 3)) if name == "transmitter_moved" else None,
        over_s=draw(spans) if name == "transmitter_fading" else None,
    )


def numbers(valid: Number) -> st.SearchStrategy[float]:
    return st.floats(valid.low, valid.high, exclude_min=valid.above)


@given(st.lists(any_fault(), max_size=5))
def test_written_and_read_back_they_are_equal(faults: list[Fault]) -> None:
    plain = to_dict(replace(parse(ONE, "test"), faults=tuple(faults)))
    assert json.loads(json.dumps(plain)) == plain  # JSON types only
    assert list(parse(json.dumps(plain), "test").faults) == faults


@every(
    "option, same",
    [
        ("drop=0.02@10-60", "drop: 0.02, from_s: 10, until_s: 60"),
        ("drop=0.02", "drop: 0.02"),
        ("silence@30-35", "silence: true, from_s: 30, until_s: 35"),
        ("silence=true@1.5", "silence: true, from_s: 1.5"),
        ("stuck@-2", "stuck: true, until_s: 2"),
        ("interference=1e3,every_s=30,for_s=2@10", "interference: 1000, every_s: 30, for_s: 2, from_s: 10"),
        ("transmitter_moved=1,by_ned=[-5,.5,+1]@3", "transmitter_moved: 1, by_ned: [-5, 0.5, 1], from_s: 3"),
        ("transmitter_fading=1,over_s=60", "transmitter_fading: 1, over_s: 60"),
    ],
)
def test_an_option_says_the_same_as_a_scenario(option: str, same: str) -> None:
    (wanted,) = scenario(same).faults
    assert parse_fault(option) == wanted
    assert parse_fault(str(wanted)) == wanted


@pytest.mark.parametrize(
    ("option", "what", "cure"),
    [
        ("dorp=0.1", "'dorp=0.1': unknown key 'dorp'", "did you mean 'drop'?"),
        ("drop", "'drop': drop without a value", "a probability above 0, at most 1"),
        ("drop=2@5", "'drop=2@5': drop: '2'", "a probability above 0, at most 1"),
        ("drop=0.1@60-10", "until_s 10", "later than from_s (60)"),
        ("drop=0.1,silence", "both drop and silence", "one fault an item"),
        ("drop=0.1 @5", "'drop=0.1 @5'", "NAME=VALUE@FROM-UNTIL, e.g. drop=0.02@10-60"),
        ("drop=0.1@1-2-3", "'drop=0.1@1-2-3'", "NAME=VALUE@FROM-UNTIL"),
        ("drop={a: 1}", "'drop={a: 1}'", "NAME=VALUE@FROM-UNTIL"),
        ("", "''", "NAME=VALUE@FROM-UNTIL"),
        ("transmitter_off=3", "transmitter_off of transmitter 3", "one of 1"),
        ("transmitter_moved=1,by_ned=[1,2]", "by_ned: 2 numbers", "3 (north, east, down)"),
    ],
)
def test_a_wrong_option_is_refused(
    option: str, what: str, cure: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert main(["replay", str(LOG), "--fault", option]) == 2
    said = capsys.readouterr().err
    assert said.startswith("arva-hil: ")
    assert what in said
    assert cure in said
    if option and " " not in option:
        monkeypatch.setenv("ARVA_HIL_FAULT", f"silence@5 {option}")
        assert main(["replay", str(LOG)]) == 2
        assert what in (said := capsys.readouterr().err)
        assert cure in said


def test_bytes_inside_mavlink_are_left_alone_whoever_chose_the_format(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", "--scenario", str(ROOT / "configs" / "faults.yaml"), "--format", "tunnel"]) == 2
    assert "fault truncate=0.05" in (said := capsys.readouterr().err)
    assert "with the format tunnel, expected binary or nmea or text or handheld or vector or rssi" in said


@given(
    st.text(max_size=30) | st.lists(st.sampled_from([*"=@-,[]{}: .1\n", *FAULTS, "from_s"]), max_size=8).map("".join)
)
def test_any_option_is_a_fault_or_a_value_error(text: str) -> None:
    try:
        fault = parse_fault(text)
    except ValueError as error:
        said = str(error)
    else:
        said = f"{fault.name}, expected"
        assert fault.name in FAULTS
    assert "expected" in said


# -- what is written down ------------------------------------------------------------------------------------------


def replayed(folder: Path, *options: str) -> tuple[dict[str, Any], list[dict[str, str]], bytes]:
    """run.json, the rows of readings.csv (one a frame) and frames.bin of a replay."""
    assert main(["replay", str(LOG), "--rate", "10", "--record", str(folder), *options]) == 0
    with (folder / "readings.csv").open(newline="") as file:
        rows = [row for row in csv.DictReader(file) if row["slot"] == "1"]
    return json.loads((folder / "run.json").read_bytes()), rows, (folder / "frames.bin").read_bytes()


def test_what_is_counted_is_what_is_marked_and_what_a_driver_counts(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ARVA_HIL_FAULT", "interference=20,every_s=5,for_s=1 drop=0.05")
    options = "--fault flip_bytes=0.005 --fault duplicate=0.1@5-20 --fault delay_s=0.3@10-12".split()
    run, rows, data = replayed(tmp_path / "one", *options)
    c = run["counters"]
    assert c["frames"] == len(rows)
    assert c["frames"] + c["duplicated"] == sum(
        c[name] for name in ("delivered", "damaged", "withheld", "dropped", "waiting")
    )
    marked = Counter(name for row in rows for name in row["faults"].split("+") if name)
    assert marked == {name: count["frames"] for name, count in c["faults"].items()}
    assert set(marked) == {"interference", "drop", "flip_bytes", "duplicate", "delay_s"}
    decoder = Decoder()
    decoder.feed(data, 0.0)
    decoder.feed(b"", 1.0)
    assert decoder.good == c["delivered"]
    assert [plain for plain in run["scenario"]["faults"] if "drop" in plain] == [{"drop": 0.05}]
    said = capsys.readouterr().err
    assert "  fault delay_s=0.3@10-12\n" in said
    assert f"faults: {c['withheld']} frames withheld, {c['damaged']} damaged, {c['duplicated']} sent again" in said
    assert replayed(tmp_path / "two", *options)[1:] == (rows, data)


def test_none_takes_back_what_scenario_and_environment_ask_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ARVA_HIL_FAULT", "drop=1")
    run, rows, _ = replayed(tmp_path / "one", "--fault", "none", "--fault", "stuck@5-6")
    assert run["scenario"]["faults"] == [{"stuck": True, "from_s": 5.0, "until_s": 6.0}]
    assert {row["faults"] for row in rows} == {"", "stuck"}


def play(chosen: Scenario, wire: Wire, clock: StepClock | None = None) -> Emulator:
    """The log's frames on a wire."""
    emulator = Emulator([one_vehicle(chosen, Session(passive=True))], start=0.0, look_ahead_s=LOOK_AHEAD_S)
    replay(emulator, TlogReader(LOG), "autopilot", lambda output: wire.write(output.data), Audience([]), clock=clock)
    return emulator


def test_a_replay_in_a_clocks_time_sends_late_frames_late_and_the_same_bytes() -> None:
    chosen = scenario("delay_s: 0.04, from_s: 5, until_s: 10", "jitter_s: 0.25, from_s: 12")

    def write(clock: StepClock | None) -> list[tuple[float, bytes]]:
        wire = Wire(clock or StepClock())
        play(chosen, wire, clock)
        return wire.writes

    paced = write(StepClock())
    assert [data for _, data in paced] == [data for _, data in write(None)]
    assert [at for at, _ in paced[:100]] == pytest.approx([n / 10 + 0.04 * (n >= 50) for n in range(100)])
    assert len({round(at % 0.1, 6) for at, _ in paced[120:]}) > 50


def test_a_replay_sends_what_is_due_before_the_log_ends() -> None:
    counters = play(scenario("delay_s: 0.001"), Wire(StepClock())).vehicles[0].units[0].port.counters
    assert counters.delivered == counters.frames > 100
    assert counters.waiting == 0


def test_every_fault_is_in_the_scenario_that_shows_them() -> None:
    shown = load(ROOT / "configs" / "faults.yaml").faults
    assert {fault.name for fault in shown} == set(FAULTS)


def test_a_long_run_checks_out(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Half a minute of it."""
    options = Namespace(scenario=ROOT / "configs" / "faults.yaml", hours=0.01)
    right = long_run(options, tmp_path / "record")
    said = capsys.readouterr().out
    assert right, said
    assert "accounted for" in said
