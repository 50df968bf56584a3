"""The page's server: who is answered, who is refused, and that nobody can keep others waiting."""

from __future__ import annotations

import http.client
import json
import socket
import threading
import tracemalloc
from collections.abc import Iterable, Iterator, Mapping

import pytest

from arva_hil.clock import StepClock, Waitable
from arva_hil.observers.web.address import HostPort, parse_address
from arva_hil.observers.web.server import Server, WebError, pages

UNFINISHED = b"GET / HTTP/1.1\r\nHost: localhost\r\n"
POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; img-src 'self' data:; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)


def big(query: Mapping[str, str], client: int) -> bytes:
    """A document that no buffer of the system takes whole."""
    return b"x" * 20_000_000


@pytest.fixture
def server() -> Iterator[Server]:
    sources = {"/state.json": lambda query, client: json.dumps(dict(query)).encode(), "/big.json": big}
    server = Server(HostPort("127.0.0.1", 0), sources)
    yield server
    server.close()


def ask(
    server: Server, path: str = "/", method: str = "GET", headers: dict[str, str] | None = None, body: str | None = None
) -> tuple[http.client.HTTPResponse, bytes]:
    connection = http.client.HTTPConnection("127.0.0.1", server.address.port, timeout=10)
    try:
        connection.request(method, path, body=body, headers=headers or {})
        answer = connection.getresponse()
        return answer, answer.read()
    finally:
        connection.close()


def say(server: Server, data: bytes) -> bytes:
    """The answer to raw bytes, until the server hangs up."""
    with socket.create_connection(("127.0.0.1", server.address.port), timeout=10) as client:
        client.sendall(data)
        return until_closed(client)


def until_closed(client: socket.socket) -> bytes:
    """What comes until the server hangs up."""
    answer = b""
    while chunk := client.recv(65536):
        answer += chunk
    return answer


def test_every_file_of_the_page_is_there_with_headers_that_let_nothing_else_in(server: Server) -> None:
    for path, page in pages().items():
        answer, body = ask(server, path)
        assert (answer.status, body) == (200, page.body)
        assert answer.getheader("Content-Security-Policy") == POLICY
        assert answer.getheader("X-Content-Type-Options") == "nosniff"
        assert answer.getheader("Cache-Control") == "no-store"
        assert answer.getheader("Set-Cookie") is None
        assert answer.getheader("Server") is None
    assert ask(server, "/")[0].getheader("Content-Type") == "text/html; charset=utf-8"


def test_the_page_is_small() -> None:
    assert sum(len(page.body) for page in pages().values()) <= 180_000


def test_the_query_is_handed_on_once_each(server: Server) -> None:
    assert ask(server, "/state.json?since=12&since=13&at=1.5")[1] == b'{"since": "12", "at": "1.5"}'
    assert ask(server, "/state.json?" + "since=1&" * 50)[0].status == 400
    assert b" 400 " in say(server, b"GET http://[/state.json HTTP/1.1\r\nHost: localhost\r\n\r\n")


def test_head_has_the_headers_of_get_and_no_body(server: Server) -> None:
    answer, body = ask(server, "/style.css", "HEAD")
    assert (answer.status, body) == (200, b"")
    assert answer.getheader("Content-Length") == str(len(pages()["/style.css"].body))


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "OPTIONS", "PATCH", "TRACE", "CONNECT", "BREW"])
def test_another_method_is_not_allowed(server: Server, method: str) -> None:
    answer, _ = ask(server, "/state.json", method)
    assert answer.status == 405
    assert answer.getheader("Allow") == "GET, HEAD"


@pytest.mark.parametrize(
    "path", ["/nothing", "/../server.py", "/page.py", "//etc/passwd", "/%2e%2e/state.py", "/index"]
)
def test_what_is_no_name_of_the_page_is_not_there(server: Server, path: str) -> None:
    answer, body = ask(server, path)
    assert answer.status == 404
    assert path.encode() not in body


