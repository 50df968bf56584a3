"""Who controls the vehicle: the mode that was ordered, the mode that it reports, and the pilot's sticks.

`BOUND_MS` is promised: after a report of a mode that was not ordered has reached this computer, an order leaves within
that time or not at all. Three rules ensure it. Before every order the link is read until it is empty (the search
client does so). An order that arms or changes the mode is sent only immediately after a report of the mode, so a pilot
who switches after that report overrides the order, except while both are on their way. After a gap, in which this
program did not run, earlier reports do not count: the vehicle gets a TIMESYNC with a number of ours, and only reports
that come after its answer are used.
"""

from __future__ import annotations

import math
import secrets
from collections.abc import Sequence
from typing import Any, Final

from arva_hil.mavlink.codec import dialect
from arva_hil.mavlink.dialect import MAVLINK_MSG_ID_CURRENT_MODE

BOUND_MS: Final = 100
_AT_ONCE_S: Final = 0.02  # an order is sent within this time after a report was read,
_WAITED_S: Final = 0.25  # if the report had not waited to be read for longer than this
SILENT_S: Final = 2.5  # without a report of the mode: it is not known any more who controls the vehicle
_ASK_AGAIN_S: Final = 0.3

MODE_WANTED: Final = {dialect.MAVLINK_MSG_ID_HEARTBEAT: 10.0, MAVLINK_MSG_ID_CURRENT_MODE: 10.0}
"""The messages that report the mode, and their rates [Hz]. ArduCopter sends the first, PX4 the second."""


class Authority:
    """Remembers the mode wanted, the modes that our orders may cause, and the mode reported last.

    Times are seconds on the caller's clock. `mode` is -1 before the first report, `wanted` before the first order.
    """

    def __init__(self) -> None:
        self.mode = -1
        self.wanted = -1
        self._ours: frozenset[int] = frozenset()  # empty: every mode may be
        self._news_s = -math.inf  # the last report came after this time,
        self._read_s = -math.inf  # and was read at this time
        self._since = -math.inf  # since when a report is awaited
        self._question = 0  # the number of the unanswered TIMESYNC
        self._next_question = -math.inf

    def want(self, mode: int, *, ours: bool = True) -> None:
        """This mode is ordered from now on. Without `ours` the vehicle may be in any mode until it is in this one."""
        self.wanted = mode
        if ours:
            self._ours |= {mode}

    def borrow(self) -> None:
        """The present mode was set by somebody who hands the vehicle over. It may stay in this mode for now."""
        self._ours = frozenset({self.mode})

    @property
    def in_mode(self) -> bool:
        """Whether it is in the mode that is wanted."""
        return self.mode == self.wanted

    @property
    def usurped(self) -> bool:
        """Whether it is in a mode that our orders do not cause."""
        return bool(self._ours) and self.mode not in self._ours

    def hear(self, mode: int, since: float, now: float) -> None:
        """A report of the mode, which came after `since` and is read `now`."""
        self.mode = mode
        if not self._question:
            self._news_s, self._read_s = since, now
        if self.in_mode:
            self._ours = frozenset({mode})

    def hear_answer(self, message: Any) -> None:
        """The vehicle sent a TIMESYNC."""
        if self._question and message.tc1 and message.ts1 == self._question:
            self._question = 0

    def doubt(self, now: float) -> None:
        """There was a gap: earlier reports do not count any more, and no order is sent before a later one."""
        self._question = secrets.randbits(62) | 1
        self._next_question = self._since = now
        self._news_s = -math.inf

    def question(self, now: float) -> Any | None:
        """The TIMESYNC to send now, if any. Call `asked` after it was sent."""
        if not self._question or now < self._next_question:
            return None
        return dialect.MAVLink_timesync_message(0, self._question)

    def asked(self, now: float) -> None:
        self._next_question = now + _ASK_AGAIN_S

    @property
    def settled(self) -> bool:
        """Whether the reports count: it is known who controls the vehicle."""
        return self._news_s > -math.inf

    def fresh(self, now: float) -> bool:
        """Whether the mode was reported just now, so that an order may be sent."""
        return now - self._read_s <= _AT_ONCE_S and now - self._news_s <= _WAITED_S

    def silent(self, now: float) -> bool:
        """Whether there was no report for so long that it is not known who controls the vehicle."""
        return now - max(self._news_s, self._since) > SILENT_S


_MOVED_US: Final = 75  # 15 % of the way of a stick from its middle
_MIDDLE_US: Final = (1400, 1600)  # of the throttle: LOITER keeps the height
_PULSE_US: Final = (975, 2200)  # pulses outside are not from a radio: ArduPilot's FS_THR_VALUE is 975
_TWICE: Final = 2  # messages in a row, to ignore glitches
_RC: Final = dialect.MAV_SYS_STATUS_SENSOR_RC_RECEIVER

STICKS_WANTED: Final = {dialect.MAVLINK_MSG_ID_RC_CHANNELS: 5.0, dialect.MAVLINK_MSG_ID_SYS_STATUS: 1.0}
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
        self._now = pulses if _PULSE_US[0] <= min(pulses) and max(pulses) <= _PULSE_US[1] else ()
        if not self._marked or not self.known:
            self._times = 0
            return
        self._rest = self._rest or self._now
        by, channel = max([(abs(a - b), n) for n, (a, b) in enumerate(zip(self._now, self._rest, strict=True), 1)])
        self._times = self._times + 1 if by > _MOVED_US else 0
        if self._times >= _TWICE:
            self.channel, self.by_us = channel, by
            self.moved = f"the pilot has moved a stick (channel {channel}, by {by} µs)"
