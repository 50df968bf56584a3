"""Reasons as sentences, with the likely cure; the reaction of a vehicle to missing set-points."""

from __future__ import annotations

import string
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

from arva_hil.events.reasons import NoPose, NoVehicle, Reason, SilentStream, Why
from arva_hil.events.searches import OrderDetail

_NO_POSE = {
    "no vehicle": "no vehicle yet",
    "no home": "waiting for HOME_POSITION",
    "impossible position": "the position is out of range: no GPS fix yet",
    "streams stopped": "the streams have stopped",
}


_NO_VEHICLE: Final = {
    "link lost": "no autopilot was found: {link_error}",
    "silence": "no byte came: is the autopilot powered, and sending MAVLink on this link?",
    "no packets": "{bytes} bytes came, but no MAVLink packet: is the baud rate right, and the port's protocol MAVLink?",
    "no signature": "{packets} packets came, but no autopilot's with the key: {counts}",
    "other vehicles": "{packets} packets came, but none of the wanted vehicle: {who}; is its system id right?",
    "no heartbeat": "{packets} packets came, but no autopilot's heartbeat: {who}",
}


def no_vehicle(why: NoVehicle) -> str:
    """Return the traffic received, in words, if no vehicle was found."""
    counts = ", ".join(f"{count} {verdict}" for verdict, count in why.refused)
    who = ", ".join(f"{s.what} from {s.system}/{s.component} ×{s.times}" for s in why.sources)
    if why.reason in ("other vehicles", "no heartbeat") and not who:
        return f"{why.packets} packets came, all of other vehicles: is this one powered, and its system id right?"
    return _NO_VEHICLE[why.reason].format(counts=counts, who=who, **vars(why))


def no_pose(why: NoPose) -> str:
    """Return the reason why a vehicle has no pose."""
    if why.reason in _NO_POSE:
        return _NO_POSE[why.reason]
    if why.reason == "no truth":
        simulators = "only the simulators of ArduPilot and PX4 send their"
        who = f"no {why.message}: only a simulator sends its" if why.message else simulators
        return f"{who} vehicle's true pose; use `pose: estimate` otherwise"
    zeros = ["the position is all zeros: no GPS fix yet"] if why.reason == "zero position" else []
    return ", ".join(zeros + [_silent(stream) for stream in why.streams])


def request(command: str, asked_hz: float, result: str) -> str:
    """Return a request for a stream and its result; "" if nothing is known."""
    if not command:
        return ""
    if command == "REQUEST_DATA_STREAM":
        return f"{command} at {asked_hz:g} Hz: never acknowledged"
    return f"{command} to {asked_hz:g} Hz: {result}" if result else f"{command}: no answer"


def _silent(stream: SilentStream) -> str:
    silence = "none in the log lately" if stream.recorded else "not asked for yet"
    text = f"no {stream.name} ({request(stream.command, stream.asked_hz, stream.result) or silence})"
    return f"{text}: PX4 sends none before it has a position; no GPS fix yet?" if stream.promised else text


_RADIO_STATION: Final = ("FS_THR_ENABLE", "FS_GCS_ENABLE"), ("NAV_RCL_ACT", "NAV_DLL_ACT")  # ArduPilot's, PX4's
_FS: Final = {
    0: "nothing",
    1: "RTL",
    2: "RTL",
    3: "SmartRTL or RTL",
    4: "SmartRTL or LAND",
    5: "LAND",
    6: "the mission's landing or RTL",
    7: "BRAKE or LAND",
}
_FS_THR: Final = _FS | {3: "LAND", 4: "SmartRTL or RTL", 5: "SmartRTL or LAND"}
_IN_GUIDED: Final = 4  # of FS_OPTIONS: without a radio it continues in GUIDED
_OFFBOARD_LOST: Final = {
    0: "goes to Position mode",
    1: "goes to Altitude mode",
    2: "goes to Stabilized mode",
    3: "returns",
    4: "lands",
    5: "holds",
    6: "terminates",
    7: "disarms",
}
_BY_STICKS: Final = (0, 1, 2)  # of these
_STICKS: Final = {
    0: "PX4 ignores it",
    1: "PX4 follows it in its auto modes, not in OFFBOARD, where the search orders Hold",
    2: "PX4 follows it in OFFBOARD, not in its auto modes",
    3: "PX4 follows it, in its auto modes and in OFFBOARD",
}
_PX4_LOST: Final = {0: "nothing", 1: "Hold", 2: "Return", 3: "Land", 5: "termination", 6: "disarming"}


