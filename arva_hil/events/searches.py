"""Events of a search, which flies one vehicle with one receiver. Positions are in metres from the take-off point."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from arva_hil.events import Event
from arva_hil.events.reasons import Reason
from firmware_proto import Frame

AutopilotKind = Literal["ardupilot", "px4"]
Doubt = Literal["set-points too rare", "flies on", "sticks ignored"]
HeightOrigin = Literal["rangefinder", "estimate", "highest ground", "GPS", "terrain", "doubtful terrain"]
Lacking = Literal["link", "autopilot", "frame", "pose", "hover", "battery"]
PauseReason = Literal["no frame", "same readings"]


class FromSearch(Event):
    """An event of a search that runs in one program with an emulator or with other searches.

    `vehicle`: the name of the search's vehicle, "" if there is only one.
    """

    event: Event
    vehicle: str = ""


class SearchEvent(Event):
    """`time_s` is on the clock of the program that searches."""


class WaitingFor(SearchEvent):
    """The search waits for `what` before it launches the vehicle."""

    what: Lacking


class FailsafesKnown(SearchEvent):
    """The failsafe `parameters` of the vehicle: (name, value). They define its reaction to missing commands.

    `autopilot`: the kind of autopilot. Parameters that it did not report are left out. `remote`: it has a remote
    control that works.
    """

    autopilot: AutopilotKind
    parameters: Sequence[tuple[str, float]]
    remote: bool = False


class ParameterDoubted(SearchEvent):
    """A `parameter` of the autopilot breaks a promise of the search. `value`: None if it was not reported."""

    parameter: str
    value: float | None
    doubt: Doubt


class FenceInArea(SearchEvent):
    """The area reaches beyond the vehicle's fence, or may do so."""

    parameter: str
    """The parameter of the fence."""
    value: float
    """Its value: metres from home, or the number of points of FENCE_TOTAL."""
    reach_m: float
    """The farthest corner of the area from the take-off point; 0 if the places of the points are not known."""


class SimulatorRecognized(SearchEvent):
    """The vehicle may be armed: it answers with a `message` that only simulators send."""

    label: str
    message: str


class ArmingAllowed(SearchEvent):
    """The vehicle is not known to be a simulator. It may be armed because of --yes."""

    label: str


class ConsentNeeded(SearchEvent):
    """In a dry run: the vehicle is not known to be a simulator, and would fly only after consent.

    `asked`: search would ask at the terminal; otherwise there is no terminal, and --yes is needed.
    """

    label: str
    asked: bool


class DryRunBegun(SearchEvent):
    """A dry run has all that a flight needs. The next events report its orders; none is sent."""

    label: str
    take_over: bool
    countdown_s: float


@dataclass(frozen=True)
class OrderDetail:
    """The content of an order."""

    mode: str = ""
    """The mode that is ordered, "" if none is."""
    height_m: float | None = None
    """The height of a take-off above the take-off point."""
    set_points_hz: float | None = None
    """The rate of set-points with velocity 0, which are sent before the order."""
    at_end: bool = False
    """True if the order ends the search."""


class WouldOrder(SearchEvent):
    """The next order of a dry run, which is not sent. `order`: MAV_CMD's name."""

    order: str
    what: OrderDetail


class SetPointPlanned(SearchEvent):
    """The set-point of a dry run, not sent, `rate_hz` times a second. NED, m/s."""

    v_north: float
    v_east: float
    v_down: float
    heading_deg: float
    rate_hz: float


class CountDown(SearchEvent):
    """The vehicle is armed or taken over in `left_s` seconds."""

    left_s: int
    take_over: bool


class Launched(SearchEvent):
    """The vehicle is being armed, or taken over."""

    label: str
    take_over: bool


class SearchBegun(SearchEvent):
    """The take-off has ended, `height_m` above the take-off point.

    `wanted`: the number of transmitters to find; None: all. `area`: south, west, north, east of the take-off point [m];
    `strip_m`: the width of its strips; `limit_s`: the longest time of the search. None: not known.
    """

    height_m: float
    wanted: int | None = 1
    area: Sequence[float] | None = None
    strip_m: float | None = None
    limit_s: float | None = None


