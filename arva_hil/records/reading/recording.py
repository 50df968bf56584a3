"""One record as a whole: its run, receivers, search and events, and its place on Earth."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from arva_hil.config import Scenario
from arva_hil.emulator.build import moving_transmitters
from arva_hil.events import StatusReport
from arva_hil.model.field import LocalFrame, MovingTransmitters, Transmitters
from arva_hil.model.field.arrays import Array
from arva_hil.records.reading.lines import mapping, text
from arva_hil.records.reading.search import RecordedSearch
from arva_hil.records.writing.layout import CHUNKS, FILES
from arva_hil.records.writing.search_log import SEARCH_FILES

Ints = NDArray[np.signedinteger[Any]]

NO_ID: Final = -1


@dataclass(frozen=True, eq=False)
class RecordedReceiver:
    """The readings of one receiver: N frames, and R slots in the order of the frames, one or more for each frame.

    An empty cell is NaN, or NO_ID for an id. The slots of frame n are those at `rows(n)`.

    `vehicle`, `receiver`: its names in the scenario, "" in a record of one receiver. Times count from the start of the
    run. The pose is the receiver's true one, NED from the datum. Slots are nearest first, empty ones last. Empty slots
    have zone 0 and the true range of a transmitter without a slot. A slot whose transmitter is not received at the
    moment has its id and zone 0.
    """

    vehicle: str
    receiver: str
    sequence: Ints  # (N,)
    time_s: Array  # (N,)
    boot_ms: Array  # (N,)
    position: Array  # (N, 3) m, NED
    attitude_deg: Array  # (N, 3) roll, pitch, yaw
    pose_age_ms: Array  # (N,)
    reported: Array  # (N, 3) m, NED: the receiver's place by the vehicle's report
    late_ms: Array  # (N,) delay of the frame after its instant
    begins: Ints  # (N + 1,) the first slot of each frame, and R
    id: Ints  # (R,)
    zone: Ints  # (R,)
    d_cm: Ints  # (R,)
    delta_deg: Ints  # (R,)
    true_range_m: Array  # (R,)
    fault_sets: tuple[tuple[str, ...], ...]
    fault_set: Ints  # (N,) index into `fault_sets`, the faults that changed the frame

    def __len__(self) -> int:
        return len(self.time_s)

    @property
    def name(self) -> str:
        """For a person, "" in a record of one receiver."""
        return f"{self.vehicle}/{self.receiver}" if self.receiver else ""

    def rows(self, frame: int) -> slice:
        """Return the slots of a frame."""
        return slice(*self.begins[frame : frame + 2].tolist())

    def slots(self, frame: int) -> list[tuple[int, int, int, int, float]]:
        """Return id, zone, d [cm], δ [degrees] and true range [m] of each slot of a frame."""
        columns = (self.id, self.zone, self.d_cm, self.delta_deg, self.true_range_m)
        return list(zip(*(column[self.rows(frame)].tolist() for column in columns), strict=True))

    @cached_property
    def ids(self) -> tuple[int, ...]:
        """The transmitters received, by number."""
        return tuple(int(one) for one in np.unique(self.id[self.zone > 0]) if one != NO_ID)

    @property
    def nearest_zone(self) -> Ints:
        """(N,) the innermost zone of all slots; 0 without a signal."""
        return np.maximum.reduceat(self.zone, self.begins[:-1]) if len(self) else self.zone

    @property
    def faults(self) -> tuple[str, ...]:
        """The names of the faults that changed a frame."""
        return tuple(dict.fromkeys(name for n in np.unique(self.fault_set) for name in self.fault_sets[n]))

    def with_fault(self, name: str) -> NDArray[np.bool_]:
        """Return True (N,) for each frame that the fault changed."""
        return np.array([name in names for names in self.fault_sets], bool)[self.fault_set]

    def of_transmitter(self, id_: int) -> tuple[Array, Array, Ints, Array]:
        """Return the readings of one transmitter: d in metres, δ in degrees, zone, true range in metres, each (N,).

        Without a slot of it, d, δ and range are NaN and the zone is 0. δ is NaN in the inner zone.
        """
        rows = np.flatnonzero((self.id == id_) & (self.zone > 0))
        frames, first = np.unique(np.searchsorted(self.begins, rows, side="right") - 1, return_index=True)
        rows = rows[first]
        d_m, delta, range_m = np.full((3, len(self)), np.nan)
        zone = np.zeros(len(self), self.zone.dtype)
        d_m[frames], zone[frames], range_m[frames] = self.d_cm[rows] / 100, self.zone[rows], self.true_range_m[rows]
        delta[frames] = np.where(self.zone[rows] == 1, self.delta_deg[rows], np.nan)
        return d_m, delta, zone, range_m


def received(search: RecordedSearch) -> RecordedReceiver:
    """Return the readings of a search alone: its steps with a frame, each with one slot."""
    rows = np.flatnonzero(np.isfinite(search.d_cm))
    nothing = np.full(len(rows), np.nan)
    slots = np.nan_to_num([search.id, search.zone, search.d_cm, search.delta_deg], nan=NO_ID)[:, rows].astype(int)
    return RecordedReceiver(
        "",
        "",
        rows,
        search.time_s[rows],
        nothing,
        search.position[rows],
        np.stack([nothing, nothing, search.heading_deg[rows]], axis=1),
        nothing,
        np.stack([nothing] * 3, axis=1),
        nothing,
        np.arange(len(rows) + 1),
        slots[0],
        slots[1],
        slots[2],
        slots[3],
        nothing,
        ((),),
        np.zeros(len(rows), int),
    )


Event = Mapping[str, Any]


class RecordedDatum(NamedTuple):
    """The origin of the positions from `time_s` of the run on: degrees, degrees, metres AMSL."""

    time_s: float
    lat: float
    lon: float
    alt: float

    @property
    def frame(self) -> LocalFrame:
        """The NED frame with its origin there."""
        return LocalFrame(self.lat, self.lon, self.alt)


@dataclass(frozen=True, eq=False)
class RecordedRun:
    """The content of run.json. `scenario` is None if this program cannot read it, e.g. for lack of a plug-in.

    `json`: the whole file. `ended`: how the run ended, "" if it was killed.
    """

    json: Mapping[str, Any]
    scenario: Scenario | None

    @property
    def is_real(self) -> bool:
        """True if the frames came from a real receiver. Then a scenario has only its surveyed transmitters."""
        return self.json.get("source") == "receiver"

    @property
    def ended(self) -> str:
        return text(self.json.get("ended"))

    @property
    def started(self) -> str:
        """The time of the computer at the start, UTC, ISO 8601."""
        return text(self.json.get("started"))

    def vehicle(self, name: str) -> Mapping[str, Any]:
        """Return the entry of one vehicle; `name` is "" in a record of one receiver."""
        return mapping(mapping(self.json.get("vehicles")).get(name)) if name else self.json


@dataclass(frozen=True, eq=False)
class Recording:
    """A record. `run` is None for the log of a search alone, which has no receivers.

    - `searches`: the log of a search, by the name ""; of a team without logs, the searches by vehicle.
    - `events`, `status`: the objects of events.jsonl without the status, and the status. Their `time_s` is on the clock
      of the frames, which is 0 at the start of the run.
    - `start_utc_s`: that start in seconds since 1970; None if unknown. `log_start_s`: the same by the logs' clock.
    - `datums`: changes of the datum by vehicle ("" in a record of one receiver).
    - `notes`: unused parts of the files, for a person.
    """

    folder: Path
    run: RecordedRun | None
    receivers: tuple[RecordedReceiver, ...]
    searches: Mapping[str, RecordedSearch]
    events: tuple[Event, ...]
    status: tuple[StatusReport, ...]
    start_utc_s: float | None
    log_start_s: float | None
    datums: Mapping[str, tuple[RecordedDatum, ...]]
    notes: tuple[str, ...]

    @property
    def scenario(self) -> Scenario | None:
        """The scenario of the run, if this program can read it."""
        return self.run.scenario if self.run else None

    @property
    def search(self) -> RecordedSearch | None:
        """The search with a log; None if there is none."""
        return self.searches.get("")

    def search_of(self, vehicle: str) -> RecordedSearch | None:
        """Return the search of a vehicle; None if there is none."""
        return self.searches.get(vehicle, self.search)

    @cached_property
    def _placed(self) -> dict[RecordedDatum, MovingTransmitters]:
        """The transmitters that were requested, cached."""
        return {}

    @property
    def title(self) -> str:
        """The folder's name, for a person."""
        return self.folder.resolve().name or str(self.folder)

    @property
    def files(self) -> list[str]:
        """The names of the record's files."""
        names = [path.relative_to(self.folder) for path in (*self.folder.glob("*"), *self.folder.glob("*/*/*"))]
        return [str(name) for name in names if name.name in (*FILES, CHUNKS, *SEARCH_FILES) or name.suffix == ".tlog"]

    @cached_property
    def span_s(self) -> tuple[float, float]:
        """Times of the first and the last frame or step, on the clock of the frames; (0, 0) without any."""
        ends = [receiver.time_s[[0, -1]] for receiver in self.receivers if len(receiver)]
        if not ends and self.search and len(self.search.time_s):
            ends = [self.search.time_s[[0, -1]] + self.search.start_s]
        every = np.concatenate(ends) if ends else np.zeros(1)
        return float(np.nanmin(every)), float(np.nanmax(every))

    def datum_at(self, vehicle: str, time_s: float) -> RecordedDatum | None:
        """Return the datum at a time, None if it is not known."""
        datums = self.datums.get(vehicle, ())
        return next((datum for datum in reversed(datums) if datum.time_s <= time_s), datums[0] if datums else None)

    def lla(self, vehicle: str, time_s: ArrayLike, positions: ArrayLike) -> Array | None:
        """Return degrees, degrees, metres AMSL (N, 3) of positions NED (N, 3) at times (N,); None without a datum."""
        times, ned = np.asarray(time_s, float), np.asarray(positions, float)
        datums = self.datums.get(vehicle, ())
        if not datums:
            return None
        which = np.maximum(np.searchsorted([datum.time_s for datum in datums], times, side="right") - 1, 0)
        result = np.full(ned.shape, np.nan)
        for number_, datum in enumerate(datums):
            here = (which == number_) & np.isfinite(ned).all(axis=-1)
            if here.any():
                result[here] = np.stack(datum.frame.lla(ned[here]), axis=-1)
        return result

    def transmitters(self, vehicle: str, time_s: float = 0.0) -> Transmitters | None:
        """Return the transmitters at a time, NED from the vehicle's datum then; None without scenario or datum."""
        scenario, datum = self.scenario, self.datum_at(vehicle, time_s)
        if scenario is None or (datum is None and any(transmitter.lla for transmitter in scenario.transmitters)):
            return None
        datum = datum or RecordedDatum(0.0, 0.0, 0.0, 0.0)
        if datum not in self._placed:
            self._placed[datum] = moving_transmitters(scenario, datum.frame)
        return self._placed[datum].at(max(0.0, time_s))

    def of_search(self, ned: ArrayLike, vehicle: str = "") -> Array | None:
        """Return places of the search (..., 3), NED from its take-off point, as NED from the vehicle's datum.

        None if one of the two is not known.
        """
        search = self.search_of(vehicle)
        if search is None or search.origin is None:
            return None
        end_s = search.start_s + float(search.time_s[-1] if len(search.time_s) else 0.0)
        datum = self.datum_at(vehicle, end_s)
        return None if datum is None else datum.frame.ned(*LocalFrame(*search.origin).lla(ned))
