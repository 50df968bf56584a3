"""The page's state of a run, of bounded size: events in, JSON documents out."""

from __future__ import annotations

import functools
import secrets
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from arva_hil.events import DatumSet, Event, FrameMade, PacketsReceived, StatusReport
from arva_hil.events.searches import FrameHeard, FromSearch
from arva_hil.events.words.sentences import sentence
from arva_hil.events.words.text import Notice
from arva_hil.observers.web import jsons
from arva_hil.observers.web.background import REACH_M, Background, Source
from arva_hil.observers.web.health import Health
from arva_hil.observers.web.search_view import SEARCH, SearchView
from arva_hil.observers.web.truth import Places, TransmitterView
from arva_hil.safe_text import one_line

_MOST_EVENTS: Final = 200
_MOST_FRAMES: Final = 2000  # of one update; of more, e.g. in a fast replay, keep every n-th
_MOST_RECEIVERS: Final = 64
_KEPT: Final = 16  # documents, one for each version of the clients
_KAPPA_EQ: Final = 1.542

Key = tuple[str, str]  # vehicle, receiver


@dataclass
class _ShownReceiver:
    """One receiver: its history, and the values of its newest frame alone. `down_m`: in the map."""

    history: jsons.TextHistory = field(default_factory=jsons.TextHistory)
    frames: int = 0
    sent: bool = True
    faults: tuple[str, ...] = ()
    down_m: float | None = None


@dataclass
class _Course:
    """The course of a run. `start_s`: on the driver's clock; `ended`: the result, "" before the end.

    `hidden`: the truth is left out until the end.
    """

    hidden: bool
    start_s: float | None = None
    time_s: float = 0.0
    ended: str = ""
    failed: bool = False


