"""Finds other readers of a terminal. Each of two readers would get only a part of the bytes, without an error."""

from __future__ import annotations

import contextlib
import glob
import os
import stat

from arva_hil.links.serial_ports import command_of, is_here, is_master, natural


def other_readers(device: str) -> list[str]:
    """Each other process that has a terminal open for reading, as `1234 (command)`.

    The process with the master of a pseudo-terminal does not count. Linux; other users' processes only as root. Empty
    if `device` is not a device.
    """
    try:
        if not stat.S_ISCHR(os.stat(device).st_mode):
            return []
    except (OSError, ValueError):
        return []
    real, found = os.path.realpath(device), []
    for process in sorted(glob.glob("/proc/[0-9]*"), key=natural):
        pid = os.path.basename(process)
        with contextlib.suppress(OSError):  # another user's, or it has ended
            if pid != str(os.getpid()) and _reads(process, real):
                found.append(f"{pid} ({command_of(process)[:60]})")
    return found


def _reads(process: str, device: str) -> bool:
    reads = False
    for fd in os.listdir(f"{process}/fd"):
        path, info = f"{process}/fd/{fd}", f"{process}/fdinfo/{fd}"
        with contextlib.suppress(FileNotFoundError):  # it has been closed meanwhile
            target = os.readlink(path)
            if target == device and is_here(path, device):
                reads |= _flags(info) & os.O_ACCMODE != os.O_WRONLY
            elif target.endswith("ptmx") and is_master(path, info, device):
                return False
    return reads


def _flags(fdinfo: str) -> int:
    """The flags with which a descriptor was opened."""
    with open(fdinfo) as file:
        return next((int(line.split()[1], 8) for line in file if line.startswith("flags:")), os.O_RDWR)
