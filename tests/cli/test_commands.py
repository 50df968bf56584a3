"""The smaller commands: listen, check, ports, vehicle, command, help; and `run` as a service."""

from __future__ import annotations

import errno
import json
import os
import re
import shlex
import shutil
import signal
import socket
import subprocess
import threading
import tomllib
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import pytest

from arva_hil.autopilot.following.session import Session
from arva_hil.cli.arguments import arguments_of
from arva_hil.cli.arguments import runs as arguments
from arva_hil.cli.options import CommandParser
from arva_hil.cli.outcome import INTERRUPTED, USAGE
from arva_hil.clock import RealClock
from arva_hil.emulator.ports import encoder
from arva_hil.links import Link
from arva_hil.links.pty import PtyLink
from arva_hil.links.serial_ports import list_ports
from arva_hil.links.tcp import TcpLink
from arva_hil.links.udp import UdpInLink
from arva_hil.mavlink.codec import Encoder, Parser, decode, dialect
from arva_hil.mavlink.codec import command as order
from arva_hil.registry import FORMATS
from arva_hil.simulated.arducopter import FAILSAFES
from arva_hil.simulated.vehicle import SimulatedVehicle
from firmware_proto import Channel, CommandAnswer, Frame, encode
from tests.files import written
from tests.free_ports import free_port
from tests.said import says
from tests.service_manager import Manager

from .far_ends import DEADLINE_S, HOME, PROGRAM, Arva, Keep, Start, heartbeat, until

ROOT = Path(__file__).parent.parent.parent
DEFAULT = ROOT / "configs" / "default.yaml"
LOG = ROOT / "tests" / "data" / "px4.tlog"
FRAMES = [Frame(n, 1, (Channel(7, 1, 1234 + n, -15), Channel())) for n in range(5)]


# -- listen ------------------------------------------------------------------------------------------------


def test_listen_prints_what_a_file_of_frames_says(arva: Arva, tmp_path: Path) -> None:
    _, out, err = arva("listen", written(tmp_path / "frames.bin", b"".join(map(encode, FRAMES)) + b"tail"))
    assert out.splitlines() == [f"{n:3d}  #7 mid {1234 + n} cm -15°" for n in range(5)]
    assert "5 frames, 0 lost, 0 bad checksums, 4 bytes dropped" in err


def test_listen_hears_a_port_until_it_has_heard_enough(start: Start, line: PtyLink) -> None:
    program = start("listen", line.path, "--count", 3, "--json").after(f"listening at {line.path}")
    line.write(b"".join(map(encode, FRAMES)))
    program.ends()
    objects = [json.loads(text) for text in program.out.splitlines()]
    assert [said["seq"] for said in objects] == [0, 1, 2]
    assert objects[0]["channels"][0] == {"id": 7, "zone": "mid", "d_cm": 1234, "delta_deg": -15, "marked": False}


def test_listen_says_once_that_nothing_comes_and_ends_in_time(start: Start, line: PtyLink) -> None:
    assert start("listen", line.path, "--duration", 2.5).ends().count("no frame for 2 s") == 1


def test_listen_fails_when_the_port_goes(start: Start, tmp_path: Path) -> None:
    line = PtyLink(path := str(tmp_path / "line"))
    program = start("listen", path).after("listening")
    line.close()
    assert f"arva-hil: {path}: lost" in program.ends(1)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_listen_can_be_interrupted(start: Start, line: PtyLink, number: signal.Signals) -> None:
    program = start("listen", line.path).after("listening")
    line.write(b"".join(map(encode, FRAMES)))
    until(lambda: program.out.count(b"\n") == 5)
    assert "5 frames, 0 lost" in program.stops(number)


# -- check, ports, help ------------------------------------------------------------------------------------


def test_check_accepts_every_scenario_that_comes_along(arva: Arva) -> None:
    files = sorted((ROOT / "configs").glob("*.yaml"))
    _, out, err = arva("check", *files)
    assert err == ""
    firsts = [line for line in out.splitlines() if not line.startswith("  ")]
    assert [line.split(": ok: ")[0] for line in firsts] == list(map(str, files))


