"""A search from the end of the take-off on: velocities from frames and poses, without bytes or links.

Before the first signal it flies strips. Then a strategy flies to one transmitter, the nearest that is heard.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from arva_hil.events import Event
from arva_hil.events.searches import (
    DescentBegun,
    SearchPaused,
    SearchResumed,
    StrategySlow,
    TransmitterChosen,
    TransmitterFaded,
    TransmitterHeard,
)
from arva_hil.field.mount import Mount
from arva_hil.search.beliefs import Beliefs
from arva_hil.search.ground import Height
from arva_hil.search.heard import NO_ID, HeardTransmitter, id_of, nearest
from arva_hil.search.height import Descent, HeightKeeper
from arva_hil.search.reading_checks import StuckReadings
from arva_hil.search.strategy import STILL, Found, Observation, Position, Strategy, Velocity, towards
from arva_hil.search.strategy_checks import OFTEN, SLOW_S, checked_found, checked_velocity, failed, too_slow
from arva_hil.search.strips import Strips
from arva_hil.search.team import Teammate
from firmware_proto import INNER, Frame

FOUND: Final = "found"  # the outcome of a successful search
NOT_SURE: Final = "not sure: the readings do not agree with the place reported"

_SILENT_S: Final = 2.0  # without a frame: the receiver does not work, hover
_NEARER: Final = 0.7  # another transmitter is chosen only if it is nearer by this factor
_DEAF_S: Final = 60.0  # without a signal of the transmitter, before strips are flown again
_MOST_HEARD: Final = 16  # transmitters
_THERE_M: Final = 0.5  # from the place found
_APPROACH_M_S: Final = 1.0  # the highest speed in the descent
_AWAY_M: Final = 100.0  # from area and take-off point: a farther place ends the search


@dataclass(frozen=True)
class SearchPlan:
    """The settings of a search. `area`: south, west, north, east of the take-off point [m].

    `height`: above the ground [m], as far as it is known (`ground.py`); `take_off`: above the take-off point [m].
    `mount`: the place of the receiver on the vehicle.
    """

    strategy: Callable[[float], Strategy]
    speed: float = 1.0  # m/s, horizontal, not exceeded
    height: float = 3.0  # held
    take_off: float = 3.0
    area: tuple[float, float, float, float] = (-50.0, -50.0, 50.0, 50.0)
    strip_width: float = 40.0
    patience_s: float = 10.0  # without frames, hovering, before it ends
    limit_s: float = 900.0  # from the end of the take-off
    mount: Mount = field(default_factory=Mount)
    trust_gps: bool = False  # hold `height` also if only GPS measures it


class Mission:
    """Remembers the transmitters heard and the state of the search. `ended`: how it has ended, "" before; `broken`: it
    has ended early; `sure`: the readings agree with the place found.

    Places are NED metres from the take-off point. `start_s`: the end of the take-off. `land`: after the search it
    descends onto the place found, until `over`, when only the landing or hovering is left. `emit` gets the events.
    `team`: the other searches; a transmitter that is theirs is passed by.
    """

    def __init__(
        self,
        plan: SearchPlan,
        start_s: float,
        position: Position,
        *,
        land: bool = False,
        emit: Callable[[Event], None] = lambda _: None,
        team: Teammate | None = None,
    ) -> None:
        self.plan = plan
        self.start_s = start_s
        self.ended = ""
        self.broken = False
        self.target: int | None = None  # the id or NO_ID; None before the first signal
        self.found: Found | None = None  # the search ends above this place
        self.sure = True
        self.heard: dict[int, HeardTransmitter] = {}
        self.position = position  # the last one used
        self.searched_s = 0.0
        self.path_m = 0.0
        self.frames = 0
        self._strips = Strips(plan.area, plan.speed, position, width=plan.strip_width)
        self._strategy: Strategy | None = None
        self._slow = 0  # how often the strategy took too long,
        self.slow_s = 0.0  # and how long the last time
        self._last_frame_s = start_s
        self._hovering: Literal["no frame", "same readings"] | None = None  # why
        self._hovering_since = start_s
        self._standstill = StuckReadings()
        self._keeper = HeightKeeper(plan.height, emit)
        self._descent: Descent | None = None
        self._land = land
        self._emit = emit
        self._beliefs = Beliefs(emit)
        self._team = team

    def hear(self, frame: Frame, time_s: float, position: Position, rotation: NDArray[np.float64]) -> None:
        """Use a new frame and the receiver's pose at its arrival: position NED, and the matrix receiver FRD → NED."""
        self.frames += 1
        self._last_frame_s = time_s
        self._standstill.hear(frame, position, time_s)
        if self._standstill.old:
            return  # it repeats a reading from another place
        channels = nearest(frame)
        for id_, channel in channels.items():
            self._note(id_, Observation(time_s, position, rotation, channel.d, channel.delta, channel.zone == INNER))
        if not self.ended and self.found is None:
            with self._failing():
                self._choose(channels.keys(), time_s)
                self._observe(channels.keys(), Observation(time_s, position, rotation, -1, -1, False))
                self._beliefs.look(time_s, id_of(self.target), self._strategy)

    def fly(
        self, time_s: float, position: Position, *, receiver: Position | None = None, height: Height | None = None
    ) -> tuple[float, float, float]:
        """The velocity to fly now [m/s, NED].

        `position`: of the vehicle; `receiver`: of its receiver, if different; `height`: above the ground, if more is
        known than the position.
        """
        if not self.ended:
            self.searched_s = time_s - self.start_s
        self.path_m += math.hypot(position[0] - self.position[0], position[1] - self.position[1])
        self.position = position
        height = height or Height(-position[2], False)
        if self.ended and self.found is not None and self._land:
            return self._come_down(self.found, time_s, position, height)
        down = self._keeper.velocity(time_s, height)
        if self._keeper.failed and not self.ended:
            self._end(f"it does not get higher than {height.metres:.1f} m", broken=True)
        north, east = self._bounded(self._horizontal(time_s, position, receiver or position))
        return (0.0, 0.0, down) if self._keeper.too_low else (north, east, down)

    def took(self, seconds: float, time_s: float) -> None:
        """The strategy took this long to answer, until `time_s`. A pause of the computer looks the same."""
        if seconds <= SLOW_S or self._strategy is None or self.ended or self.found is not None:
            return
        self._slow += 1
        self.slow_s = seconds
        self._emit(StrategySlow(time_s, seconds))
        if self._slow >= OFTEN:
            self._end(too_slow(seconds), broken=True)

    @property
    def over(self) -> bool:
        """Whether the search has ended, and the descent too."""
        down = self._descent is not None and self._descent.done
        return bool(self.ended) and (self.found is None or not self._land or down)

    @property
    def hunting(self) -> bool:
        """Whether it flies to a transmitter; otherwise it flies strips."""
        return self._strategy is not None

    @property
    def others(self) -> dict[int, HeardTransmitter]:
        """The transmitters that were heard and not found."""
        return {id_: heard for id_, heard in self.heard.items() if self.found is None or id_ != self.target}

    def _come_down(self, found: Found, time_s: float, position: Position, height: Height) -> tuple[float, float, float]:
        if self._descent is None:
            speed = min(self.plan.speed, _APPROACH_M_S)
            self._descent = Descent((found.north, found.east), speed, time_s, height.metres)
            self._emit(DescentBegun(time_s))
        return self._descent.velocity(time_s, position, height)

    def _horizontal(self, time_s: float, position: Position, receiver: Position) -> Velocity:
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
        if self._waits(time_s, silent):
            return STILL
        if self._strategy is not None:
            with self._failing():
                return checked_velocity(self._strategy.velocity(time_s, receiver))
            return STILL
        velocity = self._strips.velocity(time_s, receiver)
        if self._strips.exhausted:
            return self._end("no signal: all strips are flown")
        return velocity

    def _waits(self, time_s: float, silent: float) -> bool:
        """Whether it hovers because the receiver does not work."""
        before, stuck = self._hovering, self._standstill.stuck
        why: Literal["no frame", "same readings"] | None
        self._hovering = why = "no frame" if silent > _SILENT_S else "same readings" if stuck else None
        if why and why != before:
            self._hovering_since = time_s
            self._emit(SearchPaused(time_s, why, _SILENT_S, round(self._standstill.moved_m, 1)))
        elif before and not why:
            self._emit(SearchResumed(time_s, before))
        if why == "same readings" and time_s - self._hovering_since > self.plan.patience_s:
            self._end("the receiver repeats the same reading: it is stuck", broken=True)
        return why is not None

    def _go_there(self, found: Found, position: Position) -> Velocity:
        """If it lands, it lands at the place found."""
        place = (found.north, found.east)
        if math.dist(position[:2], place) < _THERE_M or self.searched_s > self.plan.limit_s:
            return self._end(FOUND if self.sure else NOT_SURE)
        return towards(position, place, self.plan.speed)

    def _bounded(self, velocity: Velocity) -> Velocity:
        """The velocity, limited to the planned speed."""
        share = self.plan.speed / max(math.hypot(*velocity), self.plan.speed)
        return velocity[0] * share, velocity[1] * share

    def _away(self, position: Position) -> bool:
        south, west, north, east = self.plan.area
        inside = min(south, 0) - _AWAY_M <= position[0] <= max(north, 0) + _AWAY_M
        return not (inside and min(west, 0) - _AWAY_M <= position[1] <= max(east, 0) + _AWAY_M)

    def _note(self, id_: int, observation: Observation) -> None:
        if id_ not in self.heard:
            if len(self.heard) >= _MOST_HEARD:
                return
            self.heard[id_] = HeardTransmitter()
            self._emit(TransmitterHeard(observation.time_s, id_of(id_), observation.d_m, *observation.position[:2]))
        self.heard[id_].add(observation)

    def _choose(self, ids: Iterable[int], time_s: float) -> None:
        """Choose the nearest transmitter, with a margin so that noise does not change the choice."""
        if self.target is not None and self._strategy is not None and self._is_taken(self.target):
            self._strategy = self.target = None
        current = self.heard.get(self.target) if self.target is not None else None
        if current is not None and self._strategy is not None and time_s - current.last_s > _DEAF_S:
            self._strategy = None
            self._emit(TransmitterFaded(time_s, id_of(self.target)))
        heard = {id_: self.heard[id_] for id_ in ids if id_ in self.heard and not self._is_taken(id_)}
        if not heard:
            return
        closest = min(heard, key=lambda id_: heard[id_].last_m)
        if current is None or self._strategy is None or heard[closest].last_m < _NEARER * current.last_m:
            if closest != self.target:
                self._emit(TransmitterChosen(time_s, id_of(closest), heard[closest].last_m))
            if closest != self.target or self._strategy is None:
                self.target = closest
                self._strategy = self.plan.strategy(self.plan.speed)
                for observation in list(heard[closest].past)[:-1]:
                    self._strategy.hear(observation)

    def _is_taken(self, id_: int) -> bool:
        """Whether a transmitter is another search's. Without ids nobody knows."""
        own = id_ == self.target and self._strategy is not None
        return self._team is not None and id_ != NO_ID and self._team.taken(id_, own=own)

    def _observe(self, ids: Collection[int], nothing: Observation) -> None:
        """Give the strategy the reading of its transmitter in a frame; `nothing`: for a frame without it."""
        if self._strategy is None or self.target is None:
            return
        self._strategy.hear(self.heard[self.target].past[-1] if self.target in ids else nothing)
        if (found := checked_found(self._strategy.found)) is not None:
            self.found = found
            self.sure = self._agrees(self.heard[self.target], found)
            self._beliefs.found(nothing.time_s, id_of(self.target), found, self.sure)

    def _agrees(self, heard: HeardTransmitter, found: Found) -> bool:
        """Whether the readings agree with the place found, with any strategy."""
        judgement = heard.evidence.judge((found.north, found.east))
        return judgement is not None and judgement.agrees(self._keeper.wanted)

    @contextmanager
    def _failing(self) -> Iterator[None]:
        """End the search if a strategy fails, so that the vehicle lands."""
        try:
            yield
        except (Exception, SystemExit) as error:
            self._end(failed(error), broken=True)

    def _end(self, how: str, *, broken: bool = False) -> Velocity:
        self.ended, self.broken = how, broken
        return STILL
