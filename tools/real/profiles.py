"""Profiles drawn at random, and the scenario that rehearses one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from arva_hil.config import DEFAULT, NavigationError, Scenario, Transmitter
from arva_hil.config.receiver import MountOptions, Noise, ReceiverOptions
from arva_hil.records.fitting import FittedValue


def drawn(seed: int, model: str = "paper") -> tuple[Scenario, dict[str, float]]:
    """A scenario with a receiver and a transmitter drawn at random, and the true values of its parameters."""
    random = np.random.default_rng([seed, 1])
    kappa = float(1.542 * np.exp(random.uniform(-0.25, 0.25)))
    yaw = float(random.uniform(-40, 40))
    mount = tuple(float(value) for value in random.uniform(-0.4, 0.4, 3))
    north, east = (float(value) for value in random.uniform(-8, 8, 2))
    down, heading = float(random.uniform(0, 2)), float(random.uniform(-90, 90))
    pitch = float(random.uniform(-50, 50))
    floor_m = float(random.uniform(60, 100))
    weakest = float(random.uniform(0.5, 1.0))
    q = (1.0, weakest, 0.6)
    truth = {
        "kappa_eq": kappa,
        "latency": float(random.uniform(0, 0.8)),
        "mount yaw": yaw,
        "mount x": mount[0],
        "mount y": mount[1],
        "mount z": mount[2],
        "transmitter 1 north": north,
        "transmitter 1 east": east,
        "transmitter 1 down": down,
        "transmitter 1 yaw": heading,
        "transmitter 1 pitch": pitch,
    }
    receiver = ReceiverOptions(
        kappa_eq=kappa,
        sensitivity=q,
        noise=Noise("uniform", floor_m),
        mount=MountOptions((mount[0], mount[1], mount[2]), (0.0, 0.0, yaw)),
        model=model,
    )
    if model == "paper":
        truth |= {"floor_range_m": floor_m, "sensitivity y / x": weakest}
    scenario = replace(
        DEFAULT,
        transmitters=(Transmitter(id=1, ned=(north, east, down), attitude=(0.0, pitch, heading)),),
        receiver=receiver,
        navigation_error=NavigationError(walk_sigma_m=1.5, walk_tau_s=60.0),
        seed=seed,
    )
    return scenario, truth


def misses(estimates: Mapping[str, FittedValue], truth: Mapping[str, float]) -> dict[str, float]:
    """Return how far each truth is from the middle of its interval, in half widths, for identified parameters.

    A dipole with its axis reversed is the same: its pitch changes its sign with half a turn of its yaw.
    """
    true = dict(truth)
    for name in truth:
        if name.endswith("yaw") and name in estimates:
            half_turns = round((truth[name] - estimates[name].value) / 180)
            true[name] -= 180 * half_turns
            if half_turns % 2 and (pitch := name.removesuffix("yaw") + "pitch") in true:
                true[pitch] *= -1
    return {
        name: (true[name] - (one.low + one.high) / 2) / ((one.high - one.low) / 2)
        for name, one in estimates.items()
        if name in true and one.identified
    }
