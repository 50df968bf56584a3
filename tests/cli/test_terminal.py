"""What a person sees on a terminal, which here is a pseudo-terminal 160 columns wide."""

from __future__ import annotations

import codecs
import fcntl
import json
import os
import re
import select
import signal
import struct
import subprocess
import sys
import termios
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from arva_hil.cli.terminal import time_left
from arva_hil.events import ReceiverStatus, StatusReport, VehicleStatus
from arva_hil.events.words.text import BAD
from arva_hil.links.pty import PtyLink
from arva_hil.links.serial_ports import SerialPort
from arva_hil.mavlink.codec import Encoder, dialect
from arva_hil.observers.console import status_line
from firmware_proto import Channel, Frame, encode
from tests.every import every

from .far_ends import DEADLINE_S, Arva, Autopilot, Keep, Start

DATA = Path(__file__).parent.parent / "data"
STATUS = (
    r"(?:\x1b\[1m)?\x1b\[38;5;\d+m■\x1b\[39m1 +mid +\d+ cm +[+-]\d+°(?:\x1b\[0m)? \| pose \d+ ms \| "
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
            assert select.select([self._master], [], [], max(end - time.monotonic(), 0))[0], (
                f"{pattern!r} is not in:\n{self.shown!r}"
            )
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
    program.stops(signal.SIGINT)
    left = [line.split("\r\x1b[K")[-1].strip() for line in terminal.rest().split("\n")]
    assert [bool(re.fullmatch(STATUS, line)) for line in left].count(True) == 1
    assert re.search(r"\d+ frames: \d+ sent, 0 dropped", terminal.shown)
    assert "Traceback" not in terminal.shown


def test_the_line_fits_the_terminal_that_it_is_on(start: Start, autopilot: Autopilot, keep: Callable[..., Any]) -> None:
    narrow = keep(Terminal(40))
    program = start("--port", "pty", "--autopilot", autopilot.address, "--rate", 10, stderr=narrow.slave)
    narrow.shows(r"\r\x1b\[K[^■\r]*(■\x1b\[39m1 [^\r]*)\r")
    program.stops(signal.SIGINT)
    statuses = re.findall(r"\r\x1b\[K[^■\r]*(■\x1b\[39m1 [^\r\n]*)", narrow.rest())
    shown = {re.sub(r"\x1b\[\d+m", "", status) for status in statuses}
    assert {re.sub(r"[-+]?\d+", "", status) for status in shown} >= {"■   mid     cm  ° | pose  ms"}
    assert max(map(len, shown)) <= 39


def test_a_replay_shows_a_progress_bar(start: Start, terminal: Terminal) -> None:
    program = start("replay", DATA / "px4.tlog", "--out", os.devnull, "--speed", 30, stderr=terminal.slave)
    terminal.shows(r"(?s) 0 % \|.*\| 0\.00 of 500kB, .* [5-9]\d % \|.*k of 500kB, 00:0\d left")
    program.ends()
    assert "26 frames: 26 sent" in terminal.rest()
    assert "\n 100 %" not in terminal.shown  # the bar is gone at the end
    assert re.search(r"(^|\n|\x1b\[K)datum: 47.3977", terminal.shown)  # on a line of its own


def test_the_demos_last_status_stands_above_its_sums_and_agrees_with_them(start: Start, terminal: Terminal) -> None:
    program = start("demo", "--speed", "max", "--limit", 3, stderr=terminal.slave)
    terminal.shows(r"log: .*search.png")
    program.ends(1)
    left = [re.sub(r"\x1b\[\d*m", "", line.split("\r\x1b[K")[-1]).strip() for line in terminal.rest().split("\n")]
    (status,) = [number for number, line in enumerate(left) if re.search(r"\| \d+ sent, 0 dropped \|", line)]
    (frames,) = [number for number, line in enumerate(left) if re.search(r"^\d+ frames: ", line)]
    (result,) = [number for number, line in enumerate(left) if line.startswith("not found in 3 s")]
    assert status < frames < result
    count = re.search(r"\d+ sent", left[status])
    assert count
    assert count[0] in left[frames]


def test_headless_is_plain_lines(start: Start, terminal: Terminal) -> None:
    program = start("demo", "--speed", "max", "--headless", "--limit", 1, stderr=terminal.slave)
    program.ends(1)  # nothing is found in 1 s
    assert "\x1b" not in terminal.rest()


@pytest.mark.parametrize("no_color", [True, False])
def test_colours_are_for_terminals_without_no_color(
    start: Start, terminal: Terminal, monkeypatch: pytest.MonkeyPatch, no_color: bool
) -> None:
    if no_color:
        monkeypatch.setenv("NO_COLOR", "1")
    start("--port", "pty", "--autopilot", "pty", "--timeout", 0.2, stderr=terminal.slave).ends(3)
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
    program.stops(signal.SIGHUP)
    assert '"ended": "SIGHUP"' in (tmp_path / "record" / "run.json").read_text()


# -- how long something still takes ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("done", "more", "after_s", "said"),
    [
        (10, 90, 10.0, "about 0:01:30 left"),
        (1, 10_000, 3.6, "about 10:00:00 left"),
        (0, 90, 10.0, ""),  # nobody knows yet
        (90, 0, 10.0, ""),
    ],
)
def test_the_time_left_follows_from_what_was_done(done: int, more: int, after_s: float, said: str) -> None:
    assert time_left(done, more, after_s) == said


