"""The start of a fit: the place and the attitude of a transmitter, the best of many candidates."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from arva_hil.model.field.dipole import field_of
from arva_hil.records.fitting.flight import Floats, RecordedFlight, thinned

_READINGS: Final = 40
_KEEP: Final = 6  # candidates
_LATENCY_S: Final = 0.3
_MOUNT_YAWS: Final = np.arange(-3, 5) * math.pi / 8  # of one antenna: without δ nothing tells its direction
_DOWN_M: Final = (0.0, 1.5, -2.0)


def candidates(flight: RecordedFlight, index: int, surveyed: Floats | None, *, one_antenna: bool) -> list[Floats]:
    """Return starts for transmitter `index`, the best first: north, east, down, yaw, pitch, ln κ, mount yaw."""
    mine = flight.part(flight.who == index)
    some = thinned(mine, _READINGS)
    position, body = some.poses(_LATENCY_S)
    found: list[tuple[float, Floats]] = []
    places = [surveyed] if surveyed is not None else _places(some, position)
    axes = [
        (yaw, pitch)
        for pitch in (0.0, 0.6, -0.6, 1.2)
        for yaw in np.arange(0, math.tau if pitch else math.pi, math.pi / 8)
    ]
    moments = np.array([[math.cos(p) * math.cos(y), math.cos(p) * math.sin(y), -math.sin(p)] for y, p in axes])
    moments /= 4 * math.pi
    for place in places:
        every = np.repeat(position.T[:, None], len(axes), axis=1)  # (3, axes, N)
        b = np.einsum("nij,ian->jan", body, field_of(every, place[:, None, None], moments.T[:, :, None]))
        heard = [_by_one_antenna(b, mount) for mount in _MOUNT_YAWS] if one_antenna else [_by_both(b, some)]
        for size, mount_yaw, spread in heard:
            residual = np.log(some.d_m) + np.log(np.maximum(size, 1e-200)) / 3
            middle = np.median(residual, axis=1)
            cost = np.minimum(np.abs(residual - middle[:, None]) / 0.1, 5).mean(axis=1) + spread
            for at in np.argsort(cost)[:2]:
                log_kappa = 3 * middle[at] + math.log(4 * math.pi)
                found.append((float(cost[at]), np.array([*place, *axes[at], log_kappa, mount_yaw[at]])))
    found.sort(key=lambda one: one[0])
    return [start for _, start in found[:_KEEP]]


def _by_both(b: Floats, some: RecordedFlight) -> tuple[Floats, Floats, Floats]:
    """Return the signals (A, N) of fields (3, A, N), the mount yaws (A,) by δ, and how far δ is from them (A,)."""
    flat = np.hypot(b[0], b[1])
    turn = 2 * (some.delta - np.arctan2(b[1], b[0]))
    turned = np.isfinite(turn)
    mean = np.where(turned, np.exp(1j * np.where(turned, turn, 0)), 0).sum(axis=1)
    off = np.where(turned, np.exp(1j * (np.where(turned, turn, 0) - np.angle(mean)[:, None])) - 1, 0)
    size = np.where(some.inner, np.sqrt(flat**2 + b[2] ** 2), flat)
    return size, -np.angle(mean) / 2, np.minimum(np.abs(off) / 0.4, 5).mean(axis=1)


def _by_one_antenna(b: Floats, mount_yaw: float) -> tuple[Floats, Floats, Floats]:
    """Return the same for the antenna x alone, which has no δ."""
    size = np.abs(math.cos(mount_yaw) * b[0] + math.sin(mount_yaw) * b[1])
    return size, np.full(len(size), mount_yaw), np.zeros(len(size))


def _places(some: RecordedFlight, position: Floats) -> list[Floats]:
    """Return a grid around the poses, fine where d is smallest."""
    nearest = position[np.argsort(some.d_m)[:8]].mean(axis=0)
    low, high = position[:, :2].min(axis=0), position[:, :2].max(axis=0)
    reach = float(np.clip(some.d_m.min() * 1.5, 3, 40))
    ground = position[:, 2].max()
    grid = [
        (n, e)
        for n in np.linspace(low[0] - reach, high[0] + reach, 13)
        for e in np.linspace(low[1] - reach, high[1] + reach, 13)
    ]
    grid += [
        (nearest[0] + n, nearest[1] + e) for n in np.linspace(-reach, reach, 9) for e in np.linspace(-reach, reach, 9)
    ]
    return [np.array([n, e, max(0.0, ground + 0.5) + down]) for n, e in grid for down in _DOWN_M]
