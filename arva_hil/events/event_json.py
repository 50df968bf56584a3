"""Events as JSON objects, for programs: `{"event": "pose_lost", "time_s": 12.3, "vehicle": …}`."""

from __future__ import annotations

import dataclasses
import functools
import json
import math
import re
from collections.abc import Callable, Mapping
from typing import Any, Final

from arva_hil import events
from arva_hil.events import BytesSent, DatumSet, Event, FrameMade, PacketsReceived, StatusReport, searches, vehicles
from arva_hil.events.searches import (
    BeliefChanged,
    FrameHeard,
    FromSearch,
    PlaceFound,
    SearchEnded,
    TakeOffPoint,
    WouldOrder,
)
from arva_hil.events.words.reasons import in_words, order_in_words

_DRAWN: Final = (BytesSent, PacketsReceived, StatusReport, FrameHeard, BeliefChanged, PlaceFound, TakeOffPoint)
_WORDED: Final[Mapping[tuple[type, str], Callable[[Any], str]]] = {  # fields that a record has in words
    (DatumSet, "reason"): in_words,
    (SearchEnded, "how"): in_words,
    (WouldOrder, "what"): order_in_words,
}
NOT_NEWS: Final = (FrameMade, *_DRAWN)  # frames have their own objects; the others are for observers that draw


def event_name(kind: type[Event]) -> str:
    """Return the class's name in lower case, words joined by "_": PoseLost is "pose_lost"."""
    return re.sub(r"(?<!^)(?=[A-Z])", "_", kind.__name__).lower()


def event_json(event: Event) -> str | None:
    """Return an event as a JSON object of numbers, strings, lists, true, false and null; None for those in NOT_NEWS."""
    told = event.event if isinstance(event, FromSearch) else event
    return None if isinstance(told, NOT_NEWS) else json.dumps(event_object(event))


def event_object(event: Event) -> dict[str, Any]:
    """Return any event as a dictionary that JSON can take."""
    if isinstance(event, FromSearch):
        return {**event_object(event.event), "by": "search"} | ({"of": event.vehicle} if event.vehicle else {})
    return {"event": event_name(type(event)), **_fields(event)}


def event_of(said: Mapping[str, Any]) -> Event | None:
    """Return the event of such a dictionary; None for an unknown event or one with nested values.

    The types of its values are not checked.
    """
    fields = {name: value for name, value in said.items() if name not in ("event", "by", "of", "notice")}
    kind = _kinds().get(str(said.get("event")))
    try:
        event = kind(**fields) if kind else None
    except TypeError:  # it lacks fields, or has others
        return None
    return FromSearch(event.time_s, event, str(said.get("of", ""))) if event and said.get("by") == "search" else event


@functools.cache
def _kinds() -> Mapping[str, type[Event]]:
    every = (kind for room in (events, vehicles, searches) for kind in vars(room).values() if isinstance(kind, type))
    return {event_name(kind): kind for kind in every if issubclass(kind, Event)}


def _fields(value: Any, prefix: str = "") -> dict[str, Any]:
    """Return the fields by name. The fields of a nested value are named `name_field`; reasons are in words."""
    fields: dict[str, Any] = {}
    for field in dataclasses.fields(value):
        name, part = prefix + field.name, getattr(value, field.name)
        if (value.__class__, field.name) in _WORDED:
            fields[name] = _WORDED[value.__class__, field.name](part)
        else:
            fields |= _fields(part, f"{name}_") if dataclasses.is_dataclass(part) else {name: _plain(part)}
    return fields


def _plain(value: Any) -> Any:
    """Return a value with lists for tuples, and None for NaN and infinity."""
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
