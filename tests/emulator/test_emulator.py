"""The emulator: frames at their instants, from the pose at their instants, whatever carries the bytes."""

from __future__ import annotations

import math
import socket
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from arva_hil.autopilot.following.session import Session
from arva_hil.clock import Clock, RealClock, StepClock
from arva_hil.config import Scenario, parse
from arva_hil.emulator.engine import Emulator
from arva_hil.emulator.formats import MavlinkDecoder
from arva_hil.emulator.receivers import Schedule
from arva_hil.emulator.setup import one_vehicle
from arva_hil.links import Link, memory, open_link
from arva_hil.links.pty import PtyLink
from arva_hil.model.field import LocalFrame, Transmitters
from arva_hil.model.receiver import Antennas
from arva_hil.registry import FORMATS
from arva_hil.runtime.loop import run
from arva_hil.simulated.vehicle import SimulatedVehicle, Simulator
from firmware_proto import Decoder, Frame
from tests.free_ports import free_port
from tests.one_receiver import HOME, Diary, Flown, OneReceiver
from tests.paper_receiver import Receiver

QUIET = "receiver: {noise: {kind: off}, rate_hz: %g}\ntransmitters: [{id: 7, ned: [20, 5, 0]}]"


def quiet(rate_hz: float = 1.0) -> Scenario:
    return parse(QUIET % rate_hz, "test")


class Bench(Flown):
    """The same, with frames decoded."""

    def frames(self) -> list[Frame]:
        return Decoder().feed(self.consumer.read(), self.clock.now())


# -- the reading is that of the true pose at the frame's instant ------------------------------------------------


def test_frames_say_what_a_receiver_at_the_vehicles_true_pose_reads() -> None:
    bench = Bench(quiet(10))
    bench.run(10.0)
    bench.fly(1.5, 0.5)
    truths = {}
    for _ in range(60):
        bench.run(bench.clock.now() + 0.1)
        truths[round(bench.clock.now(), 6)] = bench.vehicle.truth(bench.clock.now())
    rotations = np.eye(3)[None]
    ideal = Receiver(
        Transmitters((7,), np.array([[20.0, 5.0, 0.0]]), rotations, np.ones(1)), Antennas(noise="off"), seed=1
    )
    compared = 0
    for snapshot in bench.diary.frames:
        truth = truths.get(round(snapshot.instant_s, 6))
        if truth is None:
            continue
        wanted = ideal.read(*ideal.pose(truth.ned, truth.quaternion)).channels[0]
        (read, *rest) = snapshot.reading.channels
        assert all(channel.id is None for channel in rest)
        assert (read.id, read.zone) == (7, wanted.zone)
        assert abs(read.d_cm - wanted.d_cm) <= 5  # centimetres of position over the link
        assert abs(read.delta_deg - wanted.delta_deg) <= 1
        assert np.linalg.norm(snapshot.pose.position - truth.ned) < 0.05
        compared += 1
    assert compared > 50


def test_no_pose_is_from_the_future_and_none_older_than_its_age_says() -> None:
    bench = Bench(quiet(50))
    bench.run(10.0)
    posed = [s for s in bench.diary.frames if s.pose is not None]
    assert len(posed) > 400
    for s in posed:
        assert 0 <= s.age_s < 0.05
        assert s.instant_s - 0.002 < s.boot_s <= s.instant_s + 1e-9  # the vehicle booted at 0 on this clock


def test_the_consumer_decodes_exactly_what_was_read() -> None:
    bench = Bench(quiet(5))
    bench.run(8.0)
    frames = bench.frames()
    assert [f.sequence for f in frames] == [s.frame.sequence for s in bench.diary.frames] == list(range(41))
    for frame, snapshot in zip(frames, bench.diary.frames, strict=True):
        assert frame == snapshot.frame
        assert [(c.id, c.zone, c.d, c.delta) for c in frame.channels] == [
            (c.id, c.zone, c.d_cm, c.delta_deg) for c in snapshot.reading.channels
        ]


def test_what_arrives_while_the_program_is_held_up_is_not_taken_for_earlier_than_it_was() -> None:
    """A pause between looking at the clock and at the link must not make a pose one from the future."""
    bench = Bench(quiet(50))
    bench.run(3.0)
    bench.emulator.service(StallingClock(bench.clock, bench.simulator))
    now = bench.clock.now()
    assert bench.emulator.session.navigation.clock.boot(now) <= now + 1e-9


class StallingClock(StepClock):
    """Whenever it is asked, 30 ms pass before anything else happens, in which the vehicle goes on."""

    def __init__(self, real: StepClock, vehicle: Simulator) -> None:
        super().__init__(real.now())
        self._real = real
        self._vehicle = vehicle

    def now(self) -> float:
        seen = self._real.now()
        self._real.wait(seen + 0.03)
        self._vehicle.service(self._real)
        return seen


