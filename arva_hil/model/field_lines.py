"""The field on the map: flux lines and lines of equal d in a plane, as polylines.

They are those of a level receiver at the height of the plane: its arrow points along the flux line, and it reports d.
NED, metres.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from arva_hil.model.field.arrays import Array
from arva_hil.model.field.dipole import Transmitters, dipole_field
from arva_hil.model.receiver import Zone, outputs

MOST: Final = 8  # transmitters with lines
EQUAL_D_M: Final = (5.0, 10.0, 20.0, 30.0, 40.0, 50.0)

_TURNS: Final = 90  # directions from the transmitter
_RADII_M: Final = np.geomspace(0.2, 160.0, 320)
_UNHEARD_M: Final = 1e3  # d without a signal
_SEEDS_M: Final = (2.0, 4.0, 7.0, 12.0, 20.0, 32.0)
_STEPS: Final = 110
_FAR_M: Final = 75.0  # lines end there
_NEAR_M: Final = 0.4
_FLAT: Final = 0.3  # horizontal share of a dipole's axis below which the lines are rays


def field_lines(transmitters: Transmitters, down_m: float, kappa_eq: float) -> list[dict[str, Any]]:
    """Return the lines of each of the first transmitters in the horizontal plane at `down_m`.

    `index`: of the transmitter; `place`: its north, east. `flux`: lines, each north, east, north, …; `equal_d`: [d in
    metres, line]; `inner`: the border of the inner zone, if the plane meets it.
    """
    lines = []
    for i, id_ in enumerate(transmitters.ids[:MOST]):
        sends = id_ not in transmitters.unplaced and transmitters.strengths[i] > 0
        if not sends or not np.isfinite(transmitters.positions[i]).all():
            continue
        one = Transmitters(
            (id_,),
            transmitters.positions[i : i + 1],
            transmitters.rotations[i : i + 1],
            transmitters.strengths[i : i + 1],
        )
        equal_d, inner = _equal_d(one, down_m, kappa_eq)
        place = _line(one.positions[:, :2])
        lines.append(
            {"index": i, "id": id_, "place": place, "flux": _flux(one, down_m), "equal_d": equal_d, "inner": inner}
        )
    return lines


def _field(one: Transmitters, points: Array) -> Array:
    field: Array = dipole_field(points, one.positions, one.rotations, one.strengths)[..., 0, :]
    return field


def _equal_d(one: Transmitters, down_m: float, kappa_eq: float) -> tuple[list[list[Any]], list[float]]:
    """Return the outermost places with each d in every direction, and the border of the inner zone."""
    turns = np.linspace(0, 2 * np.pi, _TURNS + 1)
    directions = np.stack([np.cos(turns), np.sin(turns)], axis=-1)
    centre = one.positions[0, :2]
    points = np.empty((len(turns), len(_RADII_M), 3))
    points[..., :2] = centre + _RADII_M[None, :, None] * directions[:, None, :]
    points[..., 2] = down_m
    d_cm, _, zone = outputs(_field(one, points), kappa_eq)
    d = np.where(d_cm > 0, d_cm / 100.0, _UNHEARD_M)
    lines: list[list[Any]] = []
    for level in EQUAL_D_M:
        radii = _outermost(d, level)
        if radii is not None:
            lines.append([level, _line(centre + radii[:, None] * directions)])
    inner = _outermost(np.where(zone == Zone.INNER, 0.0, 1.0), 0.5)
    return lines, [] if inner is None else _line(centre + inner[:, None] * directions)


def _outermost(values: Array, level: float) -> Array | None:
    """Return the largest radius (turns,) where a value is at most the level; None if a direction has none."""
    inside = values <= level
    if not inside.any(axis=1).all():
        return None
    rows = np.arange(len(values))
    last = values.shape[1] - 1 - np.argmax(inside[:, ::-1], axis=1)
    after = np.minimum(last + 1, values.shape[1] - 1)
    low, high = values[rows, last], values[rows, after]
    before = values[rows, np.maximum(last - 1, 0)]
    high = np.where(high >= _UNHEARD_M, low + np.maximum(low - before, 0.01), high)  # as if there were a signal
    share = np.clip((level - low) / np.maximum(high - low, 1e-9), 0.0, 1.0)
    outer: Array = _RADII_M[last] + share * (_RADII_M[after] - _RADII_M[last])
    return outer


def _flux(one: Transmitters, down_m: float) -> list[list[float]]:
    """Return lines along the horizontal field, from places beside the dipole."""
    axis = one.rotations[0, :2, 0]
    flat = float(np.hypot(*axis))
    centre = one.positions[0, :2]
    if flat > _FLAT:
        along, across = axis / flat, np.array([-axis[1], axis[0]]) / flat
        beside = np.array([sign * metres for metres in _SEEDS_M for sign in (-1, 1)])
        seeds = centre + beside[:, None] * across
        seeds = np.concatenate([seeds, centre + np.array([[-6.0], [6.0]]) * along])
    else:
        turns = np.linspace(0, 2 * np.pi, 16, endpoint=False)
        seeds = centre + 5.0 * np.stack([np.cos(turns), np.sin(turns)], axis=-1)
    ahead, back = (_trace(one, seeds, down_m, sign) for sign in (1.0, -1.0))
    lines = []
    for i in range(len(seeds)):
        path = np.concatenate([_ending(back[:, i], centre)[::-1], _ending(ahead[:, i], centre)[1:]])
        if len(path) > 2:
            lines.append(_line(path))
    return lines


def _trace(one: Transmitters, seeds: Array, down_m: float, sign: float) -> Array:
    """Return the places (steps, seeds, 2) along the field; steps grow with the distance from the transmitter."""
    centre, at = one.positions[0, :2], seeds.copy()
    path = [at]
    for _ in range(_STEPS):
        metres = np.clip(0.1 * np.linalg.norm(at - centre, axis=1, keepdims=True), 0.12, 4.0)
        half = at + 0.5 * metres * _direction(one, at, down_m, sign)
        at = at + metres * _direction(one, half, down_m, sign)
        path.append(at)
    return np.array(path)


def _direction(one: Transmitters, at: Array, down_m: float, sign: float) -> Array:
    points = np.column_stack([at, np.full(len(at), down_m)])
    flat = _field(one, points)[:, :2]
    unit: Array = sign * flat / np.maximum(np.linalg.norm(flat, axis=1, keepdims=True), 1e-30)
    return unit


def _ending(path: Array, centre: Array) -> Array:
    """Return a line up to its end: far away, at the transmitter, or where the horizontal field is 0."""
    away = np.linalg.norm(path - centre, axis=1)
    steps = np.diff(path, axis=0)
    back = np.zeros(len(path), bool)
    back[1:-1] = np.add.reduce(steps[:-1] * steps[1:], axis=1) <= 0
    over = np.flatnonzero((away > _FAR_M) | (away < _NEAR_M) | back)
    return path[: over[0] + 1] if len(over) else path


def _line(points: Array) -> list[float]:
    flat: list[float] = np.round(points, 2).ravel().tolist()
    return flat
