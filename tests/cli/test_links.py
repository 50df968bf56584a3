"""Links that cannot be opened or stay silent (exit 3 before the first heartbeat), are lost, or come back."""

from __future__ import annotations

import grp
import json
import os
import shutil
import socket
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import serial

from arva_hil.clock import RealClock
from arva_hil.links.pty import PtyLink
from arva_hil.links.serial_ports import list_ports
from arva_hil.links.tcp import TcpLink, TcpServerLink
from arva_hil.links.udp import UdpOutLink
from arva_hil.mavlink.codec import Encoder, dialect
from arva_hil.runtime.loop import run
from tests.free_ports import free_port
from tests.said import says

from .far_ends import (
    DEADLINE_S,
    ORDINARY,
    SPEED,
    Arva,
    Autopilot,
    Consumer,
    Denier,
    Keep,
    Start,
    hears,
    heartbeat,
    read_frames,
    read_until_heard,
    until,
)

# -- before anything runs ----------------------------------------------------------------------------------


@pytest.mark.parametrize("side", ["--port", "--autopilot"])
def test_a_serial_port_that_is_not_there(arva: Arva, side: str) -> None:
    other = "--autopilot" if side == "--port" else "--port"
    err = arva.refused(other, "pty", side, "/dev/ttyNONE7", code=3)
    assert "arva-hil: /dev/ttyNONE7: no such port; the ports here are " in err
    assert all(port.device in err for port in list_ports()[:10])


@pytest.mark.skipif(bool(ORDINARY) and not shutil.which("setpriv"), reason="root may open everything")
def test_a_serial_port_without_permission_names_the_group_to_join(start: Start, line: PtyLink) -> None:
    group = next(entry for entry in grp.getgrall() if entry.gr_name != "root")
    if os.geteuid() == 0:
        os.chown(line.path, -1, group.gr_gid)
    os.chmod(line.path, 0o060)
    name = grp.getgrgid(os.stat(line.path).st_gid).gr_name
    assert f"{line.path}: permission denied; add yourself to group {name}: sudo usermod -aG {name}" in start(
        "--autopilot", "pty", "--port", line.path, before=ORDINARY
    ).ends(3)


def test_a_busy_serial_port_names_who_holds_it(start: Start, line: PtyLink) -> None:
    with serial.Serial(line.path, exclusive=True):
        program = start("--autopilot", "pty", "--port", line.path)
        program.ends(3)
    says(program.err, f"arva-hil: {line.path}: busy: held by {os.getpid()} (", "close the other program")


def test_a_file_is_no_serial_port(arva: Arva) -> None:
    assert f"{__file__}: is a file, not a serial port" in arva("--autopilot", "pty", "--port", __file__, code=3).err


def test_a_log_is_no_place_for_frames(arva: Arva) -> None:
    assert "--port flight.tlog: this is a log: frames cannot be sent there" in arva.refused(
        "--autopilot", "pty", "--port", "flight.tlog"
    )


def test_a_tcp_server_that_is_not_there_in_time(arva: Arva) -> None:
    port = free_port(socket.SOCK_STREAM)
    err = arva("--port", "pty", "--autopilot", f"tcp:127.0.0.1:{port}", "--timeout", 0.5, code=3).err
    why = f"tcp:127.0.0.1:{port}: connection refused; is the autopilot running?"
    says(err, f"\nwaiting for {why}\n", f"\nerror: no autopilot was found: {why}\n")


def test_an_address_where_somebody_listens_already(arva: Arva, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("arva_hil.links.tcp.getpid", lambda: 0)  # the test has the address, not the program
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
        err = arva("--port", "pty", "--autopilot", f"udpin:127.0.0.1:{port}", code=3).err
    says(err, "another program listens there", f"held by {os.getpid()} (")


# -- no autopilot ------------------------------------------------------------------------------------------


def test_nothing_is_heard(arva: Arva) -> None:
    err = arva("--port", "pty", "--autopilot", "pty", "--timeout", 0.2, code=3).err
    assert "error: no byte came: is the autopilot powered" in err


def test_a_run_shorter_than_the_timeout_that_heard_nothing_is_no_success(arva: Arva) -> None:
    arva("--port", "pty", "--autopilot", "pty", "--duration", 0.2, code=3)


STATION = heartbeat(Encoder(255, 190), dialect.MAV_TYPE_GCS, dialect.MAV_AUTOPILOT_INVALID)


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (bytes(n * 7 % 251 for n in range(1000)), "1000 bytes came, but no MAVLink packet: is the baud rate right"),
        (STATION, "no autopilot's heartbeat: heartbeats of gcs from 255/190 ×1"),
    ],
    ids=["no packets", "only a ground station"],
)
def test_what_is_heard_instead_of_an_autopilot_is_named(start: Start, line: PtyLink, data: bytes, said: str) -> None:
    program = start("--port", "pty", "--autopilot", f"{line.path},9600", "--timeout", 0.5).after("scenario")
    line.write(data)
    assert said in program.ends(3)


