"""Symlinks to pseudo-terminals, and whether the program that made one still runs.

The system reuses the numbers of pseudo-terminals. The symlink of a killed program may therefore lead to another
program's terminal; then the symlink is older than the terminal. A running program marks its symlink as in use: it
locks the byte of the slave whose number is the symlink's inode. The lock ends with the program.
"""

from __future__ import annotations

import contextlib
import os
from typing import Final

PTYS: Final = "/dev/pts/"
_LONGEST: Final = 40  # symlinks in a chain; Linux follows no more


def target(link: str) -> str:
    """The target of a symlink as written; "" if `link` is not a symlink."""
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
    """Whether a running program has marked `link` as in use."""
    with contextlib.suppress(OSError):
        device, inode = os.stat(link), os.lstat(link).st_ino
        place = f"{os.major(device.st_dev):02x}:{os.minor(device.st_dev):02x}:{device.st_ino}"
        with open("/proc/locks") as file:
            return any(line.split()[-3:] == [place, str(inode), str(inode)] for line in file)
    return False


def stale(path: str) -> bool:
    """Whether `path` leads over a symlink of a program that has ended: to nothing, or to another program's terminal."""
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
