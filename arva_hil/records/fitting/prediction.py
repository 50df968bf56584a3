"""The readings that parameters predict: the signal at the antennas, its logarithm as ln d, and δ."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

import numpy as np

from arva_hil.model.field.dipole import field_of
from arva_hil.records.fitting.flight import Floats, RecordedFlight
from arva_hil.records.fitting.parameters import name_of

_SMALL: Final = 1e-200


class Predicted(NamedTuple):
    """The readings of one flight, each (N,).

    `shown`: the magnitude of the signal that the display uses; the reference transmitter has 1 / 2π on its axis at 1 m.
    `log_d`: ln of d in metres. `delta`: rad.
    """

    shown: Floats
    log_d: Floats
    delta: Floats


def predict(flight: RecordedFlight, model: str, values: Mapping[str, float], shift: Floats | float = 0.0) -> Predicted:
    """Predict a flight's readings from the parameters by name.

    `shift` (3,) or (N, 3): added to the reported positions [m].
    """
    position, body = flight.poses(values["latency"])
    position = position + body @ np.array([values["mount x"], values["mount y"], values["mount z"]]) + shift
    place, moment = _dipoles([name_of(id_) for id_ in flight.ids], values)
    who = flight.who
    h = field_of(position.T[:, None], place[who].T[:, None], moment[who].T[:, None])[:, 0]
    x, y, z = np.einsum("nij,in->jn", body, h)  # in the body frame
    cos, sin = math.cos(values["mount yaw"]), math.sin(values["mount yaw"])
    x, y = cos * x + sin * y, -sin * x + cos * y
    y = y * math.exp(values.get("gain y / x", 0.0))
    if model == "rssi":
        y = z = np.zeros_like(x)
    shown = np.where(flight.inner, np.sqrt(x * x + y * y + z * z), np.hypot(x, y))
    log_d = (values["kappa_eq"] - math.log(4 * math.pi) - np.log(np.maximum(shown, _SMALL))) / 3
    return Predicted(shown, log_d, np.arctan2(y, x))


def _dipoles(names: Sequence[str], values: Mapping[str, float]) -> tuple[Floats, Floats]:
    """Return places (M, 3), and moments (M, 3) for `field_of`."""
    places, moments = [], []
    for name in names:
        places.append([values[f"{name} {axis}"] for axis in ("north", "east", "down")])
        yaw, pitch = values[f"{name} yaw"], values[f"{name} pitch"]
        size = math.exp(values.get(f"{name} strength", 0.0)) / (4 * math.pi)
        axis = [math.cos(pitch) * math.cos(yaw), math.cos(pitch) * math.sin(yaw), -math.sin(pitch)]
        moments.append([size * one for one in axis])
    return np.array(places), np.array(moments)


def residuals(flight: RecordedFlight, predicted: Predicted) -> tuple[Floats, Floats]:
    """Return ln d and δ (N,), recorded minus predicted; δ in [−90°, 90°), NaN without one."""
    turn = flight.delta - predicted.delta
    return np.log(flight.d_m) - predicted.log_d, (turn + math.pi / 2) % math.pi - math.pi / 2
