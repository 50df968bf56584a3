"""Measure the search in Lua on a stand-in for ArduPilot, over flat ground and slopes.

Transmitters 8 to 25 m away, up to 2 m deep, in any attitude; the paper's receiver at 1 Hz; a slope that rises anywhere.
"""

from __future__ import annotations

import argparse
import math
import sys
from pathlib import Path
from random import Random

import numpy as np

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parents[1]))

from arva_hil.config import parse
from arva_hil.emulator.build import receiver, transmitters
from arva_hil.model.field import LocalFrame
from tests.firmware_proto.test_lua_search import Flight

LIMIT_S = 400


def flown(seed: int, rise: float) -> tuple[float, float, float, bool] | None:
    """Error [m], lowest height [m], duration [s], and whether the ± holds; None if nothing was found."""
    random = Random(seed)
    away, bearing, up = random.uniform(8, 25), random.uniform(-math.pi, math.pi), random.uniform(-math.pi, math.pi)
    flight = Flight(hertz=1, ARVS_ENABLE=1)
    flight.ground = lambda north, east: -rise * (north * math.cos(up) + east * math.sin(up))
    north, east = away * math.cos(bearing), away * math.sin(bearing)
    place = [north, east, flight.ground(north, east) + random.uniform(0, 2)]
    pitch, yaw = math.degrees(math.asin(random.uniform(-1, 1))), random.uniform(-180, 180)
    turned = f"attitude: {{roll: 0, pitch: {pitch}, yaw: {yaw}}}"
    chosen = parse(f"seed: {seed}\ntransmitters: [{{id: 1, ned: {place}, {turned}}}]", "drawn")
    flight.receiver, flight.transmitters = receiver(chosen), transmitters(chosen, LocalFrame(47.0, 8.0, 488.0))
    flight.autopilot.range = 2.0
    if not flight.fly(LIMIT_S, until=lambda autopilot: autopilot.place):
        return None
    error = math.dist(flight.autopilot.place[:2], place[:2])
    said = float(flight.said()[-1].rpartition("+-")[2].removesuffix("m"))
    return error, flight.lowest, flight.autopilot.time_ms / 1000, error <= said


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--searches", type=int, default=30, help="on each slope")
    count = parser.parse_args().searches
    for slope_deg in (0, 20, 30):
        flights = [flown(seed, math.tan(math.radians(slope_deg))) for seed in range(count)]
        errors, lowest, durations, sure = np.array([one for one in flights if one]).T
        print(
            f"{slope_deg}°: {len(errors)} of {count} found, error {np.median(errors):.2f} m in the median, "
            f"{errors.max():.2f} m at most, ± right {sure.sum():.0f} times, lowest height {lowest.min():.2f} m, "
            f"{np.median(durations):.0f} s",
            flush=True,
        )


if __name__ == "__main__":
    main()
