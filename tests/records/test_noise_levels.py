"""Noise over the load of the motors, from a record on the ground: the levels are those that were rehearsed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from arva_hil.config import DEFAULT, VehicleNoiseOptions
from arva_hil.config.profiles import parse_profile
from arva_hil.config.receiver import Noise, ReceiverOptions
from arva_hil.records.fitting import FitError
from arva_hil.records.fitting.noise_levels import noise_levels, noise_profile
from arva_hil.records.reading import Recording, load
from tools.real.rehearsal import Waypoint, rehearse

LEVELS = ((0.0, 0.0), (0.5, 5.0), (1.0, 10.0))


def record(
    folder: Path, throttle: Callable[[float], float] | None, steps: str = "cm", seconds: float = 240
) -> Recording:
    """Return the record of a vehicle that stands 20 m from the transmitter."""
    pulsed = {"start_s": 0.0, "steps": steps, "noise_na_m": 1.0}
    noise = VehicleNoiseOptions(levels=LEVELS)
    receiver = ReceiverOptions(model="pulsed", options=pulsed, vehicle_noise=noise, noise=Noise("gaussian"))
    stands = [Waypoint(0, 0, 5, 0, 0), Waypoint(seconds, 0, 5, 0, 0)]
    scenario = replace(DEFAULT, receiver=receiver)
    return load(rehearse(folder / "r", scenario, stands, wind=0.0, throttle=throttle))


def test_the_levels_are_those_of_the_vehicle(tmp_path: Path) -> None:
    ground = record(tmp_path, lambda t: 0.0 if t < 120 else 0.5)
    (off, quiet), (on, loud) = noise_levels(ground)
    assert (off, quiet) == (pytest.approx(0, abs=0.02), 0)
    assert on == pytest.approx(0.5, abs=0.03)
    assert loud == pytest.approx(5.0, rel=0.3)
    text = noise_profile(ground, [(off, quiet), (on, loud)])
    parse_profile(text, "receiver", "noise.yaml")


def test_what_is_missing_is_said(tmp_path: Path) -> None:
    with pytest.raises(FitError, match="the autopilot has sent no load of its motors"):
        noise_levels(record(tmp_path / "a", None, seconds=60))
    with pytest.raises(FitError, match="had 1 loads with 20 readings or more, two are needed"):
        noise_levels(record(tmp_path / "b", lambda t: 0.5, seconds=60))
    with pytest.raises(FitError, match="its steps hide the noise\\. Put the transmitter farther away"):
        noise_levels(record(tmp_path / "c", lambda t: 0.0 if t < 60 else 0.5, "digits", seconds=120))
