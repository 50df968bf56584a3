"""What comes from outside never reaches a terminal raw: whoever says it, whatever command repeats it."""

from __future__ import annotations

import json
import select
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from arva_hil.events import ReceiverStatus, StatusReport, VehicleStatus
from arva_hil.links.pty import PtyLink
from arva_hil.links.serial_ports import SerialPort
from arva_hil.mavlink.codec import Encoder, dialect
from arva_hil.observers.console.printer import status_line
from firmware_proto import Channel, Frame, encode
from tests.every import every

from .far_ends import DEADLINE_S, Arva, Autopilot, Keep, Start

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
    code, out, err = arva(*(argument.replace("{}", name) for argument in arguments))
    assert code in (1, 2, 3)
    assert_harmless(out + err)
    assert "owned" in out + err


def test_the_name_of_a_file_that_is_there(arva: Arva, hostile: Path) -> None:
    hostile.write_text(f'"{HOSTILE[1:9]}": 1\ntransmitters: []\n')
    code, out, err = arva("check", hostile)
    assert code == 2
    assert_harmless(out + err)
    assert err.count("\n") == err.count(SHOWN) > 1
    hostile.write_text("transmitters: [{id: 1, enu: [0, 0, 0]}]\n")
    code, out, err = arva("check", hostile)
    assert code == 0
    assert_harmless(out + err)
    assert f"{SHOWN}\\udcff: ok: transmitters 1" in out


def test_a_text_in_a_scenario(arva: Arva, tmp_path: Path) -> None:
    file = tmp_path / "a.yaml"
    quoted = json.dumps(HOSTILE)
    file.write_text(f"{quoted}: 1\ntransmitters: [{{id: {quoted}, enu: {quoted}}}]\ndatum: {quoted}\n")
    code, out, err = arva("check", file)
    assert code == 2
    assert_harmless(out + err)


def test_an_error_that_nobody_foresaw(arva: Arva, monkeypatch: pytest.MonkeyPatch) -> None:
    def break_down(options: object) -> int:
        raise ZeroDivisionError(HOSTILE)

    monkeypatch.setattr("arva_hil.cli.ports.main", break_down)
    monkeypatch.setattr("arva_hil.cli.options.CommandParser.parse", lambda *_: None)
    code, out, err = arva("ports", "-v")
    assert code == 1
    assert_harmless(out + err)
    assert SHOWN in err


@pytest.mark.parametrize("as_json", [False, True])
def test_the_name_of_a_usb_device(arva: Arva, monkeypatch: pytest.MonkeyPatch, as_json: bool) -> None:
    plugged = [SerialPort("/dev/ttyUSB0", f"/dev/serial/by-id/{HOSTILE}", HOSTILE + "\x7f")]
    monkeypatch.setattr("arva_hil.links.serial_ports.list_ports", lambda: plugged)
    code, out, err = arva("ports", *["--json"] * as_json)
    assert code == 0
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
        code, out, err = arva(
            *{
                "run": ("run", "--autopilot", "pty", "--port", line.path),
                "doctor": ("doctor", "--autopilot", "pty", "--port", line.path, "--listen", 0.2),
                "search": ("search", "--autopilot", "pty", "--receiver", line.path),
                "listen": ("listen", line.path, "--duration", 1),
            }[command]
        )
        holder.kill()
    assert code in (1, 3)
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
        program.send(signal.SIGINT)
        assert program.ends() == 130
        assert_harmless(program.err)


def test_what_a_service_manager_is_told() -> None:
    line = status_line(
        StatusReport(0.0, [VehicleStatus("vehicle", HOSTILE, {}, [ReceiverStatus("receiver", None, 0, 0)])])
    )
    assert line.isprintable()
    assert SHOWN in line
