"""Whether the server of a TCP connection has accepted it, from Linux's table of connections."""

from __future__ import annotations

import contextlib
import os
from typing import NamedTuple

_ESTABLISHED = "01"


class _Row(NamedTuple):
    """A connection in /proc/net/tcp: the ports of this end and the other, and the socket, "0" before it is accepted."""

    near: int
    far: int
    inode: str


def accepted(port: int) -> bool | None:
    """Whether the server at a port of this machine has accepted this process's connection.

    A server for a single client does not accept the next one, which is connected and receives nothing. None: there is
    no such connection, or the server is on another machine.
    """
    rows = _connections()
    own = _own_sockets()
    ours = {row.near for row in rows if row.far == port and row.inode in own}
    theirs = [row for row in rows if row.near == port and row.far in ours]
    return all(row.inode != "0" for row in theirs) if theirs else None


def _connections() -> list[_Row]:
    found = []
    for table in ("tcp", "tcp6"):
        with contextlib.suppress(OSError), open(f"/proc/net/{table}") as file:
            for line in list(file)[1:]:
                words = line.split()
                if words[3] == _ESTABLISHED:
                    near, far = (int(word.rpartition(":")[2], 16) for word in words[1:3])
                    found.append(_Row(near, far, words[9]))
    return found


def _own_sockets() -> set[str]:
    """The inodes of this process's sockets."""
    found = set()
    with contextlib.suppress(OSError):
        for fd in os.listdir("/proc/self/fd"):
            with contextlib.suppress(OSError):  # closed meanwhile
                found.add(os.readlink(f"/proc/self/fd/{fd}").removeprefix("socket:[").removesuffix("]"))
    return found
