"""Events in words. No other module makes sentences of events."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from arva_hil import events
from arva_hil.events import Event, searches, vehicles
from arva_hil.observers.console.reasons import failsafes, no_pose, no_vehicle, request
from arva_hil.observers.console.text import Level, Notice

Sentence = tuple[Level, str]


def sentence(event: Event, *, named: bool = False) -> Notice | None:
    """An event for a person; None if a person is told nothing. `named`: with the vehicle's or receiver's name."""
    make = _SENTENCES.get(type(event))
    if make is None or (isinstance(event, events.HeartbeatMissing) and not named):  # with one vehicle it ends the run
        return None
    if (made := make(event)) is None:
        return None
    level, text = made
    return Notice(level, f"{_name(event)}: {text}" if named and _name(event) else text)


def _name(event: Event) -> str:
    if isinstance(event, events.ReceiverEvent):
        return f"{event.vehicle}/{event.receiver}"
    return event.vehicle if isinstance(event, events.VehicleEvent) else ""


def _link_back(event: events.LinkBack) -> Sentence:
    after = f" after {event.away_s:.1f} s" if event.away_s else ""
    return "info", f"{event.address}: back{after}"


def _log_layout(event: events.LogLayout) -> Sentence:
    how = (
        f"it has {event.layout}" if event.layout else "it has no time stamps: times come from the vehicles' boot times"
    )
    return "info", f"{event.log}: {how}"


def _command(event: events.CommandReceived) -> Sentence:
    return "info", f"command {event.number} of the host: {' '.join([event.name, *map(str, event.values)])}"


def _answered(event: events.CommandAnswered) -> Sentence:
    said = " ".join([event.result, *([event.text] if event.text else []), *map(str, event.values)])
    return "info", f"command {event.number} answered: {said}" + ("" if event.sent else ", which nobody took")


def _pose_lost(event: events.PoseLost) -> Sentence:
    why = no_pose(event.lacking) if event.age_s is None else f"the newest is {event.age_s:.1f} s old"
    return "warning", f"no pose: frames say no signal until there is one ({why})"


def _datum(event: events.DatumSet) -> Sentence:
    why = f" ({event.reason})" if event.reason else ""
    return "info", f"datum: {event.lat:.7f}, {event.lon:.7f}, {event.alt:.2f} m AMSL{why}"


def _too_far(event: events.TooFar) -> Sentence:
    cure = "correct `datum` and `transmitters` in the scenario, or use `datum: home`"
    if not event.fixed:
        cure = (
            "the datum is the vehicle's home, and is read again after landing and disarming: set home there, or give "
            "a place in the scenario, `datum: {lat: …, lon: …, alt: …}`"
        )
    return "warning", (
        f"the vehicle is {event.from_datum_m / 1e3:.1f} km from the datum and {event.nearest_m / 1e3:.1f} km from the "
        f"nearest transmitter, too far to hear it: {cure}"
    )


def _other_autopilot(event: vehicles.OtherAutopilotIgnored) -> Sentence:
    cure = "it has the same ids as this one: give it others" if event.same_ids else "choose one with --target-system"
    return "info", f"another autopilot {event.system}/{event.component} on this link is ignored; {cure}"


def stream(event: vehicles.StreamEvent) -> str:
    """The text of a stream's event, without the stream's name."""
    asked = request(event.command, event.asked_hz, event.result)
    if isinstance(event, vehicles.StreamRateLowered):
        return f"{asked}; asking for {event.next_hz:g} Hz"
    assert isinstance(event, vehicles.StreamAskedOtherwise)
    return f"is slower than the {event.wanted_hz:g} Hz wanted ({asked}); trying REQUEST_DATA_STREAM"


def _arming(event: vehicles.ArmingTried) -> Sentence:
    before = f"; the last one was refused: {event.refused_order}: {event.refused_result}"
    return "info", (
        f"arming, try {event.number}; next try in {event.again_s:g} s{before if event.refused_order else ''}"
    )


def _throttle(event: vehicles.ThrottleAwaited) -> Sentence:
    stick = f"the pilot has moved a stick (channel {event.channel}, by {event.by_us} µs)"
    return "warning", (
        f"{stick if event.channel else 'the battery'}: the vehicle hovers in GUIDED until the throttle stick is in the "
        "middle, then LOITER is ordered"
    )


# -- searches ----------------------------------------------------------------------------------------------


def _from_search(event: searches.FromSearch) -> Sentence | None:
    made = sentence(event.event)
    return (made.level, f"search: {made.text}") if made else None


def _launched(event: searches.Launched) -> Sentence:
    return "info", f"{'taking over' if event.take_over else 'arming'} {event.label}"


def _consent(event: searches.ConsentNeeded) -> Sentence:
    how = "you would have to type yes here" if event.asked else "it would need --yes, because nobody can be asked here"
    return "warning", f"{event.label} is not known to be a simulator: before it flies, {how}"


def _dry_run(event: searches.DryRunBegun) -> Sentence:
    count_down = f" after a count-down of {event.countdown_s:g} s" if event.countdown_s else ""
    how = "taken over in the air" if event.take_over else "launched"
    return "info", f"dry run: all is ready. {event.label} would be {how}{count_down}, by these orders:"


def _set_point(event: searches.SetPointPlanned) -> Sentence:
    velocity = f"{event.v_north:z.2f} m/s north, {event.v_east:z.2f} m/s east, {event.v_down:z.2f} m/s down"
    heading = f"heading {event.heading_deg:z.0f}°, {event.rate_hz:g} times a second"
    return "info", f"  SET_POSITION_TARGET_LOCAL_NED: {velocity}, {heading}"


def _count_down(event: searches.CountDown) -> Sentence:
    return "info", f"{'taking over' if event.take_over else 'arming'} in {event.left_s} s"


def _paused(event: searches.SearchPaused) -> Sentence:
    if event.reason == "no frame":
        return "warning", f"no frame for {event.limit_s:g} s: hovering"
    return "warning", f"the readings did not change over {event.moved_m:g} m of flight: hovering"


def _gps_alone(margin_m: float) -> Sentence:
    added = f"{margin_m:g} m are added (--trust-height: none)" if margin_m else "nothing is added (--trust-height)"
    return "warning", f"no rangefinder and no barometer: the height comes from GPS alone; {added} to the height held"


def _resumed(event: searches.SearchResumed) -> Sentence:
    back = "frames are back" if event.reason == "no frame" else "the readings change again"
    return "info", f"{back}: the search goes on"


def _heard(event: searches.TransmitterHeard) -> Sentence:
    place = f"{event.north_m:z.1f} m north, {event.east_m:z.1f} m east of the take-off point"
    return "info", f"transmitter {_number(event)} is heard, {event.distance_m:.1f} m away, at {place}"


def _number(event: searches.TransmitterEvent) -> str:
    return "without a number" if event.transmitter is None else str(event.transmitter)


_WAITING: Final = {
    "link": "the autopilot's link",
    "autopilot": "an autopilot",
    "frame": "a frame from the receiver",
    "pose": "a pose",
    "hover": "a hover",
    "battery": "the battery: the vehicle reports it as not healthy, or has not measured it yet",
}
_INTERRUPTED: Final = {
    "arming": "the vehicle is disarmed",
    "disarming": "the vehicle is disarmed",
    "landing": "the vehicle lands; the mode switch stops it",
    "yielding": "the pilot gets the vehicle",
}
_HEIGHTS: Final[dict[str, Sentence]] = {
    "rangefinder": ("info", "height above the ground: from the rangefinder"),
    "highest ground": (
        "warning",
        "the rangefinder gives no usable values: the height is held above the highest ground that it measured",
    ),
    "estimate": (
        "warning",
        "no rangefinder is heard: the height is held above the take-off point; over a slope the height above the "
        "ground is different",
    ),
}
_SIGNATURES: Final = {
    "unsigned": "unsigned packets are ignored, the first from {}: does it have the key (SETUP_SIGNING)?",
    "forged": "packets signed with another key are ignored, the first from {}",
    "replayed": "packets with old time stamps are ignored, the first from {}: replayed, or its clock is behind",
}
_SENTENCES: Final[dict[type[Event], Callable[[Any], Sentence | None]]] = {
    events.ObserverFailed: lambda e: ("error", f"{e.observer} has failed and is switched off: {e.error}"),
    events.LinkLost: lambda e: ("warning", e.reason),
    events.LinkBlocked: lambda e: ("warning", e.reason),
    events.LinkThere: lambda e: ("info", f"{e.address}: is open"),
    events.LinkBack: _link_back,
    events.StrangersIgnored: lambda e: (
        "info",
        f"{e.address}: other senders than its peer are ignored; the first was {e.stranger}",
    ),
    events.LogLayout: _log_layout,
    events.LogClockSet: lambda e: (
        "warning",
        f"{e.log}: the clock of its computer was set during the recording: the vehicles' clocks are used instead",
    ),
    events.FollowedSystemSilent: lambda e: (
        "warning",
        f"system {e.system} {'is not heard any more' if e.was_heard else 'was never heard'}: transmitters that follow "
        "it are silent until its GLOBAL_POSITION_INT and ATTITUDE come on one of the links",
    ),
    events.FollowedSystemHeard: lambda e: ("info", f"system {e.system} is heard: transmitters follow it"),
    events.FramesLate: lambda e: (
        "warning",
        f"its frames are late, by {1e3 * e.late_s:.0f} ms now: this machine has too much to do; serve fewer vehicles, "
        "or lower rate_hz",
    ),
    events.FramesRefused: lambda e: ("warning", "nobody takes the frames: they are dropped until somebody reads them"),
    events.CommandReceived: _command,
    events.CommandAnswered: _answered,
    events.FramesTaken: lambda e: ("info", f"frames are taken; {e.dropped} were dropped so far"),
    events.PoseFound: lambda e: ("info", "there is a pose: readings are real from here on"),
    events.PoseLost: _pose_lost,
    events.PoseMissing: lambda e: ("warning", f"still no pose, frames say no signal: {no_pose(e.lacking)}"),
    events.TooFar: _too_far,
    events.DatumSet: _datum,
    events.HeartbeatMissing: lambda e: ("warning", f"{no_vehicle(e.heard)}; still waiting"),
    vehicles.VehicleFound: lambda e: (
        "info",
        f"vehicle {e.label}, MAVLink {e.version}{', signed' if e.signed else ''}",
    ),
    vehicles.SignaturesUnchecked: lambda e: (
        "warning",
        "its packets are signed. They are not checked, and it may refuse unsigned requests: use --signing-key FILE",
    ),
    vehicles.VehicleLost: lambda e: ("warning", f"no heartbeat from vehicle {e.label} for {e.silent_s:g} s"),
    vehicles.VehicleBack: lambda e: ("info", f"vehicle {e.label} is back"),
    vehicles.VehicleRebooted: lambda e: ("warning", f"vehicle {e.label} has rebooted: a new session"),
    vehicles.OtherAutopilotIgnored: _other_autopilot,
    vehicles.SignatureRefused: lambda e: ("warning", _SIGNATURES[e.verdict].format(f"{e.system}/{e.component}")),
    vehicles.ClockLeapt: lambda e: (
        "info",
        f"the vehicle's clock is ahead by {e.ahead_s:.0f} s: earlier packets came late",
    ),
    vehicles.PositionJumped: lambda e: ("warning", f"the vehicle's position has jumped by {e.by_m:.0f} m"),
    vehicles.StreamRateLowered: lambda e: ("warning", f"{e.stream}: {stream(e)}"),
    vehicles.StreamAskedOtherwise: lambda e: ("warning", f"{e.stream} {stream(e)}"),
    vehicles.AutopilotText: lambda e: ("warning", f"the autopilot says: {e.text}"),
    vehicles.ArmingTried: _arming,
    vehicles.ThrottleAwaited: _throttle,
    searches.FromSearch: _from_search,
    searches.WaitingFor: lambda e: ("info", f"waiting for {_WAITING[e.what]}"),
    searches.FailsafesKnown: lambda e: ("info", failsafes(dict(e.parameters), e.autopilot == "px4")),
    searches.SimulatorRecognized: lambda e: ("info", f"{e.label} is a simulator: it answers with {e.message}"),
    searches.ArmingAllowed: lambda e: ("warning", f"{e.label} is not known to be a simulator; --yes allows the flight"),
    searches.ConsentNeeded: _consent,
    searches.DryRunBegun: _dry_run,
    searches.WouldOrder: lambda e: ("info", f"  {e.order}: {e.what}"),
    searches.SetPointPlanned: _set_point,
    searches.CountDown: _count_down,
    searches.Launched: _launched,
    searches.SearchBegun: lambda e: ("info", f"{e.height_m:.1f} m high: the search begins"),
    searches.SearchEnded: lambda e: ("info", f"{e.how}; {'landing' if e.landing else 'hovering'}"),
    searches.SearchInterrupted: lambda e: (
        "info",
        f"interrupted: {_INTERRUPTED.get(e.phase, 'the vehicle stays hovering')}",
    ),
    searches.SearchHeldUp: lambda e: (
        "warning",
        f"the search did nothing for {e.gap_s:.1f} s: it checks who has the vehicle first",
    ),
    searches.StrategySlow: lambda e: (
        "warning",
        f"the strategy took {e.took_s:.1f} s to answer: the vehicle was not steered; a second time ends the search",
    ),
    searches.SearchPaused: _paused,
    searches.SearchResumed: _resumed,
    searches.ReceiverGone: lambda e: ("warning", f"the receiver is gone: {e.error}"),
    searches.OwnMarkHeard: lambda e: (
        "error",
        "what --gcs shows reaches the autopilot, which may evade it: not shown now",
    ),
    searches.TransmitterHeard: _heard,
    searches.TransmitterChosen: lambda e: ("info", f"going for transmitter {_number(e)}, {e.distance_m:.1f} m away"),
    searches.TransmitterFaded: lambda e: (
        "warning",
        f"transmitter {_number(e)} is not heard any more: back to the search strips",
    ),
    searches.DescentBegun: lambda e: ("info", "descending to the place reported"),
    searches.TooLow: lambda e: (
        "warning",
        f"only {e.height_m:.1f} m above the ground, {e.wanted_m:g} m are wanted: climbing",
    ),
    searches.HeightSource: lambda e: _gps_alone(e.margin_m) if e.source == "GPS" else _HEIGHTS[e.source],
}
