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
from pathlib import Path
from typing import Any

import pytest

from arva_hil.cli import doctor
from arva_hil.cli.diagnosis import diagnosis
from arva_hil.cli.diagnosis.examination import PortProbe
from arva_hil.clock import Clock, RealClock, StepClock
from arva_hil.events.words.text import BAD
from arva_hil.links import Address, Link, LinkError, open_link, parse
from arva_hil.links.pty import PtyLink
from arva_hil.links.serial import open_serial
from arva_hil.links.serial_ports import SerialPort
from arva_hil.links.tcp import TcpLink
from arva_hil.links.tcp_server import TcpServerLink
from arva_hil.links.udp import UdpInLink, UdpOutLink
from arva_hil.mavlink.codec import Encoder, dialect
from arva_hil.mavlink.signing import Signing
from arva_hil.runtime.loop import Task, run
from arva_hil.simulated.vehicle import SimulatedVehicle, Simulator
from firmware_proto import Frame, encode
from tests.free_ports import free_port

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


class Findings(dict[str, dict[str, str]]):
    """By check, the last one of each; `code` is the exit code."""

    code: int


@pytest.fixture
def examine(arva: Arva) -> Callable[..., Findings]:
    def call(*arguments: object, listen: float = 0.3) -> Findings:
        ended = arva("doctor", *arguments, "--listen", listen, "--stream-rate", 20, "--json")
        assert "Traceback" not in ended.err
        findings = Findings({said["check"]: said for said in map(json.loads, ended.out.splitlines())})
        findings.code = ended.code
        assert list(findings)[-1] == "verdict"
        return findings

    return call


Examine = Callable[..., Findings]


def failed(findings: Findings) -> set[str]:
    return {check for check, said in findings.items() if said["state"] == "fail"} - {"verdict"}


# -- it can run ----------------------------------------------------------------------------------------------


def test_a_healthy_vehicle_can_be_run_and_the_command_is_named(
    arva: Arva, monkeypatch: pytest.MonkeyPatch, keep: Keep, line: PtyLink
) -> None:
    """Both in the time of one clock, or a busy computer would make the vehicle slow: it is asked for 50 Hz."""
    port = free_port(socket.SOCK_DGRAM)
    vehicle = Simulator([SimulatedVehicle(HOME)], [keep(UdpOutLink("127.0.0.1", port))])
    monkeypatch.setattr(doctor, "RealClock", StepClock)
    monkeypatch.setattr(doctor, "run", lambda tasks, clock, **how: run([*tasks, vehicle], clock, **how))
    code, out, err = arva("doctor", "--autopilot", f"udpin:127.0.0.1:{port}", "--port", line.path)
    assert code == 0
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
    )
    words = said["verdict"]["found"].split("arva-hil ")[1].split()
    assert words[-6:-1] == ["--format", "nmea", "--target-system", "1", "--stream-rate"]
    assert start(*words, "--duration", 1.5).ends() == 0


@pytest.mark.parametrize("kind", ["udpin", "tcp"])
def test_over_the_network(examine: Examine, keep: Keep, kind: str) -> None:
    if kind == "udpin":
        port = free_port(socket.SOCK_DGRAM)
        keep(Autopilot(keep(UdpOutLink("127.0.0.1", port)), speaks_first=True))
    else:
        server = keep(TcpServerLink())
        port = server.port
        keep(Autopilot(server))
    said = examine("--autopilot", f"{kind}:127.0.0.1:{port}", "--port", "pty", listen=HEARTBEAT_S)
    assert said.code == 0
    assert said["pose"]["state"] == "ok"


def test_frames_inside_mavlink_go_over_the_autopilots_link(examine: Examine, autopilot: Autopilot) -> None:
    said = examine("--autopilot", autopilot.address, "--format", "named", listen=HEALTHY_S)
    assert said.code == 0
    assert "port" not in said
    assert "named frames were accepted" in said["frames"]["found"]
    assert b"ARVA1_DIR" in autopilot.heard
    assert re.search(r"--format named --stream-rate \d+$", said["verdict"]["found"])  # slower if the computer is busy


def test_without_a_port_only_the_autopilots_side_is_looked_at(
    examine: Examine, autopilot: Autopilot, monkeypatch: pytest.MonkeyPatch
) -> None:
    ports = [SerialPort("/dev/ttyUSB7", vid=0x0403, pid=0x6001), SerialPort("/dev/ttyS0")]
    monkeypatch.setattr(doctor, "list_ports", lambda: ports)
    said = examine("--autopilot", autopilot.address, listen=HEALTHY_S)
    assert said.code == 0
    assert said["port"]["found"] == "none was named; free: /dev/ttyUSB7, /dev/ttyS0"
    assert "frames" not in said
    assert "--port /dev/ttyUSB7" in said["verdict"]["found"]