def test_it_is_asked_by_its_address_or_as_localhost_and_by_no_other_name(server: Server) -> None:
    port = server.address.port
    for host in (f"127.0.0.1:{port}", f"localhost:{port}", f"LOCALHOST:{port}", "localhost", "localhost:9000"):
        assert ask(server, headers={"Host": host})[0].status == 200, host
    for host in (f"evil.example:{port}", "evil.example", f"127.0.0.2:{port}", "", "localhost.evil.example", "[::1]"):
        assert ask(server, headers={"Host": host})[0].status == 403, host
    assert b" 403 " in say(server, b"GET / HTTP/1.1\r\nHost: localhost\r\nHost: evil.example\r\n\r\n")
    assert b" 403 " in say(server, b"GET / HTTP/1.0\r\n\r\n")


def test_a_page_of_another_origin_is_refused(server: Server) -> None:
    host = f"127.0.0.1:{server.address.port}"
    assert ask(server, "/state.json", headers={"Host": host, "Origin": f"http://{host}"})[0].status == 200
    for origin in ("http://evil.example", "null", f"https://{host}", "http://127.0.0.1:1"):
        assert ask(server, "/state.json", headers={"Host": host, "Origin": origin})[0].status == 403, origin


def test_a_body_is_not_taken_for_the_next_request(server: Server) -> None:
    answer, _ = ask(server, "/state.json", body="GET /nothing HTTP/1.1")
    assert answer.getheader("Connection") == "close"


@pytest.mark.parametrize(
    "data", [b"\x16\x03\x01\x02\x00\x01\r\n\r\n", b"GET\r\n\r\n", b"GET / HTTP/9.9\r\n\r\n", b"<script>\r\n\r\n"]
)
def test_nonsense_is_refused_and_not_repeated(server: Server, data: bytes) -> None:
    answer = say(server, data)
    assert b"script>" not in answer
    assert ask(server)[0].status == 200


def test_if_the_port_is_taken_it_is_the_next_free_one() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        server = Server(HostPort("127.0.0.1", port), {})
        try:
            assert port < server.address.port < port + 20
            assert ask(server)[0].status == 200
        finally:
            server.close()


@pytest.mark.parametrize("host", ["192.0.2.1", "nowhere.invalid"])
def test_an_address_that_is_not_of_this_computer_is_an_error_that_says_so(host: str) -> None:
    with pytest.raises(WebError, match=f"{host}:8457: the page cannot be served: "):
        Server(HostPort(host), {})


def test_an_address_of_version_6() -> None:
    try:
        server = Server(parse_address("[::1]:0"), {})
    except WebError:
        pytest.skip("no IPv6 here")
    try:
        with socket.create_connection(("::1", server.address.port), timeout=10) as client:
            client.sendall(f"GET / HTTP/1.1\r\nHost: [::1]:{server.address.port}\r\n\r\n".encode())
            assert client.recv(100).startswith(b"HTTP/1.1 200 ")
    finally:
        server.close()


def test_clients_that_say_nothing_keep_nobody_from_the_page(server: Server) -> None:
    silent = [socket.create_connection(("127.0.0.1", server.address.port), timeout=10) for _ in range(100)]
    try:
        assert ask(server)[0].status == 200
    finally:
        for client in silent:
            client.close()


def test_a_client_that_reads_nothing_keeps_nobody_from_the_page_and_not_the_program_from_ending() -> None:
    server = Server(HostPort("127.0.0.1", 0), {"/big.json": big})
    with socket.create_connection(("127.0.0.1", server.address.port), timeout=10) as slow:
        slow.sendall(b"GET /big.json HTTP/1.1\r\nHost: localhost\r\n\r\n")
        assert slow.recv(10) == b"HTTP/1.1 2"
        assert ask(server)[0].status == 200
        server.close()
    with pytest.raises(OSError, match="refused"):
        ask(server)


def opened(server: Server, data: bytes) -> socket.socket:
    """A connection that has said so much, and is being served."""
    client = socket.create_connection(("127.0.0.1", server.address.port), timeout=10)
    client.sendall(data)
    assert ask(server)[0].status == 200
    return client


def is_closed(client: socket.socket) -> bool:
    """Whether the server hangs up within the deadline."""
    client.settimeout(10)
    try:
        return client.recv(1) == b""
    except ConnectionResetError:
        return True


class SetClock(StepClock):
    """A clock that stands until the test moves it."""

    def wait(self, deadline: float, links: Iterable[Waitable] = ()) -> None:
        pass

    def pass_s(self, seconds: float) -> None:
        self._now += seconds


