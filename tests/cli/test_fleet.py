"""`run` with a scenario that names its vehicles: all of them in one process, each receiver on a port of its own."""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import resource
import socket
import sys
import termios
from itertools import pairwise
from pathlib import Path

import pytest

from arva_hil.links.pty import PtyLink
from arva_hil.links.tlog import TlogReader
from arva_hil.links.udp import UdpOutLink
from arva_hil.records.reading import load
from arva_hil.registry import FORMATS
from firmware_proto import Frame
from tests.free_ports import free_port
from tests.mavlink.test_codec import packet

from .far_ends import (
    Arva,
    Autopilot,
    Consumer,
    Keep,
    Start,
    frames_in,
    hears,
    read_frames,
    read_until_heard,
    until,
)

TRANSMITTER = "spec: 2\ntransmitters: [{id: 1, ned: [20, 5, 0]}]\nreceiver: {noise: {kind: off}}\n"


def fleet_file(folder: Path, vehicles: str) -> Path:
    path = folder / "fleet.yaml"
    path.write_text(TRANSMITTER + "vehicles:\n" + vehicles)
    return path


def vehicle(name: str, system: int, address: str, *receivers: str) -> str:
    """One vehicle, as in the file."""
    head = f"- {{name: {name}, system: {system}, autopilot: '{address}', receivers: [%s]}}\n"
    return head % ", ".join(receivers)


def ports(keep: Keep, number: int) -> list[PtyLink]:
    return [keep(PtyLink()) for _ in range(number)]


def four_receivers(addresses: tuple[str, str], lines: list[PtyLink]) -> str:
    """Two vehicles with two receivers each, of different mount, rate and format."""
    a, b, c, d = (line.path for line in lines)
    return vehicle(
        "alpha",
        1,
        addresses[0],
        f"{{name: front, port: '{a}', rate_hz: 20, mount: {{position: [0.5, 0, 0]}}}}",
        f"{{name: rear, port: '{b}', rate_hz: 10, format: nmea, mount: {{position: [-3, 0, 0]}}}}",
    ) + vehicle(
        "bravo",
        2,
        addresses[1],
        f"{{name: front, port: '{c}', rate_hz: 5, format: text}}",
        f"{{name: rear, port: '{d}', rate_hz: 25, mount: {{position: [0, -4, 0]}}}}",
    )


def fill(line: PtyLink) -> None:
    """Write to a terminal until nothing more fits in; its master end reads nothing.

    What is written is handed over by a thread of the kernel's, which makes room once more: full is what stays full.
    """
    terminal = os.open(line.path, os.O_WRONLY | os.O_NOCTTY | os.O_NONBLOCK)

    def waiting() -> int:
        with contextlib.suppress(BlockingIOError):
            while True:
                os.write(terminal, b"x" * 256)
        return int.from_bytes(fcntl.ioctl(line._fd, termios.FIONREAD, bytes(4)), sys.byteorder)

    until(lambda: waiting() >= 4095)  # a reader's buffer on Linux
    waiting()
    os.close(terminal)


def decoded(line: PtyLink, format: str) -> list[Frame]:
    decoder = FORMATS[format].decoder()
    return decoder.feed(line.read(), 0.0) + decoder.feed(b"", 1.0)


