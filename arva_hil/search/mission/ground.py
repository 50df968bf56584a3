"""The height above the ground: the lowest one that may be true by all sensors, its control, and the descent.

With a rangefinder the height is measured. Altitudes above the take-off point (estimated position, barometer, GPS) check
it, and replace it above the highest ground that it measured. The vertical speed carries them on between samples. A
terrain database is followed down a slope where no rangefinder has measured, well above it, while it agrees with the
position. A vehicle without a rangefinder and a barometer knows its height from GPS alone, with the uncertainty
GPS_RAW_INT.v_acc.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import combinations
from typing import Final, NamedTuple

from arva_hil.autopilot.following.navigation import VehicleState
from arva_hil.autopilot.following.session import Received, Session
from arva_hil.events import Event
from arva_hil.events.reasons import Reason, Why, because
from arva_hil.events.searches import HeightOrigin, HeightSource, SensorsDisagree, TooLow
from arva_hil.search.mission.height_sensors import (
    AT_REST_M_S,
    FRESH_S,
    Distance,
    HeightSamples,
    HeightSensors,
    Odometry,
    RangeCheck,
    Survey,
)
from arva_hil.search.strategies.plan import SearchPlan
from arva_hil.search.strategies.strategy import STILL, Position, towards
from arva_hil.search.team.team import Teammate

_SURVEY_OFF_M: Final = 10.0  # the ground may be this much higher: the relative accuracy of SRTM (90 %)
_PER_DEGREE_M: Final = 111_200.0  # of latitude
_SURVEY_NEW_S: Final = 0.5  # compare only a newer report with the position
_SURVEY_AGREES_M: Final = (8.0, 2.0)  # largest differences of place and height from the position
_STEEPEST: Final = 2.0  # the steepest slope of the ground
_LEVEL: Final = math.cos(math.radians(30))  # with a larger tilt the beam meets the ground elsewhere

_SHARE: Final = 0.3  # tolerated error of a measured height, as a share of the height wanted
_TOLERANCE_M: Final = (0.3, 0.9)  # least and largest tolerated error
_SILENT_S: Final = 0.3  # an older pose or distance may follow a velocity that has ended
_ASTRAY_M: Final = 2.0  # largest error of such a pose
_JUMP_M: Final = 0.5  # a jump of the estimated position that the vertical speed does not explain
_NOTED_S: Final = 3.0  # report a jump for this time
_SMOOTH_S: Final = 2.0  # time constant of the barometer
_SIGMAS: Final = 3.0  # margin of the GPS height, in sigmas
_MARGIN_M: Final = (1.5, 15.0)  # least and largest margin
_ERRORS_M: Final = {"altitude": 4.0, "barometer": 2.0, "GPS": 4.0}  # without that margin
_WEATHER: Final = 0.01  # m/s: the drift of the barometer
_CLEARANCE_OFF_M: Final = 3.0
_LONG_S: Final = 15.0  # end the search after this time of disagreement
_CONTACT_M: Final = 0.4  # ordered descent at rest after a sink: the vehicle is on the ground
_BEGIN_M: Final = 0.4  # and so much more before a sink begins: link, autopilot and vehicle delay it


class Height(NamedTuple):
    """A height above the ground."""

    metres: float
    """The lowest height that may be true [m]."""
    measured: bool
    """True if a rangefinder measures it."""
    margin: float = 0.0
    """Margin [m] by which the height may be lower, if only GPS measures it."""
    ground: float | None = None
    """Height of the ground below, above the take-off point [m]; None if it is not known."""
    still: bool = False
    """True while sensors disagree or are checked: the vehicle must not fly on."""
    doubt: Reason | None = None
    """The sensors that have disagreed for long: the height is not known."""
    landed: bool = False
    """True if the vehicle is on the ground."""
    unchecked: float = 0.0
    """Part of the height [m] that may be a drift of the rangefinder."""


class _Level:
    """Remembers an altitude by one sensor, as an offset to the climb; and the highest ground by it."""

    def __init__(self) -> None:
        self.offset = self.highest = 0.0
        self._at: float | None = None

    def follow(self, at: float, offset: float, smooth_s: float = 0.0) -> None:
        """Use a sample, taken at the time `at`."""
        if at != self._at:
            share = 1.0 if self._at is None or not smooth_s else 1 - math.exp((self._at - at) / smooth_s)
            self.offset += (offset - self.offset) * share
            self._at = at


class _Motion:
    """The motion by the vehicle's velocity, from `start` on.

    `silent`: the last pose was old. `stalled`: the descent that was ordered at rest [m], negative while a sink may
    begin. `reported`: the estimated altitude minus the climb [m].
    """

    def __init__(self) -> None:
        self.start = Odometry(0.0, 0.0, 0.0, 0.0, (0.0, 0.0))
        self.silent = False
        self.stalled, self.reported = -_BEGIN_M, 0.0
        self._last: Odometry | None = None
        self._climbs = 0.0  # m/s

    def move(self, now: float, state: VehicleState, ordered: float) -> Odometry:
        """Continue until now. `ordered`: velocity down [m/s]."""
        north, east, down = state.position.tolist()
        v_north, v_east, sinks = state.velocity.tolist()
        speed, last = math.hypot(v_north, v_east), self._last
        if last is None:
            last = Odometry(now, -down, 0.0, speed, (0.0, 0.0))
            self.start, self._climbs = last, -sinks
        dt = max(0.0, now - last.time_s)
        climbed, by_position = last.climbed + dt * (self._climbs - sinks) / 2, -down - self.reported
        silent, self.silent = self.silent, state.age_s > _SILENT_S
        if dt > FRESH_S:  # a pause: the velocity meanwhile is not known
            dt, climbed = 0.0, by_position
        elif (silent or self.silent) and abs(by_position - climbed) <= _ASTRAY_M:
            climbed = by_position
        self._climbs = -sinks
        if not self.silent:  # an old pose may be of a vehicle that sinks meanwhile
            if ordered <= 0:
                self.stalled = -_BEGIN_M
            elif abs(sinks) >= AT_REST_M_S:
                self.stalled = 0.0
            elif ordered > 2 * AT_REST_M_S:
                self.stalled += ordered * dt
            else:
                self.stalled = min(self.stalled, 0.0)
        self._last = Odometry(now, climbed, last.flown + dt * speed, speed, (north, east))
        return self._last


class _Terrain:
    """Remembers the report that was compared last, and whether the database was ever `doubted` in this flight."""

    def __init__(self) -> None:
        self.doubted = False
        self._compared: Survey | None = None

    def rise(self, now: float, state: VehicleState, survey: Survey, standing: Survey) -> float | None:
        """Return the ground by the database, above the take-off point; None if it has ever been doubted.

        `standing`: the report on the ground.
        """
        north, east, down = state.position.tolist()
        to_north = (survey.lat - standing.lat) * _PER_DEGREE_M
        to_east = (survey.lon - standing.lon) * _PER_DEGREE_M * math.cos(math.radians(standing.lat))
        rise, height = survey.ground - standing.ground, survey.above - standing.above
        aside, off = _SURVEY_AGREES_M
        if survey is not self._compared and now - survey.time_s <= _SURVEY_NEW_S:
            self._compared = survey
            agrees = math.dist((north, east), (to_north, to_east)) <= aside and abs(height - (-down - rise)) <= off
            self.doubted |= not (agrees and abs(rise) <= _STEEPEST * (math.hypot(to_north, to_east) + aside))
        return None if self.doubted else rise


class Ground:
    """Remembers the heights by the autopilot's sensors, and the highest ground that was measured.

    `emit` gets the events.
    """

    def __init__(self, session: Session, plan: SearchPlan, emit: Callable[[Event], None]) -> None:
        self._sensors = HeightSensors(session)
        self._plan = plan
        least, most = _TOLERANCE_M
        self._range = RangeCheck(max(least, min(_SHARE * plan.height, most)))
        self._levels = {name: _Level() for name in _ERRORS_M}
        self._motion = _Motion()
        self._terrain = _Terrain()
        self._checked: tuple[Odometry, float] | None = None  # at the last checked height, and that height [m]
        self._jump = (-math.inf, 0.0, 0.0)  # of the estimated altitude: noted until when, value and expected value
        self._below: float | None = None  # the last known ground below
        self._source: HeightOrigin | None = None  # the last one reported
        self._disagree: dict[tuple[str, str], float] = {}  # start of the disagreement of each pair
        self._emit = emit

    def on_packets(self, received: Received, now: float) -> None:
        """Use what the session received at `now`."""
        self._sensors.on_packets(received, now)

    def measured(self, now: float) -> float | None:
        """Return the rangefinder's value [m], without a check; None without one."""
        distance = self._sensors.samples(now).distance
        return distance.metres if distance else None

    def height(self, now: float, state: VehicleState, ordered: float = 0.0) -> Height:
        """Return the height for the flight. `state`: NED from the take-off point. `ordered`: velocity down [m/s]."""
        above = -float(state.position[2])
        motion, samples = self._motion.move(now, state, ordered), self._sensors.samples(now)
        clearance, margin = samples.clearance, 0.0
        low, high = _MARGIN_M
        sigma = max(low, min(_SIGMAS * samples.gps_sigma, high))
        altitudes = self._altitudes(now, above, motion, samples)
        measured = self._measured(motion, state, altitudes, samples.distance)
        if measured is not None:
            lowest, self._below = measured, above - measured
            self._report("rangefinder", now)
        else:
            margin = sigma if samples.only_gps and not self._plan.trust_gps else 0.0
            lowest = self._unmeasured(now, state, altitudes, samples, 0.0 if samples.only_gps else sigma)
            if samples.only_gps:
                self._report("GPS", now, margin)
        if clearance is not None and (measured is None or measured - clearance > _CLEARANCE_OFF_M):
            lowest = min(lowest, clearance)
        found: dict[tuple[str, str], tuple[float, float]] = {}
        if samples.distance and (values := self._range.deviation(now)):
            found["rangefinder", "vertical speed"] = values
        if measured is not None and clearance is not None and abs(measured - clearance) > _CLEARANCE_OFF_M:
            found["rangefinder", "autopilot's clearance"] = measured, clearance
        still, doubt = self._compare(now, altitudes, sigma, found)
        landed = samples.landed or self._motion.stalled > _CONTACT_M
        drift = self._range.drift
        if measured is None:
            return Height(lowest, False, margin, self._below, still, doubt, landed)
        return Height(lowest, True, margin, self._below, still or drift.still, doubt, landed, drift.followed)

    def _altitudes(self, now: float, above: float, motion: Odometry, samples: HeightSamples) -> dict[str, float]:
        """Return the altitudes above the take-off point by each sensor [m]. A jump of the estimated one is left out."""
        reported = above - motion.climbed
        change, self._motion.reported = reported - self._motion.reported, reported
        if abs(change) <= _JUMP_M:
            self._levels["altitude"].offset += change
        else:
            self._jump = now + _NOTED_S, above, above - change
        known = ["altitude"]
        for name, sample, smooth_s in ("barometer", samples.pressure, _SMOOTH_S), ("GPS", samples.gps, 0.0):
            if sample:
                self._levels[name].follow(sample.time_s, sample.metres - motion.climbed, smooth_s)
                known.append(name)
        return {name: motion.climbed + self._levels[name].offset for name in known}

    def _measured(
        self, motion: Odometry, state: VehicleState, altitudes: dict[str, float], distance: Distance | None
    ) -> float | None:
        """Return the rangefinder's height, checked; None without one."""
        sure, start = [name for name in altitudes if name != "GPS"], self._motion.start
        if motion.time_s == start.time_s and not self._plan.take_over:
            self._range.begin(start, motion.climbed - max(altitudes[name] for name in sure), sure)
        elif motion.time_s == start.time_s and distance is None:  # the ground may be higher than home: sink no lower
            for name, metres_up in altitudes.items():
                self._levels[name].highest = max(0.0, metres_up - self._plan.height)
        _, x, y, _ = state.attitude
        level = 1 - 2 * (x * x + y * y)  # the cosine of the tilt
        if distance is None or level < _LEVEL:
            self._checked = None
            return None
        old = self._motion.silent or motion.time_s - distance.time_s > _SILENT_S
        if self._checked and old and motion.time_s - self._checked[0].time_s <= FRESH_S:
            then, height = self._checked
            return height + min(0.0, motion.climbed - then.climbed)
        confirmed = {name: altitudes[name] - self._levels[name].highest for name in sure}
        metres = self._range.height(motion, distance.metres * level, distance.sample, confirmed)
        self._checked = None if metres is None else (motion, metres)
        if metres is not None:
            for name, metres_up in altitudes.items():
                self._levels[name].highest = max(self._levels[name].highest, metres_up - metres)
        return metres

    def _unmeasured(
        self, now: float, state: VehicleState, altitudes: dict[str, float], samples: HeightSamples, gps_off: float
    ) -> float:
        """Return the height above the highest ground, or by the terrain database. `gps_off`: the error of GPS [m].

        The database is used only if no rangefinder has ever measured.
        """
        measured = self._source in ("rangefinder", "highest ground")
        rise = self._terrain.rise(now, state, *samples.survey) if samples.survey and not measured else None
        if rise is not None or self._terrain.doubted:
            self._below = rise
        lowest = min(
            metres - self._levels[name].highest + (gps_off if name == "GPS" else 0.0)
            for name, metres in altitudes.items()
        )
        down_slope = -math.inf
        if rise is not None and gps_off:
            down_slope = min(metres for name, metres in altitudes.items() if name != "GPS") - rise - _SURVEY_OFF_M
        if measured:
            source: HeightOrigin = "highest ground"
        elif down_slope > lowest or (rise is not None and self._source == "terrain"):
            source = "terrain"
        else:
            source = "doubtful terrain" if self._terrain.doubted else "estimate"
        if gps_off:
            self._report(source, now, _SURVEY_OFF_M if source == "terrain" else 0.0)
        feared = samples.survey[0].above - samples.survey[1].above if samples.survey else math.inf
        return min(max(lowest, down_slope), feared)

    def _compare(
        self, now: float, altitudes: dict[str, float], sigma: float, found: dict[tuple[str, str], tuple[float, float]]
    ) -> tuple[bool, Reason | None]:
        """Emit each pair that disagrees once. Returns whether sensors disagree, and the pairs that do so for long.

        `found`: the pairs that disagree already, and their values.
        """
        errors = dict(_ERRORS_M, GPS=_ERRORS_M["GPS"] + sigma)
        errors["barometer"] += _WEATHER * (now - self._motion.start.time_s)
        for (one, a), (two, b) in combinations(altitudes.items(), 2):
            if abs(a - b) > errors[one] + errors[two]:
                found[one, two] = a, b
        until, *jump = self._jump
        if now < until:
            found["altitude", "vertical speed"] = jump[0], jump[1]
        for pair in found.keys() - self._disagree.keys():
            self._emit(SensorsDisagree(now, pair[0], found[pair][0], pair[1], found[pair][1]))
        self._disagree = {pair: self._disagree.get(pair, now) for pair in found}
        pairs = [(one, a, two, b) for (one, two), (a, b) in found.items() if now - self._disagree[one, two] >= _LONG_S]
        return bool(found), because(Why.SENSORS_DISAGREE, pairs=pairs) if pairs else None

    def _report(self, source: HeightOrigin, now: float, margin: float = 0.0) -> None:
        if source != self._source:
            self._source = source
            self._emit(HeightSource(now, source, margin))


