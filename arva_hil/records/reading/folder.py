"""Reads the folder of a record, with its readings.csv: one row a reading and slot."""

from __future__ import annotations

import itertools
import json
from array import array
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from arva_hil.config import Lla, ScenarioError, parse
from arva_hil.emulator.setup import receivers_of
from arva_hil.events import ReceiverStatus, StatusReport, VehicleStatus
from arva_hil.records.reading.lines import (
    Lines,
    NumberColumns,
    RecordingError,
    json_object,
    lat_lon_alt,
    mapping,
    number,
    objects,
    seconds_of,
    strict_json,
    table,
    text,
)
from arva_hil.records.reading.recording import RecordedDatum, RecordedReceiver, RecordedRun, Recording
from arva_hil.records.reading.search import read_search, read_team
from arva_hil.records.writing.layout import COLUMNS, EVENTS, READINGS, RUN, VERSION, RecordLayout
from arva_hil.records.writing.search_log import NEWS, TRACK

_OF_FRAME: Final = (
    "time_s boot_ms north_m east_m down_m roll_deg pitch_deg yaw_deg pose_age_ms"
    " reported_north_m reported_east_m reported_down_m late_ms"
).split()
_OF_SLOT: Final = {"id": "h", "zone": "B", "d_cm": "i", "delta_deg": "h", "true_range_m": "d"}  # kinds of arrays
_MOST_FAULTS: Final = 1024  # sets of them
_MOST_SLOTS: Final = 255
_MOST_ROWS: Final = 10_000_000


def read_receiver(path: Path, vehicle: str = "", receiver: str = "") -> tuple[RecordedReceiver, list[str]]:
    """Return the readings in a file, and notes about unused parts. Raises RecordingError.

    Takes 50 bytes of memory a row with four slots a frame, 140 with one. A huge number becomes NaN. A
    command may change the number of slots in a run.
    """
    lines = Lines(path)
    columns, rows = table(lines, COLUMNS)
    frames = NumberColumns(lines, columns, {"seq": "i", **dict.fromkeys(_OF_FRAME, "d")})
    slots = NumberColumns(lines, columns, _OF_SLOT)
    begins, before = array("q"), 0  # the number of each frame's first row; the slot of the newest row
    fault_sets, fault_set = {"": 0}, array("i")
    for row in itertools.islice(rows, _MOST_ROWS):
        slot = lines.whole_number(row[columns["slot"]])
        if slot == 1:
            begins.append(len(slots))
            lines.whole_number(row[columns["seq"]])  # these two may not be empty, as others may
            lines.seconds(row[columns["time_s"]])
            frames.add(row)
            names = row[columns["faults"]]
            if names not in fault_sets and len(fault_sets) >= _MOST_FAULTS:
                raise lines.error(f"more than {_MOST_FAULTS} different sets of faults")
            fault_set.append(fault_sets.setdefault(names, len(fault_sets)))
        elif not 1 < slot == before + 1 <= _MOST_SLOTS:
            raise lines.error(f"slot {slot}, expected 1{f' or {before + 1}' if before else ''}")
        before = slot
        slots.add(row)
    begins.append(len(slots))
    notes = []
    if next(rows, None):
        notes = [f"{path}: only the first {_MOST_ROWS} rows are used"]
    if lines.torn:
        notes = [f"{path}: the last frame is cut, what is before it is used"]
    if notes and len(begins) > 1:
        begins.pop()
    faults = tuple(tuple(names.lstrip("'").split("+")) if names else () for names in fault_sets)
    return _built(vehicle, receiver, frames, slots, np.array(begins), faults, np.array(fault_set)), notes


def _built(
    vehicle: str,
    receiver: str,
    frames: NumberColumns,
    slots: NumberColumns,
    begins: NDArray[np.int64],
    faults: tuple[tuple[str, ...], ...],
    fault_set: NDArray[np.intc],
) -> RecordedReceiver:
    """Return the frames that end where the last of `begins` is."""
    n, end = len(begins) - 1, begins[-1]
    time_s, boot_ms, *poses, late_ms = (frames.column(name, n) for name in _OF_FRAME)
    id_, zone, d_cm, delta_deg, true_range_m = (slots.column(name, end) for name in _OF_SLOT)
    return RecordedReceiver(
        vehicle,
        receiver,
        frames.column("seq", n),
        time_s,
        boot_ms,
        np.stack(poses[:3], axis=1),
        np.stack(poses[3:6], axis=1),
        poses[6],
        np.stack(poses[7:], axis=1),
        late_ms,
        begins,
        id_,
        zone,
        d_cm,
        delta_deg,
        true_range_m,
        faults,
        fault_set[:n],
    )


_MOST_EVENTS: Final = 200_000
_YEAR_2001_S: Final = 978_307_200.0  # earlier times are of a stepped clock


def is_record(folder: Path) -> bool:
    """Return True if the folder has a record of a run or a search. It may be broken. Raises RecordingError."""
    try:
        return (folder / RUN).exists() or (folder / TRACK).exists()
    except OSError as error:
        raise RecordingError(folder, f"cannot be read: {error.strerror}") from None


