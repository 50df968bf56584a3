"""The page's HTTP server: GET and HEAD of a few names, only for requests to this host's own names.

It serves the files of `page/`, read once. A client cannot choose another file or change anything.
One thread serves all connections and pauses after each step, so that an attack cannot delay the loop.
"""

from __future__ import annotations

import ipaddress
import os
import re
import selectors
import socket
import threading
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from http import HTTPStatus
from pathlib import Path
from typing import Final, NamedTuple
from urllib.parse import parse_qs, urlsplit

from arva_hil.clock import Clock, RealClock
from arva_hil.errors import ArvaError
from arva_hil.observers.web.address import HostPort

MOST_HEAD: Final = 1 << 14  # bytes of a request; it has no body

_LONGEST_QUERY: Final = 200
_REQUEST: Final = re.compile(r"(?P<method>[!-~]{1,32}) (?P<target>[!-~]+) HTTP/1\.(?P<minor>[01])", re.ASCII)
_FIELD: Final = re.compile(r"([\w!#$%&'*+.^`|~-]+):[ \t]*(.*)", re.ASCII)


class Refused(ArvaError):
    """A request that is not answered. `status`: of HTTP; `str()`: the reason."""

    def __init__(self, status: HTTPStatus, why: str = "") -> None:
        super().__init__(why or status.phrase)
        self.status = status


class Request(NamedTuple):
    """A request for the content of a `path`. `headers`: by their names in lower case."""

    method: str
    path: str
    query: Mapping[str, str]
    headers: Mapping[str, Sequence[str]]
    is_last: bool  # the connection ends after the answer

    def refuse_others(self, host: str, here: str) -> None:
        """Raise Refused for a request of another page, or for a host name that is not ours.

        `host`: that the server was bound to. `here`: the address that was connected to.
        """
        hosts = self.headers.get("host", ())
        if len(hosts) != 1 or not _is_ours(hosts[0].lower(), host.lower(), here):
            raise Refused(
                HTTPStatus.FORBIDDEN, "this host name is not served here: use the address that the program has printed"
            )
        if any(origin.lower() != f"http://{hosts[0].lower()}" for origin in self.headers.get("origin", ())):
            raise Refused(HTTPStatus.FORBIDDEN, "only the page of this address may ask")


def parse_request(data: bytearray, end: int) -> Request:
    """Parse the request in the first `end` bytes; -1: it is longer than `MOST_HEAD`. Raises Refused."""
    if end < 0:
        raise Refused(HTTPStatus.REQUEST_HEADER_FIELDS_TOO_LARGE)
    first, *lines = data[:end].decode("latin-1").split("\r\n")
    fields = [_FIELD.fullmatch(line) for line in lines]
    match = _REQUEST.fullmatch(first)
    if match is None or not all(fields):
        raise Refused(HTTPStatus.BAD_REQUEST)
    if match["method"] not in ("GET", "HEAD"):
        raise Refused(HTTPStatus.METHOD_NOT_ALLOWED, "only GET and HEAD")
    headers: dict[str, list[str]] = {}
    for one in filter(None, fields):
        headers.setdefault(one[1].lower(), []).append(one[2].strip())
    try:
        parts = urlsplit(match["target"])
        every = parse_qs(parts.query[:_LONGEST_QUERY], max_num_fields=4) if parts.query else {}
    except ValueError:
        raise Refused(HTTPStatus.BAD_REQUEST) from None
    query = {name: values[0] for name, values in every.items()}
    return Request(match["method"], parts.path, query, headers, match["minor"] == "0" or _ends(headers))


def _ends(headers: Mapping[str, Sequence[str]]) -> bool:
    """Return True if no request can follow: the client closes, or sends a body, which would be parsed as a request."""
    wishes = headers.get("connection", [])
    has_body = headers.get("content-length", ["0"]) != ["0"] or "transfer-encoding" in headers
    return has_body or any("close" in wish.lower() for wish in wishes)


def _is_ours(name: str, host: str, here: str) -> bool:
    """Return True if a Host header names this server: localhost, the bound address, or the address connected to."""
    port = "80"
    if not name.endswith("]") and ":" in name:
        name, _, port = name.rpartition(":")
    name = name.removeprefix("[").removesuffix("]")
    if not port.isdecimal():
        return False
    if name in ("localhost", host):
        return True
    try:
        return ipaddress.ip_address(name) == ipaddress.ip_address(here)
    except ValueError:
        return False


TRIED: Final = 20  # ports to try, from the requested one on

