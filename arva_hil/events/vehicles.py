"""News of a vehicle, from the session with it and from who commands it.

`label` is what the vehicle is, e.g. "ardupilotmega quadrotor 1/1". Names of results are MAVLink's, e.g.
"MAV_RESULT_DENIED".
"""

from __future__ import annotations

from arva_hil.events import VehicleEvent


class VehicleFound(VehicleEvent):
    """A vehicle is followed from here on. `version`: of MAVLink; `signed`: its packets are."""

    label: str
    version: int
    signed: bool


class SignaturesUnchecked(VehicleEvent):
    """The vehicle signs its packets, and there is no key to check them by, or to sign requests with."""


class VehicleLost(VehicleEvent):
    """There was no heartbeat for `silent_s`."""

    label: str
    silent_s: float


class VehicleBack(VehicleEvent):
    """The vehicle that was lost is heard again."""

    label: str


class VehicleRebooted(VehicleEvent):
    """Its boot time has gone back: all that was known of it is forgotten."""

    label: str


class OtherAutopilotIgnored(VehicleEvent):
    """Another autopilot speaks on the link, once for each. `same_ids`: with the ids of the vehicle."""

    system: int
    component: int
    same_ids: bool


class SignatureRefused(VehicleEvent):
    """Packets are ignored for their signature, once for each `verdict`: "unsigned", "forged" or "replayed".

    Those of these ids were the first.
    """

    system: int
    component: int
    verdict: str


class ClockLeapt(VehicleEvent):
    """The vehicle's clock is ahead of what it was by `ahead_s`: what came before was late."""

    ahead_s: float


class PositionJumped(VehicleEvent):
    """Its position is `by_m` away from where it was, and stays there."""

    by_m: float


class StreamEvent(VehicleEvent):
    """`stream`: the message's name. `command`, `asked_hz`: the last request for it; `result`: of it, "" for none."""

    stream: str
    command: str
    asked_hz: float
    result: str


class StreamRateLowered(StreamEvent):
    """The rate was denied: `next_hz` are asked for from here on."""

    next_hz: float


class StreamAskedOtherwise(StreamEvent):
    """It is slower than the `wanted_hz`: REQUEST_DATA_STREAM is tried."""

    wanted_hz: float


# -- while it is commanded ---------------------------------------------------------------------------------


class AutopilotText(VehicleEvent):
    """A STATUSTEXT of warning or worse, whole, in the autopilot's own words."""

    text: str


class ArmingTried(VehicleEvent):
    """An order to arm goes out, the `number`th, and another one `again_s` later.

    `refused_order`, `refused_result`: what was refused before, e.g. "arming", "FAILED"; "" when nothing was.
    """

    number: int
    again_s: float
    refused_order: str
    refused_result: str


class ThrottleAwaited(VehicleEvent):
    """The pilot is to have the vehicle, and gets it when the throttle stick is in the middle.

    `channel`: of the stick that was moved, from 1, and by how much; 0 where it is for the battery.
    """

    channel: int
    by_us: int
