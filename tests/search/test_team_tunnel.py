"""News of searches in MAVLink TUNNEL messages: of the chosen systems, in order and in time; else nothing changes."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from arva_hil.autopilot.following.session import Session
from arva_hil.clock import StepClock
from arva_hil.links import memory
from arva_hil.mavlink.codec import Encoder, Packet, Parser, dialect, untunnel
from arva_hil.model.field import LocalFrame
from arva_hil.registry import STRATEGIES
from arva_hil.search.flight.client import COMPONENT, SearchClient
from arva_hil.search.strategies.plan import SearchPlan
from arva_hil.search.team.team import TeamField, Teammate
from arva_hil.search.team.team_tunnel import TEAM_TYPE, HeardAt, News, TeamTunnel, encode, parse
from arva_hil.simulated import HOME
from firmware_proto import Decoder

SYSTEMS = (11, 12, 13)
HEARD = (HeardAt(3, 12.34, 46.0124, 7.7455), HeardAt(0, 64.0, 46.0121, 7.7459))
NEWS = News(1, 5.0, (46.0123, 7.7456, 1650.25), True, 7, (0, 9, 254), 2, (0, 1), 21.5, False, HEARD, True)


def packet(message: Any, system: int = 12, component: int = COMPONENT) -> Packet:
    (one,) = Parser().feed(Encoder(system, component).pack(message))
    return one


def sent(news: News) -> Any:
    tunnel = TeamTunnel(SYSTEMS, COMPONENT)
    tunnel.send(news)
    (message,) = tunnel.poll()
    assert tunnel.poll() == []
    return message


def test_news_are_read_as_they_were_told_on_the_own_clock() -> None:
    heard = TeamTunnel(SYSTEMS, COMPONENT).on_packet(packet(sent(NEWS)), 90.0)
    assert heard == replace(NEWS, time_s=90.0)
    least = News(2, 0.0, (-90.0, 180.0, -10.0), False)
    assert TeamTunnel(SYSTEMS, COMPONENT).on_packet(packet(sent(least), 13), 1.0) == replace(least, time_s=1.0)
    free = replace(NEWS, part=None, hunting=None, hunting_m=math.inf, free=True)
    assert parse(encode(free), 3) == free
    assert len(encode(replace(NEWS, found=tuple(range(40)), heard=HEARD * 20))) <= 128


def test_only_the_newest_news_wait_to_be_sent() -> None:
    tunnel = TeamTunnel(SYSTEMS, COMPONENT)
    for second in range(5):
        tunnel.send(replace(NEWS, time_s=float(second)))
    assert [parse(untunnel(message), 3) for message in tunnel.poll()] == [replace(NEWS, time_s=4.0)]


@pytest.mark.parametrize(
    ("system", "component", "changes"),
    [
        (99, COMPONENT, {}),  # a stranger
        (12, 1, {}),  # not from a search
        (13, COMPONENT, {}),  # in another one's name
        (12, COMPONENT, {"payload_type": TEAM_TYPE - 1}),
        (12, COMPONENT, {"payload_length": 20}),
        (12, COMPONENT, {"payload_length": 128}),
    ],
)
def test_all_else_changes_nothing(system: int, component: int, changes: dict[str, int]) -> None:
    message = sent(NEWS)
    for name, value in changes.items():
        setattr(message, name, value)
    assert TeamTunnel(SYSTEMS, COMPONENT).on_packet(packet(message, system, component), 1.0) is None
    heartbeat = dialect.MAVLink_heartbeat_message(2, 3, 0, 0, 4, 3)
    assert TeamTunnel(SYSTEMS, COMPONENT).on_packet(packet(heartbeat), 1.0) is None


@pytest.mark.parametrize("version", [0, 1, 255])
def test_another_version_is_not_guessed_at(version: int) -> None:
    assert parse(bytes([version]) + encode(NEWS)[1:], 3) is None


@given(st.binary(max_size=128), st.integers(1, 64))
def test_any_payload_is_news_of_a_member_or_nothing(payload: bytes, members: int) -> None:
    for data in (payload, b"\x02" + payload):
        if news := parse(data, members):
            assert news.number < members
            assert news.part is None or news.part < members
            assert set(news.flown) <= set(range(members))
            assert len(news.found) <= 16
            assert len(news.heard) <= 7
            assert encode(news) == data


def test_what_is_repeated_overtaken_or_long_on_the_way_is_dropped() -> None:
    tunnel = TeamTunnel(SYSTEMS, COMPONENT)

    def heard(sent_s: float, now: float) -> bool:
        return tunnel.on_packet(packet(sent(replace(NEWS, time_s=sent_s))), now) is not None

    assert heard(100.0, 10.0)
    assert not heard(100.0, 10.1)  # again
    assert heard(101.0, 11.5)
    assert not heard(100.5, 11.6)  # overtaken
    assert not heard(102.0, 14.5)  # 2.5 s later than the quickest
    assert heard(104.0, 14.6)
    assert not heard(1.0, 16.0)
    assert heard(2.0, 20.0)  # begun anew after a silence
    assert tunnel.dropped == 4


def test_a_search_tells_and_hears_over_its_autopilots_link_and_believes_no_stranger() -> None:
    far, near = memory.pair()
    tunnel = TeamTunnel(SYSTEMS, COMPONENT)
    mate = Teammate(0, tunnel.send, TeamField((-9.0, -9.0, 9.0, 9.0), LocalFrame(*HOME), 3))
    session = Session(target_system=11, component=COMPONENT)
    search = SearchClient(
        SearchPlan(STRATEGIES["flux"]), session, near, memory.pair()[0], Decoder(), start=0.0, team=mate, tunnel=tunnel
    )
    clock = StepClock()
    mate.report(0.0, HOME, flying=True)
    far.write(Encoder(11, 1).pack(dialect.MAVLink_heartbeat_message(2, 3, 0, 0, 4, 3)))
    for system, id_ in ((12, 7), (99, 8)):
        far.write(Encoder(system, COMPONENT).pack(sent(replace(NEWS, found=(id_,)))))
    search.service(clock)
    assert mate.taken(7, own=False)
    assert not mate.taken(8, own=False)
    (told,) = [one for one in Parser().feed(far.read()) if one.msgid == dialect.MAVLINK_MSG_ID_TUNNEL]
    assert (told.system, told.component) == (11, COMPONENT)
    told_news = TeamTunnel(SYSTEMS, COMPONENT).on_packet(told, 0.0)
    assert told_news is not None
    assert (told_news.number, told_news.part) == (0, 0)
