"""CAN buses as drivers of the package dronecan: those of python-can, and the multicast of ArduPilot's simulator."""

from __future__ import annotations

import contextlib
import errno
import socket
import struct
from collections.abc import Sequence
from typing import Any, Final

from arva_hil.links.base import LinkError

_EXTENDED: Final = 1 << 31
_BUS_OFF: Final = 0x40  # SocketCAN's class of error frames
_BUS_OFF_CURE: Final = "check wires, termination and bit rate"
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
            if getattr(error, "error_code", None) in _FULL:
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
                raise OSError(f"the bus is off: {_BUS_OFF_CURE}")
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
