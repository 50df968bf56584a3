"""A search on each autopilot, all in real time and over real links: run, search, one flight, the victim found.

The simulators of others fly only where ARVA_HIL_ARDUCOPTER or ARVA_HIL_PX4 names a binary; a machine without them
still flies the built-in vehicle. They take the loopback ports of one flight: run with `-n 0`, and with `-rP` to read
what came of each. ARVA_SITL_TRANSMITTERS: how many random ones each of them searches for, 2 if nothing is said.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from arva_hil.campaign.plan import draw
from arva_hil.config import load
from arva_hil.config.campaign import Random

from .flight import ArduCopter, BuiltIn, Flown, Maker, Px4, fly

CONFIGS = Path(__file__).parents[2] / "configs"
SIMULATORS: list[tuple[Maker, str]] = [(ArduCopter, "ARVA_HIL_ARDUCOPTER"), (Px4, "ARVA_HIL_PX4")]
WITHIN_M = {"flux": 2.0, "estimate": 1.0}  # of the transmitter, horizontally, by the estimate of the vehicle's place
GPS_M = 5.0  # of the true place from the estimated one: 1.5 m on each axis, and what the autopilot makes of it
HEIGHT_M = 3.0  # the default


def binaries() -> Iterator[tuple[Maker, str]]:
    for autopilot, name in SIMULATORS:
        if binary := os.environ.get(name):
            yield autopilot, binary


def cases() -> Iterator[Any]:
    """Autopilot, its binary, strategy, case of the paper."""
    yield pytest.param(BuiltIn, "", "estimate", 4, id="BuiltIn-estimate-4")
    for autopilot, binary in binaries():
        for strategy in WITHIN_M:
            for case in (1, 2, 3, 4):
                yield pytest.param(autopilot, binary, strategy, case, id=f"{_name(autopilot)}-{strategy}-{case}")


def anywhere() -> Iterator[Any]:
    """Autopilot, its binary, seed."""
    for autopilot, binary in binaries():
        for seed in range(1, int(os.environ.get("ARVA_SITL_TRANSMITTERS", "2")) + 1):
            yield pytest.param(autopilot, binary, seed, id=f"{_name(autopilot)}-{seed}")


def _name(autopilot: Maker) -> str:
    return str(getattr(autopilot, "__name__", autopilot))


def judge(flown: Flown, strategy: str) -> None:
    """In gusts ArduCopter's land detector may never fire: that search fails, and the victim is found all the same."""
    print(flown)
    assert flown.outcome["outcome"] == ("found" if flown.landed else "failed"), flown.said
    assert flown.reported_m < WITHIN_M[strategy]
    assert flown.touchdown_m < WITHIN_M[strategy] + GPS_M
    assert flown.lowest_m > HEIGHT_M / 2


@pytest.mark.timeout(1000)
@pytest.mark.parametrize(("autopilot", "binary", "strategy", "case"), list(cases()))
def test_the_cases_of_the_paper(autopilot: Maker, binary: str, strategy: str, case: int, tmp_path: Path) -> None:
    (transmitter,) = load(str(CONFIGS / f"paper_case_{case}.yaml")).transmitters
    assert transmitter.ned is not None
    place = f"{{id: 1, ned: {list(transmitter.ned)}}}"
    judge(fly(autopilot, Path(binary).resolve(), tmp_path, place, case, "--strategy", strategy), strategy)


@pytest.mark.timeout(1000)
@pytest.mark.parametrize(("autopilot", "binary", "seed"), list(anywhere()))
def test_a_transmitter_anywhere(autopilot: Maker, binary: str, seed: int, tmp_path: Path) -> None:
    (drawn,) = draw(Random(40), seed).transmitters
    assert drawn.ned is not None
    roll, pitch, yaw = drawn.attitude
    place = f"{{id: 1, ned: {list(drawn.ned)}, attitude: {{roll: {roll}, pitch: {pitch}, yaw: {yaw}}}}}"
    judge(fly(autopilot, Path(binary).resolve(), tmp_path, place, seed), "estimate")
