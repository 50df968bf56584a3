"""UDP: one write is one datagram; what several datagrams bring is read joined."""

from __future__ import annotations

import errno
import socket
from typing import Any, Final

from arva_hil.links.base import Link, LinkError
from arva_hil.links.stream import AT_ONCE, CHUNK
from arva_hil.links.tcp import listen_error, resolve, show

# Nobody hears now, which is no reason to give up: the far end may start later.
_UNHEARD: Final = frozenset(
    getattr(errno, name)
    for name in ("ECONNREFUSED", "ECONNRESET", "EHOSTUNREACH", "ENETUNREACH", "EHOSTDOWN", "ENETDOWN")
    if hasattr(errno, name)
)


class _UdpLink(Link):
    """Everything but who the far end is."""

    def __init__(self, name: str, sock: socket.socket) -> None:
        self.name = name
        self._socket = sock
        sock.setblocking(False)

    def fileno(self) -> int | None:
        fd = self._socket.fileno()
        return fd if fd >= 0 else None

    def read(self) -> bytes:
        data = bytearray()
        for _ in range(AT_ONCE // 1024):
            try:
                datagram, sender = self._socket.recvfrom(CHUNK)
            except BlockingIOError:
                break
            except OSError as error:
                self._judge(error)
                continue
            if self._is_peer(sender):
                data += datagram
            if len(data) >= AT_ONCE:
                break
        return bytes(data)

    def write(self, data: bytes) -> bool:
        """Send one datagram; ValueError when `data` is longer than one can be."""
        for _ in range(2):  # the first try may only report what happened to the datagram before
            try:
                self._transmit(data)
                return True
            except BlockingIOError:
                break
            except OSError as error:
                if error.errno == errno.EMSGSIZE:
                    raise ValueError(f"{len(data)} bytes do not fit in one datagram") from error
                self._judge(error)
        self.dropped += 1
        return False

    def close(self) -> None:
        self._socket.close()

    def _transmit(self, data: bytes) -> None:
        self._socket.send(data)

    def _is_peer(self, sender: Any) -> bool:
        return True

    def _judge(self, error: OSError) -> None:
        """Raise LinkError unless the error only says that nobody hears."""
        if error.errno not in _UNHEARD:
            what = "is closed" if self.fileno() is None else f"lost: {error.strerror or error}"
            raise LinkError(self.name, what) from error


class UdpOutLink(_UdpLink):
    """Sends to `host:port` and hears nobody else. That nobody listens there is no error: it may start later.

    Raises LinkError when the host is unknown or there is no route to it.
    """

    def __init__(self, host: str, port: int) -> None:
        name = f"udpout:{show(host, port)}"
        family, address = resolve(name, host, port, socket.SOCK_DGRAM)
        sock = socket.socket(family, socket.SOCK_DGRAM)
        try:
            sock.connect(address)
        except OSError as error:
            sock.close()
            raise LinkError(name, f"cannot be reached: {error.strerror}") from error
        super().__init__(name, sock)


class UdpInLink(_UdpLink):
    """Listens at `host:port`; its peer is whoever sends the first datagram, for good.

    `peer` is that address, None before; `strangers` counts the datagrams of others, which are ignored. A
    write before the first datagram is dropped and counted. Port 0 takes a free one, see `port`. Raises
    LinkError when the address cannot be listened at.
    """

    def __init__(self, host: str = "127.0.0.1", port: int = 0) -> None:
        name = f"udpin:{show(host, port)}"
        family, address = resolve(name, host, port, socket.SOCK_DGRAM)
        sock = socket.socket(family, socket.SOCK_DGRAM)
        try:
            sock.bind(address)
        except OSError as error:
            sock.close()
            raise listen_error(name, error, port, "-lunp") from error
        self.port: int = sock.getsockname()[1]
        self.peer: Any = None
        self.strangers = 0
        super().__init__(f"udpin:{show(host, self.port)}", sock)

    def _transmit(self, data: bytes) -> None:
        if self.peer is None and self.fileno() is not None:
            raise BlockingIOError
        self._socket.sendto(data, self.peer)

    def _is_peer(self, sender: Any) -> bool:
        if self.peer is None:
            self.peer = sender
        self.strangers += sender != self.peer
        return bool(sender == self.peer)
