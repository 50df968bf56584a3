"""The paper's receiver: antennas and noise (eq. 3, 4, 5), output values (eq. 6, 7, 8), and slots."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final, Literal, Self, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from arva_hil.model.field.arrays import Array, require
from arva_hil.model.field.dipole import one_field
from arva_hil.model.field.medium import AIR
from arva_hil.model.field.rotation import Pose
from arva_hil.model.receiver.reading import ChannelReading, Reading, Zone
from arva_hil.model.receiver.receiver_model import Answer, Commands, Impairment, Look, ReceiverSettings, obey

Ints = NDArray[np.int64]

INNER_M: Final = 3.0
MID_M: Final = 50.0
FEW: Final = 24  # transmitters: arrays are faster for more
_SMALLEST: Final = 1e-200  # of a field: d stays finite without a field
_DEGREES: Final = 180 / math.pi
FLOOR_RANGE_M: Final = 80.0  # the paper's r_en
_REFERENCE_NA_M: Final = 2e6 * math.pi  # of a field of 1, if the reference transmitter has 1 µA/m on its axis at 10 m
_Heard = tuple[int, int, int, int]  # d in cm, id, δ in degrees, zone; sorted like slots


NoiseKind = Literal["uniform", "gaussian", "off"]

_AHEAD: Final = 256  # values drawn at a time


def noise_bound(sensitivity: Sequence[float], floor_range_m: float) -> float:
    """Return the largest ‖w‖ (eq. 5), for the reference transmitter: κ‖m‖ = 1."""
    return 1 / (2 * math.pi * max(sensitivity) * floor_range_m**3)


def draw_noise(rng: np.random.Generator, m: int, kind: NoiseKind, bound: float) -> Array:
    """Return noise w (m, 3) in NED, from 3 doubles for each: uniform on the sphere, ‖w‖ ≤ bound.

    Magnitude: `uniform` in [0, bound]; `gaussian` is |N(0, bound/3)|, limited to the bound; `off` is 0 and draws none.
    """
    if kind == "off":
        return np.zeros((m, 3))
    height, azimuth, magnitude = rng.random((m, 3)).T
    if kind == "gaussian":
        from statistics import NormalDist  # slow to import

        inverse = NormalDist().inv_cdf
        magnitude = np.array([min(1.0, -inverse(tail / 2) / 3) for tail in (1 - magnitude).tolist()])
    z, size = 2 * height - 1, bound * magnitude
    across = np.sqrt(1 - z * z) * size
    half = np.tan(np.pi * azimuth)  # tangent of half the azimuth: much faster than cosine and sine
    more = 2 * across / (1 + half * half)  # across · (1 + cosine)
    return np.column_stack((more - across, half * more, z * size))


class NoiseSource:
    """A source of noise of one kind, up to a bound, from a seed. Remembers its generator, and noise drawn in advance.

    Many draws at once take hardly more time than one, and give the same numbers.
    """

    def __init__(self, kind: NoiseKind, bound: float, seed: int) -> None:
        self._kind = kind
        self._bound = bound
        self._rng = np.random.Generator(np.random.PCG64(seed))
        self._ahead: list[list[float]] = []

    def draw(self, m: int) -> Array:
        """Return the next (m, 3), NED: see `draw_noise`."""
        return np.array(self.draw_few(m)).reshape(m, 3)

    def draw_few(self, m: int) -> list[list[float]]:
        """Return `draw` as plain numbers."""
        if m > len(self._ahead):
            self._ahead += draw_noise(self._rng, max(m, _AHEAD), self._kind, self._bound).tolist()
        drawn = self._ahead[:m]
        del self._ahead[:m]
        return drawn


@dataclass(frozen=True)
class Antennas:
    """The properties of a receiver's antennas. Raises ValueError if a value is out of range."""

    sensitivity: tuple[float, float, float] = (1.0, 0.8, 0.6)  # diagonal of Q; the paper gives none
    kappa_eq: float = 1.542  # mean of √(1 + 3cos²θ) over a circle
    floor_range_m: float = FLOOR_RANGE_M  # the noise is at most the reference transmitter's field at this distance
    noise: NoiseKind = "uniform"

    @cached_property
    def scale(self) -> float:
        """The d [m] of a field of 1."""
        return math.cbrt(self.kappa_eq / (4 * math.pi))

    @cached_property
    def near(self) -> float:
        """The weakest field of the inner zone."""
        return near(self.kappa_eq, INNER_M)

    def __post_init__(self) -> None:
        try:
            every = [float(q) for q in self.sensitivity]
        except (TypeError, ValueError):
            every = []
        right, kinds = len(every) == 3 and all(0 < q <= 1 for q in every), get_args(NoiseKind)
        require(
            (right, f"sensitivity {self.sensitivity}: expected three values in (0, 1]"),
            (0 < self.kappa_eq < math.inf, f"kappa_eq {self.kappa_eq}: expected above 0"),
            (0 < self.floor_range_m < math.inf, f"floor_range_m {self.floor_range_m}: expected above 0"),
            (self.noise in kinds, f"noise {self.noise!r}: expected one of {', '.join(kinds)}"),
        )


