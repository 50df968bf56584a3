"""Start-up beside `import numpy`, and closed loops beside real time."""

from __future__ import annotations

import gc
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from arva_hil import config
from arva_hil.campaign.trial import Trial, fly
from tools.bench.flight import Motion, playing
from tools.bench.table import Row, ratio
from tools.bench.timing import COMMAND, cpu_of_command, wall_of_command

_NUMPY = [sys.executable, "-c", "import numpy"]
_COMMANDS = ("run", "replay", "search", "campaign")
_REACH = {"flux": 500.0, "estimate": 300.0}


_CONFIGS = Path(__file__).parents[2] / "configs"


def closed_loop(strategy: str, trials: int) -> float:
    """Return the seconds searched in a second of one core, over the paper's cases; the take-off does not count."""
    cases = [config.load(str(_CONFIGS / f"paper_case_{case}.yaml")) for case in (1, 2, 3, 4)]
    fly(Trial(strategy, cases[0]))
    gc.freeze()  # as the processes of a campaign do
    start, flown = time.process_time(), 0.0
    for seed in range(trials):
        flown += fly(Trial(strategy, replace(cases[seed % 4], seed=seed))).time_s
    return flown / (time.process_time() - start)


def helps() -> Iterator[Row]:
    numpy = cpu_of_command(_NUMPY)
    for name in _COMMANDS:
        yield ratio(
            f"arva-hil {name} --help", "import numpy", cpu_of_command([*COMMAND, name, "--help"]), numpy, "s", 1.0
        )


def loops() -> Iterator[Row]:
    for strategy, reach in _REACH.items():
        speed = max(closed_loop(strategy, 8) for _ in range(3))
        yield Row(
            f"closed loop ({strategy}), one core", "real time", 1 / speed, 1.0, "s a second", 1 / speed, 1 / reach
        )


def first_frame(flight: Path) -> Iterator[Row]:
    """Wall time, of the command with the stream already flowing."""
    motion, taken = Motion(flight), []
    for _ in range(5):
        with playing(motion, 20.0) as device:
            start = time.perf_counter()
            command = [*COMMAND, "run", "--autopilot", device, "--port", "-", "--rate", "50"]
            with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, bufsize=0) as child:
                assert child.stdout is not None
                child.stdout.read(1)
                taken.append(time.perf_counter() - start)
                child.terminate()
    numpy = min(wall_of_command(_NUMPY) for _ in range(5))
    yield ratio("arva-hil run to its first frame", "import numpy", min(taken), numpy, "s", 3.0)
