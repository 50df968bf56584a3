"""A search from the end of the take-off on: velocities from frames and poses, without bytes or links.

Before the first signal it flies strips. Then a strategy flies to one transmitter, the nearest one. If more
than one is searched for, each place is recorded and marked, and the search goes on at the same height.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Final

import numpy as np
from numpy.typing import NDArray

from arva_hil.events import Event
from arva_hil.events.reasons import Reason, Why, because
from arva_hil.events.searches import BeliefChanged, DescentBegun, PlaceFound, ReceiverTurned, TransmitterMoves
from arva_hil.search.mission.accuracy import UNKNOWN
from arva_hil.search.mission.choice import (
    AGREES,
    LISTEN,
    LONG_S,
    LOOK_AGAIN,
    NO_ID,
    Choice,
    Guidance,
    HeardTransmitter,
    LastLook,
    Pauses,
    hidden,
    id_of,
    observations,
    pulses,
)
from arva_hil.search.mission.ground import Descent, Height, HeightKeeper
from arva_hil.search.mission.victims import ReceiverHost, Victim, Victims
from arva_hil.search.strategies.analysis import AnalysisResult, Inline, Worker
from arva_hil.search.strategies.history import speed_of
from arva_hil.search.strategies.plan import SearchPlan
from arva_hil.search.strategies.strategy import STILL, Belief, Found, Observation, Position, Velocity, towards
from arva_hil.search.team.team import Teammate, TeamStrips, strips_of
from firmware_proto import Frame

_AT_GOAL: Final = Why.FOUND, Why.NOT_SURE
_COMPLETE: Final = *_AT_GOAL, Why.TIME_UP, Why.STRIPS_FLOWN  # all other ends are early
_FAR_M: Final = 100.0  # from area and take-off point: a farther place ends the search
_THERE_M: Final = 0.5  # from the place found
_ASIDE_M: Final = 2.0  # the same if a descent follows, which flies the rest
_BELIEF_S: Final = 0.5  # between estimates that are reported


class Progress:
    """The time, the path and the frames of a search, and the newest position of the vehicle.

    `left_at`: where it left the strips for a transmitter.
    """

    def __init__(self, start_s: float, position: Position) -> None:
        self.searched_s = self.found_s = 0.0  # until the newest place was found
        self.path_m = 0.0  # horizontally
        self.frames = 0
        self._start_s = start_s
        self.position = self.left_at = position

    def move(self, time_s: float, position: Position, *, searching: bool) -> None:
        """Note the place of the vehicle. `searching`: the time counts."""
        if searching:
            self.searched_s = time_s - self._start_s
        self.path_m += math.dist(position[:2], self.position[:2])
        self.position = position

    def find(self, time_s: float) -> None:
        """Note the time at which a place was found."""
        self.found_s = time_s - self._start_s


class PlaceReports:
    """Emits the events about places. `accuracy`: of the vehicle's position on Earth, set from outside."""

    def __init__(self, emit: Callable[[Event], None]) -> None:
        self.emit = emit
        self.accuracy = UNKNOWN
        self._belief_s = -math.inf  # when an estimate may be reported next

    def report_found(self, time_s: float, id_: int | None, found: Found, *, sure: bool) -> None:
        """Report a place found."""
        spread = self.accuracy.relative(found), self.accuracy.on_earth(found), self.accuracy.reported_m
        self.emit(PlaceFound(time_s, id_, found.north, found.east, found.covariance, sure, *spread, found.down))
        if found.turned_deg is not None:
            self.emit(ReceiverTurned(time_s, id_, found.turned_deg))

    def report_belief(self, time_s: float, id_: int | None, belief: Belief) -> None:
        """Report an estimate, twice a second at most."""
        if time_s >= self._belief_s:
            self._belief_s = time_s + _BELIEF_S
            self.emit(BeliefChanged(time_s, id_, *belief))


