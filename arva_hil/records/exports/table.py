"""CSV: one flat table, a row for each reading and slot, with time, place on Earth and the step of the search."""

from __future__ import annotations

import codecs
import csv
import math
from collections.abc import Iterator
from typing import Any, BinaryIO, Final

import numpy as np

from arva_hil.records.exports.tracks import moment, plain_rows, rounded
from arva_hil.records.reading import RecordedReceiver, RecordedSearch, Recording
from arva_hil.safe_text import cell

COLUMNS: Final = (
    "utc time_s vehicle receiver seq boot_ms lat_deg lon_deg alt_m north_m east_m down_m roll_deg pitch_deg yaw_deg "
    "reported_north_m reported_east_m reported_down_m pose_age_ms late_ms faults slot id zone d_cm delta_deg "
    "true_range_m search_phase search_north_m search_east_m search_down_m"
).split()
_SEARCH: Final = 4  # the last columns


def write(recording: Recording, out: BinaryIO) -> None:
    """Write a record as CSV. Unknown values are empty; an unknown `id` is -1, so that the column has integers.

    The search's columns are those of its newest step before the frame. A search alone has a row for each step.
    """
    table = csv.writer(codecs.getwriter("utf-8")(out), lineterminator="\n")
    table.writerow(COLUMNS)
    table.writerows(_rows(recording))


def _rows(recording: Recording) -> Iterator[list[Any]]:
    search = recording.search
    for receiver in recording.receivers:
        yield from _readings(recording, receiver, search)
    if not recording.receivers and search:
        for step, time_s in enumerate(plain_rows(search.time_s)):
            nothing = [""] * (len(COLUMNS) - 2 - _SEARCH)
            yield [moment(recording, time_s), time_s, *nothing, *_step(search, step)]


def _readings(recording: Recording, receiver: RecordedReceiver, search: RecordedSearch | None) -> Iterator[list[Any]]:
    unknown = np.full((len(receiver), 3), np.nan)
    lla = recording.lla(receiver.vehicle, receiver.time_s, receiver.position)
    steps = np.zeros(len(receiver), int)
    if search:
        steps = np.searchsorted(search.time_s + search.start_s, receiver.time_s, side="right")
    faults = [cell("+".join(names)) if names else "" for names in receiver.fault_sets]
    names = [cell(receiver.vehicle) if receiver.vehicle else "", cell(receiver.receiver) if receiver.receiver else ""]
    columns = (
        receiver.sequence[:, None],
        receiver.boot_ms[:, None],
        unknown if lla is None else rounded(lla),
        receiver.position,
        receiver.attitude_deg,
        receiver.reported,
        receiver.pose_age_ms[:, None],
        receiver.late_ms[:, None],
    )
    for n, time_s in enumerate(plain_rows(receiver.time_s)):
        numbers = [_plain(value) for column in columns for value in column[n].tolist()]
        head = [moment(recording, time_s), time_s, *names, *numbers, faults[int(receiver.fault_set[n])]]
        tail = _step(search, int(steps[n]) - 1) if search and steps[n] else [""] * _SEARCH
        for slot, (id_, *values, range_m) in enumerate(receiver.slots(n), 1):
            yield [*head, slot, id_, *values, _plain(range_m), *tail]


def _step(search: RecordedSearch, step: int) -> list[Any]:
    return [cell(search.phase[step]), *(_plain(value) for value in search.position[step].tolist())]


def _plain(value: float) -> float | str:
    return "" if math.isnan(value) else value