_TYPES: Final = {
    ".html": "text/html; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".svg": "image/svg+xml",
    ".txt": "text/plain; charset=utf-8",
    ".png": "image/png",
}
_JSON: Final = "application/json; charset=utf-8"
_HEADERS: Final = (
    "Cache-Control: no-store\r\n"
    "Content-Security-Policy: default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; "
    "img-src 'self' data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'\r\n"
    "X-Content-Type-Options: nosniff\r\n"
    "Referrer-Policy: no-referrer\r\n"
    "Cross-Origin-Resource-Policy: same-origin\r\n"
    "Cross-Origin-Opener-Policy: same-origin\r\n"
)
_TIMEOUT_S: Final = 5.0  # for a whole request to arrive, and for a whole answer to be accepted
_MOST_CLIENTS: Final = 64  # connections
_MOST_ANSWERS: Final = 1 << 26  # bytes of waiting answers
_RECEIVE_BUFFER: Final = MOST_HEAD  # bytes of a connection that the system keeps
_PAUSE_S: Final = 0.0005  # after each step, for the loop
_POLL_S: Final = 0.05  # between checks of deadlines
_TAKEN: Final = {98, 48, 10048}  # EADDRINUSE of Linux, macOS and Windows


class WebError(ArvaError):
    """The page cannot be served. `str()` says where and why."""


class Content(NamedTuple):
    """The content behind a name."""

    type: str
    body: bytes


Source = Callable[[Mapping[str, str], int], bytes]
"""Makes the JSON or the picture of one name for a query and the number of a connection."""


def pages() -> dict[str, Content]:
    """Return the files of the page, by their path in a request."""
    found = {
        f"/{file.name}": Content(_TYPES[file.suffix], file.read_bytes())
        for file in sorted((Path(__file__).parent / "page").iterdir())
        if file.suffix in _TYPES
    }
    found["/"] = found.pop("/index.html")
    return found


@dataclass(eq=False)
class _Connection:
    """One client: the bytes of its next request, and the rest of the last answer."""

    socket: socket.socket
    due_s: float  # the end of the request, or of the answer
    asked: bytearray = field(default_factory=bytearray)
    rest: list[bytes] = field(default_factory=list)
    sent: int = 0  # bytes of the first one that were sent
    is_last: bool = False  # it ends after this answer
    is_over: bool = False  # further bytes are dropped, so that the last answer arrives


