"""Fits of rehearsed flights with profiles drawn at random: the share of truths in the 95 % intervals.

Each flight has an error of GPS of 1.5 m, wind and noise. A second flight without the error of GPS tells how well the
refitted emulator agrees.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from collections import defaultdict
from dataclasses import replace
from pathlib import Path

import numpy as np

from arva_hil.config import load as load_scenario
from arva_hil.records.comparing import compared, emulated_again, same_frames
from arva_hil.records.fitting import flight_of
from arva_hil.records.fitting.fit import fit
from arva_hil.records.fitting.profile import profile, scenario
from arva_hil.records.fitting.scatter import Gps
from arva_hil.records.reading import load
from tools.real.profiles import drawn
from tools.real.rehearsal import mission, rehearse

GPS = Gps(1.5, 60.0)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=200, help="profiles; default 200")
    parser.add_argument("--first", type=int, default=1, help="seed of the first")
    parser.add_argument("--model", choices=("paper", "pulsed"), default="paper")
    parser.add_argument("--speed", type=float, default=2.0, help="of the flight [m/s]; default 2, eleven minutes")
    options = parser.parse_args()
    inside: dict[str, list[bool]] = defaultdict(list)
    for seed in range(options.first, options.first + options.count):
        with tempfile.TemporaryDirectory() as folder:
            said = one(Path(folder), seed, options.model, options.speed)
        for name, held in said["held"].items():
            inside[name].append(held)
        print(json.dumps(said), flush=True)
    for name, held in inside.items():
        print(f"{name:24} {sum(held):4} of {len(held):4}  {100 * np.mean(held):5.1f} %")
    every = [held for each in inside.values() for held in each]
    print(f"{'all':24} {sum(every):4} of {len(every):4}  {100 * np.mean(every):5.1f} %")


def one(folder: Path, seed: int, model: str, speed: float) -> dict[str, object]:
    """One round trip."""
    chosen, truth = drawn(seed, model)
    points = mission(speed=speed)
    record = rehearse(folder / "first", chosen, points, latency_s=truth["latency"], seed=seed)
    begin = time.process_time()
    found = fit([flight_of(load(record))], model, GPS)
    cpu_s = time.process_time() - begin
    held = {}
    for name, true in truth.items():
        estimate = found.estimates.get(name)
        if estimate is None or not estimate.identified:
            continue
        middle, half = (estimate.low + estimate.high) / 2, (estimate.high - estimate.low) / 2
        off = true - middle
        off = (off + 90) % 180 - 90 if name.endswith("yaw") else off
        held[name] = bool(abs(off) <= half)
    (folder / "p.yaml").write_text(profile(found, [""]))
    (folder / "s.yaml").write_text(scenario(found, "p.yaml"))
    again = replace(chosen, navigation_error=None, seed=seed + 1000)
    second = load(rehearse(folder / "second", again, points[8:24], latency_s=truth["latency"], seed=seed + 1000))
    (receiver,) = second.receivers
    emulated = emulated_again(second, receiver, load_scenario(folder / "s.yaml"))
    (result,) = compared(receiver, emulated.receiver, same_frames(len(emulated.receiver)), emulated.ranges)
    return {
        "seed": seed,
        "held": held,
        "cpu_s": round(cpu_s, 1),
        "readings": found.readings,
        "second_ratio": result.all.ratio if result.all else None,
        "second_scatter_m": result.all.d_scatter_m if result.all else None,
        "doubts": list(found.doubts),
    }


if __name__ == "__main__":
    main()
