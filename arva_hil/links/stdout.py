"""A binary file or standard output as a link that is only written to."""

from __future__ import annotations

import select
import sys
from typing import BinaryIO

from arva_hil.links.base import Link, LinkError


class StdoutLink(Link):
    """Writes whole to `file`, drops nothing: this one link waits for a slow reader. It reads nothing.

    `write` raises LinkError when the reader went away or the disk is full. `close` leaves `file` open.
    """

    def __init__(self, file: BinaryIO, name: str = "-") -> None:
        self.name = name
        self._file: BinaryIO | None = file

    def read(self) -> bytes:
        return b""

    def write(self, data: bytes) -> bool:
        if self._file is None:
            raise LinkError(self.name, "is closed")
        try:
            left = memoryview(data)
            while left:
                sent: int | None = self._file.write(left)  # None: a non-blocking pipe that is full
                if sent is None:
                    select.select([], [self._file], [])
                left = left[sent or 0 :]
            self._file.flush()
        except BrokenPipeError as error:
            raise LinkError(self.name, "the reader of this pipe went away") from error
        except OSError as error:
            raise LinkError(self.name, f"cannot be written: {error.strerror or error}") from error
        return True

    def close(self) -> None:
        self._file = None


def open_stdout() -> StdoutLink:
    """Standard output without its buffer, which would fail once more at exit when the reader went away."""
    buffer = sys.stdout.buffer
    return StdoutLink(getattr(buffer, "raw", buffer))
