"""The readings that parameters predict: the signal at the antennas, its logarithm as ln d, and δ."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from arva_hil.model.field.dipole import field_of
from arva_hil.records.fitting.flight import Floats, RecordedFlight
from arva_hil.records.fitting.parameters import Parameter

_SMALL: Final = 1e-200


class Predicted(NamedTuple):
    """The readings of one flight, each (N,).

    `shown`: the magnitude of the signal that the display uses; the reference transmitter has 1 / 2π on its axis at 1 m.
    `log_d`: ln of d in metres. `delta`: rad.
    """

    shown: Floats
    log_d: Floats
    delta: Floats


class Predictor:
    """Predicts readings from a vector of parameters. Remembers the index of each parameter."""

    def __init__(self, model: str, names: Sequence[Parameter], ids: Sequence[str]) -> None:
        self._model = model
        self._at = {parameter.name: index for index, parameter in enumerate(names)}
        self._ids = ids

    def predict(self, flight: RecordedFlight, theta: Floats, shift: Floats | float = 0.0) -> Predicted:
        """Predict a flight's readings. `shift` (3,) or (N, 3): added to the reported positions [m]."""
        get = self._get(theta)
        position, body = flight.poses(get("latency"))
        position = position + body @ np.array([get("mount x"), get("mount y"), get("mount z")]) + shift
        place, moment = self._dipoles(theta)
        who = flight.who
        h = field_of(position.T[:, None], place[who].T[:, None], moment[who].T[:, None])[:, 0]
        x, y, z = np.einsum("nij,in->jn", body, h)  # in the body frame
        yaw = get("mount yaw")
        cos, sin = math.cos(yaw), math.sin(yaw)
        x, y = cos * x + sin * y, -sin * x + cos * y
        y = y * math.exp(get("gain y / x"))
        if self._model == "rssi":
            y = z = np.zeros_like(x)
        shown = np.where(flight.inner, np.sqrt(x * x + y * y + z * z), np.hypot(x, y))
        log_d = (get("kappa_eq", math.log(1.542)) - math.log(4 * math.pi) - np.log(np.maximum(shown, _SMALL))) / 3
        return Predicted(shown, log_d, np.arctan2(y, x))

    def _get(self, theta: Floats):  # type: ignore[no-untyped-def]
        return lambda name, default=0.0: float(theta[self._at[name]]) if name in self._at else default

    def _dipoles(self, theta: Floats) -> tuple[Floats, Floats]:
        """Return places (M, 3), and moments (M, 3) for `field_of`."""
        get = self._get(theta)
        places, moments = [], []
        for name in self._ids:
            places.append([get(f"{name} {axis}") for axis in ("north", "east", "down")])
            yaw, pitch = get(f"{name} yaw"), get(f"{name} pitch")
            size = math.exp(get(f"{name} strength")) / (4 * math.pi)
            axis = [math.cos(pitch) * math.cos(yaw), math.cos(pitch) * math.sin(yaw), -math.sin(pitch)]
            moments.append([size * one for one in axis])
        return np.array(places), np.array(moments)


def residuals(flight: RecordedFlight, predicted: Predicted) -> tuple[Floats, Floats]:
    """Return ln d and δ (N,), recorded minus predicted; δ in [−90°, 90°), NaN without one."""
    turn = flight.delta - predicted.delta
    return np.log(flight.d_m) - predicted.log_d, (turn + math.pi / 2) % math.pi - math.pi / 2
