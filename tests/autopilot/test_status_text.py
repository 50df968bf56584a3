"""What an autopilot says of itself, whole or in chunks."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from arva_hil.autopilot.commanding.complaints import Complaints, unwell
from arva_hil.mavlink.codec import Encoder, Parser, decode, dialect

WORDS = st.text("abc :_-", min_size=1, max_size=170).filter(lambda text: text == text.strip())


def said_by(messages: Iterable[Any]) -> list[str]:
    """The texts that these messages complete."""
    texts = Complaints()
    return [text for message in messages if (text := texts.on_text(message))]


def chunks(text: str, id_: int) -> list[Any]:
    """As they are decoded; a text that fills its last chunk is ended by an empty one."""
    encoder, parser = Encoder(1, 1), Parser()
    raw = text.encode()
    messages = [
        dialect.MAVLink_statustext_message(4, raw[at : at + 50], id_, seq)
        for seq, at in enumerate(range(0, len(raw) + 1, 50))
    ]
    return [decode(packet) for message in messages for packet in parser.feed(encoder.pack(message))]


@given(st.lists(WORDS, min_size=1, max_size=4, unique=True), st.randoms())
def test_chunks_of_several_texts_may_come_mixed(said: list[str], random: Any) -> None:
    waiting = [chunks(text, id_) for id_, text in enumerate(said, 1)]
    mixed = []
    while waiting:
        mixed.append(random.choice(waiting).pop(0))
        waiting = [rest for rest in waiting if rest]
    assert sorted(said_by(mixed)) == sorted(said)


def test_a_short_text_comes_at_once_and_only_once() -> None:
    assert said_by(chunks("PreArm: no", id_)[0] for id_ in (0, 0, 5)) == ["PreArm: no"]


def test_the_last_four_are_remembered() -> None:
    texts = Complaints()
    assert all(texts.on_text(chunks(f"text {n}", 0)[0]) for n in range(9))
    assert texts.recent == ["text 5", "text 6", "text 7", "text 8"]


@pytest.mark.parametrize(("lost", "text"), [(0, "…" + "b" * 50 + "c"), (1, "a" * 50 + "…c")])
def test_a_lost_chunk_is_marked(lost: int, text: str) -> None:
    came = [chunk for seq, chunk in enumerate(chunks("a" * 50 + "b" * 50 + "c", 3)) if seq != lost]
    assert said_by(came) == [text]


def test_a_text_without_its_end_is_not_mixed_with_the_next_of_its_number() -> None:
    assert said_by([chunks("a" * 60, 3)[0], *chunks("b" * 60, 3)]) == ["b" * 60]


def test_texts_without_an_end_do_not_pile_up() -> None:
    texts = Complaints()
    for id_ in range(1, 1000):
        texts.on_text(chunks("a" * 60, id_)[0])
    assert len(texts._open) < 20
    assert [texts.on_text(chunk) for chunk in chunks("b" * 60, 2000)] == ["", "b" * 60]


def test_an_empty_text_is_none() -> None:
    assert said_by([chunks("", 0)[0], chunks("   ", 1)[0]]) == []


@pytest.mark.parametrize(
    ("enabled", "health", "names"),
    [
        (0xFFFF, 0xFFFF, []),
        (dialect.MAV_SYS_STATUS_SENSOR_GPS, 0, ["gps"]),
        (0, 0, []),
        (dialect.MAV_SYS_STATUS_PREARM_CHECK | 1, 1, ["prearm check"]),
        (dialect.MAV_SYS_STATUS_SENSOR_RC_RECEIVER | 32, 0xF, ["gps", "rc receiver"]),
    ],
)
def test_sys_status_in_words(enabled: int, health: int, names: list[str]) -> None:
    assert unwell(dialect.MAVLink_sys_status_message(0, enabled, health, *[0] * 10)) == names


def test_every_bit_is_survived() -> None:
    message = dialect.MAVLink_sys_status_message(0, 2**32 - 1, 0, *[0] * 10)
    assert len(set(unwell(message))) > 20
