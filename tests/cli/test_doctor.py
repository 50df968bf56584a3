"""What is wrong, and the cure, over real links: a finding a line, a verdict, and an exit code."""

from __future__ import annotations

import contextlib
import json
import os
import re
import signal
import socket
import sys
import threading
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from arva_hil.cli import doctor
from arva_hil.cli.diagnosis import diagnosis
from arva_hil.cli.diagnosis.diagnosis import Finding, PortTraffic, Source, StreamRate, Traffic
from arva_hil.cli.diagnosis.examination import PortProbe
from arva_hil.cli.options import DEFAULT_AUTOPILOT
from arva_hil.cli.run_links import choose_autopilot
from arva_hil.clock import Clock, RealClock, StepClock
from arva_hil.events.words.text import BAD
from arva_hil.links import Address, Link, LinkError, open_link, parse
from arva_hil.links.pty import PtyLink
from arva_hil.links.serial import open_serial
from arva_hil.links.serial_ports import SerialPort
from arva_hil.links.tcp import TcpLink, TcpServerLink
from arva_hil.links.udp import UdpInLink, UdpOutLink
from arva_hil.mavlink.codec import Encoder, dialect
from arva_hil.mavlink.signing import Signing
from arva_hil.runtime.loop import Task, run
from arva_hil.simulated.vehicle import SimulatedVehicle, Simulator
from firmware_proto import Frame, encode
from tests.files import written
from tests.free_ports import free_port
from tests.said import says

from .far_ends import DEADLINE_S, HOME, Arva, Autopilot, Denier, Keep, Start, heartbeat, until

LOG = Path(__file__).parent.parent / "data" / "arducopter.tlog"
HEALTHY_S = 0.9  # as long after its first heartbeat a vehicle streams what it was asked for
HEARTBEAT_S = 1.3  # one comes within, from who speaks anyhow
GARBAGE = bytes(n * 7 % 251 for n in range(500))


def encoded(frame: Frame, boot_ms: int) -> bytes:
    return encode(frame)


class Says:
    """A far end that says the same again and again. A task for `run`."""

    def __init__(self, link: Link, *words: bytes) -> None:
        self.links = [link]
        self._words = words

    def service(self, clock: Clock) -> float:
        self.links[0].read()
        for word in self._words:
            self.links[0].write(word)
        return clock.now() + 0.1


@pytest.fixture
def serve(keep: Keep) -> Iterator[Callable[[Task], None]]:
    """Serves a far end from the first word to it until the test is over, and what is kept is closed after that."""
    over = threading.Event()
    threads: list[threading.Thread] = []

    def begin(task: Task) -> None:
        def work() -> None:
            clock = RealClock()
            while not (task.links[0].ready() or over.is_set()):
                clock.wait(clock.now() + 0.05, task.links)
            with contextlib.suppress(LinkError):
                run([task], clock, stopped=over.is_set)

        threads.append(threading.Thread(target=work))
        threads[-1].start()

    yield begin
    over.set()
    for thread in threads:
        thread.join(DEADLINE_S)


Findings = dict[str, dict[str, str]]  # by check, the last one of each


@pytest.fixture
def examine(arva: Arva) -> Callable[..., Findings]:
    """`examine(arguments…, code=…, fails=…)`: the findings, of which just these checks fail."""

    def call(*arguments: object, listen: float = 0.3, code: int = 3, fails: tuple[str, ...] = ()) -> Findings:
        ended = arva("doctor", *arguments, "--listen", listen, "--stream-rate", 20, "--json", code=(0, 1, 3), speed=1.0)
        assert "Traceback" not in ended.err
        findings = {said["check"]: said for said in map(json.loads, ended.out.splitlines())}
        assert list(findings)[-1] == "verdict"
        failed = {check for check, said in findings.items() if said["state"] == "fail"} - {"verdict"}
        assert (ended.code, failed) == (code, set(fails)), findings
        return findings

    return call


@pytest.fixture
def autopilot(keep: Keep) -> Autopilot:
    """The built-in vehicle, in real time as `examine` is: what is measured in so little time must not be hurried."""
    return keep(Autopilot(keep(PtyLink()), speed=1.0))


Examine = Callable[..., Findings]
Serve = Callable[[Task], None]  # these two are fixtures


# -- it can run ----------------------------------------------------------------------------------------------


def test_a_healthy_vehicle_can_be_run_and_the_command_is_named(
    arva: Arva, monkeypatch: pytest.MonkeyPatch, keep: Keep, line: PtyLink
) -> None:
    """Both in the time of one clock, or a busy computer would make the vehicle slow: it is asked for 50 Hz."""
    port = free_port(socket.SOCK_DGRAM)
    vehicle = Simulator([SimulatedVehicle(HOME)], [keep(UdpOutLink("127.0.0.1", port))])
    monkeypatch.setattr(doctor, "RealClock", StepClock)
    monkeypatch.setattr(doctor, "run", lambda tasks, clock, **how: run([*tasks, vehicle], clock, **how))
    _, out, err = arva("doctor", "--autopilot", f"udpin:127.0.0.1:{port}", "--port", line.path)
    lines = out.splitlines()
    assert [text.split()[1] for text in lines] == [
        *("autopilot", "link", "port", "bytes", "packets", "signing", "heartbeat", "GLOBAL_POSITION_INT", "ATTITUDE"),
        *("position", "home", "pose", "clock", "frames", "reader", "verdict"),
    ]
    assert {text.split()[0] for text in lines} <= {"ok", "note"}
    assert lines[-1].endswith(f"it can run: arva-hil run --autopilot udpin:127.0.0.1:{port} --port {line.path}")
    assert "46.0123000, 7.7456000, 1650.0 m AMSL" in lines[9]
    assert "\x1b" not in out
    assert err == "listening for 6 s\n"


