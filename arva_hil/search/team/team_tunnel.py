"""The news of searches in several programs: MAVLink TUNNEL messages that the autopilots forward.

The payload, little-endian; 33 bytes, one for each id found and 11 for each transmitter received:

| offset | type | content |
|---|---|---|
| 0 | uint8 | version, 2; others are ignored |
| 1 | uint8 | number of the search: the place of its vehicle in the scenario, 0 to 63 |
| 2 | uint32 | ms on its own clock |
| 6, 10 | int32 | latitude, longitude of its vehicle, 1e-7 deg |
| 14 | int32 | altitude, mm AMSL |
| 18 | uint8 | 1: in the air; 2: free, without strips or transmitter; 4: its position is not known any more |
| 19 | uint8 | id of the transmitter that it flies to; 255: none |
| 20 | uint16 | its smallest distance to that one, cm; 65535: unknown, or farther |
| 22 | uint8 | part of the area that it searches; 255: none |
| 23 | uint64 | parts that are flown, bit k for part k |
| 31 | uint8 | n, ids found, at most 16 |
| 32 | uint8 | m, transmitters received and not found, at most 7 |
| 33 | uint8 × n | ids found |
| 33 + n | 11 bytes × m | uint8 id; uint16 smallest distance, cm; int32 latitude, longitude there, 1e-7 deg |
"""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

from arva_hil.mavlink.codec import Packet, decode, dialect, tunnel, untunnel

MOST_HEARD: Final = 7  # transmitters in one message


class HeardAt(NamedTuple):
    """A received transmitter: its id, its smallest distance, and latitude and longitude of the vehicle there."""

    id: int
    metres: float
    lat: float
    lon: float


@dataclass(frozen=True)
class News:
    """The news of one search for the others.

    - `number`: of the search. `time_s`: on the common clock.
    - `lla`: place of its vehicle, degrees, degrees, metres AMSL. `flying`: the vehicle is in the air.
    - `lost`: the place is not known any more; `lla` is the last one.
    - `hunting`: id of the transmitter that it flies to, or None. `hunting_m`: its smallest distance to that one [m].
    - `found`: ids of the transmitters that it has found for sure.
    - `heard`: transmitters that it has received and that no search has found, at most 7.
    - `part`: the part of the area that it searches, None without strips. `flown`: the parts with all strips flown.
    - `free`: its strips are flown, and it flies to no transmitter.
    """

    number: int
    time_s: float
    lla: tuple[float, float, float]
    flying: bool
    hunting: int | None = None
    found: tuple[int, ...] = ()
    part: int | None = None
    flown: tuple[int, ...] = ()
    hunting_m: float = math.inf
    free: bool = False
    heard: tuple[HeardAt, ...] = ()
    lost: bool = False

    @property
    def ended(self) -> bool:
        """True if its search has ended: its vehicle lands, has landed, or is under another's control."""
        return self.part is None and self.hunting is None and not self.free


TEAM_TYPE: Final = 42072  # the payload type, in MAVLink's private range; frames have the one before
VERSION: Final = 2
MOST_MEMBERS: Final = 64
_HEAD: Final = struct.Struct("<BBIiiiBBHBQBB")  # offsets 0 to 32
_HEARD: Final = struct.Struct("<BHii")
_NONE: Final = 255
_FARTHEST: Final = 0xFFFF  # cm, or farther, or not known
_FLYING: Final = 1
_FREE: Final = 2
_LOST: Final = 4
_MOST_IDS: Final = 16
_STALE_S: Final = 2.0  # drop news that took this much longer than the quickest
_RESTARTED_S: Final = 5.0  # after this silence, accept that a search has restarted


def encode(news: News) -> bytes:
    """Return the payload of news, at most 128 bytes."""
    lat, lon, alt = news.lla
    ids = bytes(id_ for id_ in news.found[:_MOST_IDS] if 0 <= id_ < _NONE)
    heard = [one for one in news.heard[:MOST_HEARD] if 0 <= one.id < _NONE]
    hunting = _NONE if news.hunting is None or not 0 <= news.hunting < _NONE else news.hunting
    part = _NONE if news.part is None else news.part
    place = _degrees(lat), _degrees(lon), round(alt * 1e3)
    time_ms = round(news.time_s * 1e3) & 0xFFFFFFFF
    bits = sum(1 << part for part in news.flown)
    flies = _FLYING * news.flying | _FREE * news.free | _LOST * news.lost, hunting, _cm(news.hunting_m)
    head = _HEAD.pack(VERSION, news.number, time_ms, *place, *flies, part, bits, len(ids), len(heard))
    rows = [_HEARD.pack(one.id, _cm(one.metres), _degrees(one.lat), _degrees(one.lon)) for one in heard]
    return head + ids + b"".join(rows)


