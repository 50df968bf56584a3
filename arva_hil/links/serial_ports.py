"""Lists serial ports, those that look like an autopilot, and the programs that have one open."""

from __future__ import annotations

import contextlib
import glob
import os
import re
import sys
from collections.abc import Callable, Collection, Iterable
from typing import TYPE_CHECKING, Final, NamedTuple

if TYPE_CHECKING:
    from serial.tools.list_ports_common import ListPortInfo

# USB vendors that make flight controllers, and single products of others. Sources: QGroundControl's
# USBBoardInfo.json, ArduPilot's bootloaders.
_VENDORS: Final = frozenset(
    (
        0x26AC,  # 3DR, PX4
        0x2DAE,  # CubePilot
        0x3162,  # Holybro
        0x3163,  # CUAV
        0x3185,  # ARK, Auterion
        0x3643,  # PX4 FMU V6X-RT
        0x35A7,  # ThePeach
    )
)
_PRODUCTS: Final = frozenset(
    (
        (0x1209, 0x5740),  # ArduPilot
        (0x1209, 0x5741),  # ArduPilot
        (0x1B8C, 0x0036),  # PX4 FMU V6U
        (0x1FC9, 0x001C),  # PX4 FMUK66
        (0x0483, 0xA32F),  # ModalAI
        (0x0483, 0xA330),  # ModalAI
    )
)
_PTYS: Final = "/dev/pts/"
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
    """Every serial port of this machine, by device name."""
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
        for info in sorted(comports(), key=lambda info: natural(info.device))
    ]


def find_autopilot(ports: Iterable[SerialPort], exclude: Collection[str] = ()) -> list[SerialPort]:
    """The ports that look like an autopilot. If a board has several interfaces, only the first.

    `exclude`: ports that are used for something else, as devices, stable names or symlinks.
    """
    taken = {name for path in exclude if path for name in (path, os.path.realpath(path))}
    plugs: dict[str, SerialPort] = {}
    for port in sorted(ports, key=lambda port: (port.location, natural(port.device))):
        if port.autopilot and not taken & {port.device, os.path.realpath(port.device), port.by_id}:
            plugs.setdefault(port.location.partition(":")[0] or port.device, port)
    return list(plugs.values())


def stable_name(device: str) -> str:
    """The name by which a port is found after it is plugged in again; `device` if there is no stable name.

    A symlink is kept as it is.
    """
    return device if os.path.islink(device) else _stable_names().get(os.path.realpath(device), device)


def far_program(device: str) -> str:
    """The command of the program with the master of a pseudo-terminal; "" if it is unknown or not one. Linux.

    The system reuses the numbers of pseudo-terminals, so another program may have the same device later.
    """
    real = os.path.realpath(device)
    if not real.startswith(_PTYS):
        return ""
    for process in sorted(glob.glob("/proc/[0-9]*"), key=natural):
        try:
            ends = os.listdir(f"{process}/fd")
            if any(is_master(f"{process}/fd/{end}", f"{process}/fdinfo/{end}", real) for end in ends):
                return command_of(process)
        except OSError:  # another user's, or it has ended
            continue
    return ""


def holders(device: str) -> list[str]:
    """Each process that has a device open, as `1234 (command)`. Linux; other users' processes only as root."""
    real = os.path.realpath(device)
    return _who(lambda fd, target: target == real and is_here(fd, real))


def listeners(port: int, protocol: str) -> list[str]:
    """Each process that listens at a port of this machine, as `1234 (command)`. Linux, as `holders`.

    `protocol` is tcp or udp.
    """
    sockets = {f"socket:[{inode}]" for table in (protocol, f"{protocol}6") for inode in _bound(table, port)}
    return _who(lambda _, target: target in sockets) if sockets else []


def unread(device: str) -> int:
    """The number of unread bytes in a terminal; 0 if it is not known."""
    with contextlib.suppress(ImportError, OSError):
        import fcntl
        import termios

        fd = os.open(device, os.O_RDONLY | os.O_NOCTTY | os.O_NONBLOCK)
        try:
            return int.from_bytes(fcntl.ioctl(fd, termios.FIONREAD, bytes(4)), sys.byteorder)
        finally:
            os.close(fd)
    return 0


def _who(wanted: Callable[[str, str], bool]) -> list[str]:
    """Each process with a descriptor for which `wanted(path, target)` is true."""
    found = []
    for process in sorted(glob.glob("/proc/[0-9]*"), key=natural):
        try:
            if not any(wanted(entry.path, os.readlink(entry.path)) for entry in os.scandir(f"{process}/fd")):
                continue
            command = command_of(process)
        except OSError:  # another user's, or it has ended
            continue
        found.append(f"{os.path.basename(process)} ({command[:60]})")
    return found


def is_here(fd: str, device: str) -> bool:
    """Whether an open descriptor is this machine's device, not one of the same name in a container."""
    return not device.startswith(_PTYS) or os.stat(fd).st_dev == os.stat(device).st_dev


def is_master(fd: str, fdinfo: str, device: str) -> bool:
    """Whether a descriptor is the master of a pseudo-terminal."""
    path = os.readlink(fd)
    if not path.endswith("ptmx") or _number_of(fdinfo) != device.removeprefix(_PTYS):
        return False
    return not path.startswith(_PTYS) or is_here(fd, device)


def _bound(table: str, port: int) -> list[str]:
    """Inodes of the sockets in /proc/net that are bound to a port (UDP) or listen there (TCP)."""
    try:
        with open(f"/proc/net/{table}") as file:
            rows = [line.split() for line in file][1:]
    except OSError:
        return []
    wait = "0A" if table.startswith("tcp") else "07"
    return [row[9] for row in rows if row[1].endswith(f":{port:04X}") and row[3] == wait]


def command_of(process: str) -> str:
    with open(f"{process}/cmdline", "rb") as file:
        return file.read(200).replace(b"\0", b" ").decode(errors="replace").strip()


def _number_of(fdinfo: str) -> str:
    """The number of the pseudo-terminal whose master is this descriptor."""
    with open(fdinfo) as file:
        return next((line.split()[1] for line in file if line.startswith("tty-index:")), "")


def _stable_names() -> dict[str, str]:
    """Device → its name in /dev/serial/by-id."""
    return {os.path.realpath(path): path for path in sorted(glob.glob("/dev/serial/by-id/*"))}


def _is_autopilot(info: ListPortInfo) -> bool:
    words = f"{info.manufacturer} {info.product} {info.description}"
    if "flow" in words.lower():  # PX4FLOW is a sensor
        return False
    return info.vid in _VENDORS or (info.vid, info.pid) in _PRODUCTS or bool(_WORDS.search(words))


def natural(name: str) -> list[str | int]:
    """Sorts ttyUSB2 before ttyUSB10."""
    return [int(part) if part.isdecimal() else part for part in re.split(r"([0-9]+)", name)]
