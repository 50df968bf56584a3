"""What lies between, and what the vehicle adds: laws, limits, and that air changes nothing."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from arva_hil.model.field import Transmitters
from arva_hil.model.field.dipole import dipole_field
from arva_hil.model.field.medium import AIR, Medium, skin_depth_m
from arva_hil.model.field.vehicle_noise import VehicleNoise
from tests.every import every

THERE = Transmitters((1, 2), [[10, 0, 2], [0, 20, -1]], [np.eye(3)] * 2, [1.0, 0.5])


def test_in_air_the_field_is_the_dipole_to_the_last_bit() -> None:
    point = np.array([3.0, 4.0, -2.0])
    expected = dipole_field(point, THERE.positions, THERE.rotations, THERE.strengths)
    assert (THERE.field_at(point) == expected).all()
    assert THERE.medium is AIR


def test_snow_weakens_what_lies_below_its_surface_and_nothing_else() -> None:
    point = np.array([3.0, 4.0, -2.0])
    covered = replace(THERE, medium=Medium(snow_skin_depth_m=10.0, surface_m=0.5))
    ratio = np.linalg.norm(covered.field_at(point), axis=1) / np.linalg.norm(THERE.field_at(point), axis=1)
    assert ratio.tolist() == pytest.approx([math.exp(-0.15), 1.0])


def test_two_metres_of_snow_cost_less_than_three_percent_of_the_distance() -> None:
    for conductivity, permittivity, decibels in [(1e-5, 1.8, 0.02), (1e-4, 3.0, 0.16), (1e-3, 1.5, 0.72)]:
        loss = float(
            Medium(snow_skin_depth_m=skin_depth_m(conductivity, permittivity)).loss(np.array([[0, 0, 2.0]]))[0]
        )
        assert -20 * math.log10(loss) == pytest.approx(decibels, abs=0.01)
        assert 1 - loss ** (1 / 3) < 0.03
    assert skin_depth_m(0.0) == math.inf


def test_near_by_the_full_dipole_is_the_static_one() -> None:
    point = np.array([10.2, 0.1, 1.8])
    full = replace(THERE, medium=Medium("full"))
    assert full.field_at(point)[0] == pytest.approx(THERE.field_at(point)[0], rel=1e-4)
    assert np.isfinite(full.field_at(THERE.positions[0])).all()


def test_a_medium_without_sense_is_refused() -> None:
    with pytest.raises(ValueError, match="snow_skin_depth_m 0: expected above 0"):
        Medium(snow_skin_depth_m=0.0)


def test_four_motors_add_up_in_power_and_rise_with_their_load() -> None:
    one, four = VehicleNoise(((0.0, 0.0, 0.0),), 5.0), VehicleNoise(((0.0, 0.0, 0.0),) * 4, 5.0)
    assert one.sigma_na_m((0.5, 0.0, 0.0), 1.0) == pytest.approx(5.0)
    assert four.sigma_na_m((0.0, 0.0, 0.5), 0.5) == pytest.approx(5.0)
    assert one.sigma_na_m((0.0, 0.0, 1.0), 1.0) == pytest.approx(5.0 / 8)
    line = VehicleNoise(((0.0, 0.0, 0.0),), 4.0, line_na_m=3.0)
    assert line.sigma_na_m((0.5, 0.0, 0.0), 0.0) == pytest.approx(3.0)
    assert line.sigma_na_m((0.5, 0.0, 0.0), 1.0) == pytest.approx(5.0)


@every("wrong", [((), 1.0, 0.0), (((0, 0, 0),), -1.0, 0.0), (((0, 0, 0),), 1.0, -1.0)])
def test_a_noise_without_sense_is_refused(wrong: tuple[object, float, float]) -> None:
    with pytest.raises(ValueError, match="motor"):
        VehicleNoise(*wrong)  # type: ignore[arg-type]


@every("conductivity", [1e-5, 1e-3, 1e-2, 4.0])
@every("permittivity", [1.0, 3.0, 80.0])
def test_the_skin_depth_is_that_of_a_plane_wave(conductivity: float, permittivity: float) -> None:
    """Its complex wave number, by SI constants of 2019."""
    omega, mu, epsilon = 2 * math.pi * 457e3, 1.25663706212e-6, permittivity * 8.8541878128e-12
    wave_number = omega * (mu * (epsilon - 1j * conductivity / omega)) ** 0.5
    assert skin_depth_m(conductivity, permittivity) == pytest.approx(-1 / wave_number.imag, rel=1e-6)
