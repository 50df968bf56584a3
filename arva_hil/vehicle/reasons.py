"""Why there is no vehicle or no pose: values for a program; the console has the words."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple


class SilentStream(NamedTuple):
    """A pose message that does not come. `command`, `asked_hz`: the last request for it that is settled, "" for none.

    `result`: MAVLink's name of what was answered, "" for nothing. `recorded`: it is a log, nobody asks. `promised`: it
    was, and is silent.
    """

    name: str
    command: str
    asked_hz: float
    result: str
    recorded: bool
    promised: bool


@dataclass(frozen=True, slots=True)
class NoPose:
    """Why there is no pose. `streams`: those that are missing; with "zero position" there may be some, too.

    With "no truth", what a simulator would say: `message` by MAVLink's name, "" where the autopilot's has none.
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
    """`what` came from a system and component, `times` times: "packets", "other" or "heartbeats of gcs"."""

    what: str
    system: int
    component: int
    times: int


@dataclass(frozen=True, slots=True)
class NoVehicle:
    """Why there is no vehicle. `link_error`: why its link is lost. `refused`: packets by the verdict on signatures."""

    reason: Literal["link lost", "silence", "no packets", "no signature", "no heartbeat"]
    link_error: str = ""
    bytes: int = 0
    packets: int = 0
    refused: tuple[tuple[str, int], ...] = ()
    sources: tuple[HeardSource, ...] = ()
