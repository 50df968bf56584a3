"""News of a team: no velocity leads to a place where another vehicle is reported."""

from __future__ import annotations

import math
import random
import struct
from collections.abc import Iterator
from typing import Final

from arva_hil.mavlink.codec import Parser, dialect, untunnel
from arva_hil.model.field import LocalFrame
from arva_hil.registry import STRATEGIES
from arva_hil.search.flight.client import COMPONENT
from arva_hil.search.strategies.plan import SearchPlan
from arva_hil.search.team.team import TeamField, Teammate, apart_m, strips_of
from arva_hil.search.team.team_tunnel import TEAM_TYPE, VERSION, News, TeamTunnel, encode, parse
from arva_hil.simulated import HOME
from tools.fuzz.script import Script, packet

FRAME: Final = LocalFrame(*HOME)
SYSTEMS: Final = (11, 12, 13, 14)
AREA: Final = (-50.0, -50.0, 50.0, 50.0)
SPEED: Final = 1.0
OUTSIDE_M: Final = 20.0  # of the area: no place that another one reports is farther
_STEPS_S: Final = (0.0, 0.001, 0.2, 0.2, 1.0, 1.1, 5.1, 61.0)
_SKEWS_MS: Final = (0, 0, 0, 0, 0, 5000, -3000, 2**31)  # of the other clock
_HEAD: Final = struct.Struct("<BBIiiiBBHBQBB")
_HEARD: Final = struct.Struct("<BHii")


def fuzz(data: bytes) -> None:
    """One life of a member of a team: its own steps, and packets in the names of the others."""
    Member(Script(data)).run()


