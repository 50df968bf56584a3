"""The limits of a run: the wire, a pseudo-terminal, the parser of packets, the interpreter; each beside our work."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Final

import numpy as np

from arva_hil.autopilot.following.session import Session
from arva_hil.emulator.receivers import frame_of
from arva_hil.links.pty import PtyLink
from arva_hil.links.tlog import TlogReader
from arva_hil.model.field import Transmitters
from arva_hil.model.receiver import Antennas, Look, PaperReceiver, Pose
from arva_hil.model.receiver.maps import readings
from firmware_proto import encode
from tools.bench.table import Row, ratio
from tools.bench.timing import COMMAND, cpu_of, cpu_of_command

_TIMES: Final = 5_000
_TOGETHER: Final = 20_000  # readings
_BAUD: Final = 115_200
_NO_REACH: Final = math.inf  # these rows give a limit, and promise nothing


def rows(flight: Path) -> Iterator[Row]:
    there = Transmitters(
        (1, 2, 3, 4), np.diag([20.0, 25.0, 30.0])[[0, 1, 2, 0]], np.tile(np.eye(3), (4, 1, 1)), np.ones(4)
    )
    receiver, places, rotation = PaperReceiver(Antennas(), 4), np.zeros((_TOGETHER, 3)), np.eye(3)

    def look(i: int) -> None:
        receiver.look(Look(float(i), Pose(places[i], rotation), there))

    def frame(i: int) -> bytes:
        look(i)
        return encode(frame_of(receiver.show(float(i)), i % 256))

    size = len(frame(0))
    made = 1e6 * cpu_of(lambda: [frame(i) for i in range(_TIMES)]) / _TIMES
    wire = 1e6 * size * 10 / _BAUD
    yield ratio("a frame of 4 channels, made", f"its {size} bytes at {_BAUD} baud", made, wire, "µs", _NO_REACH)
    yield ratio("the same", "written to a pty and read", made, 1e6 * _through_a_pty(bytes(size)), "µs", _NO_REACH)
    alone = 1e6 * cpu_of(lambda: [look(i) for i in range(_TIMES)]) / _TIMES
    turns = np.broadcast_to(rotation, (_TOGETHER, 3, 3))
    many = 1e6 * cpu_of(lambda: readings(places, turns, there)) / _TOGETHER
    yield ratio("a reading, alone", f"one of {_TOGETHER:,} at once", alone, many, "µs", _NO_REACH)
    start, bare = (1e3 * cpu_of_command(words) for words in ([*COMMAND, "run", "--help"], [*COMMAND[:1], "-c", "pass"]))
    yield ratio("run --help", "python -c pass", start, bare, "ms", _NO_REACH)
    whole, parsed, packets = _packets(flight)
    yield ratio("a MAVLink packet → pose track", "the parser alone", whole / packets, parsed / packets, "µs", _NO_REACH)


def _through_a_pty(data: bytes) -> float:
    """Return seconds of CPU there and back; both ends are in this process."""
    with closing(PtyLink()) as near:
        far = os.open(near.path, os.O_RDWR | os.O_NOCTTY)
        try:

            def once() -> None:
                near.write(data)
                os.read(far, 4096)

            return cpu_of(lambda: [once() for _ in range(_TIMES)]) / _TIMES
        finally:
            os.close(far)


def _packets(flight: Path) -> tuple[float, float, int]:
    """Return µs of CPU for all packets of a log, to the pose track and by the parser alone; and their number."""
    records = [record.raw for record in TlogReader(flight)]

    def take(use: bool) -> None:
        session = Session(passive=True)
        for n, raw in enumerate(records):
            if use:
                session.feed(raw, n * 1e-3, whole=True)
            else:
                session.reader.feed(raw, n * 1e-3, whole=True)

    return 1e6 * cpu_of(lambda: take(True)), 1e6 * cpu_of(lambda: take(False)), len(records)
