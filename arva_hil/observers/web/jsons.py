"""JSON texts of the page, and a history of them: numbers are rounded, NaN is null, markup is escaped."""

from __future__ import annotations

import bisect
import json
import math
from collections.abc import Iterable
from typing import Any

from arva_hil.events import FrameMade
from arva_hil.safe_text import one_line
from firmware_proto import Channel

RECENT = 1500  # texts of a history that are all kept
OLD = 3000  # older ones


def number(value: float | None, digits: int = 3) -> str:
    """Return a number with at most `digits` decimal places; null for None, NaN and infinity."""
    if value is None or not math.isfinite(value):
        return "null"
    return repr(round(value, digits)) if digits else str(round(value))


def text(value: object) -> str:
    """Return a string as JSON on one line, without characters that have a meaning in HTML."""
    return dump(one_line(value))


def dump(value: Any) -> str:
    """Return any value of numbers, strings, lists and dictionaries; NaN and infinity become null."""
    try:
        made = json.dumps(value, allow_nan=False, separators=(",", ":"))
    except ValueError:
        made = json.dumps(_finite(value), separators=(",", ":"))
    return made.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def slots(channels: Iterable[Channel], ranges: Iterable[float | None]) -> str:
    """Return the slots of a frame, each [id, zone, d in cm, δ in degrees, true range in m]."""
    every = [
        f"[{'null' if c.id is None else int(c.id)},{int(c.zone)},{int(c.d)},{int(c.delta)},{number(true, 2)}]"
        for c, true in zip(channels, ranges, strict=False)
    ]
    return "[" + ",".join(every) + "]"


def point(
    time_s: float,
    place: Iterable[float | None],
    yaw_deg: float | None,
    age_ms: float | None,
    late_ms: float | None,
    slots_text: str,
    sequence: int,
) -> str:
    """Return a reading: [time, north, east, down, yaw, age of the pose, lateness, slots, number of the frame]."""
    north, east, down = place
    return (
        f"[{number(time_s)},{number(north)},{number(east)},{number(down)},{number(yaw_deg, 1)},"
        f"{number(age_ms, 1)},{number(late_ms, 2)},{slots_text},{sequence}]"
    )


def point_of(made: FrameMade, offset: tuple[float, float, float], *, hidden: bool) -> str:
    """Return a frame as a point. `offset`: of the vehicle's datum in the map, NED, metres. `hidden`: without ranges."""
    place: tuple[float | None, ...] = (None, None, None)
    yaw_deg = None
    if made.pose is not None:
        place = tuple(a + b for a, b in zip(made.pose.position.tolist(), offset, strict=True))
        rotation = made.pose.rotation
        yaw_deg = math.degrees(math.atan2(rotation[1, 0], rotation[0, 0]))
    return point(
        made.instant_s,
        place,
        yaw_deg,
        None if made.age_s is None else made.age_s * 1e3,
        made.late_s * 1e3,
        slots(made.frame.channels, [None if hidden else c.true_range_m for c in made.reading.channels]),
        made.frame.sequence,
    )


def _finite(value: Any) -> Any:
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    return [_finite(item) for item in value] if isinstance(value, list | tuple) else value


class TextHistory:
    """Remembers JSON texts in order, each with the version of the state in which it came.

    It keeps the newest `recent` texts, and every n-th of the older ones. n doubles whenever there are more than `old`.
    So a history of any length has at most `recent` + `old` texts.
    """

    def __init__(self, recent: int = RECENT, old: int = OLD) -> None:
        self._most_recent = recent
        self._most_old = old
        self._recent: list[tuple[int, str]] = []  # with their versions
        self._old: list[str] = []
        self._stride = 1
        self._passed = 0  # number of texts that have left _recent

    def extend(self, texts: Iterable[str], version: int) -> None:
        """Add texts that came with `version`, which is not below the one before."""
        self._recent += ((version, text) for text in texts)
        if (surplus := len(self._recent) - self._most_recent) > 0:
            for _, text in self._recent[:surplus]:
                self._pass(text)
            del self._recent[:surplus]

    def since(self, version: int) -> list[str] | None:
        """Return the lines after `version`; None if some of them are gone."""
        first = bisect.bisect_right(self._recent, version, key=lambda one: one[0])
        return None if first == 0 and self._passed else [text for _, text in self._recent[first:]]

    def whole(self) -> list[str]:
        """Return all lines."""
        return self._old + [text for _, text in self._recent]

    def _pass(self, text: str) -> None:
        if self._passed % self._stride == 0:
            self._old.append(text)
            if len(self._old) > self._most_old:
                del self._old[1::2]
                self._stride *= 2
        self._passed += 1
