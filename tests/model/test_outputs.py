"""Noise and the integers: equations 3 to 8, their borders and the facts they imply."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable

import numpy as np
import pytest
import scipy
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from arva_hil.model.field import dipole_field
from arva_hil.model.receiver import Antennas, Zone, outputs
from arva_hil.model.receiver.paper import NoiseKind, NoiseSource, draw_noise, noise_bound, receive, rounded
from tests.every import every

K = 1.542
ONE = (np.zeros((1, 3)), np.eye(3)[None], np.ones(1))  # a reference transmitter at the origin, facing north
ANY = st.floats(-1e300, 1e300)
LIMIT = np.nextafter(1, 0)


def strength_for(d: float) -> float:
    """The ‖h‖ that reads d metres."""
    return K / (4 * math.pi * d**3)


def out(h: list[float] | np.ndarray) -> tuple[int, int, int]:
    with np.errstate(divide="raise", over="raise", invalid="raise"):
        d, delta, zone = outputs(h, K)
    return int(d), int(delta), int(zone)


def facing(degrees: float, d: float) -> list[float]:
    """A field in the x–y plane that reads d metres."""
    a, h = math.radians(degrees), strength_for(d)
    return [h * math.cos(a), h * math.sin(a), 0]


OUT = (-1, -1, Zone.OUTER)


@every(
    "h, expected",
    [
        (facing(0, 10), (1000, 0, Zone.MID)),
        (facing(30, 10), (1000, 30, Zone.MID)),
        (facing(-30, 10), (1000, -30, Zone.MID)),
        (facing(150, 10), (1000, -30, Zone.MID)),  # the same line from behind
        (facing(210, 10), (1000, 30, Zone.MID)),
        # distance rounds half away from zero
        (facing(0, 4.00499999), (400, 0, Zone.MID)),
        (facing(0, 4.00500001), (401, 0, Zone.MID)),
        # so does direction
        (facing(45.499999, 10), (1000, 45, Zone.MID)),
        (facing(45.500001, 10), (1000, 46, Zone.MID)),
        (facing(-45.499999, 10), (1000, -45, Zone.MID)),
        (facing(-45.500001, 10), (1000, -46, Zone.MID)),
        (facing(-0.499999, 10), (1000, 0, Zone.MID)),
        (facing(-0.500001, 10), (1000, -1, Zone.MID)),
        # the interval is open
        (facing(89.4, 10), (1000, 89, Zone.MID)),
        (facing(89.6, 10), (1000, 89, Zone.MID)),
        (facing(90.4, 10), (1000, -89, Zone.MID)),
        (facing(-89.6, 10), (1000, -89, Zone.MID)),
        ([0.0, strength_for(10), 0], (1000, 89, Zone.MID)),
        ([-0.0, strength_for(10), 0], (1000, 89, Zone.MID)),
        ([0.0, -strength_for(10), 0], (1000, -89, Zone.MID)),
        # inner and mid
        (facing(30, 2.9999999), (300, 0, Zone.INNER)),
        (facing(30, 3.0000001), (300, 30, Zone.MID)),
        ([0, 0, strength_for(2.9999999)], (300, 0, Zone.INNER)),  # the third antenna alone
        ([0, 0, strength_for(3.0000001)], OUT),
        ([0, 0, 1e300], (0, 0, Zone.INNER)),
        (facing(30, 0.0049999), (0, 0, Zone.INNER)),
        (facing(30, 0.0050001), (1, 0, Zone.INNER)),
        ([*facing(30, 4)[:2], strength_for(2.5)], (248, 0, Zone.INNER)),
        ([*facing(30, 4)[:2], strength_for(4)], (400, 30, Zone.MID)),  # the third antenna does not count
        # mid and outer
        (facing(-30, 49.9999999), (5000, -30, Zone.MID)),
        (facing(-30, 50.0000001), OUT),
        ([*facing(30, 50.1)[:2], strength_for(10)], OUT),
        ([0, 0, 0], OUT),
        ([-0.0, -0.0, 0], OUT),
        ([5e-324, 0, 0], OUT),
        ([math.nan, 1, 1], OUT),
    ],
)
def test_table(h: list[float], expected: tuple[int, int, int]) -> None:
    assert out(h) == expected


@pytest.mark.parametrize(("d", "expected"), [(3.0, (300, 0, Zone.INNER)), (50.0, (5000, 0, Zone.MID))])
def test_what_lies_on_the_border_of_two_zones_belongs_to_the_nearer_one(
    d: float, expected: tuple[int, int, int]
) -> None:
    kappa_eq = 4 * math.pi  # a field of 1 reads 1 m, and no rounding is in the way
    h = np.array([1 / d**3, 0, 0])
    assert 1 / np.cbrt(h[0]) == d
    assert tuple(int(column) for column in outputs(h, kappa_eq)) == expected


def test_rounding_half_away_from_zero_is_exact() -> None:
    x = np.array([0.5, -0.5, 1.5, 2.5, -2.5, np.nextafter(0.5, 0), np.nextafter(2.5, 0), -0.2, 4999.5])
    assert rounded(x).tolist() == [1, -1, 2, 3, -3, 0, 2, 0, 5000]


@given(ANY, ANY, ANY)
def test_ranges(x: float, y: float, z: float) -> None:
    d, delta, zone = out([x, y, z])
    low, high, widest = {Zone.INNER: (0, 300, 0), Zone.MID: (300, 5000, 89), Zone.OUTER: (-1, -1, 1)}[zone]
    assert low <= d <= high
    assert abs(delta) <= widest


@every("zone", list(Zone))
def test_mirrored_left_and_right_only_the_sign_of_the_direction_changes(zone: Zone) -> None:
    rng = np.random.default_rng(1)
    h = rng.normal(size=(20_000, 3)) * strength_for(10 ** rng.uniform(0, 2, (20_000, 1)))
    h[::50, 0] = 0
    d, delta, zones = outputs(h, K)
    mirrored = outputs(h * [1, -1, 1], K)
    here = zones == zone
    assert here.sum() > 2000
    np.testing.assert_array_equal(mirrored[0][here], d[here])
    np.testing.assert_array_equal(mirrored[1][here], -delta[here] if zone == Zone.MID else delta[here])
    np.testing.assert_array_equal(mirrored[2][here], zones[here])


def test_any_leading_shape() -> None:
    h = np.random.default_rng(2).normal(size=(2, 5, 3)) * strength_for(20)
    d, delta, zone = outputs(h, K)
    assert d.shape == delta.shape == zone.shape == (2, 5)
    assert {a.dtype for a in (d, delta, zone)} == {np.dtype(np.int64)}
    for at in np.ndindex(2, 5):
        assert out(h[at]) == (d[at], delta[at], zone[at])


def test_the_antennas_weigh_the_noise_in_their_own_frame() -> None:
    rng = np.random.default_rng(3)
    R, h, w = (
        Rotation.from_quat(rng.normal(size=(5, 4))).as_matrix(),
        rng.normal(size=(5, 2, 3)),
        rng.normal(size=(5, 2, 3)),
    )
    got = receive(h, R, np.array([1.0, 0.8, 0.6]), w)
    for i, m in itertools.product(range(5), range(2)):
        expected = R[i].T @ h[i, m] + np.diag([1.0, 0.8, 0.6]) @ R[i].T @ w[i, m]
        np.testing.assert_allclose(got[i, m], expected, rtol=0, atol=1e-14)


def furthest(h_r: Callable[[float], np.ndarray]) -> float:
    """The largest true range with a reading, by bisection."""
    near, far = 3.5, 100.0
    while far - near > 1e-6:
        middle = (near + far) / 2
        near, far = (middle, far) if out(h_r(middle))[2] else (near, middle)
    return near


def on_axis(r: float) -> np.ndarray:
    return dipole_field([r, 0, 0], *ONE)[0]


def on_equator(r: float) -> np.ndarray:
    return dipole_field([0, r, 0], *ONE)[0]


def test_facts_without_noise() -> None:
    assert out(on_axis(40))[0] == pytest.approx(0.917 * 4000, abs=2)
    assert out(on_equator(40))[0] == pytest.approx(1.155 * 4000, abs=2)
    assert furthest(on_axis) == pytest.approx(54.5, abs=0.05)
    assert furthest(on_equator) == pytest.approx(43.3, abs=0.05)
    theta = np.linspace(0, 2 * np.pi, 10_001)[:-1]
    assert Antennas().kappa_eq == pytest.approx(np.sqrt(1 + 3 * np.cos(theta) ** 2).mean(), abs=7e-4)


def test_facts_with_the_noise_at_its_worst() -> None:
    a = Antennas()
    w = np.array([noise_bound(a.sensitivity, a.floor_range_m), 0, 0])
    q = np.array(a.sensitivity)
    assert furthest(lambda r: receive(on_axis(r), np.eye(3), q, w)) == pytest.approx(61.9, abs=0.05)


def test_no_pose_reads_further_than_62_metres() -> None:
    rng = np.random.default_rng(4)
    n, q = 50_000, np.array(Antennas().sensitivity)
    away, w = rng.normal(size=(2, n, 3))
    away *= rng.uniform(62, 90, (n, 1)) / np.linalg.norm(away, axis=1, keepdims=True)
    w *= noise_bound((1.0, 0.8, 0.6), 80) / np.linalg.norm(w, axis=1, keepdims=True)
    h_r = receive(dipole_field(away, *ONE), Rotation.from_quat(rng.normal(size=(n, 4))).as_matrix(), q, w[:, None])
    assert not outputs(h_r, K)[2].any()


def test_the_bound_is_a_transmitter_80_metres_away_on_the_most_sensitive_antenna() -> None:
    assert noise_bound((1.0, 0.8, 0.6), 80) == pytest.approx(np.linalg.norm(on_axis(80)), rel=1e-12)
    assert noise_bound((0.4, 0.5, 0.2), 80) == pytest.approx(2 * np.linalg.norm(on_axis(80)), rel=1e-12)


def magnitudes(kind: NoiseKind) -> scipy.stats.rv_continuous:
    return scipy.stats.uniform(0, 3) if kind == "uniform" else scipy.stats.halfnorm(0, 1)


@pytest.mark.parametrize("kind", ["uniform", "gaussian"])
def test_noise_is_bounded_and_uniform_in_direction(kind: NoiseKind) -> None:
    w = draw_noise(np.random.default_rng(5), 50_000, kind, 3.0)
    size = np.linalg.norm(w, axis=1)
    assert 2.99 < size.max() <= 3 * (1 + 1e-15)
    sphere = scipy.stats.uniform(-1, 2)
    for axis in (*np.eye(3), np.array([0.48, 0.64, 0.6])):  # uniform along any axis, by Archimedes
        assert scipy.stats.kstest(w @ axis / size, sphere.cdf).pvalue > 0.01
        for part in (size < np.median(size), size >= np.median(size)):
            assert scipy.stats.kstest((w @ axis / size)[part], sphere.cdf).pvalue > 0.01
    inside = size[size < 3 * (1 - 1e-12)]
    law = magnitudes(kind)
    assert scipy.stats.kstest(inside, lambda x: law.cdf(x) / law.cdf(3)).pvalue > 0.01
    assert 1 - inside.size / size.size == pytest.approx(law.sf(3), abs=5e-4)


@every("kind", ["uniform", "gaussian"])
@every("m", [0, 1, 4])
def test_noise_takes_three_doubles_each(kind: NoiseKind, m: int) -> None:
    ours, count = np.random.default_rng(6), np.random.default_rng(6)
    assert draw_noise(ours, m, kind, 1.0).shape == (m, 3)
    for _ in range(3 * m):
        count.random()
    assert ours.bit_generator.state == count.bit_generator.state


def test_noise_off_is_nothing_and_draws_nothing() -> None:
    ours = np.random.default_rng(7)
    assert draw_noise(ours, 4, "off", 1.0).tolist() == [[0.0] * 3] * 4
    assert ours.bit_generator.state == np.random.default_rng(7).bit_generator.state


@pytest.mark.parametrize("kind", ["uniform", "gaussian"])
def test_noise_from_the_ends_of_the_generator(kind: NoiseKind) -> None:
    class Ends:
        def random(self, shape: tuple[int, int]) -> np.ndarray:
            return np.array(list(itertools.product([0.0, LIMIT], repeat=3))).reshape(shape)

    with np.errstate(all="raise"):
        size = np.linalg.norm(draw_noise(Ends(), 8, kind, 1.0), axis=1)  # type: ignore[arg-type]
    assert size == pytest.approx([0, 1] * 4, abs=1e-15)


@every(
    "values, match",
    [
        ({"sensitivity": (1.0, 0.8, 0.0)}, "sensitivity"),
        ({"sensitivity": (1.1, 0.8, 0.6)}, "sensitivity"),
        ({"sensitivity": (1.0, 0.8)}, "sensitivity"),
        ({"noise": "pink"}, "noise 'pink': expected one of uniform, gaussian, off"),
    ],
)
def test_antennas_out_of_range(values: dict[str, object], match: str) -> None:
    with pytest.raises(ValueError, match=match):
        Antennas(**values)  # type: ignore[arg-type]


@pytest.mark.parametrize("name", ["kappa_eq", "floor_range_m"])
def test_antennas_take_any_finite_number_above_0(name: str) -> None:
    assert getattr(Antennas(**{name: 0.001}), name) == 0.001  # type: ignore[arg-type]
    for wrong in (0.0, -1.0, math.inf, math.nan):
        with pytest.raises(ValueError, match=f"{name} {wrong}: expected above 0"):
            Antennas(**{name: wrong})  # type: ignore[arg-type]


@every("kind", ["uniform", "gaussian", "off"])
def test_a_source_of_noise_gives_the_same_numbers_however_many_are_drawn_at_a_time(kind: NoiseKind) -> None:
    source, rng = NoiseSource(kind, 3.0, seed=9), np.random.Generator(np.random.PCG64(9))
    counts = [4, 4, 0, 90, 1, 63, 64, 65, 300, 7]
    drawn = [source.draw(m) if m % 2 else np.array(source.draw_few(m)).reshape(m, 3) for m in counts]
    assert [len(w) for w in drawn] == counts
    assert (np.concatenate(drawn) == draw_noise(rng, sum(counts), kind, 3.0)).all()
