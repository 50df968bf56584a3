"""Links within one program: two that are connected to each other, and one that has several users."""

from __future__ import annotations

from collections import deque
from collections.abc import Collection
from typing import Final

from arva_hil.links.base import Link, LinkError, Sender, SeveralSenders


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


_MOST: Final = 1 << 18  # bytes that wait for a user; one that takes none loses them


class SharedLink:
    """Remembers the link and its users. The opener of the link closes it."""

    def __init__(self, link: Link) -> None:
        self.link = link
        self._users: list[LinkUser] = []

    def user(self) -> Link:
        """Add a user of the link."""
        user = LinkUser(self)
        self._users.append(user)
        return user

    def take_in(self) -> None:
        """Pass the bytes that have come to all users. Raises LinkError if the link is lost."""
        for sender, data in self.link.receive():
            for user in self._users:
                user.put(sender, data)
        for user in self._users:
            user.note()


class LinkUser(SeveralSenders):
    """One user's view of the link. Writes go to every sender on the link: the packets in them have addresses.

    After `pin` only the peer that was followed then is read.
    """

    def __init__(self, shared: SharedLink) -> None:
        self._shared = shared
        self._waiting = deque[tuple[Sender, bytes]]()
        self._size = 0
        self.note()

    @property
    def away(self) -> bool:
        return self._shared.link.away

    def put(self, sender: Sender, data: bytes) -> None:
        """Add bytes that came on the link."""
        if self._pinned and sender != self.peer:
            return
        if self._size + len(data) > _MOST:
            self._waiting.clear()
            self._size = 0
        self._waiting.append((sender, data))
        self._size += len(data)

    def note(self) -> None:
        """Give the state of the link to all its users."""
        link = self._shared.link
        self.name, self.why, self.losses, self.renewals = link.name, link.why, link.losses, link.renewals
        self.returns = link.returns

    def receive(self) -> list[tuple[Sender, bytes]]:
        self._shared.take_in()
        came, self._size = list(self._waiting), 0
        self._waiting.clear()
        return came

    def write(self, data: bytes) -> bool:
        return self._shared.link.write(data)

    def follow(self, peer: Sender, others: Collection[Sender] = ()) -> None:
        if not self._pinned:
            self.peer = peer

    def ready(self) -> bool:
        return bool(self._waiting) or self._shared.link.ready()

    def close(self) -> None:
        """Do nothing: the link is not this user's."""
