"""TCP: a client, and a server for one client at a time; and the address errors UDP shares."""

from __future__ import annotations

import errno
import socket
from typing import Any, Final, Literal

from arva_hil.links.base import LinkError
from arva_hil.links.ports import listeners
from arva_hil.links.stream import CHUNK, EndOfStream, StreamLink

CONNECT_S: Final = 5.0  # for an answer to the first try to connect,
BRIEF_S: Final = 0.5  # to one of many
_ANSWER_MS: Final = 5000  # of an `answered` connection: bytes acknowledged later than this never will be


class TcpLink(StreamLink):
    """A client. Opening waits `timeout` seconds at most; afterwards nothing waits.

    Raises LinkError when nobody listens or answers there, and once the far end closed; `answered`: also once it
    has not acknowledged for 5 s what it was sent, as when its cable is out or it reads no more.
    """

    hint = "is the autopilot running?"

    def __init__(self, host: str, port: int, timeout: float = CONNECT_S, *, answered: bool = False) -> None:
        name = f"tcp:{show(host, port)}"
        try:
            self._socket = _connect(host, port, timeout)
        except (socket.gaierror, UnicodeError) as error:
            raise _unknown_host(name, host, error) from error
        except ConnectionRefusedError as error:
            raise LinkError(name, "connection refused", self.hint) from error
        except TimeoutError as error:
            raise LinkError(name, f"no answer in {timeout:g} s", "is the address right?") from error
        except OSError as error:
            raise LinkError(name, f"cannot connect: {error.strerror or error}") from error
        super().__init__(name)
        _set_up(self._socket, answered)

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
    side has left; but one that never said a word may still listen, and stays until it takes no more or the next
    one comes. `answered` as for TcpLink. Port 0 takes a free one, see `port`. Raises LinkError when the address
    cannot be listened at.
    """

    def __init__(self, host: str = "127.0.0.1", port: int = 0, *, answered: bool = False) -> None:
        name = f"tcpin:{show(host, port)}"
        family, address = resolve(name, host, port, socket.SOCK_STREAM)
        try:
            self._listener = socket.create_server(address[:2], family=family, backlog=1)
        except OSError as error:
            raise listen_error(name, error, port, "tcp") from error
        self._listener.setblocking(False)
        self._answered = answered
        self._client: socket.socket | None = None
        self._spoke = False  # the client said something
        self._mute = False  # the client closed its sending side, and never spoke
        self.port: int = self._listener.getsockname()[1]
        super().__init__(f"tcpin:{show(host, self.port)}")

    def fileno(self) -> int | None:
        if not self._open:
            return None
        return self._client.fileno() if self._client and not self._mute else self._listener.fileno()

    def read(self) -> bytes:
        self._check_open()
        if not self._accept() or self._mute:
            return b""
        try:
            data = super().read()
        except LinkError as error:
            if isinstance(error.__cause__, EndOfStream) and not self._spoke:
                self._mute = True
            else:
                self._leave(error)
            return b""
        self._spoke = self._spoke or bool(data)
        return data

    def write(self, data: bytes) -> bool:
        self._check_open()
        try:
            if self._accept():
                return super().write(data)
        except LinkError as error:
            self._leave(error)
        self.dropped += 1
        return False

    def _accept(self) -> bool:
        """True when there is a client."""
        if self._client is None or self._mute:
            try:
                client, _ = self._listener.accept()
            except OSError:  # nobody yet
                return self._client is not None
            try:
                _set_up(client, self._answered)
            except OSError:  # already gone again
                client.close()
                return self._client is not None
            if self._mute:
                self._leave(LinkError(self.name, "lost: closed by the far end"))
            self._client = client
            if self.away:
                self._renewed()
        return True

    def _leave(self, why: LinkError) -> None:
        """Forget the client, and with it the rest of a write that only it can make sense of."""
        self._forget()
        self._gone(LinkError(self.name, f"{why.what}, waiting for the next client"))

    def _forget(self) -> None:
        if self._client is not None:
            self._client.close()
        self._client = None
        self._spoke = self._mute = False
        self._rest = b""

    def _receive(self) -> bytes:
        assert self._client is not None
        return self._client.recv(CHUNK)

    def _send(self, data: bytes) -> int:
        assert self._client is not None
        return self._client.send(data)

    def _shut(self) -> None:
        self._forget()
        self._listener.close()


def _connect(host: str, port: int, timeout: float) -> socket.socket:
    sock = socket.create_connection((host, port), timeout)
    if sock.getsockname() == sock.getpeername():  # nobody listens there, and it got that very port for its own end
        sock.close()
        raise ConnectionRefusedError
    return sock


def _set_up(sock: socket.socket, answered: bool) -> None:
    sock.setblocking(False)
    sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    if answered and hasattr(socket, "TCP_USER_TIMEOUT"):
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, _ANSWER_MS)


def show(host: str, port: int) -> str:
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"


def resolve(name: str, host: str, port: int, kind: int) -> tuple[int, Any]:
    """The address family and socket address of a host. Raises LinkError when nobody knows it."""
    try:
        found = socket.getaddrinfo(host, port, type=kind)[0]
    except (socket.gaierror, UnicodeError) as error:
        raise _unknown_host(name, host, error) from error
    return found[0], found[4]


def listen_error(name: str, error: OSError, port: int, protocol: Literal["tcp", "udp"]) -> LinkError:
    """Why an address cannot be listened at, and the cure."""
    if error.errno == errno.EADDRINUSE:
        what = "another program listens there"
        if who := listeners(port, protocol):
            return LinkError(name, f"{what}, held by {', '.join(who)}", "close the other program")
        return LinkError(name, what, f"to see which: ss -l{protocol[0]}np 'sport = :{port}'")
    if error.errno == errno.EADDRNOTAVAIL:
        return LinkError(name, "is no address of this machine", "0.0.0.0 is all of them")
    if error.errno == errno.EACCES:
        return LinkError(name, "permission denied", "take a port above 1023")
    return LinkError(name, f"cannot listen: {error.strerror or error}")


def _unknown_host(name: str, host: str, error: Exception) -> LinkError:
    return LinkError(name, f"unknown host {host!r}", getattr(error, "strerror", None) or "")
