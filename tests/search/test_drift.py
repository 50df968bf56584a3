"""A drift of the places reported is followed, here by readings made by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from arva_hil.search.strategies import dipole
from arva_hil.search.strategies.drift import DriftFit, fitted, fitted_again

PLACE, MOMENT = np.array([0.0, 0.0, 1.0]), dipole.MOMENT * np.array([0.6, 0.8, 0.0])
EVERY_S, SMOOTH_S = 2.0, 5.0


def walk(seed: int, sigma_m: float, count: int) -> NDArray[np.float64]:
    """A slow random drift (count, 3): a Gauss-Markov process of 30 s, smoothed."""
    rng, kept, smooth = np.random.default_rng(seed), math.exp(-EVERY_S / 30), math.exp(-EVERY_S / SMOOTH_S)
    raw = drift = sigma_m * rng.standard_normal(3)
    every = []
    for _ in range(count):
        raw = kept * raw + math.sqrt(1 - kept**2) * sigma_m * rng.standard_normal(3)
        drift = smooth * drift + (1 - smooth) * raw
        every.append(drift)
    return np.array(every)


def heard(at: NDArray[np.float64]) -> tuple[float, float]:
    """d [m] and δ [rad] of a level receiver that looks north, rounded as the receiver shows them."""
    r = at - PLACE
    n = r / np.linalg.norm(r)
    h = (3 * (MOMENT @ n) * n - MOMENT) / np.linalg.norm(r) ** 3
    return round(math.hypot(h[0], h[1]) ** (-1 / 3), 2), round(math.atan2(h[1], h[0]), 2)


@pytest.mark.parametrize("seed", [0, 4, 13, 14])
def test_a_large_drift_is_followed_from_reading_to_reading(seed: int) -> None:
    """The field is the same on both sides of a transmitter: a fit that begins anew finds the other side at times."""
    readings, drift = dipole.DipoleReadings(), walk(seed, 2.0, 50)
    x, fits, off = np.array([[*PLACE, *MOMENT, 0.0]]), list[DriftFit](), list[float]()
    for k, error in enumerate(drift):
        at = np.array([1.5 * math.cos(0.8 * k), 1.5 * math.sin(0.8 * k), -3.0])
        readings.add((at + error).tolist(), np.eye(3), *heard(at), False, EVERY_S * k)
        if k >= 8 and k % 2 == 0:
            fits = fitted_again(x, fits, readings, 1.0)
            x = np.array([fit.x for fit in fits])
            off.append(math.dist(fits[0].now[:2], (PLACE + error)[:2]))
    assert max(off) < 1.5


def test_hypotheses_fitted_together_are_those_fitted_alone() -> None:
    readings, drift = dipole.DipoleReadings(), walk(3, 0.5, 20)
    for k, error in enumerate(drift):
        at = np.array([4 * math.cos(0.5 * k), 4 * math.sin(0.5 * k), -3.0])
        readings.add((at + error).tolist(), np.eye(3), *heard(at), False, EVERY_S * k)
    x = np.array([[*(PLACE + off), *MOMENT, 0.0] for off in ((0.1, 0.0, 0.0), (1.0, 2.0, 0.5), (-3.0, 1.0, 0.0))])
    together = fitted(x, readings, 0.1, 1.0, 6)
    for begin, one in zip(x, together, strict=True):
        (alone,) = fitted(begin[None], readings, 0.1, 1.0, 6)
        assert all(np.array_equal(a, b) for a, b in zip(one, alone, strict=True))
    nearer = fitted(x, readings, 0.1, 1.0, 3, together[:2])
    (alone,) = fitted(x[1:2], readings, 0.1, 1.0, 3, together[1:2])
    assert all(np.array_equal(a, b) for a, b in zip(nearer[1], alone, strict=True))
