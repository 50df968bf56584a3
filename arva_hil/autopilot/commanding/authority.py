"""The authority over the vehicle: the mode that was ordered, and the mode that it reports.

`BOUND_MS` is a promise: no order leaves later than that after this computer received a mode that was not ordered. Three
rules ensure it. The search client reads the link until it is empty before each order. An order that arms or changes the
mode is sent only immediately after a report of the mode. So a pilot who switches after that report overrides the order,
except while both are in transmission. Twice a second the vehicle gets a TIMESYNC with a number of ours: late answers
mean a slow link, on which an order could override the pilot. Without an answer at the beginning, and after a gap, in
which this program did not run, only reports after an answer in time are used.
"""

from __future__ import annotations

import math
import random
from enum import Enum, auto
from typing import Any, Final, NamedTuple

from arva_hil.mavlink.codec import dialect
from arva_hil.mavlink.dialect import MAVLINK_MSG_ID_CURRENT_MODE

BOUND_MS: Final = 100
_AT_ONCE_S: Final = 0.02  # send an order within this time after a report was read
_WAITED_S: Final = 0.25  # a report may have waited this long before it was read
_LATE_S: Final = 1.5  # without a report of the mode for this time, the vehicle stops: its last set-point lasts 3 s
SILENT_S: Final = 2.5  # without a report of the mode for this time, the authority is unknown
ANSWER_S: Final = 0.5  # a later answer is late: while it is on its way, so may be a switch of the pilot
_OLDEST_S: Final = 60.0  # of a question that is answered
_SLOW_S: Final = 1.0  # after late answers for this time, the link is slow

MODE_WANTED: Final = {dialect.MAVLINK_MSG_ID_HEARTBEAT: 10.0, MAVLINK_MSG_ID_CURRENT_MODE: 10.0}
"""The messages that report the mode, and their rates [Hz]. ArduCopter sends the first, PX4 the second."""


class Holder(Enum):
    """The side that has the vehicle, by the reports of its mode. `HOLDERS` has the meaning and the transitions."""

    UNKNOWN = auto()
    SEARCH = auto()
    OTHER = auto()


class HolderRule(NamedTuple):
    """One row of the table of holders."""

    meaning: str
    then: tuple[Holder, ...]
    """The holders that may follow."""


HOLDERS: Final = {
    Holder.UNKNOWN: HolderRule(
        "no report of the mode counts, as after a gap: only a question is sent", (Holder.SEARCH, Holder.OTHER)
    ),
    Holder.SEARCH: HolderRule(
        "the search's orders may have caused the mode: orders and set-points are sent", (Holder.UNKNOWN, Holder.OTHER)
    ),
    Holder.OTHER: HolderRule(
        "they cannot have caused it: nothing is sent, and a flight ends", (Holder.UNKNOWN, Holder.SEARCH)
    ),
}


class Authority:
    """Remembers the mode wanted, the modes that our orders may cause, and the mode reported last.

    Times are seconds on the caller's clock. `mode` is -1 before the first report, `wanted` before the first order.
    `borrowed`: the vehicle is still in the mode of a take-over, and does not follow set-points yet.
    """

    def __init__(self) -> None:
        self.mode = -1
        self.wanted = -1
        self.borrowed = False
        self._ours: frozenset[int] = frozenset()  # empty: every mode is allowed
        self._news_s = -math.inf  # the last report came after this time
        self._read_s = -math.inf  # the time at which it was read
        self._since = -math.inf  # start of the wait for a report, and for an answer
        self._doubted = False  # no question since then was answered in time
        self._base = 0  # the number of a question is higher by its time [µs]; drawn by the time of the first one
        self._next_question = self._answered_s = -math.inf
        self._late_s = math.inf  # the first of the late answers since the last one in time

    def want(self, mode: int, *, ours: bool = True) -> None:
        """Request this mode from now on. Without `ours` the vehicle may be in any mode until it is in this one."""
        self.wanted = mode
        if ours:
            self._ours |= {mode}

    def borrow(self) -> None:
        """Accept the present mode, in which the vehicle was handed over, for now."""
        self.borrowed = True
        self._ours = frozenset({self.mode})

    @property
    def in_mode(self) -> bool:
        """True if the vehicle is in the mode that is wanted."""
        return self.mode == self.wanted

    @property
    def usurped(self) -> bool:
        """True if the vehicle is in a mode that our orders cannot have caused."""
        return bool(self._ours) and self.mode not in self._ours

    def on_mode(self, mode: int, since: float, now: float) -> None:
        """Use a report of the mode, sent after `since` and read at `now`."""
        self.mode = mode
        if not self._doubted:
            self._news_s, self._read_s = since, now
        if self.in_mode:
            self._ours, self.borrowed = frozenset({mode}), False

    def on_timesync(self, message: Any, since: float, now: float) -> None:
        """Use a TIMESYNC of the vehicle, received after `since` and read at `now`."""
        asked_s = (message.ts1 - self._base) / 1e6
        oldest_s = max(self._since - 1e-6, now - _OLDEST_S)
        if not (message.tc1 and self._base and oldest_s <= asked_s <= now):  # no answer to a question of ours
            return
        if now - asked_s <= ANSWER_S:
            self._doubted, self._answered_s, self._late_s = False, now, math.inf
        elif since - asked_s > ANSWER_S:  # otherwise this program may have been late to read it
            self._late_s = min(self._late_s, now)

    def begin(self, now: float) -> None:
        """Wait for reports from now on: a flight begins."""
        self._since = now
        if now - self._answered_s > _LATE_S:
            self.doubt(now)

    def doubt(self, now: float) -> None:
        """Handle a gap: earlier reports do not count, and no order is sent before a later report."""
        self._doubted = True
        self._next_question = self._since = now
        self._news_s, self._late_s = -math.inf, math.inf

    def question(self, now: float) -> Any | None:
        """Return the TIMESYNC to send now, if any. Call `asked` after it was sent."""
        if now < self._next_question:
            return None
        self._base = self._base or random.Random(now).getrandbits(60)
        return dialect.MAVLink_timesync_message(0, self._base + int(now * 1e6))

    def asked(self, now: float) -> None:
        self._next_question = now + ANSWER_S

    @property
    def holder(self) -> Holder:
        """The side that has the vehicle."""
        if not self.settled:
            return Holder.UNKNOWN
        return Holder.OTHER if self.usurped else Holder.SEARCH

    @property
    def settled(self) -> bool:
        """True if the reports count: the authority over the vehicle is known."""
        return self._news_s > -math.inf

    def fresh(self, now: float) -> bool:
        """Return True if the mode was reported just now, so that an order may be sent."""
        quick = self._late_s == math.inf
        return quick and now - self._read_s <= _AT_ONCE_S and now - self._news_s <= _WAITED_S

    def late(self, now: float) -> bool:
        """Return True if the next report is late: it may be the pilot's mode, or the last report of all."""
        return now - max(self._news_s, self._since) > _LATE_S or self._late_s < math.inf

    def silent(self, now: float) -> bool:
        """Return True if the authority over the vehicle is unknown: the last report is old, or the link is slow."""
        return now - max(self._news_s, self._since) > SILENT_S or now - self._late_s > _SLOW_S

    def slow(self, now: float) -> bool:
        """Return True if the link is too slow: orders could override the pilot."""
        return now - self._late_s > _SLOW_S