_GAIN: Final = 1.0  # 1/s; k_z of the paper
_CLIMB: Final = 1.0  # m/s
_SINK: Final = 0.5
# Above the wanted height: fly slower, and stop. The check of a fall of the ground ends higher than that. So the descent
# after it begins vertically, where a rangefinder that is stuck contradicts the vertical speed.
_SLOWER_M: Final = (0.6, 0.9)
_LEAST: Final = 0.5  # below this share of the wanted height the vehicle only climbs
_CLEAR: Final = 0.75  # climb up to this share
_RECOVERY_S: Final = 10.0  # limit of that climb; it begins again after each rise, and with a new margin
_RISE_M: Final = 1.0  # of the height: a rise
_LONGEST_S: Final = 60.0  # limit of that climb in all

LAND_M: Final = (0.5, 1.5)  # the height at which the autopilot lands, with and without a rangefinder
_APPROACH_M_S: Final = 1.0  # the highest horizontal speed in the descent
_ABOVE_M: Final = 0.4  # descend only within this distance of the place
_LOWEST: Final = 0.6  # below this share of the landing height it also lands beside the place
_SETTLED_M: Final = 0.15
_REST_M: Final = 0.5  # stop this far above the landing height
_LAST_SPEED: Final = 0.3  # m/s, down, for the last metres
_LAST_M: Final = 2.0
_WAIT_S: Final = 5.0  # wait this long for the stop
_MOST_DESCENTS: Final = 3  # tries, while another vehicle stays below
_LIMIT_S: Final = 30.0  # plus 5 s a metre; after that it lands where it is


