"""Serial ports, opened exclusively with pyserial, and pyserial's URLs."""

from __future__ import annotations

import contextlib
import errno
import os
import stat
import sys
from typing import TYPE_CHECKING, Final

from arva_hil.clock import await_descriptors
from arva_hil.links import pty
from arva_hil.links.base import CHUNK, Absent, FdLink, Link, LinkError, Opening, StreamLink
from arva_hil.links.processes import holders
from arva_hil.links.serial_ports import list_ports
from arva_hil.links.url import Address

if TYPE_CHECKING:
    from serial import Serial

BAUD: Final = 115200
_MAKE_IT_FIRST: Final = "start the program that makes it first, e.g. `arva-hil run` or `arva-hil vehicle`"


def open_serial(device: str, baud: int = BAUD, *, brief: bool = False) -> Link:
    """Open a serial port exclusively at `baud` bit/s, 8N1, without flow control.

    Raises LinkError with the cure: no such port, no permission, busy, not a serial port. `brief`: without the cure.
    """
    import serial

    with contextlib.suppress(OSError):
        if sys.platform != "win32" and not stat.S_ISCHR(mode := os.stat(device).st_mode):
            what = "is a directory" if stat.S_ISDIR(mode) else "is a file, not a serial port"
            raise LinkError(device, what, "" if brief else _existing())
    if os.path.exists(device) and pty.stale(device):
        what = f"leads to {os.path.realpath(device)}, which another program has opened since"
        raise Absent(device, what, "" if brief else "the program that made this symlink has ended: start it again")
    try:
        port = serial.Serial(device, baud, timeout=0, write_timeout=0, exclusive=True)
    except Exception as error:  # OSError, ValueError, termios.error: pyserial passes many kinds on
        raise (LinkError(device, f"cannot be opened: {error}") if brief else _open_error(device, error)) from error
    if sys.platform == "win32":
        return PyserialLink(device, port)
    with contextlib.suppress(OSError, ValueError, NotImplementedError):  # USB adapters keep bytes up to 16 ms
        port.set_low_latency_mode(True)
    return SerialLink(device, port)


def open_url(url: str, baud: int = BAUD) -> Link:
    """Open a pyserial URL: rfc2217://, socket://, loop://, spy://, hwgrep://, alt://. Raises LinkError."""
    import serial

    timeout = None if url.lower().startswith("loop:") else 0  # its write fails if it takes longer than this
    try:
        port = serial.serial_for_url(url, baud, timeout=0, write_timeout=timeout, exclusive=True)
    except Exception as error:
        raise LinkError(url, f"cannot be opened: {error}") from error
    return PyserialLink(url, port)


class SerialLink(FdLink):
    """An open serial port on POSIX. pyserial sets it up; bytes are read and written by its file descriptor."""

    hint = "was it unplugged, or did the program behind it end?"

    @classmethod
    def open(cls, address: Address, how: Opening) -> Link:
        return open_serial(address.path, address.baud or BAUD, brief=how.brief)

    def __init__(self, name: str, port: Serial) -> None:
        super().__init__(name, port.fileno())
        self._port = port

    def _shut(self) -> None:
        with contextlib.suppress(OSError):
            self._port.close()


class PyserialLink(StreamLink):
    """A port on Windows, or a URL, opened by pyserial. Polled if it has no descriptor."""

    hint = "was it unplugged, or did the program behind it end?"

    reopened = True

    @classmethod
    def open(cls, address: Address, how: Opening) -> Link:
        return open_url(address.path, address.baud or BAUD)

    def __init__(self, name: str, port: Serial) -> None:
        super().__init__(name)
        self._port = port
        try:
            self._fd = port.fileno()
        except (AttributeError, OSError):
            self._fd = None
        self._socket = getattr(port, "_socket", None)  # rfc2217 waits up to 5 s when this one is full

    def ready(self) -> bool:
        try:
            return self._open and bool(self._port.in_waiting)
        except OSError:  # not only SerialException: after a hang-up it is a bare OSError
            return True

    def _receive(self) -> bytes:
        data = self._port.read(CHUNK)
        if not data:
            raise BlockingIOError
        return bytes(data)

    def _send(self, data: bytes) -> int:
        far = self._socket if self._fd is None else self._fd
        if far is not None and not await_descriptors(write=[far if isinstance(far, int) else far.fileno()]):
            return 0
        return self._port.write(data) or 0

    def _shut(self) -> None:
        with contextlib.suppress(OSError):
            self._port.close()


def _open_error(device: str, error: Exception) -> LinkError:
    number, text = getattr(error, "errno", None), str(error)
    if number == errno.ENOENT or "FileNotFoundError" in text:  # Windows has only the text
        return Absent(device, "no such port", _MAKE_IT_FIRST if device.startswith("/tmp/") else _existing())
    if number in (errno.EBUSY, errno.EAGAIN) or "PermissionError" in text:
        who = ", ".join(holders(device))
        return LinkError(device, "busy" + (f": held by {who}" if who else ""), "close the other program")
    if number in (errno.EACCES, errno.EPERM):
        return LinkError(device, "permission denied", _permission_hint(device))
    if number in (errno.ENXIO, errno.ENODEV, errno.EIO) or "Input/output error" in text:
        return LinkError(device, "there is no hardware behind this port", _existing())
    if "Could not configure port" in text:
        return LinkError(device, "is not a serial port", _existing())
    return LinkError(device, f"cannot be opened: {text}")


def _existing() -> str:
    devices = [port.device for port in list_ports()]
    return f"the ports here are {', '.join(devices[:10])}" if devices else "this machine has no serial port"


def _permission_hint(device: str) -> str:
    try:
        import grp

        status = os.stat(device)
        group = grp.getgrgid(status.st_gid).gr_name
    except (ImportError, OSError, KeyError):
        return "can another user open it?"
    if status.st_mode & 0o060 != 0o060 or group == "root":
        return f"only its owner may open it: ls -l {device}"
    return f"add yourself to group {group}: sudo usermod -aG {group} $USER, then log in again"
