"""The state of one vehicle and its surroundings at one instant, for its receivers."""

from __future__ import annotations

from typing import NamedTuple

from arva_hil.autopilot.following.navigation import VehicleState
from arva_hil.events.reasons import NoPose
from arva_hil.model.field import Transmitters


class Snapshot(NamedTuple):
    """One vehicle among the transmitters, NED from its datum."""

    t: float
    """The instant, on the driver's clock [s]."""
    boot_s: float | None
    """The same instant on the vehicle's clock; None before its first message."""
    pose: VehicleState | None
    """The true state; None if it is unknown or too old."""
    reported: VehicleState | None
    """The state that the vehicle reports; the same object as `pose` if the report counts as true."""
    age_s: float | None
    """The age of the newest true state, also of one that is too old."""
    transmitters: Transmitters
    """The transmitters at this instant."""
    load: float
    """The load of the vehicle's motors, 0…1."""
    lacking: NoPose | None
    """The reason why there is no pose; None if there is one."""
