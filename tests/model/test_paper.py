"""The receiver end to end: against magpylib, scipy and plain arithmetic; its slots; its memory."""

from __future__ import annotations

import math
from collections import Counter
from decimal import ROUND_HALF_UP, Decimal

import magpylib
import numpy as np
import pytest
import scipy
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from arva_hil.model.field import Mount, Transmitters
from arva_hil.model.receiver import Antennas, ChannelReading, PaperReceiver, Reading, Zone
from arva_hil.model.receiver.paper import FEW, NoiseKind, NoiseSource, noise_bound
from tests.every import every
from tests.paper_receiver import Receiver

QUIET = Antennas(noise="off")
LEVEL = (1.0, 0.0, 0.0, 0.0)
COORDINATE = st.floats(-40, 40)
TURN = st.tuples(*[st.floats(-math.pi, math.pi)] * 3)


def wxyz(rotation: Rotation) -> np.ndarray:
    return rotation.as_quat()[..., [3, 0, 1, 2]]


def transmitters(*where: tuple[float, float, float], ids: tuple[int, ...] = ()) -> Transmitters:
    """Reference transmitters that face north, numbered from 1."""
    m = len(where)
    positions = np.array(where, float).reshape(m, 3)
    return Transmitters(ids or tuple(range(1, m + 1)), positions, np.tile(np.eye(3), (m, 1, 1)), np.ones(m))


def random_transmitters(rng: np.random.Generator, m: int) -> tuple[Transmitters, Rotation]:
    rotations = Rotation.from_quat(rng.normal(size=(m, 4)))
    ids = tuple(rng.permutation(m).tolist())
    positions, strengths = rng.uniform(-15, 15, (m, 3)), rng.uniform(0.5, 3, m)
    return Transmitters(ids, positions, rotations.as_matrix(), strengths), rotations


def here(receiver: Receiver, position: tuple[float, float, float] = (0, 0, 0)) -> Reading:
    return receiver.read(*receiver.pose(np.array(position, float), LEVEL))


def bits(reading: Reading) -> list[tuple[int | None, int, int, int]]:
    return [(c.id, c.zone, c.d_cm, c.delta_deg) for c in reading.channels]


def rounded(x: float) -> tuple[int, bool]:
    """Half away from zero, and whether it is within 1e-9 of going the other way."""
    return int(Decimal(x).quantize(Decimal(0), ROUND_HALF_UP)), abs(abs(x) % 1 - 0.5) < 1e-9


def oracle_outputs(h: list[float], kappa_eq: float) -> tuple[int, int, Zone, bool]:
    """(d, δ, zone, too near an edge to tell)."""
    full = (kappa_eq / (4 * math.pi * math.dist(h, (0, 0, 0)))) ** (1 / 3)
    flat = (kappa_eq / (4 * math.pi * math.sqrt(h[0] ** 2 + h[1] ** 2))) ** (1 / 3)
    edge = abs(full - 3) < 1e-9 or abs(flat - 50) < 1e-9
    if full <= 3:
        d, tie = rounded(100 * full)
        return d, 0, Zone.INNER, edge or tie
    if flat > 50:
        return -1, -1, Zone.OUTER, edge
    (d, tie), (delta, tie2) = rounded(100 * flat), rounded(math.degrees(math.atan(h[1] / h[0])))
    return d, max(-89, min(89, delta)), Zone.MID, edge or tie or tie2


def oracle_noise(rng: np.random.Generator, kind: NoiseKind, bound: float) -> tuple[list[float], float]:
    z, azimuth, u = 2 * rng.random() - 1, 2 * math.pi * rng.random(), rng.random()
    size = bound * (u if kind == "uniform" else min(1.0, float(scipy.stats.halfnorm.ppf(u)) / 3))
    across = math.sqrt(1 - z * z)
    return [size * across * math.cos(azimuth), size * across * math.sin(azimuth), size * z], size


