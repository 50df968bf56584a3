"""The status of a run: the reading first, then the details, as many as there is room for."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple

from arva_hil.events import ReceiverStatus, StatusReport, VehicleStatus
from arva_hil.observers.console import text
from arva_hil.safe_text import one_line

_SHORT: Final = {"GLOBAL_POSITION_INT": "pos", "ATTITUDE": "att"}
BETWEEN: Final = " | "
_NAMES: Final = 3  # names take at most a third of the terminal's columns


class StatusRow(NamedTuple):
    """One receiver. `readings`: one for each channel that hears, nearest first. `rest`: the most important first."""

    name: str
    readings: Sequence[str]
    rest: Sequence[str]


def status_line(report: StatusReport, *, named: bool = False) -> str:
    """The whole status in one line of any length."""
    lines = []
    for row in _rows(report, aligned=False):
        name = [f"{row.name}:"] if named else []
        lines.append(" ".join([*name, BETWEEN.join([", ".join(row.readings), *row.rest])]))
    return " || ".join(lines)


def status_table(report: StatusReport, columns: int, most: int, *, named: bool = False) -> list[str]:
    """At most `most` lines of at most `columns` characters: one for each receiver, and one for each further channel
    that hears. Parts that do not fit are left out from the right, as a whole if possible.
    """
    rows = list(_rows(report, aligned=True))
    width = min(max((len(row.name) for row in rows), default=0), columns // _NAMES) if named else 0
    lines = []
    for row in rows:
        indent = f"{row.name[:width]:<{width}}  " if width else ""
        first, *further = row.readings
        lines.append(fit([indent + first, *row.rest], columns))
        lines += [fit([" " * len(indent) + reading], columns) for reading in further]
    if len(lines) > most:
        lines = [*lines[: most - 1], f"… and {len(lines) - most + 1} lines more"[:columns]]
    return lines


def fit(parts: Sequence[str], columns: int) -> str:
    """As many of the parts as fit, from the left. The first part is cut if it is too long."""
    line = parts[0][:columns]
    for part in parts[1:]:
        if len(line) + len(BETWEEN) + len(part) > columns:
            break
        line += BETWEEN + part
    return line.rstrip()


def _rows(report: StatusReport, *, aligned: bool) -> Iterator[StatusRow]:
    for vehicle in report.vehicles:
        of_vehicle = _of_vehicle(vehicle)
        for receiver in vehicle.receivers:
            name = f"{vehicle.name}/{receiver.name}"
            yield StatusRow(name, _readings(receiver, aligned), _rest(receiver, of_vehicle))
            of_vehicle = []  # once a vehicle


def _readings(receiver: ReceiverStatus, aligned: bool) -> list[str]:
    if receiver.last is None:
        return ["no frame yet".ljust(text.WIDTH) if aligned else "no frame yet"]
    channels = sorted((c for c in receiver.last.frame.channels if c.valid), key=lambda c: c.d)
    if not aligned:
        return [text.reading(channels)]
    return [text.aligned(c) for c in channels] or ["no signal".ljust(text.WIDTH)]


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
