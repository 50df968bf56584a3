"""The medium between transmitter and receiver: the full dipole field of a carrier, and the loss in snow or soil.

Sources of the numbers: docs/explanation/pulsed.md.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from arva_hil.model.field.arrays import Array, require
from arva_hil.model.field.keying import CARRIER_HZ

DipoleKind = Literal["static", "full"]

_LIGHT_M_S: Final = 299_792_458.0
_MU_0: Final = 4e-7 * math.pi
_EPSILON_0: Final = 1 / (_MU_0 * _LIGHT_M_S**2)
_OMEGA: Final = 2 * math.pi * CARRIER_HZ
_WAVE_NUMBER: Final = _OMEGA / _LIGHT_M_S  # 1/m


def skin_depth_m(conductivity_s_m: float, permittivity: float = 1.0) -> float:
    """Return the depth [m] at which a field at 457 kHz has fallen to 1/e; infinite without conductivity.

    `permittivity`: relative to that of the vacuum.
    """
    epsilon = permittivity * _EPSILON_0
    loss = conductivity_s_m / (_OMEGA * epsilon)
    # √(1 + x²) − 1, exact for small x
    root = loss * loss / (math.sqrt(1 + loss * loss) + 1)
    return math.inf if root == 0 else 1 / (_OMEGA * math.sqrt(_MU_0 * epsilon / 2 * root))


@dataclass(frozen=True)
class Medium:
    """The medium between transmitters and receivers.

    - `dipole`: the static dipole field, or the field with its induction and radiation terms.
    - `snow_skin_depth_m`: the skin depth of the cover of a transmitter.
    - `surface_m`: the surface of the cover, down from the datum; one for all, or (M,) of each.

    The loss is that of the path straight up: exp(−depth / skin depth). The phase between the radial and the transverse
    part of the full field, 11° at 60 m, is left out.
    """

    dipole: DipoleKind = "static"
    snow_skin_depth_m: float = math.inf
    surface_m: float | Array = 0.0

    def __post_init__(self) -> None:
        require((self.snow_skin_depth_m > 0, f"snow_skin_depth_m {self.snow_skin_depth_m:g}: expected above 0"))

    def applied(self, h: Array, r: Array) -> Array:
        """Return the field (..., M, 3) in this medium from that of static dipoles.

        `r` (..., M, 3): from each to the point.
        """
        if self.dipole == "full":
            squared = np.add.reduce(r * r, axis=-1, keepdims=True)
            along = r * (np.add.reduce(h * r, axis=-1, keepdims=True) / np.maximum(squared, 1e-300))
            kr2 = _WAVE_NUMBER**2 * squared
            h = along * np.sqrt(1 + kr2) + (h - along) * np.sqrt((1 - kr2) ** 2 + kr2)
        return h

    def loss(self, positions: Array) -> Array:
        """Return the factor (M,) of each transmitter at positions (M, 3), NED, for the snow above it."""
        depth = np.maximum(positions[:, 2] - self.surface_m, 0.0)
        factor: Array = np.exp(-depth / self.snow_skin_depth_m)
        return factor


AIR: Final = Medium()
