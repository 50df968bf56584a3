"""Prints what two vehicles with two receivers each cost, held against one with one: CPU time of `arva-hil run`.

    python tools/measure_fleet.py [--seconds 20] [--rounds 3] [--rate 10]

The vehicles are built-in ones, each in a process and on a pseudo-terminal of its own, with position and attitude at
50 Hz. A short run is subtracted from both: what start-up costs. The two are measured by turns; medians are printed.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from statistics import median
from typing import Any

from arva_hil.clock import RealClock
from arva_hil.links.pty import PtyLink
from arva_hil.runtime.loop import run
from arva_hil.simulated.simulator import Simulator
from arva_hil.simulated.vehicle import SimulatedVehicle

SHORT_S = 3.0
HOME = (46.0123, 7.7456, 1650.0)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=20.0, help="of each run; default 20")
    parser.add_argument("--rounds", type=int, default=3, help="of each kind; default 3")
    parser.add_argument("--rate", type=float, default=10.0, help="of each receiver [Hz]; default 10")
    options = parser.parse_args()
    with flying(1) as first, flying(2) as second, tempfile.TemporaryDirectory() as folder:
        one = scenario(Path(folder, "one.yaml"), [first], 1, options.rate)
        two = scenario(Path(folder, "two.yaml"), [first, second], 2, options.rate)
        costs: dict[Path, list[float]] = {one: [], two: []}
        for _ in range(options.rounds):
            for path, cost in costs.items():
                cost.append((cpu(path, options.seconds) - cpu(path, SHORT_S)) / (options.seconds - SHORT_S))
    single, double = (100 * median(cost) for cost in costs.values())
    print(
        f"one vehicle with one receiver: {single:.2f} % of a core; two with two each: {double:.2f} %: "
        f"{double / single:.2f} × (frames {options.rate:g} Hz, {options.rounds} × {options.seconds:g} s each)"
    )


def scenario(path: Path, vehicles: list[str], receivers: int, rate_hz: float) -> Path:
    """A file with these vehicles, by their links, and so many receivers each."""
    ports = ", ".join(f"{{name: r{n}, port: pty, rate_hz: {rate_hz:g}}}" for n in range(receivers))
    lines = ["spec: 2", "transmitters: [{id: 1, ned: [20, 5, 0]}]", "vehicles:"]
    for system, address in enumerate(vehicles, 1):
        lines.append(f"  - {{name: v{system}, system: {system}, autopilot: '{address}', receivers: [{ports}]}}")
    path.write_text("\n".join(lines) + "\n")
    return path


def cpu(path: Path, seconds: float) -> float:
    """CPU seconds of one run."""
    command = [sys.executable, "-m", "arva_hil", "run", "--scenario", str(path), "--duration", str(seconds)]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as child:
        _, status, usage = os.wait4(child.pid, 0)
        child.returncode = os.waitstatus_to_exitcode(status)
    assert child.returncode == 0, f"it has ended with {child.returncode}"
    return usage.ru_utime + usage.ru_stime


@contextmanager
def flying(system: int) -> Iterator[str]:
    """The pty of a vehicle with this system id."""
    said: Any = multiprocessing.Queue()
    process = multiprocessing.Process(target=fly, args=(system, said), daemon=True)
    process.start()
    yield said.get(timeout=60)
    process.terminate()
    process.join()


def fly(system: int, said: Any) -> None:
    with closing(PtyLink()) as link:
        said.put(link.path)
        run([Simulator([SimulatedVehicle(HOME, system)], [link])], RealClock())


if __name__ == "__main__":
    main()
