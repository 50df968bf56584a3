"""Ports of this machine that no other test gets."""

from __future__ import annotations

import random
import socket
from typing import Final

_LEAST, _MOST = 20_000, 32_000  # from 32768 on the system gives a port to whoever wants any, as a client does
_random: Final = random.SystemRandom()
_taken: Final[list[socket.socket]] = []  # for as long as this process lives


def free_port(kind: socket.SocketKind) -> int:
    """A port at which nobody listens, and which is given neither to another worker nor to a client."""
    while True:
        port = _random.randrange(_LEAST, _MOST)
        mark = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        try:
            mark.bind(f"\0arva-hil-port-{port}")  # of no file
            with socket.socket(socket.AF_INET, kind) as there:
                there.bind(("127.0.0.1", port))
        except OSError:
            mark.close()
            continue
        _taken.append(mark)
        return port
