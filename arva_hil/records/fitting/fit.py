"""Fits a receiver and its transmitters to records: estimates, doubts about the model, advice for the next flight."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from arva_hil.records.fitting.estimation import Estimation
from arva_hil.records.fitting.flight import FitError, Floats, RecordedFlight
from arva_hil.records.fitting.parameters import TOLD, Z_95, FittedValue
from arva_hil.records.fitting.prediction import residuals
from arva_hil.records.fitting.remarks import advice, doubts
from arva_hil.records.fitting.result import ReceiverFit
from arva_hil.records.fitting.scatter import Gps

MODELS = ("paper", "pulsed", "rssi")

_WIDE = 0.7  # largest sigma of the logarithm of the noise; a scatter with more is not identified
_LIKE = 0.75  # report a larger correlation


def fit(flights: Sequence[RecordedFlight], model: str, gps: Gps) -> ReceiverFit:
    """Fit all flights together. Raises FitError if they are of different transmitters."""
    if model not in MODELS:
        raise FitError(f"no fit for the model {model!r}; there are {', '.join(MODELS)}")
    if len({flight.ids for flight in flights}) > 1:
        named = "; ".join(f"{flight.name}: {', '.join(map(str, flight.ids))}" for flight in flights)
        raise FitError(f"the records have different transmitters ({named}): fit them one by one")
    problem = Estimation(flights, model, gps)
    problem.solve()
    inverse = np.linalg.inv(problem.information).astype(np.float64)
    estimates = _estimates(problem, inverse)
    estimates |= {one.name: one for one in _noise(problem)}
    parts = problem.parts()
    each = [residuals(part.flight, problem.predict(part.flight, problem.theta)) for part in parts]
    log_d = np.concatenate([one for one, _ in each])
    delta = np.concatenate([one for _, one in each])
    delta = delta[np.isfinite(delta)]
    found = ReceiverFit(
        model,
        flights,
        problem.ids,
        inverse,
        estimates,
        problem.scatter,
        sum(len(part.flight) for part in parts),
        sum(int((part.bad > 1).sum()) for part in parts),
        float(1.4826 * np.median(np.abs(log_d))),
        float(np.degrees(1.4826 * np.median(np.abs(delta)))) if len(delta) and model != "rssi" else None,
        (),
        (),
    )
    return replace(found, doubts=doubts(problem, found), advice=advice(problem, found))


def _estimates(problem: Estimation, inverse: Floats) -> dict[str, FittedValue]:
    sigmas = np.sqrt(np.diag(inverse))
    correlations = inverse / np.outer(sigmas, sigmas)
    estimates = {}
    for n, parameter in enumerate(problem.parameters):
        middle, half = float(problem.theta[n]), float(Z_95 * sigmas[n])
        surveyed = parameter.sigma < 1 and parameter.unit == "m" and parameter.name.startswith("transmitter")
        told = surveyed or sigmas[n] < TOLD * parameter.sigma
        others = np.abs(correlations[n])
        others[n] = 0.0
        like = "" if told or others.max() < _LIKE else problem.parameters[int(others.argmax())].name
        value, low, high = (parameter.shown(one) for one in (middle, middle - half, middle + half))
        if parameter.name.endswith("yaw"):  # a dipole and a receiver do not distinguish front and back
            back = 180 * math.floor((value + 90) / 180)
            value, low, high = value - back, low - back, high - back
        estimates[parameter.name] = FittedValue(parameter.name, parameter.unit, value, low, high, told, like)
    names = [parameter.name for parameter in problem.parameters]
    for name in problem.names:  # the axis reversed is the same dipole
        turn = math.degrees(float(problem.theta[names.index(f"{name} yaw")])) - estimates[f"{name} yaw"].value
        pitch = estimates[f"{name} pitch"]
        if round(turn / 180) % 2:
            estimates[pitch.name] = replace(pitch, value=-pitch.value, low=-pitch.high, high=-pitch.low)
    return estimates


def _noise(problem: Estimation) -> list[FittedValue]:
    """Return the noise of the antennas: as the range of the paper's floor or in nA/m, and its ratio of y to x."""
    scatter, covariance = problem.scatter, problem.noise_covariance()
    sigma = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    largest = max(scatter.x, scatter.y) if problem.model != "rssi" else scatter.x
    of = float(sigma[0] if largest == scatter.x else sigma[1])
    known = of < _WIDE
    half = Z_95 * of
    if problem.model == "paper":
        floor_m = (6 * math.pi * largest) ** (-1 / 3)
        ratio = scatter.y / scatter.x
        of = math.sqrt(max(covariance[0, 0] + covariance[1, 1] - 2 * covariance[0, 1], 0.0))
        return [
            _within("floor_range_m", "m", floor_m, half / 3, known),
            _within("sensitivity y / x", "", ratio, Z_95 * of, of < _WIDE / 2),
            FittedValue("sensitivity z", "", 0.6, 0.0, 1.0, False),
        ]
    return [_within("noise_na_m", "nA/m", largest * 2e6 * math.pi, half, known)]


def _within(name: str, unit: str, value: float, half: float, known: bool) -> FittedValue:
    """Return a value whose logarithm has an interval of this half width."""
    return FittedValue(name, unit, value, value * math.exp(-half), value * math.exp(half), known)
