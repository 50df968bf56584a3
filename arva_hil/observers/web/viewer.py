"""A record on the page: the state at any time of the run."""

from __future__ import annotations

import bisect
import contextlib
import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from arva_hil.events import DatumSet, Event, FrameMade, PacketsReceived, ReceiverStatus, StatusReport, VehicleStatus
from arva_hil.events.event_json import event_of
from arva_hil.events.reasons import Why, because
from arva_hil.events.searches import (
    FrameHeard,
    FromSearch,
    PlaceFound,
    SearchEnded,
    VictimNoted,
    WaitingFor,
)
from arva_hil.events.words.text import Notice
from arva_hil.mavlink.packet_reader import PacketReader
from arva_hil.model.field import LocalFrame
from arva_hil.observers.web import jsons
from arva_hil.observers.web.background import Source
from arva_hil.observers.web.health import CHECKS, Health
from arva_hil.observers.web.search_view import PHASES, SearchView
from arva_hil.observers.web.state import Key, State
from arva_hil.observers.web.truth import Places
from arva_hil.records.reading import (
    NO_ID,
    RecordedReceiver,
    Recording,
    RecordingError,
    notice_of,
    number,
    packets,
    received,
)

_THINNED: Final = 3000  # readings that represent all
_NEWEST: Final = 100  # before the chosen time, all kept
ONE: Final = ("vehicle", "receiver")  # the names in a run of one receiver


