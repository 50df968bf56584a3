"""TCP: a client, a server for several clients, and the address errors that UDP shares."""

from __future__ import annotations

import errno
import selectors
import socket
from collections.abc import Collection
from os import getpid
from typing import Any, Final, Literal

from arva_hil.clock import Clock, RealClock
from arva_hil.links.base import (
    CHUNK,
    Absent,
    EndOfStream,
    Link,
    LinkError,
    Opening,
    Sender,
    SeveralSenders,
    StreamLink,
)
from arva_hil.links.processes import listeners
from arva_hil.links.url import Address, show

CONNECT_S: Final = 5.0  # time-out of the first try to connect
BRIEF_S: Final = 0.5  # time-out of each later try
_LATE_PORTS: Final = (5762, 5763)
_SITL: Final = "ArduPilot's simulator listens there only once a client is connected to 5760"
_ANSWER_MS: Final = 5000  # an `answered` connection is lost if bytes are not acknowledged in this time
_TAKE_MS: Final = 10_000  # the same for other connections
# Seconds of silence before the first probe, seconds between probes, number of probes.
_KEEP_ALIVE: Final = {"TCP_KEEPIDLE": 5, "TCP_KEEPINTVL": 1, "TCP_KEEPCNT": 5}


class SocketLink(StreamLink):
    """A connected TCP socket."""

    def __init__(self, name: str, sock: socket.socket) -> None:
        super().__init__(name)
        self.sock = sock
        self._fd = sock.fileno()

    def _receive(self) -> bytes:
        return self.sock.recv(CHUNK)

    def _send(self, data: bytes) -> int:
        return self.sock.send(data)

    def _shut(self) -> None:
        self.sock.close()


class TcpLink(SocketLink):
    """A client. Opening waits for `timeout` seconds at most; later calls do not wait.

    Raises LinkError if no program listens or answers there, if the far end closes, or if it acknowledges nothing for
    10 s (5 s if `answered`), e.g. because its cable is out or it does not read any more.
    """

    reopened = True

    @classmethod
    def open(cls, address: Address, how: Opening) -> Link:
        return cls(address.host, address.port, BRIEF_S if how.brief else CONNECT_S, answered=how.answered)

    def __init__(self, host: str, port: int, timeout: float = CONNECT_S, *, answered: bool = False) -> None:
        name = f"tcp:{show(host, port)}"
        self.hint = f"is {'the autopilot' if answered else 'the program that listens there'} running?"
        try:
            sock = socket.create_connection((host, port), timeout)
            if sock.getsockname() == sock.getpeername():  # without a listener the socket is connected to itself
                sock.close()
                raise ConnectionRefusedError
        except (socket.gaierror, UnicodeError) as error:
            raise _unknown_host(name, host, error) from error
        except ConnectionRefusedError as error:
            hint = f"{self.hint} {_SITL}" if port in _LATE_PORTS else self.hint
            raise Absent(name, "connection refused", hint) from error
        except TimeoutError as error:
            raise Absent(name, f"no answer in {timeout:g} s", "is the address right?") from error
        except OSError as error:
            raise Absent(name, f"cannot connect: {error.strerror or error}") from error
        super().__init__(name, sock)
        set_up(sock, answered=answered)


def set_up(sock: socket.socket, *, answered: bool) -> None:
    """Set the socket's options: never block, send small writes at once, and detect soon that the far end is gone."""
    sock.setblocking(False)
    sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    for name, value in {**_KEEP_ALIVE, "TCP_USER_TIMEOUT": _ANSWER_MS if answered else _TAKE_MS}.items():
        if hasattr(socket, name):
            sock.setsockopt(socket.IPPROTO_TCP, getattr(socket, name), value)


def resolve(name: str, host: str, port: int, kind: int) -> tuple[int, Any]:
    """Return the address family and socket address of a host. Raises LinkError if it is unknown."""
    try:
        found = socket.getaddrinfo(host, port, type=kind)[0]
    except (socket.gaierror, UnicodeError) as error:
        raise _unknown_host(name, host, error) from error
    return found[0], found[4]


