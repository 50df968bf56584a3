"""The scatter of readings, and its covariance: noise of the antennas, rounding, age of the readings, error of GPS."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np

from arva_hil.records.fitting.flight import Floats, RecordedFlight
from arva_hil.records.fitting.prediction import Predicted

_FLOOR: Final = 5e-4  # of ln d: the field is not exactly that of a dipole
_DELTA_FLOOR: Final = 5e-4  # rad
_CLEAN: Final = 2.5  # standard deviations: readings beyond are outliers
_REFERENCE_RANGE_M: Final = 80.0


class Gps(NamedTuple):
    """The error of the reported position on each axis: standard deviation [m], correlation time [s]."""

    sigma_m: float
    tau_s: float


@dataclass(frozen=True)
class Scatter:
    """Noise at the antennas x and y, in units of the reference transmitter's field; σ of the age of a reading [s]."""

    x: float
    y: float
    age_s: float

    @property
    def theta(self) -> Floats:
        """The logarithms of the scatter, for a numeric search."""
        return np.log([self.x, self.y, self.age_s])

    @classmethod
    def of(cls, theta: Floats) -> Scatter:
        return cls(*(float(value) for value in np.exp(theta)))


_USUAL_NOISE: Final = 1 / (6 * math.pi * _REFERENCE_RANGE_M**3)
USUAL: Final = Scatter(_USUAL_NOISE, _USUAL_NOISE, 0.02)
"""The paper's noise: a third of its bound on each antenna."""


class Linear(NamedTuple):
    """The residuals of one flight at some parameters.

    Rows: ln d of each reading, then δ of those that have one. `residual` (R,), `reading` (R,): its reading. `place`
    (R, 3): derivative by position [1/m, rad/m]. `bend` (R, 6): second derivatives, those
    by one axis over √2. `age` (R,): derivative by time [1/s, rad/s].
    """

    residual: Floats
    reading: Any
    place: Floats
    bend: Floats
    age: Floats
    turned: Any
    """(R,) true for rows of δ."""


def covariance(
    flight: RecordedFlight, predicted: Predicted, linear: Linear, scatter: Scatter, gps: Gps, bad: Floats
) -> Floats:
    """Return the covariance (R, R) of the residuals. `bad` (N,): factor of the variance of outliers, 1 for others."""
    return own_covariance(flight, predicted, linear, scatter, bad) + gps_covariance(flight, linear, gps)


def gps_covariance(flight: RecordedFlight, linear: Linear, gps: Gps) -> Floats:
    """Return the part of the position's error (R, R), which does not depend on the scatter."""
    at = flight.time_s[linear.reading]
    together = gps.sigma_m**2 * np.exp(np.abs(at[:, None] - at[None]) * (-1 / gps.tau_s))
    return np.asarray(together * (linear.place @ linear.place.T) + together**2 * (linear.bend @ linear.bend.T))


def own_covariance(
    flight: RecordedFlight, predicted: Predicted, linear: Linear, scatter: Scatter, bad: Floats
) -> Floats:
    """Return the part that differs from reading to reading."""
    n = len(flight)
    cos, sin = np.cos(predicted.delta), np.sin(predicted.delta)
    nearer = np.exp(3 * (np.log(flight.d_m) - predicted.log_d))  # by the reading: GPS errs, and noise goes with d³
    relative = np.clip(nearer, 0.5, 2.0) / predicted.shown
    xx, yy = (scatter.x * relative) ** 2, (scatter.y * relative) ** 2
    d_step = np.where(flight.d_m < 10, *flight.d_step)
    of_d = (cos**2 * xx + sin**2 * yy) / 9 + (d_step / flight.d_m) ** 2 / 12 + _FLOOR**2
    of_delta = sin**2 * xx + cos**2 * yy + flight.delta_step**2 / 12 + _DELTA_FLOOR**2
    both = cos * sin * (xx - yy) / 3
    rows, which = np.arange(len(linear.reading)), linear.reading
    own = np.where(linear.turned, of_delta[which], of_d[which]) + scatter.age_s**2 * linear.age**2
    result = np.diag(own * bad[which])
    of_d_row, delta_row = which[n:], rows[n:]
    pair = (both[of_d_row] + scatter.age_s**2 * linear.age[of_d_row] * linear.age[delta_row]) * bad[of_d_row]
    result[delta_row, of_d_row] = result[of_d_row, delta_row] = pair
    return result


def minus_log_likelihood(matrix: Floats, residual: Floats, jacobian: Floats) -> float:
    """Return −2 ln of the restricted likelihood, up to a constant; infinity for an impossible covariance."""
    from scipy.linalg import LinAlgError, cho_solve, cholesky

    try:
        lower = cholesky(matrix, lower=True, check_finite=False)
    except LinAlgError:
        return math.inf
    solved = cho_solve((lower, True), np.column_stack([residual, jacobian]), check_finite=False)
    information = jacobian.T @ solved[:, 1:]
    _, of_parameters = np.linalg.slogdet(information + 1e-9 * np.eye(len(information)))
    return float(2 * np.log(np.diag(lower)).sum() + residual @ solved[:, 0] + of_parameters)


def outlier_factors(lower: Floats, residual: Floats, linear: Linear, bad: Floats) -> Floats:
    """Return the factor by which the variance of each reading has to grow (N,), 1 for most.

    `lower`: the Cholesky factor of the covariance. Each reading is compared with its prediction from all others.
    """
    from scipy.linalg import cho_solve

    inverse = cho_solve((lower, True), np.eye(len(lower)), check_finite=False)
    z = np.abs(inverse @ residual) / np.sqrt(np.diag(inverse))
    z *= np.sqrt(bad[linear.reading])
    worst = np.zeros(len(bad))
    np.maximum.at(worst, linear.reading, z)
    return np.where(worst > 2 * _CLEAN, (worst / _CLEAN) ** 2, 1.0)
