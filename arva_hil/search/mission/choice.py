"""The transmitters received: checks of their readings, the choice of one, orders to its strategy, the last check."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from arva_hil.events import Event
from arva_hil.events.reasons import Reason, Why, because
from arva_hil.events.searches import (
    PauseReason,
    PlaceDoubted,
    SearchPaused,
    SearchResumed,
    StrategySlow,
    TransmitterChosen,
    TransmitterFaded,
    TransmitterHeard,
    TransmitterLeft,
)
from arva_hil.search.strategies.analysis import Analysis, AnalysisResult, Order, Worker, silent
from arva_hil.search.strategies.history import Track
from arva_hil.search.strategies.strategy import STILL, Found, Observation, Position, Velocity
from arva_hil.search.team.team import THERE_M
from firmware_proto import INNER, MORE_TRANSMITTERS, OVERLAP, Channel, Frame, LevelChannel, VectorChannel

NO_ID: Final = -1  # in place of an id, if the frames have none

SILENT_S: Final = 2.0  # without a frame: the receiver does not work, hover
_SAME_FRAMES: Final = 3  # at least
_OLD_M: Final = 0.5  # a slow receiver may repeat a reading for this distance
_OLD: Final = 0.1  # or this share of d, because far from a transmitter a reading changes little
_OLDEST_M: Final = 1.5  # but at most for this distance
_BOTH_SIDES_M: Final = 2.5  # a reading without a direction: d is the same on both sides of a transmitter
_STUCK_M: Final = 3.0
_STUCK_S: Final = 5.0  # because a search hovers where it expects the transmitter


class StuckReadings:
    """Remembers the `whole` frame's present reading, and that of each transmitter in it."""

    def __init__(self) -> None:
        self.whole = SameReading((), (0.0, 0.0, 0.0))
        self._each: dict[int, SameReading] = {}

    def repeats(self, id_: int) -> bool:
        """Return True if the reading of this transmitter is of another place."""
        return id_ in self._each and self._each[id_].old

    def observe(self, heard: Sequence[Channel], position: Position, time_s: float) -> None:
        """Use the channels of a new frame that have a signal, and the receiver's place."""
        self.whole, before, self._each = self.whole.after(tuple(heard), position, time_s), self._each, {}
        for id_ in {channel.id for channel in heard}:
            channels = tuple([channel for channel in heard if channel.id == id_])
            key = NO_ID if id_ is None else id_
            same = before.get(key) or SameReading(channels, position)
            self._each[key] = same.after(channels, position, time_s)


class SameReading:
    """Remembers a reading, where and when it began, and how far away it came again.

    `old`: too far away to be of this place. `stuck`: too far for an equal reading, or repeated for too long.
    `moved_m`: the largest distance from where it began.
    """

    def __init__(self, channels: tuple[Channel, ...], at: Position) -> None:
        self.channels = channels
        self.old = self.stuck = False
        self.moved_m = 0.0
        self._at = at
        if any(c.zone != INNER for c in channels):
            self._old_m = min(max(_OLD_M, _OLD * min(c.d for c in channels) / 100), _OLDEST_M)
        else:
            self._old_m = _BOTH_SIDES_M
        self._old_since = math.inf
        self._frames = 0

    def after(self, channels: tuple[Channel, ...], position: Position, time_s: float) -> SameReading:
        """Return this object if these channels are the same, otherwise a new one."""
        same = self if channels == self.channels else SameReading(channels, position)
        if channels:
            same._frames += 1
            same.moved_m = max(same.moved_m, math.dist(position, same._at))
            same.old = same.moved_m > same._old_m
            same._old_since = min(same._old_since, time_s) if same.old else math.inf
            long = same.moved_m > _STUCK_M or time_s - same._old_since > _STUCK_S
            same.stuck = same.stuck or (long and same._frames >= _SAME_FRAMES)
        return same


