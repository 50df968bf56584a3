"""Packets of a busy stream are used together: frames and records are the same as if each were used when it came."""

from __future__ import annotations

import math
from dataclasses import replace

from hypothesis import given, settings
from hypothesis import strategies as st

from arva_hil.autopilot.following.session import Session
from arva_hil.clock import Clock, StepClock
from arva_hil.config import parse
from arva_hil.emulator.engine import Emulator
from arva_hil.emulator.setup import one_vehicle
from arva_hil.links.memory import MemoryLink, pair
from arva_hil.mavlink.codec import Encoder, dialect
from arva_hil.runtime.audience import Audience
from arva_hil.runtime.drivers import Live
from arva_hil.runtime.loop import run
from tests.one_receiver import Diary, OneReceiver, turn

SECONDS = 3.0
SCENARIO = """receiver: {rate_hz: %g}
transmitters: [{id: 7, ned: [20, 5, 0]}]
datum: {lat: 46.5, lon: 11.35, alt: 588}
"""


def packets(seconds: float) -> bytes:
    """What a vehicle says that flies north-east and turns."""
    ms, encoder = round(seconds * 1e3), Encoder(1, 1)
    position = 465000000 + round(400 * seconds), 113500000 + round(300 * seconds), 588_000, 0, 400, 250, 0, 0
    beat = dialect.MAVLink_heartbeat_message(2, 3, 0, 0, 3, 3)
    attitude = dialect.MAVLink_attitude_message(ms, 0, 0, math.sin(seconds), 0, 0, math.cos(seconds))
    said = [beat, dialect.MAVLink_global_position_int_message(ms, *position), attitude]
    return b"".join(encoder.pack(one) for one in said)


class Autopilot:
    """A task that writes its packets to a link at these times."""

    links = ()

    def __init__(self, link: MemoryLink, times: list[float]) -> None:
        self._link = link
        self._times = times[::-1]

    def service(self, clock: Clock) -> float:
        while self._times and self._times[-1] <= clock.now():
            self._link.write(packets(self._times.pop()))
        return self._times[-1] if self._times else math.inf


def flown(rate_hz: float, times: list[float]) -> Diary:
    diary, (near, far), (port, _) = Diary(), pair(), pair()
    scenario = parse(SCENARIO % rate_hz, "test")
    live = OneReceiver(scenario, Session(passive=True), near, port, start=0.0, observers=[diary])
    clock = StepClock()
    run([Autopilot(far, times), live], clock, until=SECONDS)
    live.finish(clock)
    return diary


def used_one_by_one(rate_hz: float, times: list[float]) -> Diary:
    diary, said = Diary(), times[::-1]
    vehicle = one_vehicle(parse(SCENARIO % rate_hz, "test"), Session(passive=True))
    engine = Emulator([vehicle], start=0.0, tell_packets=True)
    while (now := min(engine.next_deadline(), said[-1] if said else math.inf)) <= SECONDS:
        if said and said[-1] <= now:
            engine.receive("autopilot", packets(said.pop()), now)
        turn(engine, now, diary)
    return diary


def poses(diary: Diary) -> list[object]:
    """Position and rotation of each frame, None without a pose."""
    return [(one.position.tolist(), one.rotation.tolist()) if (one := frame.pose) else None for frame in diary.frames]


def received(diary: Diary) -> list[tuple[float, bytes]]:
    """Each chunk of packets with its time."""
    return [(event.time_s, b"".join(packet.raw for packet in event.packets)) for event in diary.packets]


@settings(max_examples=15, deadline=None)
@given(
    rate_hz=st.sampled_from([1.0, 7.0, 10.0, 50.0]),
    milliseconds=st.lists(st.integers(1, 2999), min_size=1, max_size=150, unique=True),
)
def test_frames_and_records_are_the_same_as_if_each_packet_were_used_when_it_came(
    rate_hz: float, milliseconds: list[int]
) -> None:
    times = [round(ms / 1e3 + 1e-4, 6) for ms in sorted(milliseconds)]  # not at the instant of a frame
    together, alone = flown(rate_hz, times), used_one_by_one(rate_hz, times)
    assert together.bytes == alone.bytes
    assert poses(together) == poses(alone)
    assert received(together) == received(alone)


class RealisticClock(StepClock):
    """A clock of a processor that is slow when it wakes up, as `RealClock`."""

    early_s = 0.0005


class CountedLive(Live):
    """Counts how often it wakes up."""

    wakes = 0

    def service(self, clock: Clock) -> float:
        self.wakes += 1
        return super().service(clock)


def test_a_live_run_rests_between_the_packets_of_a_busy_stream_and_its_poses_stay_as_new() -> None:
    """Each packet tells the pose at its time: the newest one is 20 ms old at most, and extrapolated."""
    vehicle = one_vehicle(parse(SCENARIO % 10, "test"), Session(passive=True))
    wakes = {}
    for tell_packets in (False, True):
        diary, (near, far), (port, _) = Diary(), pair(), pair()
        engine = Emulator([replace(vehicle, session=Session(passive=True))], start=0.0, tell_packets=tell_packets)
        live = CountedLive(engine, {"autopilot": near}, {"port": port}, Audience([diary]))
        run([Autopilot(far, [n / 50 + 1e-4 for n in range(150)]), live], RealisticClock(), until=SECONDS)
        ages = [frame.age_s for frame in diary.frames[5:] if frame.age_s is not None]
        assert max(ages) < 0.025
        assert all(abs(frame.instant_s - (frame.boot_s or 0.0)) < 0.005 for frame in diary.frames[5:])
        wakes[tell_packets] = live.wakes
    assert wakes[False] < 0.75 * wakes[True]


class PiecewiseLink(MemoryLink):
    """A link that returns one write at a read, as a socket returns a few datagrams."""

    def read(self) -> bytes:
        return self._inbox.popleft() if self._inbox else super().read()


def test_a_live_run_does_not_rest_while_bytes_wait() -> None:
    """Of 200 datagrams a second none is left in the system's buffer, which loses what it has no room for."""
    diary, far, (port, _) = Diary(), MemoryLink("vehicle", None), pair()
    near = far._far = PiecewiseLink("autopilot", None)
    engine = Emulator([one_vehicle(parse(SCENARIO % 10, "test"), Session(passive=True))], start=0.0)
    live = Live(engine, {"autopilot": near}, {"port": port}, Audience([diary]))
    run([Autopilot(far, [n / 200 + 1e-4 for n in range(600)]), live], RealisticClock(), until=SECONDS)
    ages = [frame.age_s for frame in diary.frames[5:] if frame.age_s is not None]
    assert max(ages) < 0.055  # a rest is 50 ms long
    assert len(near._inbox) <= 10