class Mission:
    """The received transmitters and the state of the search.

    - `ended`: the reason of its end, None before.
    - `victims`: the places of several transmitters.
    - `progress`: since the end of the take-off, at `start_s`.
    - `over`: after the search it descends onto the place found, if it shall land; then only landing is left.
    - `choice`: the transmitters received, and the one that it flies to.
    - `reports`: the events about places, with the accuracy of the vehicle's position. `emit`: gets the events.
    - `team`: the other searches; transmitters of theirs are passed by.
    - `host`: commands to the receiver.
    - `worker`: computes; None: in this loop.

    Places are NED metres from the take-off point.
    """

    def __init__(
        self,
        plan: SearchPlan,
        start_s: float,
        position: Position,
        *,
        emit: Callable[[Event], None] = lambda _: None,
        team: Teammate | None = None,
        host: ReceiverHost | None = None,
        worker: Worker | None = None,
    ) -> None:
        self.plan = plan
        self.ended: Reason | None = None
        self._reached: AnalysisResult | None = None  # it flies above its place, to end there or to record it
        self.reports = PlaceReports(emit)
        self.progress = Progress(start_s, position)
        self._strips = strips_of(team, plan, position)
        self._pauses = Pauses(start_s, plan.patience_s, emit)
        self.victims = Victims(plan.victims, host, emit)
        worker = worker or Inline(partial(plan.strategy, plan.speed))
        guidance = Guidance(worker, emit, plan.patience_s)
        self.choice = Choice(guidance, self._passes, emit, LONG_S if team else math.inf)
        self._last_look = LastLook(self.choice, emit)
        self._keeper = HeightKeeper(plan.height, emit)
        self._team = team

    def on_frame(self, frame: Frame, time_s: float, position: Position, rotation: NDArray[np.float64]) -> None:
        """Use a new frame and the receiver's pose at its arrival: position NED, and the matrix receiver FRD → NED."""
        self.progress.frames += 1
        received = pulses(frame)
        if not self._pauses.on_frame([channel for channel, _ in received], position, time_s):
            return
        every, heard = observations(received, time_s, position, rotation, self._keeper.ground), []
        repeats, guidance = self._pauses.readings.repeats, self.choice.guidance
        for id_, o in every.items():
            if not repeats(id_) and (id_ != NO_ID or not self.victims.explain(o)):
                heard.append(id_)
                self.choice.add(id_, o)
        if self.victims.several:
            self.victims.on_frame(frame, time_s)
        if not self.ended and not self._reached:
            masked = self._shares and hidden(frame, self.choice.target)
            hunted = self.choice.hunting
            self.choice.choose(heard, time_s, masked=masked)
            if self.choice.hunting and not hunted:
                self.progress.left_at = position
            elif hunted and not self.choice.hunting:
                self._strips.resume(self.progress.left_at)
            target = self.choice.target
            if self.choice.hunting and target in heard:
                guidance.observe(every[target], self._keeper.wanted)
            elif self.choice.hunting and target is not None and not masked and not repeats(target):
                guidance.observe(Observation(time_s, position, rotation, -1, -1, False), self._keeper.wanted)
        self._use(guidance.exchange(time_s), time_s, position)

    def fly(
        self, time_s: float, position: Position, *, receiver: Position | None = None, height: Height | None = None
    ) -> tuple[float, float, float]:
        """Return the velocity to fly now [m/s, NED].

        `position`: of the vehicle; `receiver`: of its receiver, if different; `height`: above the ground, if more is
        known than the position.
        """
        self.progress.move(time_s, position, searching=not self.ended)
        if self.victims.several:
            self.victims.serve(time_s)
        height = height or Height(-position[2], False)
        if (height.landed or height.doubt) and not self.ended:
            landed = because(Why.ON_THE_GROUND) if height.landed else None
            self._end(landed or height.doubt)
        if self.ended and self._lands:
            return self._come_down(time_s, position, height)
        if self._team:
            self._keeper.asked = self._team.height(self.plan.height, height.metres - height.margin, position)
        down = self._keeper.velocity(time_s, height)
        if self._keeper.failed and not self.ended:
            self._end(because(Why.TOO_LOW, metres=height.metres))
        north, east = self._horizontal(time_s, position, receiver or position)
        share = self._keeper.pace * self.plan.speed / max(math.hypot(north, east), self.plan.speed)
        return north * share, east * share, down

    def confirm(self, time_s: float) -> None:
        """Compare the newest readings, from near the ground: the transmitter may have moved in the meantime."""
        if self.found_surely and self.found and self._last_look.check(self.found, time_s, last=True) != AGREES:
            self._judge(sure=False)
            self.victims.retract()
            self.ended = because(Why.NOT_SURE)

    @property
    def found(self) -> Found | None:
        """The place above which it flies, to end there or to record it."""
        return self._reached.found if self._reached else None

    @property
    def sure(self) -> bool:
        """True if the place found is sure, or all that are recorded are."""
        return self._reached.sure if self._reached else all(victim.sure for victim in self.victims.places)

    @property
    def broken(self) -> bool:
        """True if it has ended early."""
        return self.ended is not None and self.ended.why not in _COMPLETE

    @property
    def over(self) -> bool:
        """True if the search has ended, and the descent too."""
        descent = self._keeper.descent
        return self.ended is not None and (not self._lands or (descent is not None and descent.done))

    @property
    def at_goal(self) -> bool:
        """True if the search has ended because everything was found."""
        return self.ended is not None and self.ended.why in _AT_GOAL

    @property
    def found_surely(self) -> bool:
        """True if the search has ended above a place, and the readings agree with all places."""
        return self.found is not None and self.ended == because(Why.FOUND)

    @property
    def blocked(self) -> bool:
        """True if the vehicle cannot land, because another vehicle of the team stays below."""
        return self._keeper.descent is not None and self._keeper.descent.blocked

    @property
    def pace(self) -> float:
        """The share of the speed that the height allows for a horizontal velocity."""
        return self._keeper.pace if self._keeper.descent is None else 1.0

    @property
    def _shares(self) -> bool:
        """True if more than one transmitter is expected."""
        return self._team is not None or self.victims.several

    @property
    def _lands(self) -> bool:
        # by set-points: onto a place found, and in a team anywhere, for others may be below
        return self.plan.land and (self.found is not None or self._team is not None)

    @property
    def others(self) -> dict[int, HeardTransmitter]:
        """The transmitters received and not found; without those that move."""
        heard, target = self.choice.heard, self.choice.target
        heard = {id_: one for id_, one in heard.items() if id_ not in self.victims.aside.moving}
        if self.victims.several:
            return {id_: one for id_, one in heard.items() if id_ not in self.victims.known}
        return {id_: one for id_, one in heard.items() if self.found is None or id_ != target}

    def _come_down(self, time_s: float, position: Position, height: Height) -> tuple[float, float, float]:
        if (descent := self._keeper.descent) is None:
            place = self.found.goal if self.found else position[:2]
            descent = Descent(place, self.plan.speed, time_s, height.metres, self._team)
            self._keeper.descent = descent
            if self.found:
                self.reports.emit(DescentBegun(time_s))
        if self.found:
            self.choice.guidance.contradictions(time_s)  # the newest ones at the end of the descent
        velocity = descent.velocity(time_s, position, height)
        if descent.done:
            self.confirm(time_s)
        return velocity

    def _horizontal(self, time_s: float, position: Position, receiver: Position) -> Velocity:
        if self.ended:
            return STILL
        self._use(self.choice.guidance.exchange(time_s), time_s, position)
        if self.ended:
            return STILL
        if self._is_far(position):
            return self._end(because(Why.TOO_FAR, metres=_FAR_M))
        if silent := self.choice.guidance.silent(time_s):
            return self._end(because(Why.STRATEGY_FAILED, text=silent))
        if self._reached and self._reached.found:
            return self._go_there(self._reached.found, time_s, position)
        if no_frame := self._pauses.silent(time_s):
            return self._end(no_frame)
        if self.progress.searched_s > self.plan.limit_s:
            return self._end(self.victims.not_all(Why.TIME_UP, len(self.others), limit_s=self.plan.limit_s))
        if self._pauses.waits(time_s):
            if stuck := self._pauses.stuck(time_s):
                self._end(stuck)
            return STILL
        if self.choice.hunting:
            if self.victims.several and self.victims.aside.put(self.choice, self.others, time_s):
                return self._go_on(position)
            self._use(self.choice.guidance.steer(time_s, receiver), time_s, position)
            return STILL if self.ended else self.choice.guidance.velocity(time_s)
        if self.victims.several and (place := self.victims.aside.heard_at(self.others, receiver)):
            return towards(receiver, place, self.plan.speed)
        velocity = self._strips.velocity(time_s, receiver)
        if not self._strips.exhausted:
            return velocity
        if not self._strips.twice and self.victims.aside.back() | self.choice.forgive():
            return self._strips.again()
        if self.victims.wanted or not self.victims.places or self.others:
            how = {
                "heard": bool(self.choice.heard),
                "twice": self._strips.twice,
                "team": isinstance(self._strips, TeamStrips),
            }
            return self._end(self.victims.not_all(Why.STRIPS_FLOWN, len(self.others), **how))
        return self._end_at_goal()

    def _is_far(self, position: Position) -> bool:
        """Return True if a place is too far from the area and the take-off point."""
        south, west, north, east = self.plan.area
        inside = min(south, 0) - _FAR_M <= position[0] <= max(north, 0) + _FAR_M
        return not (inside and min(west, 0) - _FAR_M <= position[1] <= max(east, 0) + _FAR_M)

    def _go_there(self, found: Found, time_s: float, position: Position) -> Velocity:
        place, late = found.goal, self.progress.searched_s > self.plan.limit_s
        barred = self._team is not None and self._team.bars(place, position)
        near_m = _ASIDE_M if self._lands else _THERE_M
        if not (late or barred) and math.dist(position[:2], place) >= near_m:
            return towards(position, place, self.plan.speed)
        if self.sure and not self.victims.unreported:
            verdict = self._last_look.check(found, time_s, last=late)
            if verdict in (LOOK_AGAIN, LISTEN):
                return self._go_on(position) if verdict == LOOK_AGAIN else STILL
            self._judge(sure=verdict == AGREES)
        if not self.victims.several:
            return self._end_at_goal()
        return self._add_victim(found, time_s, position, late=late)

    def _add_victim(self, found: Found, time_s: float, position: Position, *, late: bool) -> Velocity:
        """Record the place, wait for the receiver to mark it, and go on to the next."""
        victims, target = self.victims, self.choice.target
        assert target is not None
        if not victims.unreported:
            self._strips.twice = False
            dipole = self._reached.dipole if self._reached else None
            victims.add(Victim(target, found, self.sure, self.progress.found_s), dipole, time_s)
        if victims.settling and not late:
            return STILL
        if target == NO_ID:
            self.choice.forget(target)
        victims.report(self.choice.heard, time_s)
        self._judge(sure=all(victim.sure for victim in victims.places))
        if victims.enough:
            return self._end_at_goal()
        return self._go_on(position)

    def _go_on(self, position: Position) -> Velocity:
        """Go on to the next transmitter, or back to the strips. Returns the velocity."""
        self._reached = None
        self.choice.leave()
        self._strips.resume(position)
        return STILL

    def _passes(self, id_: int, own: bool) -> bool:
        """Return True if a transmitter is another search's, or found. Without ids that is unknown."""
        if id_ == NO_ID:
            return False
        if id_ in self.victims.known or self.victims.aside.passes(id_):
            return True
        return self._team is not None and self._team.taken(id_, own=own, metres=self.choice.heard[id_].nearest_m)

    def _use(self, answer: AnalysisResult | None, time_s: float, position: Position) -> None:
        """Use an answer of the strategy, unless it comes too late."""
        if answer is None or self.ended:
            return
        if answer.failed:
            self._end(because(Why.STRATEGY_FAILED, text=answer.failed))
            return
        if (target := self.choice.target) is None or self._reached:
            return
        if answer.track and target != NO_ID:
            self.victims.aside.put_moving(target, answer.track)
            _, north, east = answer.track[-1]
            self.reports.emit(TransmitterMoves(time_s, target, speed_of(answer.track), north, east))
            self._go_on(position)
            return
        if answer.found is not None and not self.choice.hardly:
            if self._shares and self._repeated(target, answer.found, answer.sure, time_s, position):
                return
            self._reached = answer
            self.progress.find(time_s)
            self.victims.aside.moving.pop(target, None)
            self.reports.report_found(time_s, id_of(target), answer.found, sure=self.sure)
        if answer.belief is not None:
            self.reports.report_belief(time_s, id_of(target), answer.belief)

    def _repeated(self, target: int, found: Found, sure: bool, time_s: float, position: Position) -> bool:
        """Return True if a place is found already, or is to be searched again."""
        again = self.victims.same(target, found, sure, time_s)
        if not again and (sure or not self.victims.doubt(target, found, time_s)):
            return False
        self.choice.forget(target)
        self._go_on(position)
        return True

    def _judge(self, *, sure: bool) -> None:
        if self._reached:
            self._reached = self._reached._replace(sure=sure)

    def _end_at_goal(self) -> Velocity:
        return self._end(because(Why.FOUND if self.sure else Why.NOT_SURE))

    def _end(self, how: Reason | None) -> Velocity:
        self.ended = how
        return STILL
