"""Checks that messages are still from the launched vehicle: another one may have its ids and its place on a link."""

from __future__ import annotations

import math
from typing import Any, Final

from arva_hil.mavlink.codec import dialect
from arva_hil.vehicle.clock_map import ClockMap
from arva_hil.vehicle.navigation import Place, is_zero, offset_m, place_of

_HOME: Final = dialect.MAVLINK_MSG_ID_HOME_POSITION
_POSITION: Final = dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT

Velocity = tuple[float, float, float]  # NED, m/s

_WINDOW_S: Final = 30.0  # of the clock: a vehicle's clock may be slow, and packets may come late
_AHEAD_S: Final = 1.0  # of the expected clock, plus 5 % of a silence
_AHEAD: Final = 0.05
_BEHIND_S: Final = 0.5  # of the newest time: packets do not come in another order
_JUMP_M: Final = 10.0  # an estimator may correct itself by this much, plus 5 m per second
_JUMP_MS: Final = 5.0
_LASTING: Final = 3  # values in a row, so that one wrong value does not count


class Identity:
    """Remembers the clock and the position of one vehicle. `rate`: of its clock relative to ours.

    `why`: the reason, once several messages in a row show that it is another vehicle. `doubtful`: the last value did
    not fit this vehicle.
    """

    def __init__(self, rate: float) -> None:
        self.why = ""
        self._rate = rate
        self._clock = ClockMap(_WINDOW_S)
        self._last: tuple[float, float] | None = None  # boot time, and host time of its arrival
        self._place: tuple[float, Place, Velocity] | None = None
        self._strange_times = 0
        self._strange_places = 0

    @property
    def doubtful(self) -> bool:
        return bool(self._strange_times or self._strange_places or self.why)

    def owns(self, message: Any, now: float) -> bool:
        """Whether a message that navigation handles may be from this vehicle."""
        if message.id == _HOME:
            return True
        boot = message.time_boot_ms / 1e3
        if not self.time(boot, now):
            return False
        if message.id != _POSITION or is_zero(message):
            return True
        return self.place(boot, *place_of(message))

    def time(self, boot: float, now: float) -> bool:
        """Whether its clock may show `boot` [s] now."""
        strange = ""
        if self._last is not None:
            boot_before, before = self._last
            should = self._clock.boot(before)
            assert should is not None
            ahead = boot - should - self._rate * (now - before) * (1 + _AHEAD)
            if ahead > _AHEAD_S:
                strange = f"its clock is {ahead:.1f} s ahead of the one of the vehicle that was launched"
            elif boot < boot_before - _BEHIND_S:
                strange = "it has rebooted, or it is not the vehicle that was launched: its clock has gone back"
        self._strange_times = self._strange_times + 1 if strange else 0
        if self._strange_times >= _LASTING:
            self.why = self.why or strange
        if strange:
            return False
        self._last = max(boot, self._last[0]) if self._last else boot, now
        self._clock.add(now, boot)
        return True

    def place(self, boot: float, place: Place, velocity: Velocity) -> bool:
        """Whether it may be at this place at this boot time."""
        off = 0.0
        if self._place is not None:
            before, there, (north, east, down) = self._place
            gap = max(boot - before, 0.0)
            moved = math.dist(offset_m(there, place), (north * gap, east * gap, down * gap))
            off = moved - _JUMP_M - _JUMP_MS * gap
        self._strange_places = self._strange_places + 1 if off > 0 else 0
        if self._strange_places >= _LASTING:
            self.why = self.why or f"its position has jumped by {off + _JUMP_M:.0f} m, or it is another vehicle"
        if off <= 0:
            self._place = boot, place, velocity
        return off <= 0
