"""Why there is no vehicle or no pose, as values. The console makes sentences of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple


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


@dataclass(frozen=True)
class NoVehicle:
    """Why there is no vehicle. `link_error`: of a lost link. `refused`: packets by the verdict on their signature.

    "other vehicles": there are autopilots with other ids than those asked for.
    """

    reason: Literal["link lost", "silence", "no packets", "no signature", "other vehicles", "no heartbeat"]
    link_error: str = ""
    bytes: int = 0
    packets: int = 0
    refused: tuple[tuple[str, int], ...] = ()
    sources: tuple[HeardSource, ...] = ()
