"""Remarks on a fit: doubts about the model and the places, what is not determined, and the best next pass."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Final

import numpy as np

from arva_hil.events.words.text import placed
from arva_hil.model.field import rotation
from arva_hil.records.fitting.estimation import Estimation, Part
from arva_hil.records.fitting.flight import Floats, RecordedFlight, with_near_signs
from arva_hil.records.fitting.parameters import name_of
from arva_hil.records.fitting.result import ReceiverFit
from arva_hil.records.fitting.scatter import covariance

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
                yield (
                    f"the surveyed place of {name_of(id_)} is about {range_m - mine.d_m[nearest]:.0f} m off: the "
                    f"smallest d, {mine.d_m[nearest]:.1f} m, was read {range_m:.0f} m from it, at "
                    f"{placed(*position[nearest, :2])}"
                )
                break


_LENGTH_S: Final = 60.0
_WORTH: Final = 0.8  # recommend a pass only if it leaves less than this share of the uncertainty

Path = Callable[[Floats], tuple[Floats, Floats]]
"""Time (T,) → offsets from the transmitter (T, 3) NED [m], heading (T,) [rad]."""


def _pass(heading: float, height: float, aside: float) -> Path:
    def at(t: Floats) -> tuple[Floats, Floats]:
        along = -20 + 40 * np.abs((t / _LENGTH_S * 2) % 2 - 1)
        turn = np.where(t < _LENGTH_S / 2, heading, heading + math.pi)
        cos, sin = math.cos(heading), math.sin(heading)
        place = np.stack([along * cos - aside * sin, along * sin + aside * cos, np.full(len(t), -height)], axis=1)
        return place, turn

    return at


def _turn(t: Floats) -> tuple[Floats, Floats]:
    return np.tile([7.0, 3.0, -4.0], (len(t), 1)), 2 * math.pi * t / _LENGTH_S


def _climb(t: Floats) -> tuple[Floats, Floats]:
    return np.stack([np.full(len(t), 5.0), np.full(len(t), 3.0), -3 - 12 * t / _LENGTH_S], axis=1), 0.3 + 0 * t


_PASSES: Final[dict[str, Path]] = {
    "a pass in each direction, to the north and back, 4 m above the transmitter": _pass(0.0, 4.0, 0.0),
    "a pass in each direction, to the east and back, 4 m above the transmitter": _pass(math.pi / 2, 4.0, 0.0),
    "a pass in each direction, to the north-east and back, 10 m above the transmitter": _pass(math.pi / 4, 10.0, 5.0),
    "a slow turn on the spot, 7 m beside the transmitter": _turn,
    "a slow climb from 3 to 15 m, 6 m beside the transmitter": _climb,
}


def advice(problem: Estimation, fit: ReceiverFit) -> list[str]:
    """Return sentences about unknown values and the next pass; none if all is known."""
    open_, said = [], []
    for n, parameter in enumerate(problem.parameters):
        estimate = fit.estimates[parameter.name]
        if not estimate.identified:
            like = f", not from {estimate.like}" if estimate.like else ""
            interval = f"{estimate.low:.2g} … {estimate.high:.2g} {parameter.unit}".rstrip()
            said.append(f"the flight does not determine {parameter.name}{like}: {interval}")
            open_.append((n, parameter))
    if not open_:
        return []
    before = np.sqrt(np.diag(fit.covariance))
    best: tuple[float, str, list[str]] | None = None
    for name, path in _PASSES.items():
        after = np.sqrt(np.diag(np.linalg.inv(problem.information + _information(problem, path))))
        shares = [float(after[n] / before[n]) for n, _ in open_]
        told = [p.name for (_, p), share in zip(open_, shares, strict=True) if share < _WORTH]
        if best is None or sum(shares) < best[0]:
            best = (sum(shares), name, told)
    if best and best[2]:
        said.append(f"next: fly {best[1]}, which says more about {', '.join(best[2])}")
    return said


def _information(problem: Estimation, path: Path) -> Floats:
    """Return the information of a minute on a path around the first transmitter, at one reading a second."""
    first = [parameter.name for parameter in problem.parameters].index(f"{problem.names[0]} north")
    place = problem.theta[first : first + 3]
    t = np.arange(0.0, _LENGTH_S, 1.0)
    fine = np.arange(-5.0, _LENGTH_S + 5.0, 0.5)
    offset, heading = path(np.clip(fine, 0, _LENGTH_S))
    attitude = np.stack([rotation.from_euler(0.0, 0.0, float(one)) for one in np.unwrap(heading)])
    planned: RecordedFlight = replace(
        problem.flights[0],
        time_s=t,
        who=np.zeros(len(t), np.intp),
        d_m=np.full(len(t), 10.0),
        delta=np.zeros(len(t)),
        inner=np.zeros(len(t), bool),
        track_s=fine,
        track=place + offset,
        attitude=with_near_signs(attitude),
    )
    predicted = problem.predict(planned, problem.theta)
    planned = replace(planned, d_m=np.exp(predicted.log_d), delta=predicted.delta)
    part = Part(planned, np.ones(len(t)))
    now, linear = problem.linear(part, problem.theta)
    matrix = covariance(planned, now, linear, problem.scatter, problem.gps, part.bad)
    jacobian = problem.jacobian(part, problem.theta, linear)
    return np.asarray(jacobian.T @ np.linalg.solve(matrix, jacobian))
