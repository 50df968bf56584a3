"""The files of a record: their paths, the rows of its tables, the lines of events.jsonl.

In a table an unknown value is an empty cell. Numbers have full precision. The names of faults are the only texts.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from arva_hil.clock import utc
from arva_hil.events import Event, FrameMade, StatusReport
from arva_hil.events.event_json import event_json, event_object
from arva_hil.events.searches import BeliefChanged, FromSearch, PlaceFound, TakeOffPoint
from arva_hil.events.words.sentences import sentence
from arva_hil.model.field import rotation
from arva_hil.safe_text import cell

VERSION: Final = 1  # of the record, in run.json; a reader refuses a newer one
FILES: Final = "autopilot.tlog frames.bin frames.csv readings.csv events.jsonl run.json".split()
TLOG, FRAMES, TABLE, READINGS, EVENTS, RUN = FILES
CHUNKS: Final = "chunks.csv"  # when the bytes in frames.bin came, in the record of a real receiver
CHUNK_COLUMNS: Final = ("utc_us", "bytes")
_OF_RECEIVERS: Final = (FRAMES, TABLE, READINGS)


@dataclass(frozen=True)
class RecordLayout:
    """`receivers`: names of vehicle and receiver; `links`: the engine's names of the links that are recorded.

    `real`: the frames come from a real receiver; the record has the times of its bytes too.

    The files of a single receiver are beside run.json, those of several in `VEHICLE/RECEIVER/`. The packets of a single
    link are in autopilot.tlog, those of several in autopilot-1.tlog, autopilot-2.tlog and so on.
    """

    receivers: tuple[tuple[str, str], ...] = ()
    links: tuple[str, ...] = ()
    real: bool = False

    def tlog(self, link: str) -> str:
        """Return the file of a link's packets."""
        return TLOG if len(self.links) < 2 else f"autopilot-{self.links.index(link) + 1}.tlog"

    def of_receiver(self, vehicle: str, receiver: str, file: str) -> str:
        """Return the path of one of a receiver's files in the record's folder."""
        return file if len(self.receivers) < 2 else f"{vehicle}/{receiver}/{file}"

    @property
    def folders(self) -> list[str]:
        """The folders to create, outer ones first."""
        if len(self.receivers) < 2:
            return []
        vehicles = dict.fromkeys(vehicle for vehicle, _ in self.receivers)
        return [*vehicles, *(f"{vehicle}/{receiver}" for vehicle, receiver in self.receivers)]

    @property
    def taken_name(self) -> str:
        """The name of a vehicle whose folder would be one of the record's files, in capitals or not; "" for none."""
        own = {name.casefold() for name in (*FILES, *self.files)}
        return next((folder for folder in self.folders if folder.casefold() in own), "")

    @property
    def files(self) -> list[str]:
        """All files except run.json."""
        logs = [self.tlog(link) for link in self.links] or [TLOG]
        logs += [CHUNKS] if self.real else []
        return [*logs, EVENTS, *(self.of_receiver(*names, file) for names in self._receivers for file in _OF_RECEIVERS)]

    @property
    def tables(self) -> list[str]:
        """Each receiver's frames.csv."""
        return [self.of_receiver(*names, TABLE) for names in self._receivers]

    @property
    def _receivers(self) -> Sequence[tuple[str, str]]:
        return self.receivers if len(self.receivers) > 1 else [("", "")]


COLUMNS: Final = (
    "seq time_s boot_ms north_m east_m down_m roll_deg pitch_deg yaw_deg pose_age_ms "
    "slot id zone d_cm delta_deg true_range_m faults reported_north_m reported_east_m reported_down_m "
    "late_ms"
).split()
FRAME_COLUMNS: Final = "utc time_s seq north_m east_m down_m roll_deg pitch_deg yaw_deg".split()
SLOT_COLUMNS: Final = ("id{}", "zone{}", "d{}_cm", "delta{}_deg", "range{}_m")  # of each slot, from 1

_NO_SLOT: Final = "," * (len(SLOT_COLUMNS) - 1)


def header_of_frames(slots: int) -> str:
    """Return the first line of frames.csv."""
    of_slots = [column.format(slot) for slot in range(1, slots + 1) for column in SLOT_COLUMNS]
    return ",".join([*FRAME_COLUMNS, *of_slots]) + "\n"


def rows(made: FrameMade, columns: int) -> tuple[str, str]:
    """Return the lines of readings.csv, and the line of frames.csv without its `utc`, so it begins with a comma.

    `columns`: the number of slots in frames.csv, which stays if a command changes the receiver's.
    """
    pose = "," * 5
    if made.pose is not None:
        angles = np.degrees(rotation.to_euler(made.pose.rotation)).tolist()
        pose = ",".join(map(repr, (*made.pose.position.tolist(), *angles)))
    number, instant_s = str(made.frame.sequence), repr(made.instant_s)
    boot_ms = "" if made.boot_s is None else repr(made.boot_s * 1e3)
    age_ms = "" if made.age_s is None else repr(made.age_s * 1e3)
    reported = "," * 2 if made.reported_pose is None else ",".join(map(repr, made.reported_pose.position.tolist()))
    faults = cell("+".join(made.faults)) if made.faults else ""
    head = f"{number},{instant_s},{boot_ms},{pose},{age_ms}"
    tail = f"{faults},{reported},{made.late_s * 1e3!r}"
    slots = []
    for c in made.reading.channels:
        id_, true_range = ("" if value is None else repr(value) for value in (c.id, c.true_range_m))
        slots.append(f"{id_},{int(c.zone)},{c.d_cm},{c.delta_deg},{true_range}")
    lines = [f"{head},{number_of_slot},{slot},{tail}\n" for number_of_slot, slot in enumerate(slots, 1)]
    of_frame = (slots + [_NO_SLOT] * columns)[:columns]
    return "".join(lines), ",".join(["", instant_s, number, pose, *of_frame]) + "\n"


def moment(time_s: float, epoch_us: int) -> str:
    """Return a time of the loop in UTC, to the millisecond; "" outside the years 1 to 9999, which a log may contain.

    `epoch_us`: microseconds since 1970 at the loop's time 0.
    """
    try:
        return utc(epoch_us + round(time_s * 1e6))
    except (ValueError, OverflowError, OSError):
        return ""


_MOST_BYTES: Final = 1 << 25  # text of a vehicle over days must not fill the disk


class EventLines:
    """The lines of events.jsonl: the events of `--json`, and two objects of its own.

    An event with a message for people also has a `notice`: its `level` (info, warning, error) and its `text`.

    `first_frame`: its `time_s` is the time 0 of the frames on the clock of the events, and `utc` the same instant.
    `status`: a StatusReport, once a second. The estimate of a search also comes once a second. After 32 MiB the last
    line is `events_left_out`. `epoch_us`: microseconds since 1970 at the loop's time 0.
    """

    def __init__(self, epoch_us: int) -> None:
        self._epoch_us = epoch_us
        self._has_frame = False
        self._next_status = self._next_belief = -math.inf
        self._left = _MOST_BYTES

    def of(self, event: Event) -> bytes:
        """Return the line for an event, b"" if it has none."""
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
