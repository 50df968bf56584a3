"""The noise of the vehicle at its receiver over the load of its motors, from a record on the ground.

The vehicle stands still, the transmitter too. Then d scatters with the noise: σ_d / d = σ / 3H.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from arva_hil.autopilot.following.session import Session
from arva_hil.config import ReceiverOptions, Scenario, VehicleNoiseOptions
from arva_hil.emulator.setup import one_vehicle
from arva_hil.emulator.world import VehicleWorld
from arva_hil.records.comparing.again import feed
from arva_hil.records.fitting.flight import FitError, Floats
from arva_hil.records.reading import NO_ID, Recording
from arva_hil.safe_text import one_line

LISTENS_TO_MOTORS: Final = ReceiverOptions(vehicle_noise=VehicleNoiseOptions(levels=((0.0, 0.0), (1.0, 0.0))))
"""A receiver whose vehicle is asked for the load of its motors."""

_STEP: Final = 0.1  # of the load, of one level
_LEAST: Final = 20  # readings of a level
_KAPPA_EQ: Final = 1.542
_REFERENCE_NA_M: Final = 2e6 * math.pi


def noise_levels(recording: Recording) -> list[tuple[float, float]]:
    """Return the levels: load 0…1, and the noise that the vehicle adds to that at the lowest load [nA/m].

    Raises FitError and RecordingError.
    """
    (receiver,) = recording.receivers
    every_m, _, zone, _ = receiver.of_transmitter(receiver.ids[0] if receiver.ids else NO_ID)
    heard = zone > 0
    d_m = every_m[heard]
    if len(d_m) < 2 * _LEAST:
        raise FitError(f"{recording.folder}: {len(d_m)} readings: at least {2 * _LEAST} are needed")
    loads = _loads(recording, receiver.time_s[heard])
    levels = []
    for number in range(round(1 / _STEP) + 1):
        here = np.round(loads / _STEP) == number
        if here.sum() >= _LEAST:
            levels.append((float(loads[here].mean()), _sigma_na_m(d_m[here])))
    if len(levels) < 2:
        raise FitError(
            f"{recording.folder}: the motors had {len(levels)} loads with {_LEAST} readings or more, two are needed: "
            "record with the motors off, then on"
        )
    quiet = levels[0][1]
    return [(load, math.sqrt(max(sigma**2 - quiet**2, 0.0))) for load, sigma in levels]


def noise_profile(recording: Recording, levels: Sequence[tuple[float, float]]) -> str:
    """Return the text of a profile with these levels."""
    date = one_line(recording.run.started) if recording.run else "unknown"
    listed = ", ".join(f"[{load:.3f}, {sigma:.3g}]" for load, sigma in levels)
    return (
        f"# Noise of the motors over their load, by arva-hil record --noise, {date}.\n"
        f"spec: 2\nreceiver:\n  model: pulsed\n  vehicle_noise: {{levels: [{listed}]}}\n"
    )


def _sigma_na_m(d_m: Floats) -> float:
    d = float(np.median(d_m))
    steps = np.diff(np.unique(d_m.round(2)))
    variance = (float(np.var(d_m)) - (float(steps.min()) ** 2 / 12 if len(steps) else 0.0)) / d**2
    if variance <= 0:
        raise FitError(f"d stays at {d:.2f} m: its steps hide the noise. Put the transmitter farther away")
    return 3 * _KAPPA_EQ / (4 * math.pi) / d**3 * _REFERENCE_NA_M * math.sqrt(variance)


def _loads(recording: Recording, time_s: Floats) -> Floats:
    """Return the load of the motors at these times."""
    setup = one_vehicle(Scenario((), receiver=LISTENS_TO_MOTORS), Session(passive=True))
    world = VehicleWorld(setup, {}, start=0.0, max_age_s=2.0)
    seen: list[tuple[float, float]] = []
    feed(recording, setup, world, lambda now: seen.append((now, world.at(now).load)))
    if not any(load for _, load in seen):
        raise FitError(f"{recording.folder}: the autopilot has sent no load of its motors (VFR_HUD, SERVO_OUTPUT_RAW)")
    times, loads = np.array(seen).T
    return np.asarray(np.interp(time_s, times, loads))
