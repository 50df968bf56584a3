"""`arva-hil search` as a pilot meets it: what it says, how it ends, and what it then leaves behind."""

from __future__ import annotations

import csv
import json
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from arva_hil.links.pty import PtyLink
from arva_hil.links.tcp_server import TcpServerLink
from arva_hil.mavlink.codec import Encoder, Parser, decode, dialect
from arva_hil.simulated.autopilot import Mode
from firmware_proto import encode_nmea
from tests.free_ports import free_port

from .far_ends import Arva, Autopilot, Beacon, Keep, Program, Start

LOW = ("--take-off", 0.5, "--height", 0.5)
ARM, SET_MODE = dialect.MAV_CMD_COMPONENT_ARM_DISARM, dialect.MAV_CMD_DO_SET_MODE
FLYING = "going for transmitter 4"


@pytest.fixture(autouse=True)
def _no_countdown(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ARVA_HIL_COUNTDOWN", "0")


def orders(autopilot: Autopilot) -> list[int]:
    """The commands it was sent that have an influence on a flight."""
    parser = Parser()
    messages = [decode(packet) for packet in parser.feed(bytes(autopilot.heard))]
    commands = [m.command for m in messages if m is not None and m.get_type() == "COMMAND_LONG"]
    return [c for c in commands if c in (ARM, SET_MODE, dialect.MAV_CMD_NAV_TAKEOFF, dialect.MAV_CMD_NAV_LAND)]


def pilot(autopilot: Autopilot, mode: Mode) -> None:
    """Somebody else changes the mode."""
    order = dialect.MAVLink_command_long_message(1, 1, SET_MODE, 0, 1, mode, 0, 0, 0, 0, 0)
    read, once = autopilot.link.read, [Encoder(255, 190).pack(order)]
    autopilot.link.read = lambda: read() + (once.pop() if once else b"")  # type: ignore[method-assign]


def last_lines(program: Program, count: int) -> list[str]:
    return program.err.splitlines()[-count:]


# -- before anything flies ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "what"),
    [
        ("", "--autopilot is missing, e.g. arva-hil search --autopilot udpin:127.0.0.1:14540 --receiver /tmp/arva0"),
        ("--autopilot pty", "--receiver is missing, e.g. "),
        ("--autopilot - --receiver pty", "--autopilot is missing"),
        ("--autopilot pty --receiver -", "--receiver is missing"),
        ("--autopilot pty --receiver pty --strategy luck", "--strategy: no strategy 'luck'"),
        ("--autopilot pty --receiver pty --format tunnel", "--format: 'tunnel': expected binary, nmea, text"),
        ("--autopilot pty --receiver pty --area 1,2,3", "--area: '1,2,3': expected south,west,north,east in m"),
        ("--autopilot pty --receiver pty --area=5,5,1,9", "--area: '5,5,1,9': expected south,west,north,east in m"),
        ("--autopilot pty --receiver pty --area=0,0,nan,9", "--area: '0,0,nan,9': expected south,west,north,east"),
        ("--autopilot pty --receiver pty --area 0,0,1e9,9", "expected south,west,north,east"),
        (
            "--autopilot pty --receiver pty --area 3000,0,3100,100 --limit 600",
            "--area: its nearest corner is 3000 m away, at 1 m/s too far for --limit 600",
        ),
        ("--autopilot pty --receiver pty --max-speed 0", "--max-speed: '0': expected a number of m/s 0.2…10"),
        ("--autopilot pty --receiver pty --mount 1,2", "--mount: '1,2': expected x,y,z in m and, where it is turned"),
        ("--autopilot pty --receiver pty --mount 0,0,0,nan,0,0", "--mount: '0,0,0,nan,0,0': expected x,y,z in m"),
        ("--autopilot pty --receiver pty --height -1", "--height: '-1': expected a number of m 0.3…100"),
        ("--autopilot pty --receiver pty --take-off nan", "--take-off: 'nan'"),
        ("--autopilot pty --receiver pty --end crash", "--end: invalid choice: 'crash'"),
    ],
)
def test_usage(arva: Arva, arguments: str, what: str) -> None:
    code, out, err = arva("search", *arguments.split())
    assert (code, out) == (2, "")
    assert what in err
    assert "Traceback" not in err


def test_the_way_is_told_before_anything_flies(arva: Arva) -> None:
    code, _, err = arva(
        "search", "--autopilot", "pty", "--receiver", "pty", "--timeout", 0.3, "--area=-100,-100,100,100"
    )
    assert code == 3
    first, second, *_ = err.splitlines()
    assert first.startswith("autopilot: pty (/dev/")
    assert second.startswith("strategy estimate; strips of ")
    assert second.endswith(" at 1 m/s, more than the 900 s there are")


