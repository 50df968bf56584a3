"""Rotations against scipy, which orders quaternions (x, y, z, w)."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from arva_hil.model.field import rotation
from arva_hil.model.field.rotation import from_euler, to_euler, to_matrix
from tests.every import every

N = 10_000
ANGLE = st.floats(-10, 10)


def quaternions(seed: int, n: int = N) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(n, 4))  # any length


def scipy_of(q: np.ndarray) -> Rotation:
    return Rotation.from_quat(q[..., [1, 2, 3, 0]])


def test_matrices_agree_with_scipy() -> None:
    q = quaternions(1)
    np.testing.assert_allclose(to_matrix(q), scipy_of(q).as_matrix(), rtol=0, atol=1e-14)


def test_the_order_is_w_first_and_the_matrix_takes_body_to_world() -> None:
    east = from_euler(0, 0, np.pi / 2)  # heading east
    np.testing.assert_allclose(east, [np.sqrt(0.5), 0, 0, np.sqrt(0.5)], atol=1e-15)
    np.testing.assert_allclose(to_matrix(east) @ [1, 0, 0], [0, 1, 0], atol=1e-15)
    climb = from_euler(0, np.pi / 2, 0)  # nose up: x points up, against z down
    np.testing.assert_allclose(to_matrix(climb) @ [1, 0, 0], [0, 0, -1], atol=1e-15)
    right = from_euler(np.pi / 2, 0, 0)  # right wing down
    np.testing.assert_allclose(to_matrix(right) @ [0, 1, 0], [0, 0, 1], atol=1e-15)


def test_euler_angles_agree_with_scipy() -> None:
    rng = np.random.default_rng(2)
    euler = rng.uniform((-np.pi, -np.pi / 2, -np.pi), (np.pi, np.pi / 2, np.pi), (N, 3))
    scipy = Rotation.from_euler("ZYX", euler[:, ::-1])
    q = from_euler(*euler.T)
    np.testing.assert_allclose(to_matrix(q), scipy.as_matrix(), rtol=0, atol=1e-14)
    steep = np.cos(euler[:, 1]) < 1e-2  # where angles lose digits that the rotation does not
    np.testing.assert_allclose(to_euler(q)[~steep], euler[~steep], rtol=0, atol=1e-12)
    np.testing.assert_allclose(to_euler(to_matrix(q)), to_euler(q), rtol=0, atol=1e-15)


@given(ANGLE, st.sampled_from([-1, 1]), st.sampled_from([0, 1e-3, 1e-6, 1e-8, 1e-12, 1e-16]), ANGLE)
def test_euler_angles_round_trip_up_to_gimbal_lock(roll: float, sign: int, off: float, yaw: float) -> None:
    m = to_matrix(from_euler(roll, sign * (np.pi / 2 - off), yaw))
    np.testing.assert_allclose(to_matrix(from_euler(*to_euler(m))), m, rtol=0, atol=1e-14)


def unit(q: np.ndarray) -> list[list[float]]:
    return (q / np.linalg.norm(q, axis=1, keepdims=True)).tolist()


def test_multiply_agrees_with_scipy() -> None:
    a, b = quaternions(3, 2000), quaternions(4, 2000)
    got = [rotation.multiply(one, other) for one, other in zip(unit(a), unit(b), strict=True)]
    np.testing.assert_allclose(to_matrix(got), (scipy_of(a) * scipy_of(b)).as_matrix(), rtol=0, atol=1e-14)
    np.testing.assert_allclose(np.linalg.norm(got, axis=1), 1, rtol=1e-14)


def test_slerp_agrees_with_scipy_the_shortest_way() -> None:
    q0, q1, u = quaternions(6, 2000), quaternions(7, 2000), np.random.default_rng(8).random(2000)
    r0, r1 = scipy_of(q0), scipy_of(q1)
    turn = (r0.inv() * r1).as_rotvec()  # never more than half a turn
    assert np.linalg.norm(turn, axis=1).max() > 3
    expected = (r0 * Rotation.from_rotvec(u[:, None] * turn)).as_matrix()
    got = [rotation.slerp(tuple(a), tuple(b), part) for a, b, part in zip(unit(q0), unit(q1), u.tolist(), strict=True)]
    np.testing.assert_allclose(to_matrix(got), expected, rtol=0, atol=1e-12)


@given(st.floats(0, 1), st.sampled_from([1, -1]), st.sampled_from([0, 1e-300, 1e-16, 1e-9, 1e-7]))
def test_slerp_between_equal_and_nearly_equal(u: float, sign: int, turn: float) -> None:
    q0 = rotation.from_angles(0.3, -0.2, 2.0)

    def turned(by: float) -> rotation.Quaternion:
        return rotation.multiply(q0, (math.cos(by / 2), math.sin(by / 2), 0.0, 0.0))

    w, x, y, z = turned(turn)
    got = rotation.slerp(q0, (sign * w, sign * x, sign * y, sign * z), u)
    np.testing.assert_allclose(got, turned(u * turn), rtol=0, atol=1e-15)


def test_slerp_across_half_a_turn_is_a_quarter_turn_from_both() -> None:
    middle = rotation.slerp((1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0), 0.5)
    assert abs(middle[0]) == pytest.approx(np.sqrt(0.5), abs=1e-15)
    assert abs(middle[3]) == pytest.approx(np.sqrt(0.5), abs=1e-15)


def test_leading_shapes() -> None:
    q = quaternions(9, 6).reshape(2, 3, 4)
    assert (to_matrix(tuple(map(tuple, quaternions(9, 4).tolist()))) == to_matrix(quaternions(9, 4))).all()
    assert to_matrix(q).shape == (2, 3, 3, 3)
    assert to_euler(q).shape == (2, 3, 3)
    assert from_euler(0.0, np.zeros((2, 1)), np.zeros(3)).shape == (2, 3, 4)


@every("q", [[0, 0, 0, 0], [np.nan, 0, 0, 1], [np.inf, 0, 0, 0]])
def test_no_rotation_is_an_error(q: list[float]) -> None:
    with pytest.raises(ValueError, match="no rotation"):
        to_matrix(q)


def test_a_single_rotation_in_plain_floats_is_as_in_arrays() -> None:
    many = np.random.default_rng(5).normal(size=(200, 4))
    for one, matrix, angles in zip(many, to_matrix(many), to_euler(many), strict=True):
        assert (to_matrix(one) == matrix).all()
        assert (to_matrix(tuple(one.tolist())) == matrix).all()
        assert rotation.heading(one.tolist()) == pytest.approx(angles[2], abs=1e-12)


@every("q", [(0.0, 0.0, 0.0, 0.0), (math.nan, 0.0, 0.0, 1.0), (math.inf, 0.0, 0.0, 0.0)])
def test_no_single_rotation_is_an_error_too(q: tuple[float, float, float, float]) -> None:
    with pytest.raises(ValueError, match="no rotation"):
        rotation.matrix(*q)
