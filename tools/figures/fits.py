"""Fits of rehearsed flights with profiles drawn at random: the share of truths in the 95 % intervals.

Each flight has an error of GPS of 1.5 m, wind and noise. A second flight without the error of GPS tells how well the
refitted emulator agrees: its median ratio of d is 1 within the scatter of the first flight's residuals. The results
are added to a file, a line each, and what is in the file already is not computed again.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from arva_hil.config import load as load_scenario
from arva_hil.records.comparing import compared, emulated_again
from arva_hil.records.fitting import flight_of
from arva_hil.records.fitting.fit import fit
from arva_hil.records.fitting.profile import profile, scenario
from arva_hil.records.fitting.scatter import Gps
from arva_hil.records.reading import load
from tools.figures.rehearsal import drawn, misses, mission, rehearse
from tools.options import parser

GPS = Gps(1.5, 60.0)


def main() -> None:
    made = parser(
        __doc__,
        count=(200, "profiles"),
        first=(1, "seed of the first"),
        model=("paper", "of the receiver, or pulsed"),
        speed=(2.0, "of the flight [m/s]; 2 flies for eleven minutes"),
    )
    made.add_argument("out", type=Path, help="a file with a line of JSON for each fit")
    options = made.parse_args()
    done = _done(options.out)
    with options.out.open("a") as out:
        for seed in range(options.first, options.first + options.count):
            if seed in {said["seed"] for said in done}:
                continue
            with tempfile.TemporaryDirectory() as folder:
                said = one(Path(folder), seed, options)
            print(json.dumps(said), file=out, flush=True)
            done.append(said)
    tell(done)


def _done(path: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []


def tell(done: Sequence[dict[str, Any]]) -> None:
    """Print a row for each parameter: identified, inside, and the median and the spread of its misses."""
    misses: dict[str, list[float]] = defaultdict(list)
    for said in done:
        for name, miss in said["misses"].items():
            misses[name].append(miss)
    misses["all"] = [miss for each in misses.values() for miss in each]
    print(f"{len(done)} fits; misses in half widths of the interval: 0 and 0.51 are ideal")
    for name, each in misses.items():
        inside = np.abs(each) <= 1
        print(
            f"{name:24} {inside.sum():5} of {len(each):5}  {100 * inside.mean():5.1f} %  "
            f"median {np.median(each):+.2f}  rms {np.sqrt(np.mean(np.square(each))):.2f}"
        )
    agreeing = [abs((said["second_ratio"] or 0.0) - 1) <= said["scatter"] for said in done]
    print(f"second flight agrees within the scatter: {sum(agreeing)} of {len(agreeing)}")
    print(f"with doubts: {sum(bool(said['doubts']) for said in done)}")
    cpu_s = [said["cpu_s"] for said in done]
    print(f"CPU of a fit: median {np.median(cpu_s):.1f} s, {max(cpu_s)} s at most")


def one(folder: Path, seed: int, options: argparse.Namespace) -> dict[str, Any]:
    """One round trip."""
    chosen, truth = drawn(seed, options.model)
    points = mission(speed=options.speed)
    record = rehearse(folder / "first", chosen, points, latency_s=truth["latency"], seed=seed)
    begin = time.process_time()
    found = fit([flight_of(load(record))], options.model, GPS)
    cpu_s = time.process_time() - begin
    (folder / "p.yaml").write_text(profile(found, [""]))
    (folder / "s.yaml").write_text(scenario(found, "p.yaml"))
    again = replace(chosen, navigation_error=None, seed=seed + 1000)
    later = [point._replace(time_s=point.time_s - points[8].time_s) for point in points[8:24]]
    second = load(rehearse(folder / "second", again, later, latency_s=truth["latency"], seed=seed + 1000))
    (receiver,) = second.receivers
    emulated = emulated_again(second, receiver, load_scenario(folder / "s.yaml"))
    (result,) = compared(receiver, emulated.receiver, emulated.pairs, emulated.ranges)
    return {
        "seed": seed,
        "misses": {name: round(miss, 3) for name, miss in misses(found.estimates, truth).items()},
        "scatter": found.d_scatter,
        "cpu_s": round(cpu_s, 1),
        "readings": found.readings,
        "second_ratio": result.all.ratio if result.all else None,
        "second_scatter_m": result.all.d_scatter_m if result.all else None,
        "doubts": list(found.doubts),
    }
