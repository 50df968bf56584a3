"""The receiver of a scenario: its properties, its mount, its rate, and the own keys of its model."""

from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import InitVar, asdict
from typing import Any, Final

from arva_hil.config.common import BODY_POINT, NOISE_KINDS, RATE_HZ, Attitude, NoiseKind, Triple
from arva_hil.config.constraints import Anything, Named, Number, Numbers, Whole, Word
from arva_hil.config.display import DisplayOptions
from arva_hil.config.errors import Violation
from arva_hil.config.own_options import own_keys
from arva_hil.config.tables import Table, key, own_options, valid_value
from arva_hil.config.transmitter import PROFILE, VehicleNoiseOptions
from arva_hil.errors import KindError
from arva_hil.registry import RECEIVERS

PAPER: Final = "paper"  # it has no keys of its own; a scenario without another model imports none


def own_class(model: str | None) -> tuple[type[Any] | None, str]:
    """Return the class of a model's own keys, None if it has none or cannot be used; and the model, for messages."""
    with suppress(KindError):  # reported where the model is named
        if model not in (None, PAPER):
            return getattr(RECEIVERS[model], "Options", None), f"the receiver model {model}"
    return None, f"the receiver model {model}"


NO_SIGNAL: Final = ((-1, -1), (-1, 0), (0, 0))


class _NoSignal(Numbers):
    def __init__(self) -> None:
        super().__init__(*[Whole(-1, 0)] * 2, fits=NO_SIGNAL.__contains__, expected="[-1, -1], [-1, 0] or [0, 0]")

    def json(self) -> dict[str, Any]:
        return {"enum": [list(pair) for pair in NO_SIGNAL]}


class Noise(Table):
    """The noise of eq. 4. `floor_range_m`: r_en, the distance at which it equals the reference transmitter."""

    kind: NoiseKind = key(Word(NOISE_KINDS), "its distribution", default="uniform")
    floor_range_m: float = key(
        Number(0.01, 1_000_000, unit="m"), "its strength: that of a transmitter at this distance", default=80.0
    )


class SlingOptions(Table):
    """A rope from `position` to the receiver."""

    length_m: float = key(Number(0, 100, above=True, unit="m"), "of the rope")
    damping: float = key(Number(0, 0.99), "of its swing, relative to critical", default=0.05)


class MountOptions(Table):
    """The mount of the receiver.

    `position`: body FRD, metres. `attitude`: roll, pitch, yaw in degrees. With a `sling` the receiver hangs from there,
    leans with the rope, and has the vehicle's heading plus that of `attitude`.
    """

    position: Triple = key(BODY_POINT, "body FRD, from the vehicle's position", default=(0.0, 0.0, 0.0))
    attitude: Triple = key(Attitude(), "receiver FRD to body FRD", default=(0.0, 0.0, 0.0))
    sling: SlingOptions | None = key(help="the rope on which it swings from there", since=2, default=None)


class ReceiverOptions(Table):
    """The receiver. `sensitivity`: the diagonal of Q; `no_signal`: (d, δ) of an empty slot.

    Each frame is up to `jitter_s` late, less than half the period. `options`: own keys of the model, its `Options` or a
    mapping; a file has these keys beside `model`. `profile` is a key of files only. Raises ValueError for wrong
    values.
    """

    channels: int = key(Whole(1, 16), "transmitters in a frame, the nearest first", default=4)
    rate_hz: float = key(RATE_HZ, "frames a second", default=1.0)
    jitter_s: float = key(
        Number(0, 5, unit="s"), "each frame is up to this late; less than half the period", default=0.0
    )
    kappa_eq: float = key(
        Number(0, 1000, above=True), "factor from field to distance; 1.542 is right on average", default=1.542
    )
    sensitivity: Triple = key(
        Numbers(*[Number(0, 1, above=True)] * 3, names="x, y, z"),
        "of the antennas along x, y and z",
        default=(1.0, 0.8, 0.6),
    )
    noise: Noise = key(help="noise of the antennas", default=Noise())
    mount: MountOptions = key(help="its place on the vehicle", default=MountOptions())
    no_signal: tuple[int, int] = key(_NoSignal(), "distance and angle of an empty slot", default=(-1, -1))
    model: str = key(
        Named(RECEIVERS), "the model that computes readings; the model's own keys are beside it", since=2, default=PAPER
    )
    options: Any = key(Anything(), default=None)
    display: DisplayOptions | None = key(help="own law of d; only receivers of pulses use it", since=2, default=None)
    vehicle_noise: VehicleNoiseOptions | None = key(
        help="noise of the motors; only for the model `pulsed`", since=2, default=None
    )
    profile: InitVar[str | None] = key(
        PROFILE, "the file with default keys, or builtin:NAME", since=2, default=None, kw_only=True
    )

    def __post_init__(self, profile: str | None) -> None:
        cls, owner = own_class(self.model)
        object.__setattr__(self, "options", own_options(cls, self.options, owner))

    @classmethod
    def own_class(cls, mapping: Mapping[str, Any]) -> tuple[type[Any] | None, str]:
        """Return the class of the model's own keys."""
        return own_class(valid_value(cls, mapping, "model"))

    def file_keys(self) -> dict[str, Any]:
        """Return the keys with another form in files than in Python."""
        return {} if self.options is None else asdict(self.options)

    @classmethod
    def other_schemas(cls) -> dict[str, Any]:
        """Return the JSON Schemas of the models' own keys."""
        schemas: dict[str, Any] = {}
        for model in RECEIVERS.names():
            for name, one in own_keys(own_class(model)[0]).items():
                schemas.setdefault(name, one.json())
        return schemas

    @classmethod
    def conflicts(cls, of: Any) -> Iterator[Violation]:
        if of.rate_hz is not None and of.jitter_s is not None and of.jitter_s >= 0.5 / of.rate_hz:
            yield Violation(
                f"less than half the period ({0.5 / of.rate_hz:.4g} s)",
                f"jitter_s {of.jitter_s:.4g}",
                path=("jitter_s",),
            )
