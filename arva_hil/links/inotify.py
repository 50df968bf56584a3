"""When somebody closes a file: inotify, which Python has no module for (Linux)."""

from __future__ import annotations

import contextlib
import os
from typing import Final

_IN_CLOSE: Final = 0x18


class Closings:
    """Watches a file. `seen` tells of closings, and `fd` can be waited on; where the system cannot tell it is −1."""

    def __init__(self, path: str) -> None:
        self.fd = -1
        with contextlib.suppress(ImportError, OSError, AttributeError, TypeError):
            import ctypes

            libc = ctypes.CDLL(None)
            self.fd = libc.inotify_init1(os.O_NONBLOCK | os.O_CLOEXEC)
            if self.fd >= 0:
                libc.inotify_add_watch(self.fd, os.fsencode(path), _IN_CLOSE)

    def seen(self) -> bool:
        """Whether anybody has closed it since the last call."""
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