class HeightKeeper:
    """The control of the height above the ground.

    - `too_low`: the vehicle only climbs. `failed`: it does not climb.
    - `pace`: the share of the speed at which the height can follow the ground, before a rangefinder loses it.
    - `wanted`: the height above the ground [m], with the margin of an uncertain height.
    - `ground`: the ground below, down from the take-off point [m]; None if it is not known.
    - `descent`: the one after the search, if it has begun.
    """

    def __init__(self, wanted: float, emit: Callable[[Event], None]) -> None:
        self.too_low = False
        self.failed = False
        self.pace = 1.0
        self.wanted = self.asked = wanted
        self.ground: float | None = None
        self.descent: Descent | None = None
        self._reached = False  # True if the height was reached once, after the climb from the take-off
        self._late_s = self._last_s = math.inf  # when it has failed without a rise, and in any case
        self._risen_m = math.nan  # the height at the last rise
        self._emit = emit

    def velocity(self, time_s: float, height: Height) -> float:
        """Return the vertical velocity [m/s], down. It climbs if the height is not a number."""
        metres, self.wanted = height.metres, self.asked + height.margin
        self.ground = None if height.ground is None else -height.ground
        from_m, to_m = _SLOWER_M
        above = (metres - self.wanted - from_m) / (to_m - from_m) if height.measured else 0.0
        self.pace = 0.0 if height.still else 1.0 - max(0.0, min(above, 1.0))
        enough = (_CLEAR if self.too_low else _LEAST) * self.wanted
        self._reached = self._reached or metres >= _CLEAR * self.wanted
        if metres >= enough:
            self.too_low, self._late_s = False, math.inf
            fastest = 0.0 if height.still else _SINK  # a descent would seem an error of the sensors
            return max(-_CLIMB, min(_GAIN * (metres - self.wanted), fastest))
        if not self.too_low:
            self.too_low, self._late_s = True, time_s + _RECOVERY_S + height.margin / _CLIMB
            self._risen_m, self._last_s = metres, time_s + _LONGEST_S
            if self._reached:
                self._emit(TooLow(time_s, metres, self.wanted))
        elif metres >= self._risen_m + _RISE_M:  # above a falling slope the climb may be long
            self._risen_m, self._late_s = metres, min(max(self._late_s, time_s + _RECOVERY_S), self._last_s)
        self.failed = time_s > self._late_s
        self.pace = 0.0
        return -_CLIMB


