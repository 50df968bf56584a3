"""A search from the end of the take-off on: what to fly now, from frames and poses. No bytes, no links in here.

Before the first signal it flies strips; then it hands one transmitter, the nearest heard, to a strategy.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Collection, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from arva_hil.notice import Level, Notice
from arva_hil.search.strategy import STILL, Found, Observation, Position, Strategy, Velocity, towards
from arva_hil.search.strips import Strips
from firmware_proto import INNER, Channel, Frame

FOUND: Final = "found"  # how a search ends well
NO_ID: Final = -1  # stands for the id where frames carry none

_SILENT_S: Final = 2.0  # without a frame: the receiver is not working, hover
_NEARER: Final = 0.7  # another transmitter has to be that much nearer to be gone for instead
_DEAF_S: Final = 60.0  # the transmitter was not heard for so long: it is looked for in strips again
_REMEMBERED: Final = 256  # observations of each transmitter
_MOST_HEARD: Final = 16  # transmitters
_THERE_M: Final = 0.5  # from the place found
_AWAY_M: Final = 100.0  # from area and take-off point: no place for a search
_CLIMB_GAIN: Final = 1.0  # 1/s; k_z of the paper
_CLIMB_SPEED: Final = 1.0  # m/s


@dataclass(frozen=True)
class Plan:
    """What is wanted of a search. `area`: south, west, north, east of the take-off point, m; heights above it, m."""

    strategy: Callable[[float], Strategy]
    speed: float = 1.0  # m/s, horizontal, not exceeded
    height: float = 1.0  # held
    take_off: float = 2.0
    area: tuple[float, float, float, float] = (-50.0, -50.0, 50.0, 50.0)
    strip_width: float = 40.0
    patience_s: float = 10.0  # without frames, hovering, before it ends
    limit_s: float = 900.0  # from the end of the take-off


@dataclass
class Heard:
    """One transmitter as far as it is known."""

    nearest_m: float = math.inf
    nearest_at: tuple[float, float] = (0.0, 0.0)  # north, east: where the vehicle was
    last_m: float = math.inf
    last_s: float = -math.inf
    past: deque[Observation] = field(default_factory=lambda: deque(maxlen=_REMEMBERED))


class Mission:
    """Remembers what was heard and how the search stands. `ended` is "" until it is over, then says how; `broken`:
    not because all was done.

    Places are NED metres from the take-off point. `start_s`: the end of the take-off.
    """

    def __init__(self, plan: Plan, start_s: float, position: Position) -> None:
        self.plan = plan
        self.start_s = start_s
        self.ended = ""
        self.broken = False
        self.target: int | None = None  # the id or NO_ID; None before the first signal
        self.found: Found | None = None  # it ends above that place
        self.heard: dict[int, Heard] = {}
        self.position = position  # the last one flown by
        self.searched_s = 0.0
        self.path_m = 0.0
        self.frames = 0
        self._strips = Strips(plan.area, plan.speed, position, width=plan.strip_width)
        self._strategy: Strategy | None = None
        self._last_frame_s = start_s
        self._hovering = False
        self._notices: list[Notice] = []

    def hear(self, frame: Frame, time_s: float, position: Position, rotation: NDArray[np.float64]) -> None:
        """Take a frame, and the receiver's pose when it came: NED and the matrix receiver FRD → NED."""
        self.frames += 1
        self._last_frame_s = time_s
        if self._hovering:
            self._hovering = False
            self._say("info", "frames are back: the search goes on")
        channels = _nearest(frame)
        for id_, channel in channels.items():
            self._note(id_, Observation(time_s, position, rotation, channel.d, channel.delta, channel.zone == INNER))
        if not self.ended and self.found is None:
            with self._failing():
                self._choose(channels.keys(), time_s)
                self._observe(channels.keys(), Observation(time_s, position, rotation, -1, -1, False))

    def fly(self, time_s: float, position: Position) -> tuple[float, float, float]:
        """The velocity to fly now, NED, m/s."""
        if not self.ended:
            self.searched_s = time_s - self.start_s
        self.path_m += math.hypot(position[0] - self.position[0], position[1] - self.position[1])
        self.position = position
        north, east = self._bounded(self._horizontal(time_s, position))
        down = _CLIMB_GAIN * (-self.plan.height - position[2])
        return north, east, max(-_CLIMB_SPEED, min(_CLIMB_SPEED, down))

    def take_notices(self) -> list[Notice]:
        notices, self._notices = self._notices, []
        return notices

    @property
    def hunting(self) -> bool:
        """A transmitter is being followed; before and between, strips are flown."""
        return self._strategy is not None

    @property
    def others(self) -> dict[int, Heard]:
        """The transmitters heard and not found."""
        return {id_: heard for id_, heard in self.heard.items() if self.found is None or id_ != self.target}

    def _horizontal(self, time_s: float, position: Position) -> Velocity:
        if self.ended:
            return STILL
        if self._away(position):
            return self._end(f"it is more than {_AWAY_M:g} m outside the area", broken=True)
        if self.found is not None:
            return self._go_there(self.found, position)
        silent = time_s - self._last_frame_s
        if silent > self.plan.patience_s:
            return self._end(f"no frame from the receiver for {self.plan.patience_s:g} s", broken=True)
        if self.searched_s > self.plan.limit_s:
            return self._end(f"not found in {self.plan.limit_s:g} s")
        if silent > _SILENT_S:
            if not self._hovering:
                self._hovering = True
                self._say("warning", f"no frame for {_SILENT_S:g} s: hovering")
            return STILL
        if self._strategy is not None:
            with self._failing():
                return self._strategy.velocity(time_s, position)
            return STILL
        velocity = self._strips.velocity(time_s, position)
        if self._strips.exhausted:
            return self._end("no signal: all strips are flown")
        return velocity

    def _go_there(self, found: Found, position: Position) -> Velocity:
        """What lands, lands where the victim is."""
        place = (found.north, found.east)
        if math.dist(position[:2], place) < _THERE_M or self.searched_s > self.plan.limit_s:
            return self._end(FOUND)
        return towards(position, place, self.plan.speed)

    def _bounded(self, velocity: Velocity) -> Velocity:
        """Not faster than planned; what is no velocity is none."""
        speed = math.hypot(*velocity)
        if not math.isfinite(speed):
            return STILL
        share = min(1.0, self.plan.speed / speed) if speed > 0 else 0.0
        return velocity[0] * share, velocity[1] * share

    def _away(self, position: Position) -> bool:
        south, west, north, east = self.plan.area
        inside = min(south, 0) - _AWAY_M <= position[0] <= max(north, 0) + _AWAY_M
        return not (inside and min(west, 0) - _AWAY_M <= position[1] <= max(east, 0) + _AWAY_M)

    def _note(self, id_: int, observation: Observation) -> None:
        north, east, _ = observation.position
        if id_ not in self.heard:
            if len(self.heard) >= _MOST_HEARD:
                return
            self.heard[id_] = Heard()
            place = f"{north:z.1f} m north, {east:z.1f} m east of the take-off point"
            self._say("info", f"transmitter {_name(id_)} is heard, {observation.d_m:.1f} m away, at {place}")
        heard = self.heard[id_]
        heard.last_m, heard.last_s = observation.d_m, observation.time_s
        if heard.last_m < heard.nearest_m:
            heard.nearest_m, heard.nearest_at = heard.last_m, (north, east)
        heard.past.append(observation)

    def _choose(self, ids: Iterable[int], time_s: float) -> None:
        """Which transmitter to go for: the nearest, but not another one at each whim of the noise."""
        current = self.heard.get(self.target) if self.target is not None else None
        if current is not None and self._strategy is not None and time_s - current.last_s > _DEAF_S:
            self._strategy = None
            self._say("warning", f"transmitter {_name(self.target)} is not heard any more: back to the strips")
        heard = {id_: self.heard[id_] for id_ in ids if id_ in self.heard}
        if not heard:
            return
        nearest = min(heard, key=lambda id_: heard[id_].last_m)
        if current is None or self._strategy is None or heard[nearest].last_m < _NEARER * current.last_m:
            if nearest != self.target:
                self._say("info", f"going for transmitter {_name(nearest)}, {heard[nearest].last_m:.1f} m away")
            if nearest != self.target or self._strategy is None:
                self.target = nearest
                self._strategy = self.plan.strategy(self.plan.speed)
                for observation in list(heard[nearest].past)[:-1]:
                    self._strategy.hear(observation)

    def _observe(self, ids: Collection[int], nothing: Observation) -> None:
        """Tell the strategy what the frame says of its transmitter; `nothing`: what is said by one without it."""
        if self._strategy is None or self.target is None:
            return
        self._strategy.hear(self.heard[self.target].past[-1] if self.target in ids else nothing)
        if (found := _sound(self._strategy.found)) is not None:
            self.found = found

    @contextmanager
    def _failing(self) -> Iterator[None]:
        """Whatever a strategy does wrong, the vehicle has to come down."""
        try:
            yield
        except Exception as error:
            self._end(f"the strategy has failed: {error!r}", broken=True)

    def _end(self, how: str, *, broken: bool = False) -> Velocity:
        self.ended, self.broken = how, broken
        return STILL

    def _say(self, level: Level, text: str) -> None:
        self._notices.append(Notice(level, text))


def _sound(found: Found | None) -> Found | None:
    """Without what is no number or no variance."""
    if found is None or not math.isfinite(found.north + found.east):
        return None
    north, east, down, covariance = found
    if down is not None and not math.isfinite(down):
        down = None
    if covariance is not None and not (math.isfinite(sum(covariance)) and min(covariance[0], covariance[2]) >= 0):
        covariance = None
    return Found(north, east, down, covariance)


def _nearest(frame: Frame) -> dict[int, Channel]:
    """The channels that hear, one a transmitter: the nearest where an id, or none, comes more than once."""
    nearest: dict[int, Channel] = {}
    for channel in sorted(frame.channels, key=lambda channel: channel.d):
        if channel.valid:
            nearest.setdefault(NO_ID if channel.id is None else channel.id, channel)
    return nearest


def _name(id_: int | None) -> str:
    return "without a number" if id_ in (None, NO_ID) else str(id_)