def test_two_vehicles_on_terminals_of_their_own_serve_four_ports(start: Start, keep: Keep, tmp_path: Path) -> None:
    lines, record = ports(keep, 4), tmp_path / "record"
    pilots = [keep(Autopilot(keep(PtyLink()), system=system)) for system in (1, 2)]
    path = fleet_file(tmp_path, four_receivers((pilots[0].address, pilots[1].address), lines))
    program = start("run", "--scenario", path, "--record", record)
    for name in ("alpha/front", "alpha/rear", "bravo/front", "bravo/rear"):
        program.says(f"{name}: there is a pose")
    last = Consumer(lines[3])
    frames = last.read(0) + last.read(20)  # by then each has made some more
    program.stops()
    kept = {
        "alpha/front": frames_in(lines[0].read()),
        "alpha/rear": decoded(lines[1], "nmea"),
        "bravo/front": decoded(lines[2], "text"),
        "bravo/rear": frames + last.read(0),
    }
    run = json.loads((record / "run.json").read_text())
    counters = {name: run["vehicles"][name.split("/")[0]]["receivers"][name.split("/")[1]] for name in kept}
    made = {name: counted["frames"] + counted["skipped"] for name, counted in counters.items()}
    rates = {"alpha/front": 20, "alpha/rear": 10, "bravo/front": 5, "bravo/rear": 25}
    first = {name: 0.5 * min(1 / hz, 0.1) if "bravo" in name else 0.0 for name, hz in rates.items()}  # they are spread
    earliest = max(first[name] + (made[name] - 1) / hz for name, hz in rates.items())
    assert earliest < min(first[name] + made[name] / hz for name, hz in rates.items())  # when it ended, by each one
    assert all(hears(frames[-1]) for name, frames in kept.items() if name != "bravo/front")  # text rounds
    assert len({frames[-1].channels[0].d for frames in kept.values()}) == 4  # each hears at its own place
    assert "alpha: vehicle ardupilotmega quadrotor 1/1" in program.err
    assert "bravo: vehicle ardupilotmega quadrotor 2/1" in program.err
    assert "bravo/rear: there is a pose" in program.err
    for name, frames in kept.items():
        assert (counters[name]["frames"], counters[name]["dropped"]) == (len(frames), 0)
        assert (record / name / "readings.csv").read_text().count("\n") == 1 + 4 * len(frames)
        assert (record / name / "frames.csv").read_text().count("\n") == 1 + len(frames)
    assert frames_in((record / "bravo/rear/frames.bin").read_bytes()) == kept["bravo/rear"]
    for name, system in (("alpha", 1), ("bravo", 2)):
        said = run["vehicles"][name]
        assert said["vehicle"]["system"] == system
        packets = list(TlogReader(record / said["tlog"]))
        assert len(packets) == said["counters"]["packets_received"] > 0
    assert sorted(path.name for path in record.iterdir()) == [
        "alpha",
        "autopilot-1.tlog",
        "autopilot-2.tlog",
        "bravo",
        "events.jsonl",
        "run.json",
    ]
    read = load(record)
    assert {receiver.name: len(receiver) for receiver in read.receivers} == {n: len(fs) for n, fs in kept.items()}
    assert read.datums.keys() == {"alpha", "bravo"}


def test_two_vehicles_behind_one_udp_port_are_told_apart_by_system_id(start: Start, keep: Keep, tmp_path: Path) -> None:
    """Each from a socket of its own; both are asked for their streams."""
    lines, record, port = ports(keep, 4), tmp_path / "record", free_port(socket.SOCK_DGRAM)
    address = f"udpin:127.0.0.1:{port}"
    path = fleet_file(tmp_path, four_receivers((address, address), lines))
    program = start("run", "--scenario", path, "--record", record)
    program.says("frames of bravo/rear to")
    for system in (1, 2):
        link = keep(UdpOutLink("127.0.0.1", port))
        keep(Autopilot(link, speaks_first=True, system=system))
    for name in ("alpha/front", "alpha/rear", "bravo/front", "bravo/rear"):
        program.says(f"{name}: there is a pose")
    link.write(packet(0, bytes(9), flags=2))
    last = [read_frames(line, 30)[-1] for line in (lines[0], lines[3])]
    program.stops()
    assert all(map(hears, last))
    run = json.loads((record / "run.json").read_text())
    assert [run["vehicles"][name]["vehicle"]["system"] for name in ("alpha", "bravo")] == [1, 2]
    assert run["vehicles"]["alpha"]["tlog"] == run["vehicles"]["bravo"]["tlog"] == "autopilot.tlog"
    assert "is ignored" not in program.err
    assert program.err.count(" bytes skipped") == program.err.count(f"{address} (2 vehicles): ") == 1
    assert program.err.count("not used: 1 packets incompatible") == 1


