"""The parameters of a fit: their names, units, priors and estimates."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, NamedTuple

from arva_hil.records.fitting.flight import Floats, RecordedFlight
from arva_hil.records.reading import NO_ID

TOLD: Final = 0.4  # a parameter is identified if less than this share of the prior uncertainty is left
Z_95: Final = 1.96


class Parameter(NamedTuple):
    """One parameter. `name`: its key; `mean`, `sigma`: before the flight, in the unit of the fit.

    `unit`: for a person. `scale`: from the unit of the fit to that unit. `logarithm`: the fit has its logarithm.
    """

    name: str
    mean: float
    sigma: float
    unit: str = ""
    scale: float = 1.0
    logarithm: bool = False

    def shown(self, value: float) -> float:
        """Return a value of the fit in the unit for a person."""
        return math.exp(min(value, 50.0)) if self.logarithm else value * self.scale


@dataclass(frozen=True)
class FittedValue:
    """A parameter after the fit, in its unit: the value, and the limits of its 95 % interval.

    `identified`: the flight determines it. If not, the value is close to the prior; `like`: the parameter that cannot
    be separated from it, "" for none.
    """

    name: str
    unit: str
    value: float
    low: float
    high: float
    identified: bool
    like: str = ""


def name_of(id_: int) -> str:
    """Return the name of a transmitter in the names of its parameters."""
    return "transmitter" if id_ == NO_ID else f"transmitter {id_}"


def receiver_parameters(model: str) -> list[Parameter]:
    """Return the parameters of the receiver."""
    every = [
        Parameter("kappa_eq", math.log(1.542), 1.0, logarithm=True),
        Parameter("latency", 0.3, 1.5, "s"),
        Parameter("mount yaw", 0.0, 1.8, "°", 180 / math.pi),
        Parameter("mount x", 0.0, 0.7, "m"),
        Parameter("mount y", 0.0, 0.7, "m"),
        Parameter("mount z", 0.0, 0.7, "m"),
    ]
    if model == "pulsed":
        every.append(Parameter("gain y / x", 0.0, 0.4, logarithm=True))
    return every


def transmitter_parameters(flights: list[RecordedFlight], id_: int, start: Floats, *, first: bool) -> list[Parameter]:
    """Return the parameters of one transmitter. `start`: its place, yaw and pitch from the search for a start."""
    degrees, name = 180 / math.pi, name_of(id_)
    surveyed = next((flight.places[id_] for flight in flights if id_ in flight.places), None)
    place, sigma = (start[:3], 30.0) if surveyed is None else (surveyed, 0.3)
    every = [
        Parameter(f"{name} north", float(place[0]), sigma, "m"),
        Parameter(f"{name} east", float(place[1]), sigma, "m"),
        Parameter(f"{name} down", float(place[2]), min(sigma, 5.0), "m"),
        Parameter(f"{name} yaw", float(start[3]), 1.8, "°", degrees),
        Parameter(f"{name} pitch", 0.0, 1.5, "°", degrees),
    ]
    if not first:
        every.append(Parameter(f"{name} strength", 0.0, 0.5, logarithm=True))
    return every
