"""The transmitters that one search has found: their places, the receiver's marks on them, and those left.

Marks are commands on the receiver's own port, and their answers (PROTOCOL.md).
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from arva_hil.events import Event
from arva_hil.events.reasons import Reason, Why, because
from arva_hil.events.searches import (
    MarkLost,
    MarksNotTaken,
    PlaceDoubted,
    ReceiverKnown,
    VictimAgain,
    VictimNoted,
)
from arva_hil.search.mission.choice import NO_ID, PutAside, id_of
from arva_hil.search.strategies.explained import explains
from arva_hil.search.strategies.strategy import Found, Observation
from firmware_proto import MORE_TRANSMITTERS, Command, CommandAnswer, Frame, HostForm
from firmware_proto.commands import DONE, IDENTIFY, MARK, UNKNOWN

_ANSWER_S: Final = 1.0  # repeat a command without an answer after this time
_MOST_SENT: Final = 3  # after these tries without an answer, the receiver takes no commands


Asked = tuple[Command, CommandAnswer | None]  # a command, and its answer; None: there was none


class ReceiverHost:
    """The commands without an answer. One at a time is sent, at most three times.

    `write`: bytes to the port, False if it does not take them now. `form`: of commands and answers.
    """

    def __init__(self, form: HostForm, write: Callable[[bytes], bool]) -> None:
        self._encode = form.command
        self._decoder = form.answers()
        self._write = write
        self.waiting: deque[Command] = deque()  # without an answer
        self._answers: list[CommandAnswer] = []
        self._number = self._sent = 0
        self._sent_s = 0.0

    def ask(self, name: str, *values: int) -> None:
        """Queue a command after the earlier ones."""
        self._number = (self._number + 1) % 256
        self.waiting.append(Command(self._number, name, values))

    def feed(self, chunk: bytes, now: float) -> None:
        """Use bytes of the port."""
        self._answers += self._decoder.feed(chunk, now)

    def poll(self, time_s: float) -> list[Asked]:
        """Send the command that is due. Returns the finished ones, with answers or without."""
        done: list[Asked] = []
        answers, self._answers = self._answers, []
        for answer in answers:
            if self._sent and (answer.number, answer.name) == self.waiting[0][:2]:
                done.append((self.waiting.popleft(), answer))
                self._sent = 0
        if time_s - self._sent_s > _ANSWER_S and self._sent >= _MOST_SENT:
            done.append((self.waiting.popleft(), None))
            self._sent = 0
        if self.waiting and (not self._sent or time_s - self._sent_s > _ANSWER_S):
            self._write(self._encode(self.waiting[0]))
            self._sent, self._sent_s = self._sent + 1, time_s
        return done


_MOST_TRIES: Final = 6  # of a mark in one hover: overlapping pulses make some fail
_NEXT_TRY_S: Final = 1.3  # between two tries: about one pulse
_AGAIN_S: Final = 5.0  # between tries to set a lost mark again
_NEAR_CM: Final = 600  # try it within this distance: receivers refuse distant marks
_SIGMA_M: Final = 0.4  # of a place without a sigma of the strategy
_WITHIN: Final = 2.45  # sigma: 95 % of a place
_LEAST_M: Final = 1.0  # two places within this distance are one


@dataclass(frozen=True)
class Victim:
    """A transmitter that was found. `id`: -1 when frames carry none. `sure`: as in AnalysisResult.

    `time_s`: of the finding, from the end of the take-off; `marked`: by the receiver, as far as the search knows.
    """

    id: int
    found: Found
    sure: bool
    time_s: float
    marked: bool = False

    @property
    def sigma(self) -> float:
        """Sigma of the place, for the order of probing [m]; infinite if it is not sure or not known."""
        sigma = self.found.sigma
        return math.inf if sigma is None or not self.sure else sigma


def probing_order(victims: list[Victim]) -> tuple[Victim, ...]:
    """Return the places, the surest first; equal ones in the order of finding."""
    return tuple(sorted(victims, key=lambda victim: (not victim.sure, victim.sigma, victim.time_s)))


class Marks:
    """The receiver's marks on places, by their numbers. `host`: commands to the receiver, None if it takes none."""

    def __init__(self, host: ReceiverHost | None, emit: Callable[[Event], None]) -> None:
        self._host = host
        self._emit = emit
        self._ids: dict[int, int] = {}  # of the transmitters
        self._asked = 0  # the place of the last command
        self._due: dict[int, float] = {}  # places to mark, and the time of the next try
        self._tried: dict[int, float] = {}  # the time of the last try
        self._tries = 0  # tries to mark the newest place
        if host is not None:
            host.ask(IDENTIFY)

    def begin(self, number: int, id_: int, time_s: float) -> None:
        """Mark a place, above which the vehicle hovers."""
        if self._host is not None and id_ != NO_ID:
            self._ids[number] = id_
            self._due[number], self._tries = time_s, 0

    def again(self, number: int) -> None:
        """Mark a place again, whose mark is lost."""
        if self._host is not None:
            self._due.setdefault(number, self._tried.get(number, -math.inf) + _AGAIN_S)

    def settling(self, newest: int) -> bool:
        """Return True while the search waits for the receiver above the newest place."""
        return self._host is not None and newest in self._due and self._tries < _MOST_TRIES

    def serve(self, time_s: float, newest: int) -> list[int]:
        """Send the next commands to the receiver, and use its answers. Returns the places that it has marked."""
        answered = self._host.poll(time_s) if self._host else ()
        marked = [self._asked for asked in answered if self._is_done(asked, time_s, newest)]
        due = [number for number, at_s in self._due.items() if at_s <= time_s]
        if self._host is not None and due and not self._host.waiting:
            self._asked = number = max(due)
            self._due[number], self._tried[number] = math.inf, time_s
            self._host.ask(MARK, self._ids[number])
        return marked

    def _is_done(self, asked: Asked, time_s: float, newest: int) -> bool:
        """Use an answer. Returns True if the place is marked."""
        (_, name, _), answer = asked
        if answer is None or (answer.result == UNKNOWN and name == MARK):
            self._host = None
            self._emit(MarksNotTaken(time_s, "no answer" if answer is None else answer.result))
            return False
        if name == IDENTIFY:
            channels = answer.values[0] if answer.values else None
            self._emit(ReceiverKnown(time_s, answer.text or "one without a name", channels))
            return False
        done = answer.result == DONE
        if not done and self._asked == newest and self._tries < _MOST_TRIES:
            self._tries += 1
            self._due[newest] = time_s + _NEXT_TRY_S
        else:
            self._due.pop(self._asked, None)
        return done


