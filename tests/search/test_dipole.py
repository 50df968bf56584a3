"""The fit of a dipole: against magpylib, finite differences, and readings made up by the receiver's own model."""

from __future__ import annotations

import math

import magpylib
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from arva_hil.model.field import Transmitters
from arva_hil.model.receiver import Antennas, Zone
from arva_hil.search.strategies.dipole import MOST, DipoleReadings, Reading, evaluate, likely_pose_error, refine, seeds
from tests.paper_receiver import Receiver

KAPPA_EQ = 1.542


def readings(rng: np.random.Generator, n: int, inner: bool = False) -> DipoleReadings:
    """Anything, heard by a receiver at any attitude."""
    o = DipoleReadings()
    for at, R in zip(rng.uniform(-20, 20, (n, 3)), Rotation.random(n, rng).as_matrix(), strict=True):
        o.add(at, R, rng.uniform(3, 40), rng.uniform(-1.5, 1.5), inner)
    return o


def hypotheses(rng: np.random.Generator, k: int) -> np.ndarray:
    place, moment = rng.uniform((30, -20, -20), (70, 20, 20), (k, 3)), rng.normal(size=(k, 3))
    return np.concatenate([place, moment, np.zeros((k, 1))], axis=1)


def buried(seed: int) -> tuple[Receiver, np.ndarray, np.ndarray]:
    """A reference transmitter at any attitude; also the hypothesis that is true, and the way of a vehicle past it."""
    rng = np.random.default_rng(seed)
    place, R = np.array([*rng.uniform(-5, 5, 2), rng.uniform(0, 1.5)]), Rotation.random(rng=rng).as_matrix()
    receiver = Receiver(Transmitters((1,), place[None], R[None], np.ones(1)), Antennas(), seed=seed)
    azimuth, across = rng.uniform(0, 2 * math.pi), rng.uniform(1, 3)
    along = np.linspace(-20, 8, 29)
    c, s = math.cos(azimuth), math.sin(azimuth)
    way = np.stack([place[0] + along * c - across * s, place[1] + along * s + across * c, 0 * along - 1], axis=1)
    return receiver, np.array([*place, *R[:, 0] / KAPPA_EQ, 0.0]), way


def listen(receiver: Receiver, way: np.ndarray, pose_error: float = 0.0, seed: int = 0) -> DipoleReadings:
    rng = np.random.default_rng(seed)
    o = DipoleReadings()
    for at in way:
        slot = receiver.read(at, np.eye(3)).channels[0]
        told = at + rng.normal(scale=pose_error, size=3) if pose_error else at
        o.add(told, np.eye(3), slot.d_cm / 100, math.radians(slot.delta_deg), slot.zone == Zone.INNER)
    return o


@pytest.mark.parametrize("inner", [False, True])
def test_the_field_is_the_one_of_magpylib(inner: bool) -> None:
    rng = np.random.default_rng(1)
    x, n = hypotheses(rng, 4), 30
    at, R = rng.uniform(-20, 20, (n, 3)), Rotation.random(n, rng)
    o = DipoleReadings()
    for place, matrix in zip(at, R.as_matrix(), strict=True):
        o.add(place, matrix, 10.0, 0.0, inner)
    error = evaluate(x, o, 0.1).error.reshape(4, n + 1, 2)[:, 1:]
    for k in range(4):
        h = R.inv().apply(magpylib.misc.Dipole(x[k, :3], moment=x[k, 3:6]).getH(at)) * 4 * math.pi
        size = np.linalg.norm(h, axis=1) if inner else np.hypot(h[:, 0], h[:, 1])
        assert error[k, :, 0] == pytest.approx(np.log(size) + 3 * math.log(10), abs=1e-9)
        angle = np.zeros(n) if inner else np.arctan(h[:, 1] / h[:, 0])
        assert np.sin(error[k, :, 1] - angle) == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize("inner", [False, True])
def test_its_derivatives_are_those_of_its_errors(inner: bool) -> None:
    rng = np.random.default_rng(2)
    o, x = readings(rng, 20, inner), hypotheses(rng, 3)
    now, step = evaluate(x, o, 0.1), 1e-6
    for i in range(7):
        aside = np.zeros(7)
        aside[i] = step
        difference = evaluate(x + aside, o, 0.1).error - evaluate(x - aside, o, 0.1).error
        difference = np.remainder(difference + math.pi / 2, math.pi) - math.pi / 2  # over the edge at ±90°
        gradient = np.sum(now.weight * now.error * difference, axis=1) / (2 * step)
        assert now.gradient[:, i] == pytest.approx(gradient, rel=1e-4, abs=1e-4)


