"""Prints every figure that the receiver of pulses must reproduce: computed, expected, and its source.

    python -m tools figures receivers

Ours: the figure follows from a profile of this project alone, and no source confirms it. The sources behind the others
are in docs/explanation/pulsed.md. Exit code 1 if a figure is outside its tolerance.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from arva_hil.model.field.keying import KEYING_CLASSES, Keying, KeyingClass
from arva_hil.model.field.medium import Medium, skin_depth_m
from arva_hil.model.field.vehicle_noise import VehicleNoise
from arva_hil.model.receiver import Answer, Look, Pose
from arva_hil.model.receiver.display import Display
from arva_hil.model.receiver.paper import Antennas, PaperReceiver, draw_noise, noise_bound
from tools.figures.sets import (
    AXIS,
    EQUATOR,
    KAPPA_EQ,
    PAPER,
    Hovering,
    field,
    highest,
    novice,
    options,
    overlap,
    reach,
    sets,
    shown_at,
    transmitters,
)

NORM: Final = "EN 300 718-1 as quoted [S2][S3][S4]"
EN_282: Final = "EN 282:1991 [S1]"
OURS: Final = "ours: follows from a profile of this project, no source"
PHYSICS: Final = "arithmetic"
BOUNCE: Final = "readings of a tester [S12]"
AYUSO: Final = "limits of Ayuso et al. [S15]"


class Row(NamedTuple):
    """One figure. `tolerance`: absolute."""

    name: str
    computed: float
    expected: float
    tolerance: float
    source: str

    @property
    def good(self) -> bool:
        return abs(self.computed - self.expected) <= self.tolerance + 1e-9


# The field


def moment() -> Iterator[Row]:
    """The moment of a transmitter [A m²] from its field on the axis at 10 m."""
    for h10, expected in [(0.5, 3.14e-3), (1.0, 6.28e-3), (2.24, 14.1e-3)]:
        computed = options(reference_ua_m=h10).scale_na_m * 1e-9
        yield Row(f"moment at {h10:g} µA/m, A·m²", computed, expected, 0.005 * expected, f"{PHYSICS}; {NORM}")


def kappa() -> Iterator[Row]:
    angle = (np.arange(20_000) + 0.5) * math.pi / 20_000
    norm = 4 * math.pi * np.linalg.norm(field(np.stack([np.cos(angle), np.sin(angle), 0 * angle], -1)), axis=-1)
    yield Row("κeq: mean over a circle", float(norm.mean()), 1.5420, 1e-4, PHYSICS)
    yield Row("κeq: mean over a sphere", float(np.average(norm, weights=np.sin(angle))), 1.3802, 1e-4, PHYSICS)


def spike() -> Iterator[Row]:
    expected = [0, 0.058, 0.116, 0.172, 0.230, 0.284, 0.338, 0.392, 0.446, 0.500]
    for tilt, share in zip(range(0, 91, 10), expected, strict=True):
        source = f"{PHYSICS}; {AYUSO}"
        yield Row(f"spike, 2 antennas, dipole at {tilt}°, depths", highest(tilt, 2), share, 0.01, source)
    tilts = np.arange(0, 90.01, 0.25)
    every = [highest(float(tilt), 3) for tilt in tilts]
    at = float(tilts[int(np.argmax(every))])
    yield Row("spike, 3 antennas, largest, depths", max(every), 0.250, 0.005, f"{PHYSICS}; {AYUSO}")
    yield Row("spike, 3 antennas, largest at a tilt of, °", at, 12.75, 0.5, PHYSICS)
    for tilt, share in ((0, every[0]), (90, every[-1])):
        yield Row(f"spike, 3 antennas, dipole at {tilt:g}°, depths", share, 0.0, 0.005, PHYSICS)


# Reach


def ranges() -> Iterator[Row]:
    for h10, expected in [(0.5, 43.3), (1.0, 54.5), (2.24, 71.3)]:
        on_axis = reach(6.17, h10, AXIS)
        yield Row(f"range on the axis, {h10:g} µA/m, 6.17 nA/m, m", on_axis, expected, 0.2, PHYSICS)
        beside = reach(6.17, h10, EQUATOR)
        yield Row(f"range beside, {h10:g} µA/m, 6.17 nA/m, m", beside, 0.794 * expected, 0.2, PHYSICS)
    for h10, expected in [(0.5, 18.4), (1.0, 23.2), (2.24, 30.4)]:
        yield Row(f"range of a set that needs 80 nA/m, {h10:g} µA/m, m", reach(80, h10, AXIS), expected, 0.2, EN_282)
    strong, weak = (Display(options(), KAPPA_EQ).shown(0, (h10 * 1e-4, 0, 0)) for h10 in (0.5, 2.24))
    assert strong
    assert weak
    yield Row("strong : weak, the same place, d : d", strong.d_cm / weak.d_cm, 1.648, 0.005 * 1.648, PHYSICS)


# Noise


def noise() -> Iterator[Row]:
    drawn = draw_noise(np.random.default_rng(1), 200_000, "uniform", noise_bound((1.0,), 80.0))
    rms = float(np.sqrt((drawn**2).mean())) * options().scale_na_m
    yield Row("the paper's noise, a component, nA/m", rms, 0.651, 0.01 * 0.651, "the paper, eq. 4; uniform magnitude")
    yield Row("the same, as this receiver has it, nA/m", options().sigma_na_m(80.0), 0.651, 0.00651, "the same")


def bounce() -> Iterator[Row]:
    for name, way, expected, within, source in (
        ("beside", EQUATOR, (62.6, 3.5, 0.098, 12.0), (0.3, 0.2, 0.01, 1.0), f"{BOUNCE}: 64.6, 4.2, 2 of 9"),
        ("on the axis", AXIS, (50.5, 1.84, 0.0, 6.2), (0.2, 0.1, 0.001, 0.5), OURS),
    ):
        made = shown_at(field(55 * np.asarray(way)).tolist(), 0.65, 2.25, 10_000)
        words = ("mean, m", "s.d., m", "blank, share", "direction, s.d., °")
        for what, computed, right, tolerance in zip(words, made, expected, within, strict=True):
            yield Row(f"d at 55 m {name}: {what}", computed, right, tolerance, source)


def spread_law() -> Iterator[Row]:
    for ratio in (6, 10, 30):
        h = ratio * 0.65
        made = shown_at((h / options().scale_na_m, 0.0, 0.0), 0.65, 0.5, 10_000)
        d = (options().scale_na_m * KAPPA_EQ / (4 * math.pi * h)) ** (1 / 3)
        computed = made.sigma_m / d / (0.65 / (3 * h))
        yield Row(f"σ_d/d : σ/(3H), H = {ratio} σ", computed, 1.0, 0.05, PHYSICS)


# Several transmitters


Table = Sequence[tuple[str, KeyingClass, Sequence[float | None], Sequence[float | None]]]

TABLE: Final[Table] = (  # class, shares and P60 of 2, 3, 4 sets; None: not given
    ("analogue", KEYING_CLASSES["analogue"], (0.444, 0.692, 0.828), (0.14, 0.35, 0.59)),
    ("analogue, σ 20 ms", replace(KEYING_CLASSES["analogue"], spread_s=0.020), (None, None, 0.828), (None, None, 0.63)),
    ("analogue, σ 10 ms", replace(KEYING_CLASSES["analogue"], spread_s=0.010), (None, None, 0.828), (None, None, 0.88)),
    ("analogue, σ 5 ms", replace(KEYING_CLASSES["analogue"], spread_s=0.005), (None, None, 0.828), (None, None, 0.96)),
    ("modern", KEYING_CLASSES["modern"], (0.166, 0.303, 0.418), (0.002, 0.010, 0.02)),
    ("80 ms, 0.9…1.1 s", replace(KEYING_CLASSES["modern"], spread_s=0.1), (0.160, 0.297, 0.408), (0.01, 0.03, 0.06)),
)


def overlaps(trials: int = 3000) -> Iterator[Row]:
    for name, kind, shares, long in TABLE:
        made = overlap(kind, trials=trials)
        for n, share, p60 in zip((2, 3, 4), shares, long, strict=True):
            if share is None or p60 is None:
                continue
            yield Row(f"share of pulses touched, {n} × {name}", made.share[n - 2], share, 0.01, OURS)
            source = f"{OURS}; abstract [S6] says 60 %" if (name, n) == ("analogue", 4) else OURS
            yield Row(f"a pair overlaps for a minute, {n} × {name}", made.p60[n - 2], p60, 0.03, source)


# The vehicle, and the medium


def vehicle() -> Iterator[Row]:
    for decibels, factor in [(6, 0.794), (18, 0.501), (30, 0.316)]:
        near, far = (reach(2.25 * 10 ** (db / 20), 1.0, AXIS) for db in (decibels, 0))
        yield Row(f"range with {decibels} dB more noise", near / far, factor, 0.01 * factor, PHYSICS)
    one = VehicleNoise(((0.0, 0.0, 0.0),), motor_na_m=5.2)
    fall = 20 * math.log10(one.sigma_na_m((0, 0, 0.5), 1.0) / one.sigma_na_m((0, 0, 0.2), 1.0))
    yield Row("a motor's noise, 20 → 50 cm, dB", fall, -23.9, 0.239, PHYSICS)
    reaches = [reach(3.46 * one.sigma_na_m((0, 0, pole), 1.0), 1.0, AXIS) for pole in (0.4, 0.8)]
    slope = math.log(reaches[1] / reaches[0]) / math.log(2)
    yield Row("range over pole length, slope", slope, 1.0, 0.01, PHYSICS)


def medium() -> Iterator[Row]:
    for what, conductivity, permittivity, expected, within in (
        ("dry snow", 1e-5, 1.8, 716.0, 7.16),
        ("wet snow", 1e-4, 3.0, 106.0, 1.06),
        ("1 mS/m", 1e-3, 1.5, 24.0, 1.0),
        ("moist soil", 1e-2, 15.0, 7.6, 0.076),
        ("wet soil", 5e-2, 15.0, 3.3, 0.05),
        ("sea water", 4.0, 80.0, 0.37, 0.005),
    ):
        computed = skin_depth_m(conductivity, permittivity)
        yield Row(f"skin depth, {what}, m", computed, expected, within, f"{PHYSICS}; conductivity assumed")
    for what, conductivity, permittivity, expected, within in (
        ("dry snow", 1e-5, 1.8, 0.02, 0.005),
        ("wet snow", 1e-4, 3.0, 0.16, 0.005),
        ("1 mS/m", 1e-3, 1.5, 0.7, 0.05),
    ):
        (factor,) = Medium(snow_skin_depth_m=skin_depth_m(conductivity, permittivity)).loss(np.array([[0.0, 0.0, 2.0]]))
        yield Row(f"loss over 2 m, {what}, dB", -20 * math.log10(factor), expected, within, PHYSICS)
    full = Medium(dipole="full")
    for metres, on_axis, beside in [(20, 1.018, 0.982), (40, 1.071, 0.935), (60, 1.153, 0.883)]:
        for name, way, expected in (("axis", AXIS, on_axis), ("equator", EQUATOR, beside)):
            point = metres * np.asarray(way)
            ratio = float(np.linalg.norm(field(point, medium=full)) / np.linalg.norm(field(point)))
            yield Row(f"full : static dipole, {name}, {metres} m", ratio, expected, 0.01 * expected, "textbook")


def continuity(poses: int = 200) -> Iterator[Row]:
    """Return the number of poses with other integers than the paper's: one set, no noise, hovering, two pulses."""
    rng, different = np.random.default_rng(1), 0
    for _ in range(poses):
        place, (sets_turn, turn) = rng.uniform(-45, 45, 3), Rotation.random(2, rng).as_matrix()
        there = transmitters([0.0, 0.0, 0.0], keyings=[Keying(1.0, 0.08, 0.25)], rotations=[sets_turn])
        paper = PaperReceiver(Antennas(noise="off"), 1)
        paper.look(Look(0.0, Pose(place, turn), there))
        (one,), (other,) = (
            paper.show(0.0).channels,
            Hovering(there, place, turn, channels=1, **PAPER).read(2.4).channels,
        )
        different += (one.id, one.zone, one.d_cm, one.delta_deg) != (other.id, other.zone, other.d_cm, other.delta_deg)
    yield Row(f"not the paper's integers, of {poses} poses", different, 0, 0, "exact")


