"""Symlinks that lead to a pseudo-terminal: whose they are, and whether they still lead where they did.

The number of a pseudo-terminal that is gone is given to the next one, and a symlink that a killed program left then
leads to a stranger's. Such a link is older than what it leads to. A program that is alive vouches for its
link: it holds a lock on the slave, at the byte whose number is the link's inode. The lock ends with the program.
"""

from __future__ import annotations

import contextlib
import os
from typing import Final

PTYS: Final = "/dev/pts/"
_LONGEST: Final = 40  # links that lead to one another; Linux follows no more


def target(link: str) -> str:
    """Where a symlink leads as it is written, "" when it is none."""
    try:
        return os.readlink(link)
    except OSError:
        return ""


def vouch(slave: int, inode: int) -> None:
    """Say that the symlink with this inode leads to the pseudo-terminal whose slave is open as `slave`, while it is."""
    with contextlib.suppress(ImportError, AttributeError, OSError):  # Linux
        import fcntl
        import struct

        lock = struct.pack("hhqqi", fcntl.F_WRLCK, os.SEEK_SET, inode, 1, 0)
        fcntl.fcntl(slave, fcntl.F_OFD_SETLK, lock)


def vouched(link: str) -> bool:
    """Whether a living program says that `link` leads to its pseudo-terminal."""
    with contextlib.suppress(OSError):
        device, inode = os.stat(link), os.lstat(link).st_ino
        place = f"{os.major(device.st_dev):02x}:{os.minor(device.st_dev):02x}:{device.st_ino}"
        with open("/proc/locks") as file:
            return any(line.split()[-3:] == [place, str(inode), str(inode)] for line in file)
    return False


def stale(path: str) -> bool:
    """Whether `path` is a symlink, or leads to one, that a program left which has ended: it leads nowhere or to the
    pseudo-terminal of another.
    """
    link = path
    for _ in range(_LONGEST):
        to = target(link)
        if not to or link.startswith("/proc/"):  # its links are made when they are looked at
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
    return device.st_ctime_ns > os.lstat(link).st_mtime_ns and not vouched(link)
