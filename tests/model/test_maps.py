"""Readings at many poses at once are those of a receiver that looks at one after another."""

from __future__ import annotations

import dataclasses
import tracemalloc
from itertools import product
from operator import sub

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from arva_hil.model.field import Transmitters, dipole_field
from arva_hil.model.field.dipole import one_field
from arva_hil.model.field.medium import Medium
from arva_hil.model.receiver import Antennas, Look, PaperReceiver, Pose, Zone, maps
from arva_hil.model.receiver.maps import readings
from tests.every import every

N = 5000


def transmitters(m: int) -> Transmitters:
    rng = np.random.default_rng(m)
    places = rng.uniform((-40, -40, 0), (40, 40, 2), (m, 3))
    return Transmitters(tuple(range(m)), places, Rotation.random(m, random_state=m).as_matrix(), rng.uniform(0.5, 2, m))


def poses(n: int, there: Transmitters) -> tuple[np.ndarray, np.ndarray]:
    """Anywhere, near some transmitter, right at it, and some in turn where none is heard."""
    rng = np.random.default_rng(7)
    places = rng.uniform((-60, -60, -5), (60, 60, 0), (n, 3))
    places[n // 2 : n * 3 // 4, 0] += 1000
    places[:100] = there.positions[0] + rng.normal(0, 2, (100, 3))
    places[100] = there.positions[0]
    places[101] = there.positions[0] + 1e-150
    places[102] = 1e150
    places[103] = 1e200
    return places, Rotation.random(n, random_state=8).as_matrix()


@pytest.mark.parametrize(
    "antennas",
    [Antennas(), Antennas(noise="off"), Antennas(noise="gaussian"), Antennas(floor_range_m=20), Antennas((0.5, 1, 1))],
    ids=["uniform", "off", "gaussian", "loud", "sensitive"],
)
@pytest.mark.parametrize("m", [1, 4])
def test_the_integers_are_those_of_one_look_after_another(
    antennas: Antennas, m: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(maps, "_PAIRS", 1000)  # in several blocks
    there, n = transmitters(m), 800
    places, turns = poses(n, there)
    one = PaperReceiver(antennas, channels=m, seed=3)
    every = readings(places, turns, there, antennas, seed=3)
    assert set(every.zone.ravel().tolist()) == set(Zone)
    for i in range(n):
        one.look(Look(float(i), Pose(places[i], turns[i]), there))
        shown = {(c.id, c.zone, c.d_cm, c.delta_deg) for c in one.show(i).channels if c.id is not None}
        columns = (column[i].tolist() for column in (every.zone, every.d_cm, every.delta_deg))
        assert {row for row in zip(there.ids, *columns, strict=True) if row[1]} == shown
    silent = every.zone == Zone.OUTER
    assert (every.d_cm[silent] == -1).all()
    assert (every.delta_deg[silent] == -1).all()
    assert not every.delta_deg[every.zone == Zone.INNER].any()


def test_what_only_the_third_antenna_hears_is_in_the_inner_zone() -> None:
    north = Transmitters((1,), [[0, 0, 0]], [np.eye(3)], [1.0])
    upright = [[0, 0, 1], [0, 1, 0], [-1, 0, 0]]  # its z looks north, along the dipole
    every = readings([[2, 0, 0], [10, 0, 0]], [upright] * 2, north, Antennas(noise="off"))
    assert every.zone.tolist() == [[Zone.INNER], [Zone.OUTER]]


def test_where_noise_may_hide_everything_the_integers_are_those_of_one_look_too() -> None:
    there, antennas = transmitters(2), Antennas(floor_range_m=2)
    places, turns = poses(200, there)
    one = PaperReceiver(antennas, channels=2, seed=3)
    every = readings(places, turns, there, antennas, seed=3)
    for i in range(200):
        one.look(Look(float(i), Pose(places[i], turns[i]), there))
        shown = {c.id: (c.d_cm, c.delta_deg, c.zone) for c in one.show(i).channels}
        assert [shown[id_] for id_ in there.ids] == [tuple(column[i, k] for column in every) for k in range(2)]


def test_several_threads_give_the_same_readings() -> None:
    there = transmitters(4)
    places, turns = poses(20_000, there)
    one, three = (readings(places, turns, there, threads=threads) for threads in (1, 3))
    assert all((a == b).all() for a, b in zip(one, three, strict=True))


@every("n, m", [(0, 4), (1, 1), (3, 0), (N, 3)])
def test_any_number_of_poses_and_transmitters(n: int, m: int) -> None:
    there = transmitters(m)
    every = readings(np.zeros((n, 3)), np.tile(np.eye(3), (n, 1, 1)), there)
    assert [column.shape for column in every] == [(n, m)] * 3


def test_wrong_shapes_and_another_medium_are_refused() -> None:
    there = transmitters(2)
    with pytest.raises(ValueError, match=r"rotations: the shape \(3, 3\)"):
        readings([[0, 0, 0]], np.eye(3), there)
    with pytest.raises(ValueError, match="positions"):
        readings([0, 0], [np.eye(3)], there)
    with pytest.raises(ValueError, match="another medium"):
        readings([[0, 0, 0]], [np.eye(3)], dataclasses.replace(there, medium=Medium("full")))


def test_the_field_at_many_points_is_that_at_each_of_them() -> None:
    there = transmitters(3)
    points, _ = poses(N, there)
    many = dipole_field(points, there.positions, there.rotations, there.strengths)
    places, moments = np.split(np.array(there.dipoles), 2, axis=1)
    pairs = product(points[:300].tolist(), zip(places.tolist(), moments.tolist(), strict=True))
    each = np.array([one_field(*map(sub, point, place), *moment)[1:] for point, (place, moment) in pairs])
    size = np.linalg.norm(each, axis=-1, keepdims=True)
    assert (np.abs(many[:300].reshape(-1, 3) - each) <= 1e-14 * size).all()
    shaped = dipole_field(points.reshape(50, -1, 3), there.positions, there.rotations, there.strengths)
    assert (shaped == many.reshape(50, -1, 3, 3)).all()


def test_a_large_map_needs_little_more_memory_than_its_result() -> None:
    there, points = transmitters(4), np.random.default_rng(1).uniform(-50, 50, (100_000, 3))
    tracemalloc.start()
    field = dipole_field(points, there.positions, there.rotations, there.strengths)
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert most < 1.5 * field.nbytes