def receive(h: Array, R_r: Array, Q: Array, w: Array) -> Array:
    """Return the signal at the antennas (eq. 3): h_r = R_rᵀ h + Q R_rᵀ w, (..., M, 3) in the receiver's frame.

    h and w (..., M, 3) in NED, R_r (..., 3, 3) receiver → NED, Q (3,) the diagonal.
    """
    return h @ R_r + Q * (w @ R_r)


def outputs(h_r: ArrayLike, kappa_eq: float, inner_m: float = INNER_M, mid_m: float = MID_M) -> tuple[Ints, Ints, Ints]:
    """Return (d in cm, δ in degrees, `Zone`), each (...), from the signal at the antennas (..., 3) (eq. 6, 7, 8).

    OUTER gives (−1, −1). h_x = 0 gives δ = ±89 with the sign of h_y. In the inner zone L_xy h_r may be 0.
    `inner_m`, `mid_m`: the largest d of those zones.
    """
    h_r = np.asarray(h_r, float)
    x, y, z = h_r[..., 0], h_r[..., 1], h_r[..., 2]
    flat = np.hypot(x, y)
    d_full, d_xy = distance(np.hypot(flat, z), kappa_eq), distance(flat, kappa_eq)
    inner = d_full <= inner_m
    d = np.where(inner, d_full, d_xy)
    heard = d <= mid_m
    d_cm = np.where(heard, rounded(100 * d), -1)
    delta = rounded(np.degrees(np.arctan2(np.where(x < 0, -y, y), np.abs(x))))
    delta_deg = np.where(heard & ~inner, np.minimum(np.maximum(delta, -89), 89), inner - 1)
    return d_cm.astype(np.int64), delta_deg.astype(np.int64), inner.astype(np.int64) + heard


def near(kappa_eq: float, inner_m: float) -> float:
    """Return the weakest field of the inner zone."""
    return 0.9999 / inner_m**3 * kappa_eq / (4 * math.pi)


def output(
    signal: tuple[float, float, float], scale: float, near: float, inner_m: float, mid_m: float
) -> tuple[int, int, int] | None:
    """Return the output (d in cm, δ in degrees, zone) for a signal at the antennas; None without reception.

    `outputs` in plain numbers, for one transmitter.

    `scale`: d [m] of a field of 1; `near`: a weaker field is not in the inner zone; `inner_m`, `mid_m`: see
    `outputs`.
    """
    x, y, z = signal
    flat = math.hypot(x, y)
    if (field := math.hypot(flat, z)) >= near and (d := scale / math.cbrt(field)) <= inner_m:
        d *= 100
        d_cm = int(d)
        return d_cm + int(2 * (d - d_cm)), 0, 2
    d = scale / math.cbrt(flat if flat > _SMALLEST else _SMALLEST)
    if d > mid_m:
        return None
    d *= 100
    d_cm = int(d)
    turn = math.atan2(-y if x < 0 else y, abs(x)) * _DEGREES
    delta = int(turn)
    delta += int(2 * (turn - delta))  # half away from zero, as d
    delta = delta if delta > -89 else -89
    return d_cm + int(2 * (d - d_cm)), delta if delta < 89 else 89, 1