@pytest.mark.parametrize(("kind", "floor"), [("gaussian", 45.0), ("uniform", 78.0)])
def test_the_whole_chain_agrees_with_an_independent_one(kind: NoiseKind, floor: float) -> None:
    m, frames, channels = 5, 500, 4
    rng = np.random.default_rng(1)
    t, R_t = random_transmitters(rng, m)
    antennas = Antennas(sensitivity=(0.9, 0.7, 0.5), kappa_eq=1.6, floor_range_m=floor, noise=kind)
    mount, R_mount = np.array([0.3, -0.1, 0.2]), Rotation.from_quat(rng.normal(size=4))
    receiver = Receiver(t, antennas, channels, (0, 0), seed=42, mount=Mount(mount, wxyz(R_mount)))

    away = rng.normal(size=(frames, 3))
    away *= 10 ** rng.uniform(-1.3, 1.9, (frames, 1)) / np.linalg.norm(away, axis=1, keepdims=True)
    p, R_body = t.positions[rng.integers(m, size=frames)] + away, Rotation.from_quat(rng.normal(size=(frames, 4)))
    q = wxyz(R_body)

    p_r, R_r = p + R_body.apply(mount), R_body * R_mount
    h_r = np.empty((frames, m, 3))
    for i in range(m):
        dipole = magpylib.misc.Dipole(t.positions[i], R_t[i], moment=(t.strengths[i], 0, 0))
        h_r[:, i] = R_r.inv().apply(dipole.getH(p_r))

    stream = np.random.Generator(np.random.PCG64(42))
    bound, specified = (1 / (2 * math.pi * 0.9 * r**3) for r in (floor, 80.0))
    unwind = R_r.as_matrix()
    zones: Counter[Zone] = Counter()
    edges = interfered = overfull = 0
    for k in range(frames):
        heard, edge, interference = [], False, False
        away_m = [math.dist(p_r[k], position) for position in t.positions]
        for i in range(m):
            w, size = oracle_noise(stream, kind, bound)
            interference |= size > specified * (1 + 1e-12)
            h = h_r[k, i] + np.array(antennas.sensitivity) * (unwind[k].T @ w)
            d, delta, zone, near = oracle_outputs(h.tolist(), 1.6)
            zones[zone] += 1
            edge |= near
            if zone:
                heard.append((d, t.ids[i], delta, zone, away_m[i]))
        got = receiver.read(*receiver.pose(p[k], q[k]))
        if edge:
            edges += 1
            continue
        silent = sorted(set(away_m) - {far for *_, far in heard})
        empty = [(0, None, 0, Zone.OUTER, far) for far in [*silent, *[None] * channels]]
        expected = (sorted(heard) + empty)[:channels]
        assert [(c.d_cm, c.id, c.delta_deg, c.zone) for c in got.channels] == [e[:4] for e in expected]
        for channel, (*_, true_range) in zip(got.channels, expected, strict=True):
            assert channel.true_range_m == (true_range and pytest.approx(true_range, rel=1e-12))
        assert got.more_heard == (len(heard) > channels)
        assert got.interference == interference
        interfered += interference
        overfull += got.more_heard
    assert edges <= 3
    assert min(zones[z] for z in Zone) > 125, zones
    assert overfull > 12
    assert (interfered > 0) == (floor < 80)


def test_turning_the_whole_world_changes_nothing() -> None:
    rng = np.random.default_rng(2)
    differ = total = 0
    for _ in range(4):
        t, R_t = random_transmitters(rng, 5)
        G = Rotation.from_quat(rng.normal(size=4))
        turned = Transmitters(t.ids, G.apply(t.positions), (G * R_t).as_matrix(), t.strengths)
        ours, theirs = Receiver(t, QUIET, 5), Receiver(turned, QUIET, 5)
        p, R = rng.normal(size=(500, 3)) * 15, Rotation.from_quat(rng.normal(size=(500, 4)))
        poses, turned_poses = ours.pose(p, wxyz(R)), theirs.pose(G.apply(p), wxyz(G * R))
        for pose, turned_pose in zip(zip(*poses, strict=True), zip(*turned_poses, strict=True), strict=True):
            a, b = ours.read(*pose), theirs.read(*turned_pose)
            total += len(a.channels)
            differ += sum(x != y for x, y in zip(bits(a), bits(b), strict=True))
    assert total == 10_000
    assert differ <= 3  # rounding edges