def test_the_command_that_the_verdict_names_does_run(
    start: Start, examine: Examine, autopilot: Autopilot, line: PtyLink
) -> None:
    said = examine(
        *("--master", autopilot.address, "--port", line.path, "--format", "nmea", "--target-system", 1),
        listen=HEALTHY_S,
        code=0,
    )
    words = said["verdict"]["found"].split("arva-hil ")[1].split()
    assert words[-6:-1] == ["--format", "nmea", "--target-system", "1", "--stream-rate"]
    start(*words, "--duration", 1.5, speed=1.0).ends()


def test_frames_inside_mavlink_go_over_the_autopilots_link(examine: Examine, autopilot: Autopilot) -> None:
    said = examine("--autopilot", autopilot.address, "--format", "named", listen=HEALTHY_S, code=0)
    assert "port" not in said
    assert "named frames were accepted" in said["frames"]["found"]
    assert b"ARVA1_DIR" in autopilot.heard
    assert re.search(r"--format named --stream-rate \d+$", said["verdict"]["found"])  # slower if the computer is busy


def test_without_a_port_only_the_autopilots_side_is_looked_at(
    examine: Examine, autopilot: Autopilot, monkeypatch: pytest.MonkeyPatch
) -> None:
    ports = [SerialPort("/dev/ttyUSB7", vid=0x0403, pid=0x6001), SerialPort("/dev/ttyS0")]
    monkeypatch.setattr(doctor, "list_ports", lambda: ports)
    said = examine("--autopilot", autopilot.address, listen=HEALTHY_S, code=0)
    assert said["port"]["found"] == "none was named; free: /dev/ttyUSB7, /dev/ttyS0"
    assert "frames" not in said
    assert "--port /dev/ttyUSB7" in said["verdict"]["found"]


def test_a_log_is_said_to_be_one(examine: Examine) -> None:
    said = examine("--autopilot", LOG, "--port", "pty", listen=HEALTHY_S, code=0)
    assert "a log, played in real time" in said["autopilot"]["found"]
    assert said["ATTITUDE"]["found"].endswith("Hz, as recorded")


@pytest.mark.parametrize(
    ("ports", "why"),
    [
        ([], "udpin:127.0.0.1:14550, the usual port of ground stations, because there is no autopilot on USB"),
        ([SerialPort("/dev/ttyACM9", description="Pixhawk6X", autopilot=True)], "/dev/ttyACM9, on USB: Pixhawk6X"),
    ],
)
def test_what_is_chosen_without_an_autopilot_is_said_and_why(
    examine: Examine, monkeypatch: pytest.MonkeyPatch, ports: list[SerialPort], why: str
) -> None:
    def opener(address: Address, **_: Any) -> Link:
        raise LinkError(str(address), "is not there")

    monkeypatch.setattr("arva_hil.cli.run_links.list_ports", lambda: ports)
    monkeypatch.setattr(doctor, "list_ports", lambda: ports)
    monkeypatch.setattr(doctor, "open_link", opener)
    assert examine(fails=("link",))["autopilot"]["found"] == why


@pytest.mark.parametrize("port", ["/dev/ttyACM9,57600", "serial:/dev/ttyACM9", "serial:///dev/ttyACM9:57600"])
def test_the_port_for_frames_is_not_chosen_as_the_autopilot(monkeypatch: pytest.MonkeyPatch, port: str) -> None:
    monkeypatch.setattr("arva_hil.cli.run_links.list_ports", lambda: [SerialPort("/dev/ttyACM9", autopilot=True)])
    assert choose_autopilot(port) == DEFAULT_AUTOPILOT


# -- the autopilot's link ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("kind", "check", "found"),
    [
        ("tcp", "link", "connection refused"),
        ("udpout", "bytes", "no program listens there"),
        ("udpin", "bytes", "no byte came"),
    ],
)
def test_nobody_is_there(examine: Examine, kind: str, check: str, found: str) -> None:
    port = free_port(socket.SOCK_STREAM if kind == "tcp" else socket.SOCK_DGRAM)
    said = examine("--autopilot", f"{kind}:127.0.0.1:{port}", fails=(check,))
    assert found in said[check]["found"]
    assert said[check]["cure"]


def test_no_such_port(examine: Examine) -> None:
    said = examine("--autopilot", "/dev/ttyACM77", "--port", "/dev/ttyUSB77", fails=("link", "port"))
    assert said["link"]["found"] == "/dev/ttyACM77: no such port"
    assert said["verdict"]["cure"].endswith("arva-hil run --autopilot URL --port URL --stream-rate 20")