class Pauses:
    """Remembers the last frame, and why the vehicle hovers. `readings`: those that do not change.

    `patience_s`: it hovers no longer than that. `emit` gets the events.
    """

    def __init__(self, start_s: float, patience_s: float, emit: Callable[[Event], None]) -> None:
        self._patience_s = patience_s
        self._last_frame_s = self._since_s = start_s
        self._why: PauseReason | None = None
        self.readings = StuckReadings()
        self._emit = emit

    def on_frame(self, heard: Sequence[Channel], position: Position, time_s: float) -> bool:
        """Check the channels with a signal of a new frame. Returns False if it repeats a reading from another place."""
        self._last_frame_s = time_s
        self.readings.observe(heard, position, time_s)
        return not self.readings.whole.old

    def silent(self, time_s: float) -> Reason | None:
        """Return the end of the search if no frame came for too long."""
        too_long = time_s - self._last_frame_s > self._patience_s
        return because(Why.NO_FRAME, seconds=self._patience_s) if too_long else None

    def waits(self, time_s: float) -> bool:
        """Return True if the search hovers because the receiver does not work."""
        before, stuck = self._why, self.readings.whole.stuck
        silent = time_s - self._last_frame_s > SILENT_S
        why: PauseReason | None = "same readings" if stuck else None
        self._why = why = "no frame" if silent else why
        if why and why != before:
            self._since_s = time_s
            self._emit(SearchPaused(time_s, why, SILENT_S, round(self.readings.whole.moved_m, 1)))
        elif before and not why:
            self._emit(SearchResumed(time_s, before))
        return why is not None

    def stuck(self, time_s: float) -> Reason | None:
        """Return the end of the search if the same reading came for too long."""
        too_long = self._why == "same readings" and time_s - self._since_s > self._patience_s
        return because(Why.SAME_READING) if too_long else None


_HELD_S: Final = 1.0  # fly a velocity for this long without a new one
_MOST_ORDERS: Final = 256  # in a batch: a pipe accepts these without waiting


class Guidance:
    """Remembers the waiting orders, the newest answer, and the age of the velocity that is flown.

    `number`: of the present strategy. `patience_s`: the longest time for one answer. Times are of the mission's clock,
    which does not run while the computer pauses.
    """

    def __init__(self, worker: Worker, emit: Callable[[Event], None], patience_s: float) -> None:
        self.number = 0
        self._worker = worker
        self._emit = emit
        self._patience_s = patience_s
        self._orders: list[Order] = []
        self._question: Order | None = None  # the newest question, sent after the orders
        self._sent_s: float | None = None  # when the unanswered batch was sent
        self._starved_s = 0.0  # the worker's, before that batch
        self._warn_s = _HELD_S  # report an answer that takes longer
        self._velocity, self._velocity_s = STILL, -math.inf
        self._contradictions: tuple[bool, ...] | None = None

    def add(self, id_: int, o: Observation) -> None:
        """Add a reading of a transmitter."""
        self._orders.append((Analysis.add, id_, o))

    def forget(self, id_: int) -> None:
        """Forget the readings of a transmitter."""
        self._orders.append((Analysis.forget, id_))

    def begin(self, id_: int, *, has_id: bool) -> None:
        """Begin a new strategy, for a transmitter."""
        self.leave()
        self._orders.append((Analysis.begin, self.number, id_, has_id))

    def leave(self) -> None:
        """Use no more answers of the present strategy."""
        self.number += 1
        self._velocity, self._contradictions, self._question = STILL, None, None

    def observe(self, o: Observation, height_m: float) -> None:
        """Give the strategy a reading. `height_m`: the height wanted."""
        self._contradictions = None
        self._orders.append((Analysis.observe, o, height_m))

    def steer(self, time_s: float, position: Position) -> AnalysisResult | None:
        """Ask the strategy for a velocity. Returns the result of `exchange`."""
        self._question = Analysis.steer, time_s, position
        return self.exchange(time_s)

    def velocity(self, time_s: float) -> Velocity:
        """Return the last velocity of the strategy for 1 s, then hover."""
        return self._velocity if time_s - self._velocity_s <= _HELD_S else STILL

    def contradictions(self, time_s: float) -> tuple[bool, ...] | None:
        """Return which of the newest readings contradict the place found, None before it is known."""
        self._question = Analysis.check, time_s
        self.exchange(time_s)
        return self._contradictions

    def exchange(self, time_s: float) -> AnalysisResult | None:
        """Send the waiting orders if the last batch is answered. Returns a new answer of the strategy, or None."""
        answer = None if self._sent_s is None else self._collect(time_s, self._sent_s)
        if self._sent_s is None and (self._orders or self._question):
            batch = self._orders[:_MOST_ORDERS]
            del self._orders[:_MOST_ORDERS]
            if self._question and not self._orders:
                batch.append(self._question)
                self._question = None
            self._worker.send(batch)
            self._sent_s, self._starved_s = time_s, self._worker.starved_s
            answer = self._collect(time_s, time_s) or answer
        return answer

    def silent(self, time_s: float) -> str:
        """Return the end of the search if the strategy takes too long, otherwise "".

        Time in which it waited for a processor does not count.
        """
        if self._sent_s is None or time_s - self._sent_s <= self._patience_s:
            return ""
        took_s = time_s - self._sent_s - (self._worker.starved_s - self._starved_s)
        return silent(took_s) if took_s > self._patience_s else ""

    def _collect(self, time_s: float, sent_s: float) -> AnalysisResult | None:
        if (answer := self._worker.receive()) is None:
            if time_s - sent_s > self._warn_s:
                starved_s = self._worker.starved_s - self._starved_s
                self._emit(StrategySlow(time_s, time_s - sent_s, starved_s))
                self._warn_s = 2 * (time_s - sent_s)
            return None
        self._sent_s = None
        if answer.failed:
            return answer
        if answer.number != self.number:
            return None
        if answer.velocity is not None:
            self._velocity, self._velocity_s = answer.velocity, time_s
        if answer.contradictions is not None:
            self._contradictions = answer.contradictions
        return answer