def left_alone(values: Mapping[str, float], px4: bool, remote: bool) -> str:
    """Return the reaction to missing set-points in GUIDED or Offboard, in words. `remote`: it has a remote control."""
    if not px4:
        after = _after(values, "GUID_TIMEOUT", "s")
        return f"it stops{after}, and hovers in GUIDED, armed, until the pilot takes control"
    act, after = _word(values, "COM_OBL_RC_ACT", _OFFBOARD_LOST), _after(values, "COM_OF_LOSS_T", "s")
    if act and not remote and values["COM_OBL_RC_ACT"] in _BY_STICKS:
        return f"it {act}{after}, and sinks there and lands where it is, because it has no remote control"
    return f"it {act}{after}" if act else f"its action is unknown{after}: it did not report COM_OBL_RC_ACT"


def failsafes(values: Mapping[str, float], px4: bool, remote: bool) -> str:
    """Return the reaction to missing set-points, radio and station, in words; with PX4 also to a stick."""
    radio, station = _RADIO_STATION[px4]
    without = _word(values, radio, _PX4_LOST if px4 else _FS_THR) or f"unknown ({radio})"
    if int(values.get("FS_OPTIONS", 0)) & _IN_GUIDED:
        without = f"nothing in GUIDED (FS_OPTIONS {values['FS_OPTIONS']:g})"
    ground = _word(values, station, _PX4_LOST if px4 else _FS) or f"unknown ({station})"
    alone = f"without set-points {left_alone(values, px4, remote)}"
    sticks = _word(values, "COM_RC_OVERRIDE", _STICKS)
    moved = f"; if a stick moves: {sticks}" if sticks else ""
    return f"{alone}; without a radio: {without}; without a ground station: {ground}{moved}"


def _word(values: Mapping[str, float], name: str, words: Mapping[int, str]) -> str:
    """Return the meaning of a parameter's value, and the parameter; "" if the vehicle did not report it."""
    value = values.get(name)
    return "" if value is None else f"{words.get(int(value), 'an unknown action')} ({name} {value:g})"


def _after(values: Mapping[str, float], name: str, unit: str) -> str:
    value = values.get(name)
    return f" after an unknown time ({name})" if value is None else f" after {value:g} {unit} ({name})"


def in_words(reasons: Reason | Sequence[Reason] | str | None) -> str:
    """Return reasons in words, "" without one. Those that a record has are in words already."""
    if isinstance(reasons, str):
        return reasons
    every = [reasons] if isinstance(reasons, Reason) else reasons or ()
    return "; ".join(_one(reason) for reason in every)


def order_in_words(detail: OrderDetail | str) -> str:
    """Return the content of an order in words. That of a record is in words already."""
    if isinstance(detail, str):
        return detail
    if detail.height_m is not None:
        return f"to {detail.height_m:g} m above the take-off point"
    if detail.set_points_hz is not None:
        return f"set-points flow, 0 m/s, {detail.set_points_hz:g} a second; then {detail.mode}"
    return ", ".join(filter(None, [detail.mode, "at the end" if detail.at_end else ""])) or "arm"


class WordFormatter(string.Formatter):
    """`{field:yes|no}`: one of two texts, by whether the field is true; `{field:kind}`: by a function of `words`."""

    def __init__(self, words: Mapping[str, Callable[[Any], str]]) -> None:
        self._words = words

    def format_field(self, value: Any, spec: str) -> str:
        yes, either, no = spec.rpartition("|")
        if either:
            return yes if value else no
        return self._words[spec](value) if spec in self._words else str(super().format_field(value, spec))


_FORMATTER: Final = WordFormatter({})


def _one(reason: Reason) -> str:
    form = _WORDS[reason.why]
    return _FORMATTER.vformat(form, (), reason.values) if isinstance(form, str) else form(**reason.values)


def _not_all(where: str, nothing: str, found: int, wanted: int | None, more: int, unsure: int = 0) -> str:
    """Return the end of a search that has not found all that it searched for."""
    if not found and not unsure:
        return nothing
    doubtful = f", {unsure} not sure" if unsure else ""
    if wanted:
        return f"{found} of {wanted} found{doubtful} {where}"
    return f"{found} found{doubtful} {where}, {more} more received"


def _strips_flown(heard: bool, twice: bool, team: bool, **counts: Any) -> str:
    strips = "all strips are flown" + (", those of other parts as the team reports" if team else "")
    nothing = f"{'no signal agrees with a place' if heard else 'no signal'}: {strips}{', twice' if twice else ''}"
    return _not_all("on all strips", nothing, **counts)


