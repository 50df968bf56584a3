"""The data behind the figures of tools/figures/paper.py, against the paper's equations; and that the files are made."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.figure import Figure
from PIL import Image

from arva_hil.model.receiver import Antennas, Zone
from tests.paper_receiver import Receiver
from tools.figures import paper

KAPPA, MID_M, BOUND = 1.542, 50.0, 1 / (2 * np.pi * 80**3)
SILENT = Antennas(noise="off")
ON_AXIS, ON_EQUATOR = 2.0, 1.0  # 4π‖h‖ at 1 m
LAST_M = (ON_AXIS / (KAPPA / MID_M**3 - 2 / 80**3)) ** (1 / 3)  # the farthest that can be heard, noise at its worst
SURE_M = (ON_EQUATOR / (KAPPA / MID_M**3 + 2 / 80**3)) ** (1 / 3)  # a level receiver always hears up to here


def analytic(places: np.ndarray) -> np.ndarray:
    """Eq. 1 in the dipole's own plane, x being east."""
    x, y = places.T
    r = np.hypot(x, y)
    return (np.array([2 * x**2 - y**2, 3 * x * y]) / (4 * np.pi * r**5)).T


def test_the_bounds_are_those_of_the_model_s_description() -> None:
    assert round(LAST_M, 1) == 61.9
    assert round(SURE_M, 1) == 39.5


def test_the_field_is_that_of_a_dipole_that_points_east() -> None:
    places = np.random.default_rng(1).uniform(-60, 60, (500, 2))
    np.testing.assert_allclose(paper.field(places), analytic(places), rtol=1e-9, atol=1e-18)


@given(st.lists(st.floats(1, 1000), min_size=1, max_size=5))
@settings(max_examples=6)
def test_a_flux_line_keeps_its_apex(apexes: list[float]) -> None:
    lines = paper.flux_lines(apexes)
    assert lines.shape[0] == len(apexes)
    for apex, line in zip(apexes, lines, strict=True):
        r, sine = np.hypot(*line.T), line[:, 1] / np.hypot(*line.T)
        np.testing.assert_allclose(r, apex * sine**2, rtol=1e-5)
        assert r.max() == pytest.approx(apex)
        assert max(r[0], r[-1]) < 0.003 * apex
        assert line[0, 0] > 0 > line[-1, 0]  # leaves by the dipole's head, comes back to its tail
        along = (np.diff(line, axis=0) * analytic((line[1:] + line[:-1]) / 2)).sum(axis=1)
        assert (along > 0).all()


@given(st.floats(3.5, 49.9))
@settings(max_examples=25)
def test_an_iso_power_line_is_of_one_power_and_bears_what_is_shown_there(d: float) -> None:
    line = paper.iso_power_line(d)
    np.testing.assert_allclose(np.linalg.norm(analytic(line), axis=1), KAPPA / (4 * np.pi * d**3), rtol=1e-9)
    np.testing.assert_allclose(line[0], line[-1], atol=1e-9)
    assert line[:, 0].max() == pytest.approx(d / (KAPPA / ON_AXIS) ** (1 / 3), rel=1e-3)
    shown = paper.directions(line, antennas=SILENT)
    assert (shown.zones == Zone.MID).all()
    np.testing.assert_allclose(shown.d, d, atol=0.00501)


def test_level_poses_are_level_in_the_plane_and_the_others_turned_in_every_way() -> None:
    rng = np.random.default_rng(2)
    quarters = [0.25, 0.5, 0.75]
    places, R = paper.poses(20_000, rng, level=True)
    assert (places[:, 2] == 0).all()
    np.testing.assert_allclose(R[:, 2], np.broadcast_to([0, 0, 1], (20_000, 3)), atol=1e-12)
    for x, y in (places.T[:2], R[:, :2, 0].T):
        np.testing.assert_allclose(np.quantile(np.arctan2(y, x) / np.pi, quarters), [-0.5, 0, 0.5], atol=0.03)
    free, free_R = paper.poses(20_000, rng, level=False)
    for p in (places, free):
        np.testing.assert_allclose(np.quantile(np.linalg.norm(p, axis=1), quarters), [22.5, 45, 67.5], atol=1.5)
    ways = free / np.linalg.norm(free, axis=1, keepdims=True)
    for unit in (ways, *np.moveaxis(free_R, 2, 0)):  # on a sphere each coordinate is uniform
        np.testing.assert_allclose(np.quantile(unit, quarters, axis=0), np.outer([-0.5, 0, 0.5], [1, 1, 1]), atol=0.03)


@pytest.mark.parametrize("level", [True, False])
@pytest.mark.parametrize("kind", ["uniform", "gaussian", "off"])
def test_readings_are_what_a_receiver_says(level: bool, kind: str) -> None:
    antennas = Antennas(noise=kind)  # type: ignore[arg-type]
    places, R = paper.poses(300, np.random.default_rng(3), level, farthest=60.0)
    receiver = Receiver(paper.TRANSMITTER, antennas, channels=1, seed=9)
    said = [receiver.read(p, r).channels[0] for p, r in zip(places, R, strict=True)]
    d_cm, delta, zone = paper.readings(places, R, 9, antennas)
    assert [(c.d_cm, c.delta_deg, c.zone) for c in said] == list(zip(d_cm, delta, zone, strict=True))
    assert {Zone.INNER, Zone.MID, Zone.OUTER} == set(zone.tolist())


