"""Reads the folder of a record, with its readings.csv: one row a reading and slot."""

from __future__ import annotations

import itertools
import json
import math
from array import array
from collections.abc import Iterator, Mapping, Sequence
from operator import itemgetter
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from arva_hil.config import Lla, ScenarioError, parse
from arva_hil.emulator.setup import receivers_of
from arva_hil.records.reading.lines import (
    Lines,
    RecordingError,
    json_object,
    mapping,
    number,
    seconds_of,
    strict_json,
    table,
    text,
    triple,
)
from arva_hil.records.reading.recording import NO_ID, RecordedDatum, RecordedReceiver, RecordedRun, Recording
from arva_hil.records.reading.search import read_search
from arva_hil.records.writing.layout import EVENTS, READINGS, RUN, VERSION, RecordLayout
from arva_hil.records.writing.search_log import NEWS, TRACK

_OF_FRAME: Final = "time_s boot_ms north_m east_m down_m roll_deg pitch_deg yaw_deg pose_age_ms".split()
_LATER: Final = "reported_north_m reported_east_m reported_down_m late_ms".split()  # old records lack them
_OF_SLOT: Final = {"id": "h", "zone": "b", "d_cm": "i", "delta_deg": "h"}  # kinds of arrays
_NEEDED: Final = ("seq", *_OF_FRAME, "slot", *_OF_SLOT, "true_range_m")
_MOST_FAULTS: Final = 1024  # sets of them
_MOST_SLOTS: Final = 255
_MOST_ROWS: Final = 10_000_000


def read_receiver(path: Path, vehicle: str = "", receiver: str = "") -> tuple[RecordedReceiver, list[str]]:
    """Return the readings in a file, and notes about unused parts. Raises RecordingError.

    Takes 50 bytes of memory a row with four slots a frame, 140 with one. An infinite number becomes NaN. A
    command may change the number of slots in a run.
    """
    lines = Lines(path)
    columns, rows = table(lines, _NEEDED)
    builder = _Builder(lines, columns)
    for row in itertools.islice(rows, _MOST_ROWS):
        builder.add(row)
    notes = []
    if next(rows, None):
        notes = [f"{path}: only the first {_MOST_ROWS} rows are used"]
    if lines.torn:
        notes = [f"{path}: the last frame is cut, what is before it is used"]
    if notes:
        builder.drop_frame()
    return builder.built(vehicle, receiver), notes


class _Builder:
    """Remembers the rows so far."""

    def __init__(self, lines: Lines, columns: Mapping[str, int]) -> None:
        self._before = 0  # the slot of the newest row
        self._begins = array("q")  # the number of each frame's first row
        self._lines = lines
        self._later = [name for name in _LATER if name in columns]
        self._frames, self._ranges = array("d"), array("d")
        self._sequence, self._fault_set = array("i"), array("i")
        self._fault_sets: dict[str, int] = {"": 0}
        self._slots = [array(kind) for kind in _OF_SLOT.values()]
        if columns:
            self._seq, self._slot, self._range = (columns[name] for name in ("seq", "slot", "true_range_m"))
            self._faults = columns.get("faults")
            self._of_frame = itemgetter(*(columns[name] for name in (*_OF_FRAME, *self._later)))
            self._of_slot = itemgetter(*(columns[name] for name in _OF_SLOT))

    def add(self, row: Sequence[str]) -> None:
        """Add one row. Raises RecordingError."""
        slot = self._number(row[self._slot])
        if slot == 1:
            self._begin_frame(row)
        elif not 1 < slot == self._before + 1 <= _MOST_SLOTS:
            raise self._lines.error(f"slot {slot}, expected 1{f' or {self._before + 1}' if self._before else ''}")
        self._before = slot
        cell = ""
        try:
            for column, cell in zip(self._slots, self._of_slot(row), strict=True):
                column.append(int(cell) if cell else NO_ID)
            cell = row[self._range]
            self._ranges.append(float(cell or math.nan))
        except ValueError:
            raise self._no_number(cell) from None
        except OverflowError:
            raise self._lines.error(f"{cell[:40]} is out of range") from None

    def built(self, vehicle: str, receiver: str) -> RecordedReceiver:
        """Return the complete frames of all rows."""
        n, rows = len(self._begins), len(self._ranges)
        parts = len(_OF_FRAME) + len(self._later)
        frames = _frozen(self._frames, n * parts).reshape(n, parts)
        later = {name: frames[:, len(_OF_FRAME) + at] for at, name in enumerate(self._later)}
        nothing = np.full(n, np.nan)
        id_, zone, d_cm, delta_deg = (_frozen(column, rows) for column in self._slots)
        return RecordedReceiver(
            vehicle,
            receiver,
            _frozen(self._sequence, n),
            frames[:, 0],
            frames[:, 1],
            frames[:, 2:5],
            frames[:, 5:8],
            frames[:, 8],
            np.stack([later.get(name, nothing) for name in _LATER[:3]], axis=1),
            later.get(_LATER[3], nothing),
            np.append(_frozen(self._begins, n), rows),
            id_,
            zone,
            d_cm,
            delta_deg,
            _frozen(self._ranges, rows),
            tuple(tuple(names.lstrip("'").split("+")) if names else () for names in self._fault_sets),
            _frozen(self._fault_set, n),
        )

    def drop_frame(self) -> None:
        """Forget the newest frame, if there is one."""
        if self._begins:
            begin = self._begins.pop()
            del self._ranges[begin:]
            for column in self._slots:
                del column[begin:]

    def _begin_frame(self, row: Sequence[str]) -> None:
        cell = row[self._seq]
        try:
            self._begins.append(len(self._ranges))
            self._sequence.append(int(cell))
            for cell in self._of_frame(row):
                self._frames.append(float(cell) if cell else math.nan)
        except (ValueError, OverflowError):
            raise self._no_number(cell) from None
        names = "" if self._faults is None else row[self._faults]
        if names not in self._fault_sets and len(self._fault_sets) >= _MOST_FAULTS:
            raise self._lines.error(f"more than {_MOST_FAULTS} different sets of faults")
        self._fault_set.append(self._fault_sets.setdefault(names, len(self._fault_sets)))

    def _number(self, cell: str) -> int:
        try:
            return int(cell)
        except ValueError:
            raise self._no_number(cell) from None

    def _no_number(self, cell: str) -> RecordingError:
        return self._lines.error(f"{cell[:40]!r}, expected a number")


