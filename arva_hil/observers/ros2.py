"""Publishes the messages of a running program in ROS 2. Needs `rclpy`, which a sourced ROS 2 environment has.

The messages are those of the other outputs; rclpy only gets their types.
"""

from __future__ import annotations

import importlib
import os
from collections.abc import Mapping
from functools import partial
from typing import Any, Final

from arva_hil.errors import ArvaError
from arva_hil.events import BytesSent, Event, PacketsReceived
from arva_hil.records.ros_messages.readings import LiveMessages
from arva_hil.records.ros_messages.types import PUBLISHED, Message, encode
from arva_hil.runtime.worker_thread import WorkerThread

_NODE: Final = "arva_hil"
_DEPTH: Final = 100  # messages of a topic that wait for a slow subscriber
_MOST_JOBS: Final = 1000  # events that wait for a slow middleware; then they are dropped
_GOODBYE_S: Final = 0.5
_WHERE: Final = "ROS_AUTOMATIC_DISCOVERY_RANGE"
_NEVER: Final = (BytesSent, PacketsReceived)  # many, and no messages


class Ros2Error(ArvaError):
    """Nothing can be published. `str()`: the reason and the cure."""


class Ros2Publisher:
    """An observer that publishes each message of `messages` on its topic, from a thread of its own.

    `missing`: packages of messages that are not there, so that their topics are not published. Publishes to this
    computer only unless the environment says otherwise. Raises Ros2Error if rclpy or all packages are missing.
    """

    def __init__(self, messages: LiveMessages) -> None:
        os.environ.setdefault(_WHERE, "LOCALHOST")
        try:
            import rclpy
            from rclpy.context import Context
            from rclpy.signals import SignalHandlerOptions
        except ImportError as error:
            raise Ros2Error(
                f"--ros2 needs rclpy, which cannot be imported ({error}): source the setup file of your ROS 2, e.g. "
                ". /opt/ros/jazzy/setup.sh, and run arva-hil with that Python"
            ) from None
        self._kinds, self.missing = _kinds()
        if not self._kinds:
            raise Ros2Error(f"--ros2 needs the packages {', '.join(self.missing)}: source your ROS 2's setup file")
        self._messages = messages
        self._context = Context()
        try:
            rclpy.init(context=self._context, signal_handler_options=SignalHandlerOptions.NO)
            self._node = rclpy.create_node(_NODE, context=self._context, enable_rosout=False)
        except Exception as error:
            raise Ros2Error(
                f"--ros2: no node can be made ({error}): is another RMW_IMPLEMENTATION installed?"
            ) from None
        self._publishers = {
            topic: self._node.create_publisher(self._kinds[kind], topic, _DEPTH)
            for topic, kind in messages.topics.items()
            if kind in self._kinds
        }
        self._thread = WorkerThread("ros2", most_jobs=_MOST_JOBS)

    @property
    def dropped(self) -> int:
        """Events that were not published, because the middleware was too slow."""
        return self._thread.refused

    def observe(self, event: Event) -> None:
        if not isinstance(event, _NEVER):
            self._thread.put(partial(self._publish, event))

    def close(self) -> None:
        """End the node after everything is published, without waiting for long."""
        self._thread.close(self._end, timeout_s=_GOODBYE_S)

    def _publish(self, event: Event) -> None:
        for topic, _, message in self._messages.of_event(event):
            if publisher := self._publishers.get(topic):
                publisher.publish(encode(message))

    def _end(self) -> None:
        self._node.destroy_node()
        self._context.try_shutdown()


def _kinds() -> tuple[Mapping[type[Message], Any], list[str]]:
    """Return ROS 2's classes of our messages, and the missing packages."""
    kinds: dict[type[Message], Any] = {}
    missing = []
    for cls in PUBLISHED:
        package, _, name = cls.__msgtype__.split("/")
        try:
            kinds[cls] = getattr(importlib.import_module(f"{package}.msg"), name)
        except (ImportError, AttributeError):
            missing.append(package)
    return kinds, missing
