"""`arva-hil command`: one command, its answer, and what is said when there is none."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from arva_hil.clock import RealClock
from arva_hil.links.pty import PtyLink
from arva_hil.registry import FORMATS
from firmware_proto import Channel, CommandAnswer, Frame, encode

from .far_ends import Arva, Start

FRAME = Frame(1, 1, (Channel(7, 1, 1234, -15),))


@contextmanager
def receiver(line: PtyLink, format: str, result: str | None, frames: bytes = b"") -> Iterator[None]:
    """One that gives every command of a host the same result, or no answer, behind a pseudo-terminal.

    Frames come when there is something to read: who opens a port forgets what came before.
    """
    form, clock, ended = FORMATS[format].host, RealClock(), threading.Event()
    decoder = form.commands()

    def serve() -> None:
        while not ended.wait(0.01):
            data = line.read()
            line.write(frames if data else b"")
            for command in decoder.feed(data, clock.now()) if result else ():
                strange = CommandAnswer((command.number + 1) % 256, command.name, "busy")
                answer = CommandAnswer(command.number, command.name, str(result), command.values)
                line.write(form.answer(strange) + form.answer(answer) + frames)

    thread = threading.Thread(target=serve)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


@pytest.mark.parametrize("format", ["binary", "nmea", "text"])
def test_the_answer_is_printed(arva: Arva, line: PtyLink, format: str) -> None:
    frames = FORMATS[format].encode(FRAME)
    with receiver(line, format, "done", frames):
        code, out, err = arva("command", line.path, "mark", 3, "--format", format)
    assert (code, out, err) == (0, "mark: done, 3\n", "")


@pytest.mark.parametrize("result", ["refused", "unknown", "busy"])
def test_a_refusal_is_printed_and_exit_code_1(arva: Arva, line: PtyLink, result: str) -> None:
    with receiver(line, "binary", result):
        code, out, _ = arva("command", line.path, "scan", "--json")
    assert code == 1
    said = json.loads(out)
    assert said.pop("number") in range(256)
    assert said == {"name": "scan", "result": result, "values": [], "text": ""}


@pytest.mark.parametrize(
    ("came", "said"),
    [
        (b"", "nothing came"),
        (encode(FRAME), "frames come, so this receiver takes no commands, or does not receive any from this program"),
        (FORMATS["nmea"].encode(FRAME), "bytes came, and no frame: the bytes are nmea: --format nmea"),
    ],
)
def test_no_answer_is_an_error_that_says_what_came(arva: Arva, line: PtyLink, came: bytes, said: str) -> None:
    with receiver(line, "binary", None, came):
        code, out, err = arva("command", line.path, "identify", "--timeout", 0.5)
    assert (code, out) == (1, "")
    assert err.startswith(f"arva-hil: {line.path}: no answer in 0.5 s: ")
    assert err.endswith(said + "\n")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("mrak", 3), "mrak: name is 'mrak', expected one of identify, mark,"),
        (("mark", "three"), "expected a whole number"),
        (("mark", 1, 2, 3, 4, 5), "5 values, expected 4 at most"),
        (("mark", 1, "--format", "tunnel"), "tunnel"),
    ],
)
def test_a_wrong_command_line_is_a_usage_error(arva: Arva, line: PtyLink, arguments: Any, said: str) -> None:
    code, out, err = arva("command", line.path, *arguments)
    assert (code, out) == (2, "")
    assert said in err


def test_a_port_that_is_not_there_is_exit_code_3(arva: Arva) -> None:
    assert arva("command", "/dev/no-such-port", "identify")[0] == 3


def test_a_run_obeys_it(arva: Arva, start: Start, autopilot: Any, tmp_path: Any) -> None:
    port = tmp_path / "port"
    program = start("run", "--port", f"pty:{port}", "--autopilot", autopilot.address, "--rate", 10)
    program.says("there is a pose")
    code, out, _ = arva("command", port, "identify", "--timeout", 20)
    assert code == 0
    assert out.startswith("identify: done, paper ")
    assert out.endswith(" binary, 4\n")
    port.write_bytes(b"hello")
    assert arva("command", port, "mark", 200, "--timeout", 20)[0] == 1
    program.says("command [0-9]+ answered: refused")
    program.stops()
    came = "commands: 2 came: 1 done, 1 refused, 0 unknown, 0 busy, 0 not answered; 5 bytes in no command"
    assert came in program.err
