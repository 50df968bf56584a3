"""A relay between a search and a simulator, which records each message with its time; and a pilot on it."""

from __future__ import annotations

import contextlib
import gc
import math
import os
import random
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from typing import Any, Final, NamedTuple

from arva_hil.clock import RealClock
from arva_hil.links import Link, LinkError
from arva_hil.mavlink.codec import Encoder, Parser, command, decode, dialect
from arva_hil.mavlink.dialect import MAVLINK_MSG_ID_CURRENT_MODE

SPACING_M: Final = 30  # TERRAIN_SPACING
PER_DEGREE_M: Final = 111_318.8  # of latitude, ArduPilot's
TRUTH_US: Final = 50_000  # between two true places
GPS_S: Final = 30.0
_DATAGRAM: Final = 1024  # bytes
_LOOK_S: Final = 0.01  # between two reads of silent links
_LAND: Final = (9, 0), (4, 6)  # modes of ArduCopter and PX4
_SIM_STATE: Final = dialect.MAVLINK_MSG_ID_SIM_STATE
_TRUTH: Final = (_SIM_STATE, dialect.MAVLINK_MSG_ID_HIL_STATE_QUATERNION)
ORDERS: Final = (
    dialect.MAV_CMD_COMPONENT_ARM_DISARM,
    dialect.MAV_CMD_DO_SET_MODE,
    dialect.MAV_CMD_NAV_TAKEOFF,
    dialect.MAV_CMD_NAV_LAND,
)


def run_first() -> None:
    """Let all threads of this program run before others, without pauses: neither must look like a late search.

    Raises PermissionError without the right to do so. Programs that it starts get `run_as_others`.
    """
    gc.disable()  # it would visit all notes, which takes 0.2 s after some minutes
    os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(1))


def run_as_others() -> None:
    """Undo `run_first` in a started process."""
    os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


class Note(NamedTuple):
    """`time_s`: of a message from the search, when its link was last empty; of others, when the search had it."""

    time_s: float
    up: bool  # from the search
    message: Any


class Place(NamedTuple):
    """A true place: degrees, degrees, metres above mean sea level."""

    time_s: float
    lat: float
    lon: float
    alt: float


