"""The place of a dipole, from readings at many poses: several hypotheses fitted at once.

A hypothesis is (north, east, down, moment north, east, down, yaw): metres from the take-off point, the moment in
units that make its field h = (3(m·n)n − m)/ρ³ the receiver's own, d = ‖h‖^(−⅓), and the angle by which the receiver
is turned clockwise from its reported pose [rad]: compass and mount are never exact. K hypotheses, N readings.

A reading is one complex number, ln(h_x + i·h_y) = −3 ln d + iδ: the real part of its error is relative to the field,
the imaginary one an angle, known up to the receiver's 180°. In the inner zone d is of the whole field and δ is not
valid: the field's own direction replaces the receiver's x + i·y.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from arva_hil.model.field import rotation

Array = NDArray[np.float64]

# Prior knowledge.
MOMENT: Final = 1 / 1.542  # of the reference transmitter: 1/κeq
_STRENGTH: Final = 0.35  # sigma of the logarithm of a transmitter's strength
_DEPTH: Final = (0.5, 1.2)  # depth below the ground and its sigma, m
_YAW: Final = math.radians(5.0) ** -2  # inverse variance of the yaw
RIDGE: Final = np.diag([1e-4] * 3 + [1e-2] * 3 + [_YAW])  # next to nothing of place and moment

_ONE: Final = np.eye(7)

# Variances of a reading, relative to the field or in radians².
_NOISE: Final = (0.43 / 80.0**3) ** 2  # of the antennas: their bound over 3; times d⁶
_ANY: Final = 1.0  # of a reading without information
_ROUNDED: Final = (0.01 / math.sqrt(12), math.radians(1.0) / math.sqrt(12))  # sigmas of a rounded d [m] and δ
_CHANCE: Final = np.array([0.01**2, 0.02**2])  # of d and of δ, by unknown causes
_SILENCE: Final = (50.0, 0.1**2)  # the limit of reception [m], and its width
_TILT: Final = 0.03  # sigma of the receiver's attitude, rad
TAIL: Final = 9.0  # variances; larger squared errors have less and less weight

POSE_ERRORS: Final = np.geomspace(0.03, 1.0, 10)  # possible sigmas of the receiver's place, m
WIDE: Final = np.geomspace(0.03, 10.0, 16)  # the same for a place that may be wrong
USUAL: Final = (0.1, 0.8)  # prior of such a sigma: its median, and the sigma of its logarithm
_MODESTY: Final = 1.6  # a fit underestimates its own errors

FORGET: Final = 12.0  # drop a hypothesis with e^−12 of the best likelihood
SETTLED: Final = 0.01  # stop after two rounds in a row that reduce a cost by less

MOST: Final = 64  # readings
_NEAREST: Final = 0.1  # m
_EQUAL: Final = 1e-9  # smaller differences are rounding, which differs between processors


# The arguments of `DipoleReadings.add`.
Reading = tuple[Sequence[float], Array, float, float, bool, float, float | None]


class DipoleReadings:
    """Remembers the most informative readings; number 0 is the prior.

    - `told`, `limit`: for the real and the imaginary part of each reading: it is a value; it is an upper bound.
    - `gains`: of the antennas x and y, 0 for a dead one. `lost`: the part of a field that they miss, None or (3, N).
    - `deaf_m`: the distance at which the reference transmitter is no stronger than the noise.
    - `since_s`: earlier readings do not count.
    """

    def __init__(
        self, gains: tuple[float, float] = (1.0, 1.0), deaf_m: float = math.inf, since_s: float = -math.inf
    ) -> None:
        self._antennas = gains, max(_NOISE, deaf_m**-6), since_s
        self._ground = np.full(MOST, math.nan)
        self.lost: NDArray[np.complex128] | None = None
        self._all: tuple[NDArray[Any], ...] = (
            np.full((MOST, 3), 1e3),
            np.ones((MOST, 3), complex),
            np.zeros(MOST, complex),
            np.ones(MOST, bool),
            np.ones((MOST, 2), bool),
            np.zeros((MOST, 2), bool),
            np.ones((MOST, 2)),
            np.zeros(MOST),
        )
        self._show(1)

    def add(
        self,
        position: Sequence[float],
        rotation: Array,
        d: float,
        delta: float,
        inner: bool,
        time_s: float = 0.0,
        ground: float | None = None,
    ) -> None:
        """Add a reading. It replaces the weakest one if there are too many.

        The receiver at `position` NED [m], turned by `rotation` (3, 3) to NED; d in metres, not above 0 when
        there was no signal; δ in radians.
        """
        n = len(self.said)
        i = n if n < MOST else 1 + int(np.argmin(self.said.real[1:]))
        self._put(i, position, rotation[:, 0] + 1j * rotation[:, 1], *self._columns(d, delta, inner, time_s), time_s)
        self._ground[i] = math.nan if ground is None else ground
        self._show(max(n, i + 1))

    def add_all(self, readings: Sequence[Reading]) -> None:
        """Add the first readings, in a tenth of the time of `add`."""
        if not readings:
            return
        positions, rotations, d, delta, inner, times_s, grounds = zip(*readings, strict=True)
        columns = [self._columns(*one) for one in zip(d, delta, inner, times_s, strict=True)]
        strengths = [said.real for said, *_ in columns]
        kept, held = list(range(len(columns)))[: MOST - 1], strengths[: MOST - 1]
        for new in range(MOST - 1, len(columns)):
            weakest = held.index(min(held))
            kept[weakest], held[weakest] = new, strengths[new]
        turned, rows = np.array(rotations)[kept], slice(1, len(kept) + 1)
        said = zip(*(columns[i] for i in kept), strict=True)
        axes = turned[:, :, 0] + 1j * turned[:, :, 1]
        self._put(rows, np.array(positions)[kept], axes, *said, np.array(times_s)[kept])
        self._ground[rows] = [math.nan if grounds[i] is None else grounds[i] for i in kept]
        self._show(len(kept) + 1)

    def _put(self, rows: int | slice, *values: Any) -> None:
        for column, value in zip(self._all, values, strict=True):
            column[rows] = value

    def _columns(self, d: float, delta: float, inner: bool, time_s: float) -> tuple[Any, ...]:
        """Return the values kept of each reading, besides its pose."""
        heard = d > 0
        d = d if heard else _SILENCE[0]
        _, noise, since_s = self._antennas
        noise = min(noise * d**6, _ANY) if time_s >= since_s else _ANY
        noise += 0.0 if heard else _SILENCE[1]
        variance = noise + min(3 * _ROUNDED[0] / d, _ANY) ** 2, noise + _ROUNDED[1] ** 2
        return complex(-3 * math.log(d), delta), inner, (heard, heard and not inner), (not heard, False), variance

    def _show(self, n: int) -> None:
        at, axis, self.said, self.inner, told, limit, self.variance, self.time_s = (column[:n] for column in self._all)
        self.at, self.axis = np.ascontiguousarray(at.T), np.ascontiguousarray(axis.T)  # so sums over 3 are fast
        gains = self._antennas[0]
        if gains != (1.0, 1.0):
            (x, y), (miss_x, miss_y) = gains, (math.sqrt(1 - gain**2) for gain in gains)
            self.lost = miss_x * self.axis.real + 1j * miss_y * self.axis.imag
            self.axis = x * self.axis.real + 1j * y * self.axis.imag
        self.told, self.limit = told.ravel(), limit.ravel()

    @property
    def telling(self) -> DipoleReadings:
        """These readings without a δ that tells nothing: with one antenna it is the same everywhere."""
        if all(self._antennas[0]):
            return self
        there = copy.copy(self)
        there.told = self.told.copy()
        there.told[3::2] = False  # number 0 is the prior
        return there

    @property
    def sloping(self) -> bool:
        """True if the ground below readings is known."""
        return not bool(np.isnan(self._ground).all())

    def level(self, x: Array) -> Array:
        """Return the ground where hypotheses (K, 7) are, down from the take-off point (K,); 0 if it is not known.

        It is the ground below the reading nearest to each.
        """
        if not self.sloping:
            return np.zeros(len(x))
        off = self.at[..., :2, :] - x[:, :2, None]
        level: Array = self._ground[(off[:, 0] ** 2 + off[:, 1] ** 2).argmin(axis=1)]
        return np.where(np.isnan(level), 0.0, level)  # several times as fast as nan_to_num


class Fit(NamedTuple):
    """The agreement of hypotheses with readings; M = 2N, real and imaginary parts in turn."""

    x: Array  # (K, 7)
    cost: Array  # (K,) −ln of the likelihood
    information: Array  # (K, 7, 7) inverse of the covariance
    gradient: Array  # (K, 7) of the cost, the weights held
    error: Array  # (K, M)
    weight: Array  # (K, M)
    slope: Array  # (K, M) squared slope of the error over the receiver's place, 1/m²
    variance: Array  # (K, M) of the error, if the receiver's place were exact
    slopes: Array  # (K, 7, M) of the error over x


def evaluate(x: Array, o: DipoleReadings, pose_error: float | Array, chance: float = 1.0) -> Fit:
    """Compare hypotheses (K, 7) with readings, whose places and axes (K, 3, N) may be others for each.

    `pose_error`: sigma of the receiver's place on each axis, by chance [m]; of all, or (K, 1). `chance`: size of the
    other errors by chance, of its attitude and of unknown causes, in usual ones.
    """
    m, (rho2, n, along, h) = x[:, 3:6, None], _field(x, o)
    h2 = _dot(h, h) + 1e-20
    if o.lost is None:
        axis = np.where(o.inner, h / np.sqrt(h2), o.axis)
    else:
        left = h - (_dot(o.lost, h).conj() * o.lost).real
        axis = np.where(o.inner, left / np.sqrt(np.maximum(_dot(left, h), 1e-20)), o.axis)
    z = _dot(axis, h) + 1e-12
    heard2 = z.real**2 + z.imag**2
    hidden = np.maximum(h2 / heard2 - 1, 0)  # the part of the field that both antennas miss
    error = np.empty((len(x), len(o.said)), complex)  # ln(z/ρ³) by its parts: ten times faster than as complex
    error.real = 0.5 * np.log(heard2 / rho2**3)[:, 0] - o.said.real
    turn = np.arctan2(z.imag, z.real)[:, 0] - o.said.imag - x[:, 6:]  # exact for a level receiver
    error.imag = turn - np.pi * np.rint(turn / np.pi)
    axis = axis / z
    share = _dot(axis, n)
    slopes = np.empty((len(x), 7, len(o.said)), complex)
    slopes[:, :3] = ((1 + 2 * along * share) * n - share * m - along * axis) * (3 / np.sqrt(rho2))
    slopes[:, 3:6], slopes[:, 6] = 3 * share * n - axis, -1j
    m2 = _dot(m, m)[:, 0] + 1e-20
    error[:, 0] = (x[:, 2] - o.level(x) - _DEPTH[0]) / _DEPTH[1] + 1j * np.log(m2[:, 0] / MOMENT**2) / (2 * _STRENGTH)
    slopes[:, :, 0] = 0
    slopes[:, 2, 0], slopes[:, 3:6, 0] = 1 / _DEPTH[1], x[:, 3:6] * (1j / _STRENGTH / m2)

    e, j = error.view(float), slopes.view(float)
    slope = np.add.reduce(j[:, :3] ** 2, axis=1)
    by_chance = (_TILT**2 * hidden[:, 0]).repeat(2, axis=1) + np.tile(_CHANCE, len(o.said))
    variance = chance**2 * by_chance + o.variance.ravel()
    total = pose_error**2 * slope + variance
    squared = e**2 / total
    tail = 1 + squared / TAIL
    loss = TAIL * np.log(tail)
    tail[:, :2], loss[:, :2] = 1, squared[:, :2]  # the prior is no outlier
    used = o.told | (o.limit & (e > _EQUAL))
    weight = used / (total * tail)
    cost = 0.5 * (np.add.reduce(used * loss + o.told * np.log(total), axis=1) + _YAW * x[:, 6] ** 2)
    weighted = j * weight[:, None]
    information = weighted @ j.transpose(0, 2, 1) + RIDGE
    gradient = (weighted @ e[:, :, None])[:, :, 0]
    gradient[:, 6] += _YAW * x[:, 6]
    return Fit(x, cost, information, gradient, e, weight, slope, variance, j)


def of_receiver(x: Array, o: DipoleReadings) -> Array:
    """Return the slopes (K, 6, M) of the errors of `evaluate` over the receiver's gains, and over its lean.

    The gains: logarithms of those of x, y and z. The lean: roll and pitch [1/rad]; the last is the error if the yaw is
    one of the compass: it turns about the vertical, and a mount about the receiver's own axis. For a level receiver
    both are the same.
    """
    *_, h = _field(x, o)
    ahead, right, down = _axes(o.axis)
    parts = np.concatenate([_dot(axis, h) for axis in (ahead, right, down)], axis=1)  # (K, 3, N)
    z = parts[:, :1] + 1j * parts[:, 1:2] + 1e-12
    gains = np.where(o.inner, parts**2 / (_dot(h, h) + 1e-20), parts * np.array([[1], [1j], [0]]) / z)
    across = np.where(o.inner, 0, parts[:, 2:] / z)
    roll, pitch = 1j * across, -across
    compass = x[:, 6:, None] * (ahead[..., 2:, :] * roll + right[..., 2:, :] * pitch)
    slopes = np.concatenate([gains, roll, pitch, compass], axis=1).view(float)
    slopes[:, :, :2] = 0  # number 0 is the prior
    return slopes


def leaning(axis: NDArray[np.complex128], lean: Array, compass: Array) -> NDArray[np.complex128]:
    """Return the axes (K, 3, N) of a receiver with those axes (3, N), if it leans and the compass is off.

    `lean` (K, 2): roll and pitch [rad]. `compass` (K,): the part of the yaw of a hypothesis that turns about the
    vertical [rad].
    """
    about_itself = rotation.to_matrix(rotation.from_euler(lean[:, 0], lean[:, 1], -compass))
    about_vertical = rotation.to_matrix(rotation.from_euler(0.0, 0.0, compass))
    both = about_itself[..., 0] + 1j * about_itself[..., 1]
    leant: NDArray[np.complex128] = np.einsum("kmj,ki,ijn->kmn", about_vertical, both, _axes(axis))
    return leant


def _axes(axis: NDArray[np.complex128]) -> Array:
    """Return the axes x, y and z (3, …, 3, N) of a receiver."""
    return np.array([axis.real, axis.imag, np.cross(axis.real, axis.imag, axis=-2)])


def refine(x: Array, damping: Array, o: DipoleReadings, pose_error: float | Array, rounds: int) -> tuple[Fit, Array]:
    """Return hypotheses (K, 7) after at most so many steps of Levenberg and Marquardt, and the next dampings.

    `dampings` (K,) are those of the first step. It stops when no hypothesis improves.
    """
    now, settled = evaluate(x, o, pose_error), 0
    for _ in range(rounds):
        damped = now.information * (1 + damping[:, None, None] * _ONE)
        new = evaluate(now.x - np.linalg.solve(damped, now.gradient[:, :, None])[:, :, 0], o, pose_error)
        more = _YAW * (new.x[:, 6] ** 2 - now.x[:, 6] ** 2)
        better = np.add.reduce(now.weight * (new.error**2 - now.error**2), axis=1) + more < -_EQUAL
        damping = np.clip(np.where(better, damping / 8, damping * 8), 1e-4, 1e4)
        settled = settled + 1 if (now.cost - new.cost).max() < SETTLED else 0
        now = the_better(now, new, better)
        if settled > 1:
            break
    return now, damping


def the_better(old: Fit, new: Fit, better: NDArray[np.bool_]) -> Fit:
    """Return the new fit for the hypotheses (K,) that are `better`, the old one for the others."""
    if better.all():
        return new
    pairs = zip(old, new, strict=True)
    return Fit(*(np.where(better.reshape(-1, *[1] * (a.ndim - 1)), b, a) for a, b in pairs))


def likely_pose_errors(fit: Fit, of: NDArray[np.intp], o: DipoleReadings, errors: Array) -> tuple[Array, Array]:
    """Return for each hypothesis `of` a fit the likeliest of `errors` of the receiver's place [m], and its cost."""
    total = errors[:, None, None] ** 2 * fit.slope[of] + fit.variance[of]
    tail = np.log1p(_MODESTY * fit.error[of] ** 2 / (TAIL * total))
    cost = 0.5 * np.add.reduce(o.told * (TAIL * tail + np.log(total)), axis=2)
    cost += 0.5 * (np.log(errors / USUAL[0]) / USUAL[1])[:, None] ** 2  # the surprise
    return errors[np.argmin(cost, axis=0)], np.min(cost, axis=0)


