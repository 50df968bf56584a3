"""The ports of a bench: the end of the bench, and the end that the program under test opens."""

from __future__ import annotations

import io
import os
import shutil
import tempfile
import weakref
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Final

from arva_hil.clock import Clock, RealClock
from arva_hil.errors import ArvaError
from arva_hil.links import Link, LinkError, memory, open_link

if TYPE_CHECKING:
    from serial import SerialBase

_SETTLE_S: Final = 0.02  # real time in which the system moves bytes through a pseudo-terminal
_LOOK_S: Final = 0.0002
_HOLDS: Final = 4095  # bytes; a pseudo-terminal's, for a program that does not read
_FOREVER_S: Final = 3600.0


class BenchError(ArvaError, ValueError):
    """A bench cannot do a request. `str()` has the cure."""


class BenchPort:
    """A port that can be unplugged. Remembers its link, None while it is unplugged.

    `kind`: "pty", "tcp", "udp", "memory", or the connection string of a real port. `name`: for the
    program under test to open. It stays the same after the port is plugged in again.
    """

    def __init__(self, kind: str, clock: Clock) -> None:
        self.kind = kind
        self.link: Link | None = None
        self.far: Link | None = None  # the other end, if it is in memory
        self.sent = 0  # bytes that the port accepted
        self._clock = clock
        self._folder = ""
        self._url = kind
        self._opened: list[Any] = []
        if kind == "pty":
            self._folder = tempfile.mkdtemp(prefix="arva-")
            self._remove = weakref.finalize(self, shutil.rmtree, self._folder, ignore_errors=True)
            self._url = f"pty:{os.path.join(self._folder, 'port')}"
        elif kind == "tcp":
            self._url = "tcpin:127.0.0.1:0"
        elif kind == "udp":
            self._url = f"udpout:127.0.0.1:{_free_udp_port()}"
        try:
            self.plug()
        except BaseException:
            self.close()
            raise

    @property
    def name(self) -> str:
        number = self._url.rpartition(":")[2]
        if self.kind == "tcp":
            return f"socket://127.0.0.1:{number}"
        if self.kind == "udp":
            return f"udpin:127.0.0.1:{number}"
        return self._url.removeprefix("pty:") if self.kind == "pty" else self._url

    def plug(self) -> None:
        """Plug the port in. Nothing happens if it is. Raises LinkError or AddressError."""
        if self.link is not None:
            return
        if self.kind == "memory":
            self.link, self.far = memory.pair()
        elif self.kind == "tcp":
            from arva_hil.links.tcp import TcpServerLink

            server = TcpServerLink(port=int(self._url.rpartition(":")[2]), clock=self._clock)
            self.link, self._url = server, server.name
        else:
            self.link = open_link(self._url, clock=self._clock)

    def unplug(self) -> None:
        """Pull the plug out: the program under test loses its port."""
        link, self.link = self.link, None
        if link is not None:
            link.close()

    def close(self) -> None:
        """Close the port and everything that `serial` has opened, and remove the symlink."""
        for one in self._opened:
            one.close()
        self.unplug()
        if self._folder:
            self._remove()

    def read(self) -> bytes:
        """Return the bytes that the program under test has sent."""
        try:
            return self.link.read() if self.link is not None else b""
        except LinkError:
            return b""

    def write(self, data: bytes) -> bool:
        """Send bytes. Returns False if the port is unplugged or no program reads it."""
        try:
            accepted = self.link is not None and self.link.write(data)
        except LinkError:
            return False
        self.sent += len(data) if accepted else 0
        return accepted

    def unread(self) -> int:
        """Return the number of bytes that wait in a pseudo-terminal; 0 for other ports."""
        return int(getattr(self.link, "unread", lambda: 0)())

    def settle(self, expected: int) -> None:
        """Wait in real time until `expected` bytes wait in a pseudo-terminal, which the system moves with a delay."""
        if self.kind != "pty" or self.link is None:
            return
        clock, expected = RealClock(), min(expected, _HOLDS)
        while self.unread() < expected and clock.now() < _SETTLE_S:
            clock.wait(clock.now() + _LOOK_S)

    def serial(self, timeout: float | None, wait: Callable[[float, Callable[[], bool]], None], **options: Any) -> Any:
        """Return the port, opened as by pyserial. `wait`: lets time pass, for ports in memory."""
        if self.kind == "memory":
            opened: SerialBase | MemorySerial = MemorySerial(self, wait, timeout)
        elif self.kind in ("pty", "tcp"):
            from serial import serial_for_url

            opened = serial_for_url(self.name, timeout=timeout, **options)
        else:
            raise BenchError(f"serial: the port {self.name} is not at this end: open the far end yourself")
        self._opened.append(opened)
        return opened


class MemorySerial(io.RawIOBase):
    """A port in memory with the methods of `serial.Serial` that drivers use.

    A read that waits lets the bench's own time pass. Raises serial.SerialException while the port is unplugged.
    """

    def __init__(
        self, port: BenchPort, wait: Callable[[float, Callable[[], bool]], None], timeout: float | None
    ) -> None:
        self.port = port.name
        self.timeout = timeout
        self._port = port
        self._wait = wait
        self._bytes = bytearray()

    @property
    def is_open(self) -> bool:
        return not self.closed

    @property
    def in_waiting(self) -> int:
        """The number of bytes that can be read at once."""
        if self._port.link is not None or not self._bytes:
            self._bytes += self._far().read()
        return len(self._bytes)

    def read(self, size: int = 1) -> bytes:
        """Return `size` bytes, or fewer after the timeout."""
        if self.in_waiting < size and self.timeout != 0:
            self._wait(_FOREVER_S if self.timeout is None else self.timeout, lambda: self.in_waiting >= size)
            if self.timeout is None and self.in_waiting < size:
                raise BenchError(f"serial: a read without a timeout waits for {size} bytes, and an hour has passed")
        data = bytes(self._bytes[:size])
        del self._bytes[:size]
        return data

    def readable(self) -> bool:
        return True

    def writable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int:
        data = self.read(len(buffer))
        buffer[: len(data)] = data
        return len(data)

    def write(self, data: Any) -> int:
        """Send bytes to the receiver."""
        self._far().write(bytes(data))
        return len(data)

    def reset_input_buffer(self) -> None:
        """Discard unread bytes."""
        del self._bytes[: self.in_waiting]

    def _far(self) -> Link:
        """Return the far end of the port. Raises SerialException while the port is unplugged."""
        if self._port.far is None or self._port.link is None:
            from serial import SerialException

            raise SerialException("the port is unplugged")
        return self._port.far


def _free_udp_port() -> int:
    import socket

    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
        one.bind(("127.0.0.1", 0))
        port: int = one.getsockname()[1]
        return port
