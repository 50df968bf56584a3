"""What every way for bytes to travel has in common: the `Link`, and the one error it raises."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Collection, Hashable
from typing import NamedTuple

from arva_hil.errors import ArvaError
from arva_hil.runtime.clock import Clock, await_descriptors

Sender = Hashable  # one of several on a link; None where a link has but one


class LinkError(ArvaError):
    """A link that could not be opened or was lost. `str()` is the whole message: what, where and the cure."""

    def __init__(self, link: str, what: str, hint: str = "") -> None:
        self.link = link
        self.what = what
        self.hint = hint
        super().__init__(f"{link}: {what}" + (f"; {hint}" if hint else ""))


class Absent(LinkError):
    """A link that cannot be opened because its far end is not there, or not yet."""


class LinkEnded(LinkError):
    """A link that came to the end it was bound to have: a log that was played."""


class Opening(NamedTuple):
    """How a link is to be opened: see `open_link`."""

    clock: Clock
    baud: int = 115200
    brief: bool = False
    answered: bool = False


class Link(ABC):
    """A two-way byte stream that never blocks.

    A kind of link that a connection string can name has a class method `open(address: Address, how: Opening)`, which
    gives a link or raises LinkError. `reopened`: one that is lost is to be opened again.

    `name` is the connection string a person knows it by. `dropped` counts the writes that were dropped whole
    because nobody empties the far end, `refusals` how often the far machine said that nobody listens there,
    `strangers` what came from another address than the far end's and was not read; `stranger` is the first of those
    addresses.

    Some kinds outlive their far end. They count `losses`, `why` being the last one's message, or what a person has to
    see to before it can be back; `renewals`, each of
    which put a new far end in the place of a lost one; and `returns`, the renewals that lasted.
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
        """True from a loss to the return behind it."""
        return self.losses > self.returns

    @abstractmethod
    def read(self) -> bytes:
        """All that is there now, b"" when nothing is. Raises LinkError when the link is lost."""

    @abstractmethod
    def write(self, data: bytes) -> bool:
        """Send `data` whole, or drop it whole, count it and return False. Raises LinkError when lost."""

    def receive(self) -> list[tuple[Sender, bytes]]:
        """As `read`, but what several senders sent is kept apart: each sender and its bytes, the peer's first."""
        data = self.read()
        return [(None, data)] if data else []

    def follow(self, peer: Sender, others: Collection[Sender] = ()) -> None:  # noqa: B027
        """Whom writes go to: `peer`, one of the senders that `receive` names; `others` while it is None, not known yet.

        A peer in the place of another is a loss and a return. Without a call to this, every sender gets them.
        """

    def pin(self) -> None:  # noqa: B027
        """From now on nobody takes the peer's place: others are not read; who leaves is lost for good."""

    @abstractmethod
    def close(self) -> None:
        """Give everything back; a second call does nothing."""

    def _gone(self, why: LinkError) -> None:
        """The far end is lost; one that has been lost and did not return is lost once."""
        if not self.away:
            self.losses += 1
            self.why = str(why)

    def _renewed(self, *, lasting: bool = True) -> None:
        """There is a new far end; if it is `lasting`, this is the return."""
        self.renewals += 1
        self.returns += lasting

    def fileno(self) -> int | None:
        """What the system can wait on; None where there is no such thing, and `ready` is polled instead."""
        return None

    def ready(self) -> bool:
        """True when `read` has something to give or an error to raise."""
        fd = self.fileno()
        return fd is not None and await_descriptors([fd])
