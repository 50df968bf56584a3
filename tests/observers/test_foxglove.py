"""The messages of a running program as a client of Foxglove's protocol gets them, which knows nothing of the SDK."""

from __future__ import annotations

import contextlib
import importlib.util
import json
import socket
import sys
import threading
from collections.abc import Callable, Iterator

import pytest

from arva_hil.cli.arguments.shared import foxglove
from arva_hil.config import DEFAULT
from arva_hil.events import DatumSet
from arva_hil.observers.foxglove import FoxgloveError, FoxgloveServer
from arva_hil.observers.web.address import HostPort
from arva_hil.records.ros_messages.live import LiveMessages
from tests.records.ros_messages.test_readings import EPOCH_US, HOME, made

pytestmark = pytest.mark.skipif(importlib.util.find_spec("foxglove") is None, reason="foxglove-sdk is not installed")

if importlib.util.find_spec("foxglove"):
    from websockets.sync.client import connect

    from tests.foxglove_client import FoxgloveClient

STALLED = {"subprotocols": ["foxglove.sdk.v1"], "max_queue": 1, "close_timeout": 0.1}


@contextlib.contextmanager
def server(port: int = 0) -> Iterator[FoxgloveServer]:
    served = FoxgloveServer(LiveMessages(DEFAULT, EPOCH_US, searches=False), HostPort(port=port))
    try:
        yield served
    finally:
        served.close()


@contextlib.contextmanager
def taken() -> Iterator[int]:
    """A port that another program has."""
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        yield other.getsockname()[1]


def poll(done: Callable[[], bool]) -> None:
    for _ in range(2000):
        if done():
            return
        threading.Event().wait(0.01)
    raise AssertionError("the deadline passed")


def subscribed(served: FoxgloveServer, client: FoxgloveClient) -> None:
    """Tell something until the client hears it."""

    def told() -> bool:
        served.observe(made(time_s=0.5))
        return bool(client.told)

    poll(told)


def test_a_client_gets_every_message_with_its_schema_and_time() -> None:
    with server() as served:
        client = FoxgloveClient(served.port)
        subscribed(served, client)
        before = len(client.of("/arva"))
        served.observe(DatumSet(0.0, "vehicle", *HOME, ()))
        for n in range(20):
            served.observe(made(time_s=1.5 + n))
        assert client.channels["/arva"] == ("cdr", "arva_msgs/msg/Arva", "ros2msg")
        last_ns = (EPOCH_US + 20_000_000) * 1000
        poll(lambda: any(one.stamp_ns == last_ns for one in client.of("/arva")))  # a server that ends loses the rest
    told = [one for one in client.until_closed() if one.topic == "/arva"]
    later = [one for one in told[before:] if one.stamp_ns > (EPOCH_US + 600_000) * 1000]
    assert [one.stamp_ns for one in later] == [(EPOCH_US + 1_000_000 * (1 + n)) * 1000 for n in range(20)]
    assert [one.message["arva_signals"][0]["distance"] for one in later] == [361.0] * 20
    assert {one.topic for one in client.told} >= {"/tf", "/arva/pose", "/arva/fix", "/arva/visualization"}


def test_where_the_port_is_taken_the_next_free_one_is_used() -> None:
    with taken() as port, server(port) as served:
        assert port < served.port <= port + 20
        FoxgloveClient(served.port)


def test_a_client_that_does_not_read_holds_up_nothing_and_the_end_does_not_wait_for_it() -> None:
    with server() as served, connect(f"ws://127.0.0.1:{served.port}", **STALLED) as stalled:
        ids = [{"id": n, "channelId": n} for n in range(1, 8)]
        stalled.send(json.dumps({"op": "subscribe", "subscriptions": ids}))
        over = threading.Event()

        def tell_much() -> None:
            for n in range(5000):
                served.observe(made(time_s=1.5 + n))
            served.close()
            over.set()

        threading.Thread(target=tell_much, daemon=True).start()
        assert over.wait(60)  # with the connection still open


def test_clients_that_fail_are_no_news(caplog: pytest.LogCaptureFixture) -> None:
    with server() as served:
        for _ in range(3):
            with socket.create_connection(("127.0.0.1", served.port), timeout=10) as client:
                client.sendall(b"nonsense\r\n\r\n")
                client.settimeout(10)
                with contextlib.suppress(ConnectionResetError):
                    assert client.recv(1) in (b"", b"H")
        FoxgloveClient(served.port)
    assert caplog.records == []


def test_a_host_that_is_not_ours_is_refused_with_a_cure() -> None:
    with pytest.raises(FoxgloveError, match=r"--foxglove 192\.0\.2\.1:8765: cannot be served there .* name another"):
        FoxgloveServer(LiveMessages(DEFAULT, 0, searches=False), HostPort("192.0.2.1", 8765))


def test_without_the_sdk_the_command_to_install_it_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "foxglove", None)
    with pytest.raises(FoxgloveError, match=r"pip install 'arva-hil\[foxglove\]'"):
        FoxgloveServer(LiveMessages(DEFAULT, 0, searches=False), HostPort(port=0))


@pytest.mark.parametrize(
    ("text", "meant"),
    [
        ("127.0.0.1:9000", HostPort("127.0.0.1", 9000)),
        ("9000", HostPort("127.0.0.1", 9000)),
        ("bench-2.local", HostPort("bench-2.local", 8765)),
        ("[::1]:9000", HostPort("::1", 9000)),
    ],
)
def test_addresses(text: str, meant: HostPort) -> None:
    assert foxglove(text) == meant


@pytest.mark.parametrize("text", ["", "a:b", "127.0.0.1:", ":9000", "65536", "::1", "http://localhost:80", "a b"])
def test_what_is_no_address_is_refused(text: str) -> None:
    with pytest.raises(Exception, match=r"expected HOST:PORT, HOST or PORT, e\.g\. 127\.0\.0\.1:8765"):
        foxglove(text)
