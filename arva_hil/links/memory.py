"""Two links in one process, connected to each other: for tests and the built-in vehicle."""

from __future__ import annotations

from collections import deque

from arva_hil.links.base import Link, LinkError


class MemoryLink(Link):
    """One end of a `pair`. `ready` must be polled: it is true if bytes wait or the far end has closed."""

    def __init__(self, name: str, capacity: int | None) -> None:
        self.name = name
        self._capacity = capacity
        self._inbox: deque[bytes] = deque()
        self._far: MemoryLink = self

    def read(self) -> bytes:
        inbox = self._inbox
        if not inbox:
            self._check_open()
            return b""
        data = b"".join(inbox)
        inbox.clear()
        return data

    def write(self, data: bytes) -> bool:
        self._check_open()
        inbox = self._far._inbox
        if self._capacity is not None and sum(map(len, inbox)) + len(data) > self._capacity:
            self.dropped += 1
            return False
        inbox.append(bytes(data))
        return True

    def close(self) -> None:
        self._open = False
        self._inbox.clear()

    def _check_open(self) -> None:
        if not (self._open and self._far._open):
            super()._check_open()
            raise LinkError(self.name, "lost: closed by the far end")

    def ready(self) -> bool:
        return self._open and (bool(self._inbox) or not self._far._open)


def pair(capacity: int | None = None) -> tuple[MemoryLink, MemoryLink]:
    """Return two connected links. `capacity`: bytes in each direction; a longer write is dropped."""
    a, b = MemoryLink("memory:a", capacity), MemoryLink("memory:b", capacity)
    a._far, b._far = b, a
    return a, b
