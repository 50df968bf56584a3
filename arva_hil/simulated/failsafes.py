"""The failsafes of the built-in vehicle by name, with the texts and the modes of ArduCopter.

https://ardupilot.org/copter/docs/failsafe-landing-page.html
"""

from __future__ import annotations

from typing import Final, NamedTuple

from arva_hil.mavlink.codec import dialect
from arva_hil.simulated.autopilot import Mode


class Failsafe(NamedTuple):
    """The STATUSTEXT of the vehicle, and its mode afterwards if it is armed. `empty`: its battery is empty."""

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
