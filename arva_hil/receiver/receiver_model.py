"""What any virtual receiver has to do: look when it wants to, show what it has heard, take its host's commands.

Times are seconds from the start of the run; poses and places NED, metres, from the datum.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Any, Literal, Protocol

from arva_hil.field.arrays import Array, vector
from arva_hil.field.dipole import Transmitters
from arva_hil.receiver.reading import Reading

__all__ = ["Answer", "Look", "Pose", "ReceiverModel", "ReceiverSettings"]


@dataclass(frozen=True, slots=True)
class Pose:
    """The receiver's own pose, mount included: position (3,) NED [m] from the datum, rotation (3, 3) receiver → NED.

    Lists are taken as arrays. Raises ValueError for another shape.
    """

    position: Array
    rotation: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "position", vector("position", self.position, 3))
        object.__setattr__(self, "rotation", vector("rotation", self.rotation, 3, 3))


@dataclass(frozen=True, slots=True)
class Look:
    """What there is for a receiver to hear at one instant.

    `pose`: its own, None when that is unknown. `transmitters`: as they are then, always as many in the same order.
    `noise` (M, 3), NED: what interference adds to the field of each, instead of the noise of the receiver itself, which
    draws its own all the same.
    """

    time_s: float
    pose: Pose | None
    transmitters: Transmitters
    noise: Array | None = None


class Answer(Enum):
    """What a receiver says to a command."""

    DONE = "done"
    REFUSED = "refused"  # it knows the command, and cannot do it now or not with these values
    UNKNOWN = "unknown"


class NoiseSettings(Protocol):
    """The noise of a scenario's receiver. `kind`: uniform, gaussian or off. `floor_range_m`: it is at most as strong as
    the reference transmitter is from there."""

    @property
    def kind(self) -> Literal["uniform", "gaussian", "off"]: ...
    @property
    def floor_range_m(self) -> float: ...


class ReceiverSettings(Protocol):
    """What a scenario says of a receiver, as far as a model may want to know it.

    `channels`: slots; `rate_hz`: of the frames; `kappa_eq`, `sensitivity`, `noise`: see `Antennas`; `no_signal`:
    (d, δ) of an empty slot; `options`: the model's own keys, an `Options` of it, None if it has none.
    """

    @property
    def channels(self) -> int: ...
    @property
    def rate_hz(self) -> float: ...
    @property
    def kappa_eq(self) -> float: ...
    @property
    def sensitivity(self) -> tuple[float, float, float]: ...
    @property
    def noise(self) -> NoiseSettings: ...
    @property
    def no_signal(self) -> tuple[int, int]: ...
    @property
    def options(self) -> Any: ...


class ReceiverModel(Protocol):
    """One receiver. It knows no vehicle, no frames and no faults; whoever has it asks in the order of time.

    A scenario's `model:` names a class whose objects are like this. It has a class method
    `from_settings(settings: ReceiverSettings, seed: int)`, which makes one of them, the same seed with the same noise.
    If it has keys of its own, it has a class `Options` too: a frozen dataclass, whose fields are those keys.
    """

    def next_look(self, after_s: float, frame_s: float) -> float:
        """The first instant later than `after_s` at which it looks, when its next frame is due at `frame_s`.

        A look at the instant of a frame comes before that frame. Asked again after each look and each frame.
        """

    def look(self, look: Look) -> None:
        """Hear what there is."""

    def show(self, time_s: float) -> Reading:
        """What it says at an instant not before its newest look; with every slot empty before the first."""

    def command(self, time_s: float, name: str, values: Sequence[float]) -> Answer:
        """Take a command of its host."""
