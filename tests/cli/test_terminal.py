"""What a person sees on a terminal, which here is a pseudo-terminal 160 columns wide."""

from __future__ import annotations

import codecs
import fcntl
import os
import re
import select
import signal
import struct
import termios
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from arva_hil.events.words.text import BAD

from .far_ends import DEADLINE_S, Autopilot, Start

DATA = Path(__file__).parent.parent / "data"
STATUS = (
    r"(?:\x1b\[1m)?#1 +mid +\d+ cm +[+-]\d+°(?:\x1b\[0m)? \| pose \d+ ms \| "
    r"\d+ sent, 0 dropped \| pos \d+ Hz att \d+ Hz \| quadrotor 1/1"
)


class Terminal:
    """A screen for a program's stderr; `shown` is every byte it was sent."""

    def __init__(self, columns: int) -> None:
        self.shown = ""
        self._decoder = codecs.getincrementaldecoder("utf-8")()
        self._master, self.slave = os.openpty()
        fcntl.ioctl(self.slave, termios.TIOCSWINSZ, struct.pack("HHHH", 40, columns, 0, 0))

    def shows(self, pattern: str) -> re.Match[str]:
        end = time.monotonic() + DEADLINE_S
        while not (found := re.search(pattern, self.shown)):
            left = max(end - time.monotonic(), 0)
            assert select.select([self._master], [], [], left)[0], f"{pattern!r} is not in:\n{self.shown!r}"
            self.shown += self._decoder.decode(os.read(self._master, 65536))
        return found

    def types(self, keys: bytes) -> None:
        os.write(self._master, keys)

    def rest(self) -> str:
        end = time.monotonic() + DEADLINE_S
        while select.select([self._master], [], [], 0)[0] and time.monotonic() < end:
            self.shown += self._decoder.decode(os.read(self._master, 65536))
        return self.shown

    def close(self) -> None:
        os.close(self._master)
        os.close(self.slave)


@pytest.fixture
def terminal(keep: Callable[..., Any]) -> Terminal:
    return keep(Terminal(160))


def test_one_live_line_has_everything(start: Start, autopilot: Autopilot, terminal: Terminal) -> None:
    program = start("--port", "pty", "--autopilot", autopilot.address, "--rate", 10, stderr=terminal.slave)
    terminal.shows(STATUS + r"[^\n]*" + STATUS)  # written over: no new line between the two
    program.send(signal.SIGINT)
    assert program.ends() == 130
    left = [line.split("\r\x1b[K")[-1].strip() for line in terminal.rest().split("\n")]
    assert [bool(re.fullmatch(STATUS, line)) for line in left].count(True) == 1
    assert re.search(r"\d+ frames: \d+ sent, 0 dropped", terminal.shown)
    assert "Traceback" not in terminal.shown


def test_the_line_fits_the_terminal_that_it_is_on(start: Start, autopilot: Autopilot, keep: Callable[..., Any]) -> None:
    narrow = keep(Terminal(40))
    program = start("--port", "pty", "--autopilot", autopilot.address, "--rate", 10, stderr=narrow.slave)
    narrow.shows(r"\r\x1b\[K[^#\r]*(#1 [^\r]*)\r")
    program.send(signal.SIGINT)
    assert program.ends() == 130
    statuses = re.findall(r"\r\x1b\[K[^#\r]*(#1 [^\r\n]*)", narrow.rest())
    assert {re.sub(r"[-+]?\d+|\x1b\[.m", "", status) for status in statuses} >= {"#   mid     cm  ° | pose  ms"}
    assert max(len(re.sub(r"\x1b\[.m", "", status)) for status in statuses) <= 39


def test_a_replay_shows_a_progress_bar(start: Start, terminal: Terminal) -> None:
    program = start("replay", DATA / "px4.tlog", "--out", os.devnull, "--speed", 30, stderr=terminal.slave)
    terminal.shows(r"(?s) 0 % \|.*\| 0\.00 of 500kB, .* [5-9]\d % \|.*k of 500kB, 00:0\d left")
    assert program.ends() == 0
    assert "26 frames: 26 sent" in terminal.rest()
    assert "\n 100 %" not in terminal.shown  # the bar is gone at the end
    assert re.search(r"(^|\n|\x1b\[K)datum: 47.3977", terminal.shown)  # on a line of its own


def test_the_demos_last_status_stands_above_its_sums_and_agrees_with_them(start: Start, terminal: Terminal) -> None:
    program = start("demo", "--speed", "max", stderr=terminal.slave)
    terminal.shows(r"log: .*search.png")
    assert program.ends() == 0
    left = [re.sub(r"\x1b\[\d*m", "", line.split("\r\x1b[K")[-1]).strip() for line in terminal.rest().split("\n")]
    (status,) = [number for number, line in enumerate(left) if re.search(r"\| \d+ sent, 0 dropped \|", line)]
    (frames,) = [number for number, line in enumerate(left) if re.search(r"^\d+ frames: ", line)]
    (found,) = [number for number, line in enumerate(left) if line.startswith("found transmitter")]
    assert status < frames < found
    count = re.search(r"\d+ sent", left[status])
    assert count
    assert count[0] in left[frames]


def test_headless_is_plain_lines(start: Start, terminal: Terminal) -> None:
    program = start("demo", "--speed", "max", "--headless", "--limit", 5, stderr=terminal.slave)
    assert program.ends() == 1  # nothing is found in 5 s
    assert "\x1b" not in terminal.rest()


@pytest.mark.parametrize("no_color", [True, False])
def test_colours_are_for_terminals_without_no_color(
    start: Start, terminal: Terminal, monkeypatch: pytest.MonkeyPatch, no_color: bool
) -> None:
    if no_color:
        monkeypatch.setenv("NO_COLOR", "1")
    program = start("--port", "pty", "--autopilot", "pty", "--timeout", 0.2, stderr=terminal.slave)
    assert program.ends() == 3
    text = "error: no byte came"
    assert text in terminal.rest()
    assert (f"\x1b[38;5;{BAD}m{text}" in terminal.shown) is not no_color
    assert bool(re.search(r"\x1b\[[0-9;]*m", terminal.shown)) is not no_color


def test_a_terminal_that_is_closed_ends_the_run_and_its_record_is_whole(
    start: Start, autopilot: Autopilot, keep: Callable[..., Any], tmp_path: Path
) -> None:
    terminal = Terminal(80)
    program = start(
        *("--port", "pty", "--autopilot", autopilot.address, "--rate", 20, "--record", tmp_path / "record"),
        stderr=terminal.slave,
    )
    terminal.shows("pose")
    terminal.close()
    program.send(signal.SIGHUP)
    assert program.ends() == 130
    assert '"ended": "SIGHUP"' in (tmp_path / "record" / "run.json").read_text()