def test_check_shows_the_faults_as_the_command_line_writes_them(arva: Arva, tmp_path: Path) -> None:
    file = tmp_path / "faults.yaml"
    faults = "[{drop: 0.02, from_s: 10, until_s: 60}, {interference: 20, every_s: 30, for_s: 2}]"
    file.write_text(f"transmitters: [{{id: 3, ned: [1, 2, 3]}}]\nfaults: {faults}\n")
    _, out, err = arva("check", file, DEFAULT)
    assert err == ""
    assert out.splitlines()[:3] == [
        f"{file}: ok: transmitters 3; 1 Hz, binary",
        "  fault drop=0.02@10-60",
        "  fault interference=20,every_s=30,for_s=2",
    ]
    assert out.splitlines()[3].startswith(f"{DEFAULT}: ok: ")


def test_scenarios_says_what_each_is_in_a_whole_sentence(arva: Arva) -> None:
    said = [json.loads(line)["about"] for line in arva("scenarios", "--json").out.splitlines()]
    assert [about for about in said if re.search(r"\b[A-Z]\.$", about)] == []  # cut behind an initial


def test_ports_lists_what_there_is(arva: Arva) -> None:
    devices = [port.device for port in list_ports()]
    out = arva("ports", "--json").out
    assert [json.loads(line)["device"] for line in out.splitlines()] == devices
    out = arva("ports").out
    assert all(device in out for device in devices) if devices else "no serial ports" in out


@pytest.mark.parametrize("arguments", [["--help"], ["-h"], ["help"], ["-help"]])
def test_help_names_every_command(arva: Arva, arguments: list[str]) -> None:
    _, out, err = arva(*arguments)
    assert err == ""
    for command in ("run", "replay", "demo", "search", "campaign", "listen", "check", "ports", "doctor"):
        assert re.search(rf"^  {command} ", out, re.MULTILINE)


def test_run_is_the_default_command(arva: Arva) -> None:
    assert arva("--port", "pty", "--help").out == arva("run", "--help").out


def test_help_with_one_dash_is_understood_behind_a_command_too(arva: Arva) -> None:
    assert arva("replay", "-help") == arva("replay", "--help")


def test_version_is_that_of_the_package() -> None:
    done = subprocess.run([*PROGRAM, "--version"], capture_output=True, text=True, timeout=20)
    assert (done.returncode, done.stderr) == (0, "")
    assert re.fullmatch(r"arva-hil \d+\.\d+\.\d+\n", done.stdout)


def test_a_terminal_that_knows_only_ascii_is_no_reason_to_fail(start: Start) -> None:
    program = start("run", "--help", env={**os.environ, "PYTHONIOENCODING": "ascii"})
    program.ends()
    assert program.out.isascii()


# -- stdout that nobody takes ------------------------------------------------------------------------------


def into_nothing(why: str) -> int:
    """A descriptor that takes nothing."""
    if why == "No space left on device":
        return os.open("/dev/full", os.O_WRONLY)
    reader, writer = os.pipe()
    os.close(reader)
    return writer


@pytest.mark.parametrize(
    ("why", "code", "said"),
    [
        ("No space left on device", 1, r"stdout: cannot be written: No space left on device\n$"),
        ("Broken pipe", 141, r"^$"),
    ],
)
@pytest.mark.parametrize("command", ["--help", "run --help", "listen", "check --schema"])
def test_stdout_that_takes_nothing_is_an_error_with_a_message_and_a_reader_that_has_gone_is_none(
    start: Start, tmp_path: Path, command: str, why: str, code: int, said: str
) -> None:
    arguments = command.split()
    if command == "listen":
        arguments.append(str(tmp_path / "frames.bin"))
        (tmp_path / "frames.bin").write_bytes(b"".join(map(encode, FRAMES)))
    stdout = into_nothing(why)
    program = start(*arguments, stdout=stdout)
    os.close(stdout)
    assert re.search(said, program.ends(code))


