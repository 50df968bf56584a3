"""Sends a search to a ground station's map: the place found as ADSB_VEHICLE, readings as NAMED_VALUE_FLOAT.

Ground stations draw an ADSB_VEHICLE from any link. An autopilot may evade one, so this needs a separate link without an
autopilot.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final, NamedTuple

from arva_hil.events import Event, searches
from arva_hil.links import Link
from arva_hil.mavlink.codec import Encoder, Message, dialect
from arva_hil.model.field import LocalFrame
from arva_hil.search.strategies.strategy import sigma_of
from firmware_proto import Channel, Frame

_EVERY_S: Final = 1.0
_FIRST_ADDRESS: Final = 0xF0A000  # of a range that ICAO gives to no state
_NO_ID: Final = 0xFF
_MOST_NOTED: Final = 16


class _ShownPlace(NamedTuple):
    """The place sent, metres from the take-off point. `found`: the search ends there; otherwise it is an estimate."""

    transmitter: int | None
    north_m: float
    east_m: float
    sigma_m: float | None
    found: bool


class GroundStation:
    """An observer that sends the newest place and readings of a search once a second.

    `link` is closed by `close`. `system`: the vehicle's system id, None while it is not known; nothing is sent then.
    `component`: of the sender.
    """

    def __init__(self, link: Link, system: Callable[[], int | None], component: int) -> None:
        self._link = link
        self._system = system
        self._encoder = Encoder(1, component)
        self._due_s = -math.inf
        self._start_s: float | None = None
        self._origin: tuple[LocalFrame, float] | None = None  # and its altitude
        self._reaches_autopilot = False  # then nothing is sent any more
        self._place: _ShownPlace | None = None
        self._noted: list[_ShownPlace] = []  # of a search for several
        self._frame: Frame | None = None

    def observe(self, event: Event) -> None:
        if isinstance(event, searches.FromSearch):
            event = event.event
        if not isinstance(event, searches.SearchEvent):
            return
        self._remember(event)
        if self._start_s is None:
            self._start_s = event.time_s
        if event.time_s >= self._due_s:
            self._due_s = event.time_s + _EVERY_S
            self._send_status(event.time_s - self._start_s)

    def close(self) -> None:
        self._link.close()

    def _remember(self, event: searches.SearchEvent) -> None:
        if isinstance(event, searches.TakeOffPoint):
            self._origin = LocalFrame(event.lat, event.lon, event.alt), event.alt
        elif isinstance(event, searches.OwnMarkHeard):
            self._reaches_autopilot = True
        elif isinstance(event, searches.FrameHeard):
            self._frame = event.frame
        elif isinstance(event, searches.BeliefChanged) and event.hypotheses and not (self._place and self._place.found):
            north, east, _ = max(event.hypotheses, key=lambda one: one[2])
            self._place = _ShownPlace(event.transmitter, north, east, sigma_of(event.covariance), False)
        elif isinstance(event, searches.PlaceFound):
            sigma = sigma_of(event.relative_covariance or event.covariance)
            self._place = _ShownPlace(event.transmitter, event.north_m, event.east_m, sigma, True)
            self._due_s = -math.inf  # at once
        elif isinstance(event, searches.TransmitterChosen) and self._place and self._place.found:
            self._noted.append(self._place)
            self._place = None

    def _send_status(self, time_s: float) -> None:
        self._link.read()  # discard messages of the ground station
        if (system := self._system()) is None:
            return
        self._encoder.system = system
        messages = [_HEARTBEAT, *self._values(round(time_s * 1e3) % 2**32)]
        if self._origin and not self._reaches_autopilot:
            places = [*self._noted[-_MOST_NOTED:], *([self._place] if self._place else [])]
            messages += [self._on_map(place, *self._origin) for place in places]
        self._link.write(b"".join(map(self._encoder.pack, messages)))

    def _values(self, boot_ms: int) -> list[Message]:
        values: dict[str, float] = {}
        if self._frame is not None:
            nearest = _nearest(self._frame, self._place.transmitter if self._place else None)
            values = {"arva_d": nearest.d / 100 if nearest.valid else -1.0, "arva_delta": float(nearest.delta)}
            values |= {"arva_zone": float(nearest.zone), "arva_id": float(-1 if nearest.id is None else nearest.id)}
        if self._place and self._place.sigma_m is not None:
            values["arva_sigma"] = self._place.sigma_m
        return [
            dialect.MAVLink_named_value_float_message(boot_ms, name.encode(), value) for name, value in values.items()
        ]

    def _on_map(self, place: _ShownPlace, origin: LocalFrame, alt: float) -> Message:
        lat, lon, _ = map(float, origin.lla([place.north_m, place.east_m, 0.0]))
        id_ = _NO_ID if place.transmitter is None else place.transmitter
        name = "ARVA" if place.transmitter is None else f"ARVA{place.transmitter}"
        return dialect.MAVLink_adsb_vehicle_message(
            _FIRST_ADDRESS + id_,
            round(lat * 1e7),
            round(lon * 1e7),
            dialect.ADSB_ALTITUDE_TYPE_GEOMETRIC,
            round(alt * 1e3),  # the take-off point's; not flagged as valid
            0,
            0,
            0,
            (name if place.found else f"{name}?").encode(),
            dialect.ADSB_EMITTER_TYPE_POINT_OBSTACLE,
            0,  # seconds old
            dialect.ADSB_FLAGS_VALID_COORDS | dialect.ADSB_FLAGS_VALID_CALLSIGN,
            0,
        )


_HEARTBEAT: Final = dialect.MAVLink_heartbeat_message(
    dialect.MAV_TYPE_ONBOARD_CONTROLLER, dialect.MAV_AUTOPILOT_INVALID, 0, 0, dialect.MAV_STATE_ACTIVE, 3
)


def _nearest(frame: Frame, transmitter: int | None) -> Channel:
    """Return the channel of the transmitter searched for, else the first one."""
    return next((c for c in frame.channels if c.valid and c.id == transmitter), frame.channels[0])
