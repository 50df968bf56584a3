"""`run`, the main job: a vehicle on one side, frames on the other."""

from __future__ import annotations

import contextlib
import fcntl
import json
import math
import os
import re
import socket
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from arva_hil.emulator.formats import MavlinkDecoder
from arva_hil.links import LinkError
from arva_hil.links.pty import PtyLink
from arva_hil.links.tcp import TcpLink
from arva_hil.links.tcp_server import TcpServerLink
from arva_hil.links.udp import UdpInLink, UdpOutLink
from arva_hil.mavlink.codec import Encoder, dialect
from firmware_proto import SYNTHETIC, NmeaDecoder, TextDecoder
from tests.free_ports import free_port

from .far_ends import Autopilot, Keep, Start, frames_in, hears, heartbeat, read_frames, read_until_heard, until


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
    assert "vehicle ardupilotmega quadrotor 1/1, MAVLink 2" in program.err
    assert "datum: 46.0123000, 7.7456000, 1650.00 m AMSL" in program.err
    assert "20 m north, 5 m east" in program.err
    assert autopilot.address in program.err
    assert line.path in program.err


@pytest.mark.parametrize("kind", ["udpin", "udpout", "tcp", "tcpin"])
def test_the_autopilot_and_the_consumer_may_be_on_the_network(start: Start, keep: Keep, kind: str) -> None:
    port = free_port(socket.SOCK_DGRAM if kind.startswith("udp") else socket.SOCK_STREAM)
    frames_to = keep(UdpInLink())
    far_end = {"udpout": UdpInLink, "tcp": TcpServerLink}.get(kind)
    if far_end:
        keep(Autopilot(keep(far_end("127.0.0.1", port))))
    url = f"udpout:127.0.0.1:{frames_to.port}"
    program = start("--port", url, "--autopilot", f"{kind}:127.0.0.1:{port}", "--rate", 50)
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
    program = start("--port", line.path, "--autopilot", f"udpin:127.0.0.1:{port}", "--rate", 50, "--record", tmp_path)
    program.says("frames to")
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


def test_who_sends_a_byte_before_the_vehicle_does_not_keep_it_out(start: Start, keep: Keep, line: PtyLink) -> None:
    port = free_port(socket.SOCK_DGRAM)
    program = start("--port", line.path, "--autopilot", f"udpin:127.0.0.1:{port}", "--rate", 50)
    program.says("frames to")
    stranger = keep(UdpOutLink("127.0.0.1", port))
    stranger.write(b"x")
    keep(Autopilot(keep(UdpOutLink("127.0.0.1", port)), speaks_first=True))
    program.says("there is a pose")
    assert stranger.read() == b""  # nor is it answered
    program.stops()


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


def test_stdout_carries_the_frames_and_nothing_else(start: Start, autopilot: Autopilot) -> None:
    program = start("--port", "-", "--autopilot", autopilot.address, "--rate", 20)
    program.says("there is a pose")
    program.writes(500)
    program.stops()
    assert hears(frames_in(program.out)[-1])


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


def test_frames_may_be_lines_of_text(start: Start, autopilot: Autopilot) -> None:
    program = start("--port", "-", "--autopilot", autopilot.address, "--format", "nmea", "--rate", 20)
    program.says("there is a pose")
    program.writes(1000)
    program.stops()
    assert program.out.isascii()
    assert NmeaDecoder().feed(program.out, 0.0)[-1].channels[0].d in range(1000, 4000)