@pytest.mark.parametrize(
    ("why", "code", "message"),
    [
        ("No space left on device", 1, "-: cannot be written: No space left on device"),
        ("Broken pipe", 141, "-: the reader of this pipe went away"),
    ],
)
@pytest.mark.parametrize("option", ["--out=-", "--json"])
def test_frames_that_stdout_does_not_take_end_a_replay_and_its_record_says_why(
    start: Start, option: str, why: str, code: int, message: str, tmp_path: Path
) -> None:
    stdout = into_nothing(why)
    program = start("replay", LOG, option, "--record", tmp_path / "record", stdout=stdout)
    os.close(stdout)
    assert (f"error: {message}" in program.ends(code)) is (code == 1)
    run = json.loads((tmp_path / "record" / "run.json").read_bytes())
    assert (run["ended"], run["exit_code"]) == (message, code)


def test_listen_into_head_prints_one_line_and_no_traceback(tmp_path: Path) -> None:
    file = written(tmp_path / "frames.bin", b"".join(encode(Frame(n % 256, 1, (Channel(),))) for n in range(10_000)))
    done = subprocess.run(
        f"{shlex.join(PROGRAM)} listen {file} | head -n 1", shell=True, capture_output=True, text=True, timeout=20
    )
    assert (done.stdout, done.stderr) == ("  0  no signal\n", "")


def test_the_demo_without_pseudo_terminals_says_what_else_there_is(arva: Arva, monkeypatch: pytest.MonkeyPatch) -> None:
    def none() -> tuple[int, int]:
        raise OSError(errno.ENOSPC, "out of pty devices")

    monkeypatch.setattr("os.openpty", none)
    says(arva("demo", code=3).err, "no pseudo-terminal", "--speed max")


# -- `arva-hil listen` of bytes in another format than it was told, and of the end of a file -------------------


def sent_as(format: str) -> bytes:
    session = Session()
    session.feed(SimulatedVehicle(HOME).poll(0.0), 0.0)
    encode = encoder(format, session)
    return b"".join(encode(frame, 5) for frame in FRAMES)


@pytest.mark.parametrize("format", list(FORMATS))
def test_a_file_has_all_its_frames_the_last_one_too(arva: Arva, tmp_path: Path, format: str) -> None:
    (tmp_path / "frames").write_bytes(sent_as(format))
    _, out, err = arva("listen", tmp_path / "frames", "--format", format)
    shown = [1200] * 5 if format == "handheld" else [1234 + n for n in range(5)]
    assert [f"{d_cm} cm" in line for d_cm, line in zip(shown, out.splitlines(), strict=True)] == [True] * 5
    assert err.startswith("5 frames, 0 lost")


@pytest.mark.parametrize(
    ("format", "asked"),
    [("nmea", "binary"), ("text", "nmea"), ("binary", "text"), ("named", "binary"), ("tunnel", "named")],
)
def test_a_file_of_another_format_is_named_and_an_error(arva: Arva, tmp_path: Path, format: str, asked: str) -> None:
    (tmp_path / "frames").write_bytes(data := sent_as(format))
    said = arva.refused("listen", tmp_path / "frames", "--format", asked, code=1).splitlines()[-1]
    assert said == f"arva-hil: no {asked} frame in {len(data)} bytes: the bytes are {format}: --format {format}"


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (heartbeat(Encoder(1, 1)) * 3, "the bytes are MAVLink (3 packets) without frames of a receiver in it"),
        (b"\x00\x80\xf8" * 50, "the bytes are of no other known format"),
    ],
    ids=["MAVLink without frames", "noise of a wrong baud rate"],
)
def test_what_is_no_format_at_all_is_an_error_too(arva: Arva, tmp_path: Path, data: bytes, said: str) -> None:
    (tmp_path / "frames").write_bytes(data)
    assert said in arva("listen", tmp_path / "frames", code=1).err


def test_an_empty_file_holds_no_frames_and_is_no_error(arva: Arva, tmp_path: Path) -> None:
    (tmp_path / "frames").write_bytes(b"")
    arva("listen", tmp_path / "frames")


def test_a_port_of_another_format_is_said_while_it_listens_and_at_the_end(start: Start, line: PtyLink) -> None:
    program = start("listen", line.path, "--duration", 3).after("listening at")
    line.write(sent_as("nmea"))
    program.says(r"no frame for 2 s: no binary frame in \d+ bytes: the bytes are nmea: --format nmea\n")
    program.ends(1)