class State:
    """Remembers the content of the page. `update` takes events, `document` makes the JSON; only one thread at a time.

    `kind`: of the run: run, replay, demo, search or view. `title`: a line for a person. `known`: whether the scenario
    is known, so that the page has the truth. `datum`: degrees, degrees, metres AMSL, if the scenario fixes it.
    `faults`: of the scenario, in words. `named`: there are several receivers.
    `background`: draws the picture under the map. `hidden`: the truth is left out until the end, for a lesson.
    """

    def __init__(
        self,
        kind: str,
        title: str,
        *,
        known: bool = True,
        datum: tuple[float, float, float] | None = None,
        kappa_eq: float = _KAPPA_EQ,
        asked_hz: Mapping[str, float] | None = None,
        faults: Iterable[str] = (),
        named: bool = False,
        background: Source | None = None,
        hidden: bool = False,
    ) -> None:
        self.version = 1
        self._course = _Course(hidden)
        self._background = Background(source=background)
        self.health = Health(dict(asked_hz or {}))
        self.places = Places()
        self._about: dict[str, Any] = {
            "run": secrets.token_hex(4),
            "kind": kind,
            "title": title,
            "known": known,
            "lesson": hidden,
            "planned_faults": list(faults),
        }
        if datum is not None:
            self.places.put("", *datum)
        self.is_named = named
        self._receivers: dict[Key, _ShownReceiver] = {}
        self._events = jsons.TextHistory(_MOST_EVENTS, 0)
        self._searches: dict[str, SearchView] = {}  # by vehicle, "" where there is one only
        self._truth = TransmitterView(self.places, kappa_eq)
        self._documents = functools.lru_cache(_KEPT)(self._make)

    # -- in ------------------------------------------------------------------------------------------------

    def update(self, events: Iterable[Event]) -> None:
        """Use the events since the last update."""
        batch = list(events)
        if not batch:
            return
        self._new_version()
        frames: dict[Key, list[Event]] = {}
        for event in batch:
            name, inner = (event.vehicle, event.event) if isinstance(event, FromSearch) else ("", event)
            # without an emulator frames and vehicles are the searches' own
            is_own = inner is event or self._about["kind"] == "search"
            if isinstance(inner, PacketsReceived):
                self.health.observe(inner)
            elif isinstance(inner, FrameMade):
                frames.setdefault((inner.vehicle, inner.receiver), []).append(inner)
            elif not isinstance(inner, FrameHeard):
                self._take(event, inner, name, is_own)
            elif is_own:
                frames.setdefault((name or "vehicle", "receiver"), []).append(inner)
        for key, made in frames.items():
            self._take_frames(key, made)

    def put(self, key: Key, frames: int, texts: Iterable[str], faults: Iterable[str], down_m: float | None) -> None:
        """Replace a receiver's readings. `frames`: the number of frames that they represent."""
        receiver = self._receivers.setdefault(key, _ShownReceiver())
        receiver.history = jsons.TextHistory()
        receiver.history.extend(texts, self.version)
        receiver.frames, receiver.faults, receiver.down_m = frames, tuple(faults), down_m

    def forget(self) -> None:
        """Forget the events, but not the places."""
        self.health.forget()
        self._searches.clear()
        self._events = jsons.TextHistory(_MOST_EVENTS, 0)
        self._course.time_s = 0.0
        self._new_version()

    def end(self, how: str, *, failed: bool = False) -> None:
        """End the run with its result. `failed`: the run has failed."""
        course = self._course
        course.ended, course.failed, course.hidden = one_line(how), failed, False
        self._new_version()

    def fail(self, why: str) -> None:
        """Report why something could not be displayed."""
        self._new_version()
        self._tell(self._course.time_s, Notice("error", f"the page could not display something: {why}"))

    def _new_version(self) -> None:
        self.version += 1
        self._documents.cache_clear()

    def _tell(self, time_s: float, notice: Notice) -> None:
        line = f"[{jsons.number(time_s, 2)},{jsons.text(notice.level)},{jsons.text(notice.text)}]"
        self._events.extend([line], self.version)

    def _take(self, event: Event, inner: Event, name: str, is_own: bool) -> None:
        self._course.time_s = max(self._course.time_s, event.time_s)
        if isinstance(inner, DatumSet):
            self.places.put(inner.vehicle, inner.lat, inner.lon, inner.alt)
        if is_own:
            self.health.observe(inner)
        if isinstance(inner, StatusReport):
            self._truth.observe(inner)
            return
        if name in self._searches or len(self._searches) < _MOST_RECEIVERS:
            self._searches.setdefault(name, SearchView(self.places, name)).observe(inner)
        if (notice := self.notice_of(event)) is not None:
            self._tell(event.time_s - (self._course.start_s or 0.0), notice)

    def _take_frames(self, key: Key, frames: list[Event]) -> None:
        if key not in self._receivers and len(self._receivers) >= _MOST_RECEIVERS:
            return
        receiver = self._receivers.setdefault(key, _ShownReceiver())
        receiver.frames += len(frames)
        stride = -(-len(frames) // _MOST_FRAMES)
        shown = frames[(len(frames) - 1) % stride :: stride]  # the newest among them
        offset = self.places.offset(key[0])
        texts = []
        for made in shown:
            if isinstance(made, FrameMade):
                texts.append(jsons.point_of(made, offset, hidden=self._course.hidden))
            elif isinstance(made, FrameHeard):
                texts.append(self._point_of(made, key[0]))
        receiver.history.extend(texts, self.version)
        last = frames[-1]
        self._course.time_s = max(self._course.time_s, last.time_s)
        if isinstance(last, FrameMade):
            self._course.start_s = last.time_s - last.late_s - last.instant_s
            receiver.sent, receiver.faults = last.sent, last.faults
            receiver.down_m = None if last.pose is None else float(last.pose.position[2]) + offset[2]

    def _point_of(self, made: FrameHeard, vehicle: str) -> str:
        place: tuple[float | None, ...] = (None, None, None)
        if made.position is not None:
            offset = self.places.offset(SEARCH + (vehicle if vehicle in self._searches else ""))
            place = tuple(a + b for a, b in zip(made.position, offset, strict=True))
        channels = made.frame.channels
        said = jsons.slots(channels, [None] * len(channels))
        return jsons.point(made.time_s, place, made.heading_deg, None, None, said, made.frame.sequence)

    def draw_field(self) -> None:
        """Compute the lines of the field again if transmitters have moved, or the receiver has climbed."""
        downs = (receiver.down_m for receiver in self._receivers.values())
        if not self._course.hidden and self._truth.draw(next((down for down in downs if down is not None), None)):
            self._new_version()
        if self._background.source and self.places.origin:
            self._background = self._background.source(self.places.origin)
            self._new_version()

    def background(self) -> bytes:
        """`/background.png`."""
        return self._background.png

    def field(self) -> bytes:
        """Return `/field.json`."""
        return self._truth.lines

    def notice_of(self, event: Event) -> Notice | None:
        """Return the notice of an event; None without one."""
        return sentence(event, named=self.is_named)

    # -- out -----------------------------------------------------------------------------------------------

    def document(self, since: int = 0) -> bytes:
        """Return `/state.json`: the changes since version `since`; everything if that version is unknown or too old."""
        return self._documents(since if 0 < since <= self.version else 0)

    def _make(self, since: int) -> bytes:
        parts = {key: receiver.history.since(since) for key, receiver in self._receivers.items()}
        full = not since or any(part is None for part in parts.values())
        events = None if full else self._events.since(since)
        receivers = []
        for (vehicle, name), receiver in self._receivers.items():
            points = receiver.history.whole() if full else parts[vehicle, name] or []
            receivers.append(
                f'{{"vehicle":{jsons.text(vehicle)},"name":{jsons.text(name)},"frames":{receiver.frames},'
                f'"sent":{"true" if receiver.sent else "false"},"faults":{jsons.dump(list(receiver.faults))},'
                f'"points":[{",".join(points)}]}}'
            )
        said = self._events.whole() if events is None else events
        course = self._course
        searches = {name: one.document(course.time_s, over=bool(course.ended)) for name, one in self._searches.items()}
        head = {
            **self._about,
            "known": self._about["known"] and not course.hidden,
            "version": self.version,
            "full": full,
            "time_s": round(course.time_s - (course.start_s or 0.0), 3),
            "ended": course.ended,
            "failed": course.failed,
            "origin": self.places.origin,
            "vehicles": self.health.vehicles(course.time_s),
            "links": self.health.links(),
            "search": searches.pop("", None),
            "team": [shown for shown in searches.values() if shown],
            "field": self._truth.version,
            "background": {"reach_m": REACH_M, "about": self._background.about} if self._background.png else None,
            "all_events": events is None,
        }
        transmitters = "[]" if course.hidden else self._truth.text
        tail = f'"transmitters":{transmitters},"events":[{",".join(said)}],"receivers":[{",".join(receivers)}]'
        return f"{jsons.dump(head)[:-1]},{tail}}}".encode()
