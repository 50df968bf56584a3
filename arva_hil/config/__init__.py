# mypy: implicit-reexport
# ruff: noqa: F401
"""The files of scenarios, their faults, and plans of campaigns. Each key is declared once."""

from arva_hil.config.common import NoiseKind
from arva_hil.config.errors import ScenarioError
from arva_hil.config.faults import Fault, FaultKind, misfit, parse_fault
from arva_hil.config.receiver import MountOptions, Noise, ReceiverOptions
from arva_hil.config.scenario import DEFAULT, Scenario, load, parse, to_dict
from arva_hil.config.tables import newer_keys
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
