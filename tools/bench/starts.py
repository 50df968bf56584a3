"""Start-up beside `import numpy`."""

from __future__ import annotations

import argparse
import subprocess
import sys
import time
from collections.abc import Iterator

from tools.bench.stream import playing
from tools.bench.table import Row, ratio
from tools.bench.timing import COMMAND, cpu_of_command, wall_of_command

_NUMPY = [sys.executable, "-c", "import numpy"]
_COMMANDS = ("run", "replay", "search", "campaign")


def rows(_: argparse.Namespace) -> Iterator[Row]:
    numpy = cpu_of_command(_NUMPY)
    for name in _COMMANDS:
        ours = cpu_of_command([*COMMAND, name, "--help"])
        yield ratio(f"arva-hil {name} --help", "import numpy", ours, numpy, "s", 1.0)
    first = min(_first_frame() for _ in range(5))
    numpy = min(wall_of_command(_NUMPY) for _ in range(5))
    yield ratio("arva-hil run to its first frame", "import numpy", first, numpy, "s", 3.0)


def _first_frame() -> float:
    """Return the wall time of the command until its first frame [s], with the stream already flowing."""
    with playing(20.0) as device:
        start = time.perf_counter()
        command = [*COMMAND, "run", "--autopilot", device, "--port", "-", "--rate", "50"]
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, bufsize=0) as child:
            assert child.stdout is not None
            child.stdout.read(1)
            taken = time.perf_counter() - start
            child.terminate()
    return taken
