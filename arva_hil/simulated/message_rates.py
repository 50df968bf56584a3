"""The regular messages of the built-in vehicle, and their times in µs on its clock."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from arva_hil.mavlink.codec import dialect
from arva_hil.simulated.messages import BUILDERS

_HEARTBEAT: Final = dialect.MAVLINK_MSG_ID_HEARTBEAT
_HEARTBEAT_US: Final = 1_000_000
_SHORTEST_US: Final = 3000

# The messages of each stream of REQUEST_DATA_STREAM.
_GROUPS: Final[dict[int, tuple[int, ...]]] = {
    dialect.MAV_DATA_STREAM_EXTENDED_STATUS: (1, 24),
    dialect.MAV_DATA_STREAM_POSITION: (33, 32),
    dialect.MAV_DATA_STREAM_EXTRA1: (30,),
    dialect.MAV_DATA_STREAM_EXTRA3: (132,),
    dialect.MAV_DATA_STREAM_ALL: (1, 24, 33, 32, 30, 132),
}


class MessageRates:
    """Remembers the interval of each message that is sent, and when it is due.

    `defaults`: message id → Hz, from each boot on, besides the heartbeat. Raises ValueError for an unknown message.
    """

    def __init__(self, defaults: Mapping[int, float]) -> None:
        self._defaults = {_HEARTBEAT: _HEARTBEAT_US} | {msgid: round(1e6 / hz) for msgid, hz in defaults.items()}
        if not all(msgid in BUILDERS and us >= _SHORTEST_US for msgid, us in self._defaults.items()):
            raise ValueError(f"streams {dict(defaults)}: an id the vehicle does not send, or a rate above 333 Hz")
        self.boot(0)

    def boot(self, at: int) -> None:
        """Return to the defaults. The first heartbeat is due at once."""
        self._intervals = self._defaults.copy()
        self._due = {msgid: at + interval for msgid, interval in self._intervals.items()}
        self._due[_HEARTBEAT] = self.next_due = at

    def interval(self, msgid: int) -> int:
        """Return the interval of a message; -1: it is not sent."""
        return self._intervals.get(msgid, -1)

    def take_due(self) -> list[int]:
        """Return the message ids that are due at `next_due`. Changes `next_due` to the next instant."""
        now, due = self.next_due, self._due
        ids = [msgid for msgid, at in due.items() if at == now]
        for msgid in ids:
            due[msgid] = now + self._intervals[msgid]
        self.next_due = min(due.values())
        return ids

    def request(self, msgid: int, interval_us: int, now: int) -> bool:
        """Handle SET_MESSAGE_INTERVAL: 0 is the default, -1 is never. Returns False if it is denied."""
        if msgid not in BUILDERS or (interval_us not in (0, -1) and interval_us < _SHORTEST_US):
            return False
        if interval_us == 0 or (msgid == _HEARTBEAT and interval_us == -1):
            self._set(msgid, self._defaults.get(msgid), now)
        else:
            self._set(msgid, None if interval_us == -1 else interval_us, now)
        return True

    def request_group(self, stream: int, rate_hz: int, now: int) -> None:
        """Handle REQUEST_DATA_STREAM: 0 Hz stops the stream."""
        for msgid in _GROUPS.get(stream, ()):
            self._set(msgid, max(1_000_000 // rate_hz, _SHORTEST_US) if rate_hz else None, now)

    def _set(self, msgid: int, interval: int | None, now: int) -> None:
        if interval is None:
            self._intervals.pop(msgid, None)
            self._due.pop(msgid, None)
        elif self._intervals.get(msgid) != interval:
            self._intervals[msgid] = interval
            self._due[msgid] = now + interval
        self.next_due = min(self._due.values())
