"""One search on one autopilot, in real time and over real links, judged by the simulator's own truth."""

from __future__ import annotations

import json
import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from arva_hil.model.field import LocalFrame
from tests.cli.far_ends import Program

from .autopilots import HOME, Maker, Running
from .truth import ground_m

_BEGINS: Final = "the search begins"
_ENDS: Final = "descending to|; landing|; hovering|the pilot or a failsafe"
_ITS_OWN: Final = ("--target-system", 1)  # every PX4 of a machine sends to port 14550
_NOT_LANDED: Final = "does not report that it has landed"
_CONTACT_M: Final = 0.2
_PATIENCE_S: Final = 700.0


@dataclass(frozen=True)
class Flown:
    """What came of a search. Errors are horizontal, m, from where the transmitter truly is."""

    outcome: dict[str, Any]  # what --json says
    said: str
    lowest_m: float  # true height above the ground, from the beginning of the search to the way down
    reported_m: float | None  # error of the place reported
    touchdown_m: float | None  # error of where the vehicle truly came down first
    landed: bool  # the autopilot has noticed, too

    def __str__(self) -> str:
        reported, touchdown = ("-" if off is None else f"{off:.2f} m" for off in (self.reported_m, self.touchdown_m))
        return (
            f"{self.outcome['outcome']}{'' if self.landed else ', still armed'}; {self.outcome['time_s']:.0f} s, "
            f"place reported {reported} off, true touchdown {touchdown} off, lowest true height {self.lowest_m:.2f} m"
        )


def fly(autopilot: Maker, binary: Path, folder: Path, transmitter: str, seed: int, *options: object) -> Flown:
    """Fly to a transmitter as in a scenario file, its place NED from `HOME`; `options` are those of `search`."""
    scenario, port, record = folder / "scenario.yaml", folder / "receiver", folder / "record"
    lat, lon, alt = HOME
    datum = f"datum: {{lat: {lat}, lon: {lon}, alt: {alt}}}"
    scenario.write_text(f"spec: 1\nseed: {seed}\n{datum}\ntransmitters: [{transmitter}]\n")
    flown = autopilot(binary, folder, seed)
    programs: list[Program] = []
    try:
        emulator = Program(
            *("run", "--scenario", scenario, "--record", record, "--timeout", 60),
            *("--autopilot", flown.telemetry, "--port", f"pty:{port}", *_ITS_OWN),
            speed=1.0,
        )
        programs.append(emulator)
        emulator.says("frames to")
        search = Program(
            *("search", "--json", "--timeout", 90, "--arm-timeout", 120, "--record", record, *options),
            *("--autopilot", flown.commands, "--receiver", port, *_ITS_OWN),
            speed=1.0,
        )
        programs.append(search)
        begun, ended = _wait(search, _BEGINS, flown), _wait(search, _ENDS, flown)
        search.ends(0, 1, 3, 130, within_s=_PATIENCE_S)
        outcome = json.loads(search.out)
        emulator.process.terminate()
        emulator.ends(130)
    finally:
        for program in programs:
            program.close()
        flown.close()
    places = flown.places
    assert places[begun:ended], f"no truth of a search: {search.err}"
    ground = ground_m(places)
    heights = [place.alt - ground for place in places[begun:ended]]
    found = outcome["found"]
    reported = None if found is None else _off(found["lat_lon"][0], found["lat_lon"][1], transmitter)
    contact = next((place for place in places[ended:] if place.alt - ground < _CONTACT_M), None)
    touchdown = None if contact is None else _off(contact.lat, contact.lon, transmitter)
    landed = _NOT_LANDED not in outcome["how"]
    return Flown(outcome, search.err, min(heights), reported, touchdown, landed)


def _wait(search: Program, pattern: str, flown: Running) -> int:
    """Wait until it was said; how much truth there was by then. The end of the program is an end, too."""
    while not re.search(pattern, search.err) and search._listen(_PATIENCE_S):
        pass
    return len(flown.places)


def _off(lat: float, lon: float, transmitter: str) -> float:
    north, east, _ = LocalFrame(*HOME).ned(lat, lon, HOME[2])
    found = re.search(r"ned: \[([-\d.]+), ([-\d.]+)", transmitter)
    assert found
    return math.dist((north, east), tuple(map(float, found.groups())))
