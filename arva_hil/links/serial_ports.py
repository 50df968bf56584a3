"""Serial ports: the list of them, those of autopilots, and the reopening of a lost one."""

from __future__ import annotations

import errno
import glob
import math
import os
import re
from collections.abc import Collection, Iterable
from typing import TYPE_CHECKING, Final, NamedTuple

from arva_hil.clock import Clock
from arva_hil.links import Address, open_link
from arva_hil.links.base import Link, LinkError
from arva_hil.links.processes import far_program

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


_STUBBORN_S: Final = 1.0  # after a port is plugged in, its permissions are set late, and other programs probe it
_BARRED: Final = frozenset((errno.EBUSY, errno.EAGAIN, errno.EACCES, errno.EPERM))


class Barred(LinkError):
    """A link that exists, but can only be opened after a person has done something."""


class SerialOpener:
    """Opens a serial port again by its stable name. If it stays busy or forbidden, raises Barred once with the cause.

    A pseudo-terminal without a symlink must belong to the same program as before, because the system reuses numbers.
    """

    def __init__(self, address: Address, clock: Clock) -> None:
        self.path = stable_name(address.path)
        self._address = address._replace(path=self.path)
        self._clock = clock
        known = os.path.exists(self.path) and not os.path.islink(self.path)
        self._program = far_program(self.path) if known else None
        self._bar = ""  # the error of all tries so far
        self._since = 0.0  # when it began; infinite after it was reported

    def __call__(self) -> Link:
        try:
            link = self._open(brief=True)
        except LinkError as error:
            if not self._stubborn(error.what if _barred(error) else ""):
                raise LinkError(error.link, error.what) from error
            link = self._look_into()
        self._bar = ""
        return link

    def _look_into(self) -> Link:
        try:
            return self._open(brief=False)
        except LinkError as error:
            if _barred(error):
                raise Barred(error.link, error.what, error.hint) from error
            raise

    def _open(self, *, brief: bool) -> Link:
        if self._program and not os.path.exists(self.path):  # do not search for its program
            raise LinkError(self.path, "no such port")
        if self._program is not None and (other := far_program(self.path)) != self._program:
            whose = f": {other[:60]}" if other else ""
            hint = "name a symlink, which finds the pseudo-terminal if its number changes"
            raise Barred(self.path, f"now belongs to another program{whose}", hint)
        return open_link(self._address, clock=self._clock, brief=brief)

    def _stubborn(self, bar: str) -> bool:
        """Return True if the error has lasted for long and was not reported yet."""
        now = self._clock.now()
        if bar != self._bar:
            self._bar, self._since = bar, now
        told = bool(bar) and now - self._since >= _STUBBORN_S
        if told:
            self._since = math.inf
        return told


def _barred(error: LinkError) -> bool:
    cause = error.__cause__
    return isinstance(error, Barred) or getattr(cause, "errno", None) in _BARRED or "PermissionError" in str(cause)
