"""The datum: the place of the scenario's origin."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from arva_hil.autopilot.following.navigation import Place
from arva_hil.autopilot.following.session import Session
from arva_hil.config import Scenario
from arva_hil.events import Event, FrameMade, TooFar
from arva_hil.events.reasons import Reason, Why, because
from arva_hil.mavlink.codec import dialect
from arva_hil.model.field import LocalFrame

HOME_WAIT_S: Final = 5.0  # wait for HOME_POSITION, then use the first valid position
_FAR_M: Final = 1000.0  # if every transmitter is farther away, something is wrong

MOVE_DATUM: Final = frozenset(  # messages between two checks
    {dialect.MAVLINK_MSG_ID_HEARTBEAT, dialect.MAVLINK_MSG_ID_HOME_POSITION, dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT}
)
_SAME_PLACE_M: Final = 100.0  # no signal at this distance
_ARMING_S: Final = 2.0


class DatumChange(NamedTuple):
    """From `time_s` of the run the datum is at `lat_lon_alt`. `why`: empty for the first one."""

    time_s: float
    lat_lon_alt: Place
    why: tuple[Reason, ...]


class Datum:
    """Remembers the present and the earlier places of the scenario's origin.

    A fixed datum stays. `datum: home` follows the vehicle's home until the vehicle arms, because autopilots move their
    home by a metre at first. While the vehicle is armed the datum stays: transmitters do not jump in flight. A new home
    after a landing is a new datum: at once if it is more than 100 m away or the vehicle has rebooted, otherwise when it
    arms again, because PX4 sets its home at each landing, also beside the transmitter that was found.

    Without a HOME_POSITION the first valid position is used after 5 s. A home replaces it. A later position replaces it
    if the vehicle has rebooted or its position has jumped, because the first one was wrong then. Both only while the
    vehicle is disarmed.

    `start`: of the run, on the clock of `update` [s].
    """

    def __init__(self, scenario: Scenario, start: float = 0.0) -> None:
        fixed = scenario.datum
        self.frame: LocalFrame | None = None
        self.changes: list[DatumChange] = []
        self._start = start
        self.fixed = fixed != "home"
        self._flown: Place | None = None
        self._armed: tuple[float, int] | None = None  # when, and the number of reboots until then
        self._has_landed = False  # and has not rebooted since
        self._reboots = 0
        self._provisional = False  # it is a position, not a home
        self._first_position_at: float | None = None
        self._taken_in = (0, 0)  # the number of reboots and jumps when a position was used
        self._far_said = False
        if fixed != "home":
            self._take((fixed.lat, fixed.lon, fixed.alt), start, None)

    @property
    def lla(self) -> Place | None:
        """Its present place."""
        return self.changes[-1].lat_lon_alt if self.changes else None

    @property
    def of_the_flight(self) -> Place | None:
        """The datum when the vehicle was last armed; the present one if it was never armed."""
        return self._flown or self.lla

    def update(self, session: Session, now: float) -> bool:
        """Move the datum if necessary. Returns whether it has changed."""
        if self.fixed:
            return False
        if session.navigation.reboots != self._reboots:
            self._reboots = session.navigation.reboots
            self._has_landed = False
            self._first_position_at = None
        armed = session.vehicle is not None and session.vehicle.armed
        if armed and self._armed is None:
            self._armed = now, self._reboots
            self._flown = self.lla
        elif not armed and self._armed is not None:
            self._has_landed = self._reboots == self._armed[1]  # otherwise a reboot has disarmed it
            self._armed = None
        # autopilots set their home when they arm, and may send it a little later
        arming = self._armed is not None and now - self._armed[0] <= _ARMING_S
        if armed and self.lla and not (self._has_landed and arming):
            return False
        changed = self._take_home(home, now) if (home := session.navigation.home) else self._take_position(session, now)
        if armed:
            self._flown = self.lla
        return changed

    def check_distance(self, made: FrameMade) -> list[Event]:
        """Return an event if a receiver is too far from all transmitters to receive one: once for each place."""
        nearest = made.reading.channels[0]
        away_m = nearest.true_range_m or 0.0
        if made.pose is None or self._far_said or nearest.id is not None or away_m <= _FAR_M:
            return []
        self._far_said = True
        from_datum_m = math.hypot(*made.pose.position[:2].tolist())
        return [TooFar(made.time_s, made.vehicle, made.receiver, from_datum_m, away_m, self.fixed)]

    def _take_home(self, home: Place, now: float) -> bool:
        if home == self.lla:
            self._provisional = False
            return False
        near = self.frame is not None and math.hypot(*self.frame.ned_of(*home)) <= _SAME_PLACE_M
        if near and self._has_landed and self._armed is None:  # it is used when the vehicle arms
            return False
        why = Why.HOME_CAME if self._provisional else Why.HOME_MOVED
        self._provisional = False
        return self._take(home, now, Why.HOME_AFTER_LANDING if self._has_landed else why)

    def _take_position(self, session: Session, now: float) -> bool:
        """Use the first position if no home has come in time."""
        positions, life = session.navigation.track.positions, (self._reboots, session.navigation.jumps)
        if not positions:
            self._first_position_at = None
        if not positions or (self.lla and not (self._provisional and life != self._taken_in)):
            return False
        if self._first_position_at is None:
            self._first_position_at = now
        if now - self._first_position_at < HOME_WAIT_S:
            return False
        why = Why.POSITION_JUMPED if life[0] == self._taken_in[0] else Why.REBOOTED
        self._provisional, self._taken_in = True, life
        return self._take(positions[0].place, now, why)

    def _take(self, place: Place, now: float, why: Why | None) -> bool:
        """Move the datum. Returns whether it was elsewhere before."""
        if place == self.lla:
            return False
        self.changes.append(DatumChange(now - self._start, place, (because(why),) if why and self.lla else ()))
        self._far_said = False
        self.frame = LocalFrame(*place)
        return True
