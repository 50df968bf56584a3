"""A link that only writes: to a binary file or standard output."""

from __future__ import annotations

import contextlib
import io
import os
import select
import stat
import sys
from collections.abc import Callable
from typing import BinaryIO, Final

from arva_hil.clock import await_descriptors
from arva_hil.links.base import Link, LinkError, Opening
from arva_hil.links.url import Address

_AT_ONCE: Final = getattr(select, "PIPE_BUF", 512)  # if a pipe is writable, it accepts this many bytes without waiting
_ASK_S: Final = 0.1  # time between calls of `give_up`


class ReaderGone(LinkError):
    """No program reads the pipe any more. The program should end without an error."""


class StdoutLink(Link):
    """Writes to `file`. It reads nothing.

    Unlike other links it waits for a slow reader, until `give_up()` is true; then it drops the write. `write` raises
    ReaderGone if the reader is gone, and LinkError if the disk is full; then no part of the write stays in the file.
    `close` does not close `file`.
    """

    @classmethod
    def open(cls, address: Address, how: Opening) -> Link:
        return open_stdout()

    def __init__(self, file: BinaryIO, name: str = "-") -> None:
        self.name = name
        self.give_up: Callable[[], bool] = lambda: False
        self._file = file
        self._fills = sys.platform != "win32" and _fills(file)

    def read(self) -> bytes:
        return b""

    def write(self, data: bytes) -> bool:
        self._check_open()
        left = memoryview(data)
        try:
            if self._fills and not self._has_room():
                self.dropped += 1
                return False
            while left:
                sent: int | None = self._file.write(left[:_AT_ONCE])  # None: a non-blocking pipe that is full
                if sent is None:
                    await_descriptors(write=[self._file.fileno()], timeout_s=None)
                left = left[sent or 0 :]
            self._file.flush()
        except BrokenPipeError as error:
            raise ReaderGone(self.name, "the reader of this pipe went away") from error
        except OSError as error:
            written = len(data) - len(left)
            with contextlib.suppress(OSError, ValueError):  # remove the first part of a write that did not fit
                if written and self._file.tell() == os.fstat(self._file.fileno()).st_size:
                    self._file.truncate(self._file.tell() - written)
            raise LinkError(self.name, f"cannot be written: {error.strerror or error}") from error
        return True

    def close(self) -> None:
        self._open = False

    def _has_room(self) -> bool:
        """Wait for room. Returns False if `give_up()` is true first."""
        pause = 0.0
        while not await_descriptors(write=[self._file.fileno()], timeout_s=pause):
            if self.give_up():
                return False
            pause = _ASK_S
        return True


def open_stdout() -> StdoutLink:
    """Open standard output without its buffer. A buffer would fail again at exit if the reader is gone."""
    buffer = sys.stdout.buffer
    return StdoutLink(getattr(buffer, "raw", buffer))


def _fills(file: BinaryIO) -> bool:
    """Return True if the file becomes full without a reader, as a pipe does."""
    try:
        return not stat.S_ISREG(os.fstat(file.fileno()).st_mode)
    except (OSError, io.UnsupportedOperation):
        return False
