"""TCP: a client, the parts that the server uses too, and the address errors that UDP shares."""

from __future__ import annotations

import errno
import socket
from os import getpid
from typing import Any, Final, Literal

from arva_hil.links.base import CHUNK, Absent, Link, LinkError, Opening, StreamLink
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
