"""Faults of a receiver's antennas and of what is beside it: dead or detuned, saturated, cold, near electronics."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from arva_hil.config import FaultKind
from arva_hil.config.constraints import Number
from arva_hil.faults.switch import Switch
from arva_hil.receiver import Impairment, Look

_GAIN: Final = Number(0, 1, "a gain")
_SIGNAL: Final = Number(0, 1e9, "nA/m", above=True, unit="nA/m")
_DECIBELS: Final = Number(0, 60, "decibels", above=True, unit="dB")


def _impaired(look: Look, more: Impairment) -> Look:
    return replace(look, impairment=look.impairment.also(more) if look.impairment else more)


def _antenna_x(look: Look, switch: Switch) -> Look:
    return _impaired(look, Impairment(gains=(switch.fault.value, 1.0, 1.0)))


def _antenna_y(look: Look, switch: Switch) -> Look:
    return _impaired(look, Impairment(gains=(1.0, switch.fault.value, 1.0)))


def _antenna_z(look: Look, switch: Switch) -> Look:
    return _impaired(look, Impairment(gains=(1.0, 1.0, switch.fault.value)))


def _cold(look: Look, switch: Switch) -> Look:
    gain = 10 ** (-switch.fault.value / 20)
    return _impaired(look, Impairment(gains=(gain, gain, gain)))


def _saturated(look: Look, switch: Switch) -> Look:
    return _impaired(look, Impairment(saturation_na_m=switch.fault.value))


def _electronics(look: Look, switch: Switch) -> Look:
    return _impaired(look, Impairment(noise_na_m=switch.fault.value))


ANTENNA_X: Final = FaultKind("heard", _GAIN, "the antenna x has this gain: 0 dead, below 1 detuned", _antenna_x)
ANTENNA_Y: Final = FaultKind("heard", _GAIN, "the antenna y has this gain: 0 dead, below 1 detuned", _antenna_y)
ANTENNA_Z: Final = FaultKind("heard", _GAIN, "the antenna z has this gain: 0 dead, below 1 detuned", _antenna_z)
COLD: Final = FaultKind("heard", _DECIBELS, "a cold battery: all antennas hear so much less", _cold)
SATURATION: Final = FaultKind("heard", _SIGNAL, "no antenna says more, as next to a transmitter", _saturated)
ELECTRONICS: Final = FaultKind("heard", _SIGNAL, "something beside it adds noise of this deviation", _electronics)
