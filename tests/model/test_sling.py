"""A receiver on a rope: it hangs, lags, swings with its period, and dies down."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from arva_hil.model.field.rotation import Sling
from tests.every import every

LEVEL = np.eye(3)


def offsets(sling: Sling, times: list[float], velocities: list[tuple[float, float, float]]) -> np.ndarray:
    return np.array([sling.hang(t, np.zeros(3), np.array(v), LEVEL)[0] for t, v in zip(times, velocities, strict=True)])


def test_at_rest_it_hangs_straight_down_with_the_vehicle_s_heading() -> None:
    heading = Rotation.from_euler("zyx", [70, 10, -5], degrees=True).as_matrix()
    position, rotation = Sling(8.0, 0.1).hang(0.0, np.array([1.0, 2.0, -30.0]), np.zeros(3), heading)
    assert position == pytest.approx(np.array([1.0, 2.0, -22.0]))
    assert rotation @ rotation.T == pytest.approx(np.eye(3), abs=1e-12)
    assert rotation[:, 2] == pytest.approx(np.array([0.0, 0.0, 1.0]))
    assert math.atan2(rotation[1, 0], rotation[0, 0]) == pytest.approx(math.atan2(heading[1, 0], heading[0, 0]))


@given(st.floats(1, 20), st.floats(0, 0.5), st.floats(-1.0, 1.0), st.integers(0, 1000))
def test_between_instants_it_obeys_the_pendulum_s_equation(length: float, damping: float, a: float, seed: int) -> None:
    """Small swings, against an integrator of the equation."""
    times = np.cumsum(np.random.default_rng(seed).uniform(0.05, 1.2, 12)).tolist()
    sling = Sling(length, damping)
    made = offsets(sling, [0.0, *times], [(a * t, 0.0, 0.0) for t in (0.0, *times)])[1:, 0]
    omega = math.sqrt(9.81 / length)
    solved = solve_ivp(
        lambda t, y: [y[1], -2 * damping * omega * y[1] - omega**2 * y[0] - a],
        (0.0, times[-1]),
        [0.0, 0.0],
        t_eval=times,
        rtol=1e-9,
        atol=1e-10,
    )
    limit = 0.9 * length
    assert made == pytest.approx(np.clip(solved.y[0], -limit, limit), abs=1e-5)


def test_braking_swings_it_ahead_and_it_comes_to_rest() -> None:
    sling = Sling(5.0, 0.2)
    times = [n / 5 for n in range(301)]
    path = offsets(sling, times, [(3.0, 0.0, 0.0)] + [(max(0.0, 3.0 - 3.0 * t), 0.0, 0.0) for t in times[1:]])
    assert path[:10, 0].max() > 0.5
    assert abs(path[-1, 0]) < 1e-3
    assert (np.linalg.norm(path, axis=1) == pytest.approx(5.0)) is True


def test_after_a_long_gap_it_hangs_at_rest() -> None:
    sling = Sling(5.0, 0.0)
    offsets(sling, [0.0, 1.0], [(0.0, 0.0, 0.0), (2.0, 0.0, 0.0)])
    assert offsets(sling, [60.0], [(9.0, 0.0, 0.0)])[0] == pytest.approx(np.array([0.0, 0.0, 5.0]))


@every("wrong", [(0.0, 0.1), (5.0, 1.0), (5.0, -0.1)])
def test_a_sling_without_sense_is_refused(wrong: tuple[float, float]) -> None:
    with pytest.raises(ValueError, match="a sling of"):
        Sling(*wrong)
