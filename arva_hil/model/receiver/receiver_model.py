"""The protocol of receiver models: the times of their samples, their readings, and commands of their host.

Times are seconds from the start of the run; poses and places NED, metres, from the datum.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Any, Literal, Protocol

from arva_hil.model.field.arrays import Array
from arva_hil.model.field.dipole import Transmitters
from arva_hil.model.field.rotation import Pose
from arva_hil.model.receiver.reading import Reading


@dataclass(frozen=True, slots=True)
class Impairment:
    """The faults of a receiver and of its surroundings at an instant.

    `gains`: of the antennas x, y, z; `saturation_na_m`: the largest signal of an antenna; `noise_na_m`: the standard
    deviation of noise from near the receiver, at each antenna [nA/m].
    """

    gains: tuple[float, float, float] = (1.0, 1.0, 1.0)
    saturation_na_m: float = math.inf
    noise_na_m: float = 0.0

    def also(self, other: Impairment) -> Impairment:
        """Return the sum of two impairments."""
        x, y, z = (one * more for one, more in zip(self.gains, other.gains, strict=True))
        return Impairment(
            (x, y, z),
            min(self.saturation_na_m, other.saturation_na_m),
            math.hypot(self.noise_na_m, other.noise_na_m),
        )


@dataclass(frozen=True, slots=True)
class Look:
    """The input of a receiver at one instant.

    - `pose`: the receiver's own; None if unknown.
    - `transmitters`: always the same number in the same order.
    - `noise` (M, 3), NED: during interference added to each field instead of the receiver's own noise.
    - `impairment`: faults; None without one.
    """

    time_s: float
    pose: Pose | None
    transmitters: Transmitters
    noise: Array | None = None
    impairment: Impairment | None = None


class Answer(Enum):
    """The answer of a receiver to a command."""

    DONE = "done"
    REFUSED = "refused"  # a known command that is not possible now, or not with these values
    UNKNOWN = "unknown"


Commands = Mapping[str, tuple[range, Callable[..., bool | None]]]
"""Commands by name: the allowed numbers of values, and a function of these integers; False is a refusal."""


def obey(commands: Commands, name: str, values: Sequence[float]) -> Answer:
    """Handle a command. It is refused for a wrong number of values, or a value that is not whole."""
    if name not in commands:
        return Answer.UNKNOWN
    counts, do = commands[name]
    if len(values) not in counts or not all(float(value).is_integer() for value in values):
        return Answer.REFUSED
    return Answer.REFUSED if do(*map(int, values)) is False else Answer.DONE


class NoiseSettings(Protocol):
    """The noise of a scenario's receiver."""

    @property
    def kind(self) -> Literal["uniform", "gaussian", "off"]:
        """The distribution of its magnitude."""

    @property
    def floor_range_m(self) -> float:
        """The noise is at most as strong as the reference transmitter at this distance."""


class ReceiverSettings(Protocol):
    """The settings of a receiver in the scenario, for its model."""

    @property
    def channels(self) -> int:
        """Number of slots."""

    @property
    def rate_hz(self) -> float:
        """Of frames."""

    @property
    def kappa_eq(self) -> float:
        """See `Antennas`."""

    @property
    def sensitivity(self) -> tuple[float, float, float]:
        """See `Antennas`."""

    @property
    def noise(self) -> NoiseSettings:
        """See `Antennas`."""

    @property
    def no_signal(self) -> tuple[int, int]:
        """(d, δ) of an empty slot."""

    @property
    def display(self) -> Any:
        """Its `table` is a `DisplayLaw`; None without an own law."""

    @property
    def options(self) -> Any:
        """The model's `Options`, or None."""


class ReceiverModel(Protocol):
    """One receiver. It knows no vehicle, no frames and no faults. Times of calls never go back.

    `model:` in a scenario names a class with a class method `from_settings(settings: ReceiverSettings, seed: int)`; the
    same seed gives the same noise. The model's own keys are the fields of its `Options`, a frozen dataclass.
    """

    def next_look(self, after_s: float, frame_s: float) -> float:
        """Return the first instant after `after_s` at which it takes a sample.

        `frame_s`: the instant of the next frame; a sample at that instant comes first. Called after each sample and
        frame.
        """

    def look(self, look: Look) -> bool | None:
        """Receive the transmitters at one instant. Returns True to ask for a frame of this instant."""

    def show(self, time_s: float) -> Reading:
        """Return the reading at an instant, not before the newest sample. Before the first one every slot is empty."""

    def command(self, time_s: float, name: str, values: Sequence[float]) -> Answer:
        """Handle a command of the host at `time_s`. `values` have the units that PROTOCOL.md gives for the command."""
