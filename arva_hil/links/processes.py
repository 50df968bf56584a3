"""The processes that have a terminal or a socket open, from /proc. Linux; other users' processes only as root."""

from __future__ import annotations

import contextlib
import glob
import os
import stat
from collections.abc import Callable, Iterator
from typing import Final, NamedTuple

_PTYS: Final = "/dev/pts/"
_ESTABLISHED: Final = "01"
_LISTENS: Final = {"tcp": "0A", "udp": "07"}


def far_program(device: str) -> str:
    """Return the command of the program with the master of a pseudo-terminal; "" if it is unknown or not one.

    The system reuses the numbers of pseudo-terminals, so another program may have the same device later.
    """
    real = os.path.realpath(device)
    if not real.startswith(_PTYS):
        return ""
    return next((command for _, command in _processes(lambda process: _has_master(process, real))), "")


def holders(device: str) -> list[str]:
    """Return each process that has a device open, as `1234 (command)`."""
    real = os.path.realpath(device)
    return _shown(lambda process: any(_is_here(fd, real) for fd, target in _descriptors(process) if target == real))


def other_readers(device: str) -> list[str]:
    """Return each other process that has a terminal open for reading, as `1234 (command)`.

    Each of two readers gets only a part of the bytes, without an error. The process with the master of a
    pseudo-terminal does not count. The list is empty if `device` is not a device.
    """
    try:
        if not stat.S_ISCHR(os.stat(device).st_mode):
            return []
    except (OSError, ValueError):
        return []
    real, own = os.path.realpath(device), f"/proc/{os.getpid()}"
    return _shown(lambda process: process != own and _reads(process, real) and not _has_master(process, real))


def listeners(port: int, protocol: str) -> list[str]:
    """Return each process that listens at a port of this machine, as `1234 (command)`. `protocol`: tcp or udp."""
    rows = _sockets(protocol)
    inodes = {f"socket:[{row.inode}]" for row in rows if row.near == port and row.state == _LISTENS[protocol]}
    return _shown(lambda process: any(target in inodes for _, target in _descriptors(process))) if inodes else []


def accepted(port: int) -> bool | None:
    """Return True if the TCP server at a port of this machine has accepted this process's connection.

    A server for a single client does not accept the next one, which is connected and receives nothing. None: there is
    no such connection, or the server is on another machine.
    """
    rows = [row for row in _sockets("tcp") if row.state == _ESTABLISHED]
    own = {target for _, target in _descriptors("/proc/self")}
    ours = {row.near for row in rows if row.far == port and f"socket:[{row.inode}]" in own}
    theirs = [row for row in rows if row.near == port and row.far in ours]
    return all(row.inode != "0" for row in theirs) if theirs else None


def _shown(wanted: Callable[[str], bool]) -> list[str]:
    return [f"{os.path.basename(process)} ({command[:60]})" for process, command in _processes(wanted)]


def _processes(wanted: Callable[[str], bool]) -> Iterator[tuple[str, str]]:
    """Yield the folder and the command of each wanted process, by process id."""
    for process in sorted(glob.glob("/proc/[0-9]*"), key=lambda path: int(os.path.basename(path))):
        with contextlib.suppress(OSError):  # another user's, or it has ended
            if wanted(process):
                with open(f"{process}/cmdline", "rb") as file:
                    yield process, file.read(200).replace(b"\0", b" ").decode(errors="replace").strip()


def _descriptors(process: str) -> Iterator[tuple[str, str]]:
    """Yield the path of each descriptor of a process, and what it leads to."""
    for fd in os.listdir(f"{process}/fd"):
        with contextlib.suppress(FileNotFoundError):  # it has been closed meanwhile
            yield (path := f"{process}/fd/{fd}"), os.readlink(path)


def _has_master(process: str, device: str) -> bool:
    return any(
        target.endswith("ptmx")
        and _info(fd, "tty-index:") == device.removeprefix(_PTYS)
        and (not target.startswith(_PTYS) or _is_here(fd, device))
        for fd, target in _descriptors(process)
    )


def _reads(process: str, device: str) -> bool:
    return any(
        int(_info(fd, "flags:") or str(os.O_RDWR), 8) & os.O_ACCMODE != os.O_WRONLY
        for fd, target in _descriptors(process)
        if target == device and _is_here(fd, device)
    )


def _is_here(fd: str, device: str) -> bool:
    """Return True if an open descriptor is this machine's device, not one of the same name in a container."""
    with contextlib.suppress(FileNotFoundError):  # it has been closed meanwhile
        return not device.startswith(_PTYS) or os.stat(fd).st_dev == os.stat(device).st_dev
    return False


def _info(fd: str, key: str) -> str:
    """Return the system's value of a key of a descriptor, "" if it has none."""
    with contextlib.suppress(FileNotFoundError), open(fd.replace("/fd/", "/fdinfo/")) as file:
        return next((line.split()[1] for line in file if line.startswith(key)), "")
    return ""


class _Socket(NamedTuple):
    """A row of /proc/net: the ports of this end and the other, and "0" as the inode before it is accepted."""

    near: int
    far: int
    state: str
    inode: str


def _sockets(protocol: str) -> list[_Socket]:
    found = []
    for table in (protocol, f"{protocol}6"):
        with contextlib.suppress(OSError), open(f"/proc/net/{table}") as file:
            for words in map(str.split, list(file)[1:]):
                near, far = (int(word.rpartition(":")[2], 16) for word in words[1:3])
                found.append(_Socket(near, far, words[3], words[9]))
    return found