def load(folder: Path) -> Recording:
    """Read a record. Raises RecordingError for no record, a newer version, or a wrong line.

    A cut last line is not used, and is in `notes`.
    """
    if not is_record(folder):
        found = f"there is no {RUN} and no {TRACK} in it" if folder.is_dir() else "is not a folder"
        raise RecordingError(
            folder, f"{found if folder.exists() else 'no such folder'}; name one that --record has written"
        )
    if not (folder / RUN).exists():
        news, more = _events(folder / NEWS)
        search, notes = read_search(folder, None, news)
        started = search.started_utc_s if search else None
        return Recording(
            folder, None, (), {"": search} if search else {}, tuple(news), (), started, started, {}, tuple(notes + more)
        )
    run, notes = _run(folder / RUN)
    # their folders, if the scenario cannot be read; a receiver's name has no control characters
    inside = ((path.parts[-3], path.parts[-2]) for path in folder.glob(f"*/*/{READINGS}"))
    there = sorted(names for names in inside if "".join(names).isprintable())
    names = receivers_of(run.scenario) if run.scenario else there
    layout, receivers = RecordLayout(tuple(names)), []
    for vehicle, receiver in names if len(names) > 1 else [("", "")]:
        read, more = read_receiver(folder / layout.of_receiver(vehicle, receiver, READINGS), vehicle, receiver)
        receivers.append(read)
        notes += more
    events, of_events = _events(folder / EVENTS)
    first = next((event for event in events if event.get("event") == "first_frame"), {})
    start_s = number(first.get("time_s")) or 0.0
    start_utc_s = seconds_of(text(first.get("utc")))
    news, of_news = _events(folder / NEWS)
    search, of_search = read_search(folder, start_utc_s, [*events, *news])
    events = [{**event, "time_s": event["time_s"] - start_s} for event in events]
    events += [{**event, "time_s": event["time_s"] + (search.start_s if search else 0.0)} for event in news]
    events.sort(key=lambda event: event["time_s"])
    return Recording(
        folder,
        run,
        tuple(receivers),
        {"": search} if search else read_team(events, number(run.json.get("exit_code"))),
        tuple(event for event in events if event.get("event") != "status"),
        tuple(_report(event) for event in events if event.get("event") == "status"),
        start_utc_s if start_utc_s and start_utc_s > _YEAR_2001_S else seconds_of(run.started),
        start_utc_s,
        {receiver.vehicle: _datums(run, receiver.vehicle, events) for receiver in receivers},
        (*notes, *of_events, *of_news, *of_search),
    )


def _run(path: Path) -> tuple[RecordedRun, list[str]]:
    said = json_object(path)
    version = said.get("record", 1)
    if not isinstance(version, int) or version > VERSION:
        newer = f"record: {version!r:.20} is newer than this program, which reads up to {VERSION}: update arva-hil"
        raise RecordingError(path, newer)
    notes = (
        [] if said.get("ended") is not None else [f"{path}: the run continues, or was killed: there are no counters"]
    )
    if said.get("scenario") is None and RecordedRun(said, None).is_real:
        return RecordedRun(said, None), notes
    try:
        return RecordedRun(said, parse(json.dumps(said.get("scenario")), f"{path}: scenario")), notes
    except ScenarioError as error:
        return RecordedRun(said, None), [*notes, f"the scenario cannot be read: {error.problems[0]}"]


def _events(path: Path) -> tuple[list[dict[str, Any]], list[str]]:
    """Return all events with a time, and notes. A record of a search alone has none."""
    if not path.exists():
        return [], []
    lines, events = Lines(path), list[dict[str, Any]]()
    for line in lines:
        if len(events) == _MOST_EVENTS:
            return events, [f"{path}: only the first {_MOST_EVENTS} events are used"]
        try:
            event = strict_json(line)
        except (ValueError, RecursionError) as error:
            raise lines.error(f"is no JSON object: {getattr(error, 'msg', error)}") from None
        time_s = number(event.get("time_s")) if isinstance(event, dict) else None
        if time_s is None:
            raise lines.error("expected an object with a time_s")
        events.append({**event, "time_s": time_s})
    return events, lines.note


def _report(said: Mapping[str, Any]) -> StatusReport:
    vehicles = []
    for vehicle in objects(said.get("vehicles")):
        rates = {name: number(rate) or 0.0 for name, rate in mapping(vehicle.get("rates")).items()}
        receivers = []
        for one in objects(vehicle.get("receivers")):
            frames, dropped = (int(number(one.get(what)) or 0) for what in ("frames", "dropped"))
            receivers.append(ReceiverStatus(text(one.get("name")), None, frames, dropped))
        vehicles.append(VehicleStatus(text(vehicle.get("name")), text(vehicle.get("label")), rates, receivers))
    return StatusReport(said["time_s"], vehicles)


def _datums(run: RecordedRun, vehicle: str, events: list[dict[str, Any]]) -> tuple[RecordedDatum, ...]:
    """Return the datums of a vehicle: by run.json, else by the events of a run that was killed, else the scenario's."""
    changes = objects(run.vehicle(vehicle).get("datums")) or [
        {**event, "lat_lon_alt": [event.get(name) for name in ("lat", "lon", "alt")]}
        for event in events
        if event.get("event") == "datum_set" and (not vehicle or event.get("vehicle") == vehicle)
    ]
    found = []
    for change in changes:
        place, time_s = lat_lon_alt(change.get("lat_lon_alt")), number(change.get("time_s"))
        if place and time_s is not None:
            found.append(RecordedDatum(time_s, *place))
    if not found and run.scenario and isinstance(run.scenario.datum, Lla):
        fixed = run.scenario.datum
        found.append(RecordedDatum(0.0, fixed.lat, fixed.lon, fixed.alt))
    return tuple(sorted(found))