# -- what comes from outside never reaches a terminal raw: whoever says it, whatever command repeats it --------


# sets the title, clears the screen, writes over the line, fakes one, colours, turns the direction
HOSTILE = "\x1b]0;owned\x07\x1b[2J\r\nerror: all is well\x9b31m\u202e"
SHOWN = r"\x1b]0;owned\x07\x1b[2J\r\nerror: all is well\x9b31m\u202e"


def assert_harmless(said: str) -> None:
    assert all(line.isprintable() for line in said.split("\n")), repr(said)
    assert "\nerror: all is well" not in said


@pytest.fixture
def hostile(tmp_path: Path) -> Path:
    """A file name that is an order to a terminal; the bytes behind it are no UTF-8."""
    return tmp_path / (HOSTILE + "\udcff")


@every(
    "arguments",
    [
        ["check", "{}"],
        ["replay", "{}.tlog"],
        ["replay", "{}"],
        ["listen", "{}"],
        ["{}"],
        ["--port", "{}"],
        ["--{}"],
        ["--port", "pty", "--format", "{}"],
        ["--port", "pty", "--scenario", "{}"],
        ["--port", "pty:{}/x"],
        ["--port", "/dev/{}", "--autopilot", "pty"],
        ["--port", "udpout:{}:14550"],
        ["--port", "tcp:x.{}:14550"],
        ["--port", "pty", "--signing-key", "{}"],
        ["campaign", "{}"],
        ["campaign", "--scheduler", "{}", "x"],
        ["search", "--autopilot", "pty", "--receiver", "/dev/{}", "--timeout", "0.2"],
        ["doctor", "--autopilot", "/dev/{}", "--listen", "0.2"],
    ],
)
def test_a_name_on_the_command_line(arva: Arva, hostile: Path, arguments: list[str]) -> None:
    name = hostile.name
    _, out, err = arva(*(argument.replace("{}", name) for argument in arguments), code=(1, 2, 3))
    assert_harmless(out + err)
    assert "owned" in out + err


def test_the_name_of_a_file_that_is_there(arva: Arva, hostile: Path) -> None:
    hostile.write_text(f'"{HOSTILE[1:9]}": 1\ntransmitters: []\n')
    _, out, err = arva("check", hostile, code=2)
    assert_harmless(out + err)
    assert err.count("\n") == err.count(SHOWN) > 1
    hostile.write_text("transmitters: [{id: 1, enu: [0, 0, 0]}]\n")
    _, out, err = arva("check", hostile)
    assert_harmless(out + err)
    assert f"{SHOWN}\\udcff: ok: transmitters 1" in out