def test_no_autopilot(arva: Arva, tmp_path: Path) -> None:
    arguments = ("search", "--autopilot", "pty", "--receiver", "pty", "--timeout", 0.3, "--json")
    code, out, err = arva(*arguments, "--record", tmp_path / "record")
    assert code == 3
    assert "error: no autopilot: no byte came: is the autopilot powered" in err
    assert json.loads(out)["outcome"] == "no link"
    assert json.loads((tmp_path / "record" / "search.json").read_text())["exit_code"] == 3


def test_without_matplotlib_there_is_a_log_and_the_cure(
    arva: Arva, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    arguments = ("search", "--autopilot", "pty", "--receiver", "pty", "--timeout", 0.3)
    code, _, err = arva(*arguments, "--record", tmp_path)
    assert code == 3
    assert err.endswith(f"log: {tmp_path}/search.csv; for a picture: pip install 'arva-hil[plots]'\n")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["search.csv", "search.json", "search.jsonl"]


def test_a_port_that_is_none_leaves_no_record(arva: Arva, tmp_path: Path) -> None:
    code, _, err = arva("search", "--autopilot", "pty", "--receiver", tmp_path, "--record", tmp_path / "record")
    assert code == 3
    assert f"{tmp_path}: is a directory" in err
    assert not (tmp_path / "record").exists()


def test_a_receiver_whose_port_is_not_there_in_time_is_the_reason_given(start: Start, autopilot: Autopilot) -> None:
    program = start("search", "--autopilot", autopilot.address, "--receiver", "/dev/ttyNONE7", "--timeout", 1)
    program.says("waiting for /dev/ttyNONE7: no such port; ")
    assert program.ends() == 3
    assert "error: no frame from the receiver: /dev/ttyNONE7: no such port" in program.err


def test_a_receiver_whose_port_is_not_there_yet_is_waited_for(
    start: Start, autopilot: Autopilot, keep: Keep, tmp_path: Path
) -> None:
    path = str(tmp_path / "receiver")
    program = start("search", "--autopilot", autopilot.address, "--receiver", path, *LOW)
    program.says(f"waiting for {path}: no such port")
    program.says("waiting for a frame from the receiver")
    keep(Beacon(symlink=path))
    program.says(f"{path}: is open")
    program.says("arming ardupilotmega quadrotor 1/1")
    program.send(signal.SIGINT)
    assert program.ends() == 130


def test_an_autopilot_that_is_started_later_is_waited_for(start: Start, keep: Keep, beacon: Beacon) -> None:
    port = free_port(socket.SOCK_STREAM)
    url = f"tcp:127.0.0.1:{port}"
    program = start("search", "--autopilot", url, "--receiver", beacon.link.path, *LOW)
    program.says(f"waiting for {url}: connection refused")
    keep(Autopilot(keep(TcpServerLink("127.0.0.1", port))))
    program.says(f"{url}: is open")
    program.says("arming ardupilotmega quadrotor 1/1")
    program.send(signal.SIGINT)
    assert program.ends() == 130


def test_one_port_cannot_be_both(arva: Arva, line: PtyLink) -> None:
    code, _, err = arva("search", "--autopilot", line.path, "--receiver", line.path)
    assert code == 3
    assert f"{line.path}: busy" in err


def test_a_search_is_never_overwritten(arva: Arva, tmp_path: Path) -> None:
    (tmp_path / "search.csv").write_text("of yesterday")
    code, _, err = arva("search", "--autopilot", "pty", "--receiver", "pty", "--record", tmp_path)
    assert code == 2
    assert f"{tmp_path}: holds a search already (search.csv); name another folder" in err
    assert (tmp_path / "search.csv").read_text() == "of yesterday"


def test_without_frames_nothing_is_armed(start: Start, autopilot: Autopilot, line: PtyLink) -> None:
    program = start("search", "--autopilot", autopilot.address, "--receiver", line.path, "--timeout", 2)
    assert program.ends() == 3
    assert last_lines(program, 1) == [f"error: no frame from the receiver at {line.path}: nothing came"]
    assert orders(autopilot) == []


def test_frames_of_another_format_are_shown(start: Start, autopilot: Autopilot, keep: Keep) -> None:
    beacon = keep(Beacon(encode_nmea))
    program = start("search", "--autopilot", autopilot.address, "--receiver", beacon.link.path, "--timeout", 2)
    assert program.ends() == 3
    assert "bytes came that are none, first b'" in program.err
    assert "PARVA" in program.err
    assert orders(autopilot) == []


def test_on_the_ground_there_is_nothing_to_take_over(start: Start, autopilot: Autopilot, beacon: Beacon) -> None:
    program = start(
        *("search", "--autopilot", autopilot.address, "--receiver", beacon.link.path),
        *("--take-over", "--timeout", 3),
    )
    assert program.ends() == 1
    assert last_lines(program, 1) == ["error: the vehicle is not taken over: it is not armed"]
    assert orders(autopilot) == []


def test_a_port_that_another_program_listens_to_is_busy(start: Start, autopilot: Autopilot, beacon: Beacon) -> None:
    listener = start("listen", beacon.link.path)
    listener.says("listening")
    program = start("search", "--autopilot", autopilot.address, "--receiver", beacon.link.path)
    assert program.ends() == 3
    assert f"arva-hil: {beacon.link.path}: busy: held by " in program.err
    assert f"{listener.process.pid} (" in program.err
    assert orders(autopilot) == []


def test_nothing_is_armed_while_somebody_else_reads_the_receiver(
    start: Start, autopilot: Autopilot, beacon: Beacon
) -> None:
    """One who heeds no lock, and opens the port after the search has."""
    beacon.quiet.set()
    program = start("search", "--autopilot", autopilot.address, "--receiver", beacon.link.path)
    program.says("waiting for a frame from the receiver")
    with open(beacon.link.path, "rb", buffering=0) as port, subprocess.Popen(["sleep", "60"], stdin=port) as other:
        beacon.quiet.clear()
        assert program.ends() == 3
        other.kill()
    said = f"error: {beacon.link.path} is read by {other.pid} (sleep 60) too, and each gets a part of the frames; "
    assert said + "close the other program\n" in program.err
    assert orders(autopilot) == []


# -- in the air --------------------------------------------------------------------------------------------


def test_ctrl_c_leaves_it_hovering(start: Start, autopilot: Autopilot, beacon: Beacon, tmp_path: Path) -> None:
    program = start(
        *("search", "--autopilot", autopilot.address, "--receiver", beacon.link.path, *LOW),
        *("--json", "--record", tmp_path / "record"),
    )
    program.says("going for transmitter 4, 20.0 m away")
    program.send(signal.SIGINT)
    assert program.ends() == 130
    assert "interrupted; nothing found\n" in program.err
    assert "transmitter 9 was received, but not found; nearest, 45.0 m away, at " in program.err
    said = json.loads(program.out)
    assert (said["outcome"], said["how"], said["found"]) == ("failed", "interrupted", None)
    assert [other["id"] for other in said["others"]] == [4, 9]
    assert orders(autopilot)[-1] == dialect.MAV_CMD_NAV_TAKEOFF  # nothing lands it
    recorded = json.loads((tmp_path / "record" / "search.json").read_text())
    assert recorded == recorded | said | {"exit_code": 130}
    with open(tmp_path / "record" / "search.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert {row["phase"] for row in rows} >= {"climbing", "flying"}
    assert {(row["id"], row["d_cm"]) for row in rows if row["id"]} == {("4", "2000")}
    assert (tmp_path / "record" / "search.png").read_bytes().startswith(b"\x89PNG")


def test_the_pilot_takes_over(start: Start, autopilot: Autopilot, beacon: Beacon) -> None:
    program = start("search", "--autopilot", autopilot.address, "--receiver", beacon.link.path, *LOW)
    program.says(FLYING)
    pilot(autopilot, Mode.LOITER)
    assert program.ends() == 1
    taken = "error: the mode is LOITER: the pilot or a failsafe has taken over; nothing found"
    assert taken in program.err.splitlines()
    assert orders(autopilot) == [SET_MODE, ARM, dialect.MAV_CMD_NAV_TAKEOFF]


def test_the_receiver_is_unplugged(start: Start, autopilot: Autopilot, tmp_path: Path) -> None:
    path = str(tmp_path / "arva0")
    beacon = Beacon(symlink=path)
    try:
        program = start("search", "--autopilot", autopilot.address, "--receiver", path, *LOW, "--patience", 3)
        program.says(FLYING)
    finally:
        beacon.close()
    assert program.ends() == 1
    for line in (
        f"warning: {path}: lost: closed by the far end, searching for it",
        "warning: no frame for 2 s: hovering",
        "no frame from the receiver for 3 s; landing",
        "error: no frame from the receiver for 3 s; nothing found",
    ):
        assert f"\n{line}" in program.err
    assert orders(autopilot)[-1] == dialect.MAV_CMD_NAV_LAND


def test_the_receiver_is_plugged_in_again(start: Start, autopilot: Autopilot, keep: Keep, tmp_path: Path) -> None:
    path = str(tmp_path / "arva0")
    beacon = Beacon(symlink=path)
    try:
        program = start("search", "--autopilot", autopilot.address, "--receiver", path, *LOW, "--patience", 60)
        program.says(FLYING)
    finally:
        beacon.close()
    program.says(rf"\nwarning: {path}: lost: closed by the far end, searching for it")
    program.says("warning: no frame for 2 s: hovering")
    keep(Beacon(symlink=path))
    program.says(rf"\n{path}: back after \d+\.\d s")
    program.says("frames are back: the search goes on")
    program.send(signal.SIGINT)
    assert program.ends() == 130
    assert program.err.count(f"{path}: lost") == 1


def test_both_are_waited_for_on_the_ground(start: Start, keep: Keep, tmp_path: Path) -> None:
    fc, arva = str(tmp_path / "fc"), str(tmp_path / "arva0")
    first, port = Autopilot(PtyLink(fc)), PtyLink(arva)
    try:
        program = start("search", "--autopilot", fc, "--receiver", arva, *LOW)
        program.says("waiting for a frame from the receiver")
    finally:
        first.close()
        port.close()
    for path in (fc, arva):
        program.says(rf"\nwarning: {path}: lost")
    assert orders(first) == []
    keep(Autopilot(keep(PtyLink(fc))))
    keep(Beacon(symlink=arva))
    program.says("arming")
    for path in (fc, arva):
        assert f"\n{path}: back after " in program.err
    program.says(FLYING)
    program.send(signal.SIGINT)
    assert program.ends() == 130


def test_the_autopilots_link_is_lost(start: Start, beacon: Beacon, tmp_path: Path) -> None:
    autopilot = Autopilot(PtyLink(path := str(tmp_path / "fc")))
    try:
        program = start("search", "--autopilot", path, "--receiver", beacon.link.path, *LOW)
        program.says(FLYING)
    finally:
        autopilot.close()
    assert program.ends() == 1
    assert f"error: {path}: lost" in program.err
    assert "searching for it" not in program.err
    assert "the vehicle is left to its own failsafe: it stops after 3 s (GUID_TIMEOUT), and hovers" in program.err


def test_the_last_seconds_before_propellers_turn_are_counted_down(
    start: Start, autopilot: Autopilot, beacon: Beacon
) -> None:
    program = start(
        "search", "--autopilot", autopilot.address, "--receiver", beacon.link.path, "--countdown", 1.5, *LOW
    )
    program.says("arming in 1 s")
    assert orders(autopilot) == []
    program.says("arming, try 1")
    program.send(signal.SIGINT)
    assert program.ends() == 130
    assert "arming in 2 s" in program.err
    assert "without set-points it stops after 3 s (GUID_TIMEOUT), and hovers in GUIDED, armed" in program.err


def test_two_ctrl_c_end_it_at_once(start: Start, autopilot: Autopilot, beacon: Beacon) -> None:
    program = start("search", "--autopilot", autopilot.address, "--receiver", beacon.link.path)
    program.says("arming")
    autopilot.pause()  # it will never say that it is disarmed
    program.send(signal.SIGINT)
    program.says("interrupted: the vehicle ")
    program.send(signal.SIGINT)
    assert program.ends() == 130


def test_a_ground_station_gets_what_the_search_reads_on_a_link_of_its_own(
    start: Start, autopilot: Autopilot, beacon: Beacon
) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as station:
        station.bind(("127.0.0.1", 0))
        station.settimeout(60)
        program = start(
            *("search", "--autopilot", autopilot.address, "--receiver", beacon.link.path, "--dry-run", "--yes"),
            *("--gcs", f"udpout:127.0.0.1:{station.getsockname()[1]}"),
        )
        parser, types, values = dialect.MAVLink(None), set(), {}
        while len(values) < 4:
            for message in parser.parse_buffer(bytearray(station.recv(65536))) or []:
                types.add(message.get_type())
                if message.get_type() == "NAMED_VALUE_FLOAT":
                    values[message.name] = message.value
        program.send(signal.SIGINT)
        program.ends()
    assert values == {"arva_d": 20.0, "arva_delta": 10.0, "arva_zone": 1.0, "arva_id": 4.0}
    heard = dialect.MAVLink(None).parse_buffer(bytearray(autopilot.heard)) or []
    assert not {message.get_type() for message in heard} & {"NAMED_VALUE_FLOAT", "ADSB_VEHICLE"}


@pytest.mark.parametrize("url", ["udpin:127.0.0.1:14999", "udpout:127.0.0.1:14999", "/tmp/arva-none", "log.tlog", "-"])
def test_a_ground_station_on_the_link_of_another_is_refused(arva: Arva, url: str) -> None:
    ended = arva("search", "--autopilot", "udpin:127.0.0.1:14999", "--receiver", "/tmp/arva-none", "--gcs", url)
    assert ended.code == 2
    assert "--gcs" in ended.err
