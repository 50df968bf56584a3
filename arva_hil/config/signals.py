"""How transmitters send, what lies between them and a receiver, and what the vehicle adds."""

from collections.abc import Iterator
from typing import Annotated, Any, Final, Literal, get_args

from arva_hil.config.common import BODY_POINT, Triple
from arva_hil.config.constraints import ListOf, Number, Word
from arva_hil.config.errors import Violation
from arva_hil.config.tables import Help, table, valid_value

KeyingKind = Literal["modern", "modern-tight", "old-digital", "analogue", "norm-weak", "norm-strong"]
DipoleKind = Literal["static", "full"]

_NOISE: Final = Number(0, 1_000_000, unit="nA/m")


@table()
class KeyingOptions:
    """When a transmitter sends. What is None is drawn from its class, by the scenario's seed and its id.

    Raises ValueError for a period that is not longer than the pulse.
    """

    kind: Annotated[KeyingKind, Word(get_args(KeyingKind)), Help("the class of sets it is of")] = "modern"
    period_s: Annotated[
        float | None, Number(0.05, 60, unit="s"), Help("from pulse to pulse; without it one of the class")
    ] = None
    pulse_s: Annotated[float | None, Number(0.001, 10, unit="s"), Help("length; without it that of the class")] = None
    phase_s: Annotated[
        float | None, Number(0, 60, unit="s"), Help("start of a pulse, from the start of the run; without it random")
    ] = None
    jitter_s: Annotated[float | None, Number(0, 1, unit="s"), Help("standard deviation of each pulse's start")] = None
    carrier_hz: Annotated[
        float | None, Number(-1000, 1000, unit="Hz"), Help("offset from 457 kHz; without it one of the class")
    ] = None
    leak_db: Annotated[float | None, Number(-200, 0, unit="dB"), Help("carrier in the pauses, relative to a pulse")] = (
        None
    )
    from_s: Annotated[
        float | None, Number(0, 1_000_000, unit="s"), Help("sends from then on: switched on, or back from searching")
    ] = None
    battery: Annotated[
        float, Number(0, 1), Help("charge at the start; below 0.2 the output falls, by 3 dB at most")
    ] = 1.0
    battery_life_h: Annotated[float, Number(0, 100_000, above=True, unit="h"), Help("from full to empty")] = 200.0
    temperature_c: Annotated[
        float, Number(-60, 60, unit="°C"), Help("the carrier of an analogue set falls by 1 Hz a degree below 20")
    ] = 20.0

    @classmethod
    def conflicts(cls, holder: Any) -> Iterator[Violation]:
        kind, period_s, pulse_s = (valid_value(cls, holder, name) for name in ("kind", "period_s", "pulse_s"))
        if kind is None or (period_s is None and pulse_s is None):
            return
        from arva_hil.field.keying import KEYING_CLASSES  # slow to import

        usual = KEYING_CLASSES[kind]
        shortest = usual.period_s - usual.spread_s if period_s is None else period_s
        pulse_s = usual.pulse_s if pulse_s is None else pulse_s
        if shortest <= pulse_s:
            key = "pulse_s" if period_s is None else "period_s"
            found = f"a pulse of {pulse_s:g} s in a period of {shortest:g} s"
            yield Violation("a period above the pulse", found, path=(key,))


@table()
class MediumOptions:
    """What lies between transmitters and receivers."""

    dipole: Annotated[
        DipoleKind, Word(get_args(DipoleKind)), Help("the near field alone, or with induction and radiation")
    ] = "static"
    snow_conductivity_s_m: Annotated[
        float, Number(0, 10, unit="S/m"), Help("of what covers them: dry snow 1e-5, wet 1e-4, moist soil 1e-2")
    ] = 0.0
    snow_permittivity: Annotated[float, Number(1, 100), Help("of that, relative: dry snow 1.8, wet 3")] = 1.8
    surface_m: Annotated[float, Number(-10_000, 10_000, unit="m"), Help("its surface, down from the datum")] = 0.0


@table()
class VehicleNoiseOptions:
    """What the vehicle's motors add to a receiver's noise."""

    motors: Annotated[
        tuple[Triple, ...], ListOf(BODY_POINT, 1, 16, "places", unit="m"), Help("body FRD, of each motor")
    ]
    motor_na_m: Annotated[float, _NOISE, Help("of one motor at full throttle, 0.5 m away")] = 5.2
    line_na_m: Annotated[float, _NOISE, Help("of one controller's harmonic in the band, 0.5 m away, always")] = 0.0
