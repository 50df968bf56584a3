"""Events of a vehicle, from its session and its commander.

`label`: the kind of vehicle and its ids, e.g. "ardupilotmega quadrotor 1/1". Names of results are MAVLink's, e.g.
"MAV_RESULT_DENIED".
"""

from __future__ import annotations

from arva_hil.events import VehicleEvent


class VehicleFound(VehicleEvent):
    """A vehicle is followed from now on. `version`: of MAVLink; `signed`: its packets are signed."""

    label: str
    version: int
    signed: bool


class SignaturesUnchecked(VehicleEvent):
    """The vehicle signs its packets, but there is no key to check them and to sign requests."""


class VehicleLost(VehicleEvent):
    """There was no heartbeat for `silent_s`."""

    label: str
    silent_s: float


class VehicleBack(VehicleEvent):
    """The lost vehicle sends heartbeats again."""

    label: str


class VehicleRebooted(VehicleEvent):
    """The vehicle's boot time has gone back. A new session begins."""

    label: str


class OtherAutopilotIgnored(VehicleEvent):
    """Another autopilot on the link is ignored. Emitted once for each. `same_ids`: it has the vehicle's ids."""

    system: int
    component: int
    same_ids: bool


class SignatureRefused(VehicleEvent):
    """Packets are ignored because of their signature. Emitted once for each `verdict`.

    `verdict`: "unsigned", "forged" or "replayed". `system`, `component`: the sender of the first such packet.
    """

    system: int
    component: int
    verdict: str


class ClockLeapt(VehicleEvent):
    """The vehicle's clock is ahead of its expected time by `ahead_s`, so earlier packets came late."""

    ahead_s: float


class PositionJumped(VehicleEvent):
    """The vehicle's position has jumped by `by_m`, and stays there."""

    by_m: float


class StreamEvent(VehicleEvent):
    """`stream`: the message's name. `command`, `asked_hz`: the last request; `result`: its result, "" if none came."""

    stream: str
    command: str
    asked_hz: float
    result: str


class StreamRateLowered(StreamEvent):
    """The vehicle denied the rate. `next_hz`: the rate of the next request."""

    next_hz: float


class StreamAskedOtherwise(StreamEvent):
    """The stream is slower than `wanted_hz`. The next request uses REQUEST_DATA_STREAM."""

    wanted_hz: float


class AutopilotText(VehicleEvent):
    """A whole STATUSTEXT of severity warning or worse."""

    text: str


class ArmingTried(VehicleEvent):
    """The `number`-th command to arm is sent. The next one follows after `again_s`.

    `refused_order`, `refused_result`: the last command that was refused, e.g. "arming", "FAILED"; "" if none was.
    """

    number: int
    again_s: float
    refused_order: str
    refused_result: str


class ThrottleAwaited(VehicleEvent):
    """The pilot gets the vehicle once the throttle stick is in the middle.

    `channel`: of the stick that was moved, from 1; 0 if the battery is the reason. `by_us`: its movement, µs.
    """

    channel: int
    by_us: int
