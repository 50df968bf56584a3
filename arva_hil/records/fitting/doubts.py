"""Doubts: residuals that a model cannot have, and places that cannot be right."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from arva_hil.records.fitting.estimation import Estimation
from arva_hil.records.fitting.parameters import name_of
from arva_hil.records.fitting.result import ReceiverFit

_PAPER_M: Final = 50.0  # its mid zone ends there
_STEP_M: Final = 0.05  # a larger step of d is not whole centimetres
_AGE_S: Final = 0.15  # a larger scatter of the age is not that of a receiver that reads for each frame
_GAIN: Final = 6.0  # of the logarithm of the likelihood
_REPEATED: Final = 0.25
_POOR: Final = 0.15  # of ln d


def doubts(problem: Estimation, fit: ReceiverFit) -> list[str]:
    """Sentences for a person; empty if the model and the places fit."""
    return [*_of_model(problem, fit), *_of_places(problem, fit)]


def _of_model(problem: Estimation, fit: ReceiverFit) -> Iterator[str]:
    signs = []
    steps = max(max(flight.d_step) for flight in fit.flights)
    if fit.model == "paper":
        if steps > _STEP_M:
            signs.append(f"d comes in steps of {steps:g} m, this model gives whole centimetres")
        age = fit.scatter.age_s
        if age > _AGE_S and problem.log_likelihood_gain > _GAIN:
            signs.append(
                f"the readings are of different ages, with a scatter of {age:.2f} s (logarithm of the likelihood "
                f"+{problem.log_likelihood_gain:.0f}), this model reads at each frame"
            )
        repeated = max(flight.repeated for flight in fit.flights)
        if repeated > _REPEATED:
            signs.append(f"{100 * repeated:.0f} % of the frames repeat the reading before them in flight")
        farthest = max(float(flight.d_m.max()) for flight in fit.flights)
        if farthest > _PAPER_M:
            signs.append(f"d is up to {farthest:.0f} m, this model ends at {_PAPER_M:g} m")
    deltas = [flight.delta[np.isfinite(flight.delta)] for flight in fit.flights]
    if fit.model == "rssi" and any(len(delta) and np.ptp(delta) > 0.2 for delta in deltas):
        signs.append("δ changes, and this model has one antenna and no δ")
    if fit.d_scatter > _POOR:
        signs.append(f"the residuals of d scatter by {100 * fit.d_scatter:.0f} %")
    if signs:
        other = "pulsed" if fit.model in ("paper", "rssi") else "paper"
        yield f"the model {fit.model} does not fit: {'; '.join(signs)}. Try --model {other}"


def _of_places(problem: Estimation, fit: ReceiverFit) -> Iterator[str]:
    for index, id_ in enumerate(fit.ids):
        for flight in fit.flights:
            mine = flight.part(flight.who == index)
            if id_ not in flight.places or not len(mine):
                continue
            position, _ = mine.poses(0.0)
            nearest = int(mine.d_m.argmin())
            range_m = float(np.linalg.norm(position[nearest] - flight.places[id_]))
            if range_m > 2.5 * mine.d_m[nearest] + 5 * problem.gps.sigma_m:
                north, east, _ = position[nearest]
                yield (
                    f"the surveyed place of {name_of(id_)} is about {range_m - mine.d_m[nearest]:.0f} m off: the "
                    f"smallest d, {mine.d_m[nearest]:.1f} m, was read {range_m:.0f} m from it, at {north:.0f} m north, "
                    f"{east:.0f} m east"
                )
                break
