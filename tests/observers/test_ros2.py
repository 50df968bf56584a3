"""`--ros2`: with a stand-in for rclpy what is published, and with a real one what a subscriber gets.

The real one is off unless ARVA_ROS2_PYTHON names a Python that has rclpy, the packages of ROS 2's messages and
arva_msgs (docs/howto/ros.md says how to make one).
"""

from __future__ import annotations

import csv
import json
import os
import subprocess
import sys
import threading
import types
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from arva_hil.config import DEFAULT
from arva_hil.events import DatumSet
from arva_hil.observers import ros2
from arva_hil.observers.ros2 import Ros2Error, Ros2Publisher
from arva_hil.records.ros_messages.live import LiveMessages
from arva_hil.records.ros_messages.types import PUBLISHED
from tests.records.ros_messages.oracle import read
from tests.records.ros_messages.test_readings import EPOCH_US, HOME, made

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
        assert subscriber.stdout is not None
        assert subscriber.stdout.readline() == "ready\n"
        command = [PYTHON, "-m", "arva_hil", "replay", flight, "--ros2", "--speed", "10", "--rate", "5"]
        subprocess.run([*command, "--record", tmp_path / "run"], env=environment, check=True, timeout=100)
        told = json.loads(subscriber.communicate(timeout=60)[0])
    frames: dict[str, list[tuple[float, ...]]] = {}
    for row in csv.DictReader((tmp_path / "run" / "readings.csv").open()):
        values = int(row["id"] or -1), float(row["d_cm"]), int(row["delta_deg"]), int(row["zone"])
        frames.setdefault(row["time_s"], []).append(values)
    expected = list(frames.values())
    assert len(told) > 10
    assert [[tuple(slot) for slot in reading] for reading in told] == expected[len(expected) - len(told) :]
