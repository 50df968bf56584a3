"""The fit: a robust start, then generalized least squares with a scatter that the readings tell themselves.

The error of the reported position is correlated in time. It is not a parameter: it is a part of the covariance of the
residuals, so that the intervals of the parameters contain it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky, solve_triangular
from scipy.optimize import least_squares, minimize

from arva_hil.records.fitting.flight import Floats, RecordedFlight, thinned
from arva_hil.records.fitting.parameters import Parameter, name_of, receiver_parameters, transmitter_parameters
from arva_hil.records.fitting.prediction import Predicted, predict, residuals
from arva_hil.records.fitting.scatter import (
    USUAL,
    Gps,
    Linear,
    Scatter,
    covariance,
    gps_covariance,
    minus_log_likelihood,
    outlier_factors,
    own_covariance,
)
from arva_hil.records.fitting.start import candidates

_ROUNDS: Final = 9
_SCATTER_ROUNDS: Final = (1, 3)  # the rounds that estimate the scatter
_OUTLIER_ROUNDS: Final = (0, 2, 4)
_SETTLED: Final = 0.05  # standard deviations: a round that changes no parameter by more is the last
_STEP_M: Final = 0.05
_STEP_S: Final = 0.05
_NEAR_LIMIT: Final = 0.85  # readings predicted beyond this share of the range are left out: weak ones are lost there
_NEAR: Final = 5.0  # standard deviations of GPS: nearer readings are left out, their place is not known
_BENT: Final = 0.1  # rad or of ln d: readings where GPS bends the prediction more, as near δ's poles, are left out
_NOISY: Final = 0.3  # relative noise beyond which a reading is left out
_START_READINGS: Final = 150
_LEAST_AGE_S: Final = 1e-3
_ROBUST: Final = (0.12, 0.15)  # scale of residuals of ln d and δ at the start


class Part(NamedTuple):
    """The readings of a flight that are used. `bad` (N,): factors of the variance of outliers."""

    flight: RecordedFlight
    bad: Floats


class Estimation:
    """One estimation. Remembers the parameters, the scatter and which readings are used."""

    def __init__(self, flights: Sequence[RecordedFlight], model: str, gps: Gps) -> None:
        self.flights = list(flights)
        self.model = model
        self.gps = gps
        self.scatter = USUAL
        self.used = [np.ones(len(flight), bool) for flight in self.flights]
        self.bad = [np.ones(len(flight)) for flight in self.flights]
        self.parameters: list[Parameter] = []
        self.theta = np.zeros(0)
        self.information = np.zeros((0, 0))
        self.log_likelihood_gain = 0.0

    def solve(self) -> None:
        """Fit the parameters and the scatter."""
        self._start()
        for number in range(_ROUNDS):
            self._choose()
            if number in _SCATTER_ROUNDS:
                self._estimate_scatter()
            settled = self._refine(look_for_outliers=number in _OUTLIER_ROUNDS)
            if settled and number > max(*_SCATTER_ROUNDS, *_OUTLIER_ROUNDS):
                break

    @property
    def ids(self) -> Sequence[int]:
        return self.flights[0].ids

    @property
    def names(self) -> list[str]:
        """The names of the transmitters."""
        return [name_of(id_) for id_ in self.ids]

    def predict(self, flight: RecordedFlight, theta: Floats, shift: Floats | float = 0.0) -> Predicted:
        """Return the readings of a flight that some parameters predict. `shift`: of the reported positions [m]."""
        values = dict(zip([parameter.name for parameter in self.parameters], theta.tolist(), strict=True))
        return predict(flight, self.model, values, shift)

    @property
    def means(self) -> Floats:
        return np.array([parameter.mean for parameter in self.parameters])

    @property
    def sigmas(self) -> Floats:
        return np.array([parameter.sigma for parameter in self.parameters])

    def parts(self) -> list[Part]:
        """Return the readings used of each flight."""
        return [
            Part(flight.part(used), bad[used])
            for flight, used, bad in zip(self.flights, self.used, self.bad, strict=True)
        ]

    def linear(self, part: Part, theta: Floats) -> tuple[Predicted, Linear]:
        """Return the residuals at some parameters, and their derivatives by place and time.

        The derivatives by place are differences over the usual error of GPS; the mean over that error is a part of the
        prediction.
        """
        flight, rows = part.flight, self._rows(part, theta)
        step = max(math.sqrt(3) * self.gps.sigma_m, _STEP_M)
        shift = np.eye(3) * step
        ahead = [self._change(part, theta, rows, one) for one in shift]
        back = [self._change(part, theta, rows, -one) for one in shift]
        place = np.stack([(a - b) / (2 * step) for a, b in zip(ahead, back, strict=True)], axis=1)
        bends = [(a + b) / step**2 for a, b in zip(ahead, back, strict=True)]
        mixed = []
        for i, j in ((0, 1), (0, 2), (1, 2)):
            both = self._change(part, theta, rows, shift[i] + shift[j])
            mixed.append((both - ahead[i] - ahead[j]) / step**2)
        later = theta.copy()
        later[1] -= _STEP_S
        age = self._change(part, later, rows) / _STEP_S
        reading = np.concatenate([np.arange(len(flight)), np.flatnonzero(self._has_delta(flight))])
        mean = self.gps.sigma_m**2 / 2 * np.sum(bends, axis=0)
        bend = np.stack([*(np.array(bends) / math.sqrt(2)), *mixed], axis=1)
        is_delta = np.arange(len(rows)) >= len(flight)
        return self.predict(flight, theta), Linear(rows + mean, reading, place, bend, age, is_delta)

    def jacobian(self, part: Part, theta: Floats, linear: Linear) -> Floats:
        """Return the derivatives of the residuals by the parameters.

        Those by places come from `linear`: so a constant error of GPS has exactly the effect of another place.
        """
        rows = self._rows(part, theta)
        _, body = part.flight.poses(float(theta[1]))
        aside = np.einsum("ri,rij->rj", linear.place, body[linear.reading])
        of_place = {f"mount {axis}": aside[:, n] for n, axis in enumerate("xyz")}
        for index, name in enumerate(self.names):
            mine = (part.flight.who == index)[linear.reading]
            of_place |= {
                f"{name} {axis}": -linear.place[:, n] * mine for n, axis in enumerate(("north", "east", "down"))
            }
        columns = []
        for index, (parameter, sigma) in enumerate(zip(self.parameters, self.sigmas, strict=True)):
            if parameter.name in of_place:
                columns.append(of_place[parameter.name])
                continue
            step = min(1e-3, 1e-3 * sigma)
            more = theta.copy()
            more[index] += step
            columns.append(self._change(part, more, rows) / step)
        return np.stack(columns, axis=1)

    def _has_delta(self, flight: RecordedFlight) -> NDArray[np.bool_]:
        return np.isfinite(flight.delta) & (self.model != "rssi")

    def _rows(self, part: Part, theta: Floats, shift: Floats | float = 0.0) -> Floats:
        log_d, delta = residuals(part.flight, self.predict(part.flight, theta, shift))
        return np.concatenate([log_d, delta[self._has_delta(part.flight)]])

    def _change(self, part: Part, theta: Floats, rows: Floats, shift: Floats | float = 0.0) -> Floats:
        """Return the residuals at shifted places minus `rows`; those of δ are not half a turn away."""
        change = self._rows(part, theta, shift) - rows
        n = len(part.flight)
        change[n:] = (change[n:] + math.pi / 2) % math.pi - math.pi / 2
        return change

    def _start(self) -> None:
        best: tuple[float, Floats, list[Parameter]] | None = None
        some = [thinned(flight, _START_READINGS) for flight in self.flights]

        def rows(theta: Floats) -> Floats:
            every = []
            for flight in some:
                log_d, delta = residuals(flight, self.predict(flight, theta))
                every += [log_d / _ROBUST[0], delta[self._has_delta(flight)] / _ROBUST[1]]
            return np.concatenate([*every, (theta - self.means) / self.sigmas])

        starts = []
        for index, id_ in enumerate(self.ids):
            flight = max(self.flights, key=lambda one: int((one.who == index).sum()))
            surveyed = next((one.places[id_] for one in self.flights if id_ in one.places), None)
            starts.append(candidates(flight, index, surveyed, one_antenna=self.model == "rssi"))
        for number in range(max(map(len, starts))):
            chosen = [every[min(number, len(every) - 1)] for every in starts]
            self.parameters = receiver_parameters(self.model)
            theta = [parameter.mean for parameter in self.parameters]
            theta[0], theta[2] = float(chosen[0][5]), float(chosen[0][6])
            for n, (id_, start) in enumerate(zip(self.ids, chosen, strict=True)):
                mine = transmitter_parameters(self.flights, id_, start, first=n == 0)
                self.parameters += mine
                theta += [*start[:5].tolist(), float(start[5] - chosen[0][5])][: len(mine)]
                if any(id_ in flight.places for flight in self.flights):
                    theta[-len(mine) : -len(mine) + 3] = [parameter.mean for parameter in mine[:3]]
            found = least_squares(rows, theta, loss="soft_l1", x_scale=self.sigmas, max_nfev=40)
            if best is None or found.cost < best[0]:
                best = (float(found.cost), found.x, self.parameters)
        assert best is not None
        _, self.theta, self.parameters = best

    def _choose(self) -> None:
        """Use readings that are predicted within the range, and are not mostly noise."""
        for n, flight in enumerate(self.flights):
            predicted = self.predict(flight, self.theta)
            noise = max(self.scatter.x, self.scatter.y) / predicted.shown
            used = (noise < _NOISY) & (predicted.log_d > math.log(max(_NEAR * self.gps.sigma_m, 0.1)))
            _, linear = self.linear(Part(flight, self.bad[n]), self.theta)
            bends = np.zeros(len(flight))  # beyond what the derivatives say, by the error of GPS [rad, of ln d]
            np.maximum.at(bends, linear.reading, self.gps.sigma_m**2 * np.linalg.norm(linear.bend, axis=1))
            used &= bends < _BENT
            if flight.heard_until_m is not None:
                used &= predicted.log_d < math.log(_NEAR_LIMIT * flight.heard_until_m)
            if used.sum() >= len(self.theta):
                self.used[n] = used

    def _estimate_scatter(self) -> None:
        """Find the scatter with the highest likelihood."""
        problems: list[tuple[Part, Predicted, Linear, Floats, Floats]] = []
        for part in self.parts():
            predicted, linear = self.linear(part, self.theta)
            of_gps = gps_covariance(part.flight, linear, self.gps)
            problems.append((part, predicted, linear, self.jacobian(part, self.theta, linear), of_gps))

        def cost(theta: Floats) -> float:
            scatter = Scatter.of(theta)
            total = 2.0 * max(0.0, theta[2] - math.log(2.0)) ** 2
            for part, predicted, linear, jacobian, of_gps in problems:
                matrix = own_covariance(part.flight, predicted, linear, scatter, part.bad) + of_gps
                total += minus_log_likelihood(matrix, linear.residual, jacobian)
            return float(total)

        start = self.scatter.theta
        simplex = np.vstack([start, *(start + 0.7 * row for row in np.eye(3))])
        found = minimize(
            cost,
            start,
            method="Nelder-Mead",
            bounds=[(usual - 6, usual + 6) for usual in USUAL.theta],
            options={"initial_simplex": simplex, "maxfev": 60, "fatol": 0.05},
        )
        without = found.x.copy()
        without[2] = math.log(_LEAST_AGE_S)
        self.log_likelihood_gain = (cost(without) - found.fun) / 2
        self.scatter = Scatter.of(found.x)
        self._noise_information = _second_derivatives(cost, found.x)

    def _refine(self, *, look_for_outliers: bool) -> bool:
        """Generalized least squares with the present scatter. Returns True if little has changed."""
        parts, lines, lowers, offsets = self.parts(), list[Linear](), list[Floats](), list[Floats]()
        for part in parts:
            predicted, linear = self.linear(part, self.theta)
            matrix = covariance(part.flight, predicted, linear, self.scatter, self.gps, part.bad)
            lowers.append(cholesky(matrix, lower=True, check_finite=False))
            offsets.append(linear.residual - self._rows(part, self.theta))
            lines.append(linear)

        def rows(theta: Floats) -> Floats:
            each = [
                solve_triangular(lower, self._rows(part, theta) + offset, lower=True, check_finite=False)
                for part, lower, offset in zip(parts, lowers, offsets, strict=True)
            ]
            return np.concatenate([*each, (theta - self.means) / self.sigmas])

        def jacobian(theta: Floats) -> Floats:
            each = [
                solve_triangular(lower, self.jacobian(part, theta, linear), lower=True, check_finite=False)
                for part, lower, linear in zip(parts, lowers, lines, strict=True)
            ]
            return np.vstack([*each, np.diag(1 / self.sigmas)])

        found = least_squares(rows, self.theta, jac=jacobian, x_scale=self.sigmas, max_nfev=8)
        self.information = found.jac.T @ found.jac
        small = np.abs(found.x - self.theta) * np.sqrt(np.diag(self.information)) < _SETTLED
        self.theta = found.x
        if look_for_outliers:
            for n, (part, linear, lower, offset) in enumerate(zip(parts, lines, lowers, offsets, strict=True)):
                residual = self._rows(part, self.theta) + offset
                self.bad[n][self.used[n]] = outlier_factors(lower, residual, linear, part.bad)
        return bool(small.all())

    def noise_covariance(self) -> Floats:
        """Return the covariance of the logarithms of the scatter."""
        values, vectors = np.linalg.eigh(self._noise_information)
        return np.asarray((vectors / np.maximum(values, 1e-3)) @ vectors.T)


def _second_derivatives(cost: Callable[[Floats], float], at: Floats) -> Floats:
    """Return half the matrix of second derivatives: the information, if the cost is −2 ln likelihood."""
    step, n = 0.15, len(at)
    middle = cost(at)
    result = np.zeros((n, n))
    ends = {(i, sign): cost(at + sign * step * np.eye(n)[i]) for i in range(n) for sign in (-1, 1)}
    for i in range(n):
        result[i, i] = (ends[i, 1] - 2 * middle + ends[i, -1]) / step**2
        for j in range(i):
            both = cost(at + step * (np.eye(n)[i] + np.eye(n)[j]))
            result[i, j] = result[j, i] = (both - ends[i, 1] - ends[j, 1] + middle) / step**2
    return np.nan_to_num(result / 2, posinf=0.0, neginf=0.0)
