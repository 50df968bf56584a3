"""The report's page: facts, pictures and events of one run, or of several beside each other."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Sequence
from typing import Any, Final

from arva_hil.events.words.text import in_metres
from arva_hil.records.pictures.run import pictures
from arva_hil.records.reading import Recording, notice_of
from arva_hil.records.report.facts import errors_m, facts, found_of, merged
from arva_hil.records.report.html import render
from arva_hil.safe_text import one_line

_MOST_EVENTS: Final = 200
_CAPTIONS: Final = {
    "map": "the flight from above",
    "distance": "d over time",
    "timeline": "timeline",
    "lateness": "lateness of the frames",
    "streams": "rates of the streams",
}


def page(recordings: Sequence[Recording]) -> str:
    """Return the page. Without matplotlib it has no pictures. Raises RecordingError."""
    names = [one_line(recording.title) for recording in recordings]
    if len(set(names)) < len(names):  # with their parents
        names = [one_line(recording.folder) for recording in recordings]
    told = [_told(name, recording) for name, recording in zip(names, recordings, strict=True)]
    return render(
        "arva_hil.records.report",
        "run.html",
        title=" and ".join(names) if len(names) <= 2 else f"{len(names)} runs",
        runs=told,
        sections=merged([facts(recording) for recording in recordings]),
        pictures=_pictures(names, recordings),
        differ=lambda values: len(set(values)) > 1,
    )


def _told(name: str, recording: Recording) -> dict[str, Any]:
    """Return the contents of the page about one run, apart from its facts."""
    happened = [one for event in recording.events if (one := _happened(event))]
    return {
        "name": name,
        "when": one_line(recording.run.started) if recording.run else "",
        "verdict": _verdict(recording),
        "notes": [one_line(note) for note in recording.notes],
        "events": happened[:_MOST_EVENTS],
        "more_events": max(0, len(happened) - _MOST_EVENTS),
    }


def _verdict(recording: Recording) -> str:
    """Return the run in one sentence."""
    words = []
    if recording.searches:
        errors = [in_metres(error) for error in errors_m(recording).values()]
        off = f", {', '.join(errors)} from the transmitter{'s' * (len(errors) > 1)}" if errors else ""
        words.append(found_of(recording) + off)
        for how in dict.fromkeys(search.how for search in recording.searches.values()):
            if how != "found":
                words.append(f"the search ended: {one_line(how)}" if how else "the search has not ended")
    if recording.run is not None:
        words.append(
            f"the run ended: {one_line(recording.run.ended)}" if recording.run.ended else "the run has not ended"
        )
        words.append(f"{sum(map(len, recording.receivers))} frames")
    return ", ".join(words)


def _happened(event: Any) -> dict[str, Any] | None:
    """Return the console's text of an event, with its time and level; None without one."""
    if (notice := notice_of(event)) is None:
        return None
    return {"time_s": event["time_s"], "level": notice.level, "text": one_line(notice.text)}


def _pictures(names: Sequence[str], recordings: Sequence[Recording]) -> list[tuple[str, str]] | None:
    """Return (caption, SVG in base64), pictures of one kind beside each other; None without matplotlib."""
    try:
        drawn = [list(pictures(recording, "svg", transparent=True)) for recording in recordings]
    except ModuleNotFoundError:
        return None
    found: list[tuple[int, str, str]] = []
    order = list(_CAPTIONS)
    for name, every in zip(names, drawn, strict=True):
        for receiver, kind, svg in every:
            of: Iterable[str] = filter(None, [name if len(names) > 1 else "", receiver, _CAPTIONS[kind]])
            found.append((order.index(kind), ": ".join(of), base64.b64encode(svg).decode()))
    found.sort(key=lambda one: one[0])
    return [(caption, svg) for _, caption, svg in found]
