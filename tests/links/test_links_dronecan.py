"""The serial tunnel of DroneCAN, on the virtual bus of python-can and on a simulator's multicast."""

from __future__ import annotations

import contextlib
import errno
import socket
import sys
from collections.abc import Callable
from importlib.util import find_spec
from random import Random
from types import SimpleNamespace
from typing import Any

import pytest

from arva_hil.clock import RealClock
from arva_hil.links import AddressError, Link, LinkError, open_link
from arva_hil.links.dronecan import PythonCanBus, open_bus
from arva_hil.links.reconnecting import open_reconnecting
from firmware_proto import Channel, Decoder, Frame, encode
from tests.every import every
from tests.links.links_waiting import receive

can = pytest.importorskip("can")
pytestmark = pytest.mark.skipif(find_spec("dronecan") is None, reason="dronecan is not installed")

Keep = Callable[[Link], Link]
FRAME = encode(Frame(7, 1, (Channel(1, 1, 1905, 22), Channel())))


def ends(keep: Keep, bus: str) -> tuple[Link, Link]:
    """Return a receiver and an autopilot on a bus."""
    clock = RealClock()
    receiver = keep(open_link(f"can:SERIAL0,node=42,bus={bus}", clock=clock))
    return receiver, keep(open_link(f"can:SERIAL0,node=10,to=42,bus={bus}", clock=clock))


@pytest.mark.parametrize("bus", ["virtual:both-ways", "mcast:9"])
def test_bytes_pass_both_ways(keep: Keep, bus: str) -> None:
    receiver, autopilot = ends(keep, bus)
    long = bytes(range(256)) * 2
    assert receiver.write(long)
    assert receive(autopilot, len(long)) == long
    assert autopilot.write(b"command")
    assert receive(receiver, 7) == b"command"


def test_bytes_that_came_before_a_write_are_ready_after_it(keep: Keep) -> None:
    receiver, autopilot = ends(keep, "virtual:before-a-write")
    with socket.socket() as silent:
        silent.bind(("127.0.0.1", 0))
        silent.listen()
        receiver._fd = silent.fileno()  # as on SocketCAN, where a descriptor is ready only while frames wait
        assert autopilot.write(b"command")
        assert receiver.write(FRAME)
        assert receiver.ready()
        assert receiver.read() == b"command"
        assert not receiver.ready()
    receiver.close()
    autopilot.close()
    assert not receiver.ready()
    assert not autopilot.ready()


def test_another_port_and_another_node_are_not_read(keep: Keep) -> None:
    receiver, autopilot = ends(keep, "virtual:ports")
    clock = RealClock()
    for other in "can:SERIAL1,node=42,bus=virtual:ports", "can:SERIAL0,node=43,bus=virtual:ports":
        assert keep(open_link(other, clock=clock)).write(b"not this")
    assert receiver.write(b"this")
    assert receive(autopilot, 4) == b"this"
    assert not autopilot.ready()


def test_the_node_says_who_it_is(keep: Keep) -> None:
    """ArduPilot's server of node IDs asks each node."""
    import dronecan  # here: it takes 0.3 s, in every worker that only collects this test

    receiver, _ = ends(keep, "virtual:node")
    asking = dronecan.node.Node(open_bus("virtual:node", [(0, 0)]), node_id=99)
    answers: list[Any] = []
    asking.request(dronecan.uavcan.protocol.GetNodeInfo.Request(), 42, answers.append)
    receiver.read()
    asking.spin(0)
    asking.close()
    (answer,) = answers
    assert answer.response.name.decode() == "org.arva_hil.receiver"
    assert answer.response.status.mode == answer.response.status.MODE_OPERATIONAL


def test_wrong_frames_of_other_nodes_are_counted_and_do_no_harm(keep: Keep) -> None:
    receiver, autopilot = ends(keep, "virtual:wrong")
    random = Random(457)
    with can.Bus(interface="virtual", channel="wrong") as bus:
        for _ in range(300):
            tunnel, request = 16 << 24 | 3001 << 8 | 42, 16 << 24 | 1 << 16 | 10 << 8 | 0x80
            id_ = random.choice([tunnel, request, random.getrandbits(29)])
            data = random.randbytes(random.randrange(8)) + bytes([0xC0 | random.randrange(32)])
            bus.send(can.Message(arbitration_id=id_, data=data))
        autopilot.read()
    assert autopilot.strangers > 50
    decoder = Decoder()
    frames = []
    for _ in range(3):  # one transfer ID may be that of a wrong frame
        receiver.write(FRAME)
        while not autopilot.ready():
            pass
        frames += decoder.feed(autopilot.read(), 0.0)
    assert frames[-1].channels[0].d == 1905


def test_a_bus_that_is_lost_is_opened_again(keep: Keep) -> None:
    clock = RealClock()
    receiver = keep(open_reconnecting("can:SERIAL0,node=42,bus=virtual:lost", clock=clock))
    autopilot = keep(open_link("can:SERIAL0,node=10,to=42,bus=virtual:lost", clock=clock))
    receiver._link._node.can_driver.close()  # type: ignore[attr-defined]
    assert not receiver.write(FRAME)
    assert receiver.away
    assert "is the CAN adapter plugged in?" in receiver.why
    while receiver.away:
        clock.wait(clock.now() + 0.01, [receiver])
        receiver.write(FRAME)
        receiver.read()
    assert receive(autopilot, len(FRAME)).startswith(FRAME)