# -- the schedule ------------------------------------------------------------------------------------------------


@given(rate=st.floats(0.1, 50), start=st.floats(0, 1e6), share=st.floats(0, 0.49), seed=st.integers(0, 2**63 - 1))
def test_deadlines_are_absolute_and_jitter_never_adds_up(rate: float, start: float, share: float, seed: int) -> None:
    jitter = share / rate
    schedule = Schedule(start, rate, jitter, seed)
    previous = -math.inf
    for n in range(200):
        assert start + n / rate <= schedule.deadline <= start + n / rate + jitter + 1e-9
        assert schedule.deadline > previous
        previous = schedule.deadline
        schedule.advance()


def test_a_late_loop_sends_what_it_owes_but_after_a_long_stop_no_burst() -> None:
    bench = Bench(quiet(10))
    bench.run(5.0)
    bench.diary.events.clear()
    bench.clock.wait(5.55)
    bench.run(5.55)
    assert [round(s.instant_s, 9) for s in bench.diary.frames] == [5.1, 5.2, 5.3, 5.4, 5.5]
    assert bench.emulator.counters.skipped == 0
    bench.diary.events.clear()
    bench.clock.wait(60.0)
    bench.run(60.0)
    assert len(bench.diary.frames) <= 12
    assert bench.diary.frames[-1].instant_s == pytest.approx(60.0)
    assert bench.emulator.counters.skipped == 545 - len(bench.diary.frames)
    assert bench.diary.frames[-1].frame.sequence == 600 % 256  # what was skipped is a gap in the numbers


# -- no pose ------------------------------------------------------------------------------------------------------


def test_frames_flow_before_there_is_a_vehicle_and_say_no_signal() -> None:
    bench = Bench(quiet(2))
    bench.run(3.0, with_vehicle=False)
    frames = bench.frames()
    assert len(frames) == 7
    assert all((c.id, c.zone, c.d, c.delta) == (None, 0, -1, -1) for f in frames for c in f.channels)


def test_an_old_pose_is_no_pose_said_once_and_it_recovers_by_itself() -> None:
    bench = Bench(quiet(10))
    bench.run(5.0)
    assert bench.diary.frames[-1].pose is not None
    bench.run(12.0, with_vehicle=False)
    silent = [s for s in bench.diary.frames if s.instant_s > 5.0]
    for s in silent:
        if abs(s.instant_s - 7.0) > 0.05:  # the limit itself
            assert (s.pose is None) == (s.instant_s > 7.0), s.instant_s
        assert s.frame.channels[0].valid == (s.pose is not None)
    assert bench.diary.said("no pose: frames have no signal") == 1
    bench.run(14.0)
    assert bench.diary.frames[-1].pose is not None
    assert bench.diary.frames[-1].frame.channels[0].id == 7
    assert bench.diary.said("there is a pose") == 2


ELSEWHERE = (46.1, 7.9, 2100.0)  # 15 km away


@pytest.mark.parametrize("boot_time", [15.0, -1000.0], ids=["rebooted", "another one, on for longer"])
def test_a_vehicle_that_comes_back_elsewhere_finds_the_transmitters_around_its_new_home(boot_time: float) -> None:
    bench = Bench(quiet(10))
    bench.run(5.0)
    assert bench.diary.frames[-1].frame.channels[0].id == 7
    bench.run(15.0, with_vehicle=False)
    bench.simulator = Simulator([SimulatedVehicle(ELSEWHERE, boot_time=boot_time)], [bench.far])
    bench.run(25.0)
    (channel, *_) = bench.diary.frames[-1].reading.channels
    assert channel.id == 7
    assert channel.true_range_m == pytest.approx(math.hypot(20, 5), abs=0.1)
    assert bench.diary.said("datum: 46.1000000, 7.9000000, 2100.00 m AMSL (home has moved)") == 1


def test_a_vehicle_far_from_the_datum_is_said_once_and_the_true_range_shows_it() -> None:
    scenario = parse("datum: {lat: 47.0, lon: 7.7456, alt: 1650}\n" + QUIET % 10, "test")
    bench = Bench(scenario)
    bench.run(20.0)
    assert bench.diary.said("the vehicle is 109.8 km from the datum") == 1
    (channel, *others) = bench.diary.frames[-1].reading.channels
    assert channel.id is None
    assert channel.true_range_m == pytest.approx(109_800, abs=200)
    assert [other.true_range_m for other in others] == [None] * 3


