"""Commands that the host sends to a receiver's port: they are given to the model, and answered between frames."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

from arva_hil import __version__
from arva_hil.config import Scenario
from arva_hil.events import CommandAnswered, CommandReceived, Event
from arva_hil.model.receiver import Answer
from firmware_proto import MAX_CHANNELS, Command, CommandAnswer, HostForm
from firmware_proto.commands import BUSY, CHANNELS, DONE, IDENTIFY, REFUSED, RESTART

Obey = Callable[[float, str, Sequence[float]], Answer]
"""Handles a command of the host: the time on the driver's clock, its name and its values."""

_MOST_BYTES: Final = 4096  # used of one read, so that a flood does not delay the frames
_RATE_HZ: Final = 20.0  # commands executed per second on average; as many are answered with "busy"
_BURST: Final = 10  # more commands at once
_CLEAR_S: Final = 0.01  # no answer in this time before a frame; the longest takes 8 ms at 115200 baud


@dataclass
class CommandCounters:
    """The results of the commands: commands = done + refused + unknown + busy + unanswered."""

    commands: int = 0  # complete ones
    done: int = 0
    refused: int = 0
    unknown: int = 0
    busy: int = 0  # not executed, because too many came
    unanswered: int = 0  # not answered either, because far too many came
    answers_dropped: int = 0  # the link did not accept them
    bytes_dropped: int = 0  # that belong to no command


class RateLimit:
    """Allows `rate_hz` commands per second on average, and `burst` at once."""

    def __init__(self, rate_hz: float, burst: int) -> None:
        self._rate_hz = rate_hz
        self._most = self._left = float(burst)
        self._at = math.inf

    def take(self, now: float) -> bool:
        """Return True if one more is allowed at `now`, and count it."""
        self._left = min(self._most, self._left + self._rate_hz * max(0.0, now - self._at))
        self._at = now
        if self._left < 1:
            return False
        self._left -= 1
        return True


class HostCommands:
    """Remembers the commands of a receiver's host that are not executed yet, and the answers that are not sent yet.

    `vehicle`, `name`: for its events. `form`: how commands are encoded on this port. `obey`: the receiver's
    `command`. `channels`: the number in the newest frame.
    """

    def __init__(
        self,
        vehicle: str,
        name: str,
        scenario: Scenario,
        form: HostForm,
        obey: Obey,
    ) -> None:
        self.counters = CommandCounters()
        self._about = vehicle, name
        self._scenario = scenario
        self._form = form
        self._decoder = form.commands()
        self._obey = obey
        self.channels = scenario.receiver.channels
        self.heard = False  # True after the first byte; most hosts only listen
        self._commands: list[Command] = []
        self._answers: list[tuple[bytes, CommandAnswered]] = []
        self._executed = RateLimit(_RATE_HZ, _BURST)
        self._refusals = RateLimit(_RATE_HZ, _BURST)

    def receive(self, data: bytes, now: float) -> None:
        """Use bytes of the host that arrived at `now`."""
        self.heard = True
        self._commands += self._decoder.feed(data[:_MOST_BYTES], now)
        self._decoder.dropped += max(0, len(data) - _MOST_BYTES)

    def advance(self, now: float) -> list[Event]:
        """Execute the commands received. The receiver must have taken its samples until `now`. Returns the events."""
        self._commands += self._decoder.feed(b"", now)
        self.counters.bytes_dropped = self._decoder.dropped
        if not self._commands:
            return []
        commands, self._commands = self._commands, []
        return [event for command in commands if (event := self._take(command, now))]

    def answers(self, now: float, next_frame: float) -> list[tuple[bytes, CommandAnswered]]:
        """Return the answers to send now; none shortly before a frame."""
        if not self._answers or next_frame - now < _CLEAR_S:
            return []
        answers, self._answers = self._answers, []
        return answers

    def _take(self, command: Command, now: float) -> CommandReceived | None:
        """Execute one command, or refuse it if too many came."""
        counters = self.counters
        counters.commands += 1
        received = None
        if self._executed.take(now):
            received = CommandReceived(now, *self._about, command.number, command.name, command.values)
            result, values, text = self._result(command, now)
        elif self._refusals.take(now):
            result, values, text = BUSY, (), ""
        else:
            counters.unanswered += 1
            return None
        setattr(counters, result, getattr(counters, result) + 1)
        answer = CommandAnswer(command.number, command.name, result, values, text)
        told = CommandAnswered(now, *self._about, command.number, command.name, result, values, text, True)
        self._answers.append((self._form.answer(answer), told))
        return received

    def _result(self, command: Command, now: float) -> tuple[str, tuple[int, ...], str]:
        """Return result, values and text of the answer. Some commands do not need the model."""
        name, values = command.name, command.values
        if name == IDENTIFY:
            settings, form = self._scenario.receiver, self._scenario.output_format
            words = (settings.model, 12), (__version__, 8), (form, 10)
            identity = (re.sub(r"[^A-Za-z0-9.+_-]", "_", word)[:size] for word, size in words)
            return DONE, (self.channels,), " ".join(identity)
        if name == CHANNELS and not values:
            return DONE, (self.channels,), ""
        if name == CHANNELS and (len(values) > 1 or not 1 <= values[0] <= MAX_CHANNELS):
            return REFUSED, (), ""
        result = self._obey(now, name, values).value
        if result != DONE:
            return result, (), ""
        if name == RESTART:
            self.channels = self._scenario.receiver.channels
        elif name == CHANNELS:
            self.channels = values[0]
            return DONE, values, ""
        return DONE, (), ""
