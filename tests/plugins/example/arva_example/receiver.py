"""A receiver model with keys of its own: it looks ten times a second and shows the nearest of some looks."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

from annotated_types import Ge, Le

from arva_hil import Answer, Look, PaperReceiver, Reading, ReceiverSettings


class Hold:
    """Remembers the readings of the last `looks` looks."""

    @dataclass(frozen=True)
    class Options:
        """Its keys in a scenario, beside those of every receiver."""

        looks: Annotated[int, Ge(1), Le(100)] = 3
        label: str = "hold"

    def __init__(self, paper: PaperReceiver, looks: int) -> None:
        self._paper = paper
        self._readings: deque[Reading] = deque(maxlen=looks)

    @classmethod
    def from_settings(cls, settings: ReceiverSettings, seed: int) -> Hold:
        return cls(PaperReceiver.from_settings(settings, seed), settings.options.looks)

    def next_look(self, after_s: float, frame_s: float) -> float:
        return (math.floor(after_s * 10 + 1e-6) + 1) / 10 if after_s >= 0 else 0.0

    def look(self, look: Look) -> None:
        self._paper.look(look)
        self._readings.append(self._paper.show(look.time_s))

    def show(self, time_s: float) -> Reading:
        silent = self._paper.show(time_s)
        return min(self._readings, key=lambda reading: reading.channels[0].d_cm % 10**6, default=silent)

    def command(self, time_s: float, name: str, values: Sequence[float]) -> Answer:
        return Answer.UNKNOWN
