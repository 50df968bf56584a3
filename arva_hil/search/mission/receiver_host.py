"""The search as the host of its receiver: commands on the receiver's own port, and their answers (PROTOCOL.md)."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Final, NamedTuple

from firmware_proto import Command, CommandAnswer, HostForm

_ANSWER_S: Final = 1.0  # repeat a command without an answer after this time
_MOST_SENT: Final = 3  # after these tries without an answer, the receiver takes no commands


class Asked(NamedTuple):
    """A command, and its answer; None: there was none."""

    command: Command
    answer: CommandAnswer | None


class ReceiverHost:
    """The commands without an answer. One at a time is sent, at most three times.

    `write`: bytes to the port, False if it does not take them now. `form`: of commands and answers.
    """

    def __init__(self, form: HostForm, write: Callable[[bytes], bool]) -> None:
        self._encode = form.command
        self._decoder = form.answers()
        self._write = write
        self._waiting: deque[Command] = deque()
        self._answers: list[CommandAnswer] = []
        self._number = self._sent = 0
        self._sent_s = 0.0

    @property
    def busy(self) -> bool:
        """True if a command has no answer yet."""
        return bool(self._waiting)

    def ask(self, name: str, *values: int) -> None:
        """Queue a command after the earlier ones."""
        self._number = (self._number + 1) % 256
        self._waiting.append(Command(self._number, name, values))

    def feed(self, chunk: bytes, now: float) -> None:
        """Use bytes of the port. Without a pending command they are dropped."""
        if self._waiting:
            self._answers += self._decoder.feed(chunk, now)

    def poll(self, time_s: float) -> list[Asked]:
        """Send the command that is due. Returns the finished ones, with answers or without."""
        done: list[Asked] = []
        answers, self._answers = self._answers, []
        for answer in answers:
            if self._sent and self._waiting and (answer.number, answer.name) == self._waiting[0][:2]:
                done.append(Asked(self._waiting.popleft(), answer))
                self._sent = 0
        if self._sent and time_s - self._sent_s > _ANSWER_S and self._sent >= _MOST_SENT:
            done.append(Asked(self._waiting.popleft(), None))
            self._sent = 0
        if self._waiting and (not self._sent or time_s - self._sent_s > _ANSWER_S):
            self._write(self._encode(self._waiting[0]))
            self._sent, self._sent_s = self._sent + 1, time_s
        return done
