"""Reasons in words: every kind has some, and a record has them in place of the values."""

from __future__ import annotations

import json

import pytest

from arva_hil.events import DatumSet, Event
from arva_hil.events.event_json import event_json, event_of
from arva_hil.events.reasons import Why, because
from arva_hil.events.searches import OrderDetail, SearchEnded, WouldOrder
from arva_hil.events.words.reasons import _WORDS, in_words
from arva_hil.events.words.sentences import sentence

FLOWN = because(Why.STRIPS_FLOWN, heard=True, twice=True, team=False, found=0, wanted=1, more=0)
MOVED = DatumSet(1.0, "vehicle", 46.0, 7.0, 1650.0, (because(Why.HOME_MOVED),))


def test_every_kind_of_reason_has_words() -> None:
    assert set(_WORDS) == set(Why)


def test_several_reasons_are_one_sentence_and_none_is_empty() -> None:
    taken = because(Why.MODE_TAKEN, mode="LOITER", stalled_s=0.0), because(Why.NOT_TAKEN_OVER)
    assert in_words(taken) == "the mode is LOITER: the pilot or a failsafe has taken over; it was not taken over"
    assert in_words(()) == in_words(None) == ""


@pytest.mark.parametrize(
    ("found", "wanted", "words"),
    [
        (0, 3, "not found in 900 s"),
        (2, 3, "2 of 3 found in 900 s"),
        (2, None, "2 found in 900 s, 1 more received"),
    ],
)
def test_a_search_whose_time_is_up_says_how_many_it_has_found(found: int, wanted: int | None, words: str) -> None:
    assert in_words(because(Why.TIME_UP, limit_s=900.0, found=found, wanted=wanted, more=1)) == words


@pytest.mark.parametrize(
    ("event", "field", "words"),
    [
        (SearchEnded(1.0, (FLOWN,), True), "how", "not found: all strips are flown, twice"),
        (MOVED, "reason", "home has moved"),
        (DatumSet(1.0, "vehicle", 46.0, 7.0, 1650.0, ()), "reason", ""),
        (WouldOrder(1.0, "DO_SET_MODE", OrderDetail("GUIDED", at_end=True)), "what", "GUIDED, at the end"),
        (WouldOrder(1.0, "NAV_TAKEOFF", OrderDetail(height_m=3.0)), "what", "to 3 m above the take-off point"),
        (WouldOrder(1.0, "COMPONENT_ARM_DISARM", OrderDetail()), "what", "arm"),
    ],
)
def test_a_record_has_the_words_and_gives_the_same_sentence(event: Event, field: str, words: str) -> None:
    said = json.loads(event_json(event) or "")
    assert said[field] == words
    read = event_of(said)
    assert read is not None
    assert sentence(read) == sentence(event)
