"""News of a search. It flies one vehicle by one receiver. Places are metres from the take-off point."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

from arva_hil.events import Event


class FromSearch(Event):
    """What the search tells where an emulator runs beside it in one program."""

    event: Event


class SearchEvent(Event):
    """`time_s` is on the clock of the program that searches."""


# -- on the ground -----------------------------------------------------------------------------------------


class WaitingFor(SearchEvent):
    """What is lacking before the vehicle can be launched."""

    what: Literal["link", "autopilot", "frame", "pose", "hover", "battery"]


class FailsafesKnown(SearchEvent):
    """What the vehicle does when it is left alone follows from its `parameters`: (name, value) each.

    `autopilot`: whose they are; of what it did not answer there is nothing.
    """

    autopilot: Literal["ardupilot", "px4"]
    parameters: Sequence[tuple[str, float]]


class SimulatorRecognized(SearchEvent):
    """The vehicle answers with the `message` that only simulators send: it may be armed."""

    label: str
    message: str


class ArmingAllowed(SearchEvent):
    """The vehicle is not known to be a simulator, and was allowed to be armed beforehand, by --yes."""

    label: str


class ConsentNeeded(SearchEvent):
    """In a dry run: the vehicle is not known to be a simulator, and would be flown only if somebody says so.

    `asked`: a person would be asked at the terminal; else there is nobody, and --yes is needed.
    """

    label: str
    asked: bool


class DryRunBegun(SearchEvent):
    """All is there that a flight needs. What follows says what would be ordered; nothing is."""

    label: str
    take_over: bool
    countdown_s: float


class WouldOrder(SearchEvent):
    """In a dry run: what would be ordered next. `order`: MAV_CMD's name; `what`: of it, in words."""

    order: str
    what: str


class SetPointPlanned(SearchEvent):
    """In a dry run: the set-point that would be sent now, `rate_hz` times a second. NED, m/s."""

    v_north: float
    v_east: float
    v_down: float
    heading_deg: float
    rate_hz: float


class CountDown(SearchEvent):
    """So many seconds until the vehicle is armed, or taken over."""

    left_s: int
    take_over: bool


class Launched(SearchEvent):
    """The vehicle is being armed, or taken over."""

    label: str
    take_over: bool


# -- in the air --------------------------------------------------------------------------------------------


class SearchBegun(SearchEvent):
    """The take-off has ended, `height_m` above the take-off point."""

    height_m: float


class SearchEnded(SearchEvent):
    """Nothing more is looked for. `how`: as in the outcome; `landing`: it lands, else it hovers."""

    how: str
    landing: bool


class SearchInterrupted(SearchEvent):
    """Somebody has broken it off, in this phase of the flight, e.g. "flying"."""

    phase: str


class SearchHeldUp(SearchEvent):
    """The program did nothing for `gap_s`: before anything is ordered it is seen who has the vehicle."""

    gap_s: float


class StrategySlow(SearchEvent):
    """The strategy took `took_s` to answer, or the computer paused meanwhile. The vehicle was not steered."""

    took_s: float


class SearchPaused(SearchEvent):
    """It hovers. No frame came for `limit_s`, or the readings are the same over `moved_m` of flight."""

    reason: Literal["no frame", "same readings"]
    limit_s: float
    moved_m: float


class SearchResumed(SearchEvent):
    """`reason`: why it hovered."""

    reason: Literal["no frame", "same readings"]


class ReceiverGone(SearchEvent):
    """The receiver's link is gone for good. `error`: the link's."""

    error: str


class TransmitterEvent(SearchEvent):
    """`transmitter`: its id, None when the frames carry none."""

    transmitter: int | None


class TransmitterHeard(TransmitterEvent):
    """For the first time, `distance_m` away by the reading; `north_m`, `east_m`: where the receiver is."""

    distance_m: float
    north_m: float
    east_m: float


class TransmitterChosen(TransmitterEvent):
    """It is gone for from here on, `distance_m` away by the reading."""

    distance_m: float


class TransmitterFaded(TransmitterEvent):
    """It is not heard any more: strips are flown again."""


class DescentBegun(SearchEvent):
    """It comes down onto the place reported."""


class TooLow(SearchEvent):
    """Only `height_m` above the ground where `wanted_m` are wanted: nothing is flown but up."""

    height_m: float
    wanted_m: float


class HeightSource(SearchEvent):
    """What the height above the ground comes from now.

    "rangefinder"; "estimate": none is heard, it is above the take-off point; "highest ground": the rangefinder has
    nothing of use to say any more, it is above the highest ground that it has seen; "GPS": neither it nor a barometer
    is there, and it is held `margin_m` higher than was asked for.
    """

    source: Literal["rangefinder", "estimate", "highest ground", "GPS"]
    margin_m: float = 0.0
