"""Residuals of d and δ between two receivers of one flight: by range, zone, angle and time."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from arva_hil.events.words.text import placed
from arva_hil.records.comparing.again import Floats, Paired
from arva_hil.records.reading import NO_ID, RecordedReceiver
from firmware_proto.frame import missing

Mask = NDArray[np.bool_]

TOO_FEW: Final = 10  # readings in common

_RANGES_M: Final = (0.0, 3.0, 5.0, 10.0, 20.0, 30.0, 50.0, math.inf)
_ANGLES_DEG: Final = (-90, -45, 0, 45, 90)
_PARTS: Final = 6  # of the time
_MOST_LAG_S: Final = 3.0
_LAG_STEP_S: Final = 0.05
_FAR_M: Final = 20.0  # report a place with a larger error
_MAD: Final = 1.4826  # scales a median of absolute deviations to a standard deviation


@dataclass(frozen=True)
class Spread:
    """The residuals of some readings: medians as bias, scaled median deviations as scatter.

    d: metres, first minus second. δ: degrees, in the mid zone of both; None without such readings.
    """

    label: str
    count: int
    d_bias_m: float
    d_scatter_m: float
    ratio: float
    """Median of the first d over the second."""
    delta_bias_deg: float | None
    delta_scatter_deg: float | None


@dataclass(frozen=True)
class Comparison:
    """The readings of one transmitter side by side. `id` is None if the frames have no ids.

    `both`, `first_only`, `second_only`: frames in which both, or only one, received it. `lag_s`: the first is later by
    this; None if unknown. `groups`: residuals by "range", "zone", "angle" and "time". `hints`: probable
    mistakes. `time_s`, `first_m`, `second_m`, `first_deg`, `second_deg`, `range_m`: (N,) for pictures, NaN where
    not received.
    """

    id: int | None
    frames: int
    both: int
    first_only: int
    second_only: int
    first_lost: int
    second_lost: int
    lag_s: float | None
    all: Spread | None
    groups: Mapping[str, Sequence[Spread]]
    hints: Sequence[str]
    time_s: Floats
    first_m: Floats
    second_m: Floats
    first_deg: Floats
    second_deg: Floats
    range_m: Floats

    def as_json(self) -> dict[str, Any]:
        """Return everything but the readings as JSON."""
        names = ("id", "frames", "both", "first_only", "second_only", "first_lost", "second_lost", "lag_s")
        return {
            **{name: getattr(self, name) for name in names},
            "all": asdict(self.all) if self.all else None,
            "by": {name: [asdict(one) for one in group] for name, group in self.groups.items()},
            "hints": list(self.hints),
        }


class _Columns(NamedTuple):
    """The readings of one transmitter by both receivers, at each pair of frames."""

    time_s: Floats
    first: Sequence[NDArray[Any]]  # d, δ, zone, true range
    second: Sequence[NDArray[Any]]


Ranges = Mapping[int, Floats]
"""True ranges of transmitters at the frames of the second receiver, by id [m]."""

_NO_RANGES: Final[Ranges] = {}


def compared(
    one: RecordedReceiver, two: RecordedReceiver, pairs: Paired, ranges: Ranges = _NO_RANGES
) -> list[Comparison]:
    """Compare two receivers, for each transmitter that one of them received."""
    ids = [(id_, id_) for id_ in sorted({*one.ids, *two.ids})]
    if any(not receiver.ids and (receiver.zone > 0).any() for receiver in (one, two)):  # frames without ids
        ids = [(_nearest(one), _nearest(two))]
    return [_of_one(one, two, pairs, *both, ranges) for both in ids]


def _nearest(receiver: RecordedReceiver) -> int:
    """Return the transmitter that is most often in the first slot."""
    first = receiver.begins[:-1][receiver.zone[receiver.begins[:-1]] > 0] if len(receiver) else receiver.begins[:0]
    values, counts = np.unique(receiver.id[first], return_counts=True)
    return int(values[counts.argmax()]) if len(values) else NO_ID


def _of_one(
    one: RecordedReceiver, two: RecordedReceiver, pairs: Paired, id_1: int, id_2: int, ranges: Ranges
) -> Comparison:
    first: list[NDArray[Any]] = [column[pairs.first] for column in one.of_transmitter(id_1)]
    second: list[NDArray[Any]] = [column[pairs.second] for column in two.of_transmitter(id_2)]
    if id_2 in ranges:
        second[3] = ranges[id_2][pairs.second]
    columns = _Columns(one.time_s[pairs.first], first, second)
    heard_1, heard_2 = first[2] > 0, second[2] > 0
    both = heard_1 & heard_2
    range_m = np.where(np.isfinite(second[3]), second[3], first[3])
    # from each first frame to its second one, by the autopilot's clock; 0 without a pose
    later_s = np.nan_to_num(two.boot_ms[pairs.second] - one.boot_ms[pairs.first]) / 1e3
    groups = {
        "range": _by(columns, np.where(np.isfinite(range_m), range_m, second[0]), _RANGES_M, "m"),
        "zone": [
            spread
            for label, zone in (("mid", 1), ("inner", 2))
            if (spread := _spread(label, columns, both & (second[2] == zone)))
        ],
        "angle": _by(columns, second[1], _ANGLES_DEG, "°"),
        "time": _by(columns, columns.time_s, _parts(columns.time_s), "s"),
    }
    return Comparison(
        None if id_1 == NO_ID else id_1,
        len(pairs.first),
        int(both.sum()),
        int((heard_1 & ~heard_2).sum()),
        int((heard_2 & ~heard_1).sum()),
        _lost(one),
        _lost(two),
        _lag_s(columns, later_s) if pairs.how == "time" else None,
        _spread("all", columns, both),
        groups,
        _hints(one, two, pairs, columns, id_2),
        columns.time_s,
        first[0],
        second[0],
        first[1],
        second[1],
        range_m,
    )


def _spread(label: str, c: _Columns, here: Mask) -> Spread | None:
    """Return the residuals of the readings `here`; None without any."""
    here = here & np.isfinite(c.first[0]) & np.isfinite(c.second[0])
    if not here.any():
        return None
    residual = c.first[0][here] - c.second[0][here]
    turned = here & np.isfinite(c.first[1]) & np.isfinite(c.second[1])
    turn = wrapped_half(c.first[1][turned] - c.second[1][turned])
    return Spread(
        label,
        int(here.sum()),
        float(np.median(residual)),
        _scatter(residual),
        float(np.median(c.first[0][here] / np.maximum(c.second[0][here], 0.01))),
        float(np.median(turn)) if len(turn) else None,
        _scatter(turn) if len(turn) else None,
    )


def wrapped_half(degrees: Floats) -> Floats:
    """Return angles in [−90, 90): a receiver does not distinguish front and back."""
    return (degrees + 90) % 180 - 90


def _scatter(values: Floats) -> float:
    return float(_MAD * np.median(np.abs(values - np.median(values))))


def _by(c: _Columns, values: Floats, edges: Sequence[float], unit: str) -> list[Spread]:
    spreads = []
    for low, high in pairwise(edges):
        label = f"{low:g} {unit} …" if math.isinf(high) else f"{low:g} … {high:g} {unit}"
        if spread := _spread(label, c, (values >= low) & (values < high)):
            spreads.append(spread)
    return spreads


def _parts(time_s: Floats) -> Sequence[float]:
    if not len(time_s):
        return (0.0, 1.0)
    first_s, last_s = math.floor(10 * time_s.min()) / 10, math.floor(10 * time_s.max() + 1) / 10
    edges: list[float] = np.linspace(first_s, last_s, _PARTS + 1).round(1).tolist()
    return edges


def _lost(receiver: RecordedReceiver) -> int:
    """Return the number of frames missing in the sequence."""
    numbers = receiver.sequence.tolist()
    return sum(missing(a % 256, b % 256) for a, b in pairwise(numbers) if (b - a) % 256 > 1)


def _lag_s(c: _Columns, later_s: Floats) -> float | None:
    """Return the lag of the first: the shift of the second with which log d fits best."""
    heard = np.isfinite(c.second[0])
    if heard.sum() < TOO_FEW:
        return None
    time_2, log_2 = (c.time_s + later_s)[heard], np.log(np.maximum(c.second[0][heard], 0.01))
    use = np.isfinite(c.first[0])
    time_1, log_1 = c.time_s[use], np.log(np.maximum(c.first[0][use], 0.01))
    inside = (time_1 > time_2[0] + _MOST_LAG_S) & (time_1 < time_2[-1] - _MOST_LAG_S)
    time_1, log_1 = time_1[inside], log_1[inside]
    if len(time_1) < TOO_FEW or np.ptp(log_2) < 0.2:
        return None
    lags = np.arange(-_MOST_LAG_S, _MOST_LAG_S + _LAG_STEP_S / 2, _LAG_STEP_S)
    costs = np.array([_misfit(log_1 - np.interp(time_1 - lag, time_2, log_2)) for lag in lags])
    # Noise averages out between two readings of the second: take the mean over one interval of them.
    half = max(1, round(float(np.median(np.diff(time_2))) / _LAG_STEP_S / 2))
    costs = np.convolve(np.pad(costs, half, "edge"), np.convolve(np.ones(2 * half), [0.5, 0.5]), "valid")
    best = int(costs.argmin())
    if not 0 < best < len(lags) - 1:
        return None
    a, b, d = costs[best - 1 : best + 2]
    bend = a - 2 * b + d
    return float(lags[best] + (_LAG_STEP_S * (a - d) / (2 * bend) if bend > 0 else 0.0))


def _misfit(residual: Floats) -> float:
    """Return the sum of a robust loss, after the median is removed."""
    residual = residual - np.median(residual)
    return float(np.sqrt(1 + (residual / 0.05) ** 2).sum())


def _hints(one: RecordedReceiver, two: RecordedReceiver, pairs: Paired, c: _Columns, id_2: int) -> list[str]:
    """Return sentences on probable mistakes."""
    hints = []
    name = "the transmitter" if id_2 == NO_ID else f"transmitter {id_2}"
    d_m, range_m = c.first[0], c.second[3]
    if np.isfinite(d_m).any():
        nearest = int(np.nanargmin(d_m))
        off_m = range_m[nearest] - 1.2 * d_m[nearest]
        if off_m > _FAR_M:
            there = placed(*one.position[pairs.first[nearest], :2])
            hints.append(
                f"the place of {name} is about {off_m:.0f} m off: the smallest d, {d_m[nearest]:.1f} m, was read at "
                f"{there}, {range_m[nearest]:.0f} m from its place"
            )
        elif not (np.isfinite(range_m) | np.isfinite(c.second[0])).any():
            hints.append(f"{name} has a signal in the first, and none in the second")
    both = int((np.isfinite(d_m) & np.isfinite(c.second[0])).sum())
    if both < TOO_FEW:
        hints.append(f"only {both} readings of {name} in common: the table is worth little below {TOO_FEW}")
    return hints
