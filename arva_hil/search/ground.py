"""The height of the vehicle above the ground: from its rangefinder, otherwise a safe estimate.

Messages, https://mavlink.io/en/messages/common.html: DISTANCE_SENSOR or ArduPilot's RANGEFINDER measure the height.
ALTITUDE.bottom_clearance, TERRAIN_REPORT and SCALED_PRESSURE do not, but may show that it is less than the estimated
position says. Without a rangefinder TERRAIN_REPORT is followed down a slope, well above it, while it agrees with the
position. A vehicle with neither a rangefinder nor a barometer (SYS_STATUS, and no SCALED_PRESSURE) knows its
height from GPS alone, with the uncertainty GPS_RAW_INT.v_acc.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from statistics import median
from typing import Any, Final, Literal, NamedTuple

from arva_hil.events.searches import HeightSource
from arva_hil.field.quaternion import upright
from arva_hil.mavlink.codec import dialect
from arva_hil.vehicle.pose_track import VehicleState
from arva_hil.vehicle.session import Session

EXTRAS: Final[Mapping[int, float]] = {  # messages to request, Hz
    dialect.MAVLINK_MSG_ID_DISTANCE_SENSOR: 10.0,
    dialect.MAVLINK_MSG_ID_SCALED_PRESSURE: 5.0,
    dialect.MAVLINK_MSG_ID_RANGEFINDER: 10.0,
    dialect.MAVLINK_MSG_ID_ALTITUDE: 5.0,
    dialect.MAVLINK_MSG_ID_TERRAIN_REPORT: 2.0,
    dialect.MAVLINK_MSG_ID_SYS_STATUS: 1.0,
    dialect.MAVLINK_MSG_ID_GPS_RAW_INT: 1.0,
}
_FRESH_S: Final = 1.0
_SURVEY_FRESH_S: Final = 3.0  # of the terrain database
_SURVEY_OFF_M: Final = 10.0  # that the ground may be higher than it says: the relative accuracy of SRTM (90 %)
_PER_DEGREE_M: Final = 111_200.0  # of latitude
_SURVEY_NEW_S: Final = 0.5  # only when so new it is compared with the position
_SURVEY_AGREES_M: Final = (8.0, 2.0)  # its place and height, with the position
_STEEPEST: Final = 2.0  # of a slope: steeper is no ground
_SAMPLES: Final = 3  # of the median, so that a single echo of a bird does not count
_NOT_INVALID: Final = 1  # DISTANCE_SENSOR.signal_quality: 1 is invalid, 0 is unknown
_LEVEL: Final = math.cos(math.radians(30))  # with a larger tilt the beam meets the ground elsewhere
_STUCK_M: Final = 0.5  # of climb or descent while the rangefinder shows the same value
_SMOOTH_S: Final = 5.0  # time constant of the difference between barometer and estimate
_MOST_M: Final = 5.0  # of that difference, because it may be weather
_STEADY: Final = 0.1  # the weight of each further pressure on the ground
_SCALE_M: Final = 29.27 * 273.0  # of the air: height by the logarithm of pressure

_BAROMETER: Final = dialect.MAV_SYS_STATUS_SENSOR_ABSOLUTE_PRESSURE
_HAS_ONE_S: Final = 10.0  # after a pressure, the vehicle has a barometer for this long
_SIGMAS: Final = 3.0  # of the GPS height, added to the height that is held
_GPS_SIGMA_M: Final = 2.0  # without v_acc
_MARGIN_M: Final = (1.5, 15.0)  # at least, at most

_Source = Literal["rangefinder", "estimate", "highest ground", "GPS", "terrain", "doubtful terrain"]


class _Survey(NamedTuple):
    """What the terrain database says: degrees, metres AMSL, metres above the ground."""

    time_s: float
    lat: float
    lon: float
    ground: float
    above: float


class Height(NamedTuple):
    """A height above the ground [m]. `measured`: by a rangefinder; otherwise the lowest that may be true.

    `margin`: how much less [m] it may still be, if only GPS measures it. `ground`: as it is believed to be below, above
    the take-off point [m]; None if nothing tells.
    """

    metres: float
    measured: bool
    margin: float = 0.0
    ground: float | None = None


class Ground:
    """Remembers the last heights [m] of the autopilot's sensors, and the highest ground that they measured.

    `trust_gps`: no margin for a height from GPS alone.
    """

    def __init__(self, session: Session, *, trust_gps: bool = False) -> None:
        self._session = session
        self._range: deque[tuple[float, float]] = deque(maxlen=_SAMPLES)  # when, m
        self._own_kind = False  # whether DISTANCE_SENSOR is received, which has limits
        self._same = (math.nan, 0.0)  # the rangefinder's value, and the descent [m] since it has it
        self._time_s = math.inf  # of the last height
        self._clearance = (-math.inf, 0.0)
        self._survey: _Survey | None = None
        self._compared: _Survey | None = None
        self._doubted = False  # whether the survey has disagreed with the position in this flight
        self._pressure = (-math.inf, 0.0)
        self._barometer: bool | None = None  # whether there is a barometer that works; None: not reported
        self._gps_sigma = _GPS_SIGMA_M
        self._trust_gps = trust_gps
        self._standing: tuple[float, _Survey | None] | None = None  # pressure and survey on the ground
        self._offset = 0.0  # of the barometer from the estimate
        self._offset_s = -math.inf
        self._highest = 0.0  # of the ground, above the take-off point
        self._below: float | None = None  # the ground below, when it was known last
        self._source: _Source | None = None  # reported last
        session.want(EXTRAS)

    def hear(self, now: float) -> None:
        """Use the packets that the session was fed last."""
        for msgid, message in self._session.messages(_HEARD):
            _HEARD[msgid](self, message, now)

    def height(self, now: float, state: VehicleState) -> Height:
        """The height for the flight. `state`: NED from the take-off point."""
        above, sinks = -float(state.position[2]), float(state.velocity[2])
        level = upright(*state.attitude)
        dt, self._time_s = max(0.0, min(now - self._time_s, _FRESH_S)), now
        measured = self._measured(now, level, sinks * dt)
        if measured is not None:
            self._highest = max(self._highest, above - measured)
            self._below = above - measured
            self._tell("rangefinder", now)
            return Height(measured, True, 0.0, self._below)
        rise, margin = self._surveyed(now, above, state), 0.0
        self._below = rise if rise is not None else None if self._doubted else self._below
        base, down_slope = above - self._highest, -math.inf if rise is None else above - rise - _SURVEY_OFF_M
        if self._barometer is False and now - self._pressure[0] > _HAS_ONE_S:
            low, high = _MARGIN_M
            down_slope = -math.inf
            margin = 0.0 if self._trust_gps else max(low, min(_SIGMAS * self._gps_sigma, high))
            self._tell("GPS", now, margin)
        elif self._source in ("rangefinder", "highest ground"):
            self._tell("highest ground", now)
        elif down_slope > base or (rise is not None and self._source == "terrain"):
            self._tell("terrain", now, _SURVEY_OFF_M)
        else:
            self._tell("doubtful terrain" if self._doubted else "estimate", now)
        lowest = min([max(base, down_slope), *self._fears(now, above, max(base, down_slope))])
        return Height(lowest, False, margin, self._below)

    def _surveyed(self, now: float, above: float, state: VehicleState) -> float | None:
        """The ground by the terrain database, above the take-off point, if no rangefinder has ever measured; None if it
        says nothing, is old, or has ever disagreed with the position."""
        survey, standing = self._survey, self._standing[1] if self._standing else None
        measured = self._source in ("rangefinder", "highest ground")
        if survey is None or standing is None or measured or now - survey.time_s > _SURVEY_FRESH_S:
            return None
        north, east = state.position[:2].tolist()
        to_north = (survey.lat - standing.lat) * _PER_DEGREE_M
        to_east = (survey.lon - standing.lon) * _PER_DEGREE_M * math.cos(math.radians(standing.lat))
        rise, height = survey.ground - standing.ground, survey.above - standing.above
        aside, off = _SURVEY_AGREES_M
        if survey is not self._compared and now - survey.time_s <= _SURVEY_NEW_S:
            self._compared = survey
            agrees = math.dist((north, east), (to_north, to_east)) <= aside and abs(height - (above - rise)) <= off
            self._doubted |= not (agrees and abs(rise) <= _STEEPEST * (math.hypot(to_north, to_east) + aside))
        return None if self._doubted else rise

    def _measured(self, now: float, level: float, sunk: float) -> float | None:
        """The rangefinder's height; None without a value, or if it does not change in a climb or descent."""
        fresh = [metres for at, metres in self._range if now - at < _FRESH_S]
        if not fresh or level < _LEVEL:
            return None
        self._same = fresh[-1], self._same[1] + sunk if fresh[-1] == self._same[0] else 0.0
        return median(fresh) * level if abs(self._same[1]) < _STUCK_M else None

    def _fears(self, now: float, above: float, believed: float) -> list[float]:
        """Heights by other sensors, each of which may be true. `believed`: the height without them."""
        fears = []
        if now - self._clearance[0] < _FRESH_S:
            fears.append(self._clearance[1])
        if self._standing is None:
            return fears
        pressure, standing = self._standing
        if self._survey and standing and now - self._survey.time_s < _SURVEY_FRESH_S:
            fears.append(self._survey.above - standing.above)
        at, hpa = self._pressure
        if now - at < _FRESH_S:
            share = 1 - math.exp((self._offset_s - at) / _SMOOTH_S)
            off = _SCALE_M * math.log(pressure / hpa) - above
            self._offset += (max(-_MOST_M, min(off, _MOST_M)) - self._offset) * share
            self._offset_s = at
            fears.append(max(above, believed) + self._offset)
        return fears

    def _on_distance(self, message: Any, now: float) -> None:
        if message.orientation != dialect.MAV_SENSOR_ROTATION_PITCH_270:
            return
        self._own_kind = True
        low, high, cm = message.min_distance, message.max_distance, message.current_distance
        if low <= cm < high and cm > 0 and message.signal_quality != _NOT_INVALID:
            self._range.append((now, cm / 100))

    def _on_rangefinder(self, message: Any, now: float) -> None:
        if not self._own_kind and 0 < message.distance < math.inf:
            self._range.append((now, message.distance))

    def _on_altitude(self, message: Any, now: float) -> None:
        if 0 <= message.bottom_clearance < math.inf:
            self._clearance = now, message.bottom_clearance

    def _on_terrain(self, message: Any, now: float) -> None:
        if message.spacing > 0 and math.isfinite(message.current_height) and math.isfinite(message.terrain_height):
            place = message.lat / 1e7, message.lon / 1e7
            self._survey = _Survey(now, *place, message.terrain_height, message.current_height)
            self._stand(now)

    def _on_pressure(self, message: Any, now: float) -> None:
        if 0 < message.press_abs < math.inf:
            self._pressure = now, message.press_abs
            self._stand(now)

    def _on_status(self, message: Any, now: float) -> None:
        works = message.onboard_control_sensors_present & message.onboard_control_sensors_enabled
        self._barometer = bool(works & message.onboard_control_sensors_health & _BAROMETER)

    def _on_gps(self, message: Any, now: float) -> None:
        if message.v_acc > 0:
            self._gps_sigma = message.v_acc / 1e3

    def _stand(self, now: float) -> None:
        """Use the values of the sensors on the ground, disarmed, as height 0."""
        vehicle = self._session.vehicle
        if vehicle is None or vehicle.armed:
            return
        survey = self._survey if self._survey and now - self._survey.time_s < _SURVEY_FRESH_S else None
        hpa = self._pressure[1]
        if hpa > 0:
            before = self._standing[0] if self._standing else hpa
            self._standing = before + _STEADY * (hpa - before), survey
            self._doubted = False

    def _tell(self, source: _Source, now: float, margin: float = 0.0) -> None:
        if source != self._source:
            self._source = source
            self._session.news.emit(HeightSource(now, source, margin))


_HEARD: Final = {
    dialect.MAVLINK_MSG_ID_DISTANCE_SENSOR: Ground._on_distance,
    dialect.MAVLINK_MSG_ID_RANGEFINDER: Ground._on_rangefinder,
    dialect.MAVLINK_MSG_ID_ALTITUDE: Ground._on_altitude,
    dialect.MAVLINK_MSG_ID_TERRAIN_REPORT: Ground._on_terrain,
    dialect.MAVLINK_MSG_ID_SCALED_PRESSURE: Ground._on_pressure,
    dialect.MAVLINK_MSG_ID_SYS_STATUS: Ground._on_status,
    dialect.MAVLINK_MSG_ID_GPS_RAW_INT: Ground._on_gps,
}
