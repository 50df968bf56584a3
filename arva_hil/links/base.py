"""The base classes of all links and of those to a byte stream, and their errors."""

from __future__ import annotations

import contextlib
import os
from abc import ABC, abstractmethod
from collections.abc import Collection, Hashable
from typing import Any, Final, NamedTuple

from arva_hil.clock import Clock, await_descriptors
from arva_hil.errors import ArvaError
from arva_hil.links.url import show

Sender = Hashable  # one of several senders on a link; None if the link has only one


class LinkError(ArvaError):
    """A link could not be opened, or was lost. `str()` is the whole message: where, what and the cure."""

    def __init__(self, link: str, what: str, hint: str = "") -> None:
        self.link = link
        self.what = what
        self.hint = hint
        super().__init__(f"{link}: {what}" + (f"; {hint}" if hint else ""))


class Absent(LinkError):
    """A link cannot be opened because its far end does not exist, or not yet."""


class LinkEnded(LinkError):
    """A link has come to its normal end: all of a log was played."""


class Opening(NamedTuple):
    """The parameters for opening a link: see `open_link`."""

    clock: Clock
    brief: bool = False
    answered: bool = False


class Link(ABC):
    """A two-way byte stream that never blocks.

    A kind with a connection string has a class method `open(address: Address, how: Opening)`, which returns a link or
    raises LinkError. `reopened`: a lost link of this kind should be opened again.

    - `name`: the connection string.
    - `dropped`: number of writes dropped because the far end does not read.
    - `refusals`: number of reports that no program listens at the far end.
    - `strangers`: number of reads from other senders than the peer. `stranger`: address of the first.

    Some kinds survive the loss of their far end:

    - `losses`: number of losses. `why`: message of the last loss, or what a person must do before the link can return.
    - `renewals`: number of new far ends. `returns`: number of renewals that lasted.
    """

    reopened: bool = False
    name: str
    dropped: int = 0
    refusals: int = 0
    strangers: int = 0
    stranger: str = ""
    losses: int = 0
    renewals: int = 0
    returns: int = 0
    why: str = ""
    _open: bool = True
    _fd: int | None = None  # to wait on

    @property
    def away(self) -> bool:
        """True after a loss, until the return."""
        return self.losses > self.returns

    @abstractmethod
    def read(self) -> bytes:
        """Return all bytes that have arrived, b"" if there are none. Raises LinkError if the link is lost."""

    @abstractmethod
    def write(self, data: bytes) -> bool:
        """Send all of `data`; or drop all of it, count it and return False. Raises LinkError if the link is lost."""

    def receive(self) -> list[tuple[Sender, bytes]]:
        """Read as `read`, but with separate bytes for each sender: (sender, bytes), the peer first."""
        data = self.read()
        return [(None, data)] if data else []

    def follow(self, peer: Sender, others: Collection[Sender] = ()) -> None:  # noqa: B027
        """Set where writes go: to `peer`, a sender that `receive` named; or to `others` if `peer` is not known (None).

        A new peer instead of an earlier one counts as a loss and a return. Without a call, writes go to every sender.
        """

    def pin(self) -> None:  # noqa: B027
        """Keep the peer: other senders are not read, and a peer that leaves is not replaced."""

    @abstractmethod
    def close(self) -> None:
        """Close the link. A second call does nothing."""

    def _gone(self, why: LinkError) -> None:
        """Count a loss of the far end, unless it is lost already."""
        if not self.away:
            self.losses += 1
            self.why = str(why)

    def _renewed(self, *, lasting: bool = True) -> None:
        """Count a new far end; if it is `lasting`, count a return too."""
        self.renewals += 1
        self.returns += lasting

    def _check_open(self) -> None:
        if not self._open:
            raise LinkError(self.name, "is closed")

    def fileno(self) -> int | None:
        """Return a descriptor to wait on; None if there is none, and `ready` must be polled."""
        return self._fd if self._open else None

    def ready(self) -> bool:
        """Return True if `read` would return bytes or raise an error."""
        fd = self.fileno()
        return fd is not None and await_descriptors([fd])


class SeveralSenders(Link):
    """A link with several senders. Remembers the `peer`, the one that `follow` has set."""

    peer: Any = None
    _others: Collection[Any] | None = None  # receivers of writes while there is no peer; None: every sender
    _pinned: bool = False

    def read(self) -> bytes:
        return b"".join([data for _, data in self.receive()])

    def follow(self, peer: Sender, others: Collection[Sender] = ()) -> None:
        if self._pinned:
            return
        self._others = others
        if peer == self.peer:
            return
        if self.peer is not None:
            self._gone(LinkError(self.name, f"lost: {show(*self.peer[:2])} is silent"))
        self.peer = peer
        if self.away:
            self._renewed()

    def pin(self) -> None:
        self._pinned = True

    def _hears(self, sender: Any) -> bool:
        """Return True if a sender that is not the peer is read. Counts it if there is a peer."""
        if self.peer is not None:
            self.strangers += 1
            self.stranger = self.stranger or show(*sender[:2])
        return not self._pinned


CHUNK: Final = 65536  # bytes asked of the system at a time
AT_ONCE: Final = 1 << 16  # bytes that one `read` returns, plus one chunk at most: a flood cannot block the loop


class EndOfStream(ArvaError, ConnectionError):
    """The far end has closed the stream."""


class StreamLink(Link):
    """A byte stream. If the system accepted a part of a write, remembers the rest and sends it before the next write.

    `_receive` and `_send` of a subclass raise BlockingIOError for "not now" and any other OSError for "lost".
    """

    hint = ""  # the cure when this kind of link is lost
    drained_below = 0  # a shorter chunk was the last one; 0: unknown

    def __init__(self, name: str) -> None:
        self.name = name
        self._rest = b""

    @abstractmethod
    def _receive(self) -> bytes:
        """Return the next bytes; b"" if the far end has closed."""

    @abstractmethod
    def _send(self, data: bytes) -> int:
        """Send some of the bytes. Returns their number."""

    @abstractmethod
    def _shut(self) -> None:
        """Close the stream."""

    def read(self) -> bytes:
        self._check_open()
        if self._rest:
            with contextlib.suppress(OSError):  # if the link is lost, `_receive` raises it after the last bytes
                self._send_rest()
        data = b""
        try:
            while len(data) < AT_ONCE:
                chunk = self._receive()
                if not chunk:
                    raise EndOfStream("closed by the far end")
                data = data + chunk if data else chunk
                if len(chunk) < self.drained_below:
                    break
        except BlockingIOError:
            pass
        except OSError as error:
            if not data:
                raise self._lost(error) from error
        return data

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
        """Return the number of bytes that the system accepted."""
        try:
            return self._send(data)
        except BlockingIOError:
            return 0

    def _lost(self, error: OSError) -> LinkError:
        return LinkError(self.name, f"lost: {error.strerror or error}", self.hint)


class FdLink(StreamLink):
    """A stream over a non-blocking file descriptor of a terminal (POSIX)."""

    drained_below = 2048  # a terminal holds 4 kB

    def __init__(self, name: str, fd: int) -> None:
        super().__init__(name)
        os.set_blocking(fd, False)
        self._fd: int = fd

    def _receive(self) -> bytes:
        if data := os.read(self._fd, CHUNK):
            return data
        if not await_descriptors([self._fd]):  # a terminal with VMIN 0 reads b"" both when idle and when hung up
            raise BlockingIOError
        return os.read(self._fd, CHUNK)

    def _send(self, data: bytes) -> int:
        return os.write(self._fd, data)
