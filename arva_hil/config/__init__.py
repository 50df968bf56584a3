# mypy: implicit-reexport
# ruff: noqa: F401
"""The files of scenarios, their faults, and plans of campaigns. Each key is declared once.

The ranges here are those of commands' options too: importing them imports nothing else.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from arva_hil.lazy_names import lazy_names

if TYPE_CHECKING:
    from arva_hil.config.common import NOISE_KINDS, RATE_HZ, SEED, NoiseKind, Pose, Triple
    from arva_hil.config.errors import Problem, ScenarioError
    from arva_hil.config.faults import Fault, FaultKind, misfit, parse_fault, plain_fault
    from arva_hil.config.receiver import MountOptions, Noise, ReceiverOptions, SlingOptions
    from arva_hil.config.scenario import DEFAULT, Datum, Scenario, load, parse, parts_of_spec_2, to_dict
    from arva_hil.config.transmitter import (
        Follows,
        KeyingOptions,
        Lla,
        MediumOptions,
        Path,
        Transmitter,
        VehicleNoiseOptions,
    )
    from arva_hil.config.vehicles import NavigationError, ReceiverConfig, VehicleConfig

FRAMES_HZ: Final = (0.1, 50)  # from, to
LARGEST_SEED: Final = 2**63 - 1
_MODULES: Final = {
    "faults": "Fault FaultKind misfit parse_fault plain_fault",
    "common": "NOISE_KINDS RATE_HZ SEED NoiseKind Pose Triple",
    "receiver": "MountOptions Noise ReceiverOptions SlingOptions",
    "scenario": "DEFAULT Datum Scenario load parse parts_of_spec_2 to_dict",
    "transmitter": "Follows KeyingOptions Lla MediumOptions Path Transmitter VehicleNoiseOptions",
    "vehicles": "NavigationError ReceiverConfig VehicleConfig",
    "errors": "Problem ScenarioError",
}

__getattr__ = lazy_names(__name__, _MODULES)
