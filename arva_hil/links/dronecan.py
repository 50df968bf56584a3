"""DroneCAN's serial tunnel: the bytes of a serial port, in messages on a CAN bus.

ArduPilot has the other end as a serial port (`CAN_D1_UC_S1_NOD`), so drivers of the receiver read it unchanged.
"""

from __future__ import annotations

import re
from typing import Any, Final, NamedTuple

from arva_hil.links.base import Link, LinkError, Opening
from arva_hil.links.can_bus import open_bus
from arva_hil.links.url import Address, AddressError

_EXAMPLE: Final = "can:SERIAL0,node=42,bus=can0"
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
    return AddressError(f"{str(address)!r} {found}: write {_EXAMPLE}")


class DroneCanLink(Link):
    """One end of a serial tunnel, as a node of the bus."""

    reopened = True

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

        self.name = name
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

    def read(self) -> bytes:
        self._check_open()
        self._spin()
        data, self._arrived = self._arrived, b""
        return data

    def write(self, data: bytes) -> bool:
        self._check_open()
        self._spin()
        try:
            for at in range(0, len(data), _AT_ONCE):
                self._node.broadcast(self._message(data[at : at + _AT_ONCE]))
        except BlockingIOError:  # the bus is full
            self.dropped += 1
            return False
        except OSError as error:
            raise self._lost(error) from error
        return True

    def ready(self) -> bool:
        if self._fd is not None:
            return super().ready()
        try:
            self._spin()
        except LinkError:
            return True
        return bool(self._arrived)

    def close(self) -> None:
        if self._open:
            self._open = False
            self._node.close()

    def _spin(self) -> None:
        """Use the frames that have arrived, and send the status of the node when it is due."""
        while True:
            try:
                self._node.spin(0)
            except BlockingIOError:  # the status is sent again in a second
                return
            except OSError as error:
                raise self._lost(error) from error
            except Exception:  # a wrong frame of another node: dronecan raises errors of many kinds
                self.strangers += 1
            else:
                return

    def _on_message(self, event: Any) -> None:
        message, tunnel = event.message, self._tunnel
        ends = event.transfer.source_node_id, message.target_node, message.serial_id
        if ends == (tunnel.to, tunnel.node, tunnel.serial):
            self._arrived += bytes(message.buffer)

    def _message(self, data: bytes) -> Any:
        protocol = self._types.tunnel.Protocol()
        return self._types.tunnel.Targetted(
            protocol=protocol,
            target_node=self._tunnel.to,
            serial_id=self._tunnel.serial,
            baudrate=_BAUD,
            buffer=list(data),
        )

    def _lost(self, error: OSError) -> LinkError:
        return LinkError(self.name, f"lost: {error.strerror or error}", "is the CAN adapter plugged in?")
