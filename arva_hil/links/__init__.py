"""How bytes travel: `open_link("udpin:127.0.0.1:14550", clock=clock)` and its like.

Every kind of link is its own small module, imported when it is first opened.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from arva_hil.links.base import Absent, Link, LinkEnded, LinkError, Sender
from arva_hil.links.url import Address, AddressError, parse

if TYPE_CHECKING:
    from arva_hil.runtime.clock import Clock

__all__ = ["Absent", "Address", "AddressError", "Link", "LinkEnded", "LinkError", "Sender", "open_link", "parse"]


def open_link(
    address: str | Address, *, baud: int = 115200, clock: Clock, brief: bool = False, answered: bool = False
) -> Link:
    """Open the link an address names; `baud` (bit/s) is for serial ports whose address names none.

    `clock` paces a log file and tells how long a client has taken nothing. `brief`: one try of many, so be quick about
    it and name no cures. `answered`: the far end takes what it is sent, or the connection is dead (TCP).
    Raises AddressError for a string that cannot be read, LinkError for a link that cannot be opened.
    """
    if isinstance(address, str):
        address = parse(address)
    match address.kind:
        case "serial":
            from arva_hil.links.serial import open_serial

            return open_serial(address.path, address.baud or baud, brief=brief)
        case "pyserial":
            from arva_hil.links.serial import open_url

            return open_url(address.path, address.baud or baud)
        case "pty":
            from arva_hil.links.pty import PtyLink

            return PtyLink(address.path)
        case "udpin":
            from arva_hil.links.udp import UdpInLink

            return UdpInLink(address.host, address.port)
        case "udpout":
            from arva_hil.links.udp import UdpOutLink

            return UdpOutLink(address.host, address.port)
        case "tcp":
            from arva_hil.links.tcp import BRIEF_S, CONNECT_S, TcpLink

            return TcpLink(address.host, address.port, BRIEF_S if brief else CONNECT_S, answered=answered)
        case "tcpin":
            from arva_hil.links.tcp_server import TcpServerLink

            return TcpServerLink(address.host, address.port, clock, answered=answered)
        case "tlog":
            from arva_hil.links.tlog import TlogLink

            return TlogLink(address.path, clock)
        case "stdout":
            from arva_hil.links.stdout import open_stdout

            return open_stdout()