def test_the_noise_of_a_frame_does_not_depend_on_whether_others_had_a_pose() -> None:
    noisy = parse("transmitters: [{id: 7, ned: [20, 5, 0]}]", "test")
    with_gap, without = Bench(noisy), Bench(noisy)
    without.run(28.0)
    with_gap.run(10.0)
    with_gap.run(20.0, with_vehicle=False)
    with_gap.run(28.0)
    assert with_gap.diary.frames[15].frame != without.diary.frames[15].frame
    assert with_gap.diary.frames[25:] != []
    for a, b in zip(with_gap.diary.frames[25:], without.diary.frames[25:], strict=True):
        assert a.frame == b.frame


def test_a_vehicle_without_a_fix_gets_one_line_that_says_why() -> None:
    bench = Bench(quiet(1), SimulatedVehicle(HOME, fix_after=1e9))
    bench.run(30.0)
    assert bench.diary.said("still no pose") == 1
    assert bench.diary.said("no GPS fix") == 1
    assert all(s.pose is None for s in bench.diary.frames)


def test_bytes_that_come_before_the_start_are_used_and_the_first_frame_waits_for_it() -> None:
    emulator, vehicle = Emulator([one_vehicle(quiet(), Session())], start=5.0), SimulatedVehicle(HOME)
    emulator.receive("autopilot", vehicle.poll(4.0), 4.0)
    emulator.advance(4.0)
    assert emulator.vehicles[0].session.vehicle is not None
    assert [output.link for output in emulator.output()] == ["autopilot"]
    emulator.advance(5.0)
    assert "port" in [output.link for output in emulator.output()]


def test_no_heartbeat_in_time_ends_it_and_says_what_was_heard() -> None:
    bench = Bench(quiet(1), timeout_s=5.0)
    bench.far.write(b"\x00" * 100)
    bench.run(4.9, with_vehicle=False)
    assert not bench.diary.missing
    bench.run(10.0, with_vehicle=False)
    (heard,) = bench.diary.missing
    assert "100 bytes" in heard
    assert "baud" in heard


# -- ports --------------------------------------------------------------------------------------------------------


def test_a_port_that_nobody_empties_drops_whole_frames_and_holds_nothing_up() -> None:
    bench = Bench(quiet(10), capacity=100)  # three frames of four channels
    bench.run(5.0)
    emulator, diary, consumer = bench.emulator, bench.diary, bench.consumer
    assert (emulator.counters.frames, emulator.counters.delivered, emulator.counters.dropped) == (51, 3, 48)
    assert [s.sent for s in diary.frames] == [True] * 3 + [False] * 48
    assert diary.said("no program takes the frames") == 1
    decoder = Decoder()
    assert len(decoder.feed(consumer.read(), 5.0)) == 3
    bench.run(5.2)
    assert [f.sequence for f in decoder.feed(consumer.read(), 5.2)] == [51, 52]
    assert diary.said("frames are taken") == 1


@pytest.mark.parametrize("format", ["binary", "nmea", "text"])
def test_every_wire_format_carries_the_nearest_reading(format: str) -> None:
    bench = Bench(replace(quiet(2), output_format=format))
    bench.run(6.0)
    frames = FORMATS[format].decoder().feed(bench.consumer.read(), 6.0)
    assert len(frames) == 13
    for frame, snapshot in zip(frames, bench.diary.frames, strict=True):
        assert (frame.channels[0].d, frame.channels[0].delta) == (
            snapshot.frame.channels[0].d,
            snapshot.frame.channels[0].delta,
        )
    assert frames[-1].channels[0].valid


