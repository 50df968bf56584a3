"""The dipole against magpylib and against the paper's own form of it."""

from __future__ import annotations

import magpylib
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from arva_hil.model.field import Transmitters, dipole_field
from tests.every import every

FULL = st.floats(-1e300, 1e300)
NORMAL = st.floats(-1e300, 1e300, allow_subnormal=False)


def one(point: np.ndarray | list[float], rotation: np.ndarray | None = None, strength: float = 1.0) -> np.ndarray:
    """The field at a point of one transmitter at the origin."""
    R = np.eye(3) if rotation is None else rotation
    with np.errstate(divide="raise", over="raise", invalid="raise"):
        return dipole_field(point, np.zeros((1, 3)), R[None], np.array([strength]))[..., 0, :]


def test_agrees_with_magpylib() -> None:
    rng = np.random.default_rng(1)
    positions, strengths = rng.uniform(-30, 30, (50, 3)), rng.uniform(0.1, 5, 50)
    rotations = Rotation.from_quat(rng.normal(size=(50, 4)))
    away = rng.normal(size=(400, 3))
    away *= 10 ** rng.uniform(-1.5, 2, (400, 1)) / np.linalg.norm(away, axis=1, keepdims=True)
    points = positions[rng.integers(50, size=400)] + away
    ours = dipole_field(points, positions, rotations.as_matrix(), strengths)
    assert ours.shape == (400, 50, 3)
    for m in range(50):
        dipole = magpylib.misc.Dipole(position=positions[m], orientation=rotations[m], moment=(strengths[m], 0, 0))
        theirs = dipole.getH(points)
        error = np.linalg.norm(ours[:, m] - theirs, axis=1) / np.linalg.norm(theirs, axis=1)
        assert error.max() < 1e-12


def test_agrees_with_the_form_in_the_paper() -> None:
    rng = np.random.default_rng(2)
    R, p = Rotation.from_quat(rng.normal(size=4)).as_matrix(), rng.normal(size=(1000, 3)) * 20
    x, y, z = R.T @ p.T
    A = np.array([2 * x**2 - y**2 - z**2, 3 * x * y, 3 * x * z])
    expected = (2.5 / (4 * np.pi * np.linalg.norm(p, axis=1) ** 5) * (R @ A)).T
    error = np.linalg.norm(one(p, R, 2.5) - expected, axis=1) / np.linalg.norm(expected, axis=1)
    assert error.max() < 1e-12


@every("direction", [(1, 0, 0), (0, -1, 0), (0.6, 0, 0.8)])
@every("r", [1e-300, 1e-9, 0.00999])
def test_nearer_than_a_centimetre_is_a_centimetre(direction: tuple[float, ...], r: float) -> None:
    d = np.array(direction)
    np.testing.assert_allclose(one(d * r), one(d * 0.01), rtol=1e-12)
    assert not np.allclose(one(d * 0.011), one(d * 0.01))


def test_at_the_transmitter_it_is_a_centimetre_along_its_axis() -> None:
    R = Rotation.from_euler("ZYX", [0.5, 0.4, 0.3]).as_matrix()
    np.testing.assert_allclose(one([0, 0, 0], R), 2 / (4 * np.pi * 0.01**3) * R[:, 0], rtol=1e-12)
    np.testing.assert_allclose(one(np.zeros((2, 5, 3)), R)[1, 4], one([0, 0, 0], R), rtol=0)


@given(st.tuples(FULL, FULL, FULL), st.floats(0, 1e6))
def test_finite_everywhere(point: tuple[float, float, float], strength: float) -> None:
    assert np.isfinite(one(list(point), strength=strength)).all()


@given(st.tuples(NORMAL, NORMAL, NORMAL))
def test_never_stronger_than_on_the_axis_at_a_centimetre(point: tuple[float, float, float]) -> None:
    assert np.linalg.norm(one(list(point))) <= 2 / (4 * np.pi * 0.01**3) * (1 + 1e-12)


def test_any_leading_shape_is_the_same_points_one_by_one() -> None:
    rng = np.random.default_rng(3)
    points, positions = rng.normal(size=(2, 5, 3)), rng.normal(size=(4, 3))
    R, strengths = Rotation.from_quat(rng.normal(size=(4, 4))).as_matrix(), np.arange(1.0, 5)
    h = dipole_field(points, positions, R, strengths)
    assert h.shape == (2, 5, 4, 3)
    for at in np.ndindex(2, 5):
        for m in range(4):
            alone = dipole_field(points[at], positions[m : m + 1], R[m : m + 1], strengths[m : m + 1])
            np.testing.assert_array_equal(h[at][m], alone[0])


def test_transmitters_must_agree_in_number() -> None:
    with pytest.raises(ValueError, match=r"strengths: the shape \(1,\), expected \(2,\)"):
        Transmitters((1, 2), np.zeros((2, 3)), np.zeros((2, 3, 3)), np.ones(1))
