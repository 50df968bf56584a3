"""What a search strategy is: observations (a reading and the pose it was heard at) in, velocity out.

Places are NED metres from the take-off point; times are seconds on one clock; velocities are NED, m/s.
"""

from __future__ import annotations

import math
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

Velocity = tuple[float, float]  # north, east; m/s
Position = tuple[float, float, float]  # NED, m

STILL: Velocity = (0.0, 0.0)


class Observation(NamedTuple):
    """What one frame says of the transmitter that is searched for, and where that was heard.

    `rotation`: matrix receiver FRD → NED, shape (3, 3). `d_cm`, `delta_deg`: the receiver's integers; d_cm ≤ 0 says
    that nothing was heard. `inner`: d_cm rests on all three antennas, and delta_deg is nothing.
    """

    time_s: float
    position: Position
    rotation: NDArray[np.float64]
    d_cm: int
    delta_deg: int
    inner: bool

    @property
    def heard(self) -> bool:
        """Whether the transmitter was heard."""
        return self.d_cm > 0

    @property
    def d_m(self) -> float:
        """d in metres; 0 or less where it was not heard."""
        return self.d_cm / 100

    @property
    def bearing(self) -> float:
        """Of the flux line at the receiver, from north, radians; it or its opposite leads to the transmitter."""
        heading = math.atan2(self.rotation[1, 0], self.rotation[0, 0])
        return heading + math.radians(self.delta_deg)


class Found(NamedTuple):
    """Where the transmitter is; None: not known. `covariance`: of north and east, m², (nn, ne, ee)."""

    north: float
    east: float
    down: float | None = None
    covariance: tuple[float, float, float] | None = None

    @property
    def sigma(self) -> float | None:
        """The largest standard deviation in any horizontal direction, m."""
        if self.covariance is None:
            return None
        nn, ne, ee = self.covariance
        return math.sqrt((nn + ee) / 2 + math.hypot((nn - ee) / 2, ne))


class Belief(NamedTuple):
    """What a strategy believes, for whoever watches. A strategy that tells it has a property `belief`.

    `hypotheses`: (north, east, share), the shares add up to 1. `covariance`: as in `Found`. `goal`: (north, east) of
    where it flies to.
    """

    hypotheses: tuple[tuple[float, float, float], ...] = ()
    covariance: tuple[float, float, float] | None = None
    goal: tuple[float, float] | None = None


class Strategy(Protocol):
    """Remembers what was heard of one transmitter. Made with the speed not to be exceeded [m/s]."""

    def __init__(self, speed: float) -> None: ...

    @property
    def found(self) -> Found | None:
        """Where the transmitter is; None while that is not known well enough to stop."""

    def hear(self, observation: Observation) -> None:
        """Take what one more frame says; in it the transmitter may not be heard."""

    def velocity(self, time_s: float, position: Position) -> Velocity:
        """Where to fly now: two finite numbers, STILL to stay. Asked for several times between frames.

        As everything that a strategy does, it has to take less than a second: nothing else is done meanwhile.
        """


def towards(position: Position, place: tuple[float, float], speed: float, *, gain: float = 1.0) -> Velocity:
    """The velocity to a place: `speed` far from it, `gain` [1/s] times what is left near it."""
    north, east = place[0] - position[0], place[1] - position[1]
    distance = math.hypot(north, east)
    share = min(gain, speed / distance) if distance > 0 else 0.0
    return north * share, east * share
