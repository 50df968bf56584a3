"""`arva-hil command`: sends one command to a receiver, and prints the answer."""

from __future__ import annotations

import argparse
import os
from contextlib import closing
from typing import Final

from arva_hil.cli import common
from arva_hil.cli.listen import SAMPLE_BYTES, guess_format
from arva_hil.cli.outcome import FAILED, INTERRUPTED, OK, Failure, UsageError
from arva_hil.cli.terminal import show_one
from arva_hil.clock import Clock, RealClock
from arva_hil.errors import nearest
from arva_hil.links import Link
from arva_hil.registry import FORMATS
from firmware_proto import Command, CommandAnswer, HostForm
from firmware_proto.commands import DONE, NAMES

_LOOK_S: Final = 0.1


def main(options: argparse.Namespace) -> int:
    common.refuse_stdout("PORT", options.port)
    if (form := getattr(FORMATS[options.format], "host", None)) is None:
        raise UsageError(f"--format {options.format}: there are no commands in this format")
    command = Command(os.getpid() % 256, options.name, tuple(options.values))
    try:
        asking = Asking(command, form)
    except ValueError as error:
        near = nearest(options.name, NAMES)
        hint = f"; did you mean {near}?" if near and options.name not in NAMES else ""
        raise UsageError(f"{options.name}: {error}{hint}") from None
    clock = RealClock()
    with closing(common.open_or_fail(options.port, clock)) as link:
        asking.links = [link]
        interrupted = common.attend([asking], clock, until=options.timeout, over=lambda: asking.answer is not None)
    if asking.answer is None:
        if interrupted:
            return INTERRUPTED
        why = _doubt(asking.sample, options.format) if asking.sent else "the port does not take the command"
        raise Failure(FAILED, f"{options.port}: no answer in {options.timeout:g} s: {why}")
    answer = asking.answer
    what = [f"{answer.name}: {answer.result}", answer.text, *map(str, answer.values)]
    show_one(answer._asdict(), ", ".join(filter(None, what)), as_json=options.json)
    return OK if answer.result == DONE else FAILED


class Asking:
    """Sends one command as soon as the link takes it, and remembers the answer. Raises ValueError if it does not fit.

    `sample`: the first bytes that came instead of an answer.
    """

    def __init__(self, command: Command, form: HostForm) -> None:
        self.links: list[Link] = []
        self.answer: CommandAnswer | None = None
        self.sent = False
        self.sample = b""
        self._command = command
        self._bytes = form.command(command)
        self._answers = form.answers()

    def service(self, clock: Clock) -> float:
        """Send the command and read the answer. A task for the loop."""
        (link,) = self.links
        data, now = link.read(), clock.now()
        self.sample += data[: SAMPLE_BYTES - len(self.sample)]
        for answer in self._answers.feed(data, now):
            if self.sent and answer.number == self._command.number and self.answer is None:
                self.answer = answer
        if not self.sent:
            self.sent = link.write(self._bytes)
        return now + _LOOK_S


def _doubt(sample: bytes, format: str) -> str:
    """Return the likely reason for a missing answer."""
    if not sample:
        return "nothing came"
    if FORMATS[format].decoder().feed(sample, 0.0):
        return "frames come, so this receiver takes no commands, or does not receive any from this program"
    return f"{len(sample)} bytes came, and no frame: {guess_format(sample, format)}"
