"""The page's HTTP server: GET and HEAD of a few names, for browsers that asked this very host.

The names of files are those of `page/`, read once. Nothing that a client sends chooses a file or changes anything.
"""

from __future__ import annotations

import contextlib
import ipaddress
import socket
import threading
from collections.abc import Callable, Mapping
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any, Final, NamedTuple
from urllib.parse import parse_qs, urlsplit

from arva_hil.errors import ArvaError
from arva_hil.observers.web.address import HostPort

TRIED: Final = 20  # ports, from the one wanted on

_TYPES: Final = {
    ".html": "text/html; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".svg": "image/svg+xml",
    ".txt": "text/plain; charset=utf-8",
}
_JSON: Final = "application/json; charset=utf-8"
_PLAIN: Final = "text/plain; charset=utf-8"
_HEADERS: Final = (
    "Cache-Control: no-store\r\n"
    "Content-Security-Policy: default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; "
    "img-src 'self' data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'\r\n"
    "X-Content-Type-Options: nosniff\r\n"
    "Referrer-Policy: no-referrer\r\n"
    "Cross-Origin-Resource-Policy: same-origin\r\n"
    "Cross-Origin-Opener-Policy: same-origin\r\n"
)
_TIMEOUT_S: Final = 5.0  # for a request to come, and for an answer to be taken
_MOST_CLIENTS: Final = 64  # connections; one more, and the oldest is closed
_LONGEST_QUERY: Final = 200


class WebError(ArvaError):
    """The page cannot be served. `str()` says where and why."""


class Content(NamedTuple):
    """What a name stands for."""

    type: str
    body: bytes


Source = Callable[[Mapping[str, str]], bytes]
"""Makes the JSON of one name, by the query of the request."""


def pages() -> dict[str, Content]:
    """The files of the page, by their path in a request."""
    folder = Path(__file__).parent / "page"
    found = {
        f"/{file.name}": Content(_TYPES[file.suffix], file.read_bytes())
        for file in sorted(folder.iterdir())
        if file.suffix in _TYPES
    }
    found["/"] = found.pop("/index.html")
    return found


class Server:
    """Serves until it is closed, in threads of its own that never keep the program from ending.

    `sources`: what makes the JSON of each name. Port 0 is any free one. If the port is taken, the next free one is
    used; `address` says which. Raises WebError if none of them is free, or the host is not one of this computer.
    """

    def __init__(self, wanted: HostPort, sources: Mapping[str, Source]) -> None:
        self._server = _open(wanted)
        self._server.files = pages()
        self._server.sources = sources
        self._server.host = wanted.host.lower()
        self.address = HostPort(wanted.host, self._server.server_address[1])
        threading.Thread(target=self._server.serve_forever, name="web", args=(0.05,), daemon=True).start()

    def close(self) -> None:
        """Take no more connections and close those there are."""
        self._server.shutdown()
        self._server.server_close()
        self._server.forget_all()


def _open(wanted: HostPort) -> _HttpServer:
    try:
        family, _, _, _, place = socket.getaddrinfo(
            wanted.host, wanted.port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
        )[0]
    except (OSError, UnicodeError) as error:
        raise WebError(f"{wanted}: the page cannot be served: no address of that name ({error})") from None
    last: OSError | None = None
    ports = range(wanted.port, min(wanted.port + TRIED, 65536)) if wanted.port else [0]
    for port in ports:
        try:
            return _HttpServer(family, (place[0], port, *place[2:]))
        except PermissionError as error:
            last = error
        except OSError as error:
            last = error
            if error.errno not in _TAKEN:
                break
    why = last.strerror if last else "no port"
    raise WebError(f"{wanted}: the page cannot be served: {why}; give another HOST:PORT, or --web off") from None


_TAKEN: Final = {98, 48, 10048}  # EADDRINUSE of Linux, macOS and Windows


