"""Permission to arm: a simulator is armed at once, any other vehicle only after a person has said yes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, Protocol

from arva_hil.autopilot.commanding.vehicle_checks import SimulatorCheck
from arva_hil.autopilot.following.session import Received, Session
from arva_hil.events import Event
from arva_hil.events.reasons import Why, because
from arva_hil.events.searches import ArmingAllowed, ConsentNeeded, SimulatorRecognized
from arva_hil.search.mission.outcome import Refusal

_ANSWER_S: Final = 3.0  # for the answer of a simulator, once everything else is ready
_THINK_S: Final = 60.0  # for the answer of a person


class Question(Protocol):
    """A question to a person while the loop goes on."""

    def ask(self, label: str) -> None:
        """Ask if this vehicle, which is not known to be a simulator, may fly. Earlier input is no answer."""

    def answer(self) -> str | None:
        """Return the line typed since the question, None before that. Never waits."""


class Permission:
    """Remembers whether the vehicle is a simulator, and the person's answer.

    `yes`: a person has allowed it beforehand. `question`: None without a terminal. `dry_run`: nothing is armed, so the
    question is only reported.
    """

    def __init__(
        self, session: Session, *, yes: bool = False, question: Question | None = None, dry_run: bool = False
    ) -> None:
        self._session = session
        self._check = SimulatorCheck(session)
        self._yes = yes
        self._question = question
        self._dry_run = dry_run
        self._vehicle: tuple[int, ...] = ()
        self._checked_s: float | None = None  # when this vehicle was first checked
        self._asked: float | None = None
        self._said = False  # whether a person said yes to this vehicle

    @property
    def asking(self) -> bool:
        """True while a person is being asked."""
        return self._asked is not None and not self._said

    def on_packets(self, received: Received) -> None:
        """Use what the session received."""
        self._compare()
        self._check.on_packets(received)

    def poll(self, now: float) -> bytes:
        """Return the messages to send to the vehicle."""
        return b"" if self._said else self._check.poll(now)

    def forget(self) -> None:
        """Forget everything: it may be another vehicle now."""
        self._check.forget()
        self._checked_s = self._asked = None
        self._said = False

    def check(self, now: float, emit: Callable[[Event], None]) -> Refusal | bool:
        """Return True if the vehicle may be flown, False while that is unknown, or a refusal. Call it last.

        `emit` gets the event of the permission.
        """
        if self._checked_s is None:
            self._checked_s = now
        if self._said:
            return True
        if self._check.answer:
            self._said = True
            emit(SimulatorRecognized(now, str(self._session.vehicle), self._check.answer))
        elif now - self._checked_s > _ANSWER_S:
            return self._ask(now, emit)
        return self._said

    def _compare(self) -> None:
        vehicle = self._session.vehicle
        if vehicle is None:
            return
        now = vehicle.system, vehicle.component, vehicle.autopilot, vehicle.kind, self._session.navigation.reboots
        if now != self._vehicle:
            if self._vehicle:
                self.forget()
            self._vehicle = now

    def _ask(self, now: float, emit: Callable[[Event], None]) -> Refusal | bool:
        label = str(self._session.vehicle)
        if self._yes:
            self._said = True
            emit(ArmingAllowed(now, label))
        elif self._dry_run:
            self._said = True
            emit(ConsentNeeded(now, label, self._question is not None))
        elif self._question is None:
            return Refusal("refused", because(Why.NOBODY_ASKED, label=label))
        elif self._asked is None:
            self._asked = now
            self._question.ask(label)
        elif (answer := self._question.answer()) is not None:
            if answer.strip().lower() != "yes":
                return Refusal("refused", because(Why.ANSWER_NO, label=label))
            self._said = True
        elif now - self._asked > _THINK_S:
            return Refusal("refused", because(Why.ANSWER_LATE, label=label, seconds=_THINK_S))
        return self._said
