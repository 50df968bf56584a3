"""Reasons as values: why there is no vehicle or no pose, why a flight ended. `words` makes sentences of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum, auto
from typing import Any, Literal, NamedTuple


class Why(Enum):
    """The kinds of a `Reason`. A comment names the values that belong to a kind."""

    # The datum has changed.
    HOME_CAME = auto()
    HOME_MOVED = auto()
    HOME_AFTER_LANDING = auto()
    POSITION_JUMPED = auto()
    REBOOTED = auto()

    # A mission has ended.
    FOUND = auto()
    NOT_SURE = auto()
    TIME_UP = auto()  # limit_s; found, wanted, more: numbers of transmitters
    STRIPS_FLOWN = auto()  # `heard`, `twice`, `team`: booleans; found, wanted, more
    ON_THE_GROUND = auto()
    SENSORS_DISAGREE = auto()  # pairs: of (source, m, source, m)
    TOO_LOW = auto()  # metres
    TOO_FAR = auto()  # metres
    STRATEGY_FAILED = auto()  # text: of the error
    NO_FRAME = auto()  # seconds
    SAME_READING = auto()

    # A search does not begin, or ends on the ground.
    INTERRUPTED = auto()
    NO_END = auto()
    ERROR = auto()  # text: of the error
    NO_AUTOPILOT = auto()  # `heard`: a NoVehicle
    MODE_SET_BY_PROGRAM = auto()
    ARMED_ALREADY = auto()
    RECEIVER_AWAY = auto()  # text: of the link
    RECEIVER_SILENT = auto()  # link, age_s, repeated: a sequence number, first_bytes
    NO_POSE = auto()  # lacking: a NoPose
    CANNOT_TAKE_OVER = auto()  # because
    BATTERY_LOW_BEFORE = auto()
    BATTERY_UNKNOWN_BEFORE = auto()
    PORT_SHARED = auto()  # port, readers
    BEYOND_FENCE = auto()  # area: or the height; parameter, metres, needed_m
    NOBODY_ASKED = auto()  # label
    ANSWER_NO = auto()  # label
    ANSWER_LATE = auto()  # label, seconds
    OTHER_SEARCH = auto()  # name, flies
    WOULD_FLY = auto()
    WOULD_END = auto()  # because

    # A vehicle cannot be taken over.
    HOME_UNKNOWN = auto()
    NOT_ARMED = auto()
    IN_MODE = auto()  # mode
    NEAR_HOME = auto()  # height_m, least_m
    MOVES = auto()  # speed
    JUST_STOPPED = auto()

    # A flight ends early.
    POSE_LOST = auto()  # seconds, lacking: a NoPose
    NOT_FOLLOWED = auto()  # seconds, ordered_m, flown_m, off_deg: None if it hardly moves
    BLOCKED_BELOW = auto()
    AUTOPILOT_SILENT = auto()
    STILL_ARMED = auto()  # because
    GOES_ON_LANDING = auto()
    LEFT_ALONE = auto()  # parameters, px4, remote
    OTHER_IDS = auto()  # vehicle, other
    CLOCK_AHEAD = auto()  # seconds
    CLOCK_BACK = auto()
    PLACE_JUMPED = auto()  # metres

    # The commander has lost the vehicle, or gives it up.
    MODE_UNKNOWN = auto()  # seconds
    NO_RADIO = auto()
    NOT_DONE = auto()  # phase, because
    NO_EXPLANATION = auto()
    UNDER_ANOTHER = auto()
    NO_FRAMES_YET = auto()
    ARMED_BY_OTHER = auto()  # mode
    DISARMED = auto()  # mode
    NOT_TAKEN_OVER = auto()
    MODE_TAKEN = auto()  # mode, stalled_s: without set-points before
    PILOT_HAS_IT = auto()  # mode
    CHANNEL_MOVED = auto()  # channel, by_us
    AXIS_MOVED = auto()  # axis, by_us
    BATTERY_LOW = auto()
    BATTERY_ILL = auto()
    ORDER_REFUSED = auto()  # order, result
    AUTOPILOT_SAID = auto()  # text
    SENSORS_ILL = auto()  # sensors


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


_NoStream = Literal["streams missing", "streams stopped", "no truth"]


@dataclass(frozen=True)
class NoPose:
    """Why there is no pose. `streams`: the missing ones, also with "zero position".

    `message`: with "no truth", the message that a simulator of this autopilot would send, "" if it has none.
    """

    reason: Literal["no vehicle", "no home", "zero position", "impossible position"] | _NoStream
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
