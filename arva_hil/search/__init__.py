"""Searches for the transmitter: what an onboard computer flies by. `STRATEGIES` by the name a person gives them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final

from arva_hil.search.estimate import Estimate
from arva_hil.search.extremum import Extremum
from arva_hil.search.flux import Flux
from arva_hil.search.strategy import Strategy

STRATEGIES: Final[Mapping[str, Callable[[float], Strategy]]] = {
    "flux": Flux,
    "extremum": Extremum,
    "estimate": Estimate,
}