def listen_error(name: str, error: OSError, port: int, protocol: Literal["tcp", "udp"]) -> LinkError:
    """Return the error of an address at which listening failed, with the cure."""
    if error.errno == errno.EADDRINUSE:
        what, hint = "another program listens there", "take another port"
        if protocol == "udp":
            hint = "let it forward, as QGroundControl can (Application Settings, MAVLink), to udpin:127.0.0.1:14445"
        if who := listeners(port, protocol):
            if any(one.startswith(f"{getpid()} (") for one in who):
                return LinkError(name, "this program listens at that port already", "give each link its own")
            return LinkError(name, f"{what}, held by {', '.join(who)}", hint)
        return LinkError(name, what, f"{hint}; to see who: ss -l{protocol[0]}np 'sport = :{port}'")
    known = {
        errno.EADDRNOTAVAIL: ("is not an address of this machine", "0.0.0.0 means all of them"),
        errno.EACCES: ("permission denied", "take a port above 1023"),
    }
    return LinkError(name, *known.get(error.errno or 0, (f"cannot listen: {error.strerror or error}", "")))


def _unknown_host(name: str, host: str, error: Exception) -> LinkError:
    return LinkError(name, f"unknown host {host!r}", getattr(error, "strerror", None) or "")


MOST_CLIENTS: Final = 8  # further clients wait until there is room
FULL_S: Final = 10.0  # a client that accepts no waiting bytes for this long is dropped


