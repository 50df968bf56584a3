"""The messages of a running program as a client of Foxglove's protocol gets them, which knows nothing of the SDK."""

from __future__ import annotations

import contextlib
import importlib.util
import json
import os
import socket
import subprocess
import sys
import threading
import types
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from arva_hil.cli.arguments.shared import foxglove
from arva_hil.config import DEFAULT
from arva_hil.events import DatumSet
from arva_hil.observers import ros2
from arva_hil.observers.foxglove import FoxgloveError, FoxgloveServer
from arva_hil.observers.ros2 import Ros2Error, Ros2Publisher
from arva_hil.observers.web.address import HostPort
from arva_hil.records.ros_messages.readings import LiveMessages
from arva_hil.records.ros_messages.types import PUBLISHED
from tests.every import every
from tests.files import rows as table
from tests.records.ros_messages.oracle import read
from tests.records.ros_messages.test_readings import EPOCH_US, HOME, made

pytestmark = pytest.mark.skipif(importlib.util.find_spec("foxglove") is None, reason="foxglove-sdk is not installed")

if importlib.util.find_spec("foxglove"):
    from websockets.sync.client import connect

    from tests.foxglove_client import FoxgloveClient

STALLED = {"subprotocols": ["foxglove.sdk.v1"], "max_queue": 1, "close_timeout": 0.1}


@contextlib.contextmanager
def server(port: int = 0) -> Iterator[FoxgloveServer]:
    with closing(FoxgloveServer(LiveMessages(DEFAULT, EPOCH_US, searches=False), HostPort(port=port))) as served:
        yield served


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


@every(
    "text, meant",
    [
        ("127.0.0.1:9000", HostPort("127.0.0.1", 9000)),
        ("9000", HostPort("127.0.0.1", 9000)),
        ("bench-2.local", HostPort("bench-2.local", 8765)),
        ("[::1]:9000", HostPort("::1", 9000)),
    ],
)
def test_addresses(text: str, meant: HostPort) -> None:
    assert foxglove(text) == meant


@every("text", ["", "a:b", "127.0.0.1:", ":9000", "65536", "::1", "http://localhost:80", "a b"])
def test_what_is_no_address_is_refused(text: str) -> None:
    with pytest.raises(Exception, match=r"expected HOST:PORT, HOST or PORT, e\.g\. 127\.0\.0\.1:8765"):
        foxglove(text)


# -- `--ros2`: with a stand-in for rclpy what is published, and with a real one what a subscriber gets ---------


ROOT = Path(__file__).parents[2]
PYTHON = os.environ.get("ARVA_ROS2_PYTHON", "")


class Rclpy:
    """A stand-in for rclpy that keeps what is published. `stuck` holds up each message."""

    def __init__(self) -> None:
        self.published: list[tuple[str, type, bytes]] = []
        self.stuck = threading.Event()
        self.stuck.set()
        self.ended = threading.Event()
        self.options: dict[str, Any] = {}

    def init(self, **options: Any) -> None:
        self.options = options

    def create_node(self, name: str, **options: Any) -> Rclpy:
        return self

    def create_publisher(self, kind: type, topic: str, depth: int) -> Any:
        def publish(data: bytes) -> None:
            assert self.stuck.wait(60)
            self.published.append((topic, kind, data))

        return types.SimpleNamespace(publish=publish)

    def destroy_node(self) -> None:
        self.ended.set()


@pytest.fixture
def rclpy(monkeypatch: pytest.MonkeyPatch) -> Iterator[Rclpy]:
    there = Rclpy()
    modules = {
        "rclpy": there,
        "rclpy.context": types.SimpleNamespace(Context=lambda: types.SimpleNamespace(try_shutdown=lambda: None)),
        "rclpy.signals": types.SimpleNamespace(SignalHandlerOptions=types.SimpleNamespace(NO="none")),
    }
    for cls in PUBLISHED:
        package, _, name = cls.__msgtype__.split("/")
        module = modules.setdefault(f"{package}.msg", types.SimpleNamespace())
        setattr(module, name, type(name, (), {}))
        monkeypatch.setitem(sys.modules, package, types.ModuleType(package))
    for name, module in modules.items():
        monkeypatch.setitem(sys.modules, name, module)
    monkeypatch.delenv("ROS_AUTOMATIC_DISCOVERY_RANGE", raising=False)
    monkeypatch.setattr(ros2, "_GOODBYE_S", 60.0)  # however slow the machine
    yield there
    there.stuck.set()


