"""The pilot's sticks, for autopilots that ignore them while they follow set-points, as ArduPilot does in GUIDED."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

from arva_hil.mavlink.codec import dialect

_MOVED_US: Final = 75  # 15 % of the way of a stick from its middle
_MIDDLE_US: Final = (1400, 1600)  # of the throttle: LOITER keeps the height
_PULSE_US: Final = (975, 2200)  # pulses outside are not from a radio: ArduPilot's FS_THR_VALUE is 975
_TWICE: Final = 2  # messages in a row, to ignore glitches
_RC: Final = dialect.MAV_SYS_STATUS_SENSOR_RC_RECEIVER

WANTED: Final = {
    dialect.MAVLINK_MSG_ID_RC_CHANNELS: 5.0,
    dialect.MAVLINK_MSG_ID_SYS_STATUS: 1.0,
}
"""The messages to request, and their rates [Hz]."""


class Sticks:
    """Remembers the first four channels at `mark`, and whether one has moved since then.

    `moved`: a text for a person. `throttle`: the number of its channel, from 1. Without a radio nothing moves.
    """

    def __init__(self) -> None:
        self.throttle = 3
        self.moved = ""
        self.channel = self.by_us = 0  # the stick that was moved, from 1, and how far
        self._now: Sequence[int] = ()
        self._rest: Sequence[int] = ()
        self._marked = False
        self._heard = True  # whether the radio's receiver works
        self._times = 0

    @property
    def known(self) -> bool:
        """Whether there is a radio."""
        return self._heard and bool(self._now)

    @property
    def throttle_in_middle(self) -> bool:
        low, high = _MIDDLE_US
        return self.known and 1 <= self.throttle <= len(self._now) and low <= self._now[self.throttle - 1] <= high

    def mark(self) -> None:
        """Remember the present position of the sticks as their rest."""
        self._marked, self._rest, self.moved, self._times = True, self._now, "", 0

    def hear(self, message: Any) -> None:
        """Use one of the messages in `WANTED`."""
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