def test_a_vehicle_that_never_appears_is_said_once_while_the_other_flies(
    start: Start, keep: Keep, autopilot: Autopilot, tmp_path: Path
) -> None:
    lines, nobody = ports(keep, 4), keep(PtyLink())
    path = fleet_file(tmp_path, four_receivers((autopilot.address, nobody.path), lines))
    program = start("run", "--scenario", path, "--timeout", 1)
    program.says("bravo: no byte came")
    program.says("alpha/front: there is a pose")
    consumer = Consumer(lines[3])
    frames = consumer.read(0) + consumer.read(20)
    program.stops()
    assert program.err.count("bravo: no byte came") == 1
    assert "bravo: no vehicle was found; its link: 0 bytes" in program.err
    assert hears(frames_in(lines[0].read())[-1])
    assert not any(frame.channels[0].valid for frame in frames)


def test_many_vehicles_that_never_appear_on_one_link_are_said_in_one_sentence(
    start: Start, keep: Keep, autopilot: Autopilot, tmp_path: Path
) -> None:
    nobody, names = keep(PtyLink()), [f"v{system}" for system in range(2, 10)]
    absent = "".join(vehicle(name, int(name[1]), nobody.path, "{name: r, port: pty}") for name in names)
    path = fleet_file(tmp_path, vehicle("v1", 1, autopilot.address, "{name: r, port: pty}") + absent)
    program = start("run", "--scenario", path, "--timeout", 1)
    program.says("no byte came")
    program.says("v1/r: there is a pose")
    program.stops()
    assert f"warning: {', '.join(names)}: no byte came" in program.err
    assert program.err.count("no byte came") == 1
    assert f"{nobody.path} (8 vehicles): no vehicle was found; 0 bytes" in program.err
    assert program.err.count("no vehicle was found") == 1


def test_when_no_vehicle_appears_in_time_it_ends_with_3(start: Start, keep: Keep, tmp_path: Path) -> None:
    lines, nobody = ports(keep, 4), ports(keep, 2)
    path = fleet_file(tmp_path, four_receivers((nobody[0].path, nobody[1].path), lines))
    program = start("run", "--scenario", path, "--timeout", 1)
    assert program.ends() == 3
    assert program.err.count("error: no byte came") == 1


def test_an_unread_port_a_broken_link_and_a_flood_hold_up_no_other(
    start: Start, keep: Keep, autopilot: Autopilot, tmp_path: Path
) -> None:
    deaf, heard, *others = ports(keep, 4)
    fill(deaf)
    broken, number = keep(PtyLink(at := str(tmp_path / "broken"))), free_port(socket.SOCK_DGRAM)
    receivers = [f"{{name: {n}, port: '{line.path}', rate_hz: 50}}" for n, line in (("deaf", deaf), ("heard", heard))]
    spare = [f"{{name: r, port: '{line.path}'}}" for line in others]
    vehicles = vehicle("alpha", 1, autopilot.address, *receivers) + vehicle("bravo", 2, at, spare[0])
    path = fleet_file(tmp_path, vehicles + vehicle("charlie", 3, f"udpin:127.0.0.1:{number}", spare[1]))
    record = tmp_path / "record"
    program = start("run", "--scenario", path, "--record", record)
    program.says("alpha/deaf: no program takes the frames")
    broken.close()
    flood, consumer = keep(UdpOutLink("127.0.0.1", number)), Consumer(heard)
    consumer.read(0)
    frames: list[Frame] = []
    while len(frames) < 100:  # made while the other port was full, the other link away, and this one busy
        for _ in range(20):
            flood.write(bytes(range(256)) * 5)
        frames += consumer.read(1)
    program.stops()
    assert f"{at}: lost" in program.err
    vehicles_ran = json.loads((record / "run.json").read_text())["vehicles"]
    receivers_ran = vehicles_ran["alpha"]["receivers"]
    assert vehicles_ran["charlie"]["counters"]["bytes_skipped"] > 100_000
    assert receivers_ran["deaf"]["dropped"] > 0
    assert receivers_ran["heard"]["dropped"] == 0
    assert {(b.sequence - a.sequence) % 256 for a, b in pairwise(frames)} == {1}
    assert program.err.count("alpha/deaf: no program takes the frames") == 1
    assert "alpha/heard: nobody" not in program.err