def test_the_moment_and_its_opposite_sound_alike() -> None:
    rng = np.random.default_rng(3)
    o, x = readings(rng, 20), hypotheses(rng, 5)
    assert evaluate(x, o, 0.1).cost == pytest.approx(evaluate(x * [1, 1, 1, -1, -1, -1, 1], o, 0.1).cost)


def test_a_receiver_that_hears_delta_turned_round_is_the_same() -> None:
    x = hypotheses(np.random.default_rng(4), 3)
    costs = []
    for delta in (0.4, 0.4 - math.pi):
        o = DipoleReadings()
        o.add((3.0, 2.0, -1.0), np.eye(3), 12.0, delta, False)
        costs.append(evaluate(x, o, 0.1).cost)
    assert costs[0] == pytest.approx(costs[1])


def test_finds_the_place_and_says_how_well() -> None:
    normalised, errors = [], []
    for seed in range(100):
        receiver, truth, way = buried(seed)
        o = listen(receiver, way, pose_error=0.1, seed=seed)
        fit, _ = refine(truth[None], np.full(1, 1e-3), o, 0.1, 10)
        off = fit.x[0, :2] - truth[:2]
        covariance = np.linalg.inv(fit.information[0])[:2, :2]
        normalised.append(off @ np.linalg.solve(covariance, off))
        errors.append(math.hypot(*off))
    assert np.median(errors) < 0.15
    assert 0.5 < np.median(normalised) < 2.5  # 1.39 for two dimensions
    assert np.mean(np.array(normalised) < 9.2) > 0.9  # 0.99


@pytest.mark.parametrize("seed", range(6))
def test_from_the_seeds_it_comes_to_the_truth(seed: int) -> None:
    receiver, truth, way = buried(seed)
    o = listen(receiver, way)
    x = seeds(way[0], *[heard(receiver, way[0])[i] for i in (1, 0)])
    fit, _ = refine(x, np.full(len(x), 1e-2), o, 0.05, 20)
    assert math.dist(fit.x[np.argmin(fit.cost), :2], truth[:2]) < 0.1


def heard(receiver: Receiver, at: np.ndarray) -> tuple[float, float]:
    """d and δ in metres and radians."""
    slot = receiver.read(at, np.eye(3)).channels[0]
    return slot.d_cm / 100, math.radians(slot.delta_deg)


@given(st.floats(0, 6.28), st.floats(4, 45), st.floats(-4, -0.5))
def test_seeds_say_what_was_heard(bearing: float, d: float, down: float) -> None:
    at = (7.0, -3.0, down)
    o = DipoleReadings()
    o.add(at, np.eye(3), d, bearing, False)
    x = seeds(at, bearing, d)
    fit = evaluate(x, o, 0.1)
    assert np.abs(fit.error[:, 2:]).max() < 1e-6
    assert np.linalg.norm(x[:, 3:6], axis=1) == pytest.approx(1 / KAPPA_EQ)
    assert np.linalg.matrix_rank(x[:, :2] - at[:2]) == 2


@pytest.mark.parametrize("wrong", [0.03, 0.3])
def test_hears_how_wrong_its_poses_are(wrong: float) -> None:
    guesses = []
    for seed in range(20):
        receiver, truth, way = buried(seed)
        o = listen(receiver, way, wrong, seed)
        fit, _ = refine(truth[None], np.full(1, 1e-3), o, wrong, 10)
        guesses.append(likely_pose_error(fit, 0, o))
    assert wrong / 2 < np.median(guesses) < 2 * wrong


def test_silence_speaks_against_a_transmitter_near_by_and_for_nothing() -> None:
    o = DipoleReadings()
    far, near = np.array([[200.0, 0, 0.5, 0.65, 0, 0, 0]]), np.array([[12.0, 0, 0.5, 0.65, 0, 0, 0]])
    before = [evaluate(x, o, 0.1).cost[0] for x in (far, near)]
    o.add((0.0, 0.0, -1.0), np.eye(3), -0.01, 0.0, False)
    assert evaluate(far, o, 0.1).cost[0] == pytest.approx(before[0])
    assert evaluate(near, o, 0.1).cost[0] > before[1] + 3


