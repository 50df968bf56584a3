"""The pilot's sticks and switches, as the autopilot reports them.

RC_CHANNELS has the pulses of a radio, also of one that PX4 does not use. MANUAL_CONTROL has the sticks that PX4 uses:
of the radio, or of a joystick at a ground station. Only messages of the chosen autopilot count: a ground station's own
MANUAL_CONTROL on the link is a request, which the autopilot may not follow.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final

from arva_hil.events.reasons import Reason, Why, because
from arva_hil.mavlink.codec import dialect

_CHANNELS: Final = [f"chan{n}_raw" for n in range(1, 19)]
_STICKS: Final = 4  # of the channels; the others are switches and knobs
_MOVED_US: Final = 75  # a stick has moved: 15 % of its travel from the middle
_SWITCHED_US: Final = 250  # a switch has moved: half the travel of one with three positions
_CENTRE_US: Final = 1500
_MIDDLE_US: Final = (1400, 1600)  # of the throttle: LOITER keeps the height
_PULSE_US: Final = (800, 2200)  # pulses outside are not from a radio, as for ArduPilot
_LOST_US: Final = 975.0  # ArduPilot's default for FS_THR_VALUE
_ABSENT: Final = (0, 0xFFFF)  # pulses of channels that do not exist
_FRESH_S: Final = 2.0  # an older position of the throttle orders nothing
_GONE_S: Final = 4.0  # after this time without a message there is no radio: a silent link is named before
_TWICE: Final = 2  # messages in a row, to ignore glitches
_FULL: Final = 1000  # MANUAL_CONTROL: the end of an axis; the throttle begins at 0
_AXES: Final = ("roll", "pitch", "throttle", "yaw")
_RC: Final = dialect.MAV_SYS_STATUS_SENSOR_RC_RECEIVER

STICKS_WANTED: Final = {
    dialect.MAVLINK_MSG_ID_RC_CHANNELS: 5.0,
    dialect.MAVLINK_MSG_ID_MANUAL_CONTROL: 5.0,
    dialect.MAVLINK_MSG_ID_SYS_STATUS: 1.0,
}
"""The messages to request, and their rates [Hz]."""


def _valid(pulse: int) -> bool:
    return _PULSE_US[0] <= pulse <= _PULSE_US[1]


class _Pulses:
    """Remembers the last pulses [µs] of one kind of message, and the rest of each channel; 0: not known.

    A stick counts by its distance from its rest. A switch counts if it jumps: knobs drift.
    The first message is not used: PX4 sends a MANUAL_CONTROL when it is asked for them, also without any stick.
    """

    def __init__(self) -> None:
        self.now: Sequence[int] = ()
        self._rest = [0] * len(_CHANNELS)
        self._messages = 0
        self._times = 0

    def mark(self) -> None:
        """Take the present pulses as the rest."""
        self._rest, self._times = list(self.now) or [0] * len(_CHANNELS), 0

    def on_pulses(self, pulses: Sequence[int], throttle: int, *, flown: bool) -> tuple[int, int]:
        """Use a message. Returns the channel that was moved, from 1, and how far [µs]; 0 and 0 if none was.

        `throttle`: its channel. `flown`: the vehicle flies, so switches count too. A stick that appears in flight rests
        in its middle, except the throttle.
        """
        self._messages += 1
        sticks = [pulse for pulse in pulses[:_STICKS] if pulse not in _ABSENT]
        known = self._messages > 1 and all(map(_valid, sticks)) and any(map(_valid, pulses))
        self.now = pulses if known else ()
        by, channel = max(
            [(self._moved(n, throttle - 1, flown), n + 1) for n, pulse in enumerate(self.now) if _valid(pulse)],
            default=(0, 0),
        )
        self._times = self._times + 1 if by else 0
        return (channel, by) if self._times >= _TWICE else (0, 0)

    def _moved(self, n: int, throttle: int, flown: bool) -> int:
        """Return the movement of a channel with a valid pulse [µs]; 0 if it has not moved."""
        pulse, stick = self.now[n], n < _STICKS
        if not _valid(self._rest[n]):
            self._rest[n] = _CENTRE_US if flown and stick and n != throttle else pulse
        by = abs(pulse - self._rest[n])
        if by > (_MOVED_US if stick else _SWITCHED_US) and (stick or flown):
            return by
        if not stick:
            self._rest[n] = pulse
        return 0


class Sticks:
    """Remembers whether a stick or a switch has moved since `mark`.

    `moved`: the movement; None without one. `channel`: the one that was moved, from 1. `by_us`: how far, in µs.
    `throttle`: the number of the throttle's channel. `lost_us`: its pulse is lower if the radio is lost. `quality`: the
    channel with the radio's quality, which is no switch; 0: none. `remote`: the autopilot has a remote control that
    works.
    """

    def __init__(self) -> None:
        self.throttle = 3
        self.quality = 0
        self.lost_us = _LOST_US
        self.moved: Reason | None = None
        self.channel = self.by_us = 0
        self.remote = False
        self._had_remote = False  # at the mark
        self._marked = False
        self._radio, self._manual = _Pulses(), _Pulses()
        self._radio_s = -math.inf  # the time of its last message

    def known(self, now: float) -> bool:
        """Return True if there is a radio."""
        return self._usable and bool(self._radio.now) and now - self._radio_s <= _GONE_S

    def throttle_in_middle(self, now: float) -> bool:
        (low, high), us = _MIDDLE_US, self._radio.now
        fresh = self.known(now) and now - self._radio_s <= _FRESH_S
        return fresh and 1 <= self.throttle <= len(us) and low <= us[self.throttle - 1] <= high

    @property
    def _usable(self) -> bool:
        """True if a person moves the channels: not those of a lost radio. PX4 reports an unmapped radio as lost too."""
        return self.remote or not self._had_remote

    def mark(self) -> None:
        """Remember the present position of the sticks as their rest."""
        self._marked, self._had_remote, self.moved = True, self.remote, None
        self._radio.mark()
        self._manual.mark()

    def on_message(self, message: Any, now: float, *, flown: bool = True) -> None:
        """Use one of the messages in `STICKS_WANTED`, received at `now` [s]. `flown`: the vehicle flies."""
        kind = type(message).id
        if kind == dialect.MAVLINK_MSG_ID_SYS_STATUS:
            self.remote = bool(message.onboard_control_sensors_present & message.onboard_control_sensors_health & _RC)
        elif kind == dialect.MAVLINK_MSG_ID_RC_CHANNELS:
            pulses = [0 if n == self.quality > _STICKS else getattr(message, one) for n, one in enumerate(_CHANNELS, 1)]
            if not self._usable or any(0 < us < self.lost_us for us in pulses[self.throttle - 1 : self.throttle]):
                pulses = [0] * len(pulses)
            self._radio_s = now
            channel, by_us = self._radio.on_pulses(pulses, self.throttle, flown=flown)
            self._on_moved(channel, by_us, Why.CHANNEL_MOVED, channel=channel)
        else:
            axes = message.y, message.x, 2 * message.z - _FULL, message.r
            pulses = [_CENTRE_US + axis // 2 if abs(axis) <= _FULL else 0 for axis in axes]
            channel, by_us = self._manual.on_pulses(pulses, _AXES.index("throttle") + 1, flown=flown)
            self._on_moved(channel, by_us, Why.AXIS_MOVED, axis=_AXES[channel - 1])

    def _on_moved(self, channel: int, by_us: int, why: Why, /, **moved: Any) -> None:
        if channel and self._marked:
            self.channel, self.by_us, self.moved = channel, by_us, because(why, **moved, by_us=by_us)
