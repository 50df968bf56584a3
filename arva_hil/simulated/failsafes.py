"""Failsafes of the built-in vehicle, to be triggered by name: the words and the modes that ArduCopter has for them.

https://ardupilot.org/copter/docs/failsafe-landing-page.html
"""

from __future__ import annotations

from typing import Final, NamedTuple

from arva_hil.mavlink.codec import dialect
from arva_hil.simulated.autopilot import Mode


class Failsafe(NamedTuple):
    """What the vehicle says, and the mode it changes to when it is armed. `empty`: its battery is."""

    severity: int
    text: bytes
    mode: Mode
    empty: bool = False


FAILSAFES: Final = {
    "geofence": Failsafe(dialect.MAV_SEVERITY_NOTICE, b"Circle fence breached", Mode.RTL),
    "battery": Failsafe(dialect.MAV_SEVERITY_WARNING, b"Battery 1 is low 14.00V used 4000 mAh", Mode.RTL, empty=True),
    "ekf": Failsafe(dialect.MAV_SEVERITY_CRITICAL, b"EKF Failsafe: changed to LAND Mode", Mode.LAND),
    "radio": Failsafe(dialect.MAV_SEVERITY_WARNING, b"Radio Failsafe - RTL", Mode.RTL),
}