class _HttpServer(ThreadingHTTPServer):
    """A listening socket, and the connections that are open, the oldest first."""

    daemon_threads = True
    block_on_close = False
    request_queue_size = 64
    files: Mapping[str, Content]
    sources: Mapping[str, Source]
    host: str

    def __init__(self, family: int, place: tuple[Any, ...]) -> None:
        self.address_family = family
        self._open: dict[socket.socket, None] = {}
        self._lock = threading.Lock()
        super().__init__(place[:2], _Handler)

    def server_bind(self) -> None:
        """Bind, without asking a name server for the host's name as the standard one does."""
        if self.address_family == socket.AF_INET6:
            self.socket.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 1)
        socket.socket.setsockopt(self.socket, socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self.socket.bind(self.server_address)
        self.server_address = self.socket.getsockname()
        self.server_name, self.server_port = str(self.server_address[0]), int(self.server_address[1])

    def process_request(self, request: Any, client_address: Any) -> None:
        """Begin a connection. If there are too many, the oldest ends."""
        with self._lock:
            self._open[request] = None
            surplus = next(iter(self._open)) if len(self._open) > _MOST_CLIENTS else None
            if surplus is not None:
                del self._open[surplus]
        if surplus is not None:
            _end(surplus)
        super().process_request(request, client_address)

    def shutdown_request(self, request: Any) -> None:
        """A connection has ended."""
        with self._lock:
            self._open.pop(request, None)
        super().shutdown_request(request)

    def forget_all(self) -> None:
        """End all connections."""
        with self._lock:
            every = list(self._open)
            self._open.clear()
        for request in every:
            _end(request)

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A client that is gone or too slow is no news."""


def _end(connection: socket.socket) -> None:
    with contextlib.suppress(OSError):
        connection.shutdown(socket.SHUT_RDWR)


class _Handler(BaseHTTPRequestHandler):
    """Answers the requests of one connection."""

    server: _HttpServer
    protocol_version = "HTTP/1.1"
    timeout = _TIMEOUT_S
    disable_nagle_algorithm = True

    def do_GET(self) -> None:
        """Answer, or refuse."""
        if self.headers.get("Content-Length", "0") != "0" or "Transfer-Encoding" in self.headers:
            self.close_connection = True  # a body would be taken for the next request
        if (refusal := self._refusal()) is not None:
            self.send_error(*refusal)
            return
        try:
            path, query = self._asked()
        except ValueError:
            self.send_error(HTTPStatus.BAD_REQUEST)
            return
        if (source := self.server.sources.get(path)) is not None:
            self._answer(HTTPStatus.OK, Content(_JSON, source(query)))
        elif (page := self.server.files.get(path)) is not None:
            self._answer(HTTPStatus.OK, page)
        else:
            self.send_error(HTTPStatus.NOT_FOUND, "there is nothing of this name")

    def do_HEAD(self) -> None:
        """The same without a body."""
        self.do_GET()

    def send_error(self, code: int, message: str | None = None, explain: str | None = None) -> None:
        """Refuse in plain text. A method that is not GET or HEAD is one that is not allowed."""
        self.close_connection = True
        status = HTTPStatus(code)
        if status == HTTPStatus.NOT_IMPLEMENTED:
            status, message = HTTPStatus.METHOD_NOT_ALLOWED, "only GET and HEAD"
        words = status.phrase if status is HTTPStatus.BAD_REQUEST else message or status.phrase
        self._answer(status, Content(_PLAIN, f"{words}\n".encode("ascii", "replace")))

    def log_message(self, format: str, *args: Any) -> None:
        """Nothing is printed."""

    def _asked(self) -> tuple[str, dict[str, str]]:
        """The path and the values of the query. Raises ValueError for what is none."""
        parts = urlsplit(self.path)
        every = parse_qs(parts.query[:_LONGEST_QUERY], max_num_fields=4) if parts.query else {}
        return parts.path, {name: values[0] for name, values in every.items()}

    def _refusal(self) -> tuple[HTTPStatus, str] | None:
        """Why this is no request of our own page: a page elsewhere, whose host name leads here or that calls us."""
        hosts = self.headers.get_all("Host") or []
        if len(hosts) != 1 or not self._is_ours(hosts[0]):
            return (
                HTTPStatus.FORBIDDEN,
                "this host name is not served here: use the address that the program has printed",
            )
        origins = self.headers.get_all("Origin") or []
        if any(origin.lower() != f"http://{hosts[0].lower()}" for origin in origins):
            return HTTPStatus.FORBIDDEN, "only the page of this address may ask"
        return None

    def _is_ours(self, host: str) -> bool:
        """Whether a Host header names this server: localhost, as it was bound, or the address that was connected to."""
        name = host.lower()
        if name.endswith("]") or ":" not in name:
            port = "80"
        else:
            name, _, port = name.rpartition(":")
        if not port.isdecimal():
            return False
        name = name.removeprefix("[").removesuffix("]")
        if name in ("localhost", self.server.host):
            return True
        try:
            here = ipaddress.ip_address(self.connection.getsockname()[0])
            return ipaddress.ip_address(name) == here
        except (ValueError, OSError):
            return False

    def _answer(self, status: HTTPStatus, answer: Content) -> None:
        """Send it in one piece."""
        allow = "Allow: GET, HEAD\r\n" if status == HTTPStatus.METHOD_NOT_ALLOWED else ""
        closing = "Connection: close\r\n" if self.close_connection else ""
        head = (
            f"HTTP/1.1 {status.value} {status.phrase}\r\nContent-Type: {answer.type}\r\n"
            f"Content-Length: {len(answer.body)}\r\n{allow}{closing}{_HEADERS}\r\n"
        ).encode("ascii")
        self.wfile.write(head if self.command == "HEAD" else head + answer.body)
