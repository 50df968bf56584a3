"""Runs a decoder, feeds it the bytes of a clause, and compares its lines with the expected ones."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
from collections.abc import Mapping, Sequence
from typing import Any, Final, NamedTuple

from arva_hil.bench.clauses import NO_ID, Clause, Line, Step
from arva_hil.clock import RealClock, await_descriptors
from arva_hil.links.processes import holders

PATIENCE_S: Final = 5.0  # for a decoder's start, for a line that is due in 100 ms, and for its end
_TOO_MUCH: Final = 65536  # bytes of output more than the expected lines may have
_LINE_BYTES: Final = 256
_PIECE: Final = 4096
_LOOK_S: Final = 0.02


class Verdict(NamedTuple):
    """The result of one clause. `why`: the first mistake; "" if the clause holds."""

    clause: Clause
    why: str


class RunningDecoder:
    """A decoder as a process. Remembers its output. `pty`: it opens the port in $ARVA_PORT, else it reads stdin.

    `most`: the output is not read any further after so many bytes.
    """

    def __init__(self, command: Sequence[str], most: int, *, pty: bool) -> None:
        self.output = b""
        self._most = most
        self._clock = RealClock()
        self._closed = False  # its output
        self._port: Any = None
        environment = dict(os.environ)
        if pty:
            from arva_hil.links.pty import PtyLink

            self._port = PtyLink()
            environment["ARVA_PORT"] = self._port.path
        try:
            self._process = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL if pty else subprocess.PIPE,
                stdout=subprocess.PIPE,
                env=environment,
                start_new_session=True,
            )
        except BaseException:
            self.close()
            raise
        assert self._process.stdout is not None
        self._out = self._process.stdout.fileno()
        os.set_blocking(self._out, False)
        if self._process.stdin is not None:
            os.set_blocking(self._process.stdin.fileno(), False)

    def opened(self, seconds: float) -> bool:
        """Wait until the decoder has opened its port. Returns False if it does not."""
        end = self._clock.now() + seconds
        while self._port is not None and len(holders(self._port.path)) < 2:  # the bench has it open as well
            if self._process.poll() is not None or self._clock.now() > end:
                return False
            self._clock.wait(self._clock.now() + _LOOK_S)
        if self._port is not None:
            self.wait(_LOOK_S)  # it may discard bytes that came before its settings
        return True

    def send(self, data: bytes, seconds: float) -> bool:
        """Send bytes, and read the output meanwhile. Returns False if they are not taken in time."""
        end = self._clock.now() + seconds
        while data and self._clock.now() < end:
            try:
                if self._port is not None:
                    sent = len(data[:_PIECE]) if self._port.write(data[:_PIECE]) else 0
                else:
                    assert self._process.stdin is not None
                    sent = os.write(self._process.stdin.fileno(), data[:65536])
            except BlockingIOError:
                sent = 0
            except OSError:
                return False
            data = data[sent:]
            self.read()
            if data and not sent:
                self.wait(0.001)
        return not data

    @property
    def prints_too_much(self) -> bool:
        """True if the output is longer than any right output."""
        return len(self.output) > self._most

    def read(self) -> None:
        """Read the decoder's output."""
        with contextlib.suppress(BlockingIOError):
            while not self._closed and not self.prints_too_much:
                chunk = os.read(self._out, 65536)
                self._closed = not chunk
                self.output += chunk

    def wait(self, seconds: float, lines: int | None = None) -> bool:
        """Read for a time, or until there are `lines` lines. Returns False if they do not come."""
        end = self._clock.now() + seconds
        while True:
            self.read()
            there = lines is not None and self.output.count(b"\n") >= lines
            if there or (left := end - self._clock.now()) <= 0:
                return there
            if self._closed or self.prints_too_much:
                return False
            await_descriptors([self._out], timeout_s=left)

    def finish(self, seconds: float) -> str:
        """End the input, and wait for the end. Returns the mistake, "" if there is none."""
        if self._port is not None:
            self._port.close()
        elif self._process.stdin is not None:
            self._process.stdin.close()
        self.wait(seconds)
        try:
            code = self._process.wait(seconds if self._closed else 0)
        except subprocess.TimeoutExpired:
            return f"it does not end {seconds:g} s after its input"
        if code < 0:
            return f"it was killed by signal {-code}"
        return f"it ended with exit code {code}" if code else ""

    def close(self) -> None:
        """Kill its remaining processes, and close all files."""
        if self._port is not None:
            self._port.close()
        process = getattr(self, "_process", None)
        if process is None:
            return
        with contextlib.suppress(OSError, AttributeError):  # programs that a script has started may still run
            os.killpg(process.pid, signal.SIGKILL)
        process.kill()
        for stream in (process.stdin, process.stdout):
            if stream is not None:
                with contextlib.suppress(OSError):
                    stream.close()
        process.wait()


