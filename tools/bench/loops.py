"""Closed loops beside real time."""

from __future__ import annotations

import argparse
import gc
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Final

from arva_hil import config
from arva_hil.campaign.trial import Trial, fly
from tools.bench.table import Row

_REACH: Final = {"flux": 500.0, "estimate": 300.0}
_CONFIGS: Final = Path(__file__).parents[2] / "configs"


def closed_loop(strategy: str, trials: int) -> float:
    """Return the seconds searched in a second of one core, over the paper's cases; the take-off does not count."""
    cases = [config.load(str(_CONFIGS / f"paper_case_{case}.yaml")) for case in (1, 2, 3, 4)]
    fly(Trial(strategy, cases[0]))
    gc.freeze()  # as the processes of a campaign do
    start, flown = time.process_time(), 0.0
    for seed in range(trials):
        flown += fly(Trial(strategy, replace(cases[seed % 4], seed=seed))).time_s
    return flown / (time.process_time() - start)


def rows(_: argparse.Namespace) -> Iterator[Row]:
    for strategy, reach in _REACH.items():
        speed = max(closed_loop(strategy, 8) for _ in range(3))
        yield Row(
            f"closed loop ({strategy}), one core", "real time", 1 / speed, 1.0, "s a second", 1 / speed, 1 / reach
        )
