"""Commands and answers as NMEA sentences, for the text formats: `$PARVC` and `$PARVR`. See PROTOCOL.md."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import partial
from typing import Final, TypeVar

from firmware_proto.commands import MAX_VALUES, Command, CommandAnswer, HostForm, check_answer, check_command
from firmware_proto.frame import PAUSE_S
from firmware_proto.messages import StreamDecoder
from firmware_proto.sentence import MAX_SENTENCE, ChecksumError, begun, body_of, sentence

T = TypeVar("T", Command, CommandAnswer)


def encode_command_line(command: Command) -> bytes:
    """Return the sentence of a command. Raises ValueError with the field that does not fit."""
    check_command(command)
    return _sentence(["PARVC", command.number, command.name, *command.values])


def encode_answer_line(answer: CommandAnswer) -> bytes:
    """Return the sentence of an answer. Raises ValueError with the field that does not fit."""
    check_answer(answer)
    return _sentence(["PARVR", answer.number, answer.name, answer.result, answer.text, *answer.values])


def _sentence(fields: list[str | int]) -> bytes:
    body = ",".join(map(str, fields)).encode()
    if len(body) + 6 > MAX_SENTENCE:
        raise ValueError(f"a sentence of {len(body) + 6} bytes, expected {MAX_SENTENCE} at most")
    return sentence(body)


class SentenceDecoder(StreamDecoder[T]):
    """Incremental decoder of sentences of one kind. Remembers the incomplete sentence and when it began.

    Invalid and other sentences are dropped, and those that took 100 ms or more to arrive. `$` always begins a sentence.
    """

    def __init__(self, parse: Callable[[list[str]], T | None]) -> None:
        super().__init__()
        self._parse: Callable[[list[str]], T | None] = parse
        self._part = b""  # at most MAX_SENTENCE
        self._since = 0.0

    def feed(self, chunk: bytes, now: float) -> list[T]:
        """Return the messages completed by `chunk`. See StreamDecoder."""
        found: list[T] = []
        if self._part and now - self._since >= PAUSE_S:
            self.dropped += len(self._part)
            self._part = b""
        old = len(self._part)  # the first of these bytes came at `_since`
        *lines, part = (self._part + chunk).split(b"\n")
        for line in lines:
            message = self._message(line)
            if message is not None:
                found.append(message)
        self._part = begun(part)
        self.dropped += len(part) - len(self._part)
        if lines or len(self._part) < len(part) or not old:
            self._since = now
        return found

    def _message(self, line: bytes) -> T | None:
        start = max(line.rfind(b"$"), 0)
        self.dropped += start
        message = self._values(line[start:])
        if message is None:
            self.dropped += len(line) - start + 1
        else:
            self.good += 1
        return message

    def _values(self, line: bytes) -> T | None:
        try:
            body = body_of(line)
        except ChecksumError:
            self.bad_crc += 1
            return None
        return None if body is None else self._parse(body.decode("latin-1").split(","))


def _command(fields: list[str]) -> Command | None:
    if fields[0] != "PARVC" or len(fields) < 3 or (numbers := _numbers([fields[1], *fields[3:]])) is None:
        return None
    return _checked(Command(numbers[0], fields[2], tuple(numbers[1:])), check_command)


def _answer(fields: list[str]) -> CommandAnswer | None:
    if fields[0] != "PARVR" or len(fields) < 5 or (numbers := _numbers([fields[1], *fields[5:]])) is None:
        return None
    return _checked(CommandAnswer(numbers[0], fields[2], fields[3], tuple(numbers[1:]), fields[4]), check_answer)


def _numbers(fields: list[str]) -> list[int] | None:
    if len(fields) > 1 + MAX_VALUES or not all(re.fullmatch(r"-?[0-9]{1,10}", field) for field in fields):
        return None
    return [int(field) for field in fields]


def _checked(message: T, check: Callable[[T], None]) -> T | None:
    try:
        check(message)
    except ValueError:
        return None
    return message


LINE_HOST: Final = HostForm(
    encode_command_line,
    partial(SentenceDecoder[Command], _command),
    encode_answer_line,
    partial(SentenceDecoder[CommandAnswer], _answer),
)
