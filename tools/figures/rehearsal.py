"""A rehearsed flight: the emulator stands in for a real receiver, and a log records it, in virtual time.

The vehicle leans with the wind. What it reports of its position has the scenario's navigation error.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from arva_hil.autopilot.following.session import Session
from arva_hil.config import DEFAULT, NavigationError, Scenario, Transmitter, to_dict
from arva_hil.config.receiver import MountOptions, Noise, ReceiverOptions
from arva_hil.emulator.engine import Emulator
from arva_hil.emulator.setup import one_vehicle
from arva_hil.events import Event
from arva_hil.mavlink.codec import Encoder, dialect
from arva_hil.model.field import LocalFrame
from arva_hil.records.fitting import FittedValue
from arva_hil.records.received import AUTOPILOT, RECEIVER, ReceivedFrames, ReceiverLog, Surveyed, surveyed_scenario
from arva_hil.records.writing import Recorder, RecordLayout
from arva_hil.registry import FORMATS
from arva_hil.simulated import HOME

EPOCH_US = 1_798_761_600_000_000  # 2027-01-01T00:00:00Z
STEP_S = 0.1
ARMED = dialect.MAV_MODE_FLAG_SAFETY_ARMED | dialect.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED


class Waypoint(NamedTuple):
    """A point of the flight: seconds, metres NED from home, heading in degrees."""

    time_s: float
    north: float
    east: float
    down: float
    heading_deg: float


def mission(reach_m: float = 25.0, height_m: float = 4.0, speed: float = 2.0) -> list[Waypoint]:
    """A pass each way, north and east, at two heights, each with another heading, and a slow turn at two places."""
    points = [Waypoint(0.0, -reach_m, 0.0, -height_m, 0.0)]

    def to(north: float, east: float, height: float, heading: float) -> None:
        last = points[-1]
        far = math.dist((last.north, last.east, last.down), (north, east, -height))
        time_s = last.time_s + max(far / speed, abs(heading - last.heading_deg) / 20, 0.5)
        points.append(Waypoint(time_s, north, east, -height, heading))

    for height in height_m, height_m + 4:
        for heading in 0.0, 90.0:
            to(-reach_m, 0, height, heading)
            to(reach_m, 0, height, heading)
            to(reach_m, 0, height, heading + 180)
            to(-reach_m, 0, height, heading + 180)
        for heading in 90.0, 0.0:
            to(0, -reach_m, height, heading)
            to(0, reach_m, height, heading)
            to(0, reach_m, height, heading + 180)
            to(0, -reach_m, height, heading + 180)
        to(8, 8, height, 0)
        to(8, 8, height, 360)
        to(-9, 6, height, 360)
        to(-9, 6, height, 0)
    return points


def rehearse(
    folder: Path,
    scenario: Scenario,
    points: Sequence[Waypoint],
    *,
    latency_s: float = 0.0,
    surveyed: Sequence[Surveyed] = (),
    wind: float = 3.0,
    seed: int = 1,
    more: Sequence[tuple[float, bytes]] = (),
    throttle: Callable[[float], float] | None = None,
) -> Path:
    """Fly, and leave a record. `latency_s`: of the receiver. `wind`: m/s. `more`: bytes on the receiver's line.

    `throttle`: 0…1 over the time, which the vehicle reports; None: it does not.
    """
    form = FORMATS[scenario.output_format]
    emulator = Emulator([one_vehicle(scenario, Session(passive=True))], start=0.0, tell_status=False)
    places = surveyed_scenario(surveyed)
    log = ReceiverLog(places, Session(passive=True), ReceivedFrames(form.decoder(), numbered=form.numbered), start=0.0)
    about = {"source": "receiver", "format": scenario.output_format, "scenario": to_dict(places) if surveyed else None}
    recorder = Recorder(folder, EPOCH_US, about, patient=True, layout=RecordLayout(real=True))

    def tell(events: Sequence[Event]) -> None:
        for event in events:
            recorder.observe(event)

    on_the_way = [*more]
    heapq.heapify(on_the_way)
    vehicle, hud = _Vehicle(points, wind, seed), Encoder(1, 1)
    now, end_s = 0.0, points[-1].time_s
    while now <= end_s:
        data = vehicle.messages(now)
        if throttle is not None:
            data += hud.pack(dialect.MAVLink_vfr_hud_message(0.0, 0.0, 0, round(100 * throttle(now)), 0.0, 0.0))
        emulator.receive(AUTOPILOT, data, now)
        log.receive(AUTOPILOT, data, now)
        emulator.advance(now)
        for output in emulator.output():
            if output.link == "port":
                heapq.heappush(on_the_way, (now + latency_s, output.data))
            emulator.written(output.id, True, now)
        emulator.events()
        while on_the_way and on_the_way[0][0] <= now:
            came_s, frame = heapq.heappop(on_the_way)
            log.receive(RECEIVER, frame, max(came_s, now - STEP_S))
        log.advance(now)
        tell(log.events())
        now = round(now + STEP_S, 6)
    log.advance(now, final=True)
    tell(log.events())
    datums = [change._asdict() for change in log.world.datum.changes]
    recorder.close({"ended": "finished", "exit_code": 0, **about, "datums": datums, "counters": log.counts()})
    return folder


class _Vehicle:
    """A vehicle on a path that leans with the wind, and says so in MAVLink."""

    def __init__(self, points: Sequence[Waypoint], wind: float, seed: int) -> None:
        self._path = np.array(points)
        self._path[:, 4] = np.radians(self._path[:, 4])
        self._frame = LocalFrame(*HOME)
        self._encoder = Encoder(1, 1)
        self._random = np.random.default_rng([seed, 77])
        self._lean = self._random.uniform(-0.02, 0.02, 2) * wind
        self._gust = np.zeros(2)
        self._wind = wind

    def messages(self, now: float) -> bytes:
        keep = math.exp(-STEP_S / 1.5)
        self._gust = keep * self._gust + math.sqrt(1 - keep**2) * 0.01 * self._wind * self._random.standard_normal(2)
        north, east, down, heading = self._at(now)
        ahead = self._at(now + STEP_S)
        velocity = [(b - a) / STEP_S for a, b in zip((north, east, down), ahead[:3], strict=True)]
        lean_north, lean_east = self._lean + self._gust
        cos, sin = math.cos(heading), math.sin(heading)
        pitch, roll = -(lean_north * cos + lean_east * sin), -lean_north * sin + lean_east * cos
        lat, lon, alt = (float(value) for value in self._frame.lla([north, east, down]))
        boot_ms, place = 10_000 + round(now * 1e3), (round(lat * 1e7), round(lon * 1e7), round(alt * 1e3))
        yaw = math.remainder(heading, math.tau)
        messages = [
            dialect.MAVLink_attitude_message(boot_ms, roll, pitch, yaw, 0.0, 0.0, 0.0),
            dialect.MAVLink_global_position_int_message(
                boot_ms, *place, round(-down * 1e3), *(round(v * 100) for v in velocity), 65535
            ),
        ]
        if round(now / STEP_S) % round(1 / STEP_S) == 0:
            kind = dialect.MAV_TYPE_QUADROTOR, dialect.MAV_AUTOPILOT_ARDUPILOTMEGA
            armed = ARMED if now > 1 else 0
            messages.insert(0, dialect.MAVLink_heartbeat_message(*kind, armed, 4, dialect.MAV_STATE_ACTIVE, 3))
            home = round(HOME[0] * 1e7), round(HOME[1] * 1e7), round(HOME[2] * 1e3)
            messages.append(dialect.MAVLink_home_position_message(*home, 0, 0, 0, [1.0, 0, 0, 0], 0, 0, 0))
        return b"".join(map(self._encoder.pack, messages))

    def _at(self, now: float) -> list[float]:
        return [float(np.interp(now, self._path[:, 0], column)) for column in self._path.T[1:]]


def drawn(seed: int, model: str = "paper") -> tuple[Scenario, dict[str, float]]:
    """A scenario with a receiver and a transmitter drawn at random, and the true values of its parameters."""
    random = np.random.default_rng([seed, 1])
    kappa = float(1.542 * np.exp(random.uniform(-0.25, 0.25)))
    yaw = float(random.uniform(-40, 40))
    mount = tuple(float(value) for value in random.uniform(-0.4, 0.4, 3))
    north, east = (float(value) for value in random.uniform(-8, 8, 2))
    down, heading = float(random.uniform(0, 2)), float(random.uniform(-90, 90))
    pitch = float(random.uniform(-50, 50))
    floor_m = float(random.uniform(60, 100))
    weakest = float(random.uniform(0.5, 1.0))
    q = (1.0, weakest, 0.6)
    truth = {
        "kappa_eq": kappa,
        "latency": float(random.uniform(0, 0.8)),
        "mount yaw": yaw,
        "mount x": mount[0],
        "mount y": mount[1],
        "mount z": mount[2],
        "transmitter 1 north": north,
        "transmitter 1 east": east,
        "transmitter 1 down": down,
        "transmitter 1 yaw": heading,
        "transmitter 1 pitch": pitch,
    }
    receiver = ReceiverOptions(
        kappa_eq=kappa,
        sensitivity=q,
        noise=Noise("uniform", floor_m),
        mount=MountOptions((mount[0], mount[1], mount[2]), (0.0, 0.0, yaw)),
        model=model,
    )
    if model == "paper":
        truth |= {"floor_range_m": floor_m, "sensitivity y / x": weakest}
    scenario = replace(
        DEFAULT,
        transmitters=(Transmitter(id=1, ned=(north, east, down), attitude=(0.0, pitch, heading)),),
        receiver=receiver,
        navigation_error=NavigationError(walk_sigma_m=1.5, walk_tau_s=60.0),
        seed=seed,
    )
    return scenario, truth


def misses(estimates: Mapping[str, FittedValue], truth: Mapping[str, float]) -> dict[str, float]:
    """Return how far each truth is from the middle of its interval, in half widths, for identified parameters.

    A dipole with its axis reversed is the same: its pitch changes its sign with half a turn of its yaw.
    """
    true = dict(truth)
    for name in truth:
        if name.endswith("yaw") and name in estimates:
            half_turns = round((truth[name] - estimates[name].value) / 180)
            true[name] -= 180 * half_turns
            if half_turns % 2 and (pitch := name.removesuffix("yaw") + "pitch") in true:
                true[pitch] *= -1
    return {
        name: (true[name] - (one.low + one.high) / 2) / ((one.high - one.low) / 2)
        for name, one in estimates.items()
        if name in true and one.identified
    }
