"""Loads a scenario, and runs the emulator with it: live, or with a recorded flight."""

from __future__ import annotations

import itertools
import json
import math
import os
from collections.abc import Callable, Mapping
from contextlib import ExitStack, closing
from typing import Any, Final

from arva_hil.clock import RealClock
from arva_hil.config import Scenario, load, parse
from arva_hil.emulator.engine import Emulator
from arva_hil.events import Event, FrameMade
from arva_hil.links import Link, LinkError, open_link, url
from arva_hil.links.reconnecting import open_reconnecting
from arva_hil.links.tlog import TlogReader
from arva_hil.links.tlog_timeline import Timeline
from arva_hil.mavlink.packet_reader import PacketReader
from arva_hil.registry import over_mavlink
from arva_hil.runtime import drivers
from arva_hil.runtime.audience import Audience, MissingVehicles
from arva_hil.runtime.fleet_links import FleetSides, fleet_sides, live_vehicles, vehicles_in_log
from arva_hil.runtime.loop import run

_RANGES: Final = {
    "target_system": (1, 255),
    "target_component": (1, 255),
    "stream_hz": (1, 200),
    "duration_s": (0, math.inf),
    "timeout_s": (0, math.inf),
    "max_age_s": (0, math.inf),
}


def load_scenario(source: str | os.PathLike[str] | Mapping[str, Any]) -> Scenario:
    """Load a scenario from a YAML file (a path or `builtin:NAME`), YAML text, or a mapping with the same keys.

    A string with a line break, or with a colon and a blank, is text. Raises ScenarioError with all mistakes, each with
    file, line and column.

    >>> import pathlib, tempfile
    >>> path = pathlib.Path(tempfile.mkdtemp(), "one.yaml")
    >>> _ = path.write_text("transmitters: [{id: 1, enu: [5, 20, 0]}]")
    >>> load_scenario(path).transmitters[0].ned
    (20.0, 5.0, 0.0)
    >>> load_scenario({"transmitters": [{"id": 1, "enu": [5, 20, 0]}]}).transmitters[0].ned
    (20.0, 5.0, 0.0)
    """
    if isinstance(source, Mapping):
        return parse(json.dumps(source, default=_plain), "mapping")
    if isinstance(source, str) and ("\n" in source or ": " in source):
        return parse(source, "text")
    return load(source)


def _plain(value: Any) -> Any:
    """Return an array as a list, another value as text, for JSON."""
    return value.tolist() if hasattr(value, "tolist") else str(value)


def run_live(
    scenario: Scenario,
    *,
    autopilot: str | None = None,
    port: str | None = None,
    duration_s: float = math.inf,
    timeout_s: float = 10.0,
    max_age_s: float = 2.0,
    stream_hz: float = 50.0,
    target_system: int | None = None,
    target_component: int | None = None,
    on_event: Callable[[Event], object] = lambda event: None,
    stopped: Callable[[], bool] = lambda: False,
) -> None:
    """Emulate the scenario's receivers for `duration_s`, or until `stopped()` is true, which is called often.

    - `autopilot`, `port`: connection strings; formats inside MAVLink have no port. In a scenario with `vehicles` each
      receiver names its port, and `autopilot` is for vehicles that name none. A lost link is opened again.
    - `timeout_s`: for the first heartbeat.
    - `max_age_s`: older poses are not used.
    - `stream_hz`: rate of position and attitude to request.
    - `target_system`, `target_component`: follow only this vehicle.
    - `on_event`: called with every event, and must be quick. Its exception ends the run and is raised here.

    Raises AddressError for a wrong connection string; LinkError for a link that cannot be opened or is lost for good,
    or without a heartbeat in time; ValueError for arguments that do not fit together.
    """
    _check_scenario(scenario)
    _check_port(port)
    given = {"target_system": target_system, "target_component": target_component, "stream_hz": stream_hz}
    _check_numbers(given | {"duration_s": duration_s, "timeout_s": timeout_s, "max_age_s": max_age_s})
    sides = _sides(scenario, autopilot, port, target_system)
    clock, watcher = RealClock(), _Watcher(on_event, len(scenario.vehicles) or 1)
    with ExitStack() as stack:

        def opened(address: str, *, answered: bool = False) -> Link:
            return stack.enter_context(closing(open_reconnecting(address, clock=clock, answered=answered)))

        readers = {name: PacketReader() for name in sides.autopilots}
        autopilots = {name: opened(address, answered=True) for name, address in sides.autopilots.items()}
        ports = {name: opened(address) for name, address in sides.ports.items()}
        vehicles = live_vehicles(scenario, sides, readers, target_system, target_component, stream_hz)
        start = clock.now()
        emulator = Emulator(
            vehicles, start=start, timeout_s=min(timeout_s, duration_s), max_age_s=max_age_s, spread=True
        )
        live = stack.enter_context(closing(drivers.Live(emulator, autopilots, ports, Audience([watcher]))))
        run([live], clock, until=start + duration_s, stopped=lambda: watcher.over or stopped())
        live.finish(clock)
    watcher.finish(", ".join(sides.autopilots.values()))