def test_a_log_is_said_to_be_one(examine: Examine) -> None:
    said = examine("--autopilot", LOG, "--port", "pty", listen=HEALTHY_S)
    assert said.code == 0
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
    said = examine()
    assert said.code == 3
    assert said["autopilot"]["found"] == why


# -- the autopilot's link ------------------------------------------------------------------------------------


def test_a_silent_line_has_a_cure_for_both_autopilots(examine: Examine, line: PtyLink) -> None:
    said = examine("--autopilot", line.path)
    assert (said.code, failed(said)) == (3, {"bytes"})
    assert "ArduPilot: SERIALn_PROTOCOL 2" in said["bytes"]["cure"]
    assert "PX4: MAV_n_CONFIG" in said["bytes"]["cure"]
    assert said["verdict"]["found"] == "it cannot run yet, because of: bytes"


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
    said = examine("--autopilot", f"{kind}:127.0.0.1:{port}")
    assert (said.code, failed(said)) == (3, {check})
    assert found in said[check]["found"]
    assert said[check]["cure"]


def test_no_such_port(examine: Examine) -> None:
    said = examine("--autopilot", "/dev/ttyACM77", "--port", "/dev/ttyUSB77")
    assert (said.code, failed(said)) == (3, {"link", "port"})
    assert said["link"]["found"] == "/dev/ttyACM77: no such port"
    assert said["verdict"]["cure"].endswith("arva-hil run --autopilot URL --port URL --stream-rate 20")


