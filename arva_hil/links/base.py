"""The base class of all links, and their errors."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Collection, Hashable
from typing import NamedTuple

from arva_hil.errors import ArvaError
from arva_hil.runtime.clock import Clock, await_descriptors

Sender = Hashable  # one of several senders on a link; None if the link has only one


class LinkError(ArvaError):
    """A link could not be opened, or was lost. `str()` is the whole message: where, what and the cure."""

    def __init__(self, link: str, what: str, hint: str = "") -> None:
        self.link = link
        self.what = what
        self.hint = hint
        super().__init__(f"{link}: {what}" + (f"; {hint}" if hint else ""))


class Absent(LinkError):
    """A link cannot be opened because its far end is not there, or not there yet."""


class LinkEnded(LinkError):
    """A link has come to its normal end: all of a log was played."""


class Opening(NamedTuple):
    """How to open a link: see `open_link`."""

    clock: Clock
    baud: int = 115200
    brief: bool = False
    answered: bool = False


class Link(ABC):
    """A two-way byte stream that never blocks.

    A kind of link with a connection string has a class method `open(address: Address, how: Opening)`, which returns
    a link or raises LinkError. `reopened`: a lost link of this kind should be opened again.

    `name`: the connection string for a person. `dropped`: the number of writes that were dropped because the far end
    does not read. `refusals`: how often the far machine reported that nobody listens there. `strangers`: the number
    of reads from other senders than the peer; `stranger`: the address of the first of them.

    Some kinds survive the loss of their far end. `losses`: how often it was lost; `why`: the message of the last
    loss, or what a person must do before the link can return; `renewals`: how often a new far end replaced a lost
    one; `returns`: the renewals that lasted.
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

    @property
    def away(self) -> bool:
        """True after a loss, until the return."""
        return self.losses > self.returns

    @abstractmethod
    def read(self) -> bytes:
        """All bytes that have arrived, b"" if there are none. Raises LinkError if the link is lost."""

    @abstractmethod
    def write(self, data: bytes) -> bool:
        """Send all of `data`; or drop all of it, count it and return False. Raises LinkError if the link is lost."""

    def receive(self) -> list[tuple[Sender, bytes]]:
        """As `read`, but with separate bytes for each sender: (sender, bytes), the peer first."""
        data = self.read()
        return [(None, data)] if data else []

    def follow(self, peer: Sender, others: Collection[Sender] = ()) -> None:  # noqa: B027
        """Set where writes go: to `peer`, a sender that `receive` named; or to `others` if `peer` is not known (None).

        A new peer instead of an earlier one counts as a loss and a return. Without a call, writes go to every sender.
        """

    def pin(self) -> None:  # noqa: B027
        """Keep the peer for ever: other senders are not read, and a peer that leaves is not replaced."""

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

    def fileno(self) -> int | None:
        """A descriptor to wait on; None if there is none, and `ready` must be polled."""
        return None

    def ready(self) -> bool:
        """Whether `read` would return bytes or raise an error."""
        fd = self.fileno()
        return fd is not None and await_descriptors([fd])
