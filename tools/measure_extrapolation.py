"""Prints how wrong an attitude is that is told ahead, over recorded flights: what the emulator does, and two others.

    python tools/measure_extrapolation.py FLIGHT.tlog [...]

From each ATTITUDE the one some time later is told: held as it is, turned on by its body rates, and as `PoseTrack` does.
The truth is interpolated between the flight's own samples. Tilt and heading apart: root mean square, p99 and worst.
"""

from __future__ import annotations

import argparse
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from arva_hil.autopilot.following.pose_track import AttitudeSample, PoseTrack, PositionSample
from arva_hil.links.tlog import TlogReader
from arva_hil.mavlink.codec import Parser, dialect
from arva_hil.model.field import LocalFrame

AHEAD_S = (0.1, 0.2, 0.3, 0.5, 0.75, 1.0)
MOST_SAMPLES = 700  # of a flight
PLACE = (46.0, 7.0, 1600.0)
FRAME = LocalFrame(*PLACE)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("flights", nargs="+", type=Path, metavar="FLIGHT.tlog")
    for flight in parser.parse_args().flights:
        measure(flight.name, attitudes(flight))


def attitudes(flight: Path) -> list[AttitudeSample]:
    """Of the flight's autopilot, in order of its time."""
    found: dict[float, AttitudeSample] = {}
    parser = Parser()
    with closing(TlogReader(flight)) as log:
        for record in log:
            for packet in parser.feed(record.raw, whole=True):
                if packet.component == 1 and packet.msgid == dialect.MAVLINK_MSG_ID_ATTITUDE:
                    m = parser.decode(packet)
                    rates = m.rollspeed, m.pitchspeed, m.yawspeed
                    boot = m.time_boot_ms / 1e3
                    found[boot] = AttitudeSample(boot, (m.roll, m.pitch, m.yaw), rates)
    return [found[boot] for boot in sorted(found)]


def measure(name: str, samples: list[AttitudeSample]) -> None:
    truth = Slerp([s.boot for s in samples], Rotation.from_euler("ZYX", [s.angles[::-1] for s in samples]))
    print(f"{name}: degrees, root mean square / p99 / worst")
    for ahead in AHEAD_S:
        some = [s for s in samples if s.boot + ahead <= samples[-1].boot]
        some = some[:: max(1, len(some) // MOST_SAMPLES)]
        held = Rotation.from_euler("ZYX", [s.angles[::-1] for s in some])
        rates = Rotation.from_rotvec(np.array([s.rates for s in some]) * ahead)
        ours = Rotation.from_quat([told(s, ahead) for s in some])
        later = truth([s.boot + ahead for s in some])
        for how, guess in {"held": held, "rates": held * rates, "PoseTrack": ours}.items():
            down = np.array([0.0, 0.0, 1.0])
            cosine = np.sum(guess.inv().apply(down) * later.inv().apply(down), axis=1)
            tilt = np.degrees(np.arccos(np.clip(cosine, -1, 1)))
            turn = guess.as_euler("ZYX")[:, 0] - later.as_euler("ZYX")[:, 0]
            heading = np.degrees(np.abs((turn + np.pi) % (2 * np.pi) - np.pi))
            print(f"  {ahead:4.2f} s ahead, {how:>9}: tilt {spread(tilt)}, heading {spread(heading)}")


def told(sample: AttitudeSample, ahead: float) -> Any:
    """The quaternion (x, y, z, w) that a track tells `ahead` seconds after this sample, the last that it got."""
    track = PoseTrack()
    track.add_position(PositionSample(sample.boot, *PLACE, (0.0, 0.0, 0.0)))
    track.add_attitude(sample)
    state = track.at(sample.boot + ahead, FRAME)
    assert state is not None
    w, x, y, z = state.attitude
    return x, y, z, w


def spread(degrees: Any) -> str:
    return f"{np.sqrt(np.mean(degrees**2)):.1f} / {np.percentile(degrees, 99):.1f} / {degrees.max():.1f}"


if __name__ == "__main__":
    main()
