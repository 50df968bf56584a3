"""In words: why there is no vehicle or no pose, with the likely cure; and what a vehicle does if it gets no orders."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from arva_hil.events.reasons import NoPose, NoVehicle, SilentStream

_NO_POSE = {
    "no vehicle": "no vehicle yet",
    "no home": "waiting for HOME_POSITION",
    "impossible position": "the position is out of range: no GPS fix yet",
    "streams stopped": "the streams have stopped",
}
_SIMULATORS = "only the simulators of ArduPilot and PX4 tell their"


def no_vehicle(why: NoVehicle) -> str:
    """Return the traffic received, in words, if no vehicle was found."""
    if why.reason == "link lost":
        return f"no autopilot was heard: {why.link_error}"
    if why.reason == "silence":
        return "nothing was heard at all: is the autopilot powered, and sending MAVLink on this link?"
    if why.reason == "no packets":
        return (
            f"{why.bytes} bytes were heard but no MAVLink packet in them: is the baud rate right, "
            "and the port's protocol MAVLink?"
        )
    if why.reason == "no signature":
        counts = ", ".join(f"{count} {verdict}" for verdict, count in why.refused)
        return f"{why.packets} packets were heard, but no autopilot's with the key: {counts}"
    if not why.sources:
        return f"{why.packets} packets were heard, all of other vehicles: is this one powered, and its system id right?"
    who = ", ".join(f"{s.what} from {s.system}/{s.component} ×{s.times}" for s in why.sources)
    if why.reason == "other vehicles":
        return f"{why.packets} packets were heard, but none of the vehicle looked for: {who}; is its system id right?"
    return f"{why.packets} packets were heard, but no autopilot's heartbeat: {who}"


def no_pose(why: NoPose) -> str:
    """Why a vehicle that was found has no pose."""
    if why.reason in _NO_POSE:
        return _NO_POSE[why.reason]
    if why.reason == "no truth":
        who = f"no {why.message}: only a simulator tells its" if why.message else _SIMULATORS
        return f"{who} vehicle's true pose; use `pose: estimate` otherwise"
    zeros = ["the position is all zeros: no GPS fix yet"] if why.reason == "zero position" else []
    return ", ".join(zeros + [_silent(stream) for stream in why.streams])


def request(command: str, asked_hz: float, result: str) -> str:
    """A request for a stream and its result; "" if nothing is known."""
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
_IN_GUIDED: Final = 4  # of FS_OPTIONS: without a radio it goes on in GUIDED
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
        return f"it stops{after}, and hovers in GUIDED, armed, until somebody takes control"
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