class Member:
    """A search without a vehicle: what it knows of the others, and its place."""

    def __init__(self, s: Script) -> None:
        self._s = s
        self._number = s.number() % len(SYSTEMS)
        self._tunnel = TeamTunnel(SYSTEMS, COMPONENT)
        self._mate = Teammate(self._number, self._tunnel.send, TeamField(AREA, FRAME, len(SYSTEMS)))
        plan = self._mate.plan(self._mate.layered(SearchPlan(STRATEGIES["flux"], speed=SPEED)), FRAME)
        self._at = (0.0, 5.0 * self._number, -plan.height)
        self._strips = strips_of(self._mate, plan, self._at)
        self._height = plan.height
        self._now = 100.0
        self._parser = Parser()
        self._news: dict[int, News] = {}

    def run(self) -> None:
        """Run until the story ends."""
        sequence = 0
        while self._s:
            kind = self._s.number()
            if kind % 4 == 0:
                self._now += _STEPS_S[kind // 4 % len(_STEPS_S)]
                self._step()
            elif kind % 4 == 1:
                self._at = tuple(self._s.number("b") / scale for scale in (1, 1, 10))
            else:
                sequence = (sequence + 1) % 256
                self._hear(kind // 4, sequence)

    def _hear(self, kind: int, sequence: int) -> None:
        number = kind % len(SYSTEMS)
        payload = self._payload(number) if kind & 60 else self._s.take(self._s.number())
        payload = payload[:128]
        tunnel = struct.pack("<HBBB", TEAM_TYPE, 0, 0, len(payload)) + payload.ljust(128, b"\0")
        raw = packet(dialect.MAVLINK_MSG_ID_TUNNEL, tunnel, (SYSTEMS[number], COMPONENT), sequence=sequence)
        for one in self._parser.feed(raw):
            if (news := self._tunnel.on_packet(one, self._now)) is None:
                continue
            assert news.number == number, f"{news}: in the name of another one"
            assert all(map(math.isfinite, news.lla)), news
            assert max(abs(news.lla[0]) - 90, abs(news.lla[1]) - 180) <= 0, news
            self._mate.on_news(news)
            if number != self._number:
                self._news[number] = news

    def _payload(self, number: int) -> bytes:
        """News by the grammar, near the own place or anywhere; the counts may be wrong."""
        s = self._s
        near = s.number()
        if near & 7:
            metres = [there + s.number("b") / scale for there, scale in zip(self._at, (16, 16, 32), strict=True)]
            lat, lon, alt = (float(value) for value in FRAME.lla(metres))
        else:
            lat, lon, alt = s.number("i") / 1e7, s.number("i") / 1e7, s.number("i") / 1e3
        time_ms = round(self._now * 1e3) + _SKEWS_MS[near // 8 % len(_SKEWS_MS)]
        flags, hunting, cm, part, bits = s.number(), s.number(), s.number("H"), s.number(), s.number()
        found, heard = s.take(s.number() % 18), [self._heard() for _ in range(s.number() % 9)]
        place = round(lat * 1e7), round(lon * 1e7), round(alt * 1e3)
        counts = len(found) + (flags == 255), len(heard)
        told = flags & 7, hunting, cm, part % 5 if part & 64 else 255, bits & 15, *counts
        return _HEAD.pack(VERSION, number, time_ms & 0xFFFFFFFF, *place, *told) + found + b"".join(heard)

    def _heard(self) -> bytes:
        id_, cm, near = self._s.number(), self._s.number("H"), self._s.number()
        place = self._s.number("i"), self._s.number("i")
        if near & 15:
            lat, lon, _ = FRAME.lla([float(place[0] % 200 - 100), float(place[1] % 200 - 100), 0.0])
            place = round(float(lat) * 1e7), round(float(lon) * 1e7)
        return _HEARD.pack(id_ % 255, cm, *place)

    def _step(self) -> None:
        s, mate, at = self._s, self._mate, self._at
        lla = tuple(float(value) for value in FRAME.lla(at))
        flags = s.number()
        hunting = flags >> 4 if flags & 8 else None
        mate.report(self._now, lla, flying=True, hunting=hunting, hunting_m=20.0, searching=not flags & 1)  # type: ignore[arg-type]
        for message in self._tunnel.poll():
            sent = parse(untunnel(message), len(SYSTEMS))
            assert sent is not None, "its own news do not pass the decoder"
            assert encode(sent) == untunnel(message)
        assert not (mate.taken(flags, own=True, metres=9.0) and not self._news)
        wanted = *self._strips.velocity(self._now, at), s.number("b") / 100
        self._in_order(wanted, mate.apart(at, wanted, SPEED))
        for place in (mate.handed(at), mate.beside(at[:2])):
            assert place is None or all(map(math.isfinite, place)), place
        if (place := mate.handed(at)) is not None:
            assert max(map(abs, place)) <= AREA[3] + OUTSIDE_M + 0.1, f"sent to {place}"
        assert 3.0 <= mate.height(self._height, -at[2], at) <= max(self._height, -at[2])  # above another as it is
        assert mate.under_another in (True, False)
        assert self._strips.exhausted in (True, False)

    def _in_order(self, wanted: tuple[float, ...], flown: tuple[float, ...]) -> None:
        """Whether a velocity leads to nobody's place."""
        assert all(map(math.isfinite, flown)), flown
        assert math.hypot(*flown[:2]) <= max(SPEED, math.hypot(*wanted[:2])) + 1e-6, f"too fast: {flown}"
        assert flown[2] <= wanted[2] + 1e-9, f"{flown} leads down"
        for news in self._news.values():
            age_s = math.inf if news.lost else self._now - news.time_s
            north, east, below = (a - b for a, b in zip(FRAME.ned_of(*news.lla), self._at, strict=True))
            metres, overdue = math.hypot(north, east), age_s > 1.0
            level = news.flying and (overdue or abs(below) < 2.49)
            if level and 0.01 < metres < apart_m(news, age_s, SPEED) - 0.01:
                towards = (flown[0] * north + flown[1] * east) / metres
                assert towards < 1e-3, f"{flown} leads to {news}"
            if metres < 5.99 and 0.01 < below < (7.99 if news.flying else 3.99):
                assert flown[2] <= 0.0, f"{flown} leads down onto {news}"


def seeds() -> Iterator[bytes]:
    """Stories by the grammar, the same each time."""
    r = random.Random(457)
    for number in range(40):
        story = bytearray([number])
        for _ in range(12):
            story += bytes([4 * r.randrange(64) + 2, *r.randbytes(40)])
            story += bytes([4 * r.randrange(1, 4), *r.randbytes(2)])
        yield bytes(story)