def unexplained(x: Array, o: DipoleReadings, error_m: float, variances: float) -> NDArray[np.bool_]:
    """Return the readings (N − 1,) that far off the dipole (7,), by that error of the receiver's place."""
    fit = evaluate(x[None], o, error_m)
    out = fit.error[0] ** 2 > variances * (error_m**2 * fit.slope[0] + fit.variance[0])
    parts: NDArray[np.bool_] = (out & o.told).reshape(-1, 2)[1:]
    return parts[:, 0] | parts[:, 1]


def seeds(position: Sequence[float], bearing: float, d: float, ground: float | None = None) -> Array:
    """Return hypotheses (24, 7) that agree with one reading: on all sides, with a rising, level or sinking field.

    All have the reference strength and about the expected depth. Bearing of the field in radians, d in metres.
    """
    turn, rise = (grid.ravel() for grid in np.meshgrid(np.arange(8) * (np.pi / 4), (-1.5, 0.0, 1.5)))
    h = np.stack([0 * turn + math.cos(bearing), 0 * turn + math.sin(bearing), rise], axis=1)
    n = np.stack(
        [np.cos(bearing + turn), np.sin(bearing + turn), 0 * turn + ((ground or 0.0) + _DEPTH[0] - position[2]) / d],
        axis=1,
    )
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    m = 1.5 * n * np.add.reduce(n * h, axis=1, keepdims=True) - h  # for ρ = d
    rho = d * np.cbrt(MOMENT / np.linalg.norm(m, axis=1, keepdims=True))
    return np.concatenate([position + rho * n, (rho / d) ** 3 * m, 0 * rho], axis=1)


def _field(x: Array, o: DipoleReadings) -> tuple[Array, Array, Array, Array]:
    """Return ρ² of readings from hypotheses (K, 7), their directions n, n·m, and the fields for ρ = 1."""
    m, r = x[:, 3:6, None], o.at - x[:, :3, None]
    rho2 = np.maximum(_dot(r, r), _NEAREST**2)
    n = r / np.sqrt(rho2)
    along = _dot(n, m)
    return rho2, n, along, 3 * along * n - m


def _dot(a: NDArray[Any], b: NDArray[Any]) -> NDArray[Any]:
    """Return a·b (K, 1, N) of vectors (K, 3, N)."""
    product: NDArray[Any] = np.add.reduce(a * b, axis=1, keepdims=True)
    return product