def test_a_request_that_does_not_end_is_closed_however_often_something_comes() -> None:
    clock = SetClock()
    server = Server(HostPort("127.0.0.1", 0), {}, clock)
    try:
        with opened(server, UNFINISHED) as slow, opened(server, b"") as silent, opened(server, b"") as page:
            for _ in range(3):
                clock.pass_s(1.6)
                slow.sendall(b"X: y\r\n")
                page.sendall(b"HEAD / HTTP/1.1\r\nHost: localhost\r\n\r\n")
                assert page.recv(1 << 20).startswith(b"HTTP/1.1 200 ")
            clock.pass_s(1.6)
            assert is_closed(slow)
            assert is_closed(silent)
            page.sendall(b"GET /nothing HTTP/1.1\r\nHost: localhost\r\n\r\n")
            assert b"HTTP/1.1 404 " in until_closed(page)
    finally:
        server.close()


@pytest.mark.parametrize("line", [b"X: " + b"y" * 20_000 + b"\r\n", b"X: y\r\n" * 3000])
def test_headers_of_more_than_16_kib_are_refused_before_they_end(server: Server, line: bytes) -> None:
    assert say(server, UNFINISHED + line).startswith(b"HTTP/1.1 431 ")
    assert ask(server, headers={"Cookie": "c" * 16_000})[0].status == 200


def test_unfinished_headers_on_every_connection_take_some_1_mib_and_one_thread() -> None:
    threads = threading.active_count()
    tracemalloc.start()
    server = Server(HostPort("127.0.0.1", 0), {})
    clients = []
    try:
        for _ in range(100):
            clients.append(opened(server, UNFINISHED + b"X: " + b"y" * 16_000))
        peak = tracemalloc.get_traced_memory()[1]
        assert threading.active_count() == threads + 1
    finally:
        tracemalloc.stop()
        for client in clients:
            client.close()
        server.close()
    assert peak < 3 << 20


def test_answers_that_nobody_takes_are_bounded_and_the_page_goes_on(server: Server) -> None:
    clients = []
    tracemalloc.start()
    try:
        for _ in range(12):  # each waits for 20 MB of its own
            clients.append(opened(server, b"GET /big.json HTTP/1.1\r\nHost: localhost\r\n\r\n"))
        assert tracemalloc.get_traced_memory()[1] < 120 << 20
    finally:
        tracemalloc.stop()
        for client in clients:
            client.close()


def test_a_document_that_cannot_be_made_costs_its_connection_alone() -> None:
    server = Server(HostPort("127.0.0.1", 0), {"/state.json": lambda query, client: bytes(int(query["size"]))})
    try:
        assert say(server, b"GET /state.json HTTP/1.1\r\nHost: localhost\r\n\r\n") == b""
        assert ask(server)[0].status == 200
    finally:
        server.close()


def test_requests_that_come_together_are_answered_one_after_another(server: Server) -> None:
    each = "GET /state.json?since={} HTTP/1.1\r\nHost: localhost\r\n{}\r\n"
    answer = say(server, (each.format(1, "") + each.format(2, "Connection: close\r\n")).encode())
    assert [part.partition(b"\r\n\r\n")[2] for part in answer.split(b"HTTP/1.1 ")[1:]] == [
        b'{"since": "1"}',
        b'{"since": "2"}',
    ]


@pytest.mark.parametrize(
    ("text", "address"),
    [
        ("127.0.0.1:8080", HostPort("127.0.0.1", 8080)),
        ("8080", HostPort("127.0.0.1", 8080)),
        ("0.0.0.0", HostPort("0.0.0.0", 8457)),
        ("localhost", HostPort("localhost", 8457)),
        ("[::1]:80", HostPort("::1", 80)),
        ("my-laptop.local:0", HostPort("my-laptop.local", 0)),
    ],
)
def test_addresses(text: str, address: HostPort) -> None:
    assert parse_address(text) == address
    assert parse_address(str(address)) == address


@pytest.mark.parametrize(
    "text", ["", ":", "1.2.3.4:", "host:port", "host:99999", "99999", "a b", "http://x", "::1", "ü:1"]
)
def test_what_is_no_address_is_an_error_that_says_what_is_expected(text: str) -> None:
    with pytest.raises(ValueError, match=r"expected HOST:PORT, HOST or PORT, e\.g\. 127\.0\.0\.1:8457"):
        parse_address(text)
