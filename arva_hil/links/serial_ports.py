"""Serial ports: the list of them, and those of autopilots."""

from __future__ import annotations

import glob
import os
import re
from collections.abc import Collection, Iterable
from typing import TYPE_CHECKING, Final, NamedTuple

if TYPE_CHECKING:
    from serial.tools.list_ports_common import ListPortInfo

# USB vendors that make flight controllers (3DR, CubePilot, Holybro, CUAV, ARK, PX4 FMU V6X-RT, ThePeach), and single
# products of others (ArduPilot, PX4 FMU V6U, PX4 FMUK66, ModalAI). Sources: QGroundControl's USBBoardInfo.json,
# ArduPilot's bootloaders.
_VENDORS: Final = frozenset((0x26AC, 0x2DAE, 0x3162, 0x3163, 0x3185, 0x3643, 0x35A7))
_ARDUPILOT: Final = ((0x1209, 0x5740), (0x1209, 0x5741))
_PRODUCTS: Final = frozenset(((0x1B8C, 0x0036), (0x1FC9, 0x001C), (0x0483, 0xA32F), (0x0483, 0xA330), *_ARDUPILOT))
_WORDS: Final = re.compile(
    r"\bardu(?!ino)|px4|pixhawk|pixracer|fmu|\bcube(?!mx)|holybro|cuav|\bmro|matek|kakute|durandal|speedybee",
    re.IGNORECASE,
)


class SerialPort(NamedTuple):
    """A serial port. `by_id`: its stable name, the same in every USB socket; "" if it has none."""

    device: str
    by_id: str = ""
    description: str = ""
    vid: int | None = None
    pid: int | None = None
    manufacturer: str = ""
    product: str = ""
    location: str = ""  # USB bus and socket, and the interface after the colon: "1-2:1.0"
    autopilot: bool = False  # a guess

    @property
    def usb(self) -> str:
        """Vendor and product, e.g. `1209:5740`; "" if it is not on USB."""
        return "" if self.vid is None or self.pid is None else f"{self.vid:04x}:{self.pid:04x}"


def list_ports() -> list[SerialPort]:
    """Return every serial port of this machine, by device name."""
    from serial.tools.list_ports import comports

    stable = _stable_names()
    return [
        SerialPort(
            device=info.device,
            by_id=stable.get(os.path.realpath(info.device), ""),
            description="" if info.description in (None, "n/a") else info.description,
            vid=info.vid,
            pid=info.pid,
            manufacturer=info.manufacturer or "",
            product=info.product or "",
            location=info.location or "",
            autopilot=_is_autopilot(info),
        )
        for info in sorted(comports(), key=lambda info: _natural(info.device))
    ]


def find_autopilot(ports: Iterable[SerialPort], exclude: Collection[str] = ()) -> list[SerialPort]:
    """Return the ports of autopilots, by their USB descriptions. If a board has several interfaces, only the first.

    `exclude`: ports that are used for something else, as devices, stable names or symlinks.
    """
    taken = {name for path in exclude if path for name in (path, os.path.realpath(path))}
    plugs: dict[str, SerialPort] = {}
    for port in sorted(ports, key=lambda port: (port.location, _natural(port.device))):
        if port.autopilot and not taken & {port.device, os.path.realpath(port.device), port.by_id}:
            plugs.setdefault(port.location.partition(":")[0] or port.device, port)
    return list(plugs.values())


def stable_name(device: str) -> str:
    """Return the name by which a port is found after it is plugged in again; `device` if there is no stable name.

    A symlink is kept as it is.
    """
    return device if os.path.islink(device) else _stable_names().get(os.path.realpath(device), device)


def _stable_names() -> dict[str, str]:
    """Return the name in /dev/serial/by-id of each device."""
    return {os.path.realpath(path): path for path in sorted(glob.glob("/dev/serial/by-id/*"))}


def _is_autopilot(info: ListPortInfo) -> bool:
    words = f"{info.manufacturer} {info.product} {info.description}"
    if "flow" in words.lower():  # PX4FLOW is a sensor
        return False
    return info.vid in _VENDORS or (info.vid, info.pid) in _PRODUCTS or bool(_WORDS.search(words))


def _natural(name: str) -> list[str | int]:
    """Return a sort key that puts ttyUSB2 before ttyUSB10."""
    return [int(part) if part.isdecimal() else part for part in re.split(r"([0-9]+)", name)]