def test_level_receivers_all_hear_near_and_none_hears_far() -> None:
    distance, d = paper.distances(60_000, level=True)
    heard = d != -1
    assert heard[distance < SURE_M].all()
    assert not heard[distance < SURE_M + 3].all()
    assert not heard[distance > LAST_M].any()
    assert heard[distance > 57].any()
    assert 0 < d[heard].min() < d[heard].max() == MID_M
    beyond = heard & (distance > 0.01)  # nearer than a centimetre the field grows no more
    r, shown = distance[beyond], d[beyond]
    assert (KAPPA / (shown + 0.0051) ** 3 <= ON_AXIS / r**3 + 2 / 80**3).all()
    assert (KAPPA / (shown - 0.0051) ** 3 >= ON_EQUATOR / r**3 - 2 / 80**3).all()


def test_a_turned_receiver_can_be_deaf_anywhere_but_in_the_inner_zone_and_hears_no_farther() -> None:
    distance, d = paper.distances(60_000, level=False)
    heard = d != -1
    assert heard[distance < 2.5].all()
    assert not heard[distance < 20].all()
    assert not heard[distance > LAST_M].any()
    level_distance, level_d = paper.distances(60_000, level=True)
    edges = np.arange(0, 91, 5.0)
    turned, level = paper.share_heard(distance, d, edges), paper.share_heard(level_distance, level_d, edges)
    assert (turned <= level).all()
    assert (level[:7] == 1).all()
    assert (turned[4:7] < 1).all()


def test_share_heard() -> None:
    share = paper.share_heard(
        np.array([1.0, 2.0, 3.0, 11.0, 31.0]), np.array([1.0, -1, 3.0, -1, 0.0]), np.arange(0, 41, 10.0)
    )
    np.testing.assert_array_equal(share, [2 / 3, 0, np.nan, 1])


def test_a_grid_reaches_both_sides_and_has_the_transmitter() -> None:
    places = paper.grid(11, 5, 5)
    assert sorted(map(tuple, places.tolist())) == [(x, y) for x in (-10, -5, 0, 5, 10) for y in (-5, 0, 5)]


@pytest.mark.parametrize("antennas", [Antennas(), SILENT], ids=["noise", "silent"])
def test_directions_are_the_field_s_as_far_as_noise_and_whole_degrees_allow(antennas: Antennas) -> None:
    places = paper.grid(65, 45, 1.3)
    shown = paper.directions(places, antennas=antennas)
    mid = shown.zones == Zone.MID
    field, ways = analytic(places[mid]), shown.ways[mid]
    strength = np.linalg.norm(field, axis=1)
    np.testing.assert_allclose(np.linalg.norm(ways, axis=1), 1)
    off = np.arccos(np.clip((ways * field).sum(axis=1) / strength, -1, 1))
    noise = 0.0 if antennas is SILENT else np.arcsin(BOUND / strength)
    clamped = np.radians(1.001)  # δ that rounds to 90 is 89
    assert (off <= noise + clamped).all()
    assert off.mean() < np.radians(0.3 if antennas is SILENT else 3)
    assert (shown.ways[~mid] == 0).all()
    assert ((shown.d == -1) == (shown.zones == Zone.OUTER)).all()
    near = np.hypot(*places.T)
    assert (near[shown.zones == Zone.INNER] < 3.4).all()
    assert (shown.zones[near < 2.5] == Zone.INNER).all()


def test_the_same_seed_gives_the_same_data_and_another_gives_others() -> None:
    places = paper.grid(60, 40, 5)
    for draw in (
        lambda *seed: paper.distances(500, True, *seed)[1],
        lambda *seed: paper.directions(places, *seed).ways,
    ):
        np.testing.assert_array_equal(draw(), draw())
        assert not np.array_equal(draw(), draw(1))


@pytest.mark.parametrize("name", ["figure2", "figure3", "figure5"])
def test_a_figure_is_a_small_file(name: str, tmp_path: Path) -> None:
    one, two = tmp_path / "one.png", tmp_path / "two.png"
    paper.save(paper.FIGURES[name], one)
    if name == "figure5":  # drawn twice it is the same; that the data of each is: above
        paper.save(paper.FIGURES[name], two)
        assert one.read_bytes() == two.read_bytes()
    assert one.stat().st_size < 80_000
    with Image.open(one) as image:
        assert image.width == paper.WIDTH_PX
        assert len(image.convert("RGB").getcolors(256) or ()) > 20


@pytest.mark.parametrize("name", paper.FIGURES)
def test_every_figure_is_kept_beside_the_tools(name: str) -> None:
    path = Path(paper.__file__).with_name(f"{name}.png")
    assert path.stat().st_size < 80_000
    with Image.open(path) as image:
        assert image.width == paper.WIDTH_PX


def test_the_command_writes_every_figure_where_it_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def line(figure: Figure) -> None:
        figure.add_subplot().plot([0, 1])

    monkeypatch.setattr(paper, "FIGURES", {"one": line, "two": line})
    monkeypatch.setattr(sys, "argv", ["paper", "--out", str(tmp_path / "new" / "folder")])
    paper.main()
    made = sorted((tmp_path / "new" / "folder").iterdir())
    assert [path.name for path in made] == ["one.png", "two.png"]
    assert [text.split(": ")[0] for text in capsys.readouterr().out.splitlines()] == list(map(str, made))