class Descent:
    """The descent onto `place` (north, east), in a team onto the nearest place that is free at each step.

    `done`: the autopilot must land now. `blocked`: it cannot land there, because another vehicle stays below; before
    that the descent begins again, twice. `speed`: the highest of the search [m/s].

    The vehicle descends only above the place; elsewhere it first flies there. Low above the place it stops, and then
    only sinks. Above the place it does not fly aside where it may be lower because of a drift.
    """

    def __init__(
        self, place: tuple[float, float], speed: float, start_s: float, height: float, team: Teammate | None = None
    ) -> None:
        self.blocked = False
        self._place = place
        self._speed = min(speed, _APPROACH_M_S)
        self._team = team
        self._tries = 0
        self._begin(start_s, height)

    def _begin(self, start_s: float, height: float) -> None:
        self.done = self._settled = False
        self._late_s = start_s + _LIMIT_S + 5 * max(height, 0.0)
        self._low_s = math.inf
        self._tries += 1

    def velocity(self, time_s: float, position: Position, height: Height) -> tuple[float, float, float]:
        """Return the velocity, NED, m/s."""
        place = self._team.beside(self._place) if self._team else self._place
        velocity = self._towards(place, time_s, position, height)
        if self.done and not self.blocked and self._team and self._team.above_another(position):
            self.blocked = self._tries == _MOST_DESCENTS
            if not self.blocked:
                self._begin(time_s, height.metres)
        return velocity

    def _towards(
        self, place: tuple[float, float], time_s: float, position: Position, height: Height
    ) -> tuple[float, float, float]:
        off = math.dist(position[:2], place)
        floor = LAND_M[not height.measured] + height.margin
        rest = floor + _REST_M
        if height.metres <= rest + 0.1:
            self._low_s = min(self._low_s, time_s)
        waited = time_s - self._low_s
        self._settled |= waited > _WAIT_S or (waited >= 0 and off < _SETTLED_M)
        above = self._settled or off < _ABOVE_M
        low = height.metres <= (floor + 0.1 if above else _LOWEST * floor)
        self.done = self.done or low or height.landed or bool(height.doubt) or time_s > self._late_s
        if self.done:
            return *STILL, 0.0
        fastest = _SINK if height.metres > _LAST_M else _LAST_SPEED
        level = floor if self._settled else rest
        down = max(-_SINK, min(_GAIN * (height.metres - level), fastest))
        if above and height.metres - height.unchecked <= floor:
            return *STILL, down
        return *towards(position, place, self._speed), down if above else min(down, 0.0)