_NEARER: Final = 0.7  # choose another transmitter only if it is nearer by this factor
_NEARER_S: Final = 1.0  # choose it after this time: near a transmitter a dead antenna causes short gaps
_DEAF_S: Final = 60.0  # fly strips again after this time without a signal of the transmitter
_HARDLY_S: Final = 40.0  # judge the reception of a transmitter over this time
_OFTEN: Final = 0.25  # postpone it below this share of the frames that could have it
_CLOSER: Final = 0.8  # unless it came nearer than this share of its best distance; retry it there
_STEADY_S: Final = 5.0  # retry a postponed transmitter that was in all frames for this time
_MOST_HEARD: Final = 16  # transmitters
_SILENT_S: Final = 60.0  # of more, one is forgotten after this silence


_PAIR_S: Final = (0.9, 5.0)  # between two readings that are compared
_PAIR_M: Final = 0.1  # largest distance between them, as a share of d: the flux line hardly turns over it
_RANDOM: Final = 0.3  # of cos 2φ between two flux lines: the mean is 0 for noise, 0.7 to 1 for a distant transmitter
_NOISE: Final = 4.0  # after about 13 readings of noise


@dataclass
class HeardTransmitter:
    """The known state of one transmitter.

    `agreement`: of its flux lines, each with the one before. It grows with each pair that agrees, to 4, and falls with
    each that does not, to -4: then the readings are noise.
    """

    nearest_m: float = math.inf
    nearest_at: tuple[float, float] = (0.0, 0.0)  # north, east of the receiver
    last_m: float = math.inf
    last_s: float = -math.inf
    agreement: float = 0.0
    _compared: Observation | None = None

    def observe(self, o: Observation) -> None:
        """Use a reading."""
        self.last_m, self.last_s = o.d_m, o.time_s
        if self.last_m < self.nearest_m:
            self.nearest_m, self.nearest_at = self.last_m, o.position[:2]
        before = self._compared
        if before is not None and 0 <= o.time_s - before.time_s < _PAIR_S[0]:
            return
        self._compared = o
        if before is None or not 0 <= o.time_s - before.time_s < _PAIR_S[1]:
            return
        far = math.dist(o.position, before.position) > _PAIR_M * min(o.d_m, before.d_m)
        if far or o.inner or before.inner:
            return
        more = math.cos(2 * (o.bearing - before.bearing)) - _RANDOM
        self.agreement = min(max(self.agreement + more, -_NOISE), _NOISE)


