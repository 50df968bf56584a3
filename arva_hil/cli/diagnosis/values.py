"""Measurements of both links, and findings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

State = Literal["ok", "note", "fail"]


class Finding(NamedTuple):
    """One line: what was checked, its state, what was found, and the cure if there is a problem."""

    check: str
    state: State
    found: str
    cure: str = ""


@dataclass(frozen=True, slots=True)
class Traffic:
    """All packets on the link, in `seconds`."""

    seconds: float
    size: int  # bytes
    packets: int
    old: int  # MAVLink 1 packets among them
    signed: int
    bad: int  # checksums
    refused: Mapping[str, int] | None = None  # packets refused for their signature, by reason; None without a key


@dataclass(slots=True, eq=False)
class Source:
    """A sender of heartbeats. `hz`: None if only one came; `pilot`: whether it is an autopilot."""

    system: int
    component: int
    name: str
    pilot: bool
    count: int
    hz: float | None
    first_s: float = 0.0  # when the first one came

    def __str__(self) -> str:
        rate = f" at {self.hz:.1f} Hz" if self.hz is not None else ""
        return f"{self.name} {self.system}/{self.component} ×{self.count}{rate}"


@dataclass(frozen=True, slots=True)
class StreamRate:
    """One kind of pose message. `hz`: its rate lately; `said`: the vehicle's answer to the request.

    `promised`: whether the vehicle accepted the request.
    """

    name: str
    count: int
    hz: float
    wanted_hz: float
    said: str = ""
    recorded: bool = False  # it comes from a log, so no request is possible
    promised: bool = False


@dataclass(slots=True)
class PortTraffic:
    """Traffic on the port. `kind`: a link's, or mavlink; `seen`: programs at the other end; `unread`: bytes there."""

    kind: str
    name: str
    taken: int = 0
    dropped: int = 0
    answered: int = 0  # bytes that came back
    seen: Sequence[str] = ()
    unread: int = 0
    refused: bool = False  # by the far machine: no program listens there
    lost: str = ""
