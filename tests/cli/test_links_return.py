"""Links that are lost while `run` goes on, and come back."""

from __future__ import annotations

import json
import os
import signal
import socket
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import serial

from arva_hil.links.pty import PtyLink
from arva_hil.links.tcp import TcpLink
from arva_hil.links.tcp_server import TcpServerLink
from arva_hil.links.udp import UdpOutLink
from arva_hil.mavlink.codec import Encoder, dialect
from firmware_proto import Decoder, Frame
from tests.free_ports import free_port

from .far_ends import Autopilot, Keep, Start, hears, heartbeat, read_frames, read_until_heard, until


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


class Consumer:
    """Reads a line all the time; `frames` of it."""

    def __init__(self, link: Any) -> None:
        self.frames: list[Frame] = []
        self.decoder = Decoder()
        self._link = link

    def hears(self) -> bool:
        """Read on; whether the last frame hears a transmitter."""
        self.frames += self.decoder.feed(self._link.read(), 0.0)
        return bool(self.frames) and hears(self.frames[-1])


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
    program.send(signal.SIGTERM)
    assert program.ends() == 130
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
    after = read_frames(plug(), 20)
    program.says(rf"\n{plug.url}: back")
    program.send(signal.SIGTERM)
    assert program.ends() == 130
    assert hears(before[-1])
    assert all(map(hears, after))  # the autopilot's side went on all the time
    counters = json.loads((record / "run.json").read_bytes())["counters"]
    assert (counters["port_link_losses"], counters["port_link_returns"]) == (1, 1)
    assert counters["dropped"] > 0
    assert counters["autopilot_link_losses"] == 0
    assert "no program takes" not in program.err  # it is said already


def test_a_simulator_that_is_started_after_the_emulator_is_waited_for(
    start: Start, keep: Keep, line: PtyLink, tmp_path: Path
) -> None:
    port = free_port(socket.SOCK_STREAM)
    url = f"tcp:127.0.0.1:{port}"
    program = start("--port", line.path, "--autopilot", url, "--rate", 50, "--record", tmp_path / "record")
    program.says(f"waiting for {url}: connection refused; is the autopilot running")
    consumer = Consumer(line)
    until(lambda: not consumer.hears() and len(consumer.frames) > 10)  # frames go on meanwhile
    keep(Autopilot(keep(TcpServerLink("127.0.0.1", port))))
    until(consumer.hears)
    program.says(f"{url}: is open")
    program.send(signal.SIGTERM)
    assert program.ends() == 130
    assert "lost" not in program.err
    counters = json.loads((tmp_path / "record" / "run.json").read_bytes())["counters"]
    assert counters["autopilot_link_losses"] == counters["autopilot_link_returns"] == 0


def test_a_consumer_that_is_started_after_the_emulator_is_waited_for(
    start: Start, autopilot: Autopilot, keep: Keep
) -> None:
    port = free_port(socket.SOCK_STREAM)
    url = f"tcp:127.0.0.1:{port}"
    program = start("--port", url, "--autopilot", autopilot.address, "--rate", 50)
    program.says(f"waiting for {url}: connection refused")
    program.says("there is a pose")
    consumer = Consumer(keep(TcpServerLink("127.0.0.1", port)))
    until(consumer.hears)
    program.says(f"{url}: is open")
    program.send(signal.SIGTERM)
    assert program.ends() == 130


@pytest.mark.parametrize("kind", ["tcpin", "udpin"])
def test_a_server_takes_the_next_client(start: Start, keep: Keep, line: PtyLink, kind: str) -> None:
    """The autopilot, or what forwards it, is started again; over UDP it has another port then."""
    port = free_port(socket.SOCK_DGRAM if kind == "udpin" else socket.SOCK_STREAM)
    client = {"udpin": UdpOutLink, "tcpin": TcpLink}[kind]
    url = f"{kind}:127.0.0.1:{port}"
    program = start("--port", line.path, "--autopilot", url, "--rate", 50, "--max-age", 0.3)
    program.says("frames to")
    consumer = Consumer(line)
    first = keep(Autopilot(client("127.0.0.1", port), speaks_first=True))
    until(consumer.hears)
    first.close()
    until(lambda: not consumer.hears())
    keep(Autopilot(keep(client("127.0.0.1", port)), speaks_first=True))
    until(consumer.hears)
    program.says(rf"\nwarning: {url}: lost: ")
    program.says(rf"\n{url}: back")
    program.send(signal.SIGTERM)
    assert program.ends() == 130


def test_a_link_that_stays_away_does_not_end_the_run(start: Start, keep: Keep, line: PtyLink, tmp_path: Path) -> None:
    vehicle = keep(Autopilot(keep(PtyLink(path := str(tmp_path / "fc")))))
    program = start("--port", line.path, "--autopilot", path, "--rate", 50)
    read_until_heard(line)
    vehicle.close()
    program.says("lost: ")
    read_frames(line, 40)
    program.stops()
    assert "the autopilot's link was lost 1 ×, and came back 0 ×" in program.err


def test_a_link_lost_before_the_first_heartbeat_is_the_reason_given(start: Start, keep: Keep, tmp_path: Path) -> None:
    line = keep(PtyLink(path := str(tmp_path / "fc")))
    program = start("--port", "pty", "--autopilot", path, "--timeout", 1)
    program.says("scenario")
    line.write(heartbeat(Encoder(255, 190), dialect.MAV_TYPE_GCS, dialect.MAV_AUTOPILOT_INVALID))
    line.close()
    assert program.ends() == 3
    assert f"error: no autopilot was found: {path}: lost" in program.err


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
    program.send(signal.SIGTERM)
    assert program.ends() == 130
    assert program.err.count("busy") == 1


def test_one_port_frames_survive_an_absence(start: Start, keep: Keep, plug: Any) -> None:
    first = keep(Autopilot(plug()))
    program = start("--autopilot", plug.url, "--format", "tunnel", "--rate", 20)
    program.says("readings are real")
    first.close()
    program.says("lost")
    second = keep(Autopilot(plug()))
    program.says("back")
    until(lambda: second.heard.count(b"\xa4\x57") > 10)
    program.send(signal.SIGTERM)
    assert program.ends() == 130
