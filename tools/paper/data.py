"""The data behind the paper's figures, from the model: the same on every run.

The transmitter is at the origin, its dipole points east (the paper's x), and places are (east, north), metres.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from arva_hil.model.field import Transmitters, dipole_field
from arva_hil.model.field.rotation import from_euler, to_matrix
from arva_hil.model.receiver import Antennas, Zone, maps

Array = NDArray[np.float64]
Ints = NDArray[np.int32]

EAST: Final = to_matrix(from_euler(0, 0, math.pi / 2))  # R_t of a dipole that points east
TRANSMITTER: Final = Transmitters((1,), np.zeros((1, 3)), EAST[None], np.ones(1))
ANTENNAS: Final = Antennas()
SEED: Final = 457


# Figure 2


def field(places: ArrayLike) -> Array:
    """Return the field (..., 2), east and north, at places (..., 2) of the horizontal plane."""
    h: Array = _field(_ned(places))[..., 1::-1]
    return h


def flux_lines(apexes: ArrayLike) -> Array:
    """Return flux lines (K, N, 2) that cross the equator `apexes` (K,) metres north of the transmitter, end to end.

    Traced through the model's field, a step being a share of the distance: to 0.3 % of the apex at either end.
    """
    apex = np.asarray(apexes, float)
    start = np.stack([np.zeros_like(apex), apex], axis=-1)
    way = np.array([-1.0, 1.0])[:, None, None]  # against the field and with it
    step, p = 0.02, np.stack([start, start])
    halves = [p]
    for _ in range(350):
        a = _slope(p) * way
        b = _slope(p + step / 2 * a) * way
        c = _slope(p + step / 2 * b) * way
        d = _slope(p + step * c) * way
        p = p + step / 6 * (a + 2 * b + 2 * c + d)
        halves.append(p)
    against, along = np.stack(halves, axis=2)
    return np.concatenate([against[:, :0:-1], along], axis=1)


def _slope(p: Array) -> Array:
    """Return the field's direction, with the length of the distance to the transmitter."""
    h = field(p)
    slope: Array = h / np.linalg.norm(h, axis=-1, keepdims=True) * np.linalg.norm(p, axis=-1, keepdims=True)
    return slope


def iso_power_line(d: float, count: int = 361) -> Array:
    """Return the line on which a level receiver without noise reads `d` metres: (count, 2), closed."""
    bearing = np.linspace(0, 2 * np.pi, count)
    unit = np.stack([np.sin(bearing), np.cos(bearing)], axis=-1)
    power = np.linalg.norm(field(unit), axis=-1, keepdims=True)
    line: Array = d * np.cbrt(4 * np.pi / ANTENNAS.kappa_eq * power) * unit
    return line


# Figure 3


def poses(n: int, rng: np.random.Generator, level: bool, farthest: float = 90.0) -> tuple[Array, Array]:
    """Return places (n, 3) in NED and R_r (n, 3, 3) of n receivers, true distances uniform up to `farthest` metres.

    `level`: in the dipole's horizontal plane, at any bearing, level, with any heading. Otherwise in any direction
    in space and turned in any way, both uniform on their sphere.
    """
    distance = rng.uniform(0, farthest, (n, 1))
    if level:
        bearing, heading = rng.uniform(0, 2 * np.pi, (2, n))
        places = _ned(distance * np.stack([np.sin(bearing), np.cos(bearing)], axis=-1))
        return places, to_matrix(from_euler(0, 0, heading))
    way, attitude = rng.normal(size=(n, 3)), rng.normal(size=(n, 4))
    return distance * way / np.linalg.norm(way, axis=-1, keepdims=True), to_matrix(attitude)


def readings(places: Array, R_r: Array, seed: int, antennas: Antennas = ANTENNAS) -> tuple[Ints, Ints, Ints]:
    """Return (d in cm, δ in degrees, `Zone`), each (n,), at places (n, 3) and attitudes (n, 3, 3), with noise.

    They are those of a `Receiver` with the same seed at these places in turn.
    """
    d_cm, delta_deg, zone = maps.readings(places, R_r, TRANSMITTER, antennas, seed=seed)
    return d_cm[:, 0], delta_deg[:, 0], zone[:, 0]


def distances(n: int, level: bool, seed: int = SEED) -> tuple[Array, Array]:
    """Return (true distance, d), each (n,), metres, of n random poses; d is −1 without a signal."""
    places, R_r = poses(n, np.random.default_rng(seed), level)
    d_cm, _, zone = readings(places, R_r, seed)
    return np.linalg.norm(places, axis=-1), np.where(zone == Zone.OUTER, -1.0, d_cm / 100)


def share_heard(distance: Array, d: Array, edges: Array) -> Array:
    """Return the share of poses with a signal between each two edges, metres; NaN without a pose."""
    every, heard = (np.histogram(x, edges)[0] for x in (distance, distance[d >= 0]))
    share: Array = np.divide(heard, every, out=np.full(len(every), np.nan), where=every > 0)
    return share


# Figure 5


@dataclass(frozen=True, eq=False)
class Shown:
    """The readings of level receivers, each with its own heading, at N places of the horizontal plane."""

    places: Array  # (N, 2) east, north
    ways: Array  # (N, 2) of length 1: heading and δ; 0 where no δ is given
    d: Array  # (N,) metres; −1 without a signal
    zones: Ints  # (N,)


def grid(east: float, north: float, step: float) -> Array:
    """Return places (N, 2), `step` metres apart, out to ± `east` and ± `north`."""
    x, y = (np.arange(-(half // step), half // step + 1) * step for half in (east, north))
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)


def directions(places: Array, seed: int = SEED, antennas: Antennas = ANTENNAS) -> Shown:
    """Return the directions at places (N, 2), with noise; of the two senses that of the field."""
    heading = np.random.default_rng(seed).uniform(0, 2 * np.pi, len(places))
    d_cm, delta, zones = readings(_ned(places), to_matrix(from_euler(0, 0, heading)), seed, antennas)
    azimuth = heading + np.radians(delta)
    ways = np.stack([np.sin(azimuth), np.cos(azimuth)], axis=-1)
    ways *= np.where((ways * field(places)).sum(axis=-1) < 0, -1.0, 1.0)[:, None]
    ways[zones != Zone.MID] = 0
    return Shown(places, ways, np.where(zones == Zone.OUTER, -1.0, d_cm / 100), zones)


def _ned(places: ArrayLike) -> Array:
    """Return NED (..., 3) of places (..., 2)."""
    places = np.asarray(places, float)
    return np.stack([places[..., 1], places[..., 0], np.zeros(places.shape[:-1])], axis=-1)


def _field(points: Array) -> Array:
    t = TRANSMITTER
    h: Array = dipole_field(points, t.positions, t.rotations, t.strengths)[..., 0, :]
    return h
