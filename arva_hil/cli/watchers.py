"""Observers of a run that the command line asks for: the page in a browser, Foxglove, ROS 2."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

from arva_hil.cli.arguments.shared import FOXGLOVE
from arva_hil.cli.outcome import UsageError
from arva_hil.cli.terminal import tell
from arva_hil.config import Scenario
from arva_hil.events.words.text import Notice
from arva_hil.observers.web.address import DEFAULT_HOST, HostPort
from arva_hil.runtime.audience import Observer
from arva_hil.safe_text import shown

if TYPE_CHECKING:  # a page takes 15 ms to import
    from arva_hil.observers.web.background import Source
    from arva_hil.observers.web.page import WebPage
    from arva_hil.observers.web.state import State

_LOCAL: Final = ("127.", "localhost", "::1")
_POSE: Final = ("GLOBAL_POSITION_INT", "ATTITUDE")


def page_of_run(
    kind: str, options: argparse.Namespace, chosen: Scenario, say: Callable[..., None], *, named: bool
) -> WebPage | None:
    """Return the page of a run with a scenario; None without --web. Raises WebError if it cannot be served.

    `say` is called with the lines about its address. `named`: there are several receivers.
    """
    rate_hz = getattr(options, "stream_rate", None)
    datum = chosen.datum if not isinstance(chosen.datum, str) else None

    def state() -> State:
        from arva_hil.observers.web.state import State

        return State(
            kind,
            Path(chosen.source).name,
            datum=(datum.lat, datum.lon, datum.alt) if datum else None,
            kappa_eq=chosen.receiver.kappa_eq,
            asked_hz=dict.fromkeys(_POSE, rate_hz) if rate_hz else None,
            faults=[str(fault) for fault in chosen.faults],
            named=named,
            background=background_of(options.map, chosen),
            hidden=getattr(options, "hide_truth", False),
        )

    return open_page(options, state, say)


def background_of(path: str | None, scenario: Scenario | None) -> Source | None:
    """Return what draws the picture under the map: a file, or the terrain; None without both. Raises UsageError."""
    from arva_hil.cli.recorded import needing  # slow to import, as are those below
    from arva_hil.model.field.terrain import TerrainGrid
    from arva_hil.observers.web.background import map_file, terrain

    if path:
        try:
            with needing("maps", "--map"):
                return map_file(Path(path))
        except ValueError as error:
            raise UsageError(f"--map {error}") from None
    grid = scenario.terrain if scenario else None
    return terrain(grid) if isinstance(grid, TerrainGrid) else None


def open_page(options: argparse.Namespace, state: Callable[[], State], say: Callable[..., None]) -> WebPage | None:
    """Return the page of --web; None without --web.

    Raises WebError if it cannot be served, UsageError for a map without a page. `say`: see above.
    """
    wanted: HostPort | str | None = options.web
    if not isinstance(wanted, HostPort):
        if "map" in options.typed:
            raise UsageError("--map: there is no page: add --web, or leave it out")
        return None
    from arva_hil.observers.web.page import WebPage

    page = WebPage(wanted, state())
    say(*said_of_page(page.address, wanted))
    return page


def said_of_page(address: HostPort, wanted: HostPort) -> Iterator[str]:
    """Yield the lines about a page: its address, and the machines that can open it."""
    return _served(f"page: {address.url}", address, wanted, f"open the page; --web {DEFAULT_HOST} offers it")


def _served(where: str, address: HostPort, wanted: HostPort, who: str) -> Iterator[str]:
    """Yield the lines about a server: its address, and the risk if other machines can reach it."""
    yield where + (f" (port {wanted.port} is taken)" if wanted.port not in (0, address.port) else "")
    if not address.host.startswith(_LOCAL):
        yield f"warning: everybody in this network can {who} here only"


def live_observers(options: argparse.Namespace, scenario: Scenario | None, epoch_us: int) -> list[Observer]:
    """Return the observers of --foxglove and --ros2, and print their addresses; each has a `close`.

    Raises FoxgloveError, Ros2Error.

    `scenario`: of the run, None for a search. `epoch_us`: microseconds since 1970 at the loop's time 0.
    """
    observers: list[Observer] = []
    if not options.foxglove and not options.ros2:
        return observers
    from arva_hil.cli.recorded import needing  # slow to import, as are those below

    extra = "foxglove" if options.foxglove else "ros2"
    with needing(extra, f"--{extra}"):
        from arva_hil.records.ros_messages.readings import LiveMessages

    def messages() -> LiveMessages:
        alone = scenario is None or len(scenario.vehicles) < 2  # the topics have one take-off point
        return LiveMessages(scenario, epoch_us, searches=hasattr(options, "strategy") and alone)

    if wanted := options.foxglove:
        from arva_hil.observers.foxglove import FoxgloveServer

        server = FoxgloveServer(messages(), wanted)
        where, address = f"messages for Foxglove: {server.url}", wanted._replace(port=server.port)
        tell(*_served(where, address, wanted, f"read the messages; --foxglove {FOXGLOVE} serves them"))
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
    """Close the observers that have a `close`; `notice` is called for each failure."""
    for observer in observers:
        try:
            getattr(observer, "close", lambda: None)()
        except KeyboardInterrupt:
            raise
        except BaseException as error:  # as in `Audience`
            notice(Notice("error", f"observer {type(observer).__name__}: close() failed: {shown(error)}"))
