"""UDP: one write is one datagram; datagrams of one sender are joined when they are read."""

from __future__ import annotations

import errno
import socket
from collections.abc import Collection, Iterator
from typing import Any, Final

from arva_hil.links.base import AT_ONCE, CHUNK, Link, LinkError, Opening, Sender
from arva_hil.links.tcp import listen_error, resolve, show
from arva_hil.links.url import Address

_MOST_SENDERS: Final = 8  # that get each write while there is no peer


class _UdpLink(Link):
    def __init__(self, name: str, sock: socket.socket) -> None:
        self.name = name
        self._socket = sock
        sock.setblocking(False)

    def fileno(self) -> int | None:
        fd = self._socket.fileno()
        return fd if fd >= 0 else None

    def read(self) -> bytes:
        return b"".join([datagram for datagram, _ in self._datagrams()])

    def _datagrams(self) -> Iterator[tuple[bytes, Any]]:
        """The datagrams that came, with their senders; at most what one read should return."""
        size = 0
        for _ in range(AT_ONCE // 1024):
            try:
                datagram, sender = self._socket.recvfrom(CHUNK)
            except BlockingIOError:
                return
            except OSError as error:
                self._judge(error)
                continue
            yield datagram, sender
            size += len(datagram)
            if size >= AT_ONCE:
                return

    def write(self, data: bytes) -> bool:
        """Send one datagram. Raises ValueError if `data` is too long for one."""
        for _ in range(2):  # the first try may only report an error of the datagram before
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

    def _judge(self, error: OSError) -> None:
        """Raise LinkError if the link is closed. All other errors mean that nobody listens now."""
        self.refusals += error.errno == errno.ECONNREFUSED
        if self.fileno() is None:
            raise LinkError(self.name, "is closed") from error


class UdpOutLink(_UdpLink):
    """Sends to `host:port`, and receives only from there. It is no error if nobody listens there yet.

    Raises LinkError if the host is unknown or there is no route to it.
    """

    @classmethod
    def open(cls, address: Address, how: Opening) -> Link:
        """See `Link`."""
        return cls(address.host, address.port)

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
    """Listens at `host:port`. Each address that sends there is a sender, see `receive`.

    Until `follow` sets the peer, all senders are read, and writes go to the 8 senders heard last. After that writes go
    to the `peer` only; the other senders can still be received, and their datagrams are counted. After `pin` only the
    peer is read. A write is dropped and counted if there is no sender yet. Port 0 means a free port, see `port`.
    Raises LinkError if it cannot listen at the address.
    """

    @classmethod
    def open(cls, address: Address, how: Opening) -> Link:
        """See `Link`."""
        return cls(address.host, address.port)

    def __init__(self, host: str = "127.0.0.1", port: int = 0) -> None:
        name = f"udpin:{show(host, port)}"
        family, address = resolve(name, host, port, socket.SOCK_DGRAM)
        sock = socket.socket(family, socket.SOCK_DGRAM)
        try:
            sock.bind(address)
        except OSError as error:
            sock.close()
            raise listen_error(name, error, port, "udp") from error
        self.port: int = sock.getsockname()[1]
        self.peer: Any = None
        self._senders: dict[Any, None] = {}  # in the order in which they were heard
        self._others: Collection[Any] | None = None  # receivers of writes while there is no peer; None: every sender
        self._pinned = False
        super().__init__(f"udpin:{show(host, self.port)}", sock)

    def read(self) -> bytes:
        return b"".join([data for _, data in self.receive()])

    def receive(self) -> list[tuple[Sender, bytes]]:
        by_sender: dict[Any, list[bytes]] = {}
        for datagram, sender in self._datagrams():
            if sender != self.peer and not self._hears(sender):
                continue
            by_sender.setdefault(sender, []).append(datagram)
        if len(by_sender) > 1 and self.peer in by_sender:
            by_sender = {self.peer: by_sender.pop(self.peer), **by_sender}
        return [(sender, b"".join(datagrams)) for sender, datagrams in by_sender.items()]

    def follow(self, peer: Sender, others: Collection[Sender] = ()) -> None:
        if self._pinned:
            return
        self._others = others
        if peer == self.peer:
            return
        if self.peer is not None:
            self._gone(LinkError(self.name, f"lost: {show(*self.peer[:2])} is silent"))
            self._renewed()
        self.peer = peer

    def pin(self) -> None:
        self._pinned = True

    def _hears(self, sender: Any) -> bool:
        """Whether a sender that is not the peer is read. Counts or remembers it."""
        if self.peer is not None:
            self.strangers += 1
            self.stranger = self.stranger or show(*sender[:2])
        elif self._others is None:
            self._senders.pop(sender, None)
            self._senders[sender] = None
            if len(self._senders) > _MOST_SENDERS:
                del self._senders[next(iter(self._senders))]
        return not self._pinned

    def _transmit(self, data: bytes) -> None:
        if self.peer is not None:
            self._socket.sendto(data, self.peer)
            return
        there = self._senders if self._others is None else self._others
        if not there and self.fileno() is not None:
            raise BlockingIOError
        failed: list[OSError] = []
        for receiver in there:
            try:
                self._socket.sendto(data, receiver)
            except OSError as error:
                failed.append(error)
        if failed and len(failed) == len(there):
            raise failed[0]