class RecordedState(State):
    """The state of a recorded run at a time of its clock. `show` sets that time, in any order.

    Remembers the chosen time, and the JSON texts of some readings of every receiver.
    """

    def __init__(self, recording: Recording, background: Source | None = None) -> None:
        scenario = recording.scenario
        super().__init__(
            "view",
            recording.title,
            known=bool(recording.receivers) and scenario is not None,
            kappa_eq=scenario.receiver.kappa_eq if scenario else 1.0,
            faults=[str(fault) for fault in scenario.faults] if scenario else (),
            named=len(recording.receivers) > 1,
            background=background,
        )
        self.span_s = recording.span_s
        self._recording = recording
        self._shown_s = -math.inf
        self._notices: dict[int, Notice] = {}  # of events, by their identity
        self._news = sorted(self._recorded_events(), key=lambda event: event.time_s)
        self._passed = 0  # of those
        self._receivers_of: dict[str, list[str]] = {}  # by vehicle
        for receiver in recording.receivers:
            self._receivers_of.setdefault(receiver.vehicle, []).append(receiver.receiver or ONE[1])
        self._packets = {vehicle: _health_packets(recording, vehicle) for vehicle in self._receivers_of}
        self._place(-math.inf)
        every = recording.receivers or ([received(recording.search)] if recording.search else [])
        self._columns: dict[Key, _ReadingTexts] = {}
        for receiver in every:
            key = (receiver.vehicle, receiver.receiver) if receiver.receiver else ONE
            self._columns[key] = _ReadingTexts(receiver, self._offsets(receiver))

    def document(self, since: int = 0) -> bytes:
        """See `State`. Returns everything if anything has changed."""
        return super().document(since if since == self.version else 0)

    def show(self, time_s: float) -> None:
        """Set the state to that at a time, seconds from the start of the run."""
        time_s = min(max(time_s, self.span_s[0]), self.span_s[1]) if math.isfinite(time_s) else self.span_s[1]
        if time_s == self._shown_s:
            return
        if time_s < self._shown_s:
            self.forget()
            self._passed = 0
        self._shown_s = time_s
        self._place(time_s)
        now = bisect.bisect_right(self._news, time_s, key=lambda event: event.time_s)
        events = [*self._news[self._passed : now], *self._report(time_s)]
        self.update(events)
        if not events:  # of a search alone: other readings are a new version too
            self._new_version()
        self._passed = now
        for key, column in self._columns.items():
            self.put(key, *column.until(time_s))
        self._about |= {"span": list(self.span_s), "at": time_s}
        self.draw_field()

    def notice_of(self, event: Event) -> Notice | None:
        """Return the notice that was printed in the run: see `State`."""
        return self._notices.get(id(event))

    def time_line(self) -> bytes:
        """`/timeline.json`: phases, faults and marks: [from, to, vehicle, words]; events: [time, level, words]."""
        phases, marks, begun = list[list[Any]](), list[list[Any]](), dict[str, list[Any]]()
        for event in self._news:
            inner, vehicle = (event.event, event.vehicle) if isinstance(event, FromSearch) else (event, "")
            if (name := PHASES.get(type(inner))) and (vehicle not in begun or begun[vehicle][3] != name):
                at_s = max(event.time_s, self.span_s[0])
                if vehicle in begun:
                    begun[vehicle][1] = at_s
                begun[vehicle] = [at_s, self.span_s[1], vehicle, name]
                phases.append(begun[vehicle])
            if isinstance(inner, VictimNoted | PlaceFound):
                marks.append([event.time_s, event.time_s, vehicle, "place found"])
        faults = [
            [float(one.time_s[a]), float(one.time_s[min(b, len(one) - 1)]), one.vehicle, ", ".join(names)]
            for one in self._recording.receivers
            for a, b in itertools.pairwise([0, *(np.flatnonzero(np.diff(one.fault_set)) + 1).tolist(), len(one)])
            if b > a and (names := one.fault_sets[int(one.fault_set[a])])
        ]
        noticed = [event for event in self._news if id(event) in self._notices]
        some = [noticed[i] for i in _some(len(noticed))]
        events = [[event.time_s, *self._notices[id(event)]] for event in some]
        return jsons.dump({"phases": phases, "faults": faults, "marks": marks, "events": events}).encode()

    def _recorded_events(self) -> Iterator[Event]:
        """Yield the recorded events. Those that cannot be restored are notices with their recorded text."""
        recording, ended = self._recording, set[str]()
        for said in recording.events:
            event = _event(said)
            if event is None:
                event = Event(number(said.get("time_s")) or 0.0)
            if notice := notice_of(said):
                self._notices[id(event)] = notice
            inner, vehicle = (event.event, event.vehicle) if isinstance(event, FromSearch) else (event, "")
            if isinstance(inner, SearchEnded):
                ended.add(vehicle)
            yield event
        for vehicle, search in recording.searches.items():
            if vehicle not in ended and search.how:  # the vehicle was taken over, or lost, or the team was interrupted
                end = SearchEnded(self.span_s[1], [because(Why.ERROR, text=search.how)], False)
                yield FromSearch(end.time_s, end, vehicle)

    def _place(self, time_s: float) -> None:
        """Put every vehicle's datum of that time on the map."""
        for vehicle in self._receivers_of:
            if (datum := self._recording.datum_at(vehicle, time_s)) is not None:
                self.places.put(vehicle or ONE[0], datum.lat, datum.lon, datum.alt)

    def _offsets(self, receiver: RecordedReceiver) -> NDArray[np.float64]:
        """Return the datum of each reading in the map (N, 3), NED, metres."""
        datums = self._recording.datums.get(receiver.vehicle, ())
        if not datums or self.places.origin is None:
            return np.zeros((len(receiver), 3))
        origin = LocalFrame(*self.places.origin)
        every = np.array([origin.ned(datum.lat, datum.lon, datum.alt) for datum in datums])
        at = np.searchsorted([datum.time_s for datum in datums], receiver.time_s, side="right") - 1
        return np.asarray(every[np.maximum(at, 0)])

    def _report(self, time_s: float) -> Iterator[Event]:
        """Yield the newest packets of each kind, and the newest status with the places of the transmitters."""
        at = bisect.bisect_right(self._recording.status, time_s, key=lambda report: report.time_s)
        of = {one.name: one for one in self._recording.status[at - 1].vehicles} if at else {}
        vehicles = []
        for vehicle, receivers in self._receivers_of.items():
            source = None
            for every in self._packets[vehicle]:
                if at := bisect.bisect_right(every, time_s, key=lambda one: one[0]):
                    came_s, raw = every[at - 1]
                    for packet in PacketReader().feed(raw, came_s):
                        source = vehicle, packet.system
                        yield PacketsReceived(came_s, vehicle, [packet])
            name = vehicle or ONE[0]
            status = of.get(name, VehicleStatus(name, "", {}, ()))
            counts = {one.name: one for one in status.receivers}
            there = self._recording.transmitters(vehicle, time_s)
            each = [counts.get(receiver, ReceiverStatus(receiver, None, 0, 0)) for receiver in receivers]
            shown = [replace(one, transmitters=there) for one in each]
            vehicles.append(replace(status, receivers=shown, source=source))
        if vehicles:
            yield StatusReport(time_s, vehicles)