# -- an autopilot that gives no position -------------------------------------------------------------------


@pytest.fixture(params=["MAV_RESULT_DENIED", "MAV_RESULT_UNSUPPORTED"])
def denial(request: pytest.FixtureRequest, line: PtyLink) -> Iterator[str]:
    """An autopilot on `line` that refuses every request; what it answers."""
    stop = threading.Event()
    clock = RealClock(SPEED)
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
    program = start("--autopilot", line.path, "--port", out.path, "--rate", 20).after(
        *(rf"\nwarning: {stream}.*{denial}" for stream in ("GLOBAL_POSITION_INT", "ATTITUDE"))
    )
    frames = read_frames(out, 10)
    program.stops()
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
    while consumer.read(1)[-1].channels[0].valid:
        assert len(consumer.frames) < 10  # it was on its way: the terminal hands it over a little later
    assert not any(frame.channels[0].valid for frame in consumer.read(5))
    program.stops()


# -- links that are lost while `run` goes on, and come back ----------------------------------------------------


@pytest.fixture(params=["pty", "tcp"])
def plug(request: pytest.FixtureRequest, tmp_path: Path, keep: Keep) -> Callable[[], Any]:
    """Makes a far end, always at the same place, whose address is `plug.url`."""
    if request.param == "pty":
        path = str(tmp_path / "line")
        made: Callable[[], Any] = lambda: keep(PtyLink(path))  # noqa: E731
        made.url = path  # type: ignore[attr-defined]
        return made
    port = free_port(socket.SOCK_STREAM)
    made = lambda: keep(TcpServerLink("127.0.0.1", port))  # noqa: E731
    made.url = f"tcp:127.0.0.1:{port}"  # type: ignore[attr-defined]
    return made


def test_an_autopilot_unplugged_and_plugged_again(
    start: Start, keep: Keep, line: PtyLink, plug: Any, tmp_path: Path
) -> None:
    first = keep(Autopilot(plug()))
    program = start(
        *("--port", line.path, "--autopilot", plug.url, "--rate", 50, "--max-age", 0.3),
        *("--record", tmp_path / "record"),
    )
    consumer = Consumer(line)
    until(consumer.hears)
    first.close()
    until(lambda: not consumer.hears())
    program.says(rf"\nwarning: {plug.url}: lost: closed by the far end, searching for it")
    keep(Autopilot(plug()))
    until(consumer.hears)
    program.says(rf"\n{plug.url}: back after \d+\.\d s")
    program.stops()
    assert (consumer.decoder.lost, consumer.decoder.bad_crc) == (0, 0)
    counters = json.loads((tmp_path / "record" / "run.json").read_bytes())["counters"]
    assert (counters["autopilot_link_losses"], counters["autopilot_link_returns"]) == (1, 1)
    assert (counters["port_link_losses"], counters["skipped"]) == (0, 0)
    assert program.err.count(": lost: ") == program.err.count(": back") == 1
    assert "the autopilot's link was lost 1 ×, and came back 1 ×" in program.err


def test_a_consumer_unplugged_and_plugged_again(start: Start, autopilot: Autopilot, plug: Any, tmp_path: Path) -> None:
    line = plug()
    record = tmp_path / "record"
    program = start("--port", plug.url, "--autopilot", autopilot.address, "--rate", 50, "--record", record)
    before = read_frames(line, 60)
    line.close()
    program.says(rf"\nwarning: {plug.url}: lost")
    frames = record / "frames.csv"
    rows = len(frames.read_bytes().splitlines())
    until(lambda: len(frames.read_bytes().splitlines()) > rows + 60)  # more than are written late: some are dropped
    after = read_frames(plug(), 20)
    program.says(rf"\n{plug.url}: back")
    program.stops()
    assert hears(before[-1])
    assert all(map(hears, after))  # the autopilot's side went on all the time
    counters = json.loads((record / "run.json").read_bytes())["counters"]
    assert (counters["port_link_losses"], counters["port_link_returns"]) == (1, 1)
    assert counters["dropped"] > 0
    assert counters["autopilot_link_losses"] == 0
    assert "no program takes" not in program.err  # it is said already


