"""Serial ports, pseudo-terminals and pyserial's URLs: how they fail, and the cure they name."""

from __future__ import annotations

import errno
import grp
import os
import select
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import serial as pyserial

from arva_hil.clock import StepClock
from arva_hil.links import LinkError, open_link
from arva_hil.links import serial as serial_module
from arva_hil.links.pty import PtyLink
from arva_hil.links.serial import open_serial, open_url
from arva_hil.links.serial_ports import SerialPort, find_autopilot, list_ports
from arva_hil.links.tcp import TcpServerLink
from tests.every import every
from tests.links.links_waiting import Keep, receive, until


@pytest.fixture
def master(keep: Keep) -> PtyLink:
    return keep(PtyLink())


@pytest.fixture
def two_ports(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(serial_module, "list_ports", lambda: [SerialPort("/dev/ttyACM0"), SerialPort("/dev/ttyUSB1")])


def failing(monkeypatch: pytest.MonkeyPatch, error: Exception) -> None:
    def serial(*args: Any, **kwargs: Any) -> None:
        raise error

    monkeypatch.setattr(pyserial, "Serial", serial)


# Opening


def test_a_second_opener_is_told_who_holds_the_port(master: PtyLink, keep: Keep) -> None:
    keep(open_serial(master.path))
    with pytest.raises(LinkError, match="busy: held by") as caught:
        open_serial(master.path)
    assert f"{os.getpid()} (" in caught.value.what
    assert caught.value.link == master.path


def test_a_closed_port_can_be_opened_again(master: PtyLink, keep: Keep) -> None:
    open_serial(master.path).close()
    second = keep(open_serial(master.path))
    master.write(b"x")
    assert receive(second, 1) == b"x"


@pytest.mark.parametrize(
    ("path", "there", "cure"),
    [
        ("/dev/ttyNONE", ["/dev/ttyACM0", "/dev/ttyUSB1"], "the ports here are /dev/ttyACM0, /dev/ttyUSB1"),
        ("/dev/ttyNONE", [], "this machine has no serial port"),
        ("/tmp/none", [], "start the program that makes it first, e.g. `arva-hil run` or `arva-hil vehicle`"),
    ],
)
def test_no_such_port(path: str, there: list[str], cure: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(serial_module, "list_ports", lambda: [SerialPort(device) for device in there])
    with pytest.raises(LinkError, match=f"^{path}: no such port; {cure}$"):
        open_serial(path)


@pytest.mark.usefixtures("two_ports")
def test_what_is_no_serial_port(tmp_path: Path) -> None:
    (file := tmp_path / "file").write_bytes(b"precious")
    for path, what in (
        (tmp_path, "is a directory"),
        (file, "is a file, not a"),
        ("/dev/null", "is not a serial"),
    ):
        with pytest.raises(LinkError, match=what):
            open_serial(str(path))
    assert file.read_bytes() == b"precious"


@pytest.mark.parametrize(
    "error",
    [PermissionError(errno.EACCES, "Permission denied"), pyserial.SerialException(errno.EACCES, "no")],
)
@pytest.mark.parametrize(
    ("mode", "group", "hint"),
    [
        (
            0o660,
            "dialout",
            "add yourself to group dialout: sudo usermod -aG dialout $USER, then log in again",
        ),
        (0o600, "dialout", "only its owner may open it: ls -l "),
        (0o660, "root", "only its owner may open it: ls -l "),
    ],
)
def test_no_permission(
    master: PtyLink, monkeypatch: pytest.MonkeyPatch, error: Exception, mode: int, group: str, hint: str
) -> None:
    monkeypatch.setattr(grp, "getgrgid", lambda number: SimpleNamespace(gr_name=group))
    os.chmod(master.path, mode)
    failing(monkeypatch, error)
    with pytest.raises(LinkError, match="permission denied; ") as caught:
        open_serial(master.path)
    assert caught.value.hint.startswith(hint)


@pytest.mark.parametrize(
    ("error", "what"),
    [
        (pyserial.SerialException(errno.EBUSY, "busy"), "busy"),
        (pyserial.SerialException("could not open port 'COM5': FileNotFoundError(2, '...')"), "no such port"),
        (pyserial.SerialException("could not open port 'COM5': PermissionError(13, '...')"), "busy"),
        (
            pyserial.SerialException("Could not configure port: (5, 'Input/output error')"),
            "no hardware behind",
        ),
        (ValueError("Invalid baud rate: 1"), "cannot be opened: Invalid baud rate: 1"),
    ],
)
def test_other_errors(master: PtyLink, monkeypatch: pytest.MonkeyPatch, error: Exception, what: str) -> None:
    failing(monkeypatch, error)
    with pytest.raises(LinkError, match=what):
        open_serial(master.path)


# pyserial's URLs


def test_loop_url(keep: Keep) -> None:
    link = keep(open_link("loop://", clock=StepClock()))
    assert link.read() == b""
    assert not link.ready()
    assert link.write(b"around")
    assert link.ready()
    assert link.read() == b"around"
    link.close()
    link.close()
    with pytest.raises(LinkError, match="closed"):
        link.read()


def test_socket_url(keep: Keep) -> None:
    server = keep(TcpServerLink())
    link = keep(open_url(f"socket://127.0.0.1:{server.port}"))
    assert link.write(b"to the server")
    assert receive(server, 13) == b"to the server"
    assert server.write(b"x" * 50_000)
    assert receive(link, 50_000, server) == b"x" * 50_000
    while link.write(b"y" * 100_000):  # returns, and False in the end: it does not wait for the reader
        assert link.dropped == 0
    assert link.dropped == 1
    server.close()
    with pytest.raises(LinkError, match="lost"):
        until(link.read, link)


def test_a_terminal_behind_a_url_that_hangs_up(master: PtyLink, keep: Keep) -> None:
    link = keep(open_url(f"spy://{master.path}?file=/dev/null"))
    assert not link.ready()
    assert master.write(b"x")
    assert receive(link, 1) == b"x"
    while link.write(b"y" * 997):  # nobody reads the master
        assert link.dropped == 0
    master.close()
    until(link.ready, link)
    with pytest.raises(LinkError, match="lost"):
        link.read()


@pytest.mark.parametrize("url", ["socket://127.0.0.1:1", "rfc2217://127.0.0.1:1", "hwgrep://no such thing"])
def test_a_url_that_cannot_be_opened(url: str) -> None:
    with pytest.raises(LinkError, match="cannot be opened") as caught:
        open_link(url, clock=StepClock())
    assert caught.value.link == url


# Pseudo-terminals


def test_a_pty_is_raw_before_anybody_opens_it(master: PtyLink) -> None:
    every = bytes(range(256))
    assert master.write(every)
    fd = os.open(master.path, os.O_RDWR | os.O_NOCTTY)  # as a program does that sets nothing up
    try:
        got = b""
        while len(got) < 256 and select.select([fd], [], [], 5)[0]:
            got += os.read(fd, 1000)
        assert got == every
        assert not master.ready()  # no echo
        os.write(fd, every)
        assert receive(master, 256) == every
    finally:
        os.close(fd)
    assert master.read() == b""  # it may leave, and come back
    assert master.write(b"more")


def test_names_show_the_path(tmp_path: Path, master: PtyLink, keep: Keep) -> None:
    link = str(tmp_path / "arva0")
    assert master.name == f"pty ({master.path})"
    other = keep(PtyLink(link))
    assert other.name == f"pty:{link} ({other.path})"


def test_a_symlink_leads_there_until_close(tmp_path: Path, keep: Keep) -> None:
    link = tmp_path / "arva0"
    near = keep(PtyLink(str(link)))
    far = keep(open_serial(str(link)))
    assert near.write(b"x")
    assert receive(far, 1) == b"x"
    near.close()
    assert not link.is_symlink()


def test_a_stale_symlink_is_replaced(tmp_path: Path, keep: Keep) -> None:
    link = tmp_path / "arva0"
    link.symlink_to("/dev/pts/no-such")
    near = keep(PtyLink(str(link)))
    assert os.readlink(link) == near.path


def test_a_symlink_a_killed_run_left_to_the_same_device(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, keep: Keep
) -> None:
    link = tmp_path / "arva0"
    pair = os.openpty()
    link.symlink_to(os.ttyname(pair[1]))
    monkeypatch.setattr(os, "openpty", lambda: pair)
    keep(PtyLink(str(link))).close()
    assert not link.is_symlink()


def test_a_live_symlink_a_file_and_a_directory_are_left_alone(tmp_path: Path) -> None:
    live, file, folder = tmp_path / "live", tmp_path / "file", tmp_path / "folder"
    live.symlink_to("/dev/null")
    (unplugged := tmp_path / "unplugged").symlink_to("/dev/serial/by-id/x")
    file.write_bytes(b"precious")
    folder.mkdir()
    for path, what in (
        (live, "is a symlink to /dev/null, which another program made; take another name"),
        (unplugged, "is a symlink to /dev/serial/by-id/x, which another program made"),
        (file, "exists and is not a symlink"),
        (folder, "exists and is not a symlink"),
        (tmp_path / "none" / "x", "cannot be created: No such file"),
    ):
        with pytest.raises(LinkError, match=what):
            PtyLink(str(path))
    assert os.readlink(live) == "/dev/null"
    assert file.read_bytes() == b"precious"


def test_a_refused_symlink_leaks_no_descriptor(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    before = sorted(os.listdir("/proc/self/fd"))
    with pytest.raises(LinkError):
        PtyLink(str(tmp_path / "file"))
    assert sorted(os.listdir("/proc/self/fd")) == before


def test_somebody_elses_symlink_stays(tmp_path: Path, keep: Keep) -> None:
    link = tmp_path / "arva0"
    near = keep(PtyLink(str(link)))
    link.unlink()
    link.symlink_to("/dev/null")
    near.close()
    assert os.readlink(link) == "/dev/null"


def test_no_pseudo_terminals(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "tty", None)  # importing it fails as on Windows
    with pytest.raises(LinkError, match="no pseudo-terminals; use tcpin"):
        PtyLink()


# Which ports there are


def info(device: str, **fields: Any) -> SimpleNamespace:
    nothing = dict.fromkeys(("vid", "pid", "manufacturer", "product", "location"))
    return SimpleNamespace(**{"device": device, "description": "n/a", **nothing, **fields})


@every(
    "fields, autopilot",
    [
        ({"vid": 0x1209, "pid": 0x5740, "manufacturer": "ArduPilot", "product": "fmuv3"}, True),
        ({"vid": 0x1209, "pid": 0x5741}, True),
        ({"vid": 0x26AC, "pid": 0x0011}, True),
        ({"vid": 0x2DAE, "pid": 0x1016}, True),
        ({"vid": 0x3162, "pid": 0x004B}, True),
        ({"vid": 0x3163, "pid": 0x004C}, True),
        ({"vid": 0x0483, "pid": 0x5740, "product": "MatekH743"}, True),
        ({"vid": 0x0483, "pid": 0x5740, "product": "mRoControlZeroF7"}, True),
        ({"description": "PX4 FMU v6X.x"}, True),
        ({"description": "CubeOrange+"}, True),
        ({"vid": 0x1209, "pid": 0x0001, "product": "something else"}, False),
        ({"vid": 0x0483, "pid": 0x5740, "product": "STM32 Virtual COM Port"}, False),
        ({"vid": 0x2341, "pid": 0x0043, "manufacturer": "Arduino", "product": "Arduino Uno"}, False),
        ({"vid": 0x0403, "pid": 0x6001, "product": "FT232R USB UART"}, False),
        ({"vid": 0x26AC, "pid": 0x0015, "product": "PX4 Flow"}, False),
        ({}, False),
    ],
)
def test_looks_like_an_autopilot(monkeypatch: pytest.MonkeyPatch, fields: Any, autopilot: bool) -> None:
    monkeypatch.setattr("serial.tools.list_ports.comports", lambda: [info("/dev/ttyACM0", **fields)])
    (port,) = list_ports()
    assert port.autopilot is autopilot


def test_ports_are_described_and_in_order(monkeypatch: pytest.MonkeyPatch) -> None:
    found = [
        info("/dev/ttyUSB10"),
        info("/dev/ttyUSB2", vid=0x403, pid=0x6001, product="UART", manufacturer="FTDI", description="UART"),
    ]
    monkeypatch.setattr("serial.tools.list_ports.comports", lambda: found)
    monkeypatch.setattr("glob.glob", lambda pattern: ["/dev/serial/by-id/usb-FTDI"])
    real = {"/dev/serial/by-id/usb-FTDI": "/dev/ttyUSB2"}
    monkeypatch.setattr("os.path.realpath", lambda path: real.get(path, path))
    two, ten = list_ports()
    assert two == SerialPort("/dev/ttyUSB2", "/dev/serial/by-id/usb-FTDI", "UART", 0x403, 0x6001, "FTDI", "UART")
    assert two.usb == "0403:6001"
    assert ten == SerialPort("/dev/ttyUSB10")
    assert ten.usb == ""


def test_find_autopilot(tmp_path: Path) -> None:
    cube2 = SerialPort("/dev/ttyACM1", location="1-2:1.2", autopilot=True)
    cube = SerialPort("/dev/ttyACM0", by_id="/dev/serial/by-id/cube", location="1-2:1.0", autopilot=True)
    other = SerialPort("/dev/ttyACM7", location="1-3:1.0", autopilot=True)
    bare = SerialPort("COM5", autopilot=True)
    adapter = SerialPort("/dev/ttyUSB0", location="1-4:1.0")
    ports = [cube2, adapter, other, cube, bare]
    assert find_autopilot(ports) == [bare, cube, other]
    (tmp_path / "mine").symlink_to("/dev/ttyACM7")
    assert find_autopilot(ports, [str(tmp_path / "mine"), "COM5", ""]) == [cube]
    assert find_autopilot([cube, other], ["/dev/serial/by-id/cube"]) == [other]
    assert find_autopilot([adapter]) == []
