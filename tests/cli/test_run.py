"""`run`, the main job: vehicles on one side, frames on the other; with keys, and with several vehicles."""

from __future__ import annotations

import contextlib
import fcntl
import json
import math
import os
import re
import resource
import socket
import sys
import termios
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from arva_hil.emulator.formats import MavlinkDecoder
from arva_hil.links.pty import PtyLink
from arva_hil.links.tcp import TcpLink, TcpServerLink
from arva_hil.links.tlog import TlogReader
from arva_hil.links.udp import UdpInLink, UdpOutLink
from arva_hil.mavlink.codec import Encoder, dialect
from arva_hil.records.reading import load
from arva_hil.registry import FORMATS
from firmware_proto import SYNTHETIC, Frame, TextDecoder
from tests.files import written
from tests.free_ports import free_port
from tests.mavlink.test_codec import packet
from tests.said import says
from tests.waiting import limited

from .far_ends import (
    Arva,
    Autopilot,
    Consumer,
    Keep,
    Start,
    frames_in,
    hears,
    heartbeat,
    read_frames,
    read_until_heard,
    until,
)


def test_frames_go_from_one_terminal_to_another_at_the_rate_asked_for(
    start: Start, autopilot: Autopilot, line: PtyLink
) -> None:
    program = start("--port", line.path, "--autopilot", autopilot.address, "--rate", 20)
    frames = read_until_heard(line)
    program.stops()
    assert [frame.sequence for frame in frames] == [n % 256 for n in range(len(frames))]
    assert all(frame.status & SYNTHETIC for frame in frames)
    assert not hears(frames[0])  # there is no pose yet
    assert hears(frames[-1])
    says(
        program.err,
        "vehicle ardupilotmega quadrotor 1/1, MAVLink 2",
        "datum: 46.0123000, 7.7456000, 1650.00 m AMSL",
        "20 m north, 5 m east",
        autopilot.address,
        line.path,
    )


@pytest.mark.parametrize("kind", ["udpin", "udpout", "tcp", "tcpin"])
def test_the_autopilot_and_the_consumer_may_be_on_the_network(start: Start, keep: Keep, kind: str) -> None:
    port = free_port(socket.SOCK_DGRAM if kind.startswith("udp") else socket.SOCK_STREAM)
    frames_to = keep(UdpInLink())
    far_end = {"udpout": UdpInLink, "tcp": TcpServerLink}.get(kind)
    if far_end:
        keep(Autopilot(keep(far_end("127.0.0.1", port))))
    program = start(
        "--port", f"udpout:127.0.0.1:{frames_to.port}", "--autopilot", f"{kind}:127.0.0.1:{port}", "--rate", 50
    )
    if not far_end:
        program.says("frames to")
        keep(Autopilot(keep({"udpin": UdpOutLink, "tcpin": TcpLink}[kind]("127.0.0.1", port)), speaks_first=True))
    assert hears(read_until_heard(frames_to)[-1])
    program.stops()


def test_who_speaks_from_another_address_changes_nothing_and_is_counted(
    start: Start, keep: Keep, line: PtyLink, tmp_path: Path
) -> None:
    """Heartbeats, a place and a home of the very vehicle, from another socket."""
    port = free_port(socket.SOCK_DGRAM)
    program = start(
        "--port", line.path, "--autopilot", f"udpin:127.0.0.1:{port}", "--rate", 50, "--record", tmp_path
    ).after("frames to")
    keep(Autopilot(keep(UdpOutLink("127.0.0.1", port)), speaks_first=True))
    program.says("there is a pose")
    stranger, encoder = keep(UdpOutLink("127.0.0.1", port)), Encoder(1, 1)
    for _ in range(20):
        home = dialect.MAVLink_home_position_message(1, 1, 1, 0, 0, 0, [1, 0, 0, 0], 0, 0, 0)
        place = dialect.MAVLink_global_position_int_message(2**31, 1, 1, 1, 0, 0, 0, 0, 0)
        stranger.write(heartbeat(encoder, dialect.MAV_TYPE_GCS) + encoder.pack(home) + encoder.pack(place))
        frames = read_frames(line, 2)
    program.says("other senders than its peer are ignored; the first was 127.0.0.1:")
    program.stops()
    assert hears(frames[-1])
    assert len(re.findall("datum: ", program.err)) == 1
    assert len(re.findall("are ignored", program.err)) == 1
    counters = json.loads((tmp_path / "run.json").read_text())["counters"]
    assert counters["autopilot_link_strangers"] == 20
    assert counters["packets_ignored"] == counters["stray_times"] == counters["reboots"] == 0