class SearchEnded(SearchEvent):
    """The search has ended. `how`: as in the outcome; `landing`: the vehicle lands, otherwise it hovers."""

    how: Sequence[Reason]
    landing: bool


class SearchInterrupted(SearchEvent):
    """The search was interrupted. `phase`: of the flight, e.g. "flying"."""

    phase: str


class SearchHeldUp(SearchEvent):
    """The program did nothing for `gap_s`. Before the next order it checks who controls the vehicle."""

    gap_s: float


class StrategySlow(SearchEvent):
    """The strategy has not answered for `took_s`. The vehicle hovers until it does.

    `starved_s`: the part of that time in which it waited for a processor.
    """

    took_s: float
    starved_s: float


class SearchPaused(SearchEvent):
    """The vehicle hovers: no frame came for `limit_s`, or the readings did not change over `moved_m` of flight."""

    reason: PauseReason
    limit_s: float
    moved_m: float


class SearchResumed(SearchEvent):
    """The search continues. `reason`: of the pause."""

    reason: PauseReason


class ReceiverGone(SearchEvent):
    """The receiver's link is lost for good. `error`: the link's."""

    error: str


class OwnMarkHeard(SearchEvent):
    """The search's own ADSB_VEHICLE came in on the autopilot's link: a program forwards it to the autopilot."""


class TakeOffPoint(SearchEvent):
    """The take-off point, origin of all positions of the search: degrees, degrees, metres AMSL."""

    lat: float
    lon: float
    alt: float


class FrameHeard(SearchEvent):
    """A frame of the receiver, at most 10 a second.

    `position`: the receiver's by the vehicle's pose, NED. `heading_deg`: its x axis, from north. Both are None while
    there is no take-off point or no pose.
    """

    frame: Frame
    position: tuple[float, float, float] | None
    heading_deg: float | None


class TransmitterEvent(SearchEvent):
    """`transmitter`: its id, None if the frames have no ids."""

    transmitter: int | None


class TransmitterHeard(TransmitterEvent):
    """A transmitter is received for the first time.

    `distance_m`: its reading. `north_m`, `east_m`: the place of the receiver.
    """

    distance_m: float
    north_m: float
    east_m: float


class TransmitterChosen(TransmitterEvent):
    """The vehicle flies to this transmitter from now on. `distance_m`: by the reading."""

    distance_m: float


class TransmitterFaded(TransmitterEvent):
    """The receiver does not detect the transmitter any more. The vehicle flies search strips again.

    `hardly`: the receiver detects it only sometimes; the search postpones it until it is nearer. `noise`: the flux
    lines of its readings point anywhere; the search postpones it until they agree.
    """

    hardly: bool = False
    noise: bool = False


class TransmitterLeft(TransmitterEvent):
    """The search leaves the transmitter: another search has found it, or flies to it."""


class TransmitterMoves(TransmitterEvent):
    """The transmitter moves, as that of a rescuer. The search passes it by.

    `speed_m_s`: the mean of its last track; `north_m`, `east_m`: the end of that.
    """

    speed_m_s: float
    north_m: float
    east_m: float


class BeliefChanged(TransmitterEvent):
    """The strategy's present estimate, at most twice a second. Only some strategies report one.

    - `hypotheses`: places (north_m, east_m) and their shares, which add up to 1.
    - `covariance`: of the mean place, m², (nn, ne, ee); None if it is not known.
    - `goal`: (north_m, east_m) of the place to which the vehicle flies, or None.
    """

    hypotheses: Sequence[tuple[float, float, float]]
    covariance: tuple[float, float, float] | None
    goal: tuple[float, float] | None


