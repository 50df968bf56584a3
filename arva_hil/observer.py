"""What the loop tells those who watch it. They get frozen values, and cannot change, slow or stop anything."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from arva_hil.autopilot.mavlink import Packet
from arva_hil.model import Reading
from arva_hil.notice import Notice
from firmware_proto import Frame


@dataclass(frozen=True, slots=True)
class Pose:
    """The receiver's own pose, mount included: NED [m] from the datum, and the matrix receiver → NED."""

    position: NDArray[np.float64]
    rotation: NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Snapshot:
    """One frame: its instant, the pose it was computed from, what was read, what went out."""

    number: int  # 0…
    time_s: float  # its instant, from the start of the run
    boot_s: float | None  # the same instant on the autopilot's clock
    pose: Pose | None  # None: no pose, or one too old
    age_s: float | None  # of the pose
    reading: Reading
    frame: Frame
    sent: bool  # False: nobody takes it, dropped; or a fault keeps it from being sent
    late_s: float  # how long after its instant it was made
    faults: tuple[str, ...] = ()  # that it met


@dataclass(frozen=True, slots=True)
class Status:
    """How things stand, a few times a second."""

    time_s: float
    vehicle: str  # "" before there is one
    rates: Mapping[str, float]  # Hz by message name
    last: Snapshot | None
    frames: int  # that were to be sent
    dropped: int


class Observer:
    """Every method may be left out."""

    def packets(self, now: float, packets: Sequence[Packet]) -> None:
        """Packets as they came, whoever sent them, at `now` on the loop's clock [s]."""

    def frame(self, snapshot: Snapshot) -> None:
        """A frame was made, and sent unless it says else."""

    def wire(self, data: bytes) -> None:
        """These bytes went out."""

    def status(self, status: Status) -> None:
        """How things stand."""

    def notice(self, notice: Notice) -> None:
        """Something to tell a person."""
