"""UDP: one write is one datagram; datagrams of one sender are joined when they are read."""

from __future__ import annotations

import errno
import socket
from collections.abc import Iterator
from typing import Any, Final

from arva_hil.links.base import AT_ONCE, CHUNK, Link, LinkError, Opening, Sender, SeveralSenders
from arva_hil.links.tcp import listen_error, resolve
from arva_hil.links.url import Address, show

_WAITING_BYTES: Final = 1 << 20  # buffer of the system while the program is busy; a fleet sends much
_MOST_SENDERS: Final = 8  # that get each write while there is no peer


class _UdpLink(Link):
    scheme: str

    @classmethod
    def open(cls, address: Address, how: Opening) -> Link:
        return cls(address.host, address.port)

    def __init__(self, host: str, port: int) -> None:
        self.name = f"{self.scheme}:{show(host, port)}"
        family, address = resolve(self.name, host, port, socket.SOCK_DGRAM)
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _WAITING_BYTES)
        self._fd = self._socket.fileno()
        listens = self.scheme == "udpin"
        try:
            (self._socket.bind if listens else self._socket.connect)(address)
        except OSError as error:
            self._socket.close()
            if listens:
                raise listen_error(self.name, error, port, "udp") from error
            raise LinkError(self.name, f"cannot be reached: {error.strerror}") from error

    def read(self) -> bytes:
        return b"".join([datagram for datagram, _ in self._datagrams()])

    def _datagrams(self) -> Iterator[tuple[bytes, Any]]:
        """Yield the datagrams that came, with their senders; at most what one read should return."""
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
        self._open = False
        self._socket.close()

    def _transmit(self, data: bytes) -> None:
        self._socket.send(data)

    def _judge(self, error: OSError) -> None:
        """Raise LinkError if the link is closed. All other errors mean that no program listens now."""
        self.refusals += error.errno == errno.ECONNREFUSED
        self._check_open()


class UdpOutLink(_UdpLink):
    """Sends to `host:port`, and receives only from there. It is no error if no program listens there yet.

    Raises LinkError if the host is unknown or there is no route to it.
    """

    scheme = "udpout"


class UdpInLink(SeveralSenders, _UdpLink):
    """Listens at `host:port`. Each address that sends there is a sender, see `receive`.

    Until `follow` sets the peer, all senders are read, and writes go to the 8 newest senders. After that writes go
    to the `peer` only; the other senders can still be received, and their datagrams are counted. After `pin` only the
    peer is read. A write is dropped and counted if there is no sender yet. Port 0 means a free port, see `port`.
    Raises LinkError if it cannot listen at the address.
    """

    scheme = "udpin"

    def __init__(self, host: str = "127.0.0.1", port: int = 0) -> None:
        super().__init__(host, port)
        self.port: int = self._socket.getsockname()[1]
        self.name = f"udpin:{show(host, self.port)}"
        self._senders: dict[Any, None] = {}  # the newest sender is the last

    def receive(self) -> list[tuple[Sender, bytes]]:
        by_sender: dict[Any, list[bytes]] = {}
        for datagram, sender in self._datagrams():
            if sender != self.peer and not self._hears(sender):
                continue
            by_sender.setdefault(sender, []).append(datagram)
        if len(by_sender) > 1 and self.peer in by_sender:
            by_sender = {self.peer: by_sender.pop(self.peer), **by_sender}
        return [(sender, b"".join(datagrams)) for sender, datagrams in by_sender.items()]

    def _hears(self, sender: Any) -> bool:
        if self.peer is None and self._others is None:
            self._senders.pop(sender, None)
            self._senders[sender] = None
            if len(self._senders) > _MOST_SENDERS:
                del self._senders[next(iter(self._senders))]
        return super()._hears(sender)

    def _transmit(self, data: bytes) -> None:
        if self.peer is not None:
            self._socket.sendto(data, self.peer)
            return
        there = self._senders if self._others is None else self._others
        if not there:
            self._check_open()
            raise BlockingIOError
        failed: list[OSError] = []
        for receiver in there:
            try:
                self._socket.sendto(data, receiver)
            except OSError as error:
                failed.append(error)
        if failed and len(failed) == len(there):
            raise failed[0]
