"""The settings of a search."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from arva_hil.model.field.rotation import Mount
from arva_hil.search.strategies.strategy import Strategy


@dataclass(frozen=True)
class SearchPlan:
    """The settings of a search. `area`: south, west, north, east of the take-off point [m].

    `height`: above the ground [m], as far as it is known (`ground.py`); `take_off`: above the take-off point [m].
    `mount`: the place of the receiver on the vehicle. `victims`: how many are searched for, None: all. `land`: whether
    it lands at the end, else it hovers. `timeout_s`: from the start until everything is ready for the flight.
    `take_over`: it is in the air already. `dry_run`: nothing is armed, and the orders are only reported.
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
    land: bool = True
    timeout_s: float = 60.0
    arm_timeout_s: float = 60.0
    take_over: bool = False
    countdown_s: float = 0.0  # before it is armed
    dry_run: bool = False