def _receiver_silent(link: str, age_s: float | None, repeated: int | None, first_bytes: bytes) -> str:
    why = "nothing came"
    if age_s is not None:
        again = "" if repeated is None else f", and its sequence number {repeated} again and again since"
        why = f"the last one came {age_s:.0f} s ago{again}"
    elif first_bytes:
        why = f"bytes came that are none, first {first_bytes!r}: is the format right, and the baud rate?"
    return f"no frame from the receiver at {link}: {why}"


def _not_followed(seconds: float, ordered_m: float, flown_m: float, off_deg: float | None) -> str:
    how = "it hardly moves" if off_deg is None else f"it flies {abs(off_deg):.0f}° off"
    cause = "its compass is wrong, the wind is too strong, or another program steers it"
    if off_deg is None:
        cause = "a fence or an obstacle stops it (AVOID_ENABLE, CP_DIST), or set-points are lost on the link"
    flown = f"{flown_m:.1f} m in {seconds:.0f} s, {ordered_m:.1f} m ordered"
    return f"the vehicle does not follow its set-points: {how} ({flown}): {cause}"


STICKS: Final = 4  # of the channels; the others are switches and knobs
_TASKS: Final = {
    "arming": "arm",
    "climbing": "take off",
    "flying": "follow velocities",
    "landing": "land",
    "disarming": "disarm",
    "holding": "hover",
    "yielding": "hover for the pilot",
}
_REAL: Final = "{label} is not known to be a simulator"
_WORDS: Final[Mapping[Why, str | Callable[..., str]]] = {
    Why.HOME_CAME: "home has come",
    Why.HOME_MOVED: "home has moved",
    Why.HOME_AFTER_LANDING: "a new home after landing",
    Why.POSITION_JUMPED: "its position has jumped",
    Why.REBOOTED: "the vehicle has rebooted",
    Why.FOUND: "found",
    Why.NOT_SURE: "not sure: the readings contradict the place, or ± relative to the drone is above 0.4 m",
    Why.TIME_UP: lambda limit_s, **counts: _not_all(f"in {limit_s:g} s", f"not found in {limit_s:g} s", **counts),
    Why.STRIPS_FLOWN: _strips_flown,
    Why.ON_THE_GROUND: "it is on the ground, or it does not sink as ordered because set-points are lost",
    Why.SENSORS_DISAGREE: lambda pairs: "; ".join(
        f"the {one} says {a:.1f} m, and the {two} {b:.1f} m" for one, a, two, b in pairs
    ),
    Why.TOO_LOW: "it does not climb above {metres:.1f} m",
    Why.TOO_FAR: "it is more than {metres:g} m outside the area",
    Why.STRATEGY_FAILED: "{text}",
    Why.NO_FRAME: "no good frame from the receiver for {seconds:g} s",
    Why.SAME_READING: "the receiver repeats the same reading: it is stuck",
    Why.INTERRUPTED: "interrupted",
    Why.NO_END: "it did not end",
    Why.ERROR: "{text}",
    Why.NO_AUTOPILOT: lambda heard: f"no autopilot: {no_vehicle(heard)}",
    Why.MODE_SET_BY_PROGRAM: "another program has set the mode that follows set-points, while this search was waiting: "
    "end that program, and start the search again",
    Why.ARMED_ALREADY: "the vehicle is armed already: a search starts on the ground, or with --take-over in a hover",
    Why.RECEIVER_AWAY: "no frame from the receiver: {text}",
    Why.RECEIVER_UNFIT: "{failed:the receiver's self-test has failed|the receiver does not search}: "
    "restart it away from transmitters and electronics",
    Why.RECEIVER_SILENT: _receiver_silent,
    Why.NO_POSE: lambda lacking: f"no pose: {no_pose(lacking)}",
    Why.CANNOT_TAKE_OVER: lambda because: f"the vehicle is not taken over: {in_words(because)}",
    Why.BATTERY_LOW_BEFORE: "low battery: charge or change it, and restart the autopilot; nothing was flown",
    Why.BATTERY_UNKNOWN_BEFORE: "the battery is not healthy, or not measured: nothing was flown",
    Why.PORT_SHARED: lambda port, readers: (
        f"{port} is read by {', '.join(readers)} too, and each gets a part of the frames; close the other program"
    ),
    Why.BEYOND_FENCE: "{area:the whole area is|the height is} beyond the vehicle's fence ({parameter} {metres:g}), "
    "{needed_m:g} m needed; nothing was ordered",
    Why.NOBODY_ASKED: f"{_REAL}: to let it fly, write --yes",
    Why.ANSWER_NO: f"{_REAL}, and the answer was not yes: nothing was done",
    Why.ANSWER_LATE: f"{_REAL}, and no person typed yes within {{seconds:g}} s: nothing was done",
    Why.OTHER_SEARCH: "another search ({name}) "
    "{flies:flies this vehicle; this one sends nothing more|has this vehicle}; end one of the two",
    Why.WOULD_FLY: "dry run: nothing was ordered; it would have flown",
    Why.WOULD_END: lambda because: f"dry run: {in_words(because)}; nothing was ordered",
    Why.HOME_UNKNOWN: "its home position is not known",
    Why.NOT_ARMED: "it is not armed",
    Why.IN_MODE: "it is in {mode}",
    Why.NEAR_HOME: "it is {height_m:.1f} m above home, less than {least_m:g} m",
    Why.RANGEFINDER_HIGH: "the rangefinder measures {measured_m:.1f} m, but it is {height_m:.1f} m above home",
    Why.MOVES: "it moves at {speed:.1f} m/s",
    Why.JUST_STOPPED: "it has just come to a halt",
    Why.POSE_LOST: lambda seconds, lacking: f"no pose for {seconds:g} s: {no_pose(lacking)}",
    Why.NOT_FOLLOWED: _not_followed,
    Why.BLOCKED_BELOW: "it hovers, because another vehicle of the team reports that it is below; take over and land",
    Why.AUTOPILOT_SILENT: "the autopilot sends no heartbeat any more",
    Why.STILL_ARMED: lambda because: (
        "the vehicle is still armed, and does not report that it has landed. If it stands, "
        f"keep away from the propellers and disarm it from the radio or the ground station ({in_words(because)})"
    ),
    Why.GOES_ON_LANDING: "the vehicle is left to its own failsafe: it continues to land",
    Why.LEFT_ALONE: lambda parameters, px4, remote: (
        f"the vehicle is left to its own failsafe: {left_alone(parameters, px4, remote)}"
    ),
    Why.OTHER_IDS: "the vehicle that was launched is {vehicle}, and now {other} uses its ids",
    Why.CLOCK_AHEAD: "its clock is {seconds:.1f} s ahead of the one of the vehicle that was launched",
    Why.CLOCK_BACK: "it has rebooted, or it is not the vehicle that was launched: its clock has gone back",
    Why.PLACE_JUMPED: "its position has jumped by {metres:.0f} m, or it is another vehicle",
    Why.MODE_UNKNOWN: "the vehicle has not reported its mode for {seconds:g} s"
    "{late_s:, or not within {late_s:g} s of a question|}",
    Why.ANSWERS_LATE: "the link is slow: an answer of the vehicle takes more than {seconds:g} s",
    Why.NO_RADIO: "the autopilot receives no radio, so the pilot cannot have it",
    Why.NOT_DONE: lambda phase, because: f"the vehicle does not {_TASKS[phase]}: {in_words(because)}",
    Why.NO_EXPLANATION: "it gives no reason",
    Why.UNDER_ANOTHER: "another vehicle of the team is above it, or may be",
    Why.NO_FRAMES_YET: "the receiver sends no frames",
    Why.ARMED_BY_OTHER: "another program or person has armed it, in {mode}",
    Why.DISARMED: "it was disarmed; the mode is {mode}",
    Why.NOT_TAKEN_OVER: "it was not taken over",
    Why.MODE_TAKEN: "the mode is {mode}: the pilot or a failsafe has taken over"
    "{stalled_s: (this program was delayed, and sent no set-point for {stalled_s:.1f} s before: PX4 leaves OFFBOARD "
    "after COM_OF_LOSS_T)|}",
    Why.PILOT_HAS_IT: "the pilot has it, in {mode}",
    Why.SENT_ELSEWHERE: "a ground station or another program has sent the vehicle to a place; send it there again",
    Why.CHANNEL_MOVED: lambda channel, by_us: (
        f"the pilot has moved a {'stick' if channel <= STICKS else 'switch'} (channel {channel}, by {by_us} µs)"
    ),
    Why.AXIS_MOVED: lambda axis, by_us: f"the pilot has moved a stick ({axis}, by {by_us // 5} %)",
    Why.BATTERY_LOW: "low battery",
    Why.BATTERY_ILL: "the battery is not healthy",
    Why.ORDER_REFUSED: "{order}: {result}",
    Why.AUTOPILOT_SAID: "{text}",
    Why.SENSORS_ILL: lambda sensors: f"not healthy: {', '.join(sensors)}",
}
