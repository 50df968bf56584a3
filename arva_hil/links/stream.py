"""The base of links to a byte stream: reads all that is there, and never blocks or sends a part of a write."""

from __future__ import annotations

import contextlib
import os
from abc import abstractmethod
from typing import Final

from arva_hil.errors import ArvaError
from arva_hil.links.base import Link, LinkError
from arva_hil.runtime.clock import await_descriptors

CHUNK: Final = 65536  # bytes asked of the system at a time
AT_ONCE: Final = 1 << 16  # bytes that one `read` returns, plus one chunk at most: a flood cannot block the loop


class EndOfStream(ArvaError, ConnectionError):
    """The far end has closed the stream."""


class StreamLink(Link):
    """A byte stream. If the system accepted a part of a write, remembers the rest and sends it before the next write.

    A subclass has `_receive`, `_send` and `_shut`. They raise BlockingIOError for "not now" and any other OSError
    for "lost"; `_receive` returns b"" if the far end has closed.
    """

    hint = ""  # the cure when this kind of link is lost

    def __init__(self, name: str) -> None:
        self.name = name
        self._rest = b""
        self._open = True

    @abstractmethod
    def _receive(self) -> bytes: ...

    @abstractmethod
    def _send(self, data: bytes) -> int: ...

    @abstractmethod
    def _shut(self) -> None: ...

    def read(self) -> bytes:
        self._check_open()
        with contextlib.suppress(OSError):  # if the link is lost, `_receive` raises it after the last bytes
            self._send_rest()
        data = bytearray()
        try:
            while len(data) < AT_ONCE:
                chunk = self._receive()
                if not chunk:
                    raise EndOfStream("closed by the far end")
                data += chunk
        except BlockingIOError:
            pass
        except OSError as error:
            if not data:
                raise self._lost(error) from error
        return bytes(data)

    def write(self, data: bytes) -> bool:
        self._check_open()
        try:
            self._send_rest()
            sent = 0 if self._rest else self._push(data)
        except OSError as error:
            raise self._lost(error) from error
        if sent:
            self._rest = bytes(data[sent:])
        elif data:
            self.dropped += 1
            return False
        return True

    def close(self) -> None:
        if self._open:
            self._open = False
            self._shut()

    def _send_rest(self) -> None:
        if self._rest:
            self._rest = self._rest[self._push(self._rest) :]

    def _push(self, data: bytes) -> int:
        """The number of bytes that the system accepted."""
        try:
            return self._send(data)
        except BlockingIOError:
            return 0

    def _check_open(self) -> None:
        if not self._open:
            raise LinkError(self.name, "is closed")

    def _lost(self, error: OSError) -> LinkError:
        return LinkError(self.name, f"lost: {error.strerror or error}", self.hint)


class FdLink(StreamLink):
    """A stream over a non-blocking file descriptor of a terminal (POSIX)."""

    def __init__(self, name: str, fd: int) -> None:
        super().__init__(name)
        os.set_blocking(fd, False)
        self._fd = fd

    def fileno(self) -> int | None:
        return self._fd if self._open else None

    def _receive(self) -> bytes:
        if not await_descriptors([self._fd]):  # a terminal with VMIN 0 reads b"" both when idle and when hung up
            raise BlockingIOError
        return os.read(self._fd, CHUNK)

    def _send(self, data: bytes) -> int:
        return os.write(self._fd, data)
