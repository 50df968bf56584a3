"""Links carry bytes: `open_link("udpin:127.0.0.1:14550", clock=clock)`.

Each kind of link is a module, listed in `arva_hil.registry` and imported when a link of that kind is first opened.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from arva_hil.links.base import Link, LinkEnded, LinkError, Opening, Sender
from arva_hil.links.url import Address, AddressError, parse
from arva_hil.registry import LINKS

if TYPE_CHECKING:
    from arva_hil.clock import Clock

__all__ = ["Address", "AddressError", "Link", "LinkEnded", "LinkError", "Opening", "Sender", "open_link", "parse"]


def open_link(address: str | Address, *, clock: Clock, brief: bool = False, answered: bool = False) -> Link:
    """Open the link of an address. A serial port whose address has no baud rate has 115200 bit/s.

    `clock`: for the time of a log file and for time-outs of clients. `brief`: this is one of many tries, so use short
    time-outs and errors without cures. `answered`: close a TCP connection whose far end acknowledges nothing for 5 s.
    Raises AddressError for a wrong connection string, LinkError for a link that cannot be opened, KindError for a
    kind of link that cannot be used.
    """
    if isinstance(address, str):
        address = parse(address)
    kind: Any = LINKS[address.kind]
    link: Link = kind.open(address, Opening(clock, brief, answered))
    return link
