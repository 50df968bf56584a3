"""The news that the searches of a team exchange."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, NamedTuple

MOST_HEARD: Final = 7  # transmitters in one message


class HeardAt(NamedTuple):
    """A received transmitter: its id, its smallest distance, and latitude and longitude of the vehicle there."""

    id: int
    metres: float
    lat: float
    lon: float


@dataclass(frozen=True)
class News:
    """The news of one search for the others.

    - `number`: of the search. `time_s`: on the common clock.
    - `lla`: place of its vehicle, degrees, degrees, metres AMSL. `flying`: the vehicle is in the air.
    - `lost`: the place is not known any more; `lla` is the last one.
    - `hunting`: id of the transmitter that it flies to, or None. `hunting_m`: its smallest distance to that one [m].
    - `found`: ids of the transmitters that it has found for sure.
    - `heard`: transmitters that it has received and that no search has found, at most 7.
    - `part`: the part of the area that it searches, None without strips. `flown`: the parts with all strips flown.
    - `free`: its strips are flown, and it flies to no transmitter.
    """

    number: int
    time_s: float
    lla: tuple[float, float, float]
    flying: bool
    hunting: int | None = None
    found: tuple[int, ...] = ()
    part: int | None = None
    flown: tuple[int, ...] = ()
    hunting_m: float = math.inf
    free: bool = False
    heard: tuple[HeardAt, ...] = ()
    lost: bool = False

    @property
    def ended(self) -> bool:
        """True if its search has ended: its vehicle lands, has landed, or is under another's control."""
        return self.part is None and self.hunting is None and not self.free