def test_stdin_of_another_format_is_an_error(start: Start, tmp_path: Path) -> None:
    (tmp_path / "frames").write_bytes(sent_as("binary"))
    with (tmp_path / "frames").open("rb") as stdin:
        program = start("listen", "-", "--format", "text", stdin=stdin)
    assert "the bytes are binary: --format binary" in program.ends(1)


def test_stdin_is_read_for_the_time_that_is_asked_for(start: Start) -> None:
    read, write = os.pipe()
    with open(read, "rb") as stdin, open(write, "wb"):
        assert start("listen", "-", "--duration", 0.2, stdin=stdin).ends().startswith("0 frames, ")


# -- `vehicle`: the built-in vehicle for whoever wants to talk to it -------------------------------------------


GUIDED, RTL = 4, 6


class GroundStation:
    """What talks to a vehicle on one link."""

    def __init__(self, link: Link) -> None:
        self.link = link
        self.encoder = Encoder(255, 190)
        self._parser = Parser()
        self._clock = RealClock()
        self._heard: list[tuple[int, Any]] = []

    def says(self, *messages: Any) -> None:
        self.link.write(b"".join(map(self.encoder.pack, messages)))

    def hears(self, kind: str, system: int = 1, good: Callable[[Any], bool] = lambda _: True) -> Any:
        """Wait for a message."""
        while True:
            while self._heard:
                source, message = self._heard.pop(0)
                if message.get_type() == kind and source == system and good(message):
                    return message
            assert self._clock.now() < DEADLINE_S, f"no {kind} of system {system}"
            self._clock.wait(self._clock.now() + 0.05, [self.link])
            for packet in self._parser.feed(self.link.read()):
                if (message := decode(packet)) is not None:
                    self._heard.append((packet.system, message))


def test_every_link_hears_every_vehicle_and_each_obeys_on_any(start: Start, keep: Keep) -> None:
    tcp, udp = free_port(socket.SOCK_STREAM), free_port(socket.SOCK_DGRAM)
    beside = GroundStation(keep(UdpInLink("127.0.0.1", udp)))
    program = start(
        "vehicle", "--link", f"tcpin:127.0.0.1:{tcp}", "--link", f"udpout:127.0.0.1:{udp}", "--count", 2, "--system", 3
    ).after("link: udpout")
    near = GroundStation(keep(TcpLink("127.0.0.1", tcp)))
    for station in (near, beside):
        for system in (3, 4):
            station.hears("HEARTBEAT", system)
    near.says(dialect.MAVLink_param_request_list_message(3, 1))
    names = [near.hears("PARAM_VALUE", 3).param_id]
    while len(names) < (count := near.hears("PARAM_VALUE", 3)).param_count - 1:
        names.append(count.param_id)
    assert "FS_GCS_ENABLE" in names
    near.says(dialect.MAVLink_mission_request_list_message(4, 1))
    assert near.hears("MISSION_COUNT", 4).count == 0
    beside.says(order(4, 1, dialect.MAV_CMD_DO_SET_MODE, 1, GUIDED))
    near.hears("HEARTBEAT", 4, lambda m: m.custom_mode == GUIDED)
    near.hears("HEARTBEAT", 3, lambda m: m.custom_mode != GUIDED)
    program.says("vehicle 4: GUIDED, disarmed, on the ground")


@pytest.mark.parametrize(("name", "mode"), [("battery", 6), ("ekf", 9)])
def test_a_failsafe_strikes_at_its_time_in_the_air(start: Start, keep: Keep, name: str, mode: int) -> None:
    port = free_port(socket.SOCK_STREAM)
    program = start("vehicle", "--link", f"tcpin:127.0.0.1:{port}", "--failsafe", f"{name}@0.5").after("link: tcpin")
    station = GroundStation(keep(TcpLink("127.0.0.1", port)))
    station.hears("HEARTBEAT")
    station.says(
        order(1, 1, dialect.MAV_CMD_DO_SET_MODE, 1, GUIDED),
        order(1, 1, dialect.MAV_CMD_COMPONENT_ARM_DISARM, 1),
        order(1, 1, dialect.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, 5),
    )
    station.hears("STATUSTEXT", good=lambda m: name[:2] in m.text.lower() or "breached" in m.text)
    station.hears("HEARTBEAT", good=lambda m: m.custom_mode == mode)
    program.says(f"failsafe: {name}")