def distance(h: Array, kappa_eq: float) -> Array:
    """Return d [m] of a field's magnitude (...) (eq. 6, 8). If h is 0, it is a finite distance beyond every zone."""
    return math.cbrt(kappa_eq / (4 * math.pi)) / np.cbrt(np.maximum(h, _SMALLEST))


def rounded(x: Array) -> Array:
    """Round to whole numbers, half away from zero, exactly."""
    whole = np.trunc(x)
    return whole + np.trunc(2 * (x - whole))


class PaperReceiver:
    """The receiver of the paper, a `ReceiverModel`. It takes one sample for each frame, at the frame's instant.

    Remembers its random generator and its last reading. `channels`: the number of slots. `no_signal`: (d, δ) of an
    empty slot. Noise is drawn for every transmitter in each sample: it depends only on seed and number of the sample.

    Commands:

    - `mark ID`: leave out a received transmitter. `unmark ID`: report it again. `unmark`: report all again.
    - `select ID`: report only this one while it is received. `select`: report all.
    - `channels N`: set the number of slots, 1…16.
    - `restart`: undo all of this.
    """

    def __init__(
        self, antennas: Antennas, channels: int = 4, no_signal: tuple[int, int] = (-1, -1), seed: int = 0
    ) -> None:
        require((channels >= 1, f"{channels} channels: expected 1 or more"))
        self._antennas = antennas
        bound = noise_bound(antennas.sensitivity, antennas.floor_range_m)
        self._limit = noise_bound(antennas.sensitivity, FLOOR_RANGE_M)
        self._may_interfere = bound > self._limit
        self._usual = (ChannelReading(None, Zone.OUTER, *no_signal, None),) * channels  # empty slots
        self._noise = NoiseSource(antennas.noise, bound, seed)
        self._beside = np.random.Generator(np.random.PCG64([seed, 1]))  # for interference
        self._heard: list[_Heard] = []  # at the last sample
        self._start()

    @classmethod
    def from_settings(cls, settings: ReceiverSettings, seed: int) -> Self:
        """See `ReceiverModel`."""
        noise = settings.noise
        antennas = Antennas(settings.sensitivity, settings.kappa_eq, noise.floor_range_m, noise.kind)
        return cls(antennas, settings.channels, settings.no_signal, seed)

    def next_look(self, after_s: float, frame_s: float) -> float:
        """See `ReceiverModel`: when a frame is due."""
        return frame_s

    def look(self, look: Look) -> None:
        """See `ReceiverModel`. Without a pose every slot is empty, but the noise is drawn too."""
        own = self._noise.draw_few(len(look.transmitters.ids))
        w = own if look.noise is None else look.noise.tolist()
        may_interfere = self._may_interfere or look.noise is not None
        interference = may_interfere and bool((np.linalg.norm(w, axis=1) > self._limit).any())
        if look.pose is None:
            self._heard = []
            self._reading = Reading(self._empty, interference, False)
            return
        heard, ranges = self._hear(look, look.pose, w)
        heard.sort()
        self._heard = heard
        if self._marked or self._selected is not None:
            heard = self._wanted(heard)
        shown = [
            ChannelReading(id_, zone, d_cm, delta_deg, ranges.pop(id_, None))
            for d_cm, id_, delta_deg, zone in heard[: len(self._empty)]
        ]
        if free := len(self._empty) - len(shown):
            hidden = sorted(ranges.values())[:free]
            shown += [self._usual[0]._replace(true_range_m=metres) for metres in hidden]
            shown += self._empty[len(shown) :]
        self._reading = Reading(tuple(shown), interference, len(heard) > len(shown))

    def show(self, time_s: float) -> Reading:
        """See `ReceiverModel`."""
        return self._reading

    def command(self, time_s: float, name: str, values: Sequence[float]) -> Answer:
        """See `ReceiverModel`."""
        commands: Commands = {
            "mark": (range(1, 2), self._mark),
            "unmark": (range(2), self._unmark),
            "select": (range(2), self._select),
            "channels": (range(1, 2), self._set_channels),
            "restart": (range(1), self._start),
        }
        return obey(commands, name, values)

    def _hear(self, look: Look, pose: Pose, w: list[list[float]]) -> tuple[list[_Heard], dict[int, float]]:
        """Return the received transmitters, and the true ranges of all transmitters by id."""
        t, antennas = look.transmitters, self._antennas
        if len(t.ids) > FEW or t.medium is not AIR or look.impairment is not None:
            h_r = receive(t.field_at(pose.position), pose.rotation, np.array(antennas.sensitivity), np.array(w))
            if look.impairment is not None:
                h_r = self._impaired(h_r, look.impairment)
            columns = (column.tolist() for column in outputs(h_r, antennas.kappa_eq))
            every = zip(t.ids, *columns, strict=True)
            return [(d_cm, id_, delta, zone) for id_, d_cm, delta, zone in every if zone], t.ranges(pose.position)
        heard, ranges = [], {}
        north, east, down = pose.position.tolist()
        (nx, ny, nz), (ex, ey, ez), (dx, dy, dz) = pose.rotation.tolist()
        qx, qy, qz = antennas.sensitivity
        scale, near = antennas.scale, antennas.near
        for id_, (pn, pe, pd, *moment), (wn, we, wd) in zip(t.ids, t.dipoles, w, strict=True):
            metres, hn, he, hd = one_field(north - pn, east - pe, down - pd, *moment)
            if id_ not in t.unplaced:
                ranges[id_] = metres
            signal = (  # `receive` in plain numbers
                hn * nx + he * ex + hd * dx + qx * (wn * nx + we * ex + wd * dx),
                hn * ny + he * ey + hd * dy + qy * (wn * ny + we * ey + wd * dy),
                hn * nz + he * ez + hd * dz + qz * (wn * nz + we * ez + wd * dz),
            )
            if one := output(signal, scale, near, INNER_M, MID_M):
                d_cm, delta, zone = one
                heard.append((d_cm, id_, delta, zone))
        return heard, ranges

    def _impaired(self, h_r: Array, wrong: Impairment) -> Array:
        noise = self._beside.standard_normal(h_r.shape) * (wrong.noise_na_m / _REFERENCE_NA_M)
        limit = wrong.saturation_na_m / _REFERENCE_NA_M
        limited: Array = np.clip(h_r * wrong.gains + noise, -limit, limit)
        return limited

    def _start(self) -> None:
        self._marked: set[int] = set()
        self._selected: int | None = None
        self._empty = self._usual
        self._reading = Reading(self._empty, False, False)

    def _wanted(self, heard: list[_Heard]) -> list[_Heard]:
        """Return the transmitters for the frame: those without a mark, or only the selected one."""
        shown = [one for one in heard if one[1] not in self._marked]
        return [one for one in shown if one[1] == self._selected] or shown

    def _hears(self, id_: int | None) -> bool:
        return any(id_ == heard for _, heard, _, _ in self._heard)

    def _mark(self, id_: int) -> bool:
        if not self._hears(id_):
            return False
        self._marked.add(id_)
        self._selected = None if self._selected == id_ else self._selected
        return True

    def _unmark(self, id_: int | None = None) -> bool:
        if id_ is not None and id_ not in self._marked:
            return False
        self._marked -= {id_} if id_ is not None else set(self._marked)
        return True

    def _select(self, id_: int | None = None) -> bool:
        if id_ is not None and (id_ in self._marked or not self._hears(id_)):
            return False
        self._selected = id_
        return True

    def _set_channels(self, count: int) -> bool:
        if not 1 <= count <= 16:
            return False
        self._empty = self._usual[:1] * count
        return True
