"""A receiver that hovers among transmitters, the field and the display of one, and the pulses of several.

Also the sets that a novice misses among them.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from arva_hil.config import Noise, ReceiverOptions
from arva_hil.model.field import Transmitters, dipole_field, rotation
from arva_hil.model.field.keying import KEYING_CLASSES, Keying, KeyingClass, draw_keying
from arva_hil.model.field.medium import Medium
from arva_hil.model.receiver import Answer, Impairment, Look, Pose, Reading, ReceiverModel
from arva_hil.model.receiver.display import Display, PulsedOptions
from arva_hil.model.receiver.listening import normals
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


Array = NDArray[np.float64]

KAPPA_EQ: Final = 1.542
_MINUTE_S: Final = 60.0
AXIS: Final = (1.0, 0.0, 0.0)
EQUATOR: Final = (0.0, 1.0, 0.0)


def options(**more: object) -> PulsedOptions:
    return PulsedOptions(**{"steps": "cm", "start_s": 0.0, **more})  # type: ignore[arg-type]


def field(points: ArrayLike, strength: float = 1.0, medium: Medium | None = None) -> Array:
    """The field (..., 3) at points (..., 3) of a dipole at the origin along x."""
    points = np.asarray(points, float)
    h: Array = dipole_field(points, [[0, 0, 0]], [np.eye(3)], [strength])
    return (medium.applied(h, points[..., None, :]) if medium else h)[..., 0, :]


def highest(tilt_deg: float, antennas: int) -> float:
    """Return the distance beside a tilted dipole at which the signal is strongest, in depths."""
    turned = rotation.to_matrix(rotation.from_euler(0.0, -math.radians(tilt_deg), 0.0))
    x = np.linspace(-1, 1, 20_001)
    h = dipole_field(np.stack([x, 0 * x, -np.ones_like(x)], -1), [[0, 0, 0]], [turned], [1.0])[:, 0]
    return abs(float(x[np.argmax(np.linalg.norm(h[:, :antennas], axis=-1))]))


def reach(threshold_na_m: float, h10: float, way: ArrayLike) -> float:
    """Return the largest true distance [m] with a reading, to 1 mm."""
    display, unit = Display(options(threshold_na_m=threshold_na_m), KAPPA_EQ), 1e-3 * np.asarray(way, float)

    def silent(millimetres: int) -> bool:
        x, y, z = field(millimetres * unit, h10).tolist()
        return display.shown(0, (x, y, z)) is None

    return bisect_left(range(500_000), True, lo=1000, key=silent) / 1e3


class Spread(NamedTuple):
    mean_m: float
    sigma_m: float
    blank: float
    direction_deg: float


def shown_at(signal: Sequence[float], sigma_na_m: float, threshold_na_m: float, pulses: int) -> Spread:
    """Return the displayed values of pulses with noise. `signal`: at the antennas, in reference transmitters."""
    chosen = options(noise_na_m=sigma_na_m, threshold_na_m=threshold_na_m)
    display, draws = Display(chosen, KAPPA_EQ), normals(1)
    sigma = sigma_na_m / chosen.scale_na_m
    every = []
    for _ in range(pulses):
        x, y, z = (value + sigma * noise for value, noise in zip(signal, next(draws), strict=True))
        every.append(display.shown(0, (x, y, z)))
    d = np.array([one.d_cm / 100 for one in every if one])
    directions = np.array([one.delta_deg for one in every if one], float)
    return Spread(float(d.mean()), float(d.std()), 1 - len(d) / pulses, float(directions.std()))


def sets(kind: KeyingClass, n: int, trial: int) -> list[Keying]:
    """Return `n` sets of a class, in any phase to each other."""
    return [draw_keying(kind, trial, id_) for id_ in range(n)]


class Overlap(NamedTuple):
    """Of the first 2, 3, … of some sets. `share`: of a set's pulses that another's touches; `p60`: the probability that
    some pair touches in every pulse for a minute."""

    share: list[float]
    p60: list[float]


def overlap(kind: KeyingClass, most: int = 4, trials: int = 3000, window_s: float = 300.0) -> Overlap:
    shares, long = np.zeros(most + 1), np.zeros(most + 1)
    for trial in range(trials):
        starts = [one.pulses(0.0, window_s).starts for one in sets(kind, most, trial)]
        touched = [np.zeros(len(one), bool) for one in starts]
        stays = False
        for b in range(1, most):
            for a in range(b):
                for one, other in ((a, b), (b, a)):
                    by_other = _touched(starts[one], starts[other], kind.pulse_s)
                    touched[one] |= by_other
                    stays = stays or _stays(starts[one], by_other)
            shares[b + 1] += np.mean([one.mean() for one in touched[: b + 1]])
            long[b + 1] += stays
    return Overlap((shares / trials).tolist()[2:], (long / trials).tolist()[2:])


def _touched(starts: Array, others: Array, pulse_s: float) -> NDArray[np.bool_]:
    """Return True for pulses that another one touches; all have the same length."""
    at = np.searchsorted(others, starts)
    before, behind = others[np.maximum(at - 1, 0)], others[np.minimum(at, len(others) - 1)]
    touched: NDArray[np.bool_] = np.minimum(abs(starts - before), abs(starts - behind)) < pulse_s
    return touched


def _stays(starts: Array, touched: NDArray[np.bool_]) -> bool:
    """Return True if there is a run of touched pulses of a minute."""
    period_s = (starts[-1] - starts[0]) / (len(starts) - 1)
    if touched.sum() * period_s < _MINUTE_S:
        return False
    edges = np.flatnonzero(np.diff(np.concatenate([[False], touched, [False]]).astype(np.int8)))
    return bool((edges[1::2] - edges[::2]).max() * period_s >= _MINUTE_S)


def novice(seed: int) -> int:
    """How many of four analogue sets in 40 × 40 m somebody misses who walks to the nearest that is not marked, 1 m/s,
    marks it within 3 m, and gives up when nothing but marked ones was shown for a minute."""
    random = np.random.default_rng(seed)
    places = np.column_stack([random.uniform(-20, 20, (4, 2)), np.full(4, 1.0)])
    receiver = Hovering(
        transmitters(*places, keyings=sets(KEYING_CLASSES["analogue"], 4, seed)), seed=seed, noise="uniform"
    )
    receiver.position = np.array([-25.0, -25.0, -1.0])
    marked, seen_s, now = set(), 0.0, 0.0
    while now < 900.0 and now - seen_s < 60.0:
        now += 1.0
        shown = [c for c in receiver.read(now).channels if c.zone and not c.marked]
        if not shown:
            continue
        seen_s = now
        nearest = min(shown, key=lambda c: c.d_cm)
        assert nearest.id is not None
        if nearest.d_cm <= 300 and receiver.model.command(now, "mark", [nearest.id]) is Answer.DONE:
            marked.add(nearest.id)
        way = places[nearest.id - 1] - receiver.position
        way[2] = 0.0
        receiver.position = receiver.position + way * min(1.0, 1.0 / max(float(np.linalg.norm(way)), 1e-9))
    return 4 - len(marked)
