"""The estimates of a search for the page. Places are in the map."""

from __future__ import annotations

import functools
import math
from dataclasses import replace
from typing import Any, Final

from arva_hil.events import Event, searches
from arva_hil.events.words.reasons import in_words
from arva_hil.observers.web.truth import Places
from arva_hil.safe_text import one_line

SEARCH: Final = "search:"  # begins the name of its origin; no vehicle has a colon in its name

_MOST_HEARD: Final = 16
_MOST_VICTIMS: Final = 256
PHASES: Final[dict[type[Event], str]] = {
    searches.WaitingFor: "waiting",
    searches.Launched: "take-off",
    searches.SearchBegun: "searching",
    searches.TransmitterChosen: "homing in",
    searches.TransmitterFaded: "searching",
    searches.TransmitterLeft: "searching",
    searches.SearchPaused: "hovering",
    searches.SearchResumed: "searching",
    searches.PlaceFound: "place found",
    searches.VictimNoted: "searching",
    searches.DescentBegun: "descending",
    searches.SearchEnded: "ended",
}


class SearchView:
    """Remembers the newest belief, the place found, and the phase of a search. `document` has None before the first.

    `vehicle`: its name, "" if there is only one.
    """

    def __init__(self, places: Places, vehicle: str = "") -> None:
        self._places = places
        self._vehicle = vehicle
        self._seen = False
        self._phase = ""
        self._target: int | None = None
        self._belief: searches.BeliefChanged | None = None
        self._found: searches.PlaceFound | None = None
        self._heard: dict[int | None, tuple[float, float, float]] = {}
        self._victims: dict[int, searches.VictimNoted] = {}  # of a search for several, by their number
        self._begun: searches.SearchBegun | None = None
        self._wanted: int | None = 1
        self._ended = ""

    def observe(self, event: Event) -> None:
        if phase := PHASES.get(type(event)):
            self._phase, self._seen = phase, True
        if isinstance(event, searches.TakeOffPoint):
            self._places.put(SEARCH + self._vehicle, event.lat, event.lon, event.alt)
        elif isinstance(event, searches.TransmitterHeard):
            if len(self._heard) < _MOST_HEARD:
                self._heard[event.transmitter] = (event.north_m, event.east_m, event.distance_m)
        elif isinstance(event, searches.TransmitterChosen):
            self._target = event.transmitter
            self._found = None  # the search continues with the next
        elif isinstance(event, searches.SearchBegun):
            self._begun, self._wanted = event, event.wanted
        elif isinstance(event, searches.VictimNoted):
            self._wanted = event.wanted
            if len(self._victims) < _MOST_VICTIMS:  # found before it was marked
                found_s = self._found.time_s if self._found else event.time_s
                self._victims[event.number] = replace(event, time_s=found_s)
        elif isinstance(event, searches.MarkLost):
            if event.number in self._victims:
                self._victims[event.number] = replace(self._victims[event.number], marked=False)
        elif isinstance(event, searches.TransmitterFaded):
            self._belief = None
        elif isinstance(event, searches.TransmitterLeft):
            self._belief = self._target = None
        elif isinstance(event, searches.BeliefChanged):
            self._belief = event
        elif isinstance(event, searches.PlaceFound):
            self._found = event
        elif isinstance(event, searches.SearchEnded):
            self._ended = in_words(event.how)

    def _since_begun(self, time_s: float) -> float | None:
        return None if self._begun is None or not math.isfinite(time_s) else time_s - self._begun.time_s

    def _shown_victim(
        self, victim: searches.VictimNoted | searches.PlaceFound, place: list[float], *, over: bool
    ) -> dict[str, Any]:
        """Return a victim for the page; with a QR code if the search is over. `place`: in the map."""
        lat_lon = self._places.lat_lon(*place)
        noted = victim if isinstance(victim, searches.VictimNoted) else None
        return {
            "id": victim.transmitter,
            "place": place,
            "lat_lon": lat_lon,
            "qr": _qr_code(*lat_lon) if over and lat_lon else None,
            "took_s": self._since_begun(victim.time_s),
            "sure": victim.sure,
            "marked": noted is not None and noted.marked,
            "left": noted and noted.left,
        }

    def document(self, now: float = 0.0, *, over: bool = False) -> dict[str, Any] | None:
        """Return the search for the page at a time; places as [north, east, …]. `over`: the run has ended."""
        if not self._seen:
            return None
        north, east, _ = self._places.offset(SEARCH + self._vehicle)

        def place(n: float, e: float) -> list[float]:
            return [round(n + north, 6), round(e + east, 6)]

        begun = self._begun or searches.SearchBegun(0.0, 0.0)
        belief = self._belief or searches.BeliefChanged(0.0, None, (), None, None)
        took_s = None if self._ended else self._since_begun(now)
        over = over or bool(self._ended)
        # in the order of finding; of a search for one, the place found
        found: list[searches.VictimNoted | searches.PlaceFound] = [*self._victims.values()]
        if self._found is not None and not found:
            found = [self._found]
        last = self._found
        means = [sum(one[axis] * one[2] for one in belief.hypotheses) for axis in (0, 1)]
        return {
            "vehicle": one_line(self._vehicle),
            "phase": self._phase,
            "ended": self._ended,
            "target": self._target,
            "take_off": place(0.0, 0.0),
            "heard": [[id_, *place(n, e), d] for id_, (n, e, d) in self._heard.items()],
            "wanted": self._wanted,
            "begun": self._begun is not None or bool(found),
            "area": begun.area and [*place(*begun.area[:2]), *place(*begun.area[2:])],
            "strip_m": begun.strip_m,
            "left_s": None if begun.limit_s is None or took_s is None else round(max(0.0, begun.limit_s - took_s)),
            "victims": [self._shown_victim(one, place(one.north_m, one.east_m), over=over) for one in found],
            "hypotheses": [[*place(n, e), round(share, 4)] for n, e, share in belief.hypotheses],
            "mean": place(*means) if belief.hypotheses else None,
            "covariance": _covariance(belief.covariance),
            "goal": belief.goal and place(*belief.goal),
            "found": last
            and {
                "id": last.transmitter,
                "place": place(last.north_m, last.east_m),
                "covariance": _covariance(last.covariance),
                "relative_covariance": _covariance(last.relative_covariance),
                "earth_covariance": _covariance(last.earth_covariance),
                "autopilot_sigma_m": last.autopilot_sigma_m,
                "sure": last.sure,
            },
        }


@functools.lru_cache(_MOST_VICTIMS)
def _qr_code(lat: float, lon: float) -> str:
    """Return the data URI of a picture that opens a place in a phone's map."""
    import segno  # slow to import

    return segno.make_qr(f"geo:{lat:.7f},{lon:.7f}").svg_data_uri(border=4, light="white", omitsize=True)


def _covariance(values: tuple[float, float, float] | None) -> list[float] | None:
    return None if values is None else [round(value, 8) for value in values]
