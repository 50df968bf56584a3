"""The result of a fit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from arva_hil.records.fitting.flight import Floats, RecordedFlight
from arva_hil.records.fitting.parameters import FittedValue
from arva_hil.records.fitting.scatter import Scatter


@dataclass(frozen=True)
class ReceiverFit:
    """The properties of a receiver and its transmitters, by some flights.

    `estimates`: by name, in a fixed order; those of the noise too. `covariance`: of the parameters, in their units of
    the fit, in the order of the first `estimates`. `d_scatter`, `delta_scatter_deg`: of the residuals. `outliers`:
    readings that do not fit. `doubts`: sentences on a model that does not fit, or on a place. `advice`: the next pass.
    """

    model: str
    flights: Sequence[RecordedFlight]
    ids: Sequence[int]
    covariance: Floats
    estimates: Mapping[str, FittedValue]
    scatter: Scatter
    readings: int
    outliers: int
    d_scatter: float
    delta_scatter_deg: float | None
    doubts: Sequence[str]
    advice: Sequence[str]

    def as_json(self) -> dict[str, Any]:
        """Return the fit as plain values."""
        return {
            "model": self.model,
            "records": [flight.name for flight in self.flights],
            "readings": self.readings,
            "outliers": self.outliers,
            "d_scatter": self.d_scatter,
            "delta_scatter_deg": self.delta_scatter_deg,
            "parameters": [asdict(one) for one in self.estimates.values()],
            "doubts": list(self.doubts),
            "advice": list(self.advice),
        }
