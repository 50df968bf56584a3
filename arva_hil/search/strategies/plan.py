"""The settings of a search."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from arva_hil.model.field.rotation import Mount
from arva_hil.search.strategies.strategy import Strategy


@dataclass(frozen=True)
class SearchPlan:
    """The settings of a search. `area`: south, west, north, east of the take-off point [m].

    - `height`: above the ground [m], as far as it is known (`ground.py`). `take_off`: above the take-off point [m].
    - `mount`: the place of the receiver on the vehicle.
    - `victims`: the number to find; None: all.
    - `land`: land at the end; otherwise hover.
    - `timeout_s`: limit from the start until everything is ready for the flight.
    - `take_over`: the vehicle is in the air already.
    - `dry_run`: arm nothing, and only report the orders.
    """

    strategy: Callable[[float], Strategy]
    speed: float = 1.0  # largest horizontal speed, m/s
    height: float = 3.0  # held
    take_off: float = 3.0
    area: tuple[float, float, float, float] = (-50.0, -50.0, 50.0, 50.0)
    strip_width: float = 40.0
    patience_s: float = 10.0  # hover for this time without frames, then end
    limit_s: float = 900.0  # limit from the end of the take-off
    mount: Mount = field(default_factory=Mount)
    trust_gps: bool = False  # hold `height` also if only GPS measures it
    victims: int | None = 1
    land: bool = True
    timeout_s: float = 60.0
    arm_timeout_s: float = 60.0
    take_over: bool = False
    countdown_s: float = 0.0  # before it is armed
    dry_run: bool = False
