"""The protocol of a search strategy: observations (a reading and its pose) in, velocities out.

Places are NED metres from the take-off point; times are seconds on one clock; velocities are NED, m/s.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

FARTHEST_M: Final = 1e8  # no place on Earth is as far away

Velocity = tuple[float, float]  # north, east; m/s
Position = tuple[float, float, float]  # NED, m
Covariance = tuple[float, float, float]  # of north and east, m²: nn, ne, ee

STILL: Velocity = (0.0, 0.0)


class Observation(NamedTuple):
    """The reading of the transmitter that is searched for in one frame, and the receiver's pose.

    - `rotation`: matrix receiver FRD → NED, shape (3, 3).
    - `d_cm`, `delta_deg`: the receiver's integers; d_cm ≤ 0 means no signal.
    - `inner`: the inner zone, where d_cm is from all three antennas and delta_deg is not valid.
    - `ground`: down from the take-off point [m]; None if it is not known.
    - `signal`: signed signals of the three antennas, in any unit, if the receiver sends them. `age_s`: their age.
    """

    time_s: float
    position: Position
    rotation: NDArray[np.float64]
    d_cm: int
    delta_deg: int
    inner: bool
    ground: float | None = None
    signal: tuple[float, float, float] | None = None
    age_s: float = 0.0

    @property
    def heard(self) -> bool:
        """True if the transmitter was received."""
        return self.d_cm > 0

    @property
    def finite(self) -> bool:
        """True if the pose is made of finite numbers, and its place is on Earth."""
        north, east, down = map(abs, self.position)
        on_earth = north < FARTHEST_M and east < FARTHEST_M and down < FARTHEST_M  # false for NaN
        return on_earth and all(map(math.isfinite, self.rotation.flat))

    @property
    def d_m(self) -> float:
        """Distance d in metres; 0 or less without a signal."""
        return self.d_cm / 100

    @property
    def measurements(self) -> list[tuple[float, float, bool]]:
        """Measurements of the field: d [m], δ [rad], and True if d is of all three antennas. Signals give both d."""
        x, y, z = self.signal or (0.0, 0.0, 0.0)
        level, full = math.hypot(x, y), math.hypot(x, y, z)
        if not (self.heard and level and z):
            return [(self.d_m, math.radians(self.delta_deg), self.inner)]
        unit = self.d_m * math.cbrt(full if self.inner else level)
        return [(unit / math.cbrt(level), math.atan2(y, x), False), (unit / math.cbrt(full), 0.0, True)]

    @property
    def bearing(self) -> float:
        """The bearing of the flux line [rad from north]. It or its opposite leads to the transmitter."""
        heading = math.atan2(self.rotation[1, 0], self.rotation[0, 0])
        return heading + math.radians(self.delta_deg)


def sigma_of(covariance: Covariance | None) -> float | None:
    """Return the largest standard deviation of all horizontal directions [m], for (nn, ne, ee) [m²]."""
    if covariance is None:
        return None
    nn, ne, ee = covariance
    return math.sqrt((nn + ee) / 2 + math.hypot((nn - ee) / 2, ne))


class Found(NamedTuple):
    """The place of a transmitter from the take-off point [m]. `covariance`: of north and east [m²], (nn, ne, ee).

    `now`: where it is in the places that are reported now, if those drift: north, east. The vehicle flies there.
    `now_covariance`: of the goal in the places reported now, so of the place relative to the drone; None: `covariance`.
    A place with a larger sigma there than 0.4 m is not sure.
    `turned_deg`: the receiver is turned by this angle from its reported heading, clockwise; None: not far from 0.
    """

    north: float
    east: float
    down: float | None = None
    covariance: Covariance | None = None
    now: tuple[float, float] | None = None
    now_covariance: Covariance | None = None
    turned_deg: float | None = None

    @property
    def goal(self) -> tuple[float, float]:
        """The point to fly to, above the transmitter."""
        return self.now or (self.north, self.east)

    @property
    def sigma(self) -> float | None:
        """The largest standard deviation of all horizontal directions [m]."""
        return sigma_of(self.covariance)


class Belief(NamedTuple):
    """The present estimate of a strategy, for observers. A strategy may have a property `belief`.

    `hypotheses`: (north, east, share), with shares that add up to 1. `covariance`: as in `Found`. `goal`: north and
    east of the place to which it flies.
    """

    hypotheses: tuple[tuple[float, float, float], ...] = ()
    covariance: Covariance | None = None
    goal: tuple[float, float] | None = None


class Strategy(Protocol):
    """A search for one transmitter. It is created with the highest speed [m/s].

    Positions are north, east, down [m] from the take-off point; velocities are north, east [m/s].
    """

    def __init__(self, speed: float) -> None: ...

    @property
    def found(self) -> Found | None:
        """Place of the transmitter; None while it is not known well enough to stop."""

    def observe(self, observation: Observation) -> None:
        """Use the reading of one more frame, which may be without a signal."""

    def velocity(self, time_s: float, position: Position) -> Velocity:
        """Return the velocity to fly now: two finite numbers, STILL to hover. Called several times between frames.

        While a strategy computes, the vehicle flies the last velocity; after 1 s it hovers, after 10 s it lands.
        """


def as_position(place: NDArray[np.float64]) -> Position:
    """Return a place as numbers of Python."""
    north, east, down = place.tolist()
    return north, east, down


def towards(position: Position, place: tuple[float, float], speed: float, *, gain: float = 1.0) -> Velocity:
    """Return the velocity to a place: `speed` far from it, `gain` [1/s] times the distance near it."""
    north, east = place[0] - position[0], place[1] - position[1]
    distance = math.hypot(north, east)
    share = min(gain, speed / distance) if distance > 0 else 0.0
    return north * share, east * share