class Slope(NamedTuple):
    """Ground that rises to the north, `rise` m a metre, as ArduPilot's terrain data: whole metres every SPACING_M."""

    rise: float
    lat: float  # of home, and the height there, about
    alt: float

    def data(self, request: Any) -> Iterator[Any]:
        """Return the answer to a TERRAIN_REQUEST: 7 rows to the north, each of 8 squares of 4 × 4 heights."""
        for bit in range(56):
            if request.mask >> bit & 1:
                south = (request.lat / 1e7 - self.lat) * PER_DEGREE_M + bit // 8 * 4 * request.grid_spacing
                heights = [round(self.alt + self.rise * (south + i // 4 * request.grid_spacing)) for i in range(16)]
                place = request.lat, request.lon
                yield dialect.MAVLink_terrain_data_message(*place, request.grid_spacing, bit, heights)


class Weather:
    """For ArduPilot's simulator. Once `begun`, the error of its GPS walks: a Gauss-Markov process on each axis."""

    def __init__(self, seed: int, wind: float = 5.0, gps: float = 1.5) -> None:
        self.begun = False
        self._wind, self._gps = wind, gps
        self._draw = random.Random(f"weather {seed}")
        self._direction = self._draw.uniform(0, 360)
        self._error = [0.0, 0.0, 0.0]

    def parameters(self) -> Mapping[str, float]:
        """Return the parameters of the next second."""
        keep = math.exp(-1 / GPS_S)
        if self.begun:
            self._error = [e * keep + self._draw.gauss(0, self._gps) * math.sqrt(1 - keep**2) for e in self._error]
        north, east, up = self._error
        return {
            "SIM_WIND_SPD": self._wind,
            "SIM_WIND_DIR": self._direction,
            "SIM_WIND_TURB": 1.0,
            "SIM_GPS1_GLTCH_X": north / 111_200,
            "SIM_GPS1_GLTCH_Y": east / 75_300,
            "SIM_GPS1_GLTCH_Z": up,
        }


class Relay:
    """The relay between two links, in a thread. Remembers the messages, and the vehicle's last report.

    `url`: of the link of the search. `truth`: the message with the true place of a simulator.
    """

    def __init__(self, vehicle: Link, search: Link, url: str, system: int, truth: int) -> None:
        self.url = url
        self.notes: list[Note] = []
        self.places: list[Place] = []
        self.mode = -1
        self.armed = False
        self.height = 0.0
        self.ready = False  # ArduPilot knows its place
        self.slope: Slope | None = None  # the ground, for ArduPilot
        self.surveyed = False  # ArduPilot has all the ground that it requested
        self.weather: Weather | None = None
        self.silent = False  # the vehicle and the search do not hear each other
        self.lie: Callable[[Any], Any] | None = None  # changes a message to the search; None: it is not sent
        self._vehicle, self._search = vehicle, search
        self._system, self._truth = system, truth
        self._up, self._down, self._lied = Parser(), Parser(), Parser()
        self._pilot = Encoder(255, 190)
        self._said: deque[Any] = deque()  # of the pilot, to be sent
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def say(self, message: Any) -> None:
        """Send a message as the pilot's ground station, soon: only the relay's own thread uses the links."""
        self._said.append(message)

    def order(self, number: int, *params: float) -> None:
        """Send a command to the autopilot as the pilot's ground station."""
        self.say(command(self._system, 1, number, *params))

    def set(self, name: str, value: float) -> None:
        """Set a parameter of the autopilot."""
        real = dialect.MAV_PARAM_TYPE_REAL32
        self.say(dialect.MAVLink_param_set_message(self._system, 1, name.encode(), value, real))

    def hold(self, message: Callable[[], Any]) -> None:
        """Send the position of the pilot's sticks five times a second from now on."""

        def held() -> None:
            while not self._ended.wait(0.2):
                self.say(message())

        threading.Thread(target=held, daemon=True).start()

    def close(self) -> None:
        self._ended.set()
        self._thread.join()
        self._vehicle.close()
        self._search.close()

    def _run(self) -> None:
        clock, due, emptied = RealClock(), 0.0, time.monotonic()
        while not self._ended.is_set():
            clock.wait(clock.now() + _LOOK_S, [self._vehicle, self._search])
            now = time.monotonic()
            if now > due:
                due = now + 1.0
                self._ask()
            while self._said:
                self._to_vehicle(self._pilot.pack(self._said.popleft()))
            up = _read(self._search)
            if up and not self.silent:
                self._to_vehicle(up)
            self._note(up, True, emptied)
            emptied = now
            down = _read(self._vehicle)
            if down and not self.silent:
                self._to_search(self._changed(down))
            self._note(down, False, time.monotonic())

    def _to_vehicle(self, data: bytes) -> None:
        with contextlib.suppress(LinkError):
            self._vehicle.write(data)

    def _to_search(self, data: bytes) -> None:
        with contextlib.suppress(LinkError):
            for at in range(0, len(data), _DATAGRAM):
                self._search.write(data[at : at + _DATAGRAM])

    def _ask(self) -> None:
        """Request the truth until it comes, and change the weather."""
        if not self.places:
            self.order(dialect.MAV_CMD_SET_MESSAGE_INTERVAL, self._truth, TRUTH_US)
        for name, value in (self.weather.parameters() if self.weather else {}).items():
            self.set(name, value)

    def _changed(self, data: bytes) -> bytes:
        """Return the bytes for the search, with the lie."""
        if self.lie is None:
            return data
        chunks = []
        for packet in self._lied.feed(data):
            message = decode(packet)
            if message is None or packet.component != 1:
                chunks.append(packet.raw)
                continue
            if (changed := self.lie(message)) is None:
                continue
            encoder = Encoder(packet.system, packet.component)
            encoder._codec.seq = packet.raw[4]
            chunks.append(encoder.pack(changed))
        return b"".join(chunks)

    def _note(self, data: bytes, up: bool, time_s: float) -> None:
        for packet in (self._up if up else self._down).feed(data):
            message = decode(packet)
            if message is None or not (up or packet.component == 1):
                continue
            if not up:
                self._learn(message, time_s)
            self.notes.append(Note(time_s, up, message))

    def _learn(self, message: Any, time_s: float) -> None:
        kind = type(message).id
        if kind == dialect.MAVLINK_MSG_ID_HEARTBEAT:
            self.mode = message.custom_mode
            self.armed = bool(message.base_mode & dialect.MAV_MODE_FLAG_SAFETY_ARMED)
        elif kind == MAVLINK_MSG_ID_CURRENT_MODE:
            self.mode = message.custom_mode
        elif kind == dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT:
            self.height = message.relative_alt / 1e3
        elif kind in _TRUTH and (place := _place(message, time_s)):
            self.places.append(place)
        elif kind == dialect.MAVLINK_MSG_ID_TERRAIN_REQUEST and self.slope:
            for data in self.slope.data(message):
                self.say(data)
        elif kind == dialect.MAVLINK_MSG_ID_TERRAIN_REPORT:
            self.surveyed = bool(message.spacing) and not message.pending
        elif kind == dialect.MAVLINK_MSG_ID_EKF_STATUS_REPORT:
            self.ready = bool(message.flags & dialect.EKF_POS_HORIZ_ABS)


def _read(link: Link) -> bytes:
    """Return the bytes that wait; none while the far end is away."""
    with contextlib.suppress(LinkError):
        return link.read()
    return b""


def _place(message: Any, time_s: float) -> Place | None:
    """Return the true place in a message; None before the simulator knows it."""
    if type(message).id == _SIM_STATE:  # its floats of degrees · 1e7 are too coarse
        lat, lon, alt = message.lat_int, message.lon_int, message.alt
    else:
        lat, lon, alt = message.lat, message.lon, message.alt / 1e3
    return Place(time_s, lat / 1e7, lon / 1e7, alt) if lat or lon else None


def tells_mode(message: Any) -> int | None:
    heartbeat = type(message).id == dialect.MAVLINK_MSG_ID_HEARTBEAT
    return message.custom_mode if heartbeat or type(message).id == MAVLINK_MSG_ID_CURRENT_MODE else None


def orders(message: Any) -> bool:
    """Return True for a message that moves the vehicle."""
    target = type(message).id == dialect.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED
    return target or getattr(message, "command", None) in ORDERS


def orders_landing(message: Any) -> bool:
    """Return True for the orders that land it: NAV_LAND, and the modes that land."""
    order = getattr(message, "command", None)
    mode = order == dialect.MAV_CMD_DO_SET_MODE and (int(message.param2), int(message.param3))
    return order == dialect.MAV_CMD_NAV_LAND or mode in _LAND