LONG_S: Final = 240.0  # limit for one transmitter, while others or strips are left


class PutAside:
    """The transmitters to pass by: those that took too long, and those that move. `moving`: their last tracks."""

    def __init__(self) -> None:
        self.moving: dict[int, Track] = {}
        self._ids: dict[int, bool] = {}  # True for those that move
        self._visited: set[int] = set()

    def passes(self, id_: int) -> bool:
        """Return True if the search passes by a transmitter."""
        return id_ in self._ids

    def put(self, choice: Choice, others: Collection[int], time_s: float) -> bool:
        """Return True if the search for the present transmitter takes too long.

        `others`, received and not found, are searched for first; without any it gets as long again.
        """
        alone = not set(others) - self._ids.keys() - {choice.target}
        if choice.target is None or time_s - choice.since_s <= LONG_S * (1 + alone):
            return False
        self._ids[choice.target] = False
        return True

    def put_moving(self, id_: int, track: Track) -> None:
        """Put a transmitter aside that moves."""
        self.moving[id_] = track
        self._ids[id_] = True

    def heard_at(self, others: Mapping[int, HeardTransmitter], position: Position) -> tuple[float, float] | None:
        """Return the place to fly to for a received transmitter that is not found: the nearest, each once a victim."""
        past = self._visited | self._ids.keys()
        there = {id_: heard.nearest_at for id_, heard in others.items() if id_ not in past}
        while there:
            id_ = min(there, key=lambda id_: math.dist(there[id_], position[:2]))
            if math.dist(there[id_], position[:2]) > THERE_M:
                return there[id_]
            self._visited.add(id_)
            del there[id_]
        return None

    def renew(self) -> None:
        """Search again for those that took too long: another one was found."""
        self._visited.clear()
        self._ids = {id_: moves for id_, moves in self._ids.items() if moves}

    def back(self) -> bool:
        """Search again for all. Return True if there was any."""
        there = bool(self._ids)
        self._ids.clear()
        return there


def id_of(id_: int | None) -> int | None:
    """Return the id as in a frame."""
    return None if id_ == NO_ID else id_


def pulses(frame: Frame) -> list[tuple[Channel, VectorChannel | LevelChannel | None]]:
    """Return the channels of a frame that have a signal, each with its measured values if the frame carries them."""
    measured = frame.measured.channels if frame.measured else (None,) * len(frame.channels)
    return [pair for pair in zip(frame.channels, measured, strict=True) if pair[0].valid]


def observations(
    received: Sequence[tuple[Channel, VectorChannel | LevelChannel | None]],
    time_s: float,
    position: Position,
    rotation: NDArray[np.float64],
    ground: float | None,
) -> dict[int, Observation]:
    """Return the readings of the `pulses` of a frame, one for each id (or none): the nearest if there are several."""
    best: dict[int, Observation] = {}
    for channel, pulse in sorted(received, key=lambda pair: pair[0].d):
        o = Observation(time_s, position, rotation, channel.d, channel.delta, channel.zone == INNER, ground)
        if isinstance(pulse, VectorChannel) and pulse.age_ms is not None:
            o = o._replace(signal=(pulse.x, pulse.y, pulse.z), age_s=pulse.age_ms / 1e3)
        best.setdefault(NO_ID if channel.id is None else channel.id, o)
    return best


def hidden(frame: Frame, id_: int | None) -> bool:
    """Return True if a transmitter may be received though the frame has no reading of it: others mask it."""
    more = frame.status & (OVERLAP | MORE_TRANSMITTERS) or all(channel.valid for channel in frame.channels)
    return bool(more) or any(channel.id == id_ for channel in frame.channels)