class TcpServerLink(SeveralSenders):
    """Listens at `host:port` for clients, 8 at most. Each client is a sender, see `receive`.

    Until `follow` sets the peer, all clients are read, and each gets every write that it has room for. A client that
    accepts nothing for 10 s by `clock` is dropped. The link is lost when the last client or the peer leaves, and
    returns with the next. A client that closes its sending side has left; but if it never sent anything it may still
    listen, and stays until it accepts nothing more or its place is needed. A write that no client accepts is dropped
    and counted. `answered` as for TcpLink. Port 0 means a free port, see `port`. Raises LinkError if it cannot listen
    at the address; after `pin` also if the peer has left.
    """

    @classmethod
    def open(cls, address: Address, how: Opening) -> Link:
        return cls(address.host, address.port, how.clock, answered=how.answered)

    def __init__(
        self, host: str = "127.0.0.1", port: int = 0, clock: Clock | None = None, *, answered: bool = False
    ) -> None:
        name = f"tcpin:{show(host, port)}"
        family, address = resolve(name, host, port, socket.SOCK_STREAM)
        try:
            self._listener = socket.create_server(address[:2], family=family, backlog=MOST_CLIENTS)
        except OSError as error:
            raise listen_error(name, error, port, "tcp") from error
        self._listener.setblocking(False)
        self.port: int = self._listener.getsockname()[1]
        self.name = f"tcpin:{show(host, self.port)}"
        self._clock = clock or RealClock()
        self._answered = answered
        self._clients: dict[Sender, _Client] = {}  # in the order of their last bytes, or of their connection
        self._selector = selectors.DefaultSelector()
        self._selector.register(self._listener, selectors.EVENT_READ)

    def fileno(self) -> int | None:
        return self._selector.fileno() if self._open else None

    def ready(self) -> bool:
        return self._open and bool(self._selector.select(0))

    def receive(self) -> list[tuple[Sender, bytes]]:
        self._check_open()
        self._accept()
        came = [(sender, data) for sender in list(self._clients) if (data := self._hear(sender))]
        return sorted(came, key=lambda each: each[0] != self.peer) if len(came) > 1 else came

    def write(self, data: bytes) -> bool:
        self._check_open()
        self._accept()
        taken = False
        for sender, client in list(self._clients.items()):
            if self._others is None or sender == self.peer or (self.peer is None and sender in self._others):
                try:
                    taken = client.write(data) or taken
                except LinkError as error:
                    self._leave(sender, error)
                else:
                    if client.full_for(self._clock.now()) > FULL_S:
                        self._leave(sender, LinkError(self.name, f"lost: it has accepted nothing for {FULL_S:g} s"))
        self.dropped += not taken
        return taken

    def follow(self, peer: Sender, others: Collection[Sender] = ()) -> None:
        super().follow(peer if peer in self._clients else self.peer, others)

    def close(self) -> None:
        if self._open:
            self._open = False
            for client in self._clients.values():
                client.close()
            self._selector.close()
            self._listener.close()

    def _hear(self, sender: Sender) -> bytes:
        client = self._clients[sender]
        if client.mute:
            return b""
        try:
            data = client.read()
        except LinkError as error:
            if isinstance(error.__cause__, EndOfStream) and not client.spoke:
                client.mute = True
                self._selector.unregister(client.sock)  # it sends nothing more, and would always be ready
            else:
                self._leave(sender, error)
            return b""
        if not data:
            return b""
        client.spoke = True
        self._clients[sender] = self._clients.pop(sender)
        return data if sender == self.peer or self._hears(sender) else b""

    def _accept(self) -> None:
        while room := len(self._clients) < MOST_CLIENTS or self._dispensable() is not None:
            try:
                sock, sender = self._listener.accept()
            except OSError:  # no client, or already gone again
                break
            try:
                set_up(sock, answered=self._answered)
                if sender in self._clients:  # it has reset its connection, and connected from the same port again
                    self._leave(sender, LinkError(self.name, "lost: it has connected again"))
            except OSError:  # already gone again
                sock.close()
                continue
            except LinkError:  # it was the pinned peer
                sock.close()
                raise
            if len(self._clients) == MOST_CLIENTS:
                self._leave(self._dispensable(), LinkError(self.name, "lost: its place was needed"))
            self._clients[sender] = _Client(self.name, sock, self._clock.now())
            self._selector.register(sock, selectors.EVENT_READ)
            if self._others is None and self.away:
                self._renewed()
        self._listen(room)

    def _listen(self, wanted: bool) -> None:
        """Wait for new clients only if they are `wanted`."""
        listened = self._listener in self._selector.get_map()
        if wanted and not listened:
            self._selector.register(self._listener, selectors.EVENT_READ)
        elif listened and not wanted:
            self._selector.unregister(self._listener)

    def _dispensable(self) -> Sender:
        """Return the client to drop for a new one: one that closed its sending side, else the most silent stranger."""
        if mute := [sender for sender, client in self._clients.items() if client.mute]:
            return mute[0]
        if self._others is None:
            return None
        return next((s for s in self._clients if s != self.peer and s not in self._others), None)

    def _leave(self, sender: Sender, why: LinkError) -> None:
        """Close a client, and forget the unsent rest of its last write."""
        client = self._clients.pop(sender)
        if not client.mute:
            self._selector.unregister(client.sock)
        client.close()
        was_peer = sender == self.peer
        if was_peer:
            self.peer = None
            if self._pinned:
                raise LinkError(self.name, why.what)
        if was_peer if self._others is not None else not self._clients:
            self._gone(LinkError(self.name, f"{why.what}, waiting for the next client"))


class _Client(SocketLink):
    """One client. Remembers whether it sent anything, and when it last accepted bytes."""

    def __init__(self, name: str, sock: socket.socket, now: float) -> None:
        super().__init__(name, sock)
        self.spoke = False
        self.mute = False  # it has closed its sending side, and never spoke
        self._took = True  # whether it accepted bytes since the last call of `full_for`
        self._took_at = now

    def full_for(self, now: float) -> float:
        """Return the time since it last accepted bytes [s]. To be called after each write."""
        if self._took:
            self._took, self._took_at = False, now
        return now - self._took_at

    def _send(self, data: bytes) -> int:
        sent = super()._send(data)
        self._took = self._took or sent > 0
        return sent