def test_far_ends_that_are_started_after_the_emulator_are_waited_for(start: Start, keep: Keep, tmp_path: Path) -> None:
    ports = {side: free_port(socket.SOCK_STREAM) for side in ("autopilot", "port")}
    urls = {side: f"tcp:127.0.0.1:{port}" for side, port in ports.items()}
    words = [word for side, url in urls.items() for word in (f"--{side}", url)]
    program = start(*words, "--rate", 50, "--record", tmp_path / "record").after(
        f"waiting for {urls['port']}: connection refused",
        f"waiting for {urls['autopilot']}: connection refused; is the autopilot running",
    )
    consumer = Consumer(keep(TcpServerLink("127.0.0.1", ports["port"])))
    until(lambda: not consumer.hears() and len(consumer.frames) > 10)  # frames go on meanwhile
    keep(Autopilot(keep(TcpServerLink("127.0.0.1", ports["autopilot"]))))
    until(consumer.hears)
    program.says(*(f"{url}: is open" for url in urls.values()))
    assert "lost" not in program.stops()
    counters = json.loads((tmp_path / "record" / "run.json").read_bytes())["counters"]
    assert counters["autopilot_link_losses"] == counters["autopilot_link_returns"] == 0


@pytest.mark.parametrize("kind", ["tcpin", "udpin"])
def test_a_server_takes_the_next_client(start: Start, keep: Keep, line: PtyLink, kind: str) -> None:
    """The autopilot, or what forwards it, is started again; over UDP it has another port then."""
    port = free_port(socket.SOCK_DGRAM if kind == "udpin" else socket.SOCK_STREAM)
    client = {"udpin": UdpOutLink, "tcpin": TcpLink}[kind]
    url = f"{kind}:127.0.0.1:{port}"
    program = start("--port", line.path, "--autopilot", url, "--rate", 50, "--max-age", 0.3).after("frames to")
    consumer = Consumer(line)
    first = keep(Autopilot(client("127.0.0.1", port), speaks_first=True))
    until(consumer.hears)
    first.close()
    until(lambda: not consumer.hears())
    keep(Autopilot(keep(client("127.0.0.1", port)), speaks_first=True))
    until(consumer.hears)
    program.says(rf"\nwarning: {url}: lost: ", rf"\n{url}: back")
    program.stops()


def test_a_link_lost_before_the_first_heartbeat_is_the_reason_given(start: Start, keep: Keep, tmp_path: Path) -> None:
    line = keep(PtyLink(path := str(tmp_path / "fc")))
    program = start("--port", "pty", "--autopilot", path, "--timeout", 1).after("scenario")
    line.write(STATION)
    line.close()
    assert f"error: no autopilot was found: {path}: lost" in program.ends(3)


def test_who_keeps_it_from_coming_back_is_named_once(
    start: Start, autopilot: Autopilot, keep: Keep, tmp_path: Path
) -> None:
    path = str(tmp_path / "line")
    line = keep(PtyLink(path))
    program = start("--port", path, "--autopilot", autopilot.address, "--rate", 20, "--duration", 60)
    read_frames(line, 5)
    line.close()
    program.says(rf"\nwarning: {path}: lost")
    again = keep(PtyLink(str(tmp_path / "unseen")))
    with serial.Serial(again.path, exclusive=True):
        os.symlink(again.path, path)
        program.says(rf"\nwarning: {path}: busy: held by (.*, )?{os.getpid()} \(.*\); close the other program\n")
    read_frames(again, 5)
    program.says(rf"\n{path}: back")
    assert program.stops().count("busy") == 1


def test_one_port_frames_survive_an_absence(start: Start, keep: Keep, tmp_path: Path) -> None:
    path = str(tmp_path / "line")
    first = keep(Autopilot(keep(PtyLink(path))))
    program = start("--autopilot", path, "--format", "tunnel", "--rate", 20).after("readings are real")
    first.close()
    program.says("lost")
    second = keep(Autopilot(keep(PtyLink(path))))
    program.says("back")
    until(lambda: second.heard.count(b"\xa4\x57") > 10)
    program.stops()
