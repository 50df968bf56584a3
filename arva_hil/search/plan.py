"""The settings of a search."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from arva_hil.field.mount import Mount
from arva_hil.search.strategy import Strategy


@dataclass(frozen=True)
class SearchPlan:
    """The settings of a search. `area`: south, west, north, east of the take-off point [m].

    `height`: above the ground [m], as far as it is known (`ground.py`); `take_off`: above the take-off point [m].
    `mount`: the place of the receiver on the vehicle. `victims`: how many are searched for, None: all.
    """

    strategy: Callable[[float], Strategy]
    speed: float = 1.0  # m/s, horizontal, not exceeded
    height: float = 3.0  # held
    take_off: float = 3.0
    area: tuple[float, float, float, float] = (-50.0, -50.0, 50.0, 50.0)
    strip_width: float = 40.0
    patience_s: float = 10.0  # without frames, hovering, before it ends
    limit_s: float = 900.0  # from the end of the take-off
    mount: Mount = field(default_factory=Mount)
    trust_gps: bool = False  # hold `height` also if only GPS measures it
    victims: int | None = 1
