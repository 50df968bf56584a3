"""A new pseudo-terminal: the other program opens `path` as if it were a serial port. Symlinks to pseudo-terminals.

The system reuses the numbers of pseudo-terminals. The symlink of a killed program may therefore lead to another
program's terminal; then the symlink is older than the terminal. A running program marks its symlink as in use: it
locks the byte of the slave whose number is the symlink's inode. The lock ends with the program.
"""

from __future__ import annotations

import contextlib
import os
import selectors
import sys
import weakref
from typing import Any, Final

from arva_hil.links.base import FdLink, Link, LinkError, Opening
from arva_hil.links.processes import far_program
from arva_hil.links.url import Address

PTYS: Final = "/dev/pts/"
_LONGEST: Final = 40  # symlinks in a chain; Linux follows no more


def target(link: str) -> str:
    """Return the target of a symlink as written; "" if `link` is not a symlink."""
    try:
        return os.readlink(link)
    except OSError:
        return ""


def mark_in_use(slave: int, inode: int) -> None:
    """Mark the symlink with this inode as in use while the descriptor `slave` of its pseudo-terminal is open."""
    with contextlib.suppress(ImportError, AttributeError, OSError):  # Linux
        import fcntl
        import struct

        lock = struct.pack("hhqqi", fcntl.F_WRLCK, os.SEEK_SET, inode, 1, 0)
        fcntl.fcntl(slave, fcntl.F_OFD_SETLK, lock)


def is_in_use(link: str) -> bool:
    """Return True if a running program has marked `link` as in use."""
    with contextlib.suppress(OSError):
        device, inode = os.stat(link), os.lstat(link).st_ino
        place = f"{os.major(device.st_dev):02x}:{os.minor(device.st_dev):02x}:{device.st_ino}"
        with open("/proc/locks") as file:
            return any(line.split()[-3:] == [place, str(inode), str(inode)] for line in file)
    return False


def stale(path: str) -> bool:
    """Return True if `path` is a symlink of a program that has ended: to nothing, or to another program's terminal."""
    link = path
    for _ in range(_LONGEST):
        to = target(link)
        if not to or link.startswith("/proc/"):  # symlinks there have no age
            return False
        if to.startswith(PTYS):
            break
        link = os.path.join(os.path.dirname(link), to)
    else:
        return False
    try:
        device = os.stat(link)
    except OSError:
        return True
    return device.st_ctime_ns > os.lstat(link).st_mtime_ns and not is_in_use(link)


_IN_CLOSE: Final = 0x18  # inotify: a program closes the file
_TIOCGEXCL: Final = 0x80045440  # Linux: whether TIOCEXCL was set


