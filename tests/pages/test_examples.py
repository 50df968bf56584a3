"""The examples of the pages that no lesson of the tutorial runs."""

from __future__ import annotations

import json
import math
import runpy
import sys
from types import ModuleType
from typing import Any

import pytest

from arva_hil.config import parse
from arva_hil.events import LinkLost, PoseLost
from arva_hil.events.event_json import event_json
from arva_hil.events.reasons import NoPose
from arva_hil.events.vehicles import VehicleFound
from arva_hil.links.pty import PtyLink
from firmware_proto import INNER, MID, OUTER, Channel, Frame, encode

from .pages import FENCE, ROOT


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
            "transmitter 7: d 12.34 m: turn 30 degrees left, or in the opposite direction",
        ),
        (Frame(0, 1, (Channel(7, INNER, 85, 0),)), "transmitter 7: d 0.85 m: go slowly, find the smallest d"),
        (Frame(0, 1, (Channel(None, OUTER, -1, -1),)), "no signal"),
        (Frame(0, 3, (Channel(7, MID, 1234, 17),)), "transmitter 7: d 12.34 m: disturbed, wait for the next reading"),
        (Frame(0, 9, (Channel(7, MID, 1234, 17),)), "the receiver is broken: do not search with it"),
    ],
)
def test_the_client_says_what_the_protocol_says(frame: Frame, said: str) -> None:
    assert runpy.run_path(str(ROOT / "docs/examples/client.py"))["advice"](frame) == said


def blocks(kind: str) -> list[Any]:
    """The code of one kind in the pages, each with its place."""
    found = []
    for page in sorted((ROOT / "docs").rglob("*.md")):
        text = page.read_text(encoding="utf-8")
        for block in FENCE.finditer(text):
            if block["kind"] == kind:
                place = f"{page.relative_to(ROOT)}:{text.count(chr(10), 0, block.start()) + 2}"
                found.append(pytest.param(block["text"], id=place))
    return found


@pytest.mark.parametrize("text", blocks("yaml"))
def test_what_a_page_shows_of_a_scenario_is_one(text: str) -> None:
    """Where a page shows a part alone, the transmitters are added that every scenario has."""
    whole = text if "transmitters:" in text else f"transmitters: [{{id: 1, enu: [20, 5, 0]}}]\n{text}"
    assert parse(whole, "page").transmitters


def test_the_events_that_a_page_shows_are_what_the_program_writes() -> None:
    happened = [
        VehicleFound(0.21, "vehicle", "px4 quadrotor 1/1", 2, False),
        PoseLost(31.4, "vehicle", "receiver", 2.02, NoPose("streams stopped")),
        LinkLost(40.0, "port", "/dev/ttyUSB0", "/dev/ttyUSB0: lost: …"),
    ]
    (shown,) = (block.values[0] for block in blocks("json"))
    assert [json.loads(line) for line in str(shown).splitlines()] == [
        json.loads(event_json(event) or "") for event in happened
    ]
