"""The page of ROS 2 messages and the view of RViz name what is published."""

from __future__ import annotations

import re

import yaml

from arva_hil.config import DEFAULT
from arva_hil.records.ros_messages.live import LiveMessages
from arva_hil.records.ros_messages.types import MAP

from .pages import ROOT

TOPICS = LiveMessages(DEFAULT, 0, searches=True).topics


def test_the_page_has_every_topic_with_its_message() -> None:
    text = (ROOT / "docs/reference/messages.md").read_text()
    listed = dict(re.findall(r"^\| `(/[a-z_/]+)` \| `(\w+/msg/\w+)` \|", text, re.MULTILINE))
    assert listed == {topic: kind.__msgtype__ for topic, kind in TOPICS.items()}


def test_the_view_of_rviz_shows_topics_that_are_there() -> None:
    view = yaml.safe_load((ROOT / "tools/ros2/arva_hil.rviz").read_text())["Visualization Manager"]
    assert view["Global Options"]["Fixed Frame"] == MAP
    shown = {display["Topic"]["Value"] for display in view["Displays"] if "Topic" in display}
    assert shown == {"/arva/visualization", "/arva/pose", "/search/visualization"}
    assert shown <= set(TOPICS)