def judge(clause: Clause, command: Sequence[str], *, pty: bool = False, patience_s: float = PATIENCE_S) -> Verdict:
    """Run a decoder for one clause. Raises OSError if the command cannot be started."""
    decoder = RunningDecoder(command, _TOO_MUCH + _LINE_BYTES * len(clause.expected), pty=pty)
    try:
        why = "" if decoder.opened(patience_s) else "it does not open the port in $ARVA_PORT"
        return Verdict(clause, why or _run(clause, decoder, patience_s))
    finally:
        decoder.close()


def _run(clause: Clause, decoder: RunningDecoder, patience_s: float) -> str:
    expected = len(clause.expected)
    for step in clause.steps:
        if why := _step(step, decoder, patience_s):
            return _first(_mistake(decoder.output, clause.expected, ended=False), why)
    decoder.wait(patience_s, expected)
    ended = "" if decoder.prints_too_much else decoder.finish(patience_s)
    if decoder.prints_too_much:
        return f"it prints too much: more than {len(decoder.output)} bytes for {expected} lines"
    return _first(_mistake(decoder.output, clause.expected, ended=True), ended)


def _step(step: Step, decoder: RunningDecoder, patience_s: float) -> str:
    """Do one step. Returns the mistake, "" if there is none."""
    if not decoder.send(step.data, patience_s):
        return decoder.finish(patience_s) or "it does not read its input"
    if step.lines and not decoder.wait(patience_s, step.lines):
        return f"line {step.lines} does not come within {patience_s:g} s of silence (is each line flushed?)"
    if step.pause_s:
        decoder.wait(step.pause_s)
    return ""


def _first(wrong_line: str, otherwise: str) -> str:
    """Return the mistake to print: a wrong end explains missing lines."""
    return otherwise if otherwise and (not wrong_line or "missing" in wrong_line) else wrong_line


def _mistake(output: bytes, expected: Sequence[Line], *, ended: bool) -> str:
    """Return the first mistake in the lines; "" if there is none. `ended`: no more lines come."""
    texts = output.split(b"\n")
    if not texts[-1]:
        texts.pop()
    for number, text in enumerate(texts, 1):
        try:
            line = _parsed(text)
        except ValueError as error:
            return f"line {number}: {error}"
        if number > len(expected):
            return f"line {number} is one too many: {_shown(text)}"
        if wrong := _difference(line, expected[number - 1]):
            return f"line {number}: {wrong}"
    if ended and len(texts) < len(expected):
        return f"line {len(texts) + 1} is missing: {_text(expected[len(texts)])}"
    return ""


def _parsed(text: bytes) -> Line:
    """Parse a line. Raises ValueError with the mistake."""
    try:
        said = json.loads(text)
    except (ValueError, RecursionError):
        raise ValueError(f"no JSON: {_shown(text)}") from None
    if not isinstance(said, Mapping):
        raise ValueError(f"no JSON object: {_shown(text)}")
    values = []
    for name in Line._fields:
        if name not in said:
            raise ValueError(f"no key {name!r}: {_shown(text)}")
        value = said[name]
        if value is None and name in ("id", "d_cm", "delta_deg", "zone"):
            value = {"id": NO_ID, "d_cm": 0}.get(name)
        elif not isinstance(value, int) or isinstance(value, bool):
            raise ValueError(f"{name} is no integer: {_shown(text)}")
        values.append(value)
    return Line(*values)


def _difference(line: Line, expected: Line) -> str:
    """Return the first field that differs; "" if none does."""
    for name, value, wanted in zip(Line._fields, line, expected, strict=True):
        if name == "d_cm" and wanted == 0:
            if line.d_cm > 0:
                return f"d_cm is {value}, expected no signal: -1, 0 or null"
        elif wanted is not None and value != wanted:
            return f"{name} is {value}, expected {wanted}, in {_text(expected)}"
    return ""


def _text(line: Line) -> str:
    return json.dumps(line._asdict())


def _shown(text: bytes) -> str:
    return repr(text[:80].decode("utf-8", "replace"))