def test_instead_of_a_port_that_is_not_there_the_one_on_usb_is_named(
    examine: Examine, autopilot: Autopilot, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(doctor, "list_ports", lambda: [SerialPort("/dev/ttyUSB7", vid=0x0403, pid=0x6001)])
    said = examine("--autopilot", autopilot.address, "--port", "/dev/ttyUSB77")
    assert f"--autopilot {autopilot.address} --port /dev/ttyUSB7 " in said["verdict"]["cure"]


def test_what_is_cured_elsewhere_stays_in_the_command(examine: Examine, line: PtyLink, keep: Keep) -> None:
    keep(open_serial(line.path))
    tcp = f"tcp:127.0.0.1:{free_port(socket.SOCK_STREAM)}"
    said = examine("--autopilot", tcp, "--port", line.path)
    assert f"--autopilot {tcp} --port {line.path}" in said["verdict"]["cure"]


def test_a_port_that_a_running_run_holds_is_no_fault_of_the_port(start: Start, line: PtyLink, arva: Arva) -> None:
    program = start("run", "--autopilot", "pty", "--port", line.path, "--timeout", 60, fresh=True)
    program.says("frames to")
    _, out, _ = arva("doctor", "--autopilot", "pty", "--port", line.path, "--listen", 0.2)
    (said,) = [text for text in out.splitlines() if text.startswith("FAIL  port")]
    assert f"{line.path}: a running arva-hil run (process {program.process.pid}) has it open" in said
    assert f"kill -INT {program.process.pid}" in said


def test_a_runs_own_pseudo_terminal_is_not_taken_for_an_adapter(start: Start, arva: Arva, tmp_path: Path) -> None:
    """Its consumer may open it; whoever examines it would take frames from it and send it others."""
    program = start("--autopilot", "pty", "--port", f"pty:{tmp_path / 'arva0'}", "--timeout", 60, fresh=True)
    program.says("frames to")
    _, out, _ = arva("doctor", "--autopilot", "pty", "--port", tmp_path / "arva0", "--listen", 0.2)
    assert f"{tmp_path / 'arva0'}: a running arva-hil run" in out
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
        said = examine("--autopilot", address)
        first.join(DEADLINE_S)
    assert failed(said) == {"bytes"}
    assert ("another client has the port" in said["bytes"]["found"]) == other
    assert ("SERIALn_PROTOCOL 2" in said["bytes"]["cure"]) == (not other)
    assert (address in said["verdict"]["cure"]) == (not other)


@pytest.mark.parametrize("side", ["link", "port"])
def test_a_busy_port_names_its_holder(
    examine: Examine, autopilot: Autopilot, line: PtyLink, keep: Keep, side: str
) -> None:
    keep(open_serial(line.path))
    sides = {"link": (line.path, "pty"), "port": (autopilot.address, line.path)}[side]
    said = examine("--autopilot", sides[0], "--port", sides[1])
    assert said.code == 3
    assert said[side]["found"].startswith(f"{line.path}: busy: held by {os.getpid()} (")
    assert said[side]["cure"] == "close the other program"


@pytest.mark.parametrize("kind", ["udpin", "tcpin"])
def test_who_listens_at_a_busy_address_is_named(
    examine: Examine, keep: Keep, kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("arva_hil.links.tcp.getpid", lambda: 0)  # the test has the address, not the program
    taken = keep(UdpInLink() if kind == "udpin" else TcpServerLink())
    said = examine("--autopilot", f"{kind}:127.0.0.1:{taken.port}")
    assert said.code == 3
    assert f"another program listens there, held by {os.getpid()} (" in said["link"]["found"]


def test_whose_pseudo_terminal_it_is_is_named(
    examine: Examine, autopilot: Autopilot, keep: Keep, tmp_path: Path
) -> None:
    keep(PtyLink(str(tmp_path / "arva0")))
    said = examine("--autopilot", autopilot.address, "--port", f"pty:{tmp_path / 'arva0'}")
    assert said.code == 3
    assert "which is in use: held by " in said["port"]["found"]
    assert said["port"]["cure"] == "take another name"
    assert str(tmp_path) not in said["verdict"]["cure"]


def test_a_link_that_is_lost_meanwhile(examine: Examine, serve: Callable[[Task], None], keep: Keep) -> None:
    class Leaves(Says):
        def service(self, clock: Clock) -> float:
            if self.links[0].ready() and self.links[0].read():
                self.links[0].close()
                raise LinkError("far end", "left")
            return clock.now() + 0.05

    server = keep(TcpServerLink())
    serve(Leaves(server))
    said = examine("--autopilot", f"tcp:127.0.0.1:{server.port}", listen=5)
    assert said.code == 3
    assert "lost: closed by the far end" in said["link"]["found"]


# -- bytes, baud, packets ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("word", "found"), [(GARBAGE, "none in "), (b"nsh> ", "PX4's shell"), (b"boot ok\r\n", "plain text: 'boot ok")]
)
def test_bytes_without_packets(
    examine: Examine, serve: Callable[[Task], None], keep: Keep, word: bytes, found: str
) -> None:
    server = keep(TcpServerLink())
    serve(Says(server, word))
    said = examine("--autopilot", f"tcp:127.0.0.1:{server.port}")
    assert (said.code, failed(said)) == (3, {"packets"})
    assert found in said["packets"]["found"]


def test_garbage_on_a_serial_line_at_every_baud_rate(
    examine: Examine, serve: Callable[[Task], None], line: PtyLink
) -> None:
    serve(Says(line, GARBAGE))
    said = examine("--autopilot", line.path, listen=0.2)
    assert (said.code, failed(said)) == (3, {"packets", "baud"})
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
    said = examine("--autopilot", f"{autopilot.address},38400", "--format", "tunnel", listen=HEARTBEAT_S)
    assert (said.code, failed(said)) == (3, {"baud"})
    assert said["baud"]["found"] == "921600 brings packets, 38400 does not"
    assert said["baud"]["cure"] == f"--autopilot {autopilot.address},921600"
    assert said["pose"]["state"] == "ok"
    assert said["frames"]["state"] == "ok"
    assert f"--autopilot {autopilot.address},921600" in said["verdict"]["cure"]


def test_a_vehicle_that_signs_is_noted(examine: Examine, serve: Callable[[Task], None], line: PtyLink) -> None:
    serve(Says(line, heartbeat(Encoder(1, 1, signing=Signing(bytes(32), 0)))))
    said = examine("--autopilot", line.path)
    assert said["signing"]["state"] == "note"
    assert "are signed" in said["signing"]["found"]


@pytest.mark.parametrize("same", [True, False])
def test_with_a_key_it_says_whether_it_is_the_vehicles(
    examine: Examine, keep: Keep, tmp_path: Path, same: bool
) -> None:
    vehicle = keep(Autopilot(keep(PtyLink()), key=bytes(32)))
    file = tmp_path / "key"
    file.write_text("00" * 32 if same else "11" * 32)
    file.chmod(0o600)
    said = examine("--autopilot", vehicle.address, "--signing-key", file, listen=1.5)
    if same:
        assert (said.code, said["signing"]["state"], said["pose"]["state"]) == (0, "ok", "ok")
        assert f"--signing-key {file}" in said["verdict"]["found"]
    else:
        assert (said.code, failed(said)) == (3, {"signing"})
        assert "every packet is ignored" in said["signing"]["found"]
        assert "--signing-key FILE" in said["verdict"]["cure"]


# -- from whom -----------------------------------------------------------------------------------------------


def test_a_ground_station_is_no_vehicle(examine: Examine, serve: Callable[[Task], None], line: PtyLink) -> None:
    serve(Says(line, heartbeat(Encoder(255, 190), dialect.MAV_TYPE_GCS, dialect.MAV_AUTOPILOT_INVALID)))
    said = examine("--autopilot", line.path)
    assert (said.code, failed(said)) == (3, {"heartbeat"})
    assert said["heartbeat"]["found"].startswith("none from an autopilot, only gcs 255/190 ×")
    assert "forward the vehicle here" in said["heartbeat"]["cure"]


def test_packets_without_heartbeats(examine: Examine, serve: Callable[[Task], None], line: PtyLink) -> None:
    serve(Says(line, Encoder(1, 1).pack(dialect.MAVLink_system_time_message(0, 0))))
    said = examine("--autopilot", line.path)
    assert (said.code, failed(said)) == (3, {"heartbeat"})
    assert said["heartbeat"]["found"] == "none from anybody"


@pytest.mark.parametrize(("target", "state"), [([], "note"), (["--target-system", 2], "ok")])
def test_of_two_autopilots_one_is_chosen(
    examine: Examine, serve: Callable[[Task], None], line: PtyLink, target: list[object], state: str
) -> None:
    serve(Says(line, heartbeat(Encoder(1, 1)), heartbeat(Encoder(2, 1), autopilot=dialect.MAV_AUTOPILOT_PX4)))
    said = examine("--autopilot", line.path, *target)
    assert said["heartbeat"]["state"] == state
    assert "ardupilotmega quadrotor 1/1" in said["heartbeat"]["found"]
    assert "px4 quadrotor 2/1" in said["heartbeat"]["found"]
    assert ("choose with --target-system 1 or --target-system 2" in said["heartbeat"]["cure"]) == (not target)


def test_the_autopilot_asked_for_is_another(examine: Examine, autopilot: Autopilot) -> None:
    said = examine("--autopilot", autopilot.address, "--target-system", 9)
    assert (said.code, failed(said)) == (3, {"heartbeat"})
    assert said["heartbeat"]["cure"] == "--target-system 1"
    assert "--target-system 1 --stream-rate 20" in said["verdict"]["cure"]


def test_a_rate_that_is_never_reached_is_not_asked_for_again(
    examine: Examine, serve: Callable[[Task], None], line: PtyLink
) -> None:
    attitude = Encoder(1, 1).pack(dialect.MAVLink_attitude_message(0, 0, 0, 0, 0, 0, 0))
    serve(Says(line, heartbeat(Encoder(1, 1)), attitude))  # 10 Hz
    said = examine("--autopilot", line.path, listen=HEARTBEAT_S)
    assert said["ATTITUDE"]["state"] == "note"
    slow = said["ATTITUDE"]["cure"].partition(",")[0]
    assert 1 <= int(slow.removeprefix("--stream-rate ")) <= 14
    assert said["verdict"]["cure"].endswith(slow)


# -- the pose ------------------------------------------------------------------------------------------------


def test_a_vehicle_without_a_fix(examine: Examine, serve: Callable[[Task], None], line: PtyLink) -> None:
    serve(Simulator([SimulatedVehicle(HOME, fix_after=1e6)], [line]))
    said = examine("--autopilot", line.path, "--port", "pty", listen=HEALTHY_S)
    assert (said.code, failed(said)) == (1, {"position", "pose"})
    assert "no GPS fix yet" in said["position"]["found"]
    assert said["home"]["state"] == "note"
    assert said["ATTITUDE"]["state"] in ("ok", "note")  # a note if this machine is too slow for the rate


def test_a_vehicle_that_refuses_its_streams(examine: Examine, serve: Callable[[Task], None], line: PtyLink) -> None:
    serve(Denier(line, dialect.MAV_RESULT_UNSUPPORTED))
    said = examine("--autopilot", line.path, listen=HEALTHY_S)
    assert said.code == 1
    assert failed(said) == {"GLOBAL_POSITION_INT", "ATTITUDE", "position", "pose"}
    assert "MAV_RESULT_UNSUPPORTED" in said["ATTITUDE"]["found"]
    assert "ArduPilot: SRn_EXTRA1" in said["ATTITUDE"]["cure"]
    assert "PX4: MAV_n_MODE" in said["ATTITUDE"]["cure"]


# -- the port ------------------------------------------------------------------------------------------------


def test_a_healthy_vehicle_and_frames_that_nobody_takes(examine: Examine, autopilot: Autopilot) -> None:
    port = free_port(socket.SOCK_STREAM)
    said = examine("--autopilot", autopilot.address, "--port", f"tcpin:127.0.0.1:{port}", listen=HEALTHY_S)
    assert (said.code, failed(said)) == (1, {"frames"})
    assert said["frames"]["found"].startswith("0 of ")
    assert "start the consumer" in said["frames"]["cure"]


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
    said = examine("--autopilot", "pty", "--port", port)
    assert said[check]["state"] == state
    assert found in said[check]["found"]
    assert said[check]["cure"]


@pytest.mark.parametrize("kind", ["tcp", "udpout", "serial"])
def test_a_reader_that_answers_is_known(examine: Examine, serve: Callable[[Task], None], keep: Keep, kind: str) -> None:
    links: dict[str, Callable[[], Any]] = {"tcp": TcpServerLink, "udpout": UdpInLink, "serial": PtyLink}
    consumer = keep(links[kind]())
    serve(Says(consumer, b"!"))
    port = consumer.path if kind == "serial" else f"{kind}:127.0.0.1:{consumer.port}"
    said = examine("--autopilot", "pty", "--port", port)
    assert failed(said) == {"bytes"}
    assert said["reader"]["found"].endswith("bytes came back")


def test_the_other_end_of_a_pseudo_terminal_is_named(examine: Examine, line: PtyLink) -> None:
    said = examine("--autopilot", "pty", "--port", line.path)
    assert said["reader"]["found"].endswith("has the other end")


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
    program = start("listen", line.path, fresh=True)
    program.says("listening at")
    port_probe.service(clock)
    (who,) = port_probe.traffic().seen
    command = f"{sys.executable} -m arva_hil listen {line.path}"
    assert who == f"{program.process.pid} ({command[:60]})"


def test_a_port_that_is_lost_meanwhile(keep: Keep) -> None:
    consumer = PtyLink()
    port = keep(open_serial(consumer.path))
    port_probe = PortProbe(encoded, port, parse(consumer.path), 0.0)
    consumer.close()
    port_probe.service(RealClock())
    assert diagnosis.frames(port_probe.traffic(), "binary").found.startswith(f"{consumer.path}: lost: ")


# -- how it ends ---------------------------------------------------------------------------------------------


def test_ctrl_c(start: Start, line: PtyLink) -> None:
    program = start("doctor", "--autopilot", line.path, "--listen", 60)
    program.says("listening for 60 s")
    program.send(signal.SIGINT)
    assert program.ends() == 130
    assert b"verdict" not in program.out


def test_ctrl_c_while_baud_rates_are_tried(start: Start, line: PtyLink, serve: Callable[[Task], None]) -> None:
    serve(Says(line, GARBAGE))
    program = start("doctor", "--autopilot", line.path, "--listen", 1)
    program.says("trying other baud rates")
    program.send(signal.SIGINT)
    assert program.ends() == 130


@pytest.mark.parametrize(("no_color", "coloured"), [("", True), ("1", False)])
def test_states_are_coloured_on_a_terminal(start: Start, no_color: str, coloured: bool) -> None:
    master, slave = os.openpty()
    program = start("doctor", "--autopilot", "/dev/ttyACM77", stdout=slave, env={**os.environ, "NO_COLOR": no_color})
    os.close(slave)
    assert program.ends() == 3
    shown = os.read(master, 65536).decode()
    os.close(master)
    assert (f"\x1b[38;5;{BAD}mFAIL\x1b[0m" in shown) == coloured
    assert ("\x1b" in shown) == coloured


def test_what_nobody_foresaw_is_one_line(arva: Arva, monkeypatch: pytest.MonkeyPatch, line: PtyLink) -> None:
    monkeypatch.setattr("arva_hil.cli.diagnosis.diagnosis.silence", lambda *_, **__: 1 / 0)
    code, _, err = arva("doctor", "--autopilot", line.path, "--listen", 0.2)
    assert code == 1
    assert "arva-hil: unexpected ZeroDivisionError" in err