@given(COORDINATE, COORDINATE, COORDINATE, TURN, TURN)
def test_a_transmitter_turned_about_reads_the_same(
    x: float, y: float, z: float, turn_t: tuple[float, ...], turn_r: tuple[float, ...]
) -> None:
    R_t, R_r = (Rotation.from_euler("ZYX", turn).as_matrix() for turn in (turn_t, turn_r))
    p = np.array([x, y, z])
    readings = []
    for flip in ([1, 1, 1], [-1, -1, 1]):  # half a turn about the transmitter's z: −h
        t = Transmitters((1,), np.zeros((1, 3)), (R_t * flip)[None], np.ones(1))
        readings.append(Receiver(t, QUIET).read(p, R_r))
    assume(abs(readings[0].channels[0].delta_deg) < 89)  # at h_x = 0 the sign of h_y is all there is
    assume(np.linalg.norm(p) > 0.01)
    assert readings[0] == readings[1]


@given(COORDINATE, COORDINATE, COORDINATE, TURN, TURN)
def test_a_mirrored_world_reads_mirrored(
    x: float, y: float, z: float, turn_t: tuple[float, ...], turn_r: tuple[float, ...]
) -> None:
    S = np.diag([1.0, -1.0, 1.0])
    R_t, R_r = (Rotation.from_euler("ZYX", turn).as_matrix() for turn in (turn_t, turn_r))
    p = np.array([x, y, z])
    plain, mirrored = (
        Receiver(Transmitters((1,), np.zeros((1, 3)), (s @ R_t @ s)[None], np.ones(1)), QUIET)
        .read(s @ p, s @ R_r @ s)
        .channels[0]
        for s in (np.eye(3), S)
    )
    assert (mirrored.d_cm, mirrored.zone) == (plain.d_cm, plain.zone)
    assert mirrored.delta_deg == (-plain.delta_deg if plain.zone == Zone.MID else plain.delta_deg)


@given(st.tuples(*[st.floats(-1e150, 1e150)] * 3), st.sampled_from(["uniform", "gaussian", "off"]))
def test_any_pose_reads(position: tuple[float, float, float], kind: NoiseKind) -> None:
    t = transmitters((0, 0, 0), (5e-324, 0, 0), (1e150, 0, 0), (10, 0, 0))
    with np.errstate(divide="raise", over="raise", invalid="raise"):
        got = here(Receiver(t, Antennas(noise=kind)), position)
    assert len(got.channels) == 4
    assert all(-1 <= c.d_cm <= 5000 and abs(c.delta_deg) <= 89 for c in got.channels)


def test_on_top_of_a_transmitter_reads_next_to_nothing() -> None:
    channel = here(Receiver(transmitters((1, 2, 3)), QUIET), (1, 2, 3)).channels[0]
    assert channel == ChannelReading(1, Zone.INNER, 1, 0, 0.0)  # 0.917 cm


def test_slots_are_sorted_by_the_integers_and_ties_by_id() -> None:
    t = transmitters((9, 0, 0), (20, 0, 0), (-9, 0, 0), (9.001, 0, 0), (4, 0, 0), ids=(7, 1, 2, 3, 9))
    got = here(Receiver(t, QUIET, 5))
    assert [(c.d_cm, c.id) for c in got.channels] == [(367, 9), (825, 2), (825, 3), (825, 7), (1834, 1)]
    assert [c.true_range_m for c in got.channels] == [4, 9, 9.001, 9, 20]


