"""The lines of a record's events.jsonl: what happened in the run, and its status once a second."""

from __future__ import annotations

import json
import math
from typing import Any, Final

from arva_hil.events import Event, FrameMade, StatusReport
from arva_hil.events.searches import BeliefChanged, FromSearch, PlaceFound, TakeOffPoint
from arva_hil.observers.console.event_json import event_json, event_object
from arva_hil.observers.console.sentences import sentence
from arva_hil.observers.record.tables import moment

_MOST_BYTES: Final = 1 << 25  # so that a vehicle that sends text for days does not fill the disk


class EventLines:
    """Makes the lines of events.jsonl: events as `--json` gives them, and two objects of its own.

    An event that a person is told has a `notice` besides: its `level` (info, warning, error) and its `text`.

    `first_frame`: its `time_s` is the time 0 of the frames on the clock of the events, and `utc` the same instant.
    `status`: a StatusReport, once a second. What a search believes is also there once a second. Counts its bytes; after
    32 MiB it makes one last line, `events_left_out`. `epoch_us`: microseconds since 1970 at the loop's time 0.
    """

    def __init__(self, epoch_us: int) -> None:
        self._epoch_us = epoch_us
        self._has_frame = False
        self._next_status = self._next_belief = -math.inf
        self._left = _MOST_BYTES

    def of(self, event: Event) -> bytes:
        """The line for an event, b"" if it has none."""
        line = self._line(event)
        if line is None or self._left < 0:
            return b""
        self._left -= len(line) + 1
        if self._left < 0:
            line = json.dumps({"event": "events_left_out", "time_s": event.time_s})
        return line.encode() + b"\n"

    def _line(self, event: Event) -> str | None:
        if isinstance(event, FrameMade):
            if self._has_frame:
                return None
            self._has_frame = True
            start_s = event.time_s - event.late_s - event.instant_s
            return json.dumps({"event": "first_frame", "time_s": start_s, "utc": moment(start_s, self._epoch_us)})
        if isinstance(event, StatusReport):
            if event.time_s < self._next_status:
                return None
            self._next_status = math.floor(event.time_s) + 1.0
            return json.dumps(_status(event))
        told = event.event if isinstance(event, FromSearch) else event
        if isinstance(told, BeliefChanged):
            if event.time_s < self._next_belief:
                return None
            self._next_belief = math.floor(event.time_s) + 1.0
        if isinstance(told, BeliefChanged | PlaceFound | TakeOffPoint):
            return json.dumps(event_object(event))
        line, notice = event_json(event), sentence(event)
        if line is None or notice is None:
            return line
        return f"{line[:-1]}, {json.dumps({'notice': notice._asdict()})[1:]}"


def _status(report: StatusReport) -> dict[str, Any]:
    return {
        "event": "status",
        "time_s": report.time_s,
        "vehicles": [
            {
                "name": vehicle.name,
                "label": vehicle.label,
                "rates": dict(vehicle.rates),
                "receivers": [
                    {"name": receiver.name, "frames": receiver.frames, "dropped": receiver.dropped}
                    for receiver in vehicle.receivers
                ],
            }
            for vehicle in report.vehicles
        ],
    }
