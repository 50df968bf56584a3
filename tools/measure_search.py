"""How fast closed loops fly: one on one core, and a campaign on one and on two.

    python tools/measure_search.py [--trials 40]

The ratio of the flights' time to the processor's, all of vehicle, emulator and search included, by strategy; then the
same campaign with one process and with two, start-up included, each into an empty folder.
"""

from __future__ import annotations

import argparse
import dataclasses
import gc
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from arva_hil import config
from arva_hil.campaign.trial import Trial, fly
from arva_hil.registry import STRATEGIES

CONFIGS = Path(__file__).parents[1] / "configs"
CASES = [config.load(str(CONFIGS / f"paper_case_{case}.yaml")) for case in (1, 2, 3, 4)]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trials", type=int, default=40, help="of each strategy")
    options = parser.parse_args()
    for strategy in STRATEGIES:
        print(f"{strategy}: {closed_loop(strategy, options.trials):.0f} × real time on one core")
    one, two = (campaign(jobs, options.trials) for jobs in (1, 2))
    print(f"campaign: {one:.1f} s with one process, {two:.1f} s with two: {one / two:.2f} × faster")


def closed_loop(strategy: str, trials: int) -> float:
    """Seconds searched by a processor's second, over the paper's cases; take-off is flown but not counted."""
    fly(Trial(strategy, CASES[0]))
    gc.freeze()  # as the processes of a campaign do
    start, flown = time.process_time(), 0.0
    for seed in range(trials):
        flown += fly(Trial(strategy, dataclasses.replace(CASES[seed % 4], seed=seed))).time_s
    return flown / (time.process_time() - start)


def campaign(jobs: int, trials: int) -> float:
    """Seconds on the wall."""
    with tempfile.TemporaryDirectory() as folder:
        plan = Path(folder, "plan.yaml")
        cases = ", ".join(str(CONFIGS / f"paper_case_{case}.yaml") for case in (1, 2, 3, 4))
        plan.write_text(f"spec: 1\nstrategies: [{', '.join(STRATEGIES)}]\nscenarios: [{cases}]\nseeds: {trials}\n")
        command = [sys.executable, "-m", "arva_hil", "campaign", plan, "--out", f"{folder}/out", "--jobs", str(jobs)]
        start = time.perf_counter()
        subprocess.run(command, check=True, capture_output=True)
        return time.perf_counter() - start


if __name__ == "__main__":
    main()