def test_a_link_that_is_taken_is_said(arva: Arva, keep: Keep, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("arva_hil.links.tcp.getpid", lambda: 0)  # the test has the address, not the program
    taken = keep(socket.create_server(("127.0.0.1", 0)))
    err = arva("vehicle", "--link", f"tcpin:127.0.0.1:{taken.getsockname()[1]}", code=3).err
    assert "another program listens there" in err


def test_every_failsafe_of_the_vehicle_can_be_asked_for() -> None:
    assert list(FAILSAFES) == list(arguments.FAILSAFES)


# -- `arva-hil command`: one command, its answer, and what is said when there is none --------------------------


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
        assert arva("command", line.path, "mark", 3, "--format", format) == (0, "mark: done, 3\n", "")


@pytest.mark.parametrize("result", ["refused", "unknown", "busy"])
def test_a_refusal_is_printed_and_exit_code_1(arva: Arva, line: PtyLink, result: str) -> None:
    with receiver(line, "binary", result):
        said = json.loads(arva("command", line.path, "scan", "--json", code=1).out)
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
        err = arva.refused("command", line.path, "identify", "--timeout", 0.5, code=1)
    assert err.startswith(f"arva-hil: {line.path}: no answer in 0.5 s: ")
    assert err.endswith(said + "\n")


@pytest.mark.parametrize("words", ["command /dev/no-such-port identify", "serve --port /dev/no-such-port"])
def test_a_port_that_is_not_there_is_exit_code_3(arva: Arva, words: str) -> None:
    arva(*words.split(), code=3)


def test_a_run_obeys_it(arva: Arva, start: Start, autopilot: Any, tmp_path: Any) -> None:
    port = tmp_path / "port"
    program = start("run", "--port", f"pty:{port}", "--autopilot", autopilot.address, "--rate", 10).after(
        "there is a pose"
    )
    out = arva("command", port, "identify", "--timeout", 20).out
    assert out.startswith("identify: done, paper ")
    assert out.endswith(" binary, 4\n")
    port.write_bytes(b"hello")
    arva("command", port, "mark", 200, "--timeout", 20, code=1)
    program.says("command [0-9]+ answered: refused")
    program.stops()
    assert (
        "commands: 2 came: 1 done, 1 refused, 0 unknown, 0 busy, 0 not answered; 5 bytes in no command" in program.err
    )


# -- `run` as a service: what it tells the service manager, and that unit, environment and image name what exist--


SYSTEMD = ROOT / "tools" / "systemd"
UNIT, ENVIRONMENT, RECORD = (SYSTEMD / name for name in ("arva-hil.service", "arva-hil.env", "record.conf"))
CONTAINER = ROOT / "tools" / "container" / "Containerfile"
ASSIGNMENT = re.compile(r"\bARVA_HIL_\w+=[^\s\"']*")


# -- what it says ------------------------------------------------------------------------------------------


@pytest.fixture
def manager(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Manager]:
    with closing(Manager(str(tmp_path / "notify"))) as made:
        monkeypatch.setenv("NOTIFY_SOCKET", made.name)
        monkeypatch.setenv("WATCHDOG_USEC", "200000")
        monkeypatch.delenv("WATCHDOG_PID", raising=False)
        yield made


def test_a_service_is_ready_before_a_vehicle_is_heard_and_says_that_it_lives_until_it_is_stopped(
    start: Start, manager: Manager
) -> None:
    program = start("--autopilot", "pty", "--port", "pty", "--timeout", "inf")
    heard: list[str] = []
    until(lambda: heard.extend(manager.heard()) or heard.count("WATCHDOG=1") >= 3)
    assert [said for said in heard if not said.startswith("STATUS=")][:2] == ["READY=1", "WATCHDOG=1"]
    assert any(said.startswith("STATUS=") and said.endswith("no vehicle yet") for said in heard)
    program.process.terminate()
    program.ends(INTERRUPTED)
    assert manager.heard()[-1] == "STOPPING=1"


def test_a_service_whose_port_is_not_there_was_never_ready(start: Start, manager: Manager) -> None:
    start("--autopilot", "pty", "--port", "/dev/ttyNONE7").ends(3)
    assert manager.heard() == []


# -- what is installed -------------------------------------------------------------------------------------


def settings(path: Path) -> dict[str, list[str]]:
    """What a unit file sets, in order: a name may come again."""
    found: dict[str, list[str]] = {}
    for line in path.read_text().splitlines():
        if line and line[0] not in "#[":
            name, _, value = line.partition("=")
            found.setdefault(name, []).append(value)
    return found


def options(arguments: list[str], environment: dict[str, str]) -> dict[str, Any]:
    parser = CommandParser()
    arguments_of("run")(parser)
    return vars(parser.parse(arguments, environment))


@pytest.mark.parametrize("path", [UNIT, ENVIRONMENT, CONTAINER], ids=lambda path: path.name)
def test_every_name_in_the_environment_is_an_option_and_its_value_one_it_takes(path: Path) -> None:
    """Those that are commented out, too."""
    assignments = ASSIGNMENT.findall(path.read_text())
    assert assignments
    for assignment in assignments:
        name, _, value = assignment.partition("=")
        option = name.removeprefix("ARVA_HIL_").lower()
        assert options([], {name: value})[option] != options([], {})[option], assignment


def test_what_the_unit_runs_is_a_command_with_its_options() -> None:
    commands = settings(UNIT)["ExecStart"]
    assert [command.split()[:2] for command in commands] == [["/opt/arva-hil/bin/arva-hil", "run"]]
    assert options(commands[0].split()[2:], {})


def test_the_record_of_each_start_has_a_folder_of_its_own() -> None:
    empty, command = settings(RECORD)["ExecStart"]
    assert empty == ""  # or there would be two
    shell, flag, script = shlex.split(command)
    assert (shell, flag) == ("/bin/sh", "-c")
    script = script.replace("$$", "$").replace("%%", "%").removeprefix("exec /opt/arva-hil/bin/arva-hil run ")
    environment = {"STATE_DIRECTORY": "/var/lib/arva-hil", "INVOCATION_ID": "0123456789abcdef"}
    said = subprocess.run(
        [shell, flag, f"printf '%s\\n' {script}"], env=environment, capture_output=True, text=True, check=True
    )
    assert re.fullmatch(r"/var/lib/arva-hil/\d{8}T\d{6}Z-01234567", options(said.stdout.splitlines(), {})["record"])


def test_the_unit_knows_how_the_program_ends_and_waits_for_its_word() -> None:
    unit = settings(UNIT)
    assert (
        unit
        | {
            "RestartPreventExitStatus": [str(USAGE)],
            "SuccessExitStatus": [str(INTERRUPTED)],
            "Type": ["notify"],
            "EnvironmentFile": [f"/etc/arva-hil/{ENVIRONMENT.name}"],
        }
        == unit
    )
    assert int(unit["WatchdogSec"][0]) > 1
    assert "AF_UNIX" in unit["RestrictAddressFamilies"][0].split()


@pytest.mark.skipif(not shutil.which("systemd-analyze"), reason="systemd is not installed")
def test_systemd_understands_the_unit(tmp_path: Path) -> None:
    unit = written(tmp_path / UNIT.name, UNIT.read_text().replace("/opt/arva-hil/bin/arva-hil", "/bin/true"))
    said = subprocess.run(["systemd-analyze", "verify", "--man=no", unit], capture_output=True, text=True)
    assert (said.returncode, said.stderr) == (0, "")


def test_the_image_is_made_of_what_is_there() -> None:
    lines = [line.split() for line in CONTAINER.read_text().splitlines()]
    copied = [name for line in lines if line[:1] == ["COPY"] and "--from=build" not in line for name in line[1:-1]]
    assert all((ROOT / name).exists() for name in copied)
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    project_files = {"pyproject.toml", "hatch_build.py", "README.md", *project["project"]["license-files"]}
    wheel = project["tool"]["hatch"]["build"]["targets"]["wheel"]
    assert set(copied) == project_files | {*wheel["packages"], *wheel["force-include"]}
    assert ["ENTRYPOINT", *[f'["{name}"]' for name in project["project"]["scripts"]]] in lines
    bases = {line[1] for line in lines if line[:1] == ["FROM"]}
    assert len(bases) == 1
