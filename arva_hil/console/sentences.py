"""Events in words. The only place where news becomes a sentence."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from arva_hil import events
from arva_hil.events import Event
from arva_hil.notice import Level, Notice

Sentence = tuple[Level, str]


def sentence(event: Event, *, named: bool = False) -> Notice | None:
    """What a person is told of an event, None when that is nothing. `named`: with the vehicle's or receiver's name."""
    make = _SENTENCES.get(type(event))
    if make is None or (isinstance(event, events.HeartbeatMissing) and not named):  # the only vehicle: the run's end
        return None
    level, text = make(event)
    return Notice(level, f"{_name(event)}: {text}" if named and _name(event) else text)


def _name(event: Event) -> str:
    if isinstance(event, events.ReceiverEvent):
        return f"{event.vehicle}/{event.receiver}"
    return event.vehicle if isinstance(event, events.VehicleEvent) else ""


def _link_back(event: events.LinkBack) -> Sentence:
    after = f" after {event.away_s:.1f} s" if event.away_s else ""
    return "info", f"{event.address}: back{after}"


def _log_layout(event: events.LogLayout) -> Sentence:
    how = f"it has {event.layout}" if event.layout else "it has no times: they come from the vehicles' boot times"
    return "info", f"{event.log}: {how}"


def _pose_lost(event: events.PoseLost) -> Sentence:
    why = event.lacking if event.age_s is None else f"the newest is {event.age_s:.1f} s old"
    return "warning", f"no pose: frames say no signal until there is one ({why})"


def _datum(event: events.DatumSet) -> Sentence:
    why = f" ({event.reason})" if event.reason else ""
    return "info", f"datum: {event.lat:.7f}, {event.lon:.7f}, {event.alt:.2f} m AMSL{why}"


def _too_far(event: events.TooFar) -> Sentence:
    cure = "correct `datum` and `transmitters` in the scenario, or use `datum: home`"
    if not event.fixed:
        cure = (
            "the datum is the vehicle's home, and after landing and disarming a new one: set home there, or name a "
            "place in the scenario, `datum: {lat: …, lon: …, alt: …}`"
        )
    return "warning", (
        f"the vehicle is {event.from_datum_m / 1e3:.1f} km from the datum and {event.nearest_m / 1e3:.1f} km from the "
        f"nearest transmitter, too far to hear it: {cure}"
    )


_SENTENCES: Final[dict[type[Event], Callable[[Any], Sentence]]] = {
    events.ObserverFailed: lambda e: ("error", f"{e.observer} has failed and is switched off: {e.error}"),
    events.LinkLost: lambda e: ("warning", e.reason),
    events.LinkBlocked: lambda e: ("warning", e.reason),
    events.LinkThere: lambda e: ("info", f"{e.address}: is there"),
    events.LinkBack: _link_back,
    events.StrangersIgnored: lambda e: (
        "info",
        f"{e.address}: what others than its peer send is ignored, as from {e.stranger}",
    ),
    events.LogLayout: _log_layout,
    events.LogClockSet: lambda e: (
        "warning",
        f"{e.log}: its clock was set while it was written: time goes on by the vehicles' own clocks",
    ),
    events.FramesRefused: lambda e: ("warning", "nobody takes the frames: they are dropped until somebody does"),
    events.FramesTaken: lambda e: ("info", f"frames are taken; {e.dropped} were dropped so far"),
    events.PoseFound: lambda e: ("info", "there is a pose: readings are real from here on"),
    events.PoseLost: _pose_lost,
    events.PoseMissing: lambda e: ("warning", f"still no pose, frames say no signal: {e.lacking}"),
    events.TooFar: _too_far,
    events.DatumSet: _datum,
    events.HeartbeatMissing: lambda e: ("warning", f"{e.heard}; it is still waited for"),
    events.Said: lambda e: (e.level, e.text),
}
