"""The links that can be read, among several."""

from __future__ import annotations

import select
from collections.abc import Mapping, Sequence
from contextlib import suppress

from arva_hil.clock import Waitable, await_descriptors
from arva_hil.links import Link


class ReadyLinks:
    """Remembers which descriptors of several links the system watches. To wait for all of them, wait for `waitables`.

    A link that is away or has no descriptor counts as ready, because it must be polled. Without epoll
    every link counts as ready.
    """

    def __init__(self, links: Mapping[str, Link]) -> None:
        self._links = links
        self._epoll = select.epoll() if hasattr(select, "epoll") else None
        self._names: dict[int, str] = {}  # by descriptor
        self._polled: list[str] = []  # those that are read every time
        self.waitables: Sequence[Waitable] = ()
        self.renew()

    def names(self) -> list[str]:
        """Return the links to read now, in their order."""
        if self._epoll is None:
            return self._polled
        ready = {self._names[fd] for fd, _ in self._epoll.poll(0) if fd in self._names}
        if not ready:
            return self._polled
        return [name for name in self._links if name in ready or name in self._polled]

    def renew(self) -> None:
        """Watch the present descriptors of the links: a link that comes back has a new one."""
        if self._epoll is None:
            self._polled, self.waitables = list(self._links), list(self._links.values())
            return
        names, polled = dict[int, str](), []
        for name, link in self._links.items():
            fd = link.fileno()
            if link.away or fd is None or not self._watch(fd):
                polled.append(name)
            else:
                names[fd] = name
        for fd in self._names.keys() - names.keys():
            with suppress(OSError, ValueError):  # it is already closed
                self._epoll.unregister(fd)
        self._names, self._polled = names, polled
        self.waitables = [self, *(self._links[name] for name in polled)]

    def forget(self, name: str) -> None:
        """Forget a link that is lost for ever."""
        self._links = {other: link for other, link in self._links.items() if other != name}
        self.renew()

    def fileno(self) -> int | None:
        """Return a descriptor that is readable while one of the watched links is."""
        return self._epoll.fileno() if self._epoll else None

    def ready(self) -> bool:
        """Return True if one of the watched links can be read."""
        fd = self.fileno()
        return fd is not None and await_descriptors([fd])

    def _watch(self, fd: int) -> bool:
        """Return True if the system watches a descriptor. It forgets closed ones; their numbers may be used again."""
        assert self._epoll is not None
        try:
            self._epoll.modify(fd, select.EPOLLIN)
        except FileNotFoundError:
            try:
                self._epoll.register(fd, select.EPOLLIN)
            except OSError:  # of a file
                return False
        except OSError:
            return False
        return True