@pytest.mark.parametrize("format", ["tunnel", "named", "named_float", "debug_vect"])
def test_one_port_frames_travel_inside_mavlink_on_the_autopilots_own_link(
    format: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    scenario = parse("receiver: {channels: 4, rate_hz: 2}\ntransmitters: [{id: 3, ned: [9, 5, 0]}, "
                     "{id: 9, ned: [-20, 5, 0]}]", "test")  # fmt: skip
    bench, heard = Bench(replace(scenario, output_format=format), inside=True), bytearray()
    feed = bench.vehicle.feed
    monkeypatch.setattr(bench.vehicle, "feed", lambda chunk, *more: (heard.extend(chunk), feed(chunk, *more)))
    bench.run(10.0)
    heard.extend(bench.far.read())
    diary = bench.diary
    decoder = MavlinkDecoder(format)
    frames = decoder.feed(bytes(heard), 0.0)
    assert decoder.bad_crc == 0
    sent = [s.frame for s in diary.frames if s.sent]
    assert len(sent) >= 20
    frames += decoder.feed(b"", 1.0)  # a named frame ends where the next begins, or in silence
    assert len(frames) == len(sent)
    for frame, made in zip(frames, sent, strict=False):
        wanted = [c for c in made.channels if c.valid] or [made.channels[0]]
        read = [c for c in frame.channels if c.valid] or [frame.channels[0]]
        assert [(c.d, c.delta, c.zone) for c in read] == [(c.d, c.delta, c.zone) for c in wanted]
        if format != "debug_vect":
            assert [c.id for c in read] == [c.id for c in wanted]
        if format == "tunnel":
            assert frame == made
    assert len([c for c in frames[-1].channels if c.valid]) == 2


# -- two at once, and every kind of link --------------------------------------------------------------------------


def test_two_emulators_side_by_side_in_one_process_do_not_touch_each_other() -> None:
    """Together they send, byte for byte, what each sends alone."""
    first = parse("transmitters: [{id: 1, ned: [20, 5, 0]}]\nseed: 5", "first")
    second = parse("receiver: {rate_hz: 7, channels: 2}\ntransmitters: [{id: 2, enu: [-8, 3, 1]}]\nseed: 6", "second")

    def vehicles() -> Iterator[SimulatedVehicle]:
        yield SimulatedVehicle(HOME, system=1)
        yield SimulatedVehicle((-35.36, 149.165, 584.0), system=42, version=1, gps_noise_m=0.5)

    alone = []
    for scenario, vehicle in zip((first, second), vehicles(), strict=True):
        bench = Bench(scenario, vehicle)
        bench.run(5.0)
        alone.append(bench.consumer.read())
    together = [Bench(s, v) for s, v in zip((first, second), vehicles(), strict=True)]
    tasks = [task for bench in together for task in (bench.simulator, bench.emulator)]
    run(tasks, StepClock(), until=5.0)
    assert [bench.consumer.read() for bench in together] == alone
    assert [b.emulator.session.vehicle.system for b in together if b.emulator.session.vehicle] == [1, 42]


@contextmanager
def joined(kind: str, clock: RealClock) -> Iterator[tuple[Link, Link]]:
    """Two ends of a link of one kind."""
    with ExitStack() as stack:
        ends: Sequence[Link]
        if kind == "memory":
            ends = memory.pair()
        elif kind == "pty":
            far = stack.enter_context(closing(PtyLink()))
            ends = (open_link(far.path, clock=clock), far)
        else:
            listening, calling = {"udp": ("udpin", "udpout"), "tcp": ("tcpin", "tcp")}[kind]
            port = free_port(socket.SOCK_DGRAM if kind == "udp" else socket.SOCK_STREAM)
            near = open_link(f"{listening}:127.0.0.1:{port}", clock=clock)
            stack.enter_context(closing(near))
            ends = (near, open_link(f"{calling}:127.0.0.1:{port}", clock=clock))
        for end in ends:
            stack.enter_context(closing(end))
        yield ends[0], ends[1]


@pytest.mark.parametrize("receiver", ["memory", "pty", "udp", "tcp"])
@pytest.mark.parametrize("autopilot", ["memory", "pty", "udp", "tcp"])
def test_the_whole_chain_over_every_kind_of_link(autopilot: str, receiver: str) -> None:
    clock, diary = RealClock(), Diary()
    with joined(autopilot, clock) as (link, far), joined(receiver, clock) as (consumer, port):
        port.write(b"")
        emulator = OneReceiver(quiet(50), Session(), link, port, start=clock.now(), observers=[diary])
        frames: list[Frame] = []
        decoder = Decoder()

        class Consumer:
            links: Sequence[Link] = [consumer]

            def service(self, clock: Clock) -> float:
                now = clock.now()
                frames.extend(decoder.feed(consumer.read(), now))
                return now + 0.1

        enough = lambda: len(frames) > 20 and frames[-1].channels[0].id == 7  # noqa: E731
        simulator = Simulator([SimulatedVehicle(HOME, boot_time=clock.now())], [far])
        run([simulator, emulator, Consumer()], clock, until=clock.now() + 90, stopped=enough)
    assert enough()
    assert decoder.bad_crc == decoder.dropped == 0
    sent = {s.frame.sequence: s.frame for s in diary.frames}
    assert all(sent[frame.sequence] == frame for frame in frames)


def test_a_transmitter_given_by_latitude_and_longitude_is_heard_where_it_lies() -> None:
    """It moves with no datum: the vehicle's home is 20 m south and 5 m west of it."""
    lat, lon, alt = LocalFrame(*HOME).lla([20.0, 5.0, 0.0])
    there = f"receiver: {{noise: {{kind: off}}}}\ntransmitters: [{{id: 7, lla: [{lat:.12f}, {lon:.12f}, {alt:.6f}]}}]"
    by_lla, by_ned = Bench(parse(there, "test")), Bench(quiet())
    for bench in (by_lla, by_ned):
        bench.run(5.0)
    assert by_lla.frames() == by_ned.frames()
    assert by_lla.diary.frames[-1].frame.channels[0].valid
