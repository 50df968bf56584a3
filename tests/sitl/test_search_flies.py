"""A search on each autopilot, all in real time and over real links: run, search, one flight, the victim found.

The simulators fly only where ARVA_HIL_ARDUCOPTER or ARVA_HIL_PX4 names a binary; the built-in vehicle does in
tests/cli/test_search.py. They take the loopback ports of one flight: run with `-n 0`, and with `-rP` to read what came
of each. ARVA_SITL_TRANSMITTERS: how many random ones each of them searches for, 2 if nothing is said.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from arva_hil.campaign.plan import draw
from arva_hil.config import Transmitter, load
from arva_hil.config.campaign import Random
from tools.sitl.fly import fly
from tools.sitl.judge import Flight

CONFIGS = Path(__file__).parents[2] / "configs"
BINARIES = [binary for name in ("ARVA_HIL_ARDUCOPTER", "ARVA_HIL_PX4") if (binary := os.environ.get(name))]
WITHIN_M = {"flux": 2.0, "estimate": 1.0}  # of the transmitter, horizontally, by the estimate of the vehicle's place
GPS_M = 5.0  # of the true place from the estimated one: 1.5 m on each axis, and what the autopilot makes of it


def flights() -> Iterator[Any]:
    """Binary, strategy, transmitter, seed."""
    cases = {case: load(str(CONFIGS / f"paper_case_{case}.yaml")).transmitters[0] for case in (1, 2, 3, 4)}
    for binary in BINARIES:
        name = Path(binary).name
        for strategy in WITHIN_M:
            for case, transmitter in cases.items():
                yield pytest.param(binary, strategy, transmitter, case, id=f"{name}-{strategy}-{case}")
        for seed in range(1, int(os.environ.get("ARVA_SITL_TRANSMITTERS", "2")) + 1):
            yield pytest.param(binary, "estimate", draw(Random(40), seed).transmitters[0], seed, id=f"{name}-{seed}")


@pytest.mark.timeout(1000)
@pytest.mark.parametrize(("binary", "strategy", "transmitter", "seed"), list(flights()))
def test_a_transmitter_is_found(
    binary: str, strategy: str, transmitter: Transmitter, seed: int, tmp_path: Path
) -> None:
    options, there = ["--strategy", strategy], [transmitter]
    judge(fly(Path(binary).resolve(), tmp_path, "anywhere", seed, options, transmitters=there), strategy)


def judge(flown: Flight, strategy: str) -> None:
    """In gusts ArduCopter's land detector may never fire: that search fails, and the victim is found all the same."""
    print(flown)
    assert flown.outcome == ("found" if flown.disarmed else "failed"), flown
    assert flown.reported_m is not None
    assert flown.reported_m < WITHIN_M[strategy]
    assert flown.touchdown_m is not None
    assert flown.touchdown_m < WITHIN_M[strategy] + GPS_M
    assert flown.lowest_m is not None
    assert flown.lowest_m > flown.height_m / 2