def test_a_fleet_may_have_more_files_than_a_program_usually_opens(arva: Arva, tmp_path: Path) -> None:
    """Six a receiver that is recorded. The usual limit is 1024, and lower here."""
    usual = resource.getrlimit(resource.RLIMIT_NOFILE)
    used = len(os.listdir("/proc/self/fd"))
    address = f"udpin:127.0.0.1:{free_port(socket.SOCK_DGRAM)}"
    path = fleet_file(tmp_path, "".join(vehicle(f"v{n}", n, address, "{name: r, port: pty}") for n in range(1, 11)))
    resource.setrlimit(resource.RLIMIT_NOFILE, (used + 30, usual[1]))
    try:
        ended = arva("run", "--scenario", path, "--record", tmp_path / "record", "--timeout", "0.1")
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, usual)
    assert ended.code == 3
    assert "Too many open files" not in ended.err


def test_json_frames_name_vehicle_and_receiver(start: Start, keep: Keep, autopilot: Autopilot, tmp_path: Path) -> None:
    lines = ports(keep, 2)
    receivers = [f"{{name: {n}, port: '{line.path}', rate_hz: 10}}" for n, line in zip("ab", lines, strict=True)]
    path = fleet_file(tmp_path, vehicle("alpha", 1, autopilot.address, *receivers))
    program = start("run", "--scenario", path, "--json", "--duration", 1)
    assert program.ends() == 0
    objects = [json.loads(line) for line in program.out.decode().splitlines()]
    named = [(o["vehicle"], o["receiver"]) for o in objects if "ned_m" in o]
    assert named.count(("alpha", "a")) == named.count(("alpha", "b")) > 0


def test_a_vehicle_without_a_link_of_its_own_has_the_command_lines(
    start: Start, keep: Keep, autopilot: Autopilot, line: PtyLink, tmp_path: Path
) -> None:
    """With one receiver the record is the usual one."""
    path = fleet_file(tmp_path, f"- {{name: alpha, receivers: [{{name: front, port: '{line.path}', rate_hz: 20}}]}}\n")
    record = tmp_path / "record"
    program = start("run", "--scenario", path, "--autopilot", autopilot.address, "--record", record)
    frames = read_until_heard(line)
    program.stops()
    frames += frames_in(line.read())
    assert sorted(path.name for path in record.iterdir()) == [
        "autopilot.tlog",
        "events.jsonl",
        "frames.bin",
        "frames.csv",
        "readings.csv",
        "run.json",
    ]
    assert json.loads((record / "run.json").read_text())["counters"]["frames"] == len(frames)


TWO = "- {{name: a, {a} receivers: [{{name: r, port: {p}}}]}}\n- {{name: b, {b} receivers: [{{name: r, port: {q}}}]}}\n"