def test_a_new_terminal_is_made_its_path_printed_and_its_symlink_gone_in_the_end(
    start: Start, autopilot: Autopilot, tmp_path: Path
) -> None:
    link = tmp_path / "arva0"
    program = start("run", "--port", f"pty:{link}", "--master", autopilot.address)
    path = program.says(rf"frames to: pty:{link} \((/dev/\S+)\)")[1]
    program.says("vehicle ardupilotmega")
    assert os.path.realpath(link) == path
    program.stops()
    assert not os.path.lexists(link)


@pytest.mark.parametrize("form", ["binary", "nmea"])
def test_stdout_carries_the_frames_and_nothing_else(start: Start, autopilot: Autopilot, form: str) -> None:
    program = start("--port", "-", "--autopilot", autopilot.address, "--format", form, "--rate", 20).after(
        "there is a pose"
    )
    program.writes(1000)
    program.stops()
    decoder = FORMATS[form].decoder()
    assert hears((decoder.feed(program.out, 0.0) + decoder.feed(b"", 1.0))[-1])
    assert (decoder.lost, decoder.bad_crc, decoder.dropped) == (0, 0, 0)


def test_json_is_one_object_a_frame_on_stdout(start: Start, autopilot: Autopilot, line: PtyLink) -> None:
    program = start("--port", line.path, "--autopilot", autopilot.address, "--rate", 20, "--json")
    frames = read_until_heard(line)
    program.writes(5000)
    program.stops()
    every = [json.loads(text) for text in program.out.splitlines()]
    assert {"vehicle_found", "pose_found"} <= {said["event"] for said in every if "event" in said}
    objects = [said for said in every if "event" not in said]
    for frame, said in zip(frames, objects, strict=False):
        assert said["seq"] == frame.sequence
        assert [(c["id"], c["d_cm"], c["delta_deg"]) for c in said["channels"]] == [
            (c.id, c.d, c.delta) for c in frame.channels
        ]
    assert objects[0]["ned_m"] is None
    assert objects[-1]["ned_m"] == pytest.approx([0, 0, 0], abs=0.05)  # the vehicle stands at its home
    assert objects[-1]["pose_age_ms"] < 2000
    assert objects[-1]["sent"] is True
    assert not {"\x1b", "\r"} & set(program.err + program.out.decode())  # what is piped has no escape codes


@pytest.mark.parametrize("form", ["tunnel", "named", "named_float", "debug_vect"])
def test_one_port_frames_go_inside_mavlink_on_the_autopilots_link(
    start: Start, autopilot: Autopilot, arva: Callable[..., Any], tmp_path: Path, form: str
) -> None:
    program = start("--autopilot", autopilot.address, "--format", form, "--rate", 20).after("there is a pose")
    heard_so_far = len(autopilot.heard)
    until(lambda: len(autopilot.heard) > heard_so_far + 1000)
    program.stops()
    until(lambda: not autopilot.link.ready())
    decoder = MavlinkDecoder(form)
    frames = decoder.feed(bytes(autopilot.heard), 0.0) + decoder.feed(b"", math.inf)
    channel = frames[-1].channels[0]
    assert channel.id == (None if form == "debug_vect" else 1)
    assert 1000 < channel.d < 4000
    listened = arva("listen", written(tmp_path / "heard.bin", autopilot.heard), "--format", form, "--json")
    assert [json.loads(line)["channels"][0]["d_cm"] for line in listened.out.splitlines()] == [
        frame.channels[0].d for frame in frames
    ]


