"""A search on each autopilot, all in real time and over real links: run, search, one flight, the victim found.

The simulators of others fly only where ARVA_HIL_ARDUCOPTER or ARVA_HIL_PX4 names a binary; a machine without them
still flies the built-in vehicle. They take the loopback ports of one flight: run with `-n 0`.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from cli.far_ends import Program

from arva_hil import config
from arva_hil.model import LocalFrame

from .autopilots import ArduCopter, BuiltIn, Px4, Running

CONFIGS = Path(__file__).parents[2] / "configs"
WITHIN_M = {"flux": 2.0, "estimate": 1.0}  # of the transmitter, horizontally


def flights() -> Iterator[Any]:
    """Autopilot, its binary, strategy, case of the paper."""
    yield pytest.param(BuiltIn, "", "estimate", 4, id="built-in")
    for autopilot, name in ((ArduCopter, "ARVA_HIL_ARDUCOPTER"), (Px4, "ARVA_HIL_PX4")):
        if binary := os.environ.get(name):
            for strategy in WITHIN_M:
                for case in (1, 2, 3, 4):
                    yield pytest.param(autopilot, binary, strategy, case, id=f"{autopilot.__name__}-{strategy}-{case}")


@pytest.mark.timeout(400)
@pytest.mark.parametrize(("autopilot", "binary", "strategy", "case"), list(flights()))
def test_the_victim_is_found(
    autopilot: Callable[[Path, Path], Running], binary: str, strategy: str, case: int, tmp_path: Path
) -> None:
    chosen, port, record = CONFIGS / f"paper_case_{case}.yaml", tmp_path / "receiver", tmp_path / "record"
    flown = autopilot(Path(binary).resolve(), tmp_path)
    programs: list[Program] = []
    try:
        emulator = Program(
            *("run", "--scenario", chosen, "--record", record, "--timeout", 60),
            *("--autopilot", flown.telemetry, "--port", f"pty:{port}"),
        )
        programs.append(emulator)
        emulator.says("frames to")
        search = Program(
            *("search", "--strategy", strategy, "--json", "--timeout", 60, "--record", record),
            *("--autopilot", flown.commands, "--receiver", port),
        )
        programs.append(search)
        assert search.ends(300) == 0, search.err
        outcome = json.loads(search.out)
        emulator.process.terminate()
        assert emulator.ends() == 130, emulator.err
    finally:
        for program in programs:
            program.close()
        flown.close()
    assert outcome["outcome"] == "found"
    assert away(outcome["found"]["lat_lon"], chosen, json.loads((record / "run.json").read_text())) < WITHIN_M[strategy]


def away(lat_lon: list[float], chosen: Path, run: dict[str, Any]) -> float:
    """Horizontal distance [m] from a place to the transmitter where the emulator has put it."""
    (transmitter,) = config.load(str(chosen)).transmitters
    assert transmitter.ned is not None
    datum = run["datum"]
    north, east, _ = LocalFrame(*datum).ned(*lat_lon, datum[2])
    return math.dist((north, east), transmitter.ned[:2])