def test_one_reading_that_is_nonsense_moves_little() -> None:
    receiver, truth, way = buried(5)
    o = listen(receiver, way)
    o.add(way[10], np.eye(3), 4.0, 1.2, False)
    fit, _ = refine(truth[None], np.full(1, 1e-3), o, 0.05, 10)
    assert math.dist(fit.x[0, :2], truth[:2]) < 0.2


def test_keeps_the_strongest_readings_of_too_many() -> None:
    o = DipoleReadings()
    for d in [*np.linspace(49, 4, 100), -0.01]:
        o.add((0.0, 0.0, -1.0), np.eye(3), d, 0.0, False)
    assert len(o.said) < 101
    silence, *kept = np.exp(-np.sort(o.said[1:].real) / 3)
    assert silence == pytest.approx(50)
    assert min(kept) == pytest.approx(4)
    assert max(kept) < 40
    for _ in range(100):
        o.add((0.0, 0.0, -1.0), np.eye(3), 0.5, 0.0, True)
    assert o.said[0] == 0  # still what is known beforehand


@given(
    st.lists(
        st.tuples(*[st.floats(-1e6, 1e6)] * 3, st.floats(-1, 700), st.floats(-2, 2), st.booleans()),
        min_size=1,
        max_size=6,
    )
)
def test_whatever_it_hears_it_stays_finite(said: list[tuple[float, float, float, float, float, bool]]) -> None:
    o = DipoleReadings()
    for north, east, down, d, delta, inner in said:
        o.add((north, east, down), np.eye(3), d, delta, inner)
    fit, damping = refine(seeds(said[0][:3], 0.3, 20.0), np.full(24, 1e-2), o, 0.1, 3)
    for part in (*fit, damping):
        assert np.isfinite(part).all()


@pytest.mark.parametrize("count", [0, 1, 63, 100])
@pytest.mark.parametrize("gains", [(1.0, 1.0), (0.5, 1.0)])
def test_readings_added_together_are_those_added_one_by_one(count: int, gains: tuple[float, float]) -> None:
    """With more than there is room for, the weakest are left out; some are silent, or above unknown ground."""
    rng = np.random.default_rng(5)
    turns, every = Rotation.random(100, rng).as_matrix(), list[Reading]()
    for k in range(count):
        d, ground = (-1.0 if k % 7 == 3 else rng.uniform(1, 60)), (None if k % 3 else rng.uniform(-2, 2))
        every.append((rng.uniform(-20, 20, 3).tolist(), turns[k], d, rng.uniform(-1, 1), k % 5 == 0, 0.5 * k, ground))
    one_by_one, together = DipoleReadings(gains), DipoleReadings(gains)
    for reading in every:
        one_by_one.add(*reading)
    together.add_all(every)
    x = hypotheses(rng, 3)
    assert len(together.said) == min(count + 1, MOST)
    assert (together.time_s == one_by_one.time_s).all()
    assert (together.level(x) == one_by_one.level(x)).all()
    for a, b in zip(evaluate(x, together, 0.1), evaluate(x, one_by_one, 0.1), strict=True):
        assert (a == b).all()


@pytest.mark.parametrize("degrees", [-10, 0, 10])
def test_a_receiver_that_is_turned_is_noticed(degrees: int) -> None:
    """By a compass or a mount that is off: the angle is a part of the fit, and the place is right."""
    off = []
    for seed in range(6):
        receiver, truth, way = buried(seed)
        o, turned = DipoleReadings(), Rotation.from_euler("z", degrees, degrees=True).as_matrix()
        for at in way:
            slot = receiver.read(at, turned).channels[0]
            o.add(at, np.eye(3), slot.d_cm / 100, math.radians(slot.delta_deg), slot.zone == Zone.INNER)
        fit, _ = refine(truth[None], np.full(1, 1e-3), o, 0.05, 20)
        assert math.dist(fit.x[0, :2], truth[:2]) < 0.15
        off.append(math.degrees(fit.x[0, 6]))
    assert np.median(off) == pytest.approx(degrees, abs=1.5)