def test_every_option_has_a_twin_in_the_environment(start: Start, autopilot: Autopilot) -> None:
    twins = {
        "AUTOPILOT": autopilot.address,
        "PORT": "-",
        "FORMAT": "text",
        "RATE": "20",
        "SEED": "7",
        "DURATION": "4",
        "VERBOSE": "1",
        "JSON": "no",
    }
    program = start(env={**os.environ, **{f"ARVA_HIL_{name}": value for name, value in twins.items()}})
    assert "20 Hz, text, seed 7" in program.ends()
    assert TextDecoder().feed(program.out, 0.0)[-1].channels[0].valid
    assert " #1 mid" in program.err  # -v: a line for every frame


@pytest.fixture
def many_channels(tmp_path: Path) -> Path:
    """Frames so long and so many that whatever holds them is soon full."""
    return written(
        tmp_path / "many_channels.yaml",
        "transmitters: [{id: 1, enu: [5, 20, 0]}]\nreceiver: {channels: 16, rate_hz: 50}\n",
    )


def test_a_consumer_that_never_reads_costs_frames_but_not_the_loop(
    start: Start, autopilot: Autopilot, line: PtyLink, many_channels: Path, tmp_path: Path
) -> None:
    program = start(
        *("--port", line.path, "--autopilot", autopilot.address, "--scenario", many_channels, "--format", "nmea"),
        *("--duration", 2.5, "--record", tmp_path / "record"),
    )
    program.ends()
    assert program.err.count("no program takes the frames") == 1
    counters = json.loads((tmp_path / "record" / "run.json").read_bytes())["counters"]
    assert counters["frames"] + counters["skipped"] >= 126
    assert 0 < counters["dropped"] < counters["frames"]
    assert f"{counters['dropped']} dropped" in program.err


def test_a_reader_of_stdout_that_has_stopped_holds_nothing_up(
    start: Start, autopilot: Autopilot, line: PtyLink, many_channels: Path, tmp_path: Path
) -> None:
    reader, writer = os.pipe()
    fcntl.fcntl(writer, fcntl.F_SETPIPE_SZ, 4096)
    program = start(
        *("--port", line.path, "--autopilot", autopilot.address, "--scenario", many_channels, "--json"),
        *("--duration", 1.5, "--record", tmp_path / "record"),
        stdout=writer,
    )
    os.close(writer)
    read_frames(line, 20)
    program.ends(1)
    os.close(reader)
    assert "error: -: its reader did not take every line" in program.err
    assert json.loads((tmp_path / "record" / "run.json").read_bytes())["exit_code"] == 1


def test_without_an_autopilot_named_the_usual_place_is_tried_and_printed(start: Start, line: PtyLink) -> None:
    """Whether nobody speaks there, a simulator does, or another program listens there already."""
    start("--port", line.path, "--timeout", 0.2, "--duration", 1).after("autopilot: ").ends(0, 3)


# -- --signing-key: which files are taken, and a run with a vehicle that has the same key ----------------------


KEY = "0123456789abcdef" * 4


def key_file(folder: Path, content: bytes, mode: int = 0o600) -> Path:
    file = written(folder / "key", content)
    file.chmod(mode)
    return file


@pytest.mark.parametrize("mode", [0o640, 0o604, 0o620, 0o644, 0o660, 0o777, 0o601])
def test_a_key_that_others_may_read_is_refused(arva: Arva, tmp_path: Path, mode: int) -> None:
    file = key_file(tmp_path, KEY.encode(), mode)
    assert f"{file}: other users may read or write it ({mode:o}): chmod 600 {file}" in arva.refused(
        "--port", "pty", "--signing-key", file
    )


