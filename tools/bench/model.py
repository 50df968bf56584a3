"""The model: fields and readings at a million points and at one, beside magpylib and beside a loop."""

from __future__ import annotations

import argparse
import os
import tracemalloc
from collections.abc import Iterator
from typing import Any

import magpylib
import numpy as np
from scipy.spatial.transform import Rotation

from arva_hil.emulator.receivers import frame_of
from arva_hil.model.field import Transmitters, dipole_field
from arva_hil.model.receiver import Antennas, Look, PaperReceiver, Pose
from arva_hil.model.receiver.maps import readings
from firmware_proto import encode
from tools.bench.table import Row, cpu_of, ratio, wall_of

MANY = 1_000_000
SINGLE = 5_000
M = 4


def rows(_: argparse.Namespace) -> Iterator[Row]:
    rng = np.random.default_rng(1)
    points = rng.uniform((-60, -60, -5), (60, 60, 0), (MANY, 3))
    places = rng.uniform((-40, -40, 0), (40, 40, 2), (M, 3))
    axes = Rotation.random(M, random_state=1)
    there = Transmitters(tuple(range(M)), places, axes.as_matrix(), np.ones(M))
    dipoles = [
        magpylib.misc.Dipole(position=p, orientation=a, moment=(1, 0, 0)) for p, a in zip(places, axes, strict=True)
    ]

    def ours() -> Any:
        return dipole_field(points, there.positions, there.rotations, there.strengths)

    peer = cpu_of(lambda: magpylib.getH(dipoles, points), 2)
    yield ratio("field of 4 transmitters at 1,000,000 points", "magpylib getH", cpu_of(ours), peer, "s", 0.17)
    tracemalloc.start()
    size = ours().nbytes / 1e6
    most = tracemalloc.get_traced_memory()[1] / 1e6
    tracemalloc.stop()
    yield ratio("its memory", "the result", most, size, "MB", 2.0)

    turns = Rotation.random(MANY, random_state=2).as_matrix()
    receiver = PaperReceiver(Antennas(), M)

    def look(i: int) -> None:
        receiver.look(Look(float(i), Pose(points[i], turns[i]), there))

    def loop() -> None:
        for i in range(SINGLE):
            look(i)

    beside, work = "one after another", "1,000,000 readings (poses × 4 transmitters → integers)"
    each, single = cpu_of(lambda: readings(points, turns, there), 5) / MANY, cpu_of(loop) / SINGLE
    yield ratio(work, beside, 1e6 * each, 1e6 * single, "µs each", 0.05)
    cores = len(os.sched_getaffinity(0))
    each = wall_of(lambda: readings(points, turns, there, threads=cores), 5) / MANY
    yield ratio(
        f"the same on {cores} cores, on the wall", beside, 1e6 * each, 1e6 * wall_of(loop) / SINGLE, "µs each", 0.05
    )

    def whole(i: int) -> None:
        look(i)
        encode(frame_of(receiver.show(float(i)), i % 256))

    full = cpu_of(lambda: list(map(whole, range(SINGLE)))) / SINGLE
    point = points[0]
    single = cpu_of(lambda: [magpylib.getH(dipoles, point) for _ in range(500)]) / 500
    yield ratio(
        "one reading (pose → integers → bytes), 4 transmitters",
        "magpylib getH at one point",
        1e6 * full,
        1e6 * single,
        "µs",
        0.13,
    )
    yield Row("one reading, in µs", "20 µs", 1e6 * full, 20.0, "µs", 1e6 * full, 20.0)