class Choice:
    """Remembers the transmitters received, and the one that is flown to.

    `target`: its id or NO_ID, None before the first signal; `hunting`: False while strips are flown; `since_s`: when it
    was chosen. `guidance` gets the readings. `passes`: returns True for a transmitter to pass by; its second argument
    is True for the present one. `most_s`: after this time it flies to another one, and postpones this one.
    """

    def __init__(
        self,
        guidance: Guidance,
        passes: Callable[[int, bool], bool],
        emit: Callable[[Event], None],
        most_s: float = math.inf,
    ) -> None:
        self.heard: dict[int, HeardTransmitter] = {}
        self.target: int | None = None
        self.hunting = False
        self.since_s = 0.0
        self._from_m = math.inf  # its smallest distance at the choice
        self._nearer_s = math.inf  # start of the time in which another one is nearer
        self._put_off: dict[int, tuple[float, float]] = {}  # smallest distance, m, and start of the steady reception
        self._block = (0.0, 0, 0, 0.0)  # start, frames, frames with the transmitter, smallest distance before
        self.guidance = guidance
        self._passes = passes
        self._emit = emit
        self._most_s = most_s

    def add(self, id_: int, observation: Observation) -> None:
        """Add a reading of a transmitter."""
        if id_ not in self.heard:
            if len(self.heard) >= _MOST_HEARD and not self._forget_silent(observation.time_s):
                return
            self.heard[id_] = HeardTransmitter()
            self._emit(TransmitterHeard(observation.time_s, id_of(id_), observation.d_m, *observation.position[:2]))
        self.heard[id_].observe(observation)
        self.guidance.add(id_, observation)

    def choose(self, ids: Collection[int], time_s: float, *, masked: bool = False) -> None:
        """Choose the nearest transmitter, with a margin so that noise does not change the choice.

        `ids`: of a frame; `masked`: it may lack the one that is flown to because of others.
        """
        if self.target is not None and self.hunting:
            late = time_s - self.since_s > self._most_s
            if late:
                self._put_off[self.target] = self.heard[self.target].nearest_m, time_s
            if late or self._passes(self.target, True):
                self._emit(TransmitterLeft(time_s, id_of(self.target)))
                self.leave()
        current = self.heard.get(self.target) if self.target is not None else None
        if self.target is not None and current is not None and self.hunting:
            there = self.target in ids
            hardly = (there or not masked) and self._hardly_heard(current, there, time_s)
            deaf = time_s - current.last_s > _DEAF_S
            if hardly or (deaf and current.nearest_m > _CLOSER * self._from_m):
                self._put_off[self.target] = current.nearest_m, time_s
            noise = current.agreement <= -_NOISE
            if hardly or deaf or noise:
                self._abandon()
                self._emit(TransmitterFaded(time_s, id_of(self.target), hardly, noise))
        flown = self.target if self.hunting else None  # not passed by, as checked above
        known = [id_ for id_ in ids if id_ in self.heard and (id_ == flown or self.heard[id_].agreement >= 0)]
        heard = {id_: self.heard[id_] for id_ in known if id_ == flown or not self._passes(id_, False)}
        for id_, (metres, since_s) in self._put_off.items():
            self._put_off[id_] = metres, since_s if id_ in ids or masked else time_s
            enough_m = metres if time_s - since_s >= _STEADY_S else _CLOSER * metres
            if id_ in heard and heard[id_].last_m > enough_m:
                del heard[id_]
        if not heard:
            return
        closest = min(heard, key=lambda id_: heard[id_].last_m)
        nearer = current is not None and heard[closest].last_m < _NEARER * current.last_m
        self._nearer_s = min(self._nearer_s, time_s) if nearer else math.inf
        if current is None or not self.hunting or time_s - self._nearer_s >= _NEARER_S:
            if closest != self.target:
                self._emit(TransmitterChosen(time_s, id_of(closest), heard[closest].last_m))
            if closest != self.target or not self.hunting:
                self.target, self.since_s, self._from_m = closest, time_s, heard[closest].nearest_m
                self._block = time_s, 0, 0, heard[closest].nearest_m
                self.hunting = True
                self.guidance.begin(closest, has_id=closest != NO_ID)

    def forgive(self) -> bool:
        """Allow the postponed transmitters again. Returns whether there were any."""
        there = bool(self._put_off)
        self._put_off.clear()
        return there

    def _forget_silent(self, time_s: float) -> bool:
        """Forget a silent transmitter: one to pass by, or the one with the longest silence. Return False without one.

        The present one is not forgotten.
        """
        others = ((id_, one) for id_, one in self.heard.items() if id_ != self.target)
        silent = {id_: one for id_, one in others if time_s - one.last_s >= _SILENT_S}
        if not silent:
            return False
        id_ = min(silent, key=lambda id_: (not self._passes(id_, False), silent[id_].last_s))
        self.guidance.forget(id_)
        del self.heard[id_]
        return True

    def forget(self, id_: int) -> None:
        """Forget the readings of a transmitter; without an id, its reception too."""
        self.guidance.forget(id_)
        if id_ == NO_ID:
            del self.heard[id_]

    def leave(self) -> None:
        """Leave the present transmitter, and fly to none."""
        self.target = None
        self._abandon()

    @property
    def hardly(self) -> bool:
        """True if too few frames have the transmitter for a place that its few readings fit."""
        _, frames, often, _ = self._block
        return frames >= _HARDLY_S / 4 and often < _OFTEN * frames

    def _hardly_heard(self, current: HeardTransmitter, now: bool, time_s: float) -> bool:
        """Return True if few frames had the transmitter for a while, and its distance did not shrink.

        `now`: whether it is in this frame. At the limit of the range a strategy learns too little to find it.
        """
        since_s, frames, often, nearest_m = self._block
        frames, often = frames + 1, often + now
        self._block = since_s, frames, often, nearest_m
        if time_s - since_s < _HARDLY_S or frames < _HARDLY_S / 4:
            return False
        self._block = time_s, 0, 0, current.nearest_m
        return 0 < often < _OFTEN * frames and current.nearest_m > _CLOSER * nearest_m

    def _abandon(self) -> None:
        self.hunting = False
        self.guidance.leave()


