"""Reasons as values: why there is no vehicle or no pose, why a flight ended. `words` makes sentences of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import Any, Literal, NamedTuple

Why = Enum(
    "Why",
    [
        # The datum has changed.
        "HOME_CAME",
        "HOME_MOVED",
        "HOME_AFTER_LANDING",
        "POSITION_JUMPED",
        "REBOOTED",
        # A mission has ended.
        "FOUND",
        "NOT_SURE",
        "TIME_UP",  # limit_s; found, wanted, more: numbers of transmitters
        "STRIPS_FLOWN",  # `heard`, `twice`, `team`: booleans; found, wanted, more
        "ON_THE_GROUND",
        "SENSORS_DISAGREE",  # pairs: of (source, m, source, m)
        "TOO_LOW",  # metres
        "TOO_FAR",  # metres
        "STRATEGY_FAILED",  # text: of the error
        "NO_FRAME",  # seconds
        "SAME_READING",
        # A search does not begin, or ends on the ground.
        "INTERRUPTED",
        "NO_END",
        "ERROR",  # text: of the error
        "NO_AUTOPILOT",  # `heard`: a NoVehicle
        "MODE_SET_BY_PROGRAM",
        "ARMED_ALREADY",
        "RECEIVER_AWAY",  # text: of the link
        "RECEIVER_UNFIT",  # `failed`: its self-test; otherwise it does not search
        "RECEIVER_SILENT",  # link, age_s, repeated: a sequence number, first_bytes
        "NO_POSE",  # lacking: a NoPose
        "CANNOT_TAKE_OVER",  # because
        "BATTERY_LOW_BEFORE",
        "BATTERY_UNKNOWN_BEFORE",
        "PORT_SHARED",  # port, readers
        "BEYOND_FENCE",  # area: or the height; parameter, metres, needed_m
        "NOBODY_ASKED",  # label
        "ANSWER_NO",  # label
        "ANSWER_LATE",  # label, seconds
        "OTHER_SEARCH",  # name, flies
        "WOULD_FLY",
        "WOULD_END",  # because
        # A vehicle cannot be taken over.
        "HOME_UNKNOWN",
        "NOT_ARMED",
        "IN_MODE",  # mode
        "NEAR_HOME",  # height_m, least_m
        "MOVES",  # speed
        "RANGEFINDER_HIGH",  # measured_m, height_m
        "JUST_STOPPED",
        # A flight ends early.
        "POSE_LOST",  # seconds, lacking: a NoPose
        "NOT_FOLLOWED",  # seconds, ordered_m, flown_m, off_deg: None if it hardly moves
        "BLOCKED_BELOW",
        "AUTOPILOT_SILENT",
        "STILL_ARMED",  # because
        "GOES_ON_LANDING",
        "LEFT_ALONE",  # parameters, px4, remote
        "OTHER_IDS",  # vehicle, other
        "CLOCK_AHEAD",  # seconds
        "CLOCK_BACK",
        "PLACE_JUMPED",  # metres
        # The commander has lost the vehicle, or gives it up.
        "MODE_UNKNOWN",  # seconds, late_s: 0 without a question
        "ANSWERS_LATE",  # seconds
        "NO_RADIO",
        "NOT_DONE",  # phase, because
        "NO_EXPLANATION",
        "UNDER_ANOTHER",
        "NO_FRAMES_YET",
        "ARMED_BY_OTHER",  # mode
        "DISARMED",  # mode
        "NOT_TAKEN_OVER",
        "MODE_TAKEN",  # mode, stalled_s: without set-points before
        "PILOT_HAS_IT",  # mode
        "SENT_ELSEWHERE",
        "CHANNEL_MOVED",  # channel, by_us
        "AXIS_MOVED",  # axis, by_us
        "BATTERY_LOW",
        "BATTERY_ILL",
        "ORDER_REFUSED",  # order, result
        "AUTOPILOT_SAID",  # text
        "SENSORS_ILL",  # sensors
    ],
)
"""The kinds of a `Reason`. A comment names the values that belong to a kind."""


@dataclass(frozen=True)
class Reason:
    """A reason without its text: its kind, and the values of that kind by name."""

    why: Why
    values: Mapping[str, Any] = field(default_factory=dict)


def because(why: Why, **values: Any) -> Reason:
    """Return a reason of this kind with these values."""
    return Reason(why, values)


class SilentStream(NamedTuple):
    """A pose message that does not come. `command`, `asked_hz`: the last completed request for it, "" for none.

    `result`: MAVLink's name of the answer, "" for none. `recorded`: this is a log, which cannot be asked. `promised`:
    the vehicle accepted the request, but sends nothing.
    """

    name: str
    command: str
    asked_hz: float
    result: str
    recorded: bool
    promised: bool


@dataclass(frozen=True)
class NoPose:
    """Why there is no pose. `streams`: the missing ones, also with "zero position".

    `message`: with "no truth", the message that a simulator of this autopilot would send, "" if it has none.
    """

    reason: Literal[
        "no vehicle",
        "no home",
        "zero position",
        "impossible position",
        "streams missing",
        "streams stopped",
        "no truth",
    ]
    streams: tuple[SilentStream, ...] = ()
    message: str = ""


class HeardSource(NamedTuple):
    """A source: `what` came from it `times` times. `what`: "packets", "other" or e.g. "heartbeats of gcs"."""

    what: str
    system: int
    component: int
    times: int


NoVehicleReason = Literal["link lost", "silence", "no packets", "no signature", "other vehicles", "no heartbeat"]


@dataclass(frozen=True)
class NoVehicle:
    """Why there is no vehicle. `link_error`: of a lost link. `refused`: packets by the verdict on their signature.

    "other vehicles": there are autopilots with other ids than those asked for.
    """

    reason: NoVehicleReason
    link_error: str = ""
    bytes: int = 0
    packets: int = 0
    refused: tuple[tuple[str, int], ...] = ()
    sources: tuple[HeardSource, ...] = ()
