"""`vehicle`: the built-in vehicle for whoever wants to talk to it."""

from __future__ import annotations

import socket
from collections.abc import Callable
from typing import Any

import pytest

from arva_hil.cli import vehicle as arguments
from arva_hil.clock import RealClock
from arva_hil.links import Link
from arva_hil.links.tcp import TcpLink
from arva_hil.links.udp import UdpInLink
from arva_hil.mavlink.codec import Encoder, Parser, command, decode, dialect
from arva_hil.simulated.arducopter import FAILSAFES
from tests.free_ports import free_port

from .conftest import Ended
from .far_ends import DEADLINE_S, Keep, Start

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
    )
    program.says("link: udpout")
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
    beside.says(command(4, 1, dialect.MAV_CMD_DO_SET_MODE, 1, GUIDED))
    near.hears("HEARTBEAT", 4, lambda m: m.custom_mode == GUIDED)
    near.hears("HEARTBEAT", 3, lambda m: m.custom_mode != GUIDED)
    program.says("vehicle 4: GUIDED, disarmed, on the ground")


@pytest.mark.parametrize(("name", "mode"), [("geofence", 6), ("battery", 6), ("ekf", 9), ("radio", 6)])
def test_a_failsafe_strikes_at_its_time_in_the_air(start: Start, keep: Keep, name: str, mode: int) -> None:
    port = free_port(socket.SOCK_STREAM)
    program = start("vehicle", "--link", f"tcpin:127.0.0.1:{port}", "--failsafe", f"{name}@0.5")
    program.says("link: tcpin")
    station = GroundStation(keep(TcpLink("127.0.0.1", port)))
    station.hears("HEARTBEAT")
    station.says(
        command(1, 1, dialect.MAV_CMD_DO_SET_MODE, 1, GUIDED),
        command(1, 1, dialect.MAV_CMD_COMPONENT_ARM_DISARM, 1),
        command(1, 1, dialect.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, 5),
    )
    station.hears("STATUSTEXT", good=lambda m: name[:2] in m.text.lower() or "breached" in m.text)
    station.hears("HEARTBEAT", good=lambda m: m.custom_mode == mode)
    program.says(f"failsafe: {name}")


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ([], "the following arguments are required: --link URL"),
        (["--link", "nonsense:1:2:3"], "--link"),
        (["--link", "udpout:127.0.0.1:1", "--link", "udpout:127.0.0.1:1"], "udpout:127.0.0.1:1: named twice"),
        (["--link", "pty", "--home", "95,0,0"], "'95,0,0': latitude 95 is out of range"),
        (["--link", "pty", "--home", "1,2"], "'1,2': expected LAT,LON,ALT"),
        (["--link", "pty", "--wind", "nan,0,0"], "'nan,0,0': expected N,E,D in m/s"),
        (["--link", "pty", "--failsafe", "bears@3"], "'bears@3': expected NAME@SECONDS, where NAME is one of geofence"),
        (["--link", "pty", "--failsafe", "ekf@soon"], "'ekf@soon': expected NAME@SECONDS"),
        (["--link", "pty", "--system", "240", "--count", "20"], "ids go up to 250"),
    ],
)
def test_what_makes_no_sense_is_refused(arva: Callable[..., Ended], options: list[str], said: str) -> None:
    code, _, err = arva("vehicle", *options)
    assert code == 2
    assert said in err


def test_a_link_that_is_taken_is_said(arva: Callable[..., Ended], keep: Keep, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("arva_hil.links.tcp.getpid", lambda: 0)  # the test has the address, not the program
    taken = keep(socket.create_server(("127.0.0.1", 0)))
    code, _, err = arva("vehicle", "--link", f"tcpin:127.0.0.1:{taken.getsockname()[1]}")
    assert code == 3
    assert "another program listens there" in err


def test_every_failsafe_of_the_vehicle_can_be_asked_for() -> None:
    assert list(FAILSAFES) == list(arguments.FAILSAFES)
