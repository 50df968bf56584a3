"""The news that the searches of a team exchange."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, NamedTuple

MOST_HEARD: Final = 7  # transmitters that one hands over


class HeardAt(NamedTuple):
    """A transmitter that was heard: its id, how near at best, and the latitude and longitude of the vehicle then."""

    id: int
    metres: float
    lat: float
    lon: float


@dataclass(frozen=True)
class News:
    """The news of one search for the others. `number`: its own; `time_s`: on the common clock.

    `lla`: of its vehicle, degrees, degrees, metres AMSL; `flying`: whether it is in the air. `hunting`: the id of the
    transmitter it flies to, or None; `hunting_m`: how near it has heard that one; `found`: the ids of those that it has
    found surely. `part`: of the area, which it searches, None if it does not search strips any more; `flown`: the parts
    of which all strips are flown, as far as it knows. `free`: its strips are flown, and it flies to none. `heard`: the
    transmitters that it has heard and knows nobody to have found, at most 7. `lost`: it does not know any more where
    its vehicle is; it was at `lla`.
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
        """True if it searches no more: its vehicle lands, has landed, or is under another's control."""
        return self.part is None and self.hunting is None and not self.free