def test_instead_of_a_port_that_is_not_there_the_one_on_usb_is_named(
    examine: Examine, autopilot: Autopilot, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(doctor, "list_ports", lambda: [SerialPort("/dev/ttyUSB7", vid=0x0403, pid=0x6001)])
    said = examine("--autopilot", autopilot.address, "--port", "/dev/ttyUSB77", listen=HEALTHY_S, fails=("port",))
    assert f"--autopilot {autopilot.address} --port /dev/ttyUSB7 " in said["verdict"]["cure"]


def test_what_is_cured_elsewhere_stays_in_the_command(examine: Examine, line: PtyLink, keep: Keep) -> None:
    keep(open_serial(line.path))
    tcp = f"tcp:127.0.0.1:{free_port(socket.SOCK_STREAM)}"
    said = examine("--autopilot", tcp, "--port", line.path, fails=("link", "port"))
    assert f"--autopilot {tcp} --port {line.path}" in said["verdict"]["cure"]


@pytest.mark.parametrize("own", [False, True])
def test_a_port_that_a_running_run_holds_is_no_fault_of_the_port(
    start: Start, line: PtyLink, arva: Arva, tmp_path: Path, own: bool
) -> None:
    """Nor is its own pseudo-terminal: whoever examines that would take frames from it and send it others."""
    link = tmp_path / "arva0"
    program = start("run", "--autopilot", "pty", "--port", f"pty:{link}" if own else line.path, fresh=True).after(
        "frames to"
    )
    port = link if own else line.path
    out = arva("doctor", "--autopilot", f"pty:{tmp_path}/fc", "--port", port, "--listen", 0.2, code=3).out
    (said,) = [text for text in out.splitlines() if text.startswith("FAIL  port")]
    assert f"{port}: a running arva-hil run" in said
    assert own or f" (process {program.process.pid}) has it open" in said
    assert own or f"kill -INT {program.process.pid}" in said
    assert "frames were accepted" not in out


@pytest.mark.parametrize("other", [False, True])
def test_a_tcp_port_that_is_silent_is_told_from_one_that_another_client_has(
    examine: Examine, keep: Keep, other: bool
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server, contextlib.ExitStack() as stack:
        address = f"tcp:127.0.0.1:{server.getsockname()[1]}"
        taken = threading.Event()

        def serve_one() -> None:
            stack.enter_context(server.accept()[0])
            taken.set()

        first = threading.Thread(target=serve_one)
        first.start()
        if other:
            stack.enter_context(socket.create_connection(server.getsockname()))
            assert taken.wait(DEADLINE_S)
        said = examine("--autopilot", address, fails=("bytes",))
        first.join(DEADLINE_S)
    assert ("another client has the port" in said["bytes"]["found"]) == other
    assert ("SERIALn_PROTOCOL 2" in said["bytes"]["cure"]) == (not other)
    assert (address in said["verdict"]["cure"]) == (not other)


@pytest.mark.parametrize("side", ["link", "port"])
def test_a_busy_port_names_its_holder(examine: Examine, line: PtyLink, keep: Keep, side: str) -> None:
    keep(open_serial(line.path))
    words = ("--autopilot", line.path) if side == "link" else ("--autopilot", "pty", "--port", line.path)
    said = examine(*words, fails=("link",) if side == "link" else ("bytes", "port"))
    assert said[side]["found"].startswith(f"{line.path}: busy: held by {os.getpid()} (")
    assert said[side]["cure"] == "close the other program"


@pytest.mark.parametrize("kind", ["udpin", "tcpin"])
def test_who_listens_at_a_busy_address_is_named(
    examine: Examine, keep: Keep, kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("arva_hil.links.tcp.getpid", lambda: 0)  # the test has the address, not the program
    taken = keep(UdpInLink() if kind == "udpin" else TcpServerLink())
    said = examine("--autopilot", f"{kind}:127.0.0.1:{taken.port}", fails=("link",))
    assert f"another program listens there, held by {os.getpid()} (" in said["link"]["found"]


def test_whose_pseudo_terminal_it_is_is_named(examine: Examine, keep: Keep, tmp_path: Path) -> None:
    keep(PtyLink(str(tmp_path / "arva0")))
    said = examine("--autopilot", "pty", "--port", f"pty:{tmp_path / 'arva0'}", fails=("bytes", "port"))
    assert "which is in use: held by " in said["port"]["found"]
    assert said["port"]["cure"] == "take another name"
    assert str(tmp_path) not in said["verdict"]["cure"]


def test_a_link_that_is_lost_meanwhile(examine: Examine, serve: Serve, keep: Keep) -> None:
    class Leaves(Says):
        def service(self, clock: Clock) -> float:
            if self.links[0].ready() and self.links[0].read():
                self.links[0].close()
                raise LinkError("far end", "left")
            return clock.now() + 0.05

    server = keep(TcpServerLink())
    serve(Leaves(server))
    said = examine("--autopilot", f"tcp:127.0.0.1:{server.port}", listen=5, fails=("link", "bytes"))
    assert "lost: closed by the far end" in said["link"]["found"]


# -- bytes, baud, packets ------------------------------------------------------------------------------------


def pilot(system: int, autopilot: int = dialect.MAV_AUTOPILOT_ARDUPILOTMEGA, **options: Any) -> bytes:
    return heartbeat(Encoder(system, 1, **options), autopilot=autopilot)


STREAMS = ("GLOBAL_POSITION_INT", "ATTITUDE", "position", "pose")
TWO = (pilot(1), pilot(2, dialect.MAV_AUTOPILOT_PX4))
BOTH = r"ardupilotmega quadrotor 1/1.*px4 quadrotor 2/1"
GROUND = heartbeat(Encoder(255, 190), dialect.MAV_TYPE_GCS, dialect.MAV_AUTOPILOT_INVALID)
TIME = Encoder(1, 1).pack(dialect.MAVLink_system_time_message(0, 0))


@pytest.mark.parametrize(
    ("words", "options", "code", "fails", "check", "state", "found", "cure"),
    [
        ((GARBAGE,), (), 3, ("packets",), "packets", "fail", "none in ", ""),
        ((b"nsh> ",), (), 3, ("packets",), "packets", "fail", "PX4's shell", ""),
        ((b"boot ok\r\n",), (), 3, ("packets",), "packets", "fail", "plain text: 'boot ok", ""),
        ((pilot(1, signing=Signing(bytes(32), 0)),), (), 1, STREAMS, "signing", "note", "are signed", ""),
        ((GROUND,), (), 3, ("heartbeat",), "heartbeat", "fail", "^none from an autopilot, only gcs 255/190 ×", "here"),
        ((TIME,), (), 3, ("heartbeat",), "heartbeat", "fail", "^none from anybody$", ""),
        (TWO, (), 1, STREAMS, "heartbeat", "note", BOTH, "choose with --target-system 1 or --target-system 2"),
        (
            TWO,
            ("--target-system", 2),
            1,
            STREAMS,
            "heartbeat",
            "ok",
            r"px4 quadrotor 2/1.*ardupilotmega quadrotor 1/1",
            "^$",
        ),
    ],
)
def test_what_comes_on_a_link_is_recognised(
    examine: Examine,
    serve: Serve,
    keep: Keep,
    words: tuple[bytes, ...],
    options: tuple[object, ...],
    code: int,
    fails: tuple[str, ...],
    check: str,
    state: str,
    found: str,
    cure: str,
) -> None:
    server = keep(TcpServerLink())
    serve(Says(server, *words))
    said = examine("--autopilot", f"tcp:127.0.0.1:{server.port}", *options, code=code, fails=fails)[check]
    assert said["state"] == state
    assert re.search(found, said["found"])
    assert re.search(cure, said["cure"])


def test_garbage_on_a_serial_line_at_every_baud_rate(examine: Examine, serve: Serve, line: PtyLink) -> None:
    serve(Says(line, GARBAGE))
    said = examine("--autopilot", line.path, listen=0.2, fails=("packets", "baud"))
    assert said["baud"]["found"].startswith("no MAVLink at 115200, 57600, 921600")
    assert "probably not MAVLink" in said["baud"]["cure"]


def test_the_baud_rate_that_brings_packets_is_found_and_everything_else_looked_at(
    examine: Examine, autopilot: Autopilot, monkeypatch: pytest.MonkeyPatch
) -> None:
    def opener(address: Address, **options: Any) -> Link:
        """A line of 921600 baud, garbled both ways at any other."""
        if address.baud == 57600:
            raise LinkError(address.path, "does not know this rate")
        link = open_link(address, **options)
        if address.baud != 921600:
            read, write = link.read, link.write
            link.read = lambda: read().translate(bytes(n ^ 0x55 for n in range(256)))  # type: ignore[method-assign]
            link.write = lambda data: write(GARBAGE[: len(data)])  # type: ignore[method-assign]
        return link

    monkeypatch.setattr(doctor, "open_link", opener)
    said = examine(
        "--autopilot", f"{autopilot.address},38400", "--format", "tunnel", listen=HEARTBEAT_S, fails=("baud",)
    )
    assert said["baud"] == {
        "check": "baud",
        "state": "fail",
        "found": "921600 brings packets, 38400 does not",
        "cure": f"--autopilot {autopilot.address},921600",
    }
    assert (said["pose"]["state"], said["frames"]["state"]) == ("ok", "ok")
    assert f"--autopilot {autopilot.address},921600" in said["verdict"]["cure"]


@pytest.mark.parametrize("same", [True, False])
def test_with_a_key_it_says_whether_it_is_the_vehicles(
    examine: Examine, keep: Keep, tmp_path: Path, same: bool
) -> None:
    vehicle = keep(Autopilot(keep(PtyLink()), key=bytes(32), speed=1.0))
    file = written(tmp_path / "key", "00" * 32 if same else "11" * 32)
    file.chmod(0o600)
    how = {"code": 0} if same else {"fails": ("signing",)}
    said = examine("--autopilot", vehicle.address, "--signing-key", file, listen=1.5, **how)
    if same:
        assert (said["signing"]["state"], said["pose"]["state"]) == ("ok", "ok")
        assert f"--signing-key {file}" in said["verdict"]["found"]
    else:
        assert "every packet is ignored" in said["signing"]["found"]
        assert "--signing-key FILE" in said["verdict"]["cure"]


# -- from whom -----------------------------------------------------------------------------------------------


def test_the_autopilot_asked_for_is_another(examine: Examine, autopilot: Autopilot) -> None:
    said = examine("--autopilot", autopilot.address, "--target-system", 9, fails=("heartbeat",))
    assert said["heartbeat"]["cure"] == "--target-system 1"
    assert "--target-system 1 --stream-rate 20" in said["verdict"]["cure"]


def test_a_rate_that_is_never_reached_is_not_asked_for_again(examine: Examine, serve: Serve, line: PtyLink) -> None:
    attitude = Encoder(1, 1).pack(dialect.MAVLink_attitude_message(0, 0, 0, 0, 0, 0, 0))
    serve(Says(line, heartbeat(Encoder(1, 1)), attitude))  # 10 Hz
    said = examine(
        "--autopilot", line.path, listen=HEARTBEAT_S, code=1, fails=("GLOBAL_POSITION_INT", "position", "pose")
    )
    assert said["ATTITUDE"]["state"] == "note"
    slow = said["ATTITUDE"]["cure"].partition(",")[0]
    assert 1 <= int(slow.removeprefix("--stream-rate ")) <= 14
    assert said["verdict"]["cure"].endswith(slow)


# -- the pose ------------------------------------------------------------------------------------------------


def test_a_vehicle_without_a_fix(examine: Examine, serve: Serve, line: PtyLink) -> None:
    serve(Simulator([SimulatedVehicle(HOME, fix_after=1e6)], [line]))
    said = examine("--autopilot", line.path, "--port", "pty", listen=HEALTHY_S, code=1, fails=("position", "pose"))
    assert "no GPS fix yet" in said["position"]["found"]
    assert said["home"]["state"] == "note"
    assert said["ATTITUDE"]["state"] in ("ok", "note")  # a note if this machine is too slow for the rate


def test_a_vehicle_that_refuses_its_streams(examine: Examine, serve: Serve, line: PtyLink) -> None:
    serve(Denier(line, dialect.MAV_RESULT_UNSUPPORTED))
    said = examine("--autopilot", line.path, listen=HEALTHY_S, code=1, fails=STREAMS)
    assert "MAV_RESULT_UNSUPPORTED" in said["ATTITUDE"]["found"]
    says(said["ATTITUDE"]["cure"], "ArduPilot: SRn_EXTRA1", "PX4: MAV_n_MODE")


# -- the port ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("kind", "check", "state", "found"),
    [
        ("udpin", "frames", "fail", "0 of"),
        ("udpout", "reader", "fail", "no program listens there"),
        ("pty", "reader", "note", "no program has it open"),
    ],
)
def test_nobody_reads(examine: Examine, kind: str, check: str, state: str, found: str) -> None:
    port = "pty" if kind == "pty" else f"{kind}:127.0.0.1:{free_port(socket.SOCK_DGRAM)}"
    fails = ("bytes", check) if state == "fail" else ("bytes",)
    said = examine("--autopilot", "pty", "--port", port, fails=fails)
    assert said[check]["state"] == state
    assert found in said[check]["found"]
    assert said[check]["cure"]


@pytest.mark.parametrize("kind", ["tcp", "udpout", "serial"])
def test_a_reader_that_answers_is_known(examine: Examine, serve: Serve, keep: Keep, kind: str) -> None:
    links: dict[str, Callable[[], Any]] = {"tcp": TcpServerLink, "udpout": UdpInLink, "serial": PtyLink}
    consumer = keep(links[kind]())
    serve(Says(consumer, b"!"))
    port = consumer.path if kind == "serial" else f"{kind}:127.0.0.1:{consumer.port}"
    assert examine("--autopilot", "pty", "--port", port, fails=("bytes",))["reader"]["found"].endswith(
        "bytes came back"
    )


def test_the_other_end_of_a_pseudo_terminal_is_named(examine: Examine, line: PtyLink) -> None:
    assert examine("--autopilot", "pty", "--port", line.path, fails=("bytes",))["reader"]["found"].endswith(
        "has the other end"
    )


def test_a_client_that_is_connected_reads(keep: Keep) -> None:
    server = keep(TcpServerLink())
    keep(TcpLink("127.0.0.1", server.port))
    port_probe = PortProbe(encoded, server, parse(server.name), 0.0)
    clock = RealClock()
    until(lambda: port_probe.service(clock) and port_probe.traffic().taken)
    assert diagnosis.reader(port_probe.traffic()) == ("reader", "ok", "connected", "")


def test_who_has_a_new_pseudo_terminal_open_is_named(start: Start, line: PtyLink) -> None:
    port_probe = PortProbe(encoded, line, parse("pty"), 0.0)
    clock = RealClock()
    port_probe.service(clock)
    assert port_probe.traffic().seen == []
    until(lambda: port_probe.traffic().unread == 33)  # the kernel hands bytes over on a thread of its own
    program = start("listen", line.path, fresh=True).after("listening at")
    port_probe.service(clock)
    (who,) = port_probe.traffic().seen
    command = f"{sys.executable} -m arva_hil listen {line.path}"
    assert who == f"{program.process.pid} ({command[:60]})"


def test_a_port_that_is_lost_meanwhile(keep: Keep) -> None:
    consumer = PtyLink()
    port_probe = PortProbe(encoded, keep(open_serial(consumer.path)), parse(consumer.path), 0.0)
    consumer.close()
    port_probe.service(RealClock())
    assert diagnosis.frames(port_probe.traffic(), "binary").found.startswith(f"{consumer.path}: lost: ")


# -- how it ends ---------------------------------------------------------------------------------------------


def test_ctrl_c(start: Start, line: PtyLink) -> None:
    program = start("doctor", "--autopilot", line.path, "--listen", 60).after("listening for 60 s")
    program.stops(signal.SIGINT)
    assert b"verdict" not in program.out


def test_ctrl_c_while_baud_rates_are_tried(start: Start, line: PtyLink, serve: Serve) -> None:
    serve(Says(line, GARBAGE))
    start("doctor", "--autopilot", line.path, "--listen", 1).after("trying other baud rates").stops(signal.SIGINT)


@pytest.mark.parametrize(("no_color", "coloured"), [("", True), ("1", False)])
def test_states_are_coloured_on_a_terminal(start: Start, no_color: str, coloured: bool) -> None:
    master, slave = os.openpty()
    program = start("doctor", "--autopilot", "/dev/ttyACM77", stdout=slave, env={**os.environ, "NO_COLOR": no_color})
    os.close(slave)
    program.ends(3)
    shown = os.read(master, 65536).decode()
    os.close(master)
    assert (f"\x1b[38;5;{BAD}mFAIL\x1b[0m" in shown) == coloured
    assert ("\x1b" in shown) == coloured


def test_what_nobody_foresaw_is_one_line(arva: Arva, monkeypatch: pytest.MonkeyPatch, line: PtyLink) -> None:
    monkeypatch.setattr("arva_hil.cli.diagnosis.diagnosis.silence", lambda *_, **__: 1 / 0)
    err = arva("doctor", "--autopilot", line.path, "--listen", 0.2, code=1).err
    assert "arva-hil: unexpected ZeroDivisionError" in err


# -- what measurements mean: each finding by tables, how they add up to an exit code and a verdict -------------


PILOT = Source(1, 1, "ardupilotmega quadrotor", True, 6, 1.0)
OTHER = Source(2, 1, "px4 quadrotor", True, 6, 1.0)
STATION = Source(255, 190, "gcs", False, 6, 1.0)
CLEAN = Traffic(seconds=6.0, size=12_000, packets=600, old=0, signed=0, bad=0)
TRAFFIC = PortTraffic("serial", "/dev/ttyUSB0", 12, 0)
PLACE = (46.0123, 7.7456, 1650.0)


def both(cure: str) -> bool:
    """Whether it helps with either autopilot."""
    return "ArduPilot: " in cure and "PX4: " in cure


def finds(finding: Finding | None, check: str, state: str, found: str) -> str:
    """The finding of a check, with these words in it. Returns the cure."""
    assert finding
    assert (finding.check, finding.state) == (check, state)
    assert found in finding.found
    return finding.cure


# -- the autopilot's link ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("kind", "cure"),
    [
        ("serial", "SERIALn_PROTOCOL 2"),
        ("udpin", "14030 at 8 Hz"),
        ("udpin", "udpin:127.0.0.1:14445"),
        ("udpout", "MAV_n_UDP_PRT"),
        ("tcp", "each port has one client"),
        ("tcpin", "TCP client"),
        ("pyserial", "SERIALn_BAUD"),
    ],
)
def test_silence_has_a_cure_for_each_kind_of_link(kind: str, cure: str) -> None:
    finding = diagnosis.silence(kind, 6.0)
    assert (finding.check, finding.state, finding.found) == ("bytes", "fail", "no byte came in 6.0 s")
    assert cure in finding.cure
    assert both(finding.cure)


@pytest.mark.parametrize(
    ("accepted", "found", "cure", "never"),
    [
        (True, "is accepted, but nothing is sent", "SERIALn_PROTOCOL 2", "another client"),
        (False, "another client has the port", "take another one", "SERIALn_PROTOCOL"),
    ],
)
def test_a_port_that_is_not_mavlink_is_told_from_one_that_another_client_has(
    accepted: bool, found: str, cure: str, never: str
) -> None:
    finding = diagnosis.silence("tcp", 6.0, accepted=accepted)
    assert found in finding.found
    assert cure in finding.cure
    assert never not in finding.found + finding.cure
    assert both(finding.cure)


def test_a_far_machine_that_refuses_is_named() -> None:
    assert diagnosis.silence("udpout", 6.0, refused=True).found.endswith("no program listens there")


@pytest.mark.parametrize(
    ("sample", "found"),
    [
        (bytes(n * 7 % 251 for n in range(100)), "none in 100 bytes"),
        (b"", "none in 100 bytes"),
        (b"\x81$G\xb5\x62\x99", "none in 100 bytes"),
        (b"xx\xa4\x57\x01\x1b", "none in 100 bytes, but frames of a receiver"),
        (b"\xb5\x62\x01\x07", "none in 100 bytes, but u-blox: a GPS receiver"),
        (b"$GNGGA,1,2", "none in 100 bytes, but NMEA: a GPS receiver"),
        (b"\r\nnsh> ", "none in 100 bytes, but PX4's shell"),
        (b"Init ArduCopter\r\n\r\nFree RAM: 1234", "but plain text: 'Init ArduCopter Free RAM: 1234'"),
    ],
)
def test_bytes_that_are_no_packets_are_recognised(sample: bytes, found: str) -> None:
    finding = diagnosis.garbage("serial", 100, sample)
    assert both(finds(finding, "packets", "fail", found))
    assert ("but" in finding.found) == ("but" in found)


def test_the_baud_rate_that_works_is_the_cure() -> None:
    finding = diagnosis.baud("/dev/ttyACM0", (115200, 57600), 57600)
    assert finding == ("baud", "fail", "57600 brings packets, 115200 does not", "--autopilot /dev/ttyACM0,57600")


def test_no_baud_rate_works() -> None:
    finding = diagnosis.baud("/dev/ttyACM0", (115200, 57600), None)
    assert (finding.state, finding.found) == ("fail", "no MAVLink at 115200, 57600")
    assert finding.cure.startswith("the port's protocol is probably not MAVLink")


@pytest.mark.parametrize(
    ("traffic", "state", "found"),
    [
        (CLEAN, "ok", "600 in 6.0 s, 2.0 kB/s, MAVLink 2, no bad checksums"),
        (replace(CLEAN, old=600), "ok", "MAVLink 1, no bad"),
        (replace(CLEAN, old=7), "ok", "MAVLink 2, 7 of them MAVLink 1, no bad"),
        (replace(CLEAN, bad=2), "ok", "0.3% bad checksums"),
        (replace(CLEAN, packets=2, bad=2), "ok", "50.0% bad checksums"),  # the beginning of a stream
        (replace(CLEAN, bad=200), "note", "25.0% bad checksums"),
    ],
)
def test_packets(traffic: Traffic, state: str, found: str) -> None:
    assert both(finds(diagnosis.packets(traffic), "packets", state, found)) == (state == "note")


def test_signing() -> None:
    assert diagnosis.signing(CLEAN) == ("signing", "ok", "not signed", "")
    assert both(
        finds(diagnosis.signing(replace(CLEAN, signed=600)), "signing", "note", "600 of 600 packets are signed")
    )


@pytest.mark.parametrize(
    ("refused", "state", "found"),
    [
        ({"unsigned": 0, "forged": 0}, "ok", "all 600 packets are signed with the key"),
        ({"unsigned": 5, "forged": 0}, "note", "595 of 600 packets are signed with the key; ignored: 5 unsigned"),
        ({"unsigned": 599, "forged": 1}, "fail", "every packet is ignored: 599 unsigned, 1 forged"),
    ],
)
def test_signing_with_a_key(refused: dict[str, int], state: str, found: str) -> None:
    finding = diagnosis.signing(replace(CLEAN, signed=600, refused=refused))
    assert (finding.state, finding.found) == (state, found)
    assert both(finding.cure) == (state == "fail")
    assert diagnosis.exit_code([finding]) == (3 if state == "fail" else 0)


def test_strangers() -> None:
    assert diagnosis.other_senders(0, "") is None
    found = "7 datagrams of other senders are ignored; the first was from 10.0.0.9:5555"
    finds(diagnosis.other_senders(7, "10.0.0.9:5555"), "strangers", "note", found)


@pytest.mark.parametrize(
    ("sources", "followed", "target", "state", "found", "cure"),
    [
        ([PILOT], (1, 1), (None, None), "ok", "ardupilotmega quadrotor 1/1 ×6 at 1.0 Hz is followed", ""),
        ([PILOT, STATION], (1, 1), (None, None), "ok", "is followed; also gcs 255/190 ×6 at 1.0 Hz", ""),
        ([PILOT, OTHER], (2, 1), (None, None), "note", "px4 quadrotor 2/1", "--target-system 1 or --target-system 2"),
        ([PILOT, OTHER], (2, 1), (2, None), "ok", "px4 quadrotor 2/1", ""),
        ([], None, (None, None), "fail", "none from anybody", "forward HEARTBEAT"),
        ([STATION], None, (None, None), "fail", "none from an autopilot, only gcs 255/190", "forward the vehicle here"),
        ([PILOT], None, (7, None), "fail", "none from 7/1, but ardupilotmega", "--target-system 1"),
        ([replace(PILOT, component=9)], None, (None, None), "fail", "none from any/1", "--target-component 9"),
        ([replace(PILOT, hz=0.3)], (1, 1), (None, None), "note", "at 0.3 Hz", "loses packets"),
        ([replace(PILOT, count=1, hz=None)], (1, 1), (None, None), "ok", "×1 is followed", ""),
    ],
)
def test_heartbeats(
    sources: list[Source],
    followed: tuple[int, int] | None,
    target: tuple[int | None, int | None],
    state: str,
    found: str,
    cure: str,
) -> None:
    named = finds(diagnosis.heartbeat(sources, followed, target), "heartbeat", state, found)
    assert cure in named
    assert bool(cure) == bool(named)


# -- the pose ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["GLOBAL_POSITION_INT", "ATTITUDE"])
@pytest.mark.parametrize(
    ("count", "hz", "said", "state", "found"),
    [
        (300, 49.6, "", "ok", "49.6 Hz, 50 were asked for"),
        (300, 35.1, "", "ok", "35.1 Hz"),
        (60, 10.2, "SET_MESSAGE_INTERVAL: never answered", "note", "10.2 Hz, 50 were asked for (SET_MESSAGE"),
        (60, 0.0, "", "fail", "60 came, none in the last 2 s"),
        (0, 0.0, "SET_MESSAGE_INTERVAL: MAV_RESULT_DENIED ×3", "fail", "none came (SET_MESSAGE_INTERVAL: MAV_RESULT_D"),
    ],
)
def test_streams(name: str, count: int, hz: float, said: str, state: str, found: str) -> None:
    assert both(finds(diagnosis.stream(StreamRate(name, count, hz, 50.0, said)), name, state, found)) == (state != "ok")


def test_a_position_that_is_promised_and_silent_waits_for_a_fix() -> None:
    position, attitude = (StreamRate(name, 0, 0.0, 50.0, promised=True) for name in ("GLOBAL_POSITION_INT", "ATTITUDE"))
    assert "PX4 sends no position before it has one" in diagnosis.stream(position).cure
    assert "before it has one" not in diagnosis.stream(attitude).cure


def test_a_log_is_not_measured_by_what_nobody_asked_of_it() -> None:
    assert diagnosis.stream(StreamRate("ATTITUDE", 9, 4.0, 50.0, recorded=True))[1:] == (
        "ok",
        "4.0 Hz, as recorded",
        "",
    )


@pytest.mark.parametrize(
    ("position", "state", "found"),
    [
        ((PLACE, 3, 0), "ok", "46.0123000, 7.7456000, 1650.0 m AMSL"),
        ((PLACE, 0, 0, "GPS 3d_fix, 9 satellites"), "ok", "AMSL, GPS 3d_fix, 9 satellites"),
        ((None, 3, 0, "GPS no_fix, 2 satellites"), "fail", "all zeros in 3 messages: no GPS fix yet, GPS no_f"),
        ((None, 0, 4), "fail", "out of range in 4 messages"),
        ((None, 0, 0), "fail", "unknown: no GLOBAL_POSITION_INT came"),
    ],
)
def test_position(position: tuple[Any, ...], state: str, found: str) -> None:
    assert bool(finds(diagnosis.position(*position), "position", state, found)) == (state == "fail")


def test_home() -> None:
    assert diagnosis.home(PLACE, armed=True) == ("home", "ok", "46.0123000, 7.7456000, 1650.0 m AMSL, armed", "")
    assert both(finds(diagnosis.home(None, armed=False), "home", "note", "not known yet, not armed"))


@pytest.mark.parametrize(("age_s", "state"), [(0.012, "ok"), (2.0, "ok"), (2.1, "fail"), (None, "fail")])
def test_pose(age_s: float | None, state: str) -> None:
    assert diagnosis.pose(age_s).state == state


@pytest.mark.parametrize(
    ("lags_s", "reboots", "state", "found"),
    [
        ([0.0] * 95 + [0.01] * 4 + [0.05], 0, "ok", "up to 50 ms later than the quickest, 95 % within 0 ms"),
        ([0.0] * 5 + [0.5] * 5, 0, "note", "95 % within 500 ms"),
        ([0.0], 0, "ok", "up to 0 ms"),
        ([], 0, "note", "no boot time came"),
        ([0.0], 2, "note", "boot time went back 2 ×"),
    ],
)
def test_clock(lags_s: list[float], reboots: int, state: str, found: str) -> None:
    finds(diagnosis.clock(lags_s, reboots), "clock", state, found)


@pytest.mark.parametrize(
    ("times", "now", "hz"),
    [
        ([], 9.0, 0.0),
        ([9.0], 9.5, 0.0),
        ([8.0, 8.5, 9.0], 9.0, 2.0),
        ([8.0, 8.5, 9.0], 9.5, 2 / 1.5),  # a stream that stops slows down
        ([1.0, 2.0, 3.0], 9.0, 0.0),
        ([0.0, 0.1, 8.0, 9.0], 9.0, 1.0),  # only lately
    ],
)
def test_rate(times: list[float], now: float, hz: float) -> None:
    assert diagnosis.rate(times, now) == pytest.approx(hz)


# -- the port ------------------------------------------------------------------------------------------------


def test_no_port_lists_the_candidates() -> None:
    finding = diagnosis.no_port([SerialPort("/dev/ttyS0"), SerialPort("/dev/ttyUSB3", vid=1, pid=2)])
    assert finding[:3] == ("port", "note", "none was named; free: /dev/ttyS0, /dev/ttyUSB3")
    assert finding.cure == "--port /dev/ttyUSB3, --port pty, or --format tunnel"


def test_no_port_is_proposed_that_is_not_there() -> None:
    assert diagnosis.no_port([]) == (
        "port", "note", "none was named; no serial port is free for it", "--port pty, or --format tunnel",
    )  # fmt: skip


@pytest.mark.parametrize(
    ("traffic", "state", "found"),
    [
        (TRAFFIC, "ok", "12 of 12 binary frames were accepted"),
        (replace(TRAFFIC, dropped=3), "note", "12 of 15"),
        (replace(TRAFFIC, taken=0, dropped=12), "fail", "0 of 12"),
        (replace(TRAFFIC, kind="tcpin", taken=0, dropped=12), "fail", "0 of 12"),
        (replace(TRAFFIC, lost="/dev/ttyUSB0: lost: Input/output error"), "fail", "/dev/ttyUSB0: lost"),
    ],
)
def test_frames(traffic: PortTraffic, state: str, found: str) -> None:
    assert bool(finds(diagnosis.frames(traffic, "binary"), "frames", state, found)) == (state != "ok")


@pytest.mark.parametrize(
    ("traffic", "state", "found"),
    [
        (TRAFFIC, "note", "unknown"),
        (replace(TRAFFIC, answered=4), "ok", "4 bytes came back"),
        (replace(TRAFFIC, seen=("cat",)), "ok", "cat has the other end"),
        (replace(TRAFFIC, kind="mavlink"), "note", "unknown"),
        (replace(TRAFFIC, kind="udpout"), "note", "unknown"),
        (replace(TRAFFIC, kind="udpout", refused=True), "fail", "no program listens there"),
        (replace(TRAFFIC, kind="udpin"), "ok", "a datagram came"),
        (replace(TRAFFIC, kind="tcp"), "ok", "connected"),
        (replace(TRAFFIC, kind="tcpin"), "ok", "connected"),
        (replace(TRAFFIC, kind="pty"), "ok", "a program reads it"),
        (replace(TRAFFIC, kind="pty", unread=99), "note", "no program has it open"),
        (replace(TRAFFIC, kind="pty", seen=("7 (cat)",)), "ok", "7 (cat) reads it"),
        (replace(TRAFFIC, kind="pty", seen=("7 (cat)",), unread=99), "note", "7 (cat) has it open and left 99 bytes"),
    ],
)
def test_reader(traffic: PortTraffic, state: str, found: str) -> None:
    assert bool(finds(diagnosis.reader(traffic), "reader", state, found)) == (state != "ok")


@pytest.mark.parametrize("traffic", [replace(TRAFFIC, taken=0, dropped=3), replace(TRAFFIC, lost="gone")])
def test_of_a_port_that_takes_nothing_no_reader_is_told(traffic: PortTraffic) -> None:
    assert diagnosis.reader(traffic) is None


# -- all in all ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("failed", "code"),
    [
        ([], 0),
        (["link"], 3),
        (["port"], 3),
        (["bytes"], 3),
        (["packets"], 3),
        (["packets", "baud"], 3),
        (["heartbeat"], 3),
        (["ATTITUDE", "pose"], 1),
        (["position"], 1),
        (["frames"], 1),
        (["reader"], 1),
        (["pose", "port"], 3),
    ],
)
def test_the_exit_code_and_the_verdict_are_those_of_what_failed(failed: list[str], code: int) -> None:
    findings = [Finding("home", "note", "unknown yet"), *(Finding(check, "fail", "") for check in failed)]
    verdict = diagnosis.verdict(findings, "arva-hil run …")
    assert diagnosis.exit_code(findings) == code
    assert verdict.state == ("fail" if failed else "ok")
    assert "arva-hil run …" in verdict.found + verdict.cure
    assert all(check in verdict.found for check in failed)