def replay(
    log: str | os.PathLike[str],
    scenario: Scenario,
    *,
    max_age_s: float = 2.0,
    target_system: int | None = None,
    target_component: int | None = None,
    port: str | None = None,
    on_event: Callable[[Event], object] = lambda event: None,
) -> list[FrameMade]:
    """Return all frames that the scenario's receivers would send on a recorded flight (.tlog), as fast as possible.

    The same log and scenario give the same frames. `port`: also send the frames there. The `vehicles` of a scenario are
    found in the log by their `system`; their ports are not opened. Other arguments as in `run_live`. Raises LinkError
    if the file cannot be read or is not a log; ValueError for arguments that do not fit together.
    """
    _check_scenario(scenario)
    _check_port(port)
    _check_numbers({"target_system": target_system, "target_component": target_component, "max_age_s": max_age_s})
    if scenario.vehicles:
        _check_own(scenario, port, target_system)
    vehicles = vehicles_in_log(scenario, os.fspath(log), target_system, target_component)
    frames: list[FrameMade] = []

    def keep(event: Event) -> None:
        if isinstance(event, FrameMade):
            frames.append(event)
        on_event(event)

    watcher = _Watcher(keep, len(scenario.vehicles) or 1)
    emulator = Emulator(vehicles, start=0.0, max_age_s=max_age_s, look_ahead_s=drivers.LOOK_AHEAD_S)
    with ExitStack() as stack:
        reader = stack.enter_context(closing(TlogReader(log)))
        timeline = Timeline(reader, stamped=reader.stamped)
        if (first := next(timeline, None)) is None:
            raise LinkError(reader.path, "no MAVLink packet in this file", "is it a telemetry log (.tlog)?")
        out = stack.enter_context(closing(open_link(port, clock=RealClock()))) if port is not None else None
        drivers.replay(
            emulator,
            itertools.chain([first], timeline),
            "autopilot",
            lambda output: out is None or out.write(output.data),
            Audience([watcher]),
            stopped=lambda: watcher.over,
        )
    watcher.finish()
    return frames


def _check_scenario(scenario: object) -> None:
    """Raise ValueError for a file name instead of a scenario."""
    if not isinstance(scenario, Scenario):
        cure = f": write load_scenario({scenario!r})" if isinstance(scenario, str | os.PathLike | Mapping) else ""
        raise ValueError(f"scenario: {scenario!r}, expected a Scenario{cure}")


def _check_port(port: str | None) -> None:
    """Raise ValueError for a log, and AddressError for a wrong connection string."""
    if port is not None and url.parse(port).kind == "tlog":
        raise ValueError(f"port: {port!r} is a log: frames cannot be sent there")


def _check_numbers(given: Mapping[str, float | None]) -> None:
    """Raise ValueError for an argument out of its range; None is left out."""
    for name, value in given.items():
        low, high = _RANGES[name]
        if value is not None and not low <= value <= high:
            raise ValueError(f"{name}: {value!r} is out of range ({low:g}…{high:g})")


def _sides(scenario: Scenario, autopilot: str | None, port: str | None, target_system: int | None) -> FleetSides:
    """Return the links of a run. Raises ValueError for arguments that do not fit together."""
    if scenario.vehicles:
        _check_own(scenario, port, target_system)
        return fleet_sides(scenario, autopilot)
    inside = over_mavlink(scenario.output_format)
    if inside is (port is not None):
        what = "no port" if inside else "a port"
        raise ValueError(f"port: {port!r}, expected {what} for frames of the format {scenario.output_format}")
    if autopilot is None or url.parse(autopilot).kind == "stdout":
        raise ValueError(f"autopilot: {autopilot!r}, expected the connection string of the autopilot's link")
    return FleetSides({"autopilot": autopilot}, {}, {} if port is None else {"port": port})


def _check_own(scenario: Scenario, port: str | None, target_system: int | None) -> None:
    """Raise ValueError for options that each vehicle or receiver of the scenario has itself."""
    for name, value in (("port", port), ("target_system", target_system)):
        if value is not None:
            raise ValueError(f"{name}: {value!r}, expected None: {scenario.source} has vehicles, each with its own")


class _Watcher:
    """Remembers the reason to end the run."""

    def __init__(self, on_event: Callable[[Event], object], vehicles: int) -> None:
        self._on_event = on_event
        self._missing = MissingVehicles(vehicles)
        self._error: BaseException | None = None

    @property
    def over(self) -> bool:
        return self._error is not None or self._missing.all

    def observe(self, event: Event) -> None:
        self._missing.observe(event)
        if self._error is None:
            try:
                self._on_event(event)
            except BaseException as error:  # also SystemExit: `finish` raises it
                self._error = error

    def finish(self, address: str = "") -> None:
        """Raise the error that ended the run. With an `address`, raise LinkError if no vehicle was found there."""
        if self._error:
            raise self._error
        if address and self.over:
            raise LinkError(address, str(self._missing))
