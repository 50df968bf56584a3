"""Readings, notices and the status of a run as text for a person."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator, Sequence
from typing import Any, Final, Literal, NamedTuple, TextIO

from arva_hil.events import ReceiverStatus, StatusReport, VehicleStatus
from arva_hil.safe_text import is_screen, one_line, wrapped
from firmware_proto import INNER, OUTER, Channel, Frame

Level = Literal["info", "warning", "error"]


class Notice(NamedTuple):
    """A line for a person, and its level."""

    level: Level
    text: str


ZONES: Final = ("outer", "mid", "inner")
WIDTH: Final = len("#254 inner 32767 cm -180°")  # of a channel that is aligned

LEAST_M: Final = 0.01  # a smaller distance is not printed

# From xterm's 256 colours. Colour-blind people can distinguish them, and they are readable on black and on white.
# No information is in a colour alone.
GOOD, DOUBTFUL, BAD = 30, 129, 202
_COLOURS: Final = {"warning": DOUBTFUL, "error": BAD}


def in_metres(metres: float) -> str:
    """Return a distance of at least 0 with its unit, never as 0.00 m."""
    return f"{metres:.2f} m" if metres >= LEAST_M else "less than 1 cm"


def sigma(metres: float) -> str:
    """Return a standard deviation with its unit, never as 0.0 m."""
    if metres >= 10 * LEAST_M:
        return f"{metres:.1f} m"
    return f"{100 * metres:.0f} cm" if metres >= LEAST_M else "less than 1 cm"


def unless_reported(autopilot_sigma_m: float | None) -> str:
    """Return the words after an uncertainty on Earth if the autopilot does not report its accuracy, else ""."""
    return ", or more: the autopilot does not report its accuracy" if autopilot_sigma_m is None else ""


def placed(north_m: float, east_m: float) -> str:
    """Return a place as two distances with directions, without a minus."""
    north, east = round(north_m, 1), round(east_m, 1)
    along, across = "south" if north < 0 else "north", "west" if east < 0 else "east"
    return f"{abs(north):.1f} m {along}, {abs(east):.1f} m {across}"


def reading(channels: Iterable[Channel]) -> str:
    """Return the channels of a frame with a signal, e.g. '#1 mid 1046 cm +12°', or 'no signal'.

    The inner zone has no direction. A frame format without zones gives OUTER, the zone without a signal.
    """
    return ", ".join(_channel(c) for c in channels if c.valid) or "no signal"


def _channel(c: Channel) -> str:
    zone = f" {_zone(c.zone)}" if c.zone != OUTER else ""
    direction = f" {c.delta:+d}°" if c.zone != INNER else ""
    return f"#{'?' if c.id is None else c.id}{zone} {c.d} cm{direction}"


def aligned(c: Channel) -> str:
    """Return a channel as in `reading`, with each part in its own columns; WIDTH characters."""
    id_ = "#?" if c.id is None else f"#{c.id}"
    zone = "" if c.zone == OUTER else _zone(c.zone)
    delta = "" if c.zone == INNER else f"{c.delta:+d}°"
    return f"{id_:<4} {zone:<5} {c.d:>5} cm {delta:>5}"


def coloured(line: str, colour: int) -> str:
    """Return a line in one of the colours above."""
    return f"\x1b[38;5;{colour}m{line}\x1b[0m"


# Of a transmitter: the shapes of the page, and colours near those of the page, readable on black and on white.
SIGNS: Final = "●■▲◆▼⬟⬢"
SIGN_COLOURS: Final = (26, 137, 30, 198, 94, 105)
_NUMBER: Final = re.compile(r"(?<!\S)#(\d+)")


def with_signs(line: str, colour: bool) -> str:
    """Return a line with a sign for the "#" of each transmitter, so that its width stays the same."""

    def sign(found: re.Match[str]) -> str:
        id_ = int(found[1])
        shape = SIGNS[id_ % len(SIGNS)]
        if colour:
            shape = f"\x1b[38;5;{SIGN_COLOURS[id_ % len(SIGN_COLOURS)]}m{shape}\x1b[39m"
        return shape + found[1]

    return _NUMBER.sub(sign, line)


def frame_json(frame: Frame) -> dict[str, Any]:
    """Return a frame as one JSON object."""
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
    """Return one line, `wrapped` at `columns`. It begins with the level if that is a warning or an error."""
    level = "" if said.level == "info" else f"{said.level}: "
    line = wrapped(one_line(level + said.text), columns)
    return coloured(line, _COLOURS[said.level]) if colour and level else line


def wants_colour(stream: TextIO) -> bool:
    """Return True for a terminal with colours if NO_COLOR is not set (https://no-color.org)."""
    return is_screen(stream) and not os.environ.get("NO_COLOR")


def _zone(zone: int) -> str:
    return ZONES[zone] if zone < len(ZONES) else f"zone {zone}"


_SHORT: Final = {"GLOBAL_POSITION_INT": "pos", "ATTITUDE": "att"}
BETWEEN: Final = " | "
_COLUMNS: Final = 100  # in a pipe
_NAMES: Final = 3  # names take at most a third of the terminal's columns


def status_lines(report: StatusReport) -> list[str]:
    """Return one line of at most 100 characters for each receiver, for a pipe.

    It has the nearest transmitter, and the number of others received.
    """
    rows = list(_rows(report, in_columns=True))
    width = max((len(name) for name, _, _ in rows), default=0)
    return [
        fit([f"{name:<{width}}  {first}" + (f" +{len(further)}" if further else "   "), *rest], _COLUMNS)
        for name, (first, *further), rest in rows
    ]


def status_line(report: StatusReport, *, named: bool = False) -> str:
    """Return the whole status in one line of any length."""
    rows = ((f"{name}: " if named else "", readings, rest) for name, readings, rest in _rows(report, in_columns=False))
    return " || ".join(name + BETWEEN.join([", ".join(readings), *rest]) for name, readings, rest in rows)


def status_table(report: StatusReport, columns: int, most: int, *, named: bool = False) -> list[str]:
    """Return at most `most` lines of at most `columns` characters.

    There is one line for each receiver, and one for each further channel that detects. Parts that do not fit are left
    out from the right, as a whole if possible.
    """
    rows = list(_rows(report, in_columns=True))
    width = min(max((len(name) for name, _, _ in rows), default=0), columns // _NAMES) if named else 0
    lines = []
    for name, (first, *further), rest in rows:
        indent = f"{name[:width]:<{width}}  " if width else ""
        lines.append(fit([indent + first, *rest], columns))
        lines += [fit([" " * len(indent) + reading], columns) for reading in further]
    if len(lines) > most:
        lines = [*lines[: most - 1], f"… and {len(lines) - most + 1} lines more"[:columns]]
    return lines


def fit(parts: Sequence[str], columns: int) -> str:
    """Join as many of the parts as fit, from the left. The first part is cut if it is too long."""
    line = parts[0][:columns]
    for part in parts[1:]:
        if len(line) + len(BETWEEN) + len(part) > columns:
            break
        line += BETWEEN + part
    return line.rstrip()


def _rows(report: StatusReport, *, in_columns: bool) -> Iterator[tuple[str, list[str], list[str]]]:
    """Yield for each receiver: name, readings with a signal, nearest first, and the rest by importance."""
    for vehicle in report.vehicles:
        of_vehicle = _of_vehicle(vehicle)
        for receiver in vehicle.receivers:
            yield f"{vehicle.name}/{receiver.name}", _readings(receiver, in_columns), _rest(receiver, of_vehicle)
            of_vehicle = []  # once a vehicle


def _readings(receiver: ReceiverStatus, in_columns: bool) -> list[str]:
    if receiver.last is None:
        return ["no frame yet".ljust(WIDTH) if in_columns else "no frame yet"]
    channels = sorted((c for c in receiver.last.frame.channels if c.valid), key=lambda c: c.d)
    if not in_columns:
        return [reading(channels)]
    return [aligned(c) for c in channels] or ["no signal".ljust(WIDTH)]


def _rest(receiver: ReceiverStatus, of_vehicle: Sequence[str]) -> list[str]:
    made, parts = receiver.last, []
    if made:
        age = made.age_s
        parts.append("no pose" if made.pose is None or age is None else f"pose {age * 1e3:.0f} ms")
    parts.append(f"{receiver.frames - receiver.dropped} sent, {receiver.dropped} dropped")
    return [*parts, *of_vehicle]


def _of_vehicle(vehicle: VehicleStatus) -> list[str]:
    rates = " ".join(f"{_SHORT[name]} {rate:.0f} Hz" for name, rate in vehicle.rates.items() if name in _SHORT)
    return [part for part in (rates, one_line(vehicle.label) or "no vehicle yet") if part]
