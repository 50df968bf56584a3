"""The observers that send what happens to other people's tools, as the command line wants them."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence

from arva_hil.cli.arguments.shared import FOXGLOVE
from arva_hil.cli.terminal import tell
from arva_hil.config import Scenario
from arva_hil.observers.audience import Observer
from arva_hil.observers.console.text import Notice


def live_observers(options: argparse.Namespace, scenario: Scenario | None, epoch_us: int) -> list[Observer]:
    """Those of --foxglove and --ros2; each has a `close`. Says where they are. Raises FoxgloveError, Ros2Error.

    `scenario`: of the run, None for a search. `epoch_us`: microseconds since 1970 at the loop's time 0.
    """
    observers: list[Observer] = []
    if not options.foxglove and not options.ros2:
        return observers
    from arva_hil.messages.live import LiveMessages  # slow to import, as are those below

    def messages() -> LiveMessages:
        return LiveMessages(scenario, epoch_us, searches=hasattr(options, "strategy"))

    if options.foxglove:
        from arva_hil.observers.foxglove import FoxgloveServer

        server = FoxgloveServer(messages(), options.foxglove)
        taken = f" (port {options.foxglove.port} is taken)" if options.foxglove.port not in (0, server.port) else ""
        tell(f"messages for Foxglove: {server.url}{taken}")
        if options.foxglove.host != FOXGLOVE.host:
            tell(
                f"warning: everybody in this network can read the messages; --foxglove {FOXGLOVE} serves them here only"
            )
        observers.append(server)
    if options.ros2:
        from arva_hil.observers.ros2 import Ros2Publisher

        publisher = Ros2Publisher(messages())
        tell("messages in ROS 2: ros2 topic list")
        for package in publisher.missing:
            cure = "build tools/ros2/arva_msgs with colcon, and source it" if package == "arva_msgs" else "install it"
            tell(f"warning: the ROS 2 package {package} is missing, its messages are not published: {cure}")
        observers.append(publisher)
    return observers


def close_all(observers: Sequence[Observer], notice: Callable[[Notice], None]) -> None:
    """Close those that can be closed; `notice` is told what fails."""
    for observer in observers:
        try:
            getattr(observer, "close", lambda: None)()
        except Exception as error:
            notice(Notice("error", f"observer {type(observer).__name__}: close() failed: {error!r}"))