# Marks


def presses(presses: int = 1000) -> Iterator[Row]:
    """Return how often the first press works: two modern sets side by side, one marked as found at random times."""
    random, done = np.random.default_rng(1), 0
    kind = KEYING_CLASSES["modern"]
    for trial in range(presses // 20):
        receiver = Hovering(transmitters([2.5, 0, 0], [-2.5, 0, 0], keyings=sets(kind, 2, trial)))
        for at in np.sort(random.uniform(20, 200, 20)).tolist():
            receiver.read(at)
            done += receiver.model.command(at, "mark", [1]) is Answer.DONE
    source = f"{OURS}; a band: 1 − 2w/T is 0.83, Pieps says 0.89 [S9]"
    yield Row("first press marks, 2 × modern", done / presses, 0.86, 0.03, source)


def novices(searches: int = 200) -> str:
    missed = sum(novice(seed) > 0 for seed in range(searches))
    return f"four analogue sets, one who follows the nearest: {missed} of {searches} searches miss one or more"


FIGURES: Final[dict[str, Callable[[], Iterator[Row]]]] = {
    one.__name__: one
    for one in (moment, kappa, spike, ranges, noise, bounce, spread_law, overlaps, presses, vehicle, medium, continuity)
}


def main() -> int:
    bad = 0
    for figure in FIGURES.values():
        for row in figure():
            bad += not row.good
            print(
                f"{'ok ' if row.good else 'BAD'} {row.name:58} {row.computed:10.4g} expected {row.expected:8.4g} "
                f"± {row.tolerance:<8.3g} {row.source}"
            )
    print(f"    {novices()} (reported only; people and sets in Davos 2012: about 30 % [S10])")
    return 1 if bad else 0
