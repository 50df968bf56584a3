"""How bytes travel: `open_link("udpin:127.0.0.1:14550", clock=clock)` and its like.

Every kind of link is its own small module, listed in `arva_hil.registry` and imported when it is first opened.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from arva_hil.links.base import Absent, Link, LinkEnded, LinkError, Opening, Sender
from arva_hil.links.url import Address, AddressError, parse
from arva_hil.registry import LINKS

if TYPE_CHECKING:
    from arva_hil.runtime.clock import Clock

__all__ = [
    "Absent",
    "Address",
    "AddressError",
    "Link",
    "LinkEnded",
    "LinkError",
    "Opening",
    "Sender",
    "open_link",
    "parse",
]


def open_link(
    address: str | Address, *, baud: int = 115200, clock: Clock, brief: bool = False, answered: bool = False
) -> Link:
    """Open the link an address names; `baud` (bit/s) is for serial ports whose address names none.

    `clock` paces a log file and tells how long a client has taken nothing. `brief`: one try of many, so be quick about
    it and name no cures. `answered`: the far end takes what it is sent, or the connection is dead (TCP).
    Raises AddressError for a string that cannot be read, LinkError for a link that cannot be opened, KindError for a
    kind of link that cannot be used.
    """
    if isinstance(address, str):
        address = parse(address)
    kind: Any = LINKS[address.kind]
    link: Link = kind.open(address, Opening(clock, baud, brief, answered))
    return link
