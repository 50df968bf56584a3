"""A receiver of pulses that hovers among transmitters, and its readings over time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from arva_hil.config import Noise, ReceiverOptions
from arva_hil.model.field import Transmitters
from arva_hil.model.field.keying import Keying
from arva_hil.model.receiver import Impairment, Look, Pose, Reading, ReceiverModel
from arva_hil.registry import RECEIVERS

PAPER: Final[dict[str, Any]] = {"threshold_na_m": 6.168, "start_s": 0.0, "steps": "cm"}
"""The keys of the paper's receiver: 50 m, three antennas, whole centimetres."""


def transmitters(
    *places: ArrayLike, keyings: Sequence[Keying], strengths: Sequence[float] = (), rotations: ArrayLike | None = None
) -> Transmitters:
    """Return transmitters with ids 1, 2, …; by default their dipoles point north."""
    m = len(places)
    turned = np.tile(np.eye(3), (m, 1, 1)) if rotations is None else np.asarray(rotations, float)
    return Transmitters(
        tuple(range(1, m + 1)),
        np.array(places, float),
        turned,
        np.array(strengths or [1.0] * m),
        keyings=tuple(keyings),
    )


class Hovering:
    """A receiver at `position`, turned by `rotation`; both may be changed. `options`: keys of the model."""

    def __init__(
        self,
        there: Transmitters,
        position: ArrayLike = (0.0, 0.0, 0.0),
        rotation: ArrayLike | None = None,
        *,
        noise: str = "off",
        channels: int = 4,
        seed: int = 1,
        model: str = "pulsed",
        **options: Any,
    ) -> None:
        self.transmitters = there
        self.position: NDArray[np.float64] = np.asarray(position, float)
        self.rotation = np.eye(3) if rotation is None else np.asarray(rotation, float)
        self.impairment: Impairment | None = None
        settings = ReceiverOptions(
            channels=channels,
            noise=Noise(noise),  # type: ignore[arg-type]
            model=model,
            options=options,
        )
        self.model: ReceiverModel = RECEIVERS[model].from_settings(settings, seed)
        self.now = -1e-9

    def at(self, t: float) -> Look:
        return Look(t, Pose(self.position, self.rotation), self.transmitters, impairment=self.impairment)

    def looks(self, until_s: float) -> Iterator[bool | None]:
        """Let time pass; yield each look, and True if it requests a frame."""
        while (t := self.model.next_look(self.now, until_s)) <= until_s:
            self.now = t
            yield self.model.look(self.at(t))

    def read(self, until_s: float) -> Reading:
        """Let time pass, and return the reading then."""
        for _ in self.looks(until_s):
            pass
        return self.model.show(until_s)

    def readings(self, until_s: float, step_s: float) -> list[Reading]:
        """Yield the readings of every step until then."""
        times = np.arange(self.now + step_s, until_s, step_s).tolist()
        return [self.read(t) for t in times]

    def silence(self, *indices: int) -> None:
        """Switch transmitters off, and all others on."""
        strengths = np.ones(len(self.transmitters.ids))
        strengths[list(indices)] = 0.0
        self.transmitters = replace(self.transmitters, strengths=strengths)