def test_a_full_bus_loses_frames_and_stays_open(keep: Keep, monkeypatch: pytest.MonkeyPatch) -> None:
    receiver, autopilot = ends(keep, "virtual:full")
    with monkeypatch.context() as full:
        error = can.CanOperationError("no buffer space available", errno.ENOBUFS)
        full.setattr(can.interfaces.virtual.VirtualBus, "send", raising(error))
        assert not receiver.write(FRAME)
    assert receiver.dropped == 1
    assert receiver.write(FRAME)
    assert receive(autopilot, len(FRAME)) == FRAME


def test_a_bus_that_fills_during_a_write_gets_the_rest_later(keep: Keep, monkeypatch: pytest.MonkeyPatch) -> None:
    """The frames of several channels in NMEA are longer than a message of the tunnel."""
    receiver, autopilot = ends(keep, "virtual:fills")
    long, send, room = bytes(range(200)), can.interfaces.virtual.VirtualBus.send, [25]

    def send_some(bus: Any, message: Any) -> None:
        room[0] -= 1
        if room[0] < 0:
            raise can.CanOperationError("no buffer space available", errno.ENOBUFS)
        send(bus, message)

    with monkeypatch.context() as fills:
        fills.setattr(can.interfaces.virtual.VirtualBus, "send", send_some)
        assert receiver.write(long)
        assert not receiver.write(b"while it is full")
        assert receive(autopilot, 120) == long[:120]
    assert receiver.write(b"next")
    assert receive(autopilot, 84) == long[120:] + b"next"
    assert receiver.dropped == 1


def test_a_socket_without_room_is_a_full_bus_and_no_lost_one() -> None:
    """As python-can has it of SocketCAN with a long queue: an error without a number."""
    near, far = socket.socketpair()
    with near, far:
        near.setblocking(False)
        fake = SimpleNamespace(fileno=near.fileno, send=raising(can.CanOperationError("Transmit buffer full")))
        bus = PythonCanBus(fake, [])
        with pytest.raises(OSError, match="Transmit buffer full"):
            bus.send(1, b"frame")
        with contextlib.suppress(BlockingIOError):
            while near.send(bytes(1 << 16)):
                pass
        with pytest.raises(BlockingIOError, match="the bus is full"):
            bus.send(1, b"frame")


def test_a_bus_that_does_not_send_is_lost(keep: Keep, monkeypatch: pytest.MonkeyPatch) -> None:
    receiver, _ = ends(keep, "virtual:broken")
    monkeypatch.setattr(can.interfaces.virtual.VirtualBus, "send", raising(can.CanOperationError("it is gone")))
    with pytest.raises(LinkError, match="lost: it is gone; is the CAN adapter plugged in"):
        receiver.write(FRAME)


def test_a_bus_that_is_off_is_lost(keep: Keep) -> None:
    receiver, _ = ends(keep, "virtual:off")
    with can.Bus(interface="virtual", channel="off") as bus:
        bus.send(can.Message(is_error_frame=True, arbitration_id=0x04))  # a warning changes nothing
        assert receiver.read() == b""
        bus.send(can.Message(is_error_frame=True, arbitration_id=0x40))
        with pytest.raises(LinkError, match="the bus is off: check wires, termination and bit rate"):
            receiver.read()


def raising(error: Exception) -> Callable[..., None]:
    def send(*_: object) -> None:
        raise error

    return send


def test_a_missing_package_is_an_error_with_its_cure(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "can", None)
    with pytest.raises(LinkError, match=r"needs the package can, which is missing; pip install 'arva-hil\[can\]'"):
        open_link("can:SERIAL0,node=42", clock=RealClock())


@every(
    "text, found",
    [
        ("can:", "has the port ''"),
        ("can:SERIAL0", "has no node="),
        ("can:COM3,node=4", "has the port 'COM3', expected SERIAL0 to SERIAL15"),
        ("can:SERIAL0,node=10", "has node 10 at both ends"),
        ("can:SERIAL0,node=126", "has node=126, expected a node ID 1…125"),
        ("can:SERIAL0,node=x", "has node=x, expected a node ID 1…125"),
        ("can:SERIAL0,node=4,speed=9", "has 'speed', expected node=, to= or bus="),
    ],
)
def test_a_wrong_connection_string_is_refused(text: str, found: str) -> None:
    with pytest.raises(AddressError, match="write can:SERIAL0,node=42,bus=can0") as error:
        open_link(text, clock=RealClock())
    assert found in str(error.value)


@every(
    "bus, cure",
    [
        ("nothere0", "`"),
        ("morse:3", "another interface of python-can"),
        ("mcast:first", "write mcast:0"),
    ],
)
def test_a_bus_that_does_not_exist_is_an_error_with_a_cure(bus: str, cure: str) -> None:
    with pytest.raises(LinkError, match=f"CAN bus {bus}: cannot be opened") as error:
        open_link(f"can:SERIAL0,node=42,bus={bus}", clock=RealClock())
    assert cure in str(error.value)