def test_a_key_that_a_service_manager_keeps_is_taken(
    arva: Arva, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = key_file(tmp_path, KEY.encode(), 0o440)
    monkeypatch.setenv("CREDENTIALS_DIRECTORY", str(tmp_path))
    options = ["--port", "pty", "--autopilot", "pty", "--duration", "0.1", "--timeout", "0.1"]
    arva(*options, "--signing-key", file, code=3)
    monkeypatch.setenv("CREDENTIALS_DIRECTORY", str(tmp_path / "elsewhere"))
    arva(*options, "--signing-key", file, code=2)


@pytest.mark.parametrize(
    ("content", "what"),
    [
        (b"", "empty"),
        (b"\n", "empty"),
        (b"one\ntwo\n", "2 lines"),
        (b"pass\xffphrase", "byte 5 is not text"),
        (b"x" * 5000, "more than 4096 bytes"),
    ],
)
@pytest.mark.parametrize("command", [["--port", "pty"], ["search", "--autopilot", "pty", "--receiver", "pty"]])
def test_a_file_without_a_key_is_refused(
    arva: Arva, tmp_path: Path, command: list[str], content: bytes, what: str
) -> None:
    file = key_file(tmp_path, content)
    err = arva.refused(*command, "--signing-key", file)
    assert f"--signing-key {file}: {what}, expected 64 hexadecimal digits" in err
    assert KEY not in err


def test_what_is_no_file_is_refused(arva: Arva, tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe, 0o600)
    for path, what in ((tmp_path / "none", "No such file"), (tmp_path, "Is a directory"), (pipe, "is not a file")):
        assert f"--signing-key {path}: {what}" in arva.refused("--port", "pty", "--signing-key", path)


def test_with_the_vehicles_key_all_is_as_without(start: Start, keep: Keep, line: PtyLink, tmp_path: Path) -> None:
    vehicle = keep(Autopilot(keep(PtyLink()), key=bytes.fromhex(KEY)))
    options = ["--signing-key", key_file(tmp_path, KEY.encode()), "--record", tmp_path / "record", "--rate", 20]
    program = start("--port", line.path, "--autopilot", vehicle.address, *options)
    read_until_heard(line)
    assert "MAVLink 2, signed" in program.stops()
    counters = json.loads((tmp_path / "record" / "run.json").read_text())["counters"]
    assert {name: counters[f"packets_{name}"] for name in ("unsigned", "forged", "replayed")} == {
        "unsigned": 0,
        "forged": 0,
        "replayed": 0,
    }
    assert not any(KEY.encode() in file.read_bytes() for file in (tmp_path / "record").iterdir())


def test_a_home_that_cannot_be_written_is_one_line_and_the_run_goes_on(
    arva: Arva, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(key := key_file(tmp_path, KEY.encode())))
    err = arva(
        "--port", "pty", "--autopilot", "pty", "--duration", "0.1", "--timeout", "0.1", "--signing-key", key, code=3
    ).err
    assert err.count("time stamps of signatures are not stored (Not a directory)") == 1


def test_with_another_key_no_autopilot_is_heard(start: Start, keep: Keep, line: PtyLink, tmp_path: Path) -> None:
    vehicle = keep(Autopilot(keep(PtyLink()), key=bytes(32)))
    options = ["--signing-key", key_file(tmp_path, KEY.encode()), "--timeout", 1.5]
    program = start("--port", line.path, "--autopilot", vehicle.address, *options)
    assert "packets signed with another key are ignored, the first from 1/1" in program.ends(3)
    assert "no autopilot's with the key: 0 unsigned, " in program.err
    assert not hears(read_frames(line, 1)[-1])


def test_without_a_key_a_vehicle_that_signs_takes_no_request(start: Start, keep: Keep, line: PtyLink) -> None:
    program = start("--port", line.path, "--autopilot", keep(Autopilot(keep(PtyLink()), key=bytes(32))).address).after(
        "its packets are signed. They are not checked"
    )
    assert "--signing-key FILE" in program.stops()
    assert not hears(read_frames(line, 1)[-1])


# -- `run` with a scenario that names its vehicles: all of them in one process, each receiver on a port of its o--


TRANSMITTER = "spec: 2\ntransmitters: [{id: 1, ned: [20, 5, 0]}]\nreceiver: {noise: {kind: off}}\n"


def fleet_file(folder: Path, vehicles: str) -> Path:
    return written(folder / "fleet.yaml", TRANSMITTER + "vehicles:\n" + vehicles)


def vehicle(name: str, system: int, address: str, *receivers: str) -> str:
    """One vehicle, as in the file."""
    return f"- {{name: {name}, system: {system}, autopilot: '{address}', receivers: [%s]}}\n" % ", ".join(receivers)


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
    program = start("run", "--scenario", path, "--record", record, "--json").after(
        *(f"{name}: there is a pose" for name in ("alpha/front", "alpha/rear", "bravo/front", "bravo/rear"))
    )
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
    told = [said for said in map(json.loads, program.out.decode().splitlines()) if "ned_m" in said]
    for name, system in (("alpha", 1), ("bravo", 2)):
        assert f"{name}: vehicle ardupilotmega quadrotor {system}/1" in program.err
    for name, frames in kept.items():
        assert sum(f"{said['vehicle']}/{said['receiver']}" == name for said in told) == len(frames)
        assert (counters[name]["frames"], counters[name]["dropped"]) == (len(frames), 0)
        assert (record / name / "readings.csv").read_text().count("\n") == 1 + 4 * len(frames)
        assert (record / name / "frames.csv").read_text().count("\n") == 1 + len(frames)
    assert frames_in((record / "bravo/rear/frames.bin").read_bytes()) == kept["bravo/rear"]
    for name, system in (("alpha", 1), ("bravo", 2)):
        said = run["vehicles"][name]
        assert said["vehicle"]["system"] == system
        assert len(list(TlogReader(record / said["tlog"]))) == said["counters"]["packets_received"] > 0
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
    program = start(
        "run", "--scenario", fleet_file(tmp_path, four_receivers((address, address), lines)), "--record", record
    ).after("frames of bravo/rear to")
    for system in (1, 2):
        link = keep(UdpOutLink("127.0.0.1", port))
        keep(Autopilot(link, speaks_first=True, system=system))
    program.says(*(f"{name}: there is a pose" for name in ("alpha/front", "alpha/rear", "bravo/front", "bravo/rear")))
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


def test_vehicles_that_never_appear_are_said_once_in_one_sentence_while_another_flies(
    start: Start, keep: Keep, autopilot: Autopilot, tmp_path: Path
) -> None:
    (heard, unheard), nobody, names = ports(keep, 2), keep(PtyLink()), [f"v{system}" for system in range(2, 10)]
    places = [f"port: '{unheard.path}', rate_hz: 25", *["port: pty"] * 7]
    absent = [
        vehicle(n, int(n[1]), nobody.path, f"{{name: r, {place}}}") for n, place in zip(names, places, strict=True)
    ]
    flies = vehicle("v1", 1, autopilot.address, f"{{name: r, port: '{heard.path}', rate_hz: 20}}")
    program = start("run", "--scenario", fleet_file(tmp_path, flies + "".join(absent)), "--timeout", 1).after(
        "no byte came", "v1/r: there is a pose"
    )
    consumer = Consumer(unheard)
    frames = consumer.read(0) + consumer.read(20)
    err = program.stops()
    says(
        err, f"warning: {', '.join(names)}: no byte came", f"{nobody.path} (8 vehicles): no vehicle was found; 0 bytes"
    )
    assert err.count("no byte came") == err.count("no vehicle was found") == 1
    assert hears(frames_in(heard.read())[-1])
    assert not any(frame.channels[0].valid for frame in frames)


def test_when_no_vehicle_appears_in_time_it_ends_with_3(start: Start, keep: Keep, tmp_path: Path) -> None:
    lines, nobody = ports(keep, 4), ports(keep, 2)
    path = fleet_file(tmp_path, four_receivers((nobody[0].path, nobody[1].path), lines))
    assert start("run", "--scenario", path, "--timeout", 1).ends(3).count("error: no byte came") == 1


def test_an_unread_port_a_broken_link_and_a_flood_hold_up_no_other(start: Start, keep: Keep, tmp_path: Path) -> None:
    autopilot = keep(Autopilot(keep(PtyLink()), speed=1.0))
    deaf, heard, *others = ports(keep, 4)
    fill(deaf)
    broken, number = keep(PtyLink(at := str(tmp_path / "broken"))), free_port(socket.SOCK_DGRAM)
    receivers = [f"{{name: {n}, port: '{line.path}', rate_hz: 50}}" for n, line in (("deaf", deaf), ("heard", heard))]
    spare = [f"{{name: r, port: '{line.path}'}}" for line in others]
    vehicles = vehicle("alpha", 1, autopilot.address, *receivers) + vehicle("bravo", 2, at, spare[0])
    path = fleet_file(tmp_path, vehicles + vehicle("charlie", 3, f"udpin:127.0.0.1:{number}", spare[1]))
    record = tmp_path / "record"
    program = start("run", "--scenario", path, "--record", record, speed=1.0).after(
        "alpha/deaf: no program takes the frames"
    )
    broken.close()
    flood, consumer = keep(UdpOutLink("127.0.0.1", number)), Consumer(heard)
    consumer.read(0)
    frames: list[Frame] = []
    while len(frames) < 100:  # made while the other port was full, the other link away, and this one busy
        for _ in range(20):
            flood.write(bytes(range(256)) * 5)
        frames += consumer.read(1)
    says(program.stops(), f"{at}: lost", "\nbravo: no vehicle was found; its link: 0 bytes")
    assert re.search(r"(?m)^alpha/heard: \d+ frames: \d+ sent", program.err)
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
    used = len(os.listdir("/proc/self/fd"))
    address = f"udpin:127.0.0.1:{free_port(socket.SOCK_DGRAM)}"
    path = fleet_file(tmp_path, "".join(vehicle(f"v{n}", n, address, "{name: r, port: pty}") for n in range(1, 11)))
    with limited(resource.RLIMIT_NOFILE, used + 30):
        ended = arva("run", "--scenario", path, "--record", tmp_path / "record", "--timeout", "0.1", code=3)
    assert "Too many open files" not in ended.err


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
        ("system: 1,", "system: 2,", "nonsense", "pty", ["--json"], "'nonsense' is no connection, expected"),
    ],
)
def test_what_does_not_fit_together_is_refused_before_anything_is_opened(
    arva: Arva, tmp_path: Path, a: str, b: str, p: str, q: str, options: list[str], what: str
) -> None:
    path = fleet_file(tmp_path, TWO.format(a=a, b=b, p=p, q=q))
    err = arva.refused("run", "--scenario", path, *options)
    assert what in err
    if not options:  # it is wrong whatever the command line says
        assert arva.refused("check", path) == err.removeprefix("arva-hil: ")


def test_where_a_vehicle_is_may_be_left_to_the_command_line(arva: Arva, tmp_path: Path) -> None:
    path = fleet_file(tmp_path, TWO.format(a="autopilot: 'udpin:127.0.0.1:14550',", b="", p="pty", q="pty"))
    ended = arva("check", path)
    assert ended.out.splitlines()[0] == f"{path}: ok: transmitters 1; vehicles 2"  # each has its own rate and format


def test_a_record_is_not_written_through_a_folder_that_was_there(arva: Arva, tmp_path: Path) -> None:
    elsewhere, record = tmp_path / "elsewhere", tmp_path / "record"
    elsewhere.mkdir()
    record.mkdir()
    (record / "alpha").symlink_to(elsewhere)
    path = fleet_file(tmp_path, vehicle("alpha", 1, "pty", "{name: a, port: pty}", "{name: b, port: pty}"))
    assert "holds a record already (alpha); name another folder" in arva.refused(
        "run", "--scenario", path, "--record", record
    )
    assert [*elsewhere.iterdir(), *record.iterdir()] == [record / "alpha"]
