"""Readings and notices as text for a person."""

from __future__ import annotations

import os
from collections.abc import Iterable
from typing import Any, Final, TextIO

from arva_hil.line_wrapping import is_screen, wrapped
from arva_hil.observers.console.notice import Notice
from arva_hil.safe_text import one_line
from firmware_proto import INNER, OUTER, Channel, Frame

ZONES: Final = ("outer", "mid", "inner")
WIDTH: Final = len("#254 inner 32767 cm -180°")  # of a channel that is aligned

# From xterm's 256 colours. Colour-blind people can tell them apart too, and they are readable on black and on white.
# No information is in a colour alone.
GOOD, DOUBTFUL, BAD = 30, 129, 202
_COLOURS: Final = {"warning": DOUBTFUL, "error": BAD}


def reading(channels: Iterable[Channel]) -> str:
    """The channels of a frame that hear, e.g. '#1 mid 1046 cm +12°', or 'no signal'.

    The inner zone has no direction. A frame format without zones gives OUTER, in which nothing is heard.
    """
    return ", ".join(_channel(c) for c in channels if c.valid) or "no signal"


def _channel(c: Channel) -> str:
    zone = f" {_zone(c.zone)}" if c.zone != OUTER else ""
    direction = f" {c.delta:+d}°" if c.zone != INNER else ""
    return f"#{'?' if c.id is None else c.id}{zone} {c.d} cm{direction}"


def aligned(c: Channel) -> str:
    """A channel as in `reading`, with each part in its own columns; WIDTH characters."""
    id_ = "#?" if c.id is None else f"#{c.id}"
    zone = "" if c.zone == OUTER else _zone(c.zone)
    delta = "" if c.zone == INNER else f"{c.delta:+d}°"
    return f"{id_:<4} {zone:<5} {c.d:>5} cm {delta:>5}"


def coloured(line: str, colour: int) -> str:
    """A line in one of the colours above."""
    return f"\x1b[38;5;{colour}m{line}\x1b[0m"


def frame_json(frame: Frame) -> dict[str, Any]:
    """A frame as one JSON object."""
    measured = frame.measured
    return {
        "seq": frame.sequence,
        "status": frame.status,
        "channels": [
            {"id": c.id, "zone": _zone(c.zone), "d_cm": c.d, "delta_deg": c.delta, "marked": c.marked}
            for c in frame.channels
        ],
        **({"time_ms": measured.time_ms, "measured": [c._asdict() for c in measured.channels]} if measured else {}),
    }


def notice(said: Notice, colour: bool, columns: int | None = None) -> str:
    """One line, `wrapped` at `columns`. It begins with the level if that is a warning or an error."""
    level = "" if said.level == "info" else f"{said.level}: "
    line = wrapped(one_line(level + said.text), columns)
    return coloured(line, _COLOURS[said.level]) if colour and level else line


def wants_colour(stream: TextIO) -> bool:
    """Whether this is a terminal with colours, and NO_COLOR is not set (https://no-color.org)."""
    return is_screen(stream) and not os.environ.get("NO_COLOR")


def _zone(zone: int) -> str:
    return ZONES[zone] if zone < len(ZONES) else f"zone {zone}"