class PlaceFound(TransmitterEvent):
    """The search ends above this place, or records it.

    - `covariance`: as above, in the positions that the vehicle estimates. `sure`: the readings agree with the place.
    - `relative_covariance`: of the place relative to the vehicle.
    - `earth_covariance`: of the position on Earth, with the error of the vehicle's own position.
    - `autopilot_sigma_m`: of the vehicle's own position on each axis, at least; None if the autopilot reports none.
    - `down_m`: below the take-off point; None if the strategy does not know it.
    """

    north_m: float
    east_m: float
    covariance: tuple[float, float, float] | None
    sure: bool
    relative_covariance: tuple[float, float, float] | None = None
    earth_covariance: tuple[float, float, float] | None = None
    autopilot_sigma_m: float | None = None
    down_m: float | None = None


class ReceiverTurned(TransmitterEvent):
    """By the readings of the transmitter, the receiver's heading is `degrees` clockwise of the reported one."""

    degrees: float


class VictimNoted(TransmitterEvent):
    """A search for several transmitters has recorded one, the `number`-th of `wanted` (None: of all).

    - `marked`: by the receiver.
    - `left`: the number of other transmitters received; None if frames carry no ids.
    - `more`: the receiver detects more transmitters than its frames have slots.
    """

    number: int
    wanted: int | None
    north_m: float
    east_m: float
    sure: bool
    marked: bool
    left: int | None
    more: bool


class VictimAgain(TransmitterEvent):
    """The search has come back to the victim of this `number`, `apart_m` from its recorded place. It marks it again."""

    number: int
    apart_m: float


class PlaceDoubted(TransmitterEvent):
    """The readings contradict this place, or ± relative to the drone is above 0.4 m. The search visits it once more."""

    north_m: float
    east_m: float


class ReceiverKnown(SearchEvent):
    """The receiver has identified itself. `channels`: None if it did not report them."""

    text: str
    channels: int | None


class MarksNotTaken(SearchEvent):
    """The receiver marks no transmitter, so victims are only recorded. `answer`: its answer, or "no answer"."""

    answer: str


class MarkLost(TransmitterEvent):
    """The receiver has lost the mark of the victim of this `number`. The search still passes it by."""

    number: int


class DescentBegun(SearchEvent):
    """The vehicle descends to the place reported."""


class TooLow(SearchEvent):
    """The vehicle is only `height_m` above the ground instead of `wanted_m`. It climbs before it flies on."""

    height_m: float
    wanted_m: float


class SetPointsNotFollowed(SearchEvent):
    """The vehicle does not follow its set-points. The search orders it sideways once."""

    seconds: float
    """The duration of the commands [s]."""
    ordered_m: float
    """The distance commanded in that time [m]."""
    flown_m: float
    """The distance flown in that time [m]."""


class SensorsDisagree(SearchEvent):
    """Two sources of the height differ by more than their errors. The search flies by the lower height."""

    sensor: str
    """The doubted sensor, e.g. "rangefinder"."""
    value_m: float
    """Its value [m]."""
    other: str
    """The source of the comparison, e.g. "barometer"."""
    other_m: float
    """The value of that source [m]."""


class HeightSource(SearchEvent):
    """The source of the height above the ground has changed.

    - "rangefinder".
    - "estimate": there is no rangefinder; the height is above the take-off point.
    - "highest ground": the rangefinder gives no usable values any more; the height is above the highest ground that it
      measured.
    - "GPS": there is no rangefinder and no barometer; the vehicle flies `margin_m` higher than requested.
    - "terrain": there is no rangefinder; the ground falls by the autopilot's terrain data, whose error may be
      `margin_m`.
    - "doubtful terrain": these data have disagreed with the vehicle's position and are not used, otherwise as
      "estimate".
    """

    source: HeightOrigin
    margin_m: float = 0.0


class TeammateLost(SearchEvent):
    """Another search of the team was silent for 5 s with its vehicle in the air, or does not know its place.

    `number`: of its vehicle in the scenario, from 1. Until it sends again, this search keeps `apart_m` off its last
    place, `north_m`, `east_m` of the own take-off point, at every height.
    """

    number: int
    north_m: float
    east_m: float
    apart_m: float


class TeammateBack(SearchEvent):
    """A lost search of the team sends again, or its vehicle is on the ground. `number`: of its vehicle."""

    number: int
