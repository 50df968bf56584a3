"""What is measured of both links, and what is found."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

State = Literal["ok", "note", "fail"]


class Finding(NamedTuple):
    """One line: what was looked at, how it is, what was found and, unless that is well, what to do."""

    check: str
    state: State
    found: str
    cure: str = ""


@dataclass(frozen=True, slots=True)
class Traffic:
    """Packets of everybody, in `seconds`."""

    seconds: float
    size: int  # bytes
    packets: int
    old: int  # of them MAVLink 1
    signed: int
    bad: int  # checksums
    refused: Mapping[str, int] | None = None  # for their signature, by why; None without a key


@dataclass(frozen=True, slots=True)
class Source:
    """Who sends heartbeats. `hz` is None when one alone came; `pilot`: it is an autopilot."""

    system: int
    component: int
    name: str
    pilot: bool
    count: int
    hz: float | None

    def __str__(self) -> str:
        rate = f" at {self.hz:.1f} Hz" if self.hz is not None else ""
        return f"{self.name} {self.system}/{self.component} ×{self.count}{rate}"


@dataclass(frozen=True, slots=True)
class StreamRate:
    """One kind of pose message. `hz`: lately; `said`: how the vehicle answered when it was asked for.

    `promised`: it accepted to send it.
    """

    name: str
    count: int
    hz: float
    wanted_hz: float
    said: str = ""
    recorded: bool = False  # it comes from a log, which nobody can ask
    promised: bool = False


@dataclass(frozen=True, slots=True)
class Position:
    """`place`: degrees, degrees, metres AMSL. `zeros`, `refused`: messages with no position, with an impossible one."""

    place: tuple[float, float, float] | None
    zeros: int
    refused: int
    fix: str = ""  # what GPS_RAW_INT says, if it comes


@dataclass(frozen=True, slots=True)
class PortTraffic:
    """How the port does. `kind` is a link's, or mavlink; `seen`: who holds the other end; `unread`: bytes there."""

    kind: str
    name: str
    taken: int
    dropped: int
    answered: int = 0  # bytes that came back
    seen: Sequence[str] = ()
    unread: int = 0
    refused: bool = False  # by the far machine: nobody listens there
    lost: str = ""
