"""Links that cannot be opened, or stay silent: exit 3 before the first heartbeat."""

from __future__ import annotations

import grp
import os
import shutil
import socket
import threading
from collections.abc import Iterator

import pytest
import serial

from arva_hil.clock import RealClock
from arva_hil.links.pty import PtyLink
from arva_hil.links.serial_ports import list_ports
from arva_hil.mavlink.codec import Encoder, dialect
from arva_hil.runtime.loop import run
from tests.free_ports import free_port

from .far_ends import (
    DEADLINE_S,
    ORDINARY,
    Arva,
    Autopilot,
    Consumer,
    Denier,
    Keep,
    Start,
    heartbeat,
    read_frames,
    read_until_heard,
)

# -- before anything runs ----------------------------------------------------------------------------------


@pytest.mark.parametrize("side", ["--port", "--autopilot"])
def test_a_serial_port_that_is_not_there(arva: Arva, side: str) -> None:
    other = "--autopilot" if side == "--port" else "--port"
    code, out, err = arva(other, "pty", side, "/dev/ttyNONE7")
    assert (code, out) == (3, "")
    assert "arva-hil: /dev/ttyNONE7: no such port; the ports here are " in err
    assert all(port.device in err for port in list_ports()[:10])


@pytest.mark.skipif(bool(ORDINARY) and not shutil.which("setpriv"), reason="root may open everything")
def test_a_serial_port_without_permission_names_the_group_to_join(start: Start, line: PtyLink) -> None:
    group = next(entry for entry in grp.getgrall() if entry.gr_name != "root")
    if os.geteuid() == 0:
        os.chown(line.path, -1, group.gr_gid)
    os.chmod(line.path, 0o060)
    name = grp.getgrgid(os.stat(line.path).st_gid).gr_name
    program = start("--autopilot", "pty", "--port", line.path, before=ORDINARY)
    assert program.ends() == 3
    assert f"{line.path}: permission denied; add yourself to group {name}: sudo usermod -aG {name}" in program.err


def test_a_busy_serial_port_names_who_holds_it(start: Start, line: PtyLink) -> None:
    with serial.Serial(line.path, exclusive=True):
        program = start("--autopilot", "pty", "--port", line.path)
        assert program.ends() == 3
    assert f"arva-hil: {line.path}: busy: held by {os.getpid()} (" in program.err
    assert "close the other program" in program.err


def test_a_file_is_no_serial_port(arva: Arva) -> None:
    code, _, err = arva("--autopilot", "pty", "--port", __file__)
    assert code == 3
    assert f"{__file__}: is a file, not a serial port" in err


def test_a_log_is_no_place_for_frames(arva: Arva) -> None:
    code, _, err = arva("--autopilot", "pty", "--port", "flight.tlog")
    assert code == 2
    assert "--port flight.tlog: this is a log: frames cannot be sent there" in err


def test_a_tcp_server_that_is_not_there_in_time(arva: Arva) -> None:
    port = free_port(socket.SOCK_STREAM)
    code, _, err = arva("--port", "pty", "--autopilot", f"tcp:127.0.0.1:{port}", "--timeout", 0.5)
    assert code == 3
    why = f"tcp:127.0.0.1:{port}: connection refused; is the autopilot running?"
    assert f"\nwaiting for {why}\n" in err
    assert f"\nerror: no autopilot was found: {why}\n" in err


def test_an_address_where_somebody_listens_already(arva: Arva, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("arva_hil.links.tcp.getpid", lambda: 0)  # the test has the address, not the program
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
        code, _, err = arva("--port", "pty", "--autopilot", f"udpin:127.0.0.1:{port}")
    assert code == 3
    assert "another program listens there" in err
    assert f"held by {os.getpid()} (" in err


# -- no autopilot ------------------------------------------------------------------------------------------


def test_nothing_is_heard(arva: Arva) -> None:
    code, _, err = arva("--port", "pty", "--autopilot", "pty", "--timeout", 0.2)
    assert code == 3
    assert "error: no byte came: is the autopilot powered" in err


def test_a_run_shorter_than_the_timeout_that_heard_nothing_is_no_success(arva: Arva) -> None:
    assert arva("--port", "pty", "--autopilot", "pty", "--duration", 0.2).code == 3


def test_bytes_but_no_packets_hint_at_the_baud_rate(start: Start, line: PtyLink) -> None:
    program = start("--port", "pty", "--autopilot", f"{line.path},9600", "--timeout", 0.5)
    program.says("scenario")
    line.write(bytes(n * 7 % 251 for n in range(1000)))
    assert program.ends() == 3
    assert "1000 bytes came, but no MAVLink packet: is the baud rate right" in program.err


def test_only_a_ground_station_is_heard(start: Start, line: PtyLink) -> None:
    program = start("--port", "pty", "--autopilot", line.path, "--timeout", 0.5)
    program.says("scenario")
    line.write(heartbeat(Encoder(255, 190), dialect.MAV_TYPE_GCS, dialect.MAV_AUTOPILOT_INVALID))
    assert program.ends() == 3
    assert "no autopilot's heartbeat: heartbeats of gcs from 255/190 ×1" in program.err


# -- an autopilot that gives no position -------------------------------------------------------------------


@pytest.fixture(params=["MAV_RESULT_DENIED", "MAV_RESULT_UNSUPPORTED"])
def denial(request: pytest.FixtureRequest, line: PtyLink) -> Iterator[str]:
    """An autopilot on `line` that refuses every request; what it answers."""
    stop = threading.Event()
    clock = RealClock()
    denier = Denier(line, getattr(dialect, request.param))
    thread = threading.Thread(target=lambda: run([denier], clock, stopped=stop.is_set))
    thread.start()
    yield request.param
    stop.set()
    thread.join(DEADLINE_S)


def test_a_denied_position_is_a_warning_and_frames_go_on_with_no_signal(
    start: Start, keep: Keep, line: PtyLink, denial: str
) -> None:
    out = keep(PtyLink())
    program = start("--autopilot", line.path, "--port", out.path, "--rate", 20)
    for stream in ("GLOBAL_POSITION_INT", "ATTITUDE"):
        program.says(rf"\nwarning: {stream}.*{denial}")
    frames = read_frames(out, 10)
    program.process.terminate()
    assert program.ends() == 130
    assert not any(channel.valid for frame in frames for channel in frame.channels)


# -- a vehicle that is silent ------------------------------------------------------------------------------


def test_a_vehicle_that_falls_silent_is_reported_and_frames_go_on(start: Start, line: PtyLink, keep: Keep) -> None:
    """Nothing is lost that could be seen on the link: only no more packets come."""
    link = keep(PtyLink())
    autopilot = Autopilot(link)
    program = start("--port", line.path, "--autopilot", link.path, "--rate", 50, "--max-age", 0.3)
    read_until_heard(line)
    autopilot.pause()
    program.says("warning: no pose: frames have no signal until there is one")
    consumer = Consumer(line)
    consumer.read(0)
    assert not any(frame.channels[0].valid for frame in consumer.read(5))
    program.stops()
