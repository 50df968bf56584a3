"""Who has the vehicle: which mode was ordered, what it said of its mode last, and whether an order may answer that.

The promise is `BOUND_MS`: once the vehicle's word of a mode that was not ordered has reached this computer, no order
leaves later than that. Three things keep it. The link is read until it is empty before every order (the search client
does so). An order that changes the mode or arms leaves only in answer to news of the mode, at once: who switches
later than that news overrides the order, but for the instant in which both are under way. And after a gap, in which
this program did not run, nothing that came before counts: the vehicle is asked a question (TIMESYNC with a number of
ours), and only what it says of its mode behind the answer is news.
"""

from __future__ import annotations

import math
import secrets
from typing import Any, Final

from arva_hil.mavlink.codec import dialect
from arva_hil.mavlink.dialect import MAVLINK_MSG_ID_CURRENT_MODE

BOUND_MS: Final = 100
_AT_ONCE_S: Final = 0.02  # after the news was read,
_WAITED_S: Final = 0.25  # which had not waited to be read for longer
SILENT_S: Final = 2.5  # without news of the mode: who has the vehicle is not known any more
_ASK_AGAIN_S: Final = 0.3

WANTED: Final = {dialect.MAVLINK_MSG_ID_HEARTBEAT: 10.0, MAVLINK_MSG_ID_CURRENT_MODE: 10.0}
"""What tells the mode, and how often it is asked for, Hz. ArduCopter grants the first, PX4 the second."""


class Authority:
    """Remembers the mode wanted, the modes that come of our orders, and the mode last heard of.

    Times are seconds on the caller's clock. `mode` is -1 before the first news, `wanted` before the first order.
    """

    def __init__(self) -> None:
        self.mode = -1
        self.wanted = -1
        self._ours: frozenset[int] = frozenset()  # empty: any may still be
        self._news_s = -math.inf  # it came after this,
        self._read_s = -math.inf  # and was read then
        self._since = -math.inf  # news is waited for
        self._question = 0  # that was not answered yet
        self._next_question = -math.inf

    def want(self, mode: int, *, ours: bool = True) -> None:
        """This mode is ordered from now on. Not `ours`: the vehicle may be in any until it is in this one."""
        self.wanted = mode
        if ours:
            self._ours |= {mode}

    def borrow(self) -> None:
        """The mode that it is in now is somebody else's, who lets us have the vehicle: it may still be in it."""
        self._ours = frozenset({self.mode})

    @property
    def in_mode(self) -> bool:
        """It is in the mode that is wanted."""
        return self.mode == self.wanted

    @property
    def usurped(self) -> bool:
        """It is in a mode that does not come of an order of ours."""
        return bool(self._ours) and self.mode not in self._ours

    def hear(self, mode: int, since: float, now: float) -> None:
        """The vehicle has said its mode; it came after `since`, and is read `now`."""
        self.mode = mode
        if not self._question:
            self._news_s, self._read_s = since, now
        if self.in_mode:
            self._ours = frozenset({mode})

    def hear_answer(self, message: Any) -> None:
        """A TIMESYNC of the vehicle."""
        if self._question and message.tc1 and message.ts1 == self._question:
            self._question = 0

    def doubt(self, now: float) -> None:
        """Nothing that was heard so far is news."""
        self._question = secrets.randbits(62) | 1
        self._next_question = self._since = now
        self._news_s = -math.inf

    def question(self, now: float) -> Any | None:
        """What to ask the vehicle now; `asked` when it was."""
        if not self._question or now < self._next_question:
            return None
        return dialect.MAVLink_timesync_message(0, self._question)

    def asked(self, now: float) -> None:
        self._next_question = now + _ASK_AGAIN_S

    @property
    def settled(self) -> bool:
        """No doubt is left."""
        return self._news_s > -math.inf

    def fresh(self, now: float) -> bool:
        """The vehicle has just said its mode: an order may answer it."""
        return now - self._read_s <= _AT_ONCE_S and now - self._news_s <= _WAITED_S

    def silent(self, now: float) -> bool:
        """There was no news for so long that nobody knows who has the vehicle."""
        return now - max(self._news_s, self._since) > SILENT_S
