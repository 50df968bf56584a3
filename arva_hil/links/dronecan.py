"""DroneCAN's serial tunnel: the bytes of a serial port, in messages on a CAN bus.

ArduPilot has the other end as a serial port (`CAN_D1_UC_S1_NOD`), so drivers of the receiver read it unchanged.
"""

from __future__ import annotations

import contextlib
import errno
import re
import socket
import struct
from collections.abc import Sequence
from typing import Any, Final, NamedTuple

from arva_hil.clock import await_descriptors
from arva_hil.links.base import Link, LinkError, Opening, StreamLink
from arva_hil.links.url import Address, AddressError

_AT_ONCE: Final = 120  # bytes of a message
_ARDUPILOT: Final = 10  # its default, CAN_D1_UC_NODE
_BAUD: Final = 115200
_TARGETTED: Final = 3001  # uavcan.tunnel.Targetted


class Tunnel(NamedTuple):
    """One end of a tunnel: the number of the serial port, the own node ID, the other end's, and the bus."""

    serial: int
    node: int
    to: int
    bus: str


def tunnel_of(address: Address) -> Tunnel:
    """Return the tunnel of `can:SERIAL0,node=42,to=10,bus=can0`; `to` and `bus` may be missing. Raises AddressError."""
    name, *words = address.path.split(",")
    given = dict(word.partition("=")[::2] for word in words)
    if not (serial := re.fullmatch(r"(?i:SERIAL)([0-9]|1[0-5])", name)):
        raise _refused(address, f"has the port {name!r}, expected SERIAL0 to SERIAL15")
    for key in given:
        if key not in ("node", "to", "bus"):
            raise _refused(address, f"has {key!r}, expected node=, to= or bus=")
    if "node" not in given:
        raise _refused(address, "has no node=, the own node ID on the bus (CAN_D1_UC_S1_NOD)")
    numbers = []
    for key, text in ("node", given["node"]), ("to", given.get("to", str(_ARDUPILOT))):
        if not re.fullmatch("[0-9]{1,3}", text) or not 1 <= int(text) <= 125:
            raise _refused(address, f"has {key}={text}, expected a node ID 1…125")
        numbers.append(int(text))
    if numbers[0] == numbers[1]:
        raise _refused(address, f"has node {numbers[0]} at both ends, expected two node IDs")
    return Tunnel(int(serial[1]), numbers[0], numbers[1], given.get("bus", "can0"))


def _filters(node: int) -> list[tuple[int, int]]:
    """Return the ids and masks of the frames of the tunnel, and of requests to this node."""
    return [(_TARGETTED << 8, 0xFFFF80), (node << 8 | 0x80, 0x7F80)]


def _refused(address: Address, found: str) -> AddressError:
    return AddressError(f"{str(address)!r} {found}", "can:SERIAL0,node=42,bus=can0")


class DroneCanLink(StreamLink):
    """One end of a serial tunnel, as a node of the bus."""

    reopened = True
    hint = "is the CAN adapter plugged in?"

    @classmethod
    def open(cls, address: Address, how: Opening) -> Link:
        tunnel = tunnel_of(address)
        try:
            return cls(str(address), tunnel, open_bus(tunnel.bus, _filters(tunnel.node)))
        except ModuleNotFoundError as error:
            missing = f"needs the package {error.name}, which is missing"
            raise LinkError(str(address), missing, "pip install 'arva-hil[can]'") from None

    def __init__(self, name: str, tunnel: Tunnel, bus: Any) -> None:
        import dronecan
        from dronecan.node import Node

        super().__init__(name)
        self._tunnel = tunnel
        self._types = dronecan.uavcan
        info = self._types.protocol.GetNodeInfo.Response()
        info.name = "org.arva_hil.receiver"
        info.hardware_version.unique_id = list(f"arva-hil{tunnel.node:08}".encode())
        mode = self._types.protocol.NodeStatus().MODE_OPERATIONAL
        self._node = Node(bus, node_id=tunnel.node, mode=mode, node_info=info)
        self._node.add_handler(self._types.tunnel.Targetted, self._on_message)
        self._arrived = b""
        self._fd = bus.fileno()

    def _receive(self) -> bytes:
        self._spin()
        if not self._arrived:
            raise BlockingIOError
        data, self._arrived = self._arrived, b""
        return data

    def _send(self, data: bytes) -> int:
        """Send bytes in whole messages. Returns the number of bytes for which the bus had room."""
        self._spin()
        for at in range(0, len(data), _AT_ONCE):
            try:
                self._node.broadcast(
                    self._types.tunnel.Targetted(
                        protocol=self._types.tunnel.Protocol(),
                        target_node=self._tunnel.to,
                        serial_id=self._tunnel.serial,
                        baudrate=_BAUD,
                        buffer=list(data[at : at + _AT_ONCE]),
                    )
                )
            except BlockingIOError:  # the bus is full
                return at
        return len(data)

    def ready(self) -> bool:
        if self._open and self._fd is None:
            try:
                self._spin()
            except OSError:  # of a lost link, which `read` raises
                return True
        return super().ready() or (self._open and bool(self._arrived))  # a write takes frames in too

    def _shut(self) -> None:
        self._node.close()

    def _spin(self) -> None:
        """Use the frames that have arrived, and send the status of the node when it is due."""
        while True:
            try:
                self._node.spin(0)
            except BlockingIOError:  # the status is sent again in a second
                return
            except OSError:
                raise
            except Exception:  # a wrong frame of another node: dronecan raises errors of many kinds
                self.strangers += 1
            else:
                return

    def _on_message(self, event: Any) -> None:
        message, tunnel = event.message, self._tunnel
        ends = event.transfer.source_node_id, message.target_node, message.serial_id
        if ends == (tunnel.to, tunnel.node, tunnel.serial):
            self._arrived += bytes(message.buffer)


