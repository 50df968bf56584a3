"""The newest values of an autopilot's height sensors, from its messages, and the check of its rangefinder.

Messages, https://mavlink.io/en/messages/common.html: DISTANCE_SENSOR or ArduPilot's RANGEFINDER measure the height.
SCALED_PRESSURE and GPS_RAW_INT measure the altitude. TERRAIN_REPORT has the height of a database.
ALTITUDE.bottom_clearance and EXTENDED_SYS_STATE are estimates of the autopilot.

The rangefinder is compared with the vehicle's motion: the ground cannot change where the vehicle does not fly.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Mapping
from statistics import median
from typing import Any, Final, NamedTuple

from arva_hil.autopilot.following.session import Received, Session
from arva_hil.mavlink.codec import dialect

EXTRAS: Final[Mapping[int, float]] = {  # messages to request, Hz
    dialect.MAVLINK_MSG_ID_DISTANCE_SENSOR: 10.0,
    dialect.MAVLINK_MSG_ID_SCALED_PRESSURE: 5.0,
    dialect.MAVLINK_MSG_ID_RANGEFINDER: 10.0,
    dialect.MAVLINK_MSG_ID_ALTITUDE: 5.0,
    dialect.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: 2.0,
    dialect.MAVLINK_MSG_ID_TERRAIN_REPORT: 2.0,
    dialect.MAVLINK_MSG_ID_SYS_STATUS: 1.0,
    dialect.MAVLINK_MSG_ID_GPS_RAW_INT: 1.0,
}
FRESH_S: Final = 1.0  # a sample that is older is not used
_GAP_S: Final = 0.5  # after this gap between two samples the median begins again
_SURVEY_FRESH_S: Final = 3.0  # of the terrain database
_GPS_FRESH_S: Final = 3.0
_HAS_ONE_S: Final = 10.0  # after a pressure, the vehicle has a barometer for this long
_SAMPLES: Final = 3  # of the median, so that a single echo of a bird does not count
_NOT_INVALID: Final = 1  # DISTANCE_SENSOR.signal_quality: 1 is invalid, 0 is unknown
_REACH: Final = 0.9  # of max_distance: some sensors report the limit, with noise, when there is no echo
_STEADY: Final = 0.1  # the weight of each further sample on the ground
_SCALE_M: Final = 29.27 * 273.0  # of the air: height by the logarithm of pressure
_GPS_SIGMA_M: Final = 2.0  # without v_acc
_LANDED_S: Final = 1.0  # of reports before they count
_BAROMETER: Final = dialect.MAV_SYS_STATUS_SENSOR_ABSOLUTE_PRESSURE
_NEVER: Final = -math.inf


class Survey(NamedTuple):
    """A report of the terrain database."""

    time_s: float
    lat: float
    """[degrees]"""
    lon: float
    """[degrees]"""
    ground: float
    """Height of the ground [m AMSL]."""
    above: float
    """Height of the vehicle above the ground [m]."""


class Distance(NamedTuple):
    """A rangefinder's distance."""

    time_s: float
    metres: float
    """Median of the last samples [m]."""
    sample: float
    """The last sample [m]."""


class Altitude(NamedTuple):
    """An altitude above the take-off point."""

    time_s: float
    metres: float


class HeightSamples(NamedTuple):
    """The values of all sensors that are valid at one instant."""

    distance: Distance | None
    """The rangefinder's."""
    clearance: float | None
    """The autopilot's estimate of the height [m]."""
    pressure: Altitude | None
    """The barometer's."""
    gps: Altitude | None
    gps_sigma: float
    """Sigma of GPS [m]."""
    only_gps: bool
    """True if the vehicle reports that it has no barometer."""
    survey: tuple[Survey, Survey] | None
    """The terrain database's last report, and its last one on the ground."""
    landed: bool
    """True if the autopilot has reported for some time that the vehicle is on the ground."""


class _Altimeter(NamedTuple):
    """The last sample of an altimeter, and a mean of those on the ground; None without one."""

    time_s: float = _NEVER
    value: float = 0.0
    standing: float | None = None

    def after(self, time_s: float, value: float, *, stands: bool) -> _Altimeter:
        if not stands:
            return _Altimeter(time_s, value, self.standing)
        before = self.standing
        return _Altimeter(time_s, value, value if before is None else before + _STEADY * (value - before))