class Victims:
    """The transmitters found, with their ids and marks, and those that are put aside.

    `wanted`: the number to find, None: all. `several`: more than one is searched for. `host`: commands to the receiver,
    None if it takes none. `emit` gets the events. `known`: index of the place by id.
    """

    def __init__(self, wanted: int | None, host: ReceiverHost | None, emit: Callable[[Event], None]) -> None:
        self.wanted = wanted
        self.several = wanted != 1
        self.places: list[Victim] = []
        self.aside = PutAside()
        self.known: dict[int, int] = {}
        self.unreported = False  # a place is added, and not reported yet
        self._marks = Marks(host if self.several else None, emit)
        self._emit = emit
        self._together: set[frozenset[int]] = set()  # ids of one frame: they are of different transmitters
        self._doubted: set[int] = set()
        self._dipoles: list[NDArray[np.float64]] = []  # of victims without ids
        self._more = False

    @property
    def enough(self) -> bool:
        """True if as many as wanted were found for sure."""
        return self.wanted is not None and sum(victim.sure for victim in self.places) >= self.wanted

    def not_all(self, why: Why, more: int, **values: Any) -> Reason:
        """Return the end of a search that has not found all that it searched for; `more` were received."""
        sure = sum(victim.sure for victim in self.places)
        unsure = len(self.places) - sure
        return because(why, found=sure, unsure=unsure, wanted=self.wanted, more=more, **values)

    def left(self, heard: Iterable[int]) -> int | None:
        """Return the number of received transmitters that are not found; None if frames carry no ids."""
        every = set(heard)
        return None if NO_ID in every or not self.known else len(every - self.known.keys())

    def on_frame(self, frame: Frame, time_s: float) -> None:
        """Use a frame: detect lost marks, and remember transmitters received together."""
        ids = {channel.id for channel in frame.channels if channel.valid and channel.id is not None}
        self._together |= {frozenset((a, b)) for a in ids for b in ids if a < b}
        self._more = bool(frame.status & MORE_TRANSMITTERS)
        for channel in frame.channels:
            number = self.known.get(NO_ID if channel.id is None else channel.id)
            if number is None or not channel.valid or channel.marked:
                continue
            if self.places[number].marked:
                self.places[number] = replace(self.places[number], marked=False)
                self._emit(MarkLost(time_s, channel.id, number + 1))
            if channel.d <= _NEAR_CM:
                self._marks.again(number)

    def explain(self, observation: Observation) -> bool:
        """Return True if a reading without an id is of a transmitter that is found."""
        return any(explains(dipole, observation) for dipole in self._dipoles)

    def same(self, id_: int, found: Found, sure: bool, time_s: float) -> bool:
        """Return True if a place is of a transmitter found already, and mark it again.

        A sure place is never counted as one that is not sure.
        """
        for number, victim in enumerate(self.places):
            if sure and not victim.sure:
                continue
            sigma = math.hypot(found.sigma or _SIGMA_M, victim.found.sigma or _SIGMA_M)
            apart = math.dist(found[:2], victim.found[:2])
            others = [other for other, known in self.known.items() if known == number]
            together = any(frozenset((id_, other)) in self._together for other in others)
            if apart < max(_LEAST_M, _WITHIN * sigma) and not together:
                self._know(id_, number)
                self._emit(VictimAgain(time_s, id_of(id_), number + 1, apart))
                self._marks.begin(number, id_ if victim.id == NO_ID else victim.id, time_s)
                return True
        return False

    def doubt(self, id_: int, found: Found, time_s: float) -> bool:
        """Handle readings that contradict a place. Returns whether to visit it again: once for each transmitter."""
        if id_ in self._doubted:
            return False
        self._doubted.add(id_)
        self._emit(PlaceDoubted(time_s, id_of(id_), found.north, found.east))
        return True

    def add(self, victim: Victim, dipole: NDArray[np.float64] | None, time_s: float) -> None:
        """Add a found place, above which the vehicle hovers. `dipole`: there, of a transmitter without an id."""
        self.unreported = True
        self.places.append(victim)
        self._know(victim.id, len(self.places) - 1)
        if dipole is not None:
            self._dipoles.append(dipole)
        self._marks.begin(len(self.places) - 1, victim.id, time_s)

    def retract(self) -> None:
        """Count the newest place as not sure."""
        self.places[-1:] = [replace(victim, sure=False) for victim in self.places[-1:]]

    def report(self, heard: Iterable[int], time_s: float) -> None:
        """Report the newest place, and the transmitters left of those `heard`."""
        self.unreported = False
        self.aside.renew()
        victim = self.places[-1]
        place = victim.found.north, victim.found.east
        about = len(self.places), self.wanted, *place, victim.sure, victim.marked, self.left(heard), self._more
        self._emit(VictimNoted(time_s, id_of(victim.id), *about))

    @property
    def settling(self) -> bool:
        """True while the search waits for the receiver above the newest place."""
        return self._marks.settling(len(self.places) - 1)

    def serve(self, time_s: float) -> None:
        """Send the next commands to the receiver, and use its answers."""
        for number in self._marks.serve(time_s, len(self.places) - 1):
            self.places[number] = replace(self.places[number], marked=True)

    def _know(self, id_: int, number: int) -> None:
        if id_ != NO_ID:
            self.known[id_] = number