AGREES: Final = "the newest readings agree with the place"
LISTEN: Final = "the last one does not: more are needed"
LOOK_AGAIN: Final = "they do not: the search visits the transmitter again"
NOT_THERE: Final = "they do not, and the transmitter was visited again before"

_MANY: Final = 0.7  # of the newest readings: they contradict the place
_AGAIN: Final = 2  # visits of a doubted transmitter
_SAME_M: Final = 1.0  # a place found twice within this distance is right


class LastLook:
    """Remembers the places that were doubted, by transmitter. `choice`: the transmitter that is flown to."""

    def __init__(self, choice: Choice, emit: Callable[[Event], None]) -> None:
        self._choice = choice
        self._emit = emit
        self._doubted: dict[int, list[tuple[float, float]]] = {}

    def check(self, found: Found, time_s: float, *, last: bool) -> str:
        """Check that the newest readings agree with the place found. To search for it again, forget them.

        `last`: there is no time for more.
        """
        id_ = self._choice.target
        contradicting = self._choice.guidance.contradictions(time_s)
        if contradicting is None:
            return AGREES if last else LISTEN
        if id_ is None or sum(contradicting) <= _MANY * len(contradicting):
            return LISTEN if any(contradicting[-1:]) and not last else AGREES
        doubted = self._doubted.setdefault(id_, [])
        if any(math.dist(found[:2], place) < _SAME_M for place in doubted):
            return AGREES
        if last or len(doubted) == _AGAIN:
            return NOT_THERE
        doubted.append(found[:2])
        self._emit(PlaceDoubted(time_s, id_of(id_), found.north, found.east))
        self._choice.forget(id_)
        return LOOK_AGAIN
