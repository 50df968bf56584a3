"""What a service manager has for its services: a datagram socket, and all that was said to it."""

from __future__ import annotations

import os
import socket
from typing import Final

_MOST: Final = 4096  # bytes


class Manager:
    """A socket at `name`, a path or an abstract name behind `@`."""

    def __init__(self, name: str) -> None:
        self.name = name
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._socket.bind("\0" + name[1:] if name.startswith("@") else name)

    def heard(self) -> list[str]:
        """What was said since the last call; longer messages are ignored, as systemd does."""
        messages = []
        try:
            while True:
                message = self._socket.recv(_MOST + 1)
                if len(message) <= _MOST:
                    messages.append(message.decode())
        except BlockingIOError:
            return messages

    def close(self) -> None:
        self._socket.close()
        if self.name.startswith("/"):
            os.unlink(self.name)
