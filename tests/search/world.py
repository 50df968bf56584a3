"""A small world to search in: the project's own receiver on a point that follows velocities, and its frames."""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from arva_hil.config import parse
from arva_hil.emulator import build
from arva_hil.model.field import LocalFrame, rotation
from arva_hil.model.receiver import Look, Pose, Zone
from arva_hil.search.strategies.strategy import Found, Observation, Position, Strategy

LAG_S = 0.3  # of the point's velocity
STEP_S = 0.1
PAPER = [
    "{id: 1, enu: [20, 5, 0]}",
    "{id: 1, enu: [10, 0, 1]}",
    "{id: 1, enu: [20, -20, -1]}",
    "{id: 1, enu: [-6, 5, 0]}",
]


class Flight(NamedTuple):
    """What came of a search. `error_m`, horizontally, from the first transmitter; inf where nothing is found."""

    found: Found | None
    error_m: float
    time_s: float
    fastest: float  # velocity asked for, m/s
    heard: list[Observation]


def fly(
    strategy: Strategy,
    *transmitters: str,
    start: tuple[float, float] = (0.0, 0.0),
    height_m: float = 1.0,
    yaw: float = 0.0,
    rate_hz: float = 1.0,
    gps_m: float = 0.0,
    seed: int = 0,
    limit_s: float = 600.0,
    lag_s: float = LAG_S,
    fall: float = 0.0,
    wrong: Callable[[float], bool] = lambda _: False,
) -> Flight:
    """Search from `start`, NED, for the first of the transmitters, "{id: 1, enu: [20, 5, 0]}" as in a scenario file.

    `gps_m`: sigma on each axis of the position that the strategy is told. `lag_s`: of the point's velocity.
    `fall`: of the ground to the north, metres a metre; it flies `height_m` above it. `wrong`: whether the receiver then
    calls the last transmitter the first one.
    """
    world = parse(f"spec: 1\nseed: {seed}\ntransmitters: [{', '.join(transmitters)}]\n", "world")
    receiver, there = build.receiver(world), build.transmitters(world, LocalFrame(0.0, 0.0, 0.0))
    rng = random.Random(seed)
    R = rotation.to_matrix(rotation.from_euler(0.0, 0.0, yaw))
    place, velocity = np.array([*start, fall * start[0] - height_m]), np.zeros(2)
    steps = math.ceil(1 / rate_hz / STEP_S)
    dt = 1 / rate_hz / steps
    heard: list[Observation] = []
    fastest = now = 0.0
    while now < limit_s and strategy.found is None:
        receiver.look(Look(now, Pose(place, R), there))
        id_ = world.transmitters[-1 if wrong(now) else 0].id
        slot = next(c for c in receiver.show(now).channels if c.id in (id_, None))
        told = place + [rng.gauss(0, gps_m) for _ in place]
        heard.append(Observation(now, _tuple(told), R, slot.d_cm, slot.delta_deg, slot.zone == Zone.INNER))
        heard[-1] = heard[-1]._replace(ground=fall * float(place[0]) if fall else None)
        strategy.observe(heard[-1])
        for _ in range(steps):
            wanted = strategy.velocity(now, _tuple(told))
            fastest = max(fastest, math.hypot(*wanted))
            velocity += (np.array(wanted) - velocity) * min(1.0, dt / lag_s)
            place[:2] += velocity * dt
            place[2] = fall * place[0] - height_m
            told[:2] += velocity * dt
            now += dt
    found, target = strategy.found, there.positions[0]
    error = math.inf if found is None else math.hypot(found.north - target[0], found.east - target[1])
    return Flight(found, error, now, fastest, heard)


def buried(seed: int, strength: float = 1.0) -> tuple[str, tuple[float, float]]:
    """A transmitter at any attitude, and a start 28 m from it."""
    rng = np.random.default_rng(seed)
    roll, pitch, yaw = np.degrees(rotation.to_euler(rng.normal(size=4)))
    pose = f"enu: [0, 0, {-rng.uniform(0, 2)}], attitude: {{roll: {roll}, pitch: {pitch}, yaw: {yaw}}}"
    bearing = rng.uniform(0, 2 * math.pi)
    return f"{{id: 1, {pose}, strength: {strength}}}", (28 * math.cos(bearing), 28 * math.sin(bearing))


def fly_to_buried(number: int, strategy: Strategy, *others: str, strength: float = 1.0, **options: Any) -> Flight:
    """Search for a transmitter at any attitude, from 28 m away."""
    transmitter, start = buried(number, strength)
    return fly(strategy, transmitter, *others, start=start, **options)


def _tuple(place: NDArray[np.float64]) -> Position:
    north, east, down = place.tolist()
    return north, east, down