def test_a_text_in_a_scenario(arva: Arva, tmp_path: Path) -> None:
    file = tmp_path / "a.yaml"
    quoted = json.dumps(HOSTILE)
    file.write_text(f"{quoted}: 1\ntransmitters: [{{id: {quoted}, enu: {quoted}}}]\ndatum: {quoted}\n")
    _, out, err = arva("check", file, code=2)
    assert_harmless(out + err)


def test_an_error_that_nobody_foresaw(arva: Arva, monkeypatch: pytest.MonkeyPatch) -> None:
    def break_down(options: object) -> int:
        raise ZeroDivisionError(HOSTILE)

    monkeypatch.setattr("arva_hil.cli.ports.main", break_down)
    monkeypatch.setattr("arva_hil.cli.options.CommandParser.parse", lambda *_: None)
    _, out, err = arva("ports", "-v", code=1)
    assert_harmless(out + err)
    assert SHOWN in err


@pytest.mark.parametrize("as_json", [False, True])
def test_the_name_of_a_usb_device(arva: Arva, monkeypatch: pytest.MonkeyPatch, as_json: bool) -> None:
    plugged = [SerialPort("/dev/ttyUSB0", f"/dev/serial/by-id/{HOSTILE}", HOSTILE + "\x7f")]
    monkeypatch.setattr("arva_hil.cli.ports.list_ports", lambda: plugged)
    _, out, err = arva("ports", *["--json"] * as_json)
    assert_harmless(out + err)
    assert out.count("\n") == 1
    if as_json:
        assert json.loads(out)["description"] == HOSTILE + "\x7f"
    else:
        assert SHOWN in out


@pytest.mark.parametrize("command", ["run", "doctor", "search", "listen"])
def test_the_name_of_a_program_that_holds_a_port(arva: Arva, line: PtyLink, command: str) -> None:
    opened = f"open({line.path!r}, 'r+b', buffering=0)"
    holds = f"import fcntl, sys; f = {opened}; fcntl.flock(f, fcntl.LOCK_EX); print(1, flush=True); sys.stdin.read()"
    with subprocess.Popen(
        [HOSTILE, "-c", holds], executable=sys.executable, stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as holder:
        assert holder.stdout is not None
        assert select.select([holder.stdout], [], [], DEADLINE_S)[0]
        _, out, err = arva(
            *{
                "run": ("run", "--autopilot", "pty", "--port", line.path),
                "doctor": ("doctor", "--autopilot", "pty", "--port", line.path, "--listen", 0.2),
                "search": ("search", "--autopilot", "pty", "--receiver", line.path),
                "listen": ("listen", line.path, "--duration", 1),
            }[command],
            code=(1, 3),
        )
        holder.kill()
    assert_harmless(out + err)
    assert rf"{holder.pid} (\x1b]0;owned" in out + err


def test_what_a_vehicle_says(start: Start, keep: Keep, line: PtyLink) -> None:
    """In STATUSTEXT, which `search` repeats; and to `run`, which does not."""
    autopilot = keep(Autopilot(keep(PtyLink())))
    text = dialect.MAVLink_statustext_message(dialect.MAV_SEVERITY_CRITICAL, HOSTILE.encode()[:50])
    encoder, write = Encoder(1, 1), autopilot.link.write
    autopilot.link.write = lambda data: write(data + encoder.pack(text))  # type: ignore[method-assign]
    other = keep(Autopilot(keep(PtyLink())))
    programs = [
        start("search", "--autopilot", autopilot.address, "--receiver", line.path, "--timeout", 60),
        start("run", "--autopilot", other.address, "--port", "pty"),
    ]
    line.write(encode(Frame(1, 1, (Channel(4, 1, 2000, 10),))))
    for program, said in zip(programs, ("the autopilot reports: .*owned", "readings are real"), strict=True):
        program.says(said)
        program.stops(signal.SIGINT)
        assert_harmless(program.err)


def test_what_a_service_manager_is_told() -> None:
    line = status_line(
        StatusReport(0.0, [VehicleStatus("vehicle", HOSTILE, {}, [ReceiverStatus("receiver", None, 0, 0)])])
    )
    assert line.isprintable()
    assert SHOWN in line