def publisher() -> Ros2Publisher:
    return Ros2Publisher(LiveMessages(DEFAULT, EPOCH_US, searches=False))


def test_every_reading_is_published_with_the_bytes_that_others_read(rclpy: Rclpy) -> None:
    ours = publisher()
    ours.observe(DatumSet(0.0, "vehicle", *HOME, ()))
    for n in range(10):
        ours.observe(made(time_s=1.5 + n))
    ours.close()
    told = [data for topic, kind, data in rclpy.published if (topic, kind.__name__) == ("/arva", "Arva")]
    stamps = [read(data, "arva_msgs/msg/Arva")["header"]["stamp"]["sec"] for data in told]
    assert stamps == [1_700_000_001 + n for n in range(10)]
    assert {topic for topic, _, _ in rclpy.published} >= {"/tf", "/arva/pose", "/arva/fix", "/arva/visualization"}
    assert rclpy.ended.is_set()


def test_signals_stay_the_programs_own_and_discovery_stays_on_this_computer(rclpy: Rclpy) -> None:
    publisher().close()
    assert rclpy.options["signal_handler_options"] == "none"
    assert os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] == "LOCALHOST"


def test_what_the_environment_says_of_discovery_is_left_alone(rclpy: Rclpy, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET")
    publisher().close()
    assert os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] == "SUBNET"


def test_a_middleware_that_hangs_holds_up_neither_the_run_nor_its_end(
    rclpy: Rclpy, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ros2, "_GOODBYE_S", 0.5)
    ours = publisher()
    rclpy.stuck.clear()
    for n in range(3000):
        ours.observe(made(time_s=1.5 + n))
    ours.close()
    assert ours.dropped > 0


def test_without_arva_msgs_the_messages_of_ros_2_are_published(rclpy: Rclpy, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "arva_msgs.msg", None)
    ours = publisher()
    assert ours.missing == ["arva_msgs"]
    ours.observe(made())
    ours.close()
    assert {topic for topic, _, _ in rclpy.published} == {"/tf", "/arva/pose", "/arva/visualization"}


def test_without_rclpy_it_is_said_what_to_source(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "rclpy", None)
    with pytest.raises(Ros2Error, match=r"--ros2 needs rclpy.*source the setup file"):
        publisher()


def test_without_any_package_of_messages_nothing_is_published(rclpy: Rclpy, monkeypatch: pytest.MonkeyPatch) -> None:
    for cls in PUBLISHED:
        monkeypatch.setitem(sys.modules, f"{cls.__msgtype__.partition('/')[0]}.msg", None)
    with pytest.raises(Ros2Error, match="needs the packages arva_msgs, geometry_msgs"):
        publisher()


@pytest.mark.skipif(not PYTHON, reason="ARVA_ROS2_PYTHON names no Python with rclpy and arva_msgs")
def test_a_real_subscriber_gets_the_readings_of_the_record(tmp_path: Path, flight: Path) -> None:
    environment = {**os.environ, "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST", "ROS_DOMAIN_ID": "77"}
    environment["PYTHONPATH"] = os.pathsep.join([str(ROOT), environment.get("PYTHONPATH", "")])
    script = ROOT / "tests" / "records" / "ros_messages" / "subscriber.py"
    with subprocess.Popen([PYTHON, script], stdout=subprocess.PIPE, env=environment, text=True) as subscriber:
        assert subscriber.stdout.readline() == "ready\n"
        command = [PYTHON, "-m", "arva_hil", "replay", flight, "--ros2", "--speed", "10", "--rate", "5"]
        subprocess.run([*command, "--record", tmp_path / "run"], env=environment, check=True, timeout=100)
        told = json.loads(subscriber.communicate(timeout=60)[0])
    frames: dict[str, list[tuple[float, ...]]] = {}
    for row in table(tmp_path / "run" / "readings.csv"):
        values = int(row["id"] or -1), float(row["d_cm"]), int(row["delta_deg"]), int(row["zone"])
        frames.setdefault(row["time_s"], []).append(values)
    expected = list(frames.values())
    assert len(told) > 10
    assert [[tuple(slot) for slot in reading] for reading in told] == expected[len(expected) - len(told) :]