class HeightSensors:
    """Remembers the last samples. The samples on the ground, disarmed, are the height 0."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._range: deque[tuple[float, float]] = deque(maxlen=_SAMPLES)  # when, m
        self._own_kind = False  # DISTANCE_SENSOR is received, which has limits
        self._clearance = _NEVER, 0.0
        self._pressure = self._gps = _Altimeter()
        self._gps_sigma = _GPS_SIGMA_M
        self._survey: Survey | None = None
        self._standing_survey: Survey | None = None
        self._barometer: bool | None = None  # there is a barometer that works; None: not reported
        self._landed = (math.inf, _NEVER)  # since when the autopilot reports it, and its last report
        session.streams.want(EXTRAS)

    def on_packets(self, received: Received, now: float) -> None:
        """Use what the session received at `now`."""
        for msgid, message in received.messages(_HANDLERS):
            _HANDLERS[msgid](self, message, now)

    def samples(self, now: float) -> HeightSamples:
        """Return the values that are valid now."""
        distance = pressure = gps = survey = None
        fresh = [metres for at, metres in self._range if now - at < FRESH_S]
        if fresh:
            distance = Distance(self._range[-1][0], median(fresh), fresh[-1])
        clearance_s, clearance = self._clearance
        at, hpa, standing = self._pressure
        if standing is not None and now - at < FRESH_S:
            pressure = Altitude(at, _SCALE_M * math.log(standing / hpa))
        only_gps = self._barometer is False and now - at > _HAS_ONE_S
        at, metres, standing = self._gps
        if standing is not None and now - at < _GPS_FRESH_S:
            gps = Altitude(at, metres - standing)
        if self._survey and self._standing_survey and now - self._survey.time_s < _SURVEY_FRESH_S:
            survey = self._survey, self._standing_survey
        since, last = self._landed
        return HeightSamples(
            distance,
            clearance if now - clearance_s < FRESH_S else None,
            pressure,
            gps,
            self._gps_sigma,
            only_gps,
            survey,
            now - last < FRESH_S and now - since >= _LANDED_S,
        )

    def _on_distance(self, message: Any, now: float) -> None:
        if message.orientation != dialect.MAV_SENSOR_ROTATION_PITCH_270:
            return
        self._own_kind = True
        low, high, cm = message.min_distance, message.max_distance, message.current_distance
        if low <= cm < _REACH * high and cm > 0 and message.signal_quality != _NOT_INVALID:
            self._measure(now, cm / 100)

    def _on_rangefinder(self, message: Any, now: float) -> None:
        if not self._own_kind and 0 < message.distance < math.inf:
            self._measure(now, message.distance)

    def _measure(self, now: float, metres: float) -> None:
        if self._range and now - self._range[-1][0] > _GAP_S:
            self._range.clear()
        self._range.append((now, metres))

    def _on_altitude(self, message: Any, now: float) -> None:
        if 0 <= message.bottom_clearance < math.inf:
            self._clearance = now, message.bottom_clearance

    def _on_terrain(self, message: Any, now: float) -> None:
        if message.spacing > 0 and math.isfinite(message.current_height) and math.isfinite(message.terrain_height):
            place = message.lat / 1e7, message.lon / 1e7
            self._survey = Survey(now, *place, message.terrain_height, message.current_height)
            if self._stands:
                self._standing_survey = self._survey

    def _on_pressure(self, message: Any, now: float) -> None:
        if 0 < message.press_abs < math.inf:
            self._pressure = self._pressure.after(now, message.press_abs, stands=self._stands)

    def _on_gps(self, message: Any, now: float) -> None:
        if message.v_acc > 0:
            self._gps_sigma = message.v_acc / 1e3
        if message.fix_type >= dialect.GPS_FIX_TYPE_3D_FIX:
            self._gps = self._gps.after(now, message.alt / 1e3, stands=self._stands)

    def _on_status(self, message: Any, now: float) -> None:
        works = message.onboard_control_sensors_present & message.onboard_control_sensors_enabled
        self._barometer = bool(works & message.onboard_control_sensors_health & _BAROMETER)

    def _on_state(self, message: Any, now: float) -> None:
        landed = message.landed_state == dialect.MAV_LANDED_STATE_ON_GROUND
        self._landed = (min(self._landed[0], now) if landed else math.inf), now

    @property
    def _stands(self) -> bool:
        return self._session.vehicle is not None and not self._session.vehicle.armed


_HANDLERS: Final = {
    dialect.MAVLINK_MSG_ID_DISTANCE_SENSOR: HeightSensors._on_distance,
    dialect.MAVLINK_MSG_ID_RANGEFINDER: HeightSensors._on_rangefinder,
    dialect.MAVLINK_MSG_ID_ALTITUDE: HeightSensors._on_altitude,
    dialect.MAVLINK_MSG_ID_TERRAIN_REPORT: HeightSensors._on_terrain,
    dialect.MAVLINK_MSG_ID_SCALED_PRESSURE: HeightSensors._on_pressure,
    dialect.MAVLINK_MSG_ID_SYS_STATUS: HeightSensors._on_status,
    dialect.MAVLINK_MSG_ID_GPS_RAW_INT: HeightSensors._on_gps,
    dialect.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: HeightSensors._on_state,
}


_WINDOW_S: Final = 2.0
_STEEPEST: Final = 1.0  # the steepest slope of the ground, except for steps within the tolerance
_SILENT_S: Final = 10.0  # after this time without a sample, lower ground is not accepted
AT_REST_M_S: Final = 0.1  # below this speed the ground has no steps
_NOTED_S: Final = 3.0  # report a possible step for this time
_FORGET: Final = 0.2  # a step up, which may end with a step down, is forgotten at this rate: m per m of flight
_STUCK_M: Final = 0.5  # climb or descent with one repeated value: the rangefinder is stuck
_FOLLOWED: Final = 0.5  # largest slope that the vehicle follows, for which more climb is allowed
_SAME_M: Final = 1.0  # flight with one value after which the ground may have risen
_SAME_SLOPE: Final = 0.2  # slope of that ground
_DRIFTED_M: Final = 1.02  # a fall of the ground that is not followed, before a check
_HOVER_M_S: Final = 0.3
_SETTLE_S: Final = 1.0  # from the stop until the hover counts
_CHECK: Final = 0.8  # √s: duration of a check, over the root of the time since the last one; their errors add up so
_LONGEST_S: Final = 8.0  # the largest duration
_LATE_S: Final = 30.0  # a check that has not ended after this time has failed: the vehicle does not rest
_SUNK_M: Final = 1.0  # climb or descent in that time: the vehicle does not hover
_STEADY_M: Final = 0.1  # largest change of a steady height in that time


class Odometry(NamedTuple):
    """The motion of the vehicle by its velocity."""

    time_s: float
    climbed: float
    """Climb since the start [m]."""
    flown: float
    """Length of the flight over ground since the start [m]."""
    speed: float
    """Speed over ground [m/s]."""
    place: tuple[float, float]
    """North and east [m]."""


class DriftCheck:
    """Remembers how far the ground has fallen by the rangefinder: a drift has the same effect.

    A fall is followed as far as the `tolerance` [m]. Once it is larger the vehicle must hover (`still`), because below
    a hover the ground cannot fall.

    `fallen`: by each altitude, the least fall since the last check [m], from the highest ground. `followed`: the fall
    since then that is followed [m]. `drifts`: the rangefinder's value and the expected value [m] after a check that
    failed.
    """

    def __init__(self, tolerance: float) -> None:
        self.still = False
        self.drifts: tuple[float, float] | None = None
        self.fallen: dict[str, float] = {}
        self.followed = 0.0
        self._tolerance = tolerance
        self._checked_s: float | None = None
        self._last_s = 0.0  # of the last height
        self._asked_s = self._moved_s = 0.0  # when the last check was due, and the end of the last motion
        self._hover: tuple[Odometry, float] | None = None  # motion and height at the start of the hover
        self._crept, self._checks = 0.0, 0  # sum of the changes in all checks that passed [m], and their number

    def height(self, motion: Odometry, height: float, confirmed: Mapping[str, float]) -> float:
        """Return the height above the ground without the fall that must be checked: the largest by any altitude.

        `confirmed`: the height above the highest ground, by each altitude [m].
        """
        falls = {name: max(0.0, height - above) for name, above in confirmed.items()}
        self.fallen |= {name: min(self.fallen.get(name, fall), fall) for name, fall in falls.items()}
        self._checked_s = motion.time_s if self._checked_s is None else self._checked_s
        fall = max(falls[name] - self.fallen[name] for name in falls)
        self.followed = min(fall, self._tolerance)
        lowest = height - (fall - self.followed)
        if not self.still or motion.time_s - self._last_s > FRESH_S:  # without a rangefinder the vehicle flies on
            self._asked_s = motion.time_s
        elif motion.time_s - self._asked_s > _LATE_S and not self.drifts:
            self.drifts = height, lowest
        self.still = self.still or height - lowest > _DRIFTED_M
        self._last_s = motion.time_s
        if not self.still or motion.speed > _HOVER_M_S:
            self._hover, self._moved_s = None, motion.time_s
        elif motion.time_s - self._moved_s < _SETTLE_S:
            return lowest
        elif self._hover is None or abs(motion.climbed - self._hover[0].climbed) > _SUNK_M:
            self._hover = motion, height
        else:
            before, was = self._hover
            since = math.inf if self.drifts else before.time_s - self._checked_s
            duration = min(_CHECK * math.sqrt(since), _LONGEST_S)
            if motion.time_s - before.time_s >= duration:
                self._judge(height, was, motion.climbed - before.climbed)
                self._hover = None
                if not self.drifts:
                    self.fallen, self._checked_s, self.still = falls, motion.time_s, False
        return lowest

    def _judge(self, height: float, was: float, climbed: float) -> None:
        """Compare the height with the one at the start of a hover. Small drifts add up over several checks."""
        change = min(height - was, height - was - climbed, key=abs)
        crept, checks = self._crept + change, self._checks + 1
        if abs(change) > _STEADY_M or abs(crept) > _STEADY_M * math.sqrt(checks):
            self.drifts = height, was
        else:
            self.drifts, self._crept, self._checks = None, crept, checks


class RangeCheck:
    """Remembers the ground and the error of the rangefinder. `tolerance`: of a change of the ground [m]."""

    def __init__(self, tolerance: float) -> None:
        self.drift = DriftCheck(tolerance)
        self._tolerance = tolerance
        self._past: deque[tuple[Odometry, float]] = deque()  # and the ground, above the place of the start [m]
        self._offset = 0.0  # sum of the steps that may be errors of the rangefinder; below 0: a step up
        self._flown = 0.0
        self._same: tuple[float, Odometry] | None = None  # the repeated sample, and the motion at its start
        self._noted: tuple[float, float, float] | None = None  # until when, value and expected value

    def begin(self, motion: Odometry, ground: float, altitudes: Iterable[str]) -> None:
        """Begin with known `ground` at the start [m above it]. By none of the `altitudes` has it fallen yet."""
        self._past.append((motion, ground))
        self.drift.fallen = dict.fromkeys(altitudes, 0.0)

    def deviation(self, now: float) -> tuple[float, float] | None:
        """Return the rangefinder's value that contradicts the motion, and the expected value [m]; None without one."""
        if self._noted is not None and now < self._noted[0]:
            return self._noted[1:]
        return self.drift.drifts

    def height(self, motion: Odometry, metres: float, sample: float, confirmed: Mapping[str, float]) -> float | None:
        """Return the lowest height that may be true; None if the rangefinder is stuck.

        `metres`: as measured; `sample`: the rangefinder's last one; `confirmed`: the height above the highest ground,
        by each altitude.
        """
        if self._same is None or sample != self._same[0]:
            self._same = sample, motion
        since = self._same[1]
        climbed, flown = motion.climbed - since.climbed, motion.flown - since.flown
        if abs(climbed) >= _STUCK_M + _FOLLOWED * flown:
            self._contradict(motion, metres, metres + climbed, lasts=False)
            return None
        self._step(motion, metres)
        unseen = _SAME_SLOPE * max(0.0, flown - _SAME_M)
        return self.drift.height(motion, metres - max(0.0, self._offset), confirmed) - unseen

    def _step(self, motion: Odometry, metres: float) -> None:
        """Compare the ground with the previous one: a change that the flight does not explain is an error."""
        ground, past = motion.climbed - metres, self._past
        while len(past) > 1 and motion.time_s - past[0][0].time_s > _WINDOW_S:
            past.popleft()
        self._offset = min(max(self._offset, 0.0), self._offset + _FORGET * (motion.flown - self._flown))
        self._flown = motion.flown

        most = step = 0.0
        for before, was in past:
            known = motion.time_s - before.time_s <= _SILENT_S
            aside = math.dist(motion.place, before.place) if known else 0.0
            excess = abs(was - ground) - _STEEPEST * aside - self._tolerance
            if excess > most:
                most, step = excess, was - ground
        if most > 0:
            self._offset += step
            lasts = motion.speed < AT_REST_M_S and abs(self._offset) > 2 * self._tolerance
            self._contradict(motion, metres, metres - step, lasts=lasts)
            past.clear()
        past.append((motion, ground))

    def _contradict(self, motion: Odometry, metres: float, expected: float, *, lasts: bool) -> None:
        self._noted = math.inf if lasts else motion.time_s + _NOTED_S, metres, expected
