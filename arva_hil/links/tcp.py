"""TCP: a client, and a server for one client at a time; and the address errors UDP shares."""

from __future__ import annotations

import errno
import socket
from typing import Any

from arva_hil.links.base import LinkError
from arva_hil.links.stream import CHUNK, StreamLink


class TcpLink(StreamLink):
    """A client. Opening waits `timeout` seconds at most; afterwards nothing waits.

    Raises LinkError when nobody listens or answers there, and once the far end closed.
    """

    hint = "is the autopilot running?"

    def __init__(self, host: str, port: int, timeout: float = 5.0) -> None:
        name = f"tcp:{show(host, port)}"
        try:
            self._socket = socket.create_connection((host, port), timeout)
        except (socket.gaierror, UnicodeError) as error:
            raise _unknown_host(name, host, error) from error
        except ConnectionRefusedError as error:
            raise LinkError(name, "connection refused", self.hint) from error
        except TimeoutError as error:
            raise LinkError(name, f"no answer in {timeout:g} s", "is the address right?") from error
        except OSError as error:
            raise LinkError(name, f"cannot connect: {error.strerror or error}") from error
        super().__init__(name)
        _set_up(self._socket)

    def fileno(self) -> int | None:
        return self._socket.fileno() if self._open else None

    def _receive(self) -> bytes:
        return self._socket.recv(CHUNK)

    def _send(self, data: bytes) -> int:
        return self._socket.send(data)

    def _shut(self) -> None:
        self._socket.close()


class TcpServerLink(StreamLink):
    """Listens at `host:port` for one client at a time; a second one waits until the first has left.

    Without a client nothing is read, and writes are dropped and counted. A client that closes its sending
    side has left. Port 0 takes a free one, see `port`. Raises LinkError when the address cannot be listened
    at.
    """

    def __init__(self, host: str = "127.0.0.1", port: int = 0) -> None:
        name = f"tcpin:{show(host, port)}"
        family, address = resolve(name, host, port, socket.SOCK_STREAM)
        try:
            self._listener = socket.create_server(address[:2], family=family, backlog=1)
        except OSError as error:
            raise listen_error(name, error, port, "-ltnp") from error
        self._listener.setblocking(False)
        self._client: socket.socket | None = None
        self.port: int = self._listener.getsockname()[1]
        super().__init__(f"tcpin:{show(host, self.port)}")

    def fileno(self) -> int | None:
        return (self._client or self._listener).fileno() if self._open else None

    def read(self) -> bytes:
        self._check_open()
        if not self._accept():
            return b""
        try:
            return super().read()
        except LinkError:
            self._leave()
            return b""

    def write(self, data: bytes) -> bool:
        self._check_open()
        try:
            if self._accept():
                return super().write(data)
        except LinkError:
            self._leave()
        self.dropped += 1
        return False

    def _accept(self) -> bool:
        """True when there is a client."""
        if self._client is None:
            try:
                self._client, _ = self._listener.accept()
                _set_up(self._client)
            except OSError:  # nobody yet, or already gone again
                self._leave()
        return self._client is not None

    def _leave(self) -> None:
        """Forget the client, and with it the rest of a write that only it can make sense of."""
        if self._client is not None:
            self._client.close()
        self._client = None
        self._rest = b""

    def _receive(self) -> bytes:
        assert self._client is not None
        return self._client.recv(CHUNK)

    def _send(self, data: bytes) -> int:
        assert self._client is not None
        return self._client.send(data)

    def _shut(self) -> None:
        self._leave()
        self._listener.close()


def _set_up(sock: socket.socket) -> None:
    sock.setblocking(False)
    sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)


def show(host: str, port: int) -> str:
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"


def resolve(name: str, host: str, port: int, kind: int) -> tuple[int, Any]:
    """The address family and socket address of a host. Raises LinkError when nobody knows it."""
    try:
        found = socket.getaddrinfo(host, port, type=kind)[0]
    except (socket.gaierror, UnicodeError) as error:
        raise _unknown_host(name, host, error) from error
    return found[0], found[4]


def listen_error(name: str, error: OSError, port: int, ss: str) -> LinkError:
    """Why an address cannot be listened at, and the cure."""
    if error.errno == errno.EADDRINUSE:
        return LinkError(name, "another program listens there", f"to see which: ss {ss} 'sport = :{port}'")
    if error.errno == errno.EADDRNOTAVAIL:
        return LinkError(name, "is no address of this machine", "0.0.0.0 is all of them")
    if error.errno == errno.EACCES:
        return LinkError(name, "permission denied", "take a port above 1023")
    return LinkError(name, f"cannot listen: {error.strerror or error}")


def _unknown_host(name: str, host: str, error: Exception) -> LinkError:
    return LinkError(name, f"unknown host {host!r}", getattr(error, "strerror", None) or "")
