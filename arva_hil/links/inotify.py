"""Detects that a program closes a file, with inotify (Linux). Python has no module for it."""

from __future__ import annotations

import contextlib
import os
from typing import Final

_IN_CLOSE: Final = 0x18


class Closings:
    """Watches a file. `fd` can be waited on; it is −1 if the system has no inotify."""

    def __init__(self, path: str) -> None:
        self.fd = -1
        with contextlib.suppress(ImportError, OSError, AttributeError, TypeError):
            import ctypes

            libc = ctypes.CDLL(None)
            self.fd = libc.inotify_init1(os.O_NONBLOCK | os.O_CLOEXEC)
            if self.fd >= 0:
                libc.inotify_add_watch(self.fd, os.fsencode(path), _IN_CLOSE)

    def seen(self) -> bool:
        """Whether a program has closed the file since the last call."""
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
