"""A binary file or standard output as a link that is only written to."""

from __future__ import annotations

import contextlib
import io
import os
import select
import stat
import sys
from collections.abc import Callable
from typing import BinaryIO, Final

from arva_hil.links.base import Link, LinkError, Opening
from arva_hil.links.url import Address
from arva_hil.runtime.clock import await_descriptors

_AT_ONCE: Final = getattr(select, "PIPE_BUF", 512)  # bytes that a pipe takes without waiting when it takes any
_ASK_S: Final = 0.1  # how often it is asked whether to give up


class ReaderGone(LinkError):
    """Nobody reads the pipe any more: there is no use in going on, and nothing that is wrong."""


class StdoutLink(Link):
    """Writes whole to `file`. It reads nothing.

    This one link waits for a slow reader, until `give_up` says to drop the write instead. `write` raises ReaderGone
    when the reader went away, LinkError when the disk is full; then the file ends where the write before it did.
    `close` leaves `file` open.
    """

    @classmethod
    def open(cls, address: Address, how: Opening) -> Link:
        """See `Link`."""
        return open_stdout()

    def __init__(self, file: BinaryIO, name: str = "-") -> None:
        self.name = name
        self.give_up: Callable[[], bool] = lambda: False
        self._file: BinaryIO | None = file
        self._fills = sys.platform != "win32" and _fills(file)

    def read(self) -> bytes:
        return b""

    def write(self, data: bytes) -> bool:
        if self._file is None:
            raise LinkError(self.name, "is closed")
        left = memoryview(data)
        try:
            if self._fills and not self._has_room(self._file):
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
            self._cut(self._file, len(data) - len(left))
            raise LinkError(self.name, f"cannot be written: {error.strerror or error}") from error
        return True

    def close(self) -> None:
        self._file = None

    def _has_room(self, file: BinaryIO) -> bool:
        """Wait for room, or until it is no use."""
        pause = 0.0
        while not await_descriptors(write=[file.fileno()], timeout_s=pause):
            if self.give_up():
                return False
            pause = _ASK_S
        return True

    def _cut(self, file: BinaryIO, size: int) -> None:
        """Take back the last `size` bytes of a file: the beginning of what does not fit."""
        with contextlib.suppress(OSError, ValueError):
            if size and file.tell() == os.fstat(file.fileno()).st_size:
                file.truncate(file.tell() - size)


def open_stdout() -> StdoutLink:
    """Standard output without its buffer, which would fail once more at exit when the reader went away."""
    buffer = sys.stdout.buffer
    return StdoutLink(getattr(buffer, "raw", buffer))


def _fills(file: BinaryIO) -> bool:
    """Whether somebody has to read what is written, or there is no more room."""
    try:
        return not stat.S_ISREG(os.fstat(file.fileno()).st_mode)
    except (OSError, io.UnsupportedOperation):
        return False
