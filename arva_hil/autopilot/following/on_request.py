"""Messages that a vehicle sends on request: the load of its motors, and the height of the ground.

https://mavlink.io/en/messages/common.html, https://mavlink.io/en/services/terrain.html
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any, Final, Literal

from arva_hil.autopilot.following.session import Received, Session
from arva_hil.events import Event, MotorsHeard, MotorsSilent
from arva_hil.mavlink.codec import dialect
from arva_hil.mavlink.dialect import MAVLINK_MSG_ID_ESC_STATUS

_BATTERY_STATUS: Final = dialect.MAVLINK_MSG_ID_BATTERY_STATUS
_ESC_TELEMETRY: Final = dialect.MAVLINK_MSG_ID_ESC_TELEMETRY_1_TO_4
_VFR_HUD: Final = dialect.MAVLINK_MSG_ID_VFR_HUD
_ASKED_HZ: Final = 4.0
_FRESH_S: Final = 3.0
_SILENT_S: Final = 10.0
_LOWEST_US, _HIGHEST_US = 1000, 2000
_OF_MOTORS: Final = (
    dialect.MAV_BATTERY_FUNCTION_UNKNOWN,
    dialect.MAV_BATTERY_FUNCTION_ALL,
    dialect.MAV_BATTERY_FUNCTION_PROPULSION,
)

_Source = Literal["battery", "controllers", "throttle", "outputs"]
_Part = tuple[_Source, int, float]  # its number; amperes, or a load 0…1


class MotorLoad:
    """Remembers the load of a session's vehicle, 0…1, from the first of these messages that came in the last 3 s.

    With `full_current_a`, the current [A] of all motors at full throttle: BATTERY_STATUS, then ESC_TELEMETRY_1_TO_4 and
    the like (ArduPilot) or ESC_STATUS (PX4). Then the throttle in VFR_HUD, and the mean of the first four outputs in
    SERVO_OUTPUT_RAW. The battery comes before the controllers, because some of these report a constant current.
    The load is 0 before the first message, and stays after the last one. After 10 s without a message there is an
    event. `vehicle`: its name for events.
    """

    def __init__(self, vehicle: str, session: Session, full_current_a: float | None = None) -> None:
        self.load = 0.0
        self._vehicle = vehicle
        self._session = session
        self._told_s = math.inf  # the time of the newest message, or the start of the wait
        self._silent = False
        self._full_a: Final = {"battery": full_current_a, "controllers": full_current_a}
        self._told: dict[_Source, dict[int, tuple[float, float]]] = {}  # by number: time and value
        self._order: list[_Source] = ["throttle", "outputs"]
        asked = [_VFR_HUD]
        if full_current_a is not None:
            self._order = ["battery", "controllers", *self._order]
            asked += [_BATTERY_STATUS, _ESC_TELEMETRY, MAVLINK_MSG_ID_ESC_STATUS]
        session.streams.want(dict.fromkeys(asked, _ASKED_HZ))

    def observe(self, received: Received, now: float) -> list[Event]:
        """Use what the session received at `now`."""
        told = False
        for msgid, message in received.messages(_READERS):
            for source, part, value in _READERS[msgid](message):
                told = True
                self._told.setdefault(source, {})[part] = now, value
        if not told:
            return self._check_silence(now)
        events: list[Event] = [MotorsHeard(now, self._vehicle)] if self._silent else []
        self._told_s, self._silent = now, False
        for source in self._order:
            fresh = [value for at, value in self._told.get(source, {}).values() if now - at <= _FRESH_S]
            if fresh:
                self.load = max(0.0, min(sum(fresh) / (self._full_a.get(source) or 1.0), 1.0))
                break
        return events

    def _check_silence(self, now: float) -> list[Event]:
        if self._session.vehicle is not None:
            self._told_s = min(self._told_s, now)
        if now - self._told_s < _SILENT_S or self._silent:
            return []
        self._silent = True
        return [MotorsSilent(now, self._vehicle, self.load)]


def _battery(m: Any) -> Iterator[_Part]:
    """Use a BATTERY_STATUS. Unknown currents are -1 cA; PX4 sends -100."""
    if m.current_battery >= 0 and m.battery_function in _OF_MOTORS:
        yield "battery", m.id, m.current_battery / 100


def _telemetry(m: Any) -> Iterator[_Part]:
    yield "controllers", m.get_msgId(), sum(m.current) / 100


def _esc_status(m: Any) -> Iterator[_Part]:
    if all(0 <= amperes < math.inf for amperes in m.current):
        yield "controllers", m.index, sum(m.current)


def _hud(m: Any) -> Iterator[_Part]:
    yield "throttle", 0, m.throttle / 100


def _outputs(m: Any) -> Iterator[_Part]:
    pulses = [us for n in range(1, 5) if (us := getattr(m, f"servo{n}_raw"))]
    if pulses and not getattr(m, "port", 0):
        yield "outputs", 0, (sum(pulses) / len(pulses) - _LOWEST_US) / (_HIGHEST_US - _LOWEST_US)


_READERS: Final[dict[int, Callable[[Any], Iterator[_Part]]]] = {
    _BATTERY_STATUS: _battery,
    _ESC_TELEMETRY: _telemetry,
    dialect.MAVLINK_MSG_ID_ESC_TELEMETRY_5_TO_8: _telemetry,
    dialect.MAVLINK_MSG_ID_ESC_TELEMETRY_9_TO_12: _telemetry,
    MAVLINK_MSG_ID_ESC_STATUS: _esc_status,
    _VFR_HUD: _hud,
    dialect.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW: _outputs,
}


LatLon = tuple[float, float]  # degrees, to 1e-7

_EVERY_S: Final = 0.2  # between two requests
_HEIGHTS_M: Final = (-500.0, 9000.0)


class TerrainRequests:
    """Places whose height is wanted (TERRAIN_CHECK), and the answers (TERRAIN_REPORT) in `heights` [m AMSL].

    Each place is requested until the autopilot answers: it may have to fetch its data first.
    """

    def __init__(self, session: Session) -> None:
        self.heights: dict[LatLon, float] = {}
        self._session = session
        self._open: list[LatLon] = []
        self._next_s = -math.inf

    def request(self, places: Sequence[LatLon]) -> None:
        """Request these places from now on."""
        self.heights = {}
        self._open = list(dict.fromkeys(places))

    def on_packets(self, received: Received) -> bool:
        """Use what the session received. Returns True if the last missing answer is among them."""
        if not self._open:
            return False
        low, high = _HEIGHTS_M
        for _, message in received.messages((dialect.MAVLINK_MSG_ID_TERRAIN_REPORT,)):
            place = message.lat / 1e7, message.lon / 1e7
            if message.spacing and low <= message.terrain_height <= high and place in self._open:
                self._open.remove(place)
                self.heights[place] = message.terrain_height
        return not self._open

    def poll(self, now: float) -> bytes:
        """Return the next request, if it is due."""
        if not self._open or now < self._next_s or not self._session.reachable:
            return b""
        self._next_s = now + _EVERY_S
        place = self._open.pop(0)
        self._open.append(place)
        lat, lon = place
        return self._session.encoder.pack(dialect.MAVLink_terrain_check_message(round(lat * 1e7), round(lon * 1e7)))
