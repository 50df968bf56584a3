"""A TCP server for several clients."""

from __future__ import annotations

import selectors
import socket
from collections.abc import Collection
from typing import Final

from arva_hil.clock import Clock, RealClock
from arva_hil.links.base import EndOfStream, Link, LinkError, Opening, Sender, SeveralSenders
from arva_hil.links.tcp import SocketLink, listen_error, resolve, set_up
from arva_hil.links.url import Address, show

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
        fileno = getattr(self._selector, "fileno", None)
        return fileno() if fileno and self._open else None

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
            except OSError:  # already gone again
                sock.close()
                continue
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