class Server:
    """Serves until it is closed, in a thread of its own that never keeps the program from ending.

    `sources`: the makers of the JSON of each name. Port 0 is any free port. If the port is taken, the next free one is
    used: see `address`. Raises WebError if no port is free, or the host is not an address of this computer.

    Each whole request and each whole answer has `_TIMEOUT_S`. If there are too many connections or waiting bytes, the
    connection with the next deadline is closed.
    """

    def __init__(self, wanted: HostPort, sources: Mapping[str, Source], clock: Clock | None = None) -> None:
        self._listener = _open(wanted)
        self._sources = sources
        self._clock = clock or RealClock()
        self._files = pages()
        self.address = HostPort(wanted.host, self._listener.getsockname()[1])
        self._open: dict[_Connection, int] = {}  # and their numbers
        self._count = 0  # of connections so far
        self._closing = threading.Event()
        self._selector = selectors.DefaultSelector()
        self._selector.register(self._listener, selectors.EVENT_READ)
        self._thread = threading.Thread(target=self._serve, name="web", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Take no more connections and close those there are."""
        self._closing.set()
        self._thread.join(1.0)

    def _serve(self) -> None:
        while not self._closing.is_set():
            for key, _ in self._selector.select(_POLL_S):
                self._step(key.data)
                self._clock.wait(self._clock.now() + _PAUSE_S)
            for late in [one for one in self._open if one.due_s < self._clock.now()]:
                self._drop(late)
        for connection in list(self._open):
            self._drop(connection)
        self._selector.close()
        self._listener.close()

    def _step(self, connection: _Connection | None) -> None:
        """Do one step for a connection, or accept one. A client that has left or is too slow is not reported."""
        try:
            if connection is None:
                self._accept()
            elif connection.rest:
                self._send(connection)
            elif connection in self._open:
                self._receive(connection)
        except BlockingIOError:
            pass
        except Exception:  # also if a document cannot be made
            self._drop(connection)

    def _accept(self) -> None:
        client, _ = self._listener.accept()
        client.setblocking(False)
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        if len(self._open) >= _MOST_CLIENTS:
            self._drop(min(self._open, key=lambda one: one.due_s))
        connection = _Connection(client, self._clock.now() + _TIMEOUT_S)
        self._count += 1
        self._open[connection] = self._count
        self._selector.register(client, selectors.EVENT_READ, connection)

    def _drop(self, connection: _Connection | None) -> None:
        if connection is not None and self._open.pop(connection, 0):
            self._selector.unregister(connection.socket)
            connection.rest.clear()
            connection.socket.close()

    def _receive(self, connection: _Connection) -> None:
        data = connection.socket.recv(MOST_HEAD + 1 - len(connection.asked))
        if not data:
            self._drop(connection)
        elif not connection.is_over:
            connection.asked += data
            self._answer(connection)

    def _answer(self, connection: _Connection) -> None:
        """Answer the request, if it is whole."""
        end = connection.asked.find(b"\r\n\r\n")
        if end < 0 and len(connection.asked) <= MOST_HEAD:
            return
        request: Request | None = None
        try:
            request = parse_request(connection.asked, end)
            del connection.asked[: end + 4]
            request.refuse_others(self.address.host, connection.socket.getsockname()[0])
            status, content = HTTPStatus.OK, self._content(request, self._open[connection])
        except Refused as refusal:
            status, content = refusal.status, Content(_TYPES[".txt"], f"{refusal}\n".encode("ascii"))
        connection.is_last = request is None or request.is_last or status is not HTTPStatus.OK
        body = [] if not content.body or (request and request.method == "HEAD") else [content.body]
        connection.rest = [_head(status, content, connection.is_last), *body]
        self._turn(connection, selectors.EVENT_WRITE)
        # the waiting answers have a largest size; a common answer counts once
        waiting = sorted((one for one in self._open if one.rest), key=lambda one: one.due_s)
        while len(waiting) > 1 and _size(waiting) > _MOST_ANSWERS:
            self._drop(waiting.pop(0))

    def _content(self, request: Request, number: int) -> Content:
        if (source := self._sources.get(request.path)) is not None:
            return Content(_TYPES.get(Path(request.path).suffix, _JSON), source(request.query, number))
        if (page := self._files.get(request.path)) is not None:
            return page
        raise Refused(HTTPStatus.NOT_FOUND, "there is nothing of this name")

    def _send(self, connection: _Connection) -> None:
        connection.sent += connection.socket.send(memoryview(connection.rest[0])[connection.sent :])
        if connection.sent < len(connection.rest[0]):
            return
        del connection.rest[0]
        connection.sent = 0
        if connection.rest:
            return
        self._turn(connection, selectors.EVENT_READ)
        if connection.is_last:
            connection.socket.shutdown(socket.SHUT_WR)
            connection.is_over = True
            connection.asked.clear()
        else:
            self._answer(connection)

    def _turn(self, connection: _Connection, what: int) -> None:
        """Wait for the next request, or for the answer to be accepted, with the whole time from now on."""
        connection.due_s = self._clock.now() + _TIMEOUT_S
        self._selector.modify(connection.socket, what, connection)


def _size(waiting: Iterable[_Connection]) -> int:
    """Return the number of bytes of the answers that connections wait for."""
    return sum(map(len, {id(part): part for one in waiting for part in one.rest}.values()))


def _head(status: HTTPStatus, answer: Content, is_last: bool) -> bytes:
    allow = "Allow: GET, HEAD\r\n" if status == HTTPStatus.METHOD_NOT_ALLOWED else ""
    closing = "Connection: close\r\n" if is_last else ""
    return (
        f"HTTP/1.1 {status.value} {status.phrase}\r\nContent-Type: {answer.type}\r\n"
        f"Content-Length: {len(answer.body)}\r\n{allow}{closing}{_HEADERS}\r\n"
    ).encode("ascii")


def _open(wanted: HostPort) -> socket.socket:
    try:
        family, _, _, _, place = socket.getaddrinfo(
            wanted.host, wanted.port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
        )[0]
    except (OSError, UnicodeError) as error:
        raise WebError(f"{wanted}: the page cannot be served: no address of that name ({error})") from None
    why = "no port"
    for port in range(wanted.port, min(wanted.port + TRIED, 65536)) if wanted.port else [0]:
        try:
            listener = socket.create_server((str(place[0]), port), family=family, backlog=_MOST_CLIENTS)
        except OSError as error:
            why = os.strerror(error.errno) if error.errno else str(error)
            if error.errno not in _TAKEN and not isinstance(error, PermissionError):
                break
        else:
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _RECEIVE_BUFFER)
            listener.setblocking(False)
            return listener
    raise WebError(f"{wanted}: the page cannot be served: {why}; give another HOST:PORT, or --web off") from None
