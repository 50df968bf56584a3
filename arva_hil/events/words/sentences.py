"""Events in words. No other module makes sentences of events."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Final

from arva_hil import events
from arva_hil.events import Event, searches, vehicles
from arva_hil.events.words.reasons import (
    STICKS,
    WordFormatter,
    failsafes,
    in_words,
    no_pose,
    no_vehicle,
    order_in_words,
    request,
)
from arva_hil.events.words.text import Level, Notice, placed


def sentence(event: Event, *, named: bool = False) -> Notice | None:
    """Return the notice of an event; None without one. `named`: with the vehicle's or receiver's name."""
    if isinstance(event, searches.FromSearch):
        told = sentence(event.event)
        return told and Notice(told.level, f"{event.vehicle or 'search'}: {told.text}")
    form = _SENTENCES.get(type(event), "")
    if not form or (isinstance(event, events.HeartbeatMissing) and not named):  # with one vehicle it ends the run
        return None
    form = form if isinstance(form, str) else form(event)
    levels: tuple[Level, ...] = "warning", "error"
    level: Level = next((level for level in levels if form.startswith(f"{level}: ")), "info")
    text = _FORMATTER.vformat(form.removeprefix(f"{level}: "), (), {"event": event, **vars(event)})
    return Notice(level, f"{_name(event)}: {text}" if named and _name(event) else text)


def _name(event: Event) -> str:
    if isinstance(event, events.ReceiverEvent):
        return f"{event.vehicle}/{event.receiver}"
    return event.vehicle if isinstance(event, events.VehicleEvent) else ""


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
_DATUM_CURES: Final = {
    True: "correct `datum` and `transmitters` in the scenario, or use `datum: home`",
    False: "the datum is the vehicle's home, and is read again after landing and disarming: set home there, or give "
    "a place in the scenario, `datum: {lat: …, lon: …, alt: …}`",
}
_IN_WORDS: Final[Mapping[str, Callable[[Any], str]]] = {
    "control": lambda channel: "stick" if channel <= STICKS else "switch",
    "datum_cure": _DATUM_CURES.__getitem__,
    "failsafes": lambda e: failsafes(dict(e.parameters), e.autopilot == "px4", e.remote),
    "interrupted": lambda phase: _INTERRUPTED.get(phase, "the vehicle stays hovering"),
    "km": lambda metres: f"{metres / 1e3:.1f} km",
    "ms": lambda seconds: f"{1e3 * seconds:.0f} ms",
    "no_pose": no_pose,
    "no_vehicle": no_vehicle,
    "number": lambda id_: "without a number" if id_ is None else str(id_),
    "order": order_in_words,
    "of": lambda wanted: "" if wanted is None else f" of {wanted}",
    "request": lambda e: request(e.command, e.asked_hz, e.result),
    "place": lambda e: placed(e.north_m, e.east_m),
    "reasons": in_words,
    "reported": lambda value: "was not reported" if value is None else f"is {value:g}",
    "values": lambda values: "".join(f" {value}" for value in values),
    "waiting": _WAITING.__getitem__,
}
_FORMATTER: Final = WordFormatter(_IN_WORDS)
_NOTED: Final = (
    "victim {number}{wanted:of}: transmitter {transmitter:number} at {event:place} of the take-off point"
    "{sure:|, not sure}, {marked:marked by the receiver|recorded, not marked}"
)
_FADED: Final = {
    True: "warning: the flux lines of transmitter {transmitter:number} point anywhere, as noise: back to the search "
    "strips",
    False: "warning: transmitter {transmitter:number} is {hardly:hardly received|not received any more}: back to the "
    "search strips",
}
_LEFT: Final = "; {left} more received{more:, and more than a frame has|}"
_HEIGHTS: Final = {
    "rangefinder": "height above the ground: from the rangefinder",
    "highest ground": "warning: the rangefinder gives no usable values: the height is held above the highest ground "
    "that it measured",
    "estimate": "warning: no rangefinder sends values: the height is held above the take-off point; over a slope the "
    "height above the ground is different",
    "terrain": "the autopilot's terrain data say that the ground falls: the search follows it, {margin_m:g} m "
    "higher than asked",
    "doubtful terrain": "warning: the autopilot's terrain data do not agree with its position, and are ignored: the "
    "height is held above the take-off point",
    "GPS": "warning: no rangefinder and no barometer: the height comes from GPS alone; "
    "{margin_m:{margin_m:g} m are added (--trust-height: none)|nothing is added (--trust-height)} to the height held",
}
_PAUSES: Final = {
    "no frame": "warning: no frame for {limit_s:g} s: hovering",
    "same readings": "warning: the readings did not change over {moved_m:g} m of flight: hovering",
}
_RESUMED: Final = {
    "no frame": "frames are back: the search goes on",
    "same readings": "the readings change again: the search goes on",
}
_SIGNATURES: Final = {
    "unsigned": "warning: unsigned packets are ignored, the first from {system}/{component}: does it have the key "
    "(SETUP_SIGNING)?",
    "forged": "warning: packets signed with another key are ignored, the first from {system}/{component}",
    "replayed": "warning: packets with old time stamps are ignored, the first from {system}/{component}: replayed, or "
    "its clock is behind",
}
_POSE_LOST: Final = {  # by whether there was one before
    True: "warning: no pose: frames have no signal until there is one (the newest is {age_s:.1f} s old)",
    False: "warning: no pose: frames have no signal until there is one ({lacking:no_pose})",
}
_NO_GROUND: Final = {  # by whether the autopilot is asked for it
    True: "warning: the ground is not known at these transmitters, which are silent:{ids:values}. The autopilot has "
    "not sent it yet: its terrain data must be switched on and loaded",
    False: "warning: the ground is not known at these transmitters, which are silent:{ids:values}. {terrain} has no "
    "height there or at the datum: is it of this place?",
}
_DOUBTS: Final = {
    "set-points too rare": "warning: {parameter} {value:reported}: the vehicle may stop between two set-points, which "
    "come every 0.2 s; set it to 1 to 3 s",
    "flies on": "warning: {parameter} {value:reported}: the vehicle flies on for as many seconds if set-points stop; "
    "set it to 1 to 3 s",
    "sticks ignored": "warning: {parameter} {value:reported}: without bit 0 PX4 ignores the sticks in LAND and "
    "Hold; set the bit, or take over with the mode switch",
}
_SENTENCES: Final[Mapping[type[Event], str | Callable[[Any], str]]] = {  # or what chooses one of several
    events.ObserverFailed: "error: {observer} has failed and is switched off: {error}",
    events.LinkLost: "warning: {reason}",
    events.LinkBlocked: "warning: {reason}",
    events.LinkThere: "{address}: is open",
    events.LinkBack: "{address}: back{away_s: after {away_s:.1f} s|}",
    events.StrangersIgnored: "{address}: other senders than its peer are ignored; the first was {stranger}",
    events.LogLayout: "{log}: it has {layout:{layout}|no time stamps: times come from the vehicles' boot times}",
    events.LogClockSet: "warning: {log}: the clock of its computer was set during the recording: the vehicles' clocks "
    "are used instead",
    events.FollowedSystemSilent: "warning: system {system} {was_heard:sends nothing any more|never sent anything}: "
    "transmitters that follow it are silent until its GLOBAL_POSITION_INT and ATTITUDE come on one of the links",
    events.FollowedSystemHeard: "system {system} sends its position: transmitters follow it",
    events.FramesLate: "warning: its frames are late, now by {late_s:ms}: this machine is overloaded; serve fewer "
    "vehicles, or lower rate_hz",
    events.FramesRefused: "warning: no program takes the frames: they are dropped until one reads them",
    events.ReceiverRestarted: "warning: the receiver has restarted: frame {after} follows frame {before}",
    events.CommandReceived: "command {number} of the host: {name}{values:values}",
    events.CommandAnswered: "command {number} answered: {result}{text: {text}|}{values:values}"
    "{sent:|, which no program took}",
    events.FramesTaken: "frames are taken; {dropped} were dropped so far",
    events.PoseFound: "there is a pose: readings are real from here on",
    events.PoseLost: lambda e: _POSE_LOST[e.age_s is not None],
    events.PoseMissing: "warning: still no pose, frames have no signal: {lacking:no_pose}",
    events.TooFar: "warning: the vehicle is {from_datum_m:km} from the datum and {nearest_m:km} from the nearest "
    "transmitter, too far to receive it: {fixed:datum_cure}",
    events.DatumSet: "datum: {lat:.7f}, {lon:.7f}, {alt:.2f} m AMSL{reason: ({reason:reasons})|}",
    events.GroundMissing: lambda e: _NO_GROUND[e.terrain == "autopilot"],
    events.GroundFound: "the autopilot has sent the height of the ground: all transmitters send",
    events.MotorsSilent: "warning: the vehicle does not report its motors' load (VFR_HUD, BATTERY_STATUS): their "
    "noise stays that of {load:.0%} load",
    events.MotorsHeard: "the vehicle reports its motors' load",
    events.HeartbeatMissing: "warning: {heard:no_vehicle}",
    vehicles.VehicleFound: "vehicle {label}, MAVLink {version}{signed:, signed|}",
    vehicles.SignaturesUnchecked: "warning: its packets are signed. They are not checked, and it may refuse unsigned "
    "requests: use --signing-key FILE",
    vehicles.VehicleLost: "warning: no heartbeat from vehicle {label} for {silent_s:g} s",
    vehicles.VehicleBack: "vehicle {label} is back",
    vehicles.VehicleRebooted: "warning: vehicle {label} has rebooted: a new session",
    vehicles.OtherAutopilotIgnored: "another autopilot {system}/{component} on this link is ignored; "
    "{same_ids:it has the same ids as this one: change them|choose one with --target-system}",
    vehicles.SignatureRefused: lambda e: _SIGNATURES[e.verdict],
    vehicles.ClockLeapt: "the vehicle's clock is ahead by {ahead_s:.0f} s: earlier packets came late",
    vehicles.PositionJumped: "warning: the vehicle's position has jumped by {by_m:.0f} m",
    vehicles.StreamRateLowered: "warning: {stream}: {event:request}; asking for {next_hz:g} Hz",
    vehicles.StreamAskedOtherwise: "warning: {stream} is slower than the {wanted_hz:g} Hz wanted ({event:request}); "
    "trying REQUEST_DATA_STREAM",
    vehicles.AutopilotText: "warning: the autopilot reports: {text}",
    vehicles.ArmingTried: "arming, try {number}; next try in {again_s:g} s"
    "{refused_order:; the last one was refused: {refused_order}: {refused_result}|}",
    vehicles.ThrottleAwaited: "warning: {channel:the pilot has moved a {channel:control} (channel {channel}, by "
    "{by_us} µs)|the battery}: the vehicle hovers in GUIDED until the throttle stick is in the middle, then LOITER is "
    "ordered",
    searches.WaitingFor: "waiting for {what:waiting}",
    searches.FailsafesKnown: "{event:failsafes}",
    searches.ParameterDoubted: lambda e: _DOUBTS[e.doubt],
    searches.FenceInArea: "warning: {reach_m:the area reaches {reach_m:.0f} m from the take-off point, beyond the "
    "vehicle's fence|the vehicle has a fence of its own shape, which is not compared with the area} ({parameter} "
    "{value:g}): the vehicle does not fly beyond it",
    searches.SimulatorRecognized: "{label} is a simulator: it answers with {message}",
    searches.ArmingAllowed: "warning: {label} is not known to be a simulator; --yes allows the flight",
    searches.ConsentNeeded: "warning: {label} is not known to be a simulator: before it flies, "
    "{asked:you would have to type yes here|it would need --yes, because there is no terminal to ask at}",
    searches.DryRunBegun: "dry run: all is ready. {label} would be {take_over:taken over in the air|launched}"
    "{countdown_s: after a count-down of {countdown_s:g} s|}, by these orders:",
    searches.WouldOrder: "  {order}: {what:order}",
    searches.SetPointPlanned: "  SET_POSITION_TARGET_LOCAL_NED: {v_north:z.2f} m/s north, {v_east:z.2f} m/s east, "
    "{v_down:z.2f} m/s down, heading {heading_deg:z.0f}°, {rate_hz:g} times a second",
    searches.CountDown: "{take_over:taking over|arming} in {left_s} s",
    searches.Launched: "{take_over:taking over|arming} {label}",
    searches.SearchBegun: "{height_m:.1f} m high: the search begins",
    searches.SearchEnded: "{how:reasons}; {landing:landing|hovering}",
    searches.SearchInterrupted: "interrupted: {phase:interrupted}",
    searches.SearchHeldUp: "warning: the search did nothing for {gap_s:.1f} s: first it checks who controls the "
    "vehicle",
    searches.StrategySlow: "warning: the strategy has not answered for {took_s:.1f} s, {starved_s:.1f} s of them "
    "without a processor: the vehicle hovers until it does",
    searches.SearchPaused: lambda e: _PAUSES[e.reason],
    searches.SearchResumed: lambda e: _RESUMED[e.reason],
    searches.ReceiverGone: "warning: the receiver is gone: {error}",
    searches.OwnMarkHeard: "error: the autopilot receives the vehicle of --gcs, and may evade it: nothing is "
    "sent there now",
    searches.TransmitterHeard: "received transmitter {transmitter:number}, {distance_m:.1f} m away, at "
    "{event:place} of the take-off point",
    searches.TransmitterChosen: "going for transmitter {transmitter:number}, {distance_m:.1f} m away",
    searches.TransmitterFaded: lambda e: _FADED[e.noise],
    searches.TransmitterLeft: "transmitter {transmitter:number} is left to another search",
    searches.TeammateLost: "warning: the search of vehicle {number} sends nothing any more: this one stays {apart_m:g} "
    "m from where it was, {event:place} of the take-off point",
    searches.TeammateBack: "the place of vehicle {number} is known again",
    searches.VictimNoted: lambda e: _NOTED + ("" if e.left is None else _LEFT),
    searches.VictimAgain: "warning: this is victim {number} again, as transmitter {transmitter:number}: {apart_m:.1f} "
    "m from the place recorded",
    searches.PlaceDoubted: "warning: the readings of transmitter {transmitter:number} contradict the place, or ± "
    "relative to the drone is above 0.4 m: the search flies to it once more",
    searches.TransmitterMoves: "warning: transmitter {transmitter:number} moves, at about {speed_m_s:.1f} m/s: a "
    "rescuer who transmits? It is put aside, last {event:place} of the take-off point",
    searches.ReceiverTurned: "warning: the receiver is turned by some {degrees:+.0f}° from its reported heading: check "
    "compass and --mount. The place allows for it",
    searches.ReceiverKnown: "the receiver is {text}",
    searches.MarksNotTaken: "warning: the receiver cannot mark transmitters ({answer}): victims are only recorded",
    searches.MarkLost: "warning: the receiver has lost the mark of victim {number}",
    searches.DescentBegun: "descending to the place reported",
    searches.TooLow: "warning: only {height_m:.1f} m above the ground, {wanted_m:g} m are wanted: climbing",
    searches.SetPointsNotFollowed: "warning: the vehicle does not follow its set-points: {flown_m:.1f} m in "
    "{seconds:.0f} s, {ordered_m:.1f} m ordered: a fence or an obstacle ahead (AVOID_ENABLE, CP_DIST), or set-points "
    "are lost on the link. It flies sideways once",
    searches.SensorsDisagree: "warning: the {sensor} says {value_m:.1f} m, and the {other} {other_m:.1f} m: the search "
    "flies by the lower height",
    searches.HeightSource: lambda e: _HEIGHTS[e.source],
}