class PtyLink(FdLink):
    """The master's side of a new pseudo-terminal, in raw mode.

    `path`: the slave's device. `symlink`: the name of a symlink to it, which exists until `close`. The link keeps the
    slave open, so it is not lost when the other program closes it. On Linux the terminal's settings are restored when
    a program closes it, and after a hang-up.
    Raises LinkError if there are no pseudo-terminals, or if the symlink's name is taken.
    """

    @classmethod
    def open(cls, address: Address, how: Opening) -> Link:
        return cls(address.path)

    def __init__(self, symlink: str = "") -> None:
        name = f"pty:{symlink}" if symlink else "pty"
        try:
            import tty

            master, self._slave = os.openpty()
        except ImportError:
            raise LinkError(
                name, "this system has no pseudo-terminals", "use tcpin:127.0.0.1:5760 or a pair of ports by com0com"
            ) from None
        except OSError as error:
            raise LinkError(name, f"no pseudo-terminal: {error.strerror}") from error
        self.path = os.ttyname(self._slave)
        self.symlink = ""
        super().__init__(f"{name} ({self.path})", master)
        tty.setraw(self._slave)
        self._settings = self._current() or []
        self._closings = _Closings(self.path)
        self._selector = selectors.DefaultSelector()
        for fd in (master, self._closings.fd):
            if fd >= 0:
                self._selector.register(fd, selectors.EVENT_READ)
        try:
            if symlink:
                self._inode = make_symlink(symlink, self.path, self._slave)
                # once: by `close`, or if a signal came before the link was returned
                self._unlink = weakref.finalize(self, _remove, symlink, self.path, self._inode)
                self.symlink = symlink
        except BaseException:  # also a signal, at any line above
            _remove(symlink, self.path)
            self.close()
            raise

    def fileno(self) -> int | None:
        return self._selector.fileno() if self._open else None

    def read(self) -> bytes:
        if self._open and self._closings.seen():
            self._restore()
        return super().read()

    def write(self, data: bytes) -> bool:
        if self._open and (self._closings.seen() or self._current() is None):
            self._restore()
        return super().write(data)

    def unread(self) -> int:
        """Return the number of bytes that the other program has not read; 0 after a hang-up."""
        import fcntl
        import termios

        with contextlib.suppress(OSError):
            return int.from_bytes(fcntl.ioctl(self._slave, termios.FIONREAD, bytes(4)), sys.byteorder)
        return 0

    def _receive(self) -> bytes:
        try:
            return super()._receive()
        except BlockingIOError:
            raise
        except OSError:
            if self._current() is not None:
                raise
        self._restore()
        raise BlockingIOError

    def _current(self) -> list[Any] | None:
        """Return the terminal's settings; None after a hang-up, which makes every descriptor of the slave useless."""
        import termios

        try:
            return termios.tcgetattr(self._slave)
        except termios.error:
            return None

    def _restore(self) -> None:
        """Restore the terminal's first settings. Raises LinkError if that is not possible."""
        import fcntl
        import termios

        try:
            if (current := self._current()) is None:
                slave = os.open(self.path, os.O_RDWR | os.O_NOCTTY)
                os.close(self._slave)
                self._slave = slave
                if self.symlink:
                    mark_in_use(slave, self._inode)
            elif current == self._settings and not any(fcntl.ioctl(self._slave, _TIOCGEXCL, bytes(4))):
                return
            fcntl.ioctl(self._slave, termios.TIOCNXCL)
            termios.tcsetattr(self._slave, termios.TCSANOW, self._settings)
        except (OSError, termios.error) as error:
            raise LinkError(self.name, f"lost: the terminal cannot be set up again: {error}") from error

    def _shut(self) -> None:
        if self.symlink:
            self._unlink()
        self._selector.close()
        self._closings.close()
        os.close(self._fd)
        os.close(self._slave)


def _remove(link: str, path: str, inode: int | None = None) -> None:
    """Remove the symlink `link` if it leads to `path`, and still is the one with this inode."""
    with contextlib.suppress(OSError):
        if target(link) == path and inode in (None, os.lstat(link).st_ino):
            os.unlink(link)


def make_symlink(link: str, path: str, slave: int) -> int:
    """Make the symlink `link` to the pseudo-terminal `path`, and mark it as in use. Returns the symlink's inode.

    Replaces a symlink of a program that has ended, atomically. Raises LinkError if anything else has the name.
    """
    name = f"pty:{link}"
    try:
        if not target(link):
            os.symlink(path, link)
        else:
            if os.path.realpath(link) != path and not stale(link):
                held = f"is a symlink to {target(link)}, which another program made"
                if who := far_program(link):
                    held = f"is a symlink to {target(link)}, which is in use: held by {who}"
                raise LinkError(name, held, "take another name")
            new = f"{link}.{os.getpid()}"
            try:
                os.symlink(path, new)
                os.replace(new, link)
            except BaseException:  # also a signal
                _remove(new, path)
                raise
        inode = os.lstat(link).st_ino
    except FileExistsError:
        raise LinkError(name, "exists and is not a symlink", "take another name") from None
    except OSError as error:
        raise LinkError(name, f"the symlink cannot be created: {error.strerror}") from error
    mark_in_use(slave, inode)
    return inode


class _Closings:
    """Detects by inotify (Linux) that a program closes a file. `fd` can be waited on; it is −1 without inotify."""

    def __init__(self, path: str) -> None:
        self.fd = -1
        with contextlib.suppress(ImportError, OSError, AttributeError, TypeError):
            import ctypes

            libc = ctypes.CDLL(None)
            self.fd = libc.inotify_init1(os.O_NONBLOCK | os.O_CLOEXEC)
            if self.fd >= 0:
                libc.inotify_add_watch(self.fd, os.fsencode(path), _IN_CLOSE)

    def seen(self) -> bool:
        """Return True if a program has closed the file since the last call."""
        if self.fd < 0:
            return False
        try:
            return bool(os.read(self.fd, 4096))
        except BlockingIOError:
            return False

    def close(self) -> None:
        if self.fd >= 0:
            os.close(self.fd)
        self.fd = -1