@pytest.mark.parametrize(
    ("a", "b", "p", "q", "options", "what"),
    [
        ("autopilot: 'udpin:h:1',", "autopilot: 'udpin:h:2',", "pty", "pty", ["--port", "pty"], "--port: "),
        ("autopilot: 'udpin:h:1',", "autopilot: 'udpin:h:2',", "pty", "pty", ["--autopilot", "pty"], "--autopilot: "),
        (
            "autopilot: 'udpin:h:1',",
            "autopilot: 'udpin:h:2',",
            "pty",
            "pty",
            ["--target-system", "1"],
            "--target-system",
        ),
        ("autopilot: 'udpin:h:1',", "autopilot: 'udpin:h:2',", "pty", "pty", ["--rate", "5"], "--rate: "),
        ("autopilot: 'udpin:h:1',", "autopilot: 'udpin://h:1',", "pty", "pty", [], "give each its own `system`"),
        ("autopilot: 'udpin:localhost:1',", "autopilot: 'udpin:1',", "pty", "pty", [], "give each its own `system`"),
        ("autopilot: 'udpin:h:1',", "autopilot: 'udpin:h:2',", "/dev/x", "'serial:///dev/x'", [], "each needs its own"),
        ("autopilot: '/dev/x',", "autopilot: 'udpin:h:2',", "/dev/x", "pty", [], "each needs its own"),
        (
            "autopilot: 'udpin:0.0.0.0:1',",
            "autopilot: 'udpin:1',",
            "pty",
            "pty",
            [],
            "udpin:127.0.0.1:1, the autopilot of",
        ),
        (
            "autopilot: 'tcpin:[::1]:1',",
            "autopilot: 'udpin:1',",
            "pty",
            "'tcpin:[::]:1'",
            [],
            "the autopilot of a, cannot",
        ),
        ("autopilot: 'udpin:h:1',", "autopilot: 'udpin:h:2',", "log.tlog", "pty", [], "is a log"),
        ("autopilot: 'udpin:h:1',", "autopilot: 'udpin:h:2',", "'-'", "pty", ["--json"], "both go to stdout"),
        ("autopilot: '-',", "autopilot: 'udpin:h:2',", "pty", "pty", [], "cannot be read"),
        ("autopilot: 'nonsense',", "autopilot: 'udpin:h:2',", "pty", "pty", [], "nonsense"),
    ],
)
def test_what_does_not_fit_together_is_refused_before_anything_is_opened(
    arva: Arva, tmp_path: Path, a: str, b: str, p: str, q: str, options: list[str], what: str
) -> None:
    path = fleet_file(tmp_path, TWO.format(a=a, b=b, p=p, q=q))
    ended = arva("run", "--scenario", path, *options)
    assert ended.code == 2
    assert what in ended.err
    assert "Traceback" not in ended.err
    if not options:  # it is wrong whatever the command line says
        assert arva("check", path) == (2, "", ended.err.removeprefix("arva-hil: "))


def test_where_a_vehicle_is_may_be_left_to_the_command_line(arva: Arva, tmp_path: Path) -> None:
    path = fleet_file(tmp_path, TWO.format(a="autopilot: 'udpin:127.0.0.1:14550',", b="", p="pty", q="pty"))
    ended = arva("check", path)
    assert ended.code == 0
    assert ended.out.splitlines()[0] == f"{path}: ok: transmitters 1; vehicles 2"  # each has its own rate and format


def test_a_record_is_not_written_through_a_folder_that_was_there(
    start: Start, keep: Keep, autopilot: Autopilot, tmp_path: Path
) -> None:
    lines, elsewhere, record = ports(keep, 2), tmp_path / "elsewhere", tmp_path / "record"
    elsewhere.mkdir()
    record.mkdir()
    (record / "alpha").symlink_to(elsewhere)
    receivers = [f"{{name: {n}, port: '{line.path}'}}" for n, line in zip("ab", lines, strict=True)]
    path = fleet_file(tmp_path, vehicle("alpha", 1, autopilot.address, *receivers))
    program = start("run", "--scenario", path, "--record", record, "--duration", 1)
    assert program.ends() == 2
    assert "holds a record already (alpha)" in program.err
    assert not list(elsewhere.iterdir())
    until(lambda: sorted(path.name for path in record.iterdir()) == ["alpha"])
