"""UDP: one write is one datagram; what several datagrams bring is read joined."""

from __future__ import annotations

import errno
import socket
from typing import Any, Final

from arva_hil.clock import Clock, RealClock
from arva_hil.links.base import Link, LinkError
from arva_hil.links.stream import AT_ONCE, CHUNK
from arva_hil.links.tcp import listen_error, resolve, show

_SILENT_S: Final = 3.0  # a peer that says nothing for this long gives way to whoever speaks: three heartbeats


class _UdpLink(Link):
    """Everything but who the far end is."""

    def __init__(self, name: str, sock: socket.socket) -> None:
        self.name = name
        self._socket = sock
        self._drained = False  # all that had come was read
        sock.setblocking(False)

    def fileno(self) -> int | None:
        fd = self._socket.fileno()
        return fd if fd >= 0 else None

    def read(self) -> bytes:
        data = bytearray()
        self._drained = False
        for _ in range(AT_ONCE // 1024):
            try:
                datagram, sender = self._socket.recvfrom(CHUNK)
            except BlockingIOError:
                self._drained = True
                break
            except OSError as error:
                self._judge(error)
                continue
            if self._accepts(sender, datagram):
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

    def _accepts(self, sender: Any, datagram: bytes) -> bool:
        return True

    def _judge(self, error: OSError) -> None:
        """Raise LinkError when the link is closed. All else says that nobody hears now; somebody may later."""
        self.refusals += error.errno == errno.ECONNREFUSED
        if self.fileno() is None:
            raise LinkError(self.name, "is closed") from error


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
    """Listens at `host:port`; its peer is whoever sends the first datagram.

    `peer` is that address, None before; the datagrams of strangers change nothing while the peer speaks. When it has
    been silent for 3 s by `clock`, the next to send becomes the peer. A write before the first datagram is dropped and
    counted. Port 0 takes a free one, see `port`. Raises LinkError when the address cannot be listened at.
    """

    def __init__(self, host: str = "127.0.0.1", port: int = 0, clock: Clock | None = None) -> None:
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
        self._clock = clock or RealClock()
        self._heard = False  # the peer, in this read
        self._heard_at = 0.0
        self._other: Any = None  # the first stranger in this read,
        self._others = bytearray()  # and what it sent
        super().__init__(f"udpin:{show(host, self.port)}", sock)

    def read(self) -> bytes:
        self._heard, self._other = False, None
        self._others.clear()
        data = super().read()
        now = self._clock.now()
        if self._heard:
            self._heard_at = now
        elif self._other is not None and self._drained and now - self._heard_at > _SILENT_S:
            self._gone(LinkError(self.name, f"lost: {show(*self.peer[:2])} is silent"))
            self.peer, data = self._other, bytes(self._others)
            self._heard_at = now
            self._renewed()
        return data

    def _transmit(self, data: bytes) -> None:
        if self.peer is None and self.fileno() is not None:
            raise BlockingIOError
        self._socket.sendto(data, self.peer)

    def _accepts(self, sender: Any, datagram: bytes) -> bool:
        if self.peer is None:
            self.peer = sender
        if sender == self.peer:
            self._heard = True
            return True
        self.strangers += 1
        self.stranger = self.stranger or show(*sender[:2])
        if self._other is None:
            self._other = sender
        if sender == self._other:
            self._others += datagram
        return False