@pytest.mark.parametrize("form", ["tunnel", "named", "named_float", "debug_vect"])
def test_one_port_frames_go_inside_mavlink_on_the_autopilots_link(
    start: Start, autopilot: Autopilot, arva: Callable[..., Any], tmp_path: Path, form: str
) -> None:
    program = start("--autopilot", autopilot.address, "--format", form, "--rate", 20)
    program.says("there is a pose")
    heard_so_far = len(autopilot.heard)
    until(lambda: len(autopilot.heard) > heard_so_far + 1000)
    program.stops()
    until(lambda: not autopilot.link.ready())
    decoder = MavlinkDecoder(form)
    frames = decoder.feed(bytes(autopilot.heard), 0.0) + decoder.feed(b"", math.inf)
    channel = frames[-1].channels[0]
    assert channel.id == (None if form == "debug_vect" else 1)
    assert 1000 < channel.d < 4000
    heard = tmp_path / "heard.bin"
    heard.write_bytes(autopilot.heard)
    listened = arva("listen", heard, "--format", form, "--json")
    assert listened.code == 0
    assert [json.loads(line)["channels"][0]["d_cm"] for line in listened.out.splitlines()] == [
        frame.channels[0].d for frame in frames
    ]


@pytest.mark.parametrize(
    ("environment", "arguments", "hz"),
    [
        ({}, [], 4.0),
        ({"ARVA_HIL_RATE": "20"}, [], 20.0),
        ({"ARVA_HIL_RATE": "20"}, ["--rate", "10"], 10.0),
    ],
)
def test_the_command_line_is_stronger_than_the_environment_which_is_stronger_than_the_file(
    arva: Callable[..., Any],
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    environment: dict[str, str],
    arguments: list[str],
    hz: float,
) -> None:
    scenario = tmp_path / "scenario.yaml"
    scenario.write_text("transmitters: [{id: 1, enu: [0, 0, 0]}]\nreceiver: {rate_hz: 4}\n")
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    log = Path(__file__).parent.parent / "data" / "arducopter.tlog"
    code, _, err = arva("replay", log, "--scenario", scenario, "--out", os.devnull, *arguments)
    assert code == 0
    assert f"{hz:g} Hz" in err
    assert int(err.split(" frames:")[0].split("\n")[-1]) == pytest.approx(29.8 * hz, abs=2)


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
    assert program.ends() == 0
    assert "20 Hz, text, seed 7" in program.err
    assert TextDecoder().feed(program.out, 0.0)[-1].channels[0].valid
    assert " #1 mid" in program.err  # -v: a line for every frame


@pytest.fixture
def many_channels(tmp_path: Path) -> Path:
    """Frames so long and so many that whatever holds them is soon full."""
    scenario = tmp_path / "many_channels.yaml"
    scenario.write_text("transmitters: [{id: 1, enu: [5, 20, 0]}]\nreceiver: {channels: 16, rate_hz: 50}\n")
    return scenario


def test_a_consumer_that_never_reads_costs_frames_but_not_the_loop(
    start: Start, autopilot: Autopilot, line: PtyLink, many_channels: Path, tmp_path: Path
) -> None:
    program = start(
        *("--port", line.path, "--autopilot", autopilot.address, "--scenario", many_channels, "--format", "nmea"),
        *("--duration", 2.5, "--record", tmp_path / "record"),
    )
    assert program.ends() == 0
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
    assert program.ends() == 1
    os.close(reader)
    assert "error: -: its reader did not take every line" in program.err
    assert json.loads((tmp_path / "record" / "run.json").read_bytes())["exit_code"] == 1


def test_without_an_autopilot_named_the_usual_place_is_tried_and_printed(start: Start, line: PtyLink) -> None:
    """Whether nobody speaks there, a simulator does, or another program listens there already."""
    program = start("--port", line.path, "--timeout", 0.2, "--duration", 1)
    program.says("autopilot: ")
    assert program.ends() in (0, 3)


def test_silent_tcp_clients_neither_keep_the_vehicle_out_nor_are_answered(
    start: Start, keep: Keep, line: PtyLink
) -> None:
    port = free_port(socket.SOCK_STREAM)
    program = start("--port", line.path, "--autopilot", f"tcpin:127.0.0.1:{port}", "--rate", 50)
    program.says("frames to")
    read_frames(line, 2)
    strangers = [keep(TcpLink("127.0.0.1", port)) for _ in range(8)]
    keep(Autopilot(keep(TcpLink("127.0.0.1", port)), speaks_first=True))
    program.says("there is a pose")
    for stranger in strangers:
        with contextlib.suppress(LinkError):  # it gave way to another
            assert stranger.read() == b""
    program.stops()
