"""What a simulator says of itself: its true place, heard on a link of its own; and the weather it is given there."""

from __future__ import annotations

import contextlib
import math
import random
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, Final, NamedTuple

from arva_hil.clock import RealClock
from arva_hil.links import Link, LinkError, open_link
from arva_hil.mavlink.codec import Encoder, Packet, Parser, command, decode, dialect

_COMPONENT: Final = 194  # beside those of emulator and search
_SIM_STATE: Final = dialect.MAVLINK_MSG_ID_SIM_STATE  # ArduPilot's
_RATE_HZ: Final = 20.0

Weather = Callable[[float], Mapping[str, float]]  # seconds → parameters, set once a second


class Place(NamedTuple):
    """Degrees, degrees, metres above mean sea level; `time_s` on the host's clock."""

    time_s: float
    lat: float
    lon: float
    alt: float


class Witness:
    """Hears the truth on a link, in a thread; `places` are all of it, in order. `weather` is what it asks for."""

    def __init__(self, address: str, msgid: int, weather: Weather | None = None) -> None:
        self.places: list[Place] = []
        self._address = address
        self._msgid = msgid
        self._weather = weather
        self._clock = RealClock()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._listen)
        self._thread.start()

    def close(self) -> None:
        self._stop.set()
        self._thread.join()

    def _listen(self) -> None:
        while not self._stop.is_set():
            with contextlib.suppress(LinkError):  # not there yet, or the simulator has ended
                link = open_link(self._address, clock=self._clock)
                with contextlib.closing(link):
                    self._hear(link)
            self._stop.wait(0.5)

    def _hear(self, link: Link) -> None:
        parser, encoder, due = Parser(), Encoder(1, _COMPONENT), 0.0
        while not self._stop.is_set():
            self._clock.wait(self._clock.now() + 0.1, [link])
            for packet in parser.feed(link.read()):
                self._note(parser, packet)
            if self._clock.now() >= due:
                due = self._clock.now() + 1.0
                link.write(b"".join(map(encoder.pack, self._requests())))

    def _requests(self) -> Iterator[Any]:
        kind, none, active = (
            dialect.MAV_TYPE_ONBOARD_CONTROLLER,
            dialect.MAV_AUTOPILOT_INVALID,
            dialect.MAV_STATE_ACTIVE,
        )
        yield dialect.MAVLink_heartbeat_message(kind, none, 0, 0, active, 3)
        yield command(1, 1, dialect.MAV_CMD_SET_MESSAGE_INTERVAL, self._msgid, 1e6 / _RATE_HZ)
        for name, value in (self._weather(self._clock.now()) if self._weather else {}).items():
            real = dialect.MAV_PARAM_TYPE_REAL32
            yield dialect.MAVLink_param_set_message(1, 1, name.encode(), value, real)

    def _note(self, parser: Parser, packet: Packet) -> None:
        if packet.msgid != self._msgid or (message := decode(packet)) is None:
            return
        if packet.msgid == _SIM_STATE:  # its floats of degrees · 1e7 are too coarse
            lat, lon, alt = message.lat_int, message.lon_int, message.alt
        else:
            lat, lon, alt = message.lat, message.lon, message.alt / 1e3
        if lat or lon:
            self.places.append(Place(self._clock.now(), lat / 1e7, lon / 1e7, alt))


def rough(seed: int, *, wind_m_s: float = 5.0, gps_m: float = 1.5) -> Weather:
    """For ArduPilot: wind with gusts, from a direction that the seed draws, and a GPS whose error walks.

    Each axis of the error is a Gauss-Markov process of `gps_m` and 30 s; it begins once there was time to arm.
    """
    draw = random.Random(seed)
    direction, error = draw.uniform(0, 360), [0.0, 0.0, 0.0]
    begun: list[float] = []

    def weather(now: float) -> Mapping[str, float]:
        begun.append(now)
        keep = math.exp(-1 / 30)
        for axis in range(3):
            error[axis] = error[axis] * keep + draw.gauss(0, gps_m) * math.sqrt(1 - keep**2)
        share = min(1.0, max(0.0, (now - begun[0] - 60) / 10))
        return {
            "SIM_WIND_SPD": wind_m_s,
            "SIM_WIND_DIR": direction,
            "SIM_WIND_TURB": 1.0,
            "SIM_GPS1_GLTCH_X": share * error[0] / 111_000,
            "SIM_GPS1_GLTCH_Y": share * error[1] / 75_000,
            "SIM_GPS1_GLTCH_Z": share * error[2],
        }

    return weather


def ground_m(places: Sequence[Place]) -> float:
    """The altitude of the ground, where it stood at first."""
    return min(place.alt for place in places[:10])
