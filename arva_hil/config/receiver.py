"""The receiver of a scenario: what it is like, where it sits, how often it looks."""

from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Final

from arva_hil.config.kinds import ANGLE, BODY_POINT, NOISE_KINDS, RATE_HZ, NoiseKind, Triple
from arva_hil.config.marks import Help, NotAKey, Since
from arva_hil.config.mistake import Mistake
from arva_hil.config.nested import Reshaped
from arva_hil.config.own_keys import PAPER, OwnKeys, checked_options, own_keys, schemas
from arva_hil.config.sorts import Anything, Number, Numbers, Whole
from arva_hil.config.tables import right, table
from arva_hil.config.text import Named, Word
from arva_hil.registry import RECEIVERS

NO_SIGNAL: Final = ((-1, -1), (-1, 0), (0, 0))


@table()
class Angles:
    """An attitude as a file has it."""

    roll: Annotated[float, ANGLE, Help("about x")] = 0.0
    pitch: Annotated[float, ANGLE, Help("about y")] = 0.0
    yaw: Annotated[float, ANGLE, Help("about z")] = 0.0


ATTITUDE: Final = Reshaped(Angles, lambda angles: (angles.roll, angles.pitch, angles.yaw), Numbers(ANGLE, ANGLE, ANGLE))


class _NoSignal(Numbers):
    def read(self, value: Any) -> tuple[Any, ...]:
        pair = super().read(value)
        if pair not in NO_SIGNAL:
            raise Mistake("[-1, -1], [-1, 0] or [0, 0]", f"[{pair[0]}, {pair[1]}]")
        return pair

    def json(self) -> dict[str, Any]:
        return {"enum": [list(pair) for pair in NO_SIGNAL]}


@table()
class Noise:
    """The noise of eq. 4; `floor_range_m` is r_en, where it is as strong as the reference transmitter."""

    kind: Annotated[NoiseKind, Word(NOISE_KINDS), Help("how it is distributed")] = "uniform"
    floor_range_m: Annotated[
        float, Number(0, 1_000_000, above=True, unit="m"), Help("it is like a transmitter that far away")
    ] = 80.0


@table()
class MountOptions:
    """Where the receiver sits: `position` in body FRD, metres; `attitude` roll, pitch, yaw in degrees."""

    position: Annotated[Triple, BODY_POINT, Help("body FRD, from the vehicle's position")] = (0.0, 0.0, 0.0)
    attitude: Annotated[Triple, ATTITUDE, Help("receiver FRD to body FRD")] = (0.0, 0.0, 0.0)


@table()
class ReceiverOptions:
    """The receiver. `sensitivity`: the diagonal of Q; `no_signal`: (d, δ) when there is nothing to report.

    Each frame is up to `jitter_s` late, less than half the period. `options`: of a model with keys of its own its
    `Options`, or a mapping that makes them; a file has them beside `model`. Raises ValueError when it does not fit.
    """

    channels: Annotated[int, Whole(1, 16), Help("how many transmitters it can show at once, the nearest first")] = 4
    rate_hz: Annotated[float, RATE_HZ, Help("frames a second")] = 1.0
    jitter_s: Annotated[
        float, Number(0, 5, unit="s"), Help("each frame is up to this late; less than half the period")
    ] = 0.0
    kappa_eq: Annotated[
        float, Number(0, 1000, above=True), Help("what turns field into distance; 1.542 is right on average")
    ] = 1.542
    sensitivity: Annotated[
        Triple, Numbers(*[Number(0, 1, above=True)] * 3), Help("of the antennas along x, y and z")
    ] = (1.0, 0.8, 0.6)
    noise: Annotated[Noise, Help("what it hears besides")] = Noise()
    mount: Annotated[MountOptions, Help("where on the vehicle it sits")] = MountOptions()
    no_signal: Annotated[
        tuple[int, int], _NoSignal(*[Whole(-1, 0)] * 2), Help("distance and angle when there is nothing")
    ] = (-1, -1)
    model: Annotated[str, Named(RECEIVERS), Since(2), Help("what computes a reading; its own keys stand beside it")] = (
        PAPER
    )
    options: Annotated[Any, Anything(), NotAKey()] = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "options", checked_options(self.model, self.options))
        if wrong := late(self.rate_hz, self.jitter_s):
            raise ValueError(str(wrong))

    @classmethod
    def own_keys(cls, mapping: Mapping[str, Any]) -> OwnKeys:
        """The keys that the model has besides."""
        return own_keys(right(cls, mapping, "model"), mapping)

    @classmethod
    def own_schemas(cls) -> dict[str, Any]:
        """JSON Schemas of the keys that models have besides."""
        return schemas()

    @classmethod
    def misfits(cls, mapping: Mapping[str, Any]) -> Iterator[Mistake]:
        rate_hz, jitter_s = (right(cls, mapping, name) for name in ("rate_hz", "jitter_s"))
        if rate_hz is not None and jitter_s is not None and (wrong := late(rate_hz, jitter_s)):
            yield wrong


def late(rate_hz: float, jitter_s: float) -> Mistake | None:
    """What is wrong with the jitter of a receiver, if it is."""
    if jitter_s < 0.5 / rate_hz:
        return None
    return Mistake(
        f"less than half the period ({0.5 / rate_hz:.4g} s)", f"jitter_s {jitter_s:.4g}", where=("jitter_s",)
    )