@every("channels, more", [(1, True), (2, True), (3, False), (4, False), (16, False)])
def test_more_heard_than_slots(channels: int, more: bool) -> None:
    got = here(Receiver(transmitters((30, 0, 0), (10, 0, 0), (90, 0, 0), (20, 0, 0)), QUIET, channels))
    assert [c.id for c in got.channels] == ([2, 4, 1] + [None] * 13)[:channels]
    assert got.more_heard is more


@every("no_signal", [(-1, -1), (-1, 0), (0, 0)])
def test_an_empty_slot(no_signal: tuple[int, int]) -> None:
    receiver = Receiver(transmitters((90, 0, 0)), QUIET, 2, no_signal)
    empty = ChannelReading(None, Zone.OUTER, *no_signal, None)
    assert receiver.nothing() == Reading((empty, empty), False, False)
    assert here(receiver) == Reading((empty._replace(true_range_m=90.0), empty), False, False)


def test_the_true_ranges_of_what_is_not_heard_are_in_the_empty_slots_nearest_first() -> None:
    far = transmitters((90, 0, 0), (10, 0, 0), (114_000, 0, 0), (0, 70, 0), ids=(8, 3, 1, 5))
    got = here(Receiver(far, QUIET, 5))
    assert [(c.id, c.true_range_m) for c in got.channels] == [
        (3, 10),
        (None, 70),
        (None, 90),
        (None, 114_000),
        (None, None),
    ]


def test_before_its_first_look_it_shows_empty_slots_and_no_warning() -> None:
    empty = ChannelReading(None, Zone.OUTER, 0, 1, None)
    assert PaperReceiver(QUIET, 2, (0, 1)).show(0.0) == Reading((empty, empty), False, False)


def test_the_seed_is_0_unless_it_is_given() -> None:
    t = transmitters((30, 10, 0), (40, 0, 1))
    readings = [
        [here(receiver) for _ in range(5)] for receiver in (Receiver(t, Antennas()), Receiver(t, Antennas(), seed=0))
    ]
    assert readings[0] == readings[1]
    assert readings[0] != [here(Receiver(t, Antennas(), seed=1)) for _ in range(5)]


def test_noise_from_elsewhere_is_heard_instead_of_its_own() -> None:
    t = transmitters((30, 10, 0), (40, 0, 1))
    antennas = Antennas(floor_range_m=20)
    source = NoiseSource(antennas.noise, noise_bound(antennas.sensitivity, antennas.floor_range_m), seed=1)
    ours, undisturbed = Receiver(t, antennas, seed=2), Receiver(t, antennas, seed=2)
    at = ours.pose(np.zeros(3), LEVEL)
    assert ours.read(*at, source.draw(2)) == here(Receiver(t, antennas, seed=1))
    here(undisturbed)
    assert here(ours) == here(undisturbed)  # its own was drawn all the same


def test_without_transmitters() -> None:
    receiver = Receiver(transmitters(), Antennas(), 3)
    assert here(receiver) == receiver.nothing()
    assert [c.id for c in here(receiver).channels] == [None] * 3


@pytest.mark.parametrize("kind", ["uniform", "gaussian"])
def test_a_frame_s_noise_depends_on_its_number_alone(kind: NoiseKind) -> None:
    t = transmitters((30, 10, 0), (40, 0, 1), (25, -20, 0))

    def receiver(seed: int = 3) -> Receiver:
        return Receiver(t, Antennas(noise=kind), seed=seed)

    steady, moved, lost, other = receiver(), receiver(), receiver(), receiver(4)
    frames = []
    for k in range(50):
        if k % 3:
            frames.append(here(steady))
            assert here(moved) == here(lost) == frames[-1]
            assert here(other) != frames[-1]
        else:
            here(steady)
            here(moved, (k * 100, 0, 0))
            lost.nothing()
            here(other)
    assert len({tuple(bits(frame)) for frame in frames}) == len(frames)


