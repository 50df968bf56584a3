"""The pilot's hands, for autopilots that follow set-points whatever the sticks do, as ArduPilot does in GUIDED."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

from arva_hil.mavlink.codec import dialect

_MOVED_US: Final = 75  # from where it stood: 15 % of a stick's way from its middle
_MIDDLE_US: Final = (1400, 1600)  # of the throttle: LOITER keeps its height
_PULSE_US: Final = (975, 2200)  # what is no pulse of a radio that is heard: ArduPilot's FS_THR_VALUE is 975
_TWICE: Final = 2  # messages in a row: no glitch
_RC: Final = dialect.MAV_SYS_STATUS_SENSOR_RC_RECEIVER

WANTED: Final = {
    dialect.MAVLINK_MSG_ID_RC_CHANNELS: 5.0,
    dialect.MAVLINK_MSG_ID_SYS_STATUS: 1.0,
}
"""What has to be asked for, Hz."""


class Sticks:
    """Remembers where the first four channels stood when they were `mark`ed, and whether one has moved since.

    `moved` says so to a person. `throttle`: its channel, from 1. A radio that is not heard moves nothing.
    """

    def __init__(self) -> None:
        self.throttle = 3
        self.moved = ""
        self.channel = self.by_us = 0  # which one, from 1, and how far
        self._now: Sequence[int] = ()
        self._rest: Sequence[int] = ()
        self._marked = False
        self._heard = True  # the radio's receiver works
        self._times = 0

    @property
    def known(self) -> bool:
        """There is a radio."""
        return self._heard and bool(self._now)

    @property
    def throttle_in_middle(self) -> bool:
        low, high = _MIDDLE_US
        return self.known and 1 <= self.throttle <= len(self._now) and low <= self._now[self.throttle - 1] <= high

    def mark(self) -> None:
        """This is how they stand when nobody moves them."""
        self._marked, self._rest, self.moved, self._times = True, self._now, "", 0

    def hear(self, message: Any) -> None:
        """One of the messages `WANTED`."""
        if type(message).id == dialect.MAVLINK_MSG_ID_RC_CHANNELS:
            self._hear_channels(message)
        else:
            self._heard = not message.onboard_control_sensors_enabled & ~message.onboard_control_sensors_health & _RC

    def _hear_channels(self, message: Any) -> None:
        pulses = message.chan1_raw, message.chan2_raw, message.chan3_raw, message.chan4_raw
        self._now = pulses if all(_PULSE_US[0] <= pulse <= _PULSE_US[1] for pulse in pulses) else ()
        if not self._marked or not self.known:
            self._times = 0
            return
        self._rest = self._rest or self._now
        by, channel = max((abs(a - b), n) for n, (a, b) in enumerate(zip(self._now, self._rest, strict=True), 1))
        self._times = self._times + 1 if by > _MOVED_US else 0
        if self._times >= _TWICE:
            self.channel, self.by_us = channel, by
            self.moved = f"the pilot has moved a stick (channel {channel}, by {by} µs)"
