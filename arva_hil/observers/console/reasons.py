"""Why there is no vehicle or no pose: sentences for a person, with the likely cure."""

from __future__ import annotations

from arva_hil.vehicle.reasons import NoPose, NoVehicle, SilentStream

_NO_POSE = {
    "no vehicle": "no vehicle yet",
    "no home": "waiting for HOME_POSITION",
    "impossible position": "the position is out of range: no GPS fix yet",
    "streams stopped": "the streams have stopped",
}
_SIMULATORS = "only the simulators of ArduPilot and PX4 tell their"


def no_vehicle(why: NoVehicle) -> str:
    """What was heard if no vehicle was found."""
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
    who = ", ".join(f"{s.what} from {s.system}/{s.component} ×{s.times}" for s in why.sources)
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
