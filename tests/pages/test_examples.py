"""The examples of the pages that no lesson of the tutorial runs."""

from __future__ import annotations

import math
import runpy
import sys
from types import ModuleType
from typing import Any

import pytest

from arva_hil.links.pty import PtyLink
from firmware_proto import INNER, MID, OUTER, Channel, Frame, encode

from .pages import ROOT


class Node:
    """A stand-in for rclpy's node: remembers what was published, and the timer's call."""

    published: dict[str, list[float]]

    def __init__(self, name: str) -> None:
        self.published = {}

    def create_publisher(self, kind: object, topic: str, depth: int) -> Any:
        said = self.published.setdefault(topic, [])
        return type("Publisher", (), {"publish": lambda _, message: said.append(message.data)})()

    def create_timer(self, period_s: float, call: object) -> None:
        self.call = call


class Float32:
    def __init__(self, data: float) -> None:
        self.data = data


def test_the_ros_node_publishes_what_is_heard_and_no_direction_in_the_inner_zone(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for name, contents in {
        "rclpy": {},
        "rclpy.node": {"Node": Node},
        "std_msgs": {},
        "std_msgs.msg": {"Float32": Float32},
    }.items():
        module = ModuleType(name)
        module.__dict__.update(contents)
        monkeypatch.setitem(sys.modules, name, module)
    line = PtyLink()
    try:
        node = runpy.run_path(str(ROOT / "docs/examples/ros_node.py"))["Receiver"](line.path)
        for sequence, channel in enumerate([Channel(1, MID, 1234, -30), Channel(1, INNER, 85, 0), Channel()]):
            line.write(encode(Frame(sequence, 1, (channel,))))
        while len(node.published["~/distance"]) < 2:
            node.read()
        node.read()
    finally:
        line.close()
    assert node.published == {"~/distance": [12.34, 0.85], "~/direction": [math.radians(-30)]}


@pytest.mark.parametrize(
    ("frame", "said"),
    [
        (
            Frame(0, 1, (Channel(7, MID, 1234, -30),)),
            "transmitter 7: d 12.34 m: turn 30 degrees left, or the opposite way",
        ),
        (Frame(0, 1, (Channel(7, INNER, 85, 0),)), "transmitter 7: d 0.85 m: go slowly, look for the smallest d"),
        (Frame(0, 1, (Channel(None, OUTER, -1, -1),)), "nothing is heard"),
        (Frame(0, 3, (Channel(7, MID, 1234, 17),)), "transmitter 7: d 12.34 m: disturbed, wait for the next reading"),
        (Frame(0, 9, (Channel(7, MID, 1234, 17),)), "the receiver is broken: do not search with it"),
    ],
)
def test_the_client_says_what_the_protocol_says(frame: Frame, said: str) -> None:
    assert runpy.run_path(str(ROOT / "docs/examples/client.py"))["advice"](frame) == said