_EXTENDED: Final = 1 << 31
_BUS_OFF: Final = 0x40  # SocketCAN's class of error frames
_MULTICAST: Final = "239.65.82.{}", 57732, 0x2934  # address, port, first two bytes: CAN_Multicast.cpp
_HEAD: Final = struct.Struct("<HHHI")  # magic, CRC, flags, id
_SOCKET_CURES: Final[dict[int | None, str]] = {
    errno.ENODEV: "`ip -br link show type can` lists the interfaces",
    errno.EAFNOSUPPORT: "this system has no CAN: load the kernel's module `can_raw`",
}
_FULL: Final = {errno.ENOBUFS, errno.EAGAIN}


Filters = Sequence[tuple[int, int]]
"""Ids and masks: a frame passes if its id is equal to one of them under the mask."""


def open_bus(name: str, filters: Filters) -> Any:
    """Open `mcast:N`, `INTERFACE:CHANNEL` of python-can, or a channel of SocketCAN. Raises LinkError."""
    import can

    interface, colon, channel = name.partition(":")
    if not colon:
        interface, channel = "socketcan", name
    try:
        if interface == "mcast":
            return MulticastBus(int(channel or 0), filters)
        wanted = [{"can_id": id_, "can_mask": mask, "extended": True} for id_, mask in filters]
        of_kernel = {"can_filters": wanted} if interface == "socketcan" else {}
        return PythonCanBus(can.Bus(interface=interface, channel=channel, **of_kernel), filters)
    except Exception as error:  # python-can raises errors of the system, its own ones, and those of its interfaces
        raise LinkError(f"CAN bus {name}", f"cannot be opened: {error}", _cure(interface, channel, error)) from error


def _passes(id_: int, filters: Filters) -> bool:
    return any(id_ & mask == one for one, mask in filters)


def _cure(interface: str, channel: str, error: Exception) -> str:
    if interface == "socketcan":
        usual = f"bring it up: `ip link set {channel} up type can bitrate 1000000`"
        return _SOCKET_CURES.get(getattr(error, "errno", None), usual)
    if interface == "mcast":
        return "write mcast:0 for the first bus of the simulator"
    return "write can0 for SocketCAN, virtual:NAME, udp_multicast:ADDRESS or another interface of python-can"


class PythonCanBus:
    """A bus of python-can. Errors of the bus are raised as OSError."""

    def __init__(self, bus: Any, filters: Filters) -> None:
        self._bus, self._filters = bus, filters

    def fileno(self) -> int | None:
        with contextlib.suppress(NotImplementedError):
            fd: int = self._bus.fileno()
            return fd if fd >= 0 else None
        return None

    def send(self, id_: int, data: bytes, extended: bool = False, canfd: bool = False) -> None:
        import can

        message = can.Message(arbitration_id=id_, data=data, is_extended_id=extended)
        try:
            self._bus.send(message)
        except can.CanError as error:
            fd = self.fileno()  # python-can gives no error code if the socket has no room
            has_room = fd is None or await_descriptors(write=[fd])
            if getattr(error, "error_code", None) in _FULL or not has_room:
                raise BlockingIOError("the bus is full: no other node is there, or it is busy") from error
            raise OSError(str(error)) from error

    def receive(self, timeout: float) -> Any:
        import can
        from dronecan.driver.common import CANFrame

        while True:
            try:
                message = self._bus.recv(0)
            except can.CanError as error:
                raise OSError(str(error)) from error
            if message is None:
                return None
            if message.is_error_frame and message.arbitration_id & _BUS_OFF:
                raise OSError("the bus is off: check wires, termination and bit rate")
            if not message.is_error_frame and _passes(message.arbitration_id, self._filters):
                return CANFrame(message.arbitration_id, bytes(message.data), message.is_extended_id)

    def close(self) -> None:
        self._bus.shutdown()


class MulticastBus:
    """A bus of ArduPilot's simulator, which sends CAN frames by UDP multicast."""

    def __init__(self, number: int, filters: Filters) -> None:
        self._filters = filters
        address, port, _ = _MULTICAST
        self._address = address.format(number), port
        self._in = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._out = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._in.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self._in.bind(self._address)
        member = socket.inet_aton(self._address[0]) + socket.inet_aton("0.0.0.0")
        self._in.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, member)
        self._out.connect(self._address)
        self._in.setblocking(False)
        self._out.setblocking(False)

    def fileno(self) -> int:
        return self._in.fileno()

    def send(self, id_: int, data: bytes, extended: bool = False, canfd: bool = False) -> None:
        from dronecan.dsdl.common import crc16_from_bytes

        body = struct.pack("<HI", 0, id_ | (_EXTENDED if extended else 0)) + bytes(data)
        self._out.send(struct.pack("<HH", _MULTICAST[2], crc16_from_bytes(body)) + body)

    def receive(self, timeout: float) -> Any:
        from dronecan.driver.common import CANFrame
        from dronecan.dsdl.common import crc16_from_bytes

        while True:
            try:
                data, sender = self._in.recvfrom(2048)
            except BlockingIOError:
                return None
            if len(data) < _HEAD.size or sender == self._out.getsockname():
                continue
            magic, crc, flags, id_ = _HEAD.unpack_from(data)
            if (
                _passes(id_, self._filters)
                and magic == _MULTICAST[2]
                and crc == crc16_from_bytes(data[4:])
                and not flags
            ):
                return CANFrame(id_ & (_EXTENDED - 1), data[_HEAD.size :], bool(id_ & _EXTENDED))

    def close(self) -> None:
        self._in.close()
        self._out.close()