def _health_packets(recording: Recording, vehicle: str) -> list[list[tuple[float, bytes]]]:
    """Return a vehicle's packets for its health, a list a kind; none of a log that cannot be read."""
    by_kind: dict[int, list[tuple[float, bytes]]] = {kind: [] for kind in CHECKS}
    with contextlib.suppress(RecordingError):
        for time_s, kind, raw in packets(recording, vehicle):
            if kind in CHECKS:
                by_kind[kind].append((time_s, raw))
    return list(by_kind.values())


class _ReadingTexts:
    """The readings of one receiver as JSON texts: a selection, made once, and the newest, made on request.

    `offsets` (N, 3): of the datum in the map.
    """

    def __init__(self, receiver: RecordedReceiver, offsets: NDArray[np.float64]) -> None:
        self._receiver = receiver
        self._places = receiver.position + offsets
        self._some = _some(len(receiver))
        self._made = [self._text(i) for i in self._some]

    def until(self, time_s: float) -> tuple[int, list[str], Sequence[str], float | None]:
        """Return the number of readings, texts for them, faults, and the down coordinate of the newest."""
        receiver = self._receiver
        count = int(np.searchsorted(receiver.time_s, time_s, side="right"))
        first = max(0, count - _NEWEST)
        texts = self._made[: bisect.bisect_left(self._some, first)] + [self._text(i) for i in range(first, count)]
        if not count:
            return 0, texts, (), None
        down_m = float(self._places[count - 1, 2])
        faults = receiver.fault_sets[int(receiver.fault_set[count - 1])]
        return count, texts, faults, down_m if math.isfinite(down_m) else None

    def _text(self, i: int) -> str:
        r = self._receiver
        slots = [
            f"[{'null' if id_ == NO_ID else id_},{zone},{d},{delta},{jsons.number(true, 2)}]"
            for id_, zone, d, delta, true in r.slots(i)
        ]
        return jsons.point(
            float(r.time_s[i]),
            self._places[i].tolist(),
            float(r.attitude_deg[i, 2]),
            float(r.pose_age_ms[i]),
            float(r.late_ms[i]),
            f"[{','.join(slots)}]",
            int(r.sequence[i]),
        )


def _some(count: int) -> list[int]:
    """Return at most `_THINNED` indices of `count` items, evenly spread."""
    return np.unique(np.linspace(0, count - 1, min(count, _THINNED)).astype(int)).tolist() if count else []


def _event(said: Mapping[str, Any]) -> Event | None:
    """Return an event of a record; None for an unknown or unused one. Datums are in the record itself."""
    with contextlib.suppress(Exception):  # a value in it may be of any type
        event = event_of(said)
        if event is not None and not isinstance(event, DatumSet | FrameHeard | FrameMade):
            search, health = SearchView(Places()), Health({})
            for one in (WaitingFor(0.0, "pose"), event.event if isinstance(event, FromSearch) else event):
                search.observe(one)
                health.observe(one)
            jsons.dump([search.document(), health.vehicles(), health.links()])
            return event
    return None