def parse(payload: bytes, members: int) -> News | None:
    """Return the news of one of `members`; None for anything else. `time_s`: on the sender's clock."""
    if len(payload) < _HEAD.size or payload[0] != VERSION:
        return None
    _, number, time_ms, lat, lon, alt, flags, hunting, cm, part, bits, found, heard = _HEAD.unpack_from(payload)
    known = number < members and (part == _NONE or part < members) and not bits >> members and flags < 2 * _LOST
    if not known or found > _MOST_IDS or heard > MOST_HEARD:
        return None
    ids, rows = payload[_HEAD.size :][:found], payload[_HEAD.size + found :]
    if len(rows) != heard * _HEARD.size or _NONE in ids:
        return None
    every = [HeardAt(id_, _metres(near), n / 1e7, e / 1e7) for id_, near, n, e in _HEARD.iter_unpack(rows)]
    if any(one.id == _NONE for one in every) or not all(
        map(_on_earth, [(lat / 1e7, lon / 1e7), *(o[2:] for o in every)])
    ):
        return None
    return News(
        number,
        time_ms / 1e3,
        (lat / 1e7, lon / 1e7, alt / 1e3),
        bool(flags & _FLYING),
        None if hunting == _NONE else hunting,
        tuple(ids),
        None if part == _NONE else part,
        tuple(part for part in range(members) if bits >> part & 1),
        _metres(cm),
        bool(flags & _FREE),
        tuple(every),
        bool(flags & _LOST),
    )


def payload_of(packet: Packet, kind: int, component: int) -> bytes | None:
    """Return the payload of a TUNNEL with this type from a component; None for anything else."""
    if packet.msgid != dialect.MAVLINK_MSG_ID_TUNNEL or packet.component != component:
        return None
    message = decode(packet)
    return untunnel(message) if message is not None and message.payload_type == kind else None


def _on_earth(place: tuple[float, float]) -> bool:
    return abs(place[0]) <= 90 and abs(place[1]) <= 180


def _degrees(angle: float) -> int:
    return round(angle * 1e7)


def _cm(metres: float) -> int:
    return round(min(metres * 100, _FARTHEST))


def _metres(cm: int) -> float:
    return math.inf if cm == _FARTHEST else cm / 100


class TeamTunnel:
    """Sends the news of one search, and receives those of the others, each from its own system and `component` only.

    `systems`: of all members' vehicles, by their numbers. `dropped`: the number of late, repeated or wrong news.
    """

    def __init__(self, systems: Sequence[int], component: int) -> None:
        self.dropped = 0
        self._systems = systems
        self._component = component
        self._due: News | None = None
        self._last: dict[int, tuple[float, float]] = {}  # by number: the newest time, and when it came
        self._quickest: dict[int, float] = {}  # by number: the least difference of the clocks

    def send(self, news: News) -> None:
        """Queue news for the next `poll`, in place of older ones."""
        self._due = news

    def poll(self) -> list[Any]:
        """Return the messages to send now, to all systems."""
        if self._due is None:
            return []
        payload, self._due = encode(self._due), None
        return [tunnel(TEAM_TYPE, payload)]

    def on_packet(self, packet: Packet, now: float) -> News | None:
        """Return the news in a packet; None for anything else. `time_s` is then on the own clock."""
        payload = payload_of(packet, TEAM_TYPE, self._component) if packet.system in self._systems else None
        if payload is None:
            return None
        news = parse(payload, len(self._systems))
        if news is None or self._systems[news.number] != packet.system or not self._is_new(news, now):
            self.dropped += 1
            return None
        return News(**vars(news) | {"time_s": now})

    def _is_new(self, news: News, now: float) -> bool:
        number, sent = news.number, news.time_s
        newest, came = self._last.get(number, (sent, now))
        if number not in self._last or now - came > _RESTARTED_S:
            self._quickest[number] = now - sent
        elif sent <= newest:
            return False
        self._quickest[number] = min(self._quickest[number], now - sent)
        if now - sent - self._quickest[number] > _STALE_S:
            return False
        self._last[number] = sent, now
        return True