@every("kind", ["uniform", "gaussian"])
@every("floor", [80.0, 100.0])
def test_noise_within_the_specified_floor_is_no_interference(kind: NoiseKind, floor: float) -> None:
    receiver = Receiver(transmitters((10, 0, 0)), Antennas(floor_range_m=floor, noise=kind))
    assert not any(receiver.nothing().interference for _ in range(5000))


def test_interference_is_noise_above_the_specified_floor() -> None:
    receiver = Receiver(transmitters((10, 0, 0)), Antennas(floor_range_m=40.0), seed=5)
    share = np.mean([receiver.nothing().interference for _ in range(5000)])
    assert share == pytest.approx(7 / 8, abs=0.015)  # 1 − (40/80)³
    assert not Receiver(transmitters((10, 0, 0)), Antennas(floor_range_m=40.0, noise="off")).nothing().interference


def test_transmitters_may_move_and_the_noise_does_not_notice() -> None:
    near, far = transmitters((20, 0, 0)), transmitters((30, 5, 0))
    moved, fixed = Receiver(near, Antennas(), seed=6), Receiver(far, Antennas(), seed=6)
    assert here(moved) != here(fixed)
    moved.transmitters = far
    assert here(moved) == here(fixed)


def test_the_mount_moves_and_turns_the_receiver() -> None:
    right = Rotation.from_euler("ZYX", [math.pi / 2, 0, 0])
    receiver = Receiver(transmitters((10, 0, 0)), QUIET, mount=Mount((1, 0, 0.5), wxyz(right)))
    p_r, R_r = receiver.pose(np.array([2.0, 3.0, -4.0]), wxyz(right))  # heading east; the receiver faces south
    assert p_r == pytest.approx([2, 4, -3.5], abs=1e-15)
    assert R_r @ [1, 0, 0] == pytest.approx([-1, 0, 0], abs=1e-15)
    assert receiver.pose(np.zeros((2, 5, 3)), np.tile(LEVEL, (2, 5, 1)))[0].shape == (2, 5, 3)


def test_positive_is_to_the_right() -> None:
    """The receiver, on the axis of a transmitter due north, turned 30° left: the line of flux is to its right."""
    receiver = Receiver(transmitters((10, 0, 0)), QUIET)
    left = wxyz(Rotation.from_euler("ZYX", [math.radians(-30), 0, 0]))
    assert receiver.read(*receiver.pose(np.zeros(3), left)).channels[0].delta_deg == 30


def test_no_channels_is_an_error() -> None:
    with pytest.raises(ValueError, match="0 channels"):
        Receiver(transmitters(), QUIET, 0)


@pytest.mark.parametrize("noise", [0.0, 3e-3])
def test_few_transmitters_are_read_as_many_are(noise: float) -> None:
    """In plain numbers, or as arrays. Those added are too far to be heard. Noise [A/m] as strong as a field at 3 m."""
    rng = np.random.default_rng(11)
    near, _ = random_transmitters(rng, 6)
    away = np.full((FEW, 3), 1e6) + rng.normal(size=(FEW, 3))
    many = Transmitters(
        tuple(range(100, 106 + FEW)),
        np.concatenate((near.positions, away)),
        np.concatenate((near.rotations, [np.eye(3)] * FEW)),
        np.concatenate((near.strengths, np.ones(FEW))),
    )
    few = Transmitters(many.ids[:6], near.positions, near.rotations, near.strengths)
    antennas = Antennas(sensitivity=(0.9, 0.7, 0.5), noise="off")
    ours, theirs = Receiver(few, antennas, 6), Receiver(many, antennas, 6)
    p, R = rng.normal(size=(300, 3)) * 15, Rotation.from_quat(rng.normal(size=(300, 4)))
    differ = 0
    for pose in zip(*ours.pose(p, wxyz(R)), strict=True):
        w = noise * rng.normal(size=(6, 3))
        a, b = ours.read(*pose, w), theirs.read(*pose, np.concatenate((w, np.zeros((FEW, 3)))))
        differ += sum(x != y for x, y in zip(bits(a), bits(b), strict=True))
    assert differ <= 3  # rounding edges