def _frozen(data: array[Any], count: int) -> NDArray[Any]:
    """Return the first `count` numbers, infinite ones as NaN, as a read-only array."""
    values = np.frombuffer(data, data.typecode, count) if count else np.zeros(0, data.typecode)
    if data.typecode == "d" and np.isinf(values).any():
        values[np.isinf(values)] = np.nan
    values.flags.writeable = False
    return values


_MOST_EVENTS: Final = 200_000
_YEAR_2001_S: Final = 978_307_200.0  # earlier times are of a stepped clock


def is_record(folder: Path) -> bool:
    """Return True if the folder has a record of a run or a search. It may be broken."""
    return (folder / RUN).exists() or (folder / TRACK).exists()


def load(folder: Path) -> Recording:
    """Read a record. Raises RecordingError for no record, a newer version, or a wrong line.

    A cut last line is not used, and is in `notes`.
    """
    has_run, has_search = (folder / RUN).exists(), (folder / TRACK).exists()
    if not has_run and not has_search:
        found = f"there is no {RUN} and no {TRACK} in it" if folder.is_dir() else "is not a folder"
        raise RecordingError(
            folder, f"{found if folder.exists() else 'no such folder'}; name one that --record has written"
        )
    if not has_run:
        search, notes = read_search(folder, None)
        news, more = _events(folder / NEWS)
        started = search.started_utc_s if search else None
        return Recording(folder, None, (), search, tuple(news), (), started, started, {}, tuple(notes + more))
    run, notes = _run(folder / RUN)
    names = receivers_of(run.scenario) if run.scenario else _receivers_there(folder)
    layout, receivers = RecordLayout(tuple(names)), []
    for vehicle, receiver in names if len(names) > 1 else [("", "")]:
        read, more = read_receiver(folder / layout.of_receiver(vehicle, receiver, READINGS), vehicle, receiver)
        receivers.append(read)
        notes += more
    events, more = _events(folder / EVENTS)
    notes += more
    first = next((event for event in events if event.get("event") == "first_frame"), {})
    start_s = number(first.get("time_s")) or 0.0
    events = [{**event, "time_s": event["time_s"] - start_s} for event in events]
    start_utc_s = seconds_of(text(first.get("utc"))) or _start_utc_s(folder / layout.tables[0])
    search, more = read_search(folder, start_utc_s)
    news, of_news = _events(folder / NEWS)
    notes += of_news
    events += [{**event, "time_s": event["time_s"] + (search.start_s if search else 0.0)} for event in news]
    events.sort(key=lambda event: event["time_s"])
    return Recording(
        folder,
        run,
        tuple(receivers),
        search,
        tuple(event for event in events if event.get("event") != "status"),
        tuple(event for event in events if event.get("event") == "status"),
        start_utc_s if start_utc_s and start_utc_s > _YEAR_2001_S else seconds_of(run.started),
        start_utc_s,
        {receiver.vehicle: _datums(run, receiver.vehicle, events) for receiver in receivers},
        tuple(notes + more),
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


def _receivers_there(folder: Path) -> list[tuple[str, str]]:
    """Return the names of several receivers by their folders, for a record whose scenario cannot be read."""
    return sorted((path.parts[-3], path.parts[-2]) for path in folder.glob(f"*/*/{READINGS}"))


def _events(path: Path) -> tuple[list[dict[str, Any]], list[str]]:
    """Return all events with a time, and notes. Old records have none."""
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


def _start_utc_s(path: Path) -> float | None:
    """Return the frames' time 0 in seconds since 1970, from the first row of frames.csv; None if it is not there."""
    if not path.exists():
        return None
    columns, rows = table(Lines(path), ("utc", "time_s"))
    row = next(rows, None)
    try:
        utc_s = seconds_of(row[columns["utc"]]) if row else None
        return None if row is None or utc_s is None else utc_s - float(row[columns["time_s"]])
    except ValueError:
        return None


def _datums(run: RecordedRun, vehicle: str, events: list[dict[str, Any]]) -> tuple[RecordedDatum, ...]:
    """Return the datums of a vehicle: by run.json, else by the events of a run that was killed, else the scenario's."""
    found = list(_changes(run.vehicle(vehicle)))
    if not found:
        of_vehicle = [event for event in events if event.get("event") == "datum_set"]
        for event in of_vehicle:
            place = triple([event.get(name) for name in ("lat", "lon", "alt")])
            if place and (not vehicle or event.get("vehicle") == vehicle):
                found.append(RecordedDatum(event["time_s"], *place))
    if not found and run.scenario and isinstance(run.scenario.datum, Lla):
        fixed = run.scenario.datum
        found.append(RecordedDatum(0.0, fixed.lat, fixed.lon, fixed.alt))
    return tuple(sorted(found))


def _changes(said: Mapping[str, Any]) -> Iterator[RecordedDatum]:
    changes = said.get("datums")
    for change in changes if isinstance(changes, list) else []:
        place, time_s = triple(mapping(change).get("lat_lon_alt")), number(mapping(change).get("time_s"))
        if place and time_s is not None:
            yield RecordedDatum(time_s, *place)
