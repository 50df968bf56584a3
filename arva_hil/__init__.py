"""Hardware-in-the-loop emulator of an avalanche transceiver (ARVA) receiver.

The names in `__all__` and the events in `arva_hil.events` are public; all others may change at any time.
Names are imported when they are first used.
"""

from __future__ import annotations

import importlib

TYPE_CHECKING = False  # `typing` takes milliseconds to import; Ctrl-C would print a traceback before `main` handles it
if TYPE_CHECKING:
    from typing import Any, Final

    from arva_hil.api import load_scenario, replay, run_live
    from arva_hil.autopilot.following.session import Session
    from arva_hil.bench.bench import Bench, BenchTruth
    from arva_hil.bench.ports import BenchError
    from arva_hil.cli.options import CommandParser
    from arva_hil.config import Fault, FaultKind, Scenario, ScenarioError, Transmitter
    from arva_hil.config.constraints import Number, Whole
    from arva_hil.emulator.engine import Emulator
    from arva_hil.emulator.formats import MavlinkFormat
    from arva_hil.emulator.ports import Output
    from arva_hil.emulator.setup import ReceiverSetup, VehicleSetup, one_vehicle
    from arva_hil.emulator.world import Snapshot
    from arva_hil.errors import ArvaError, KindError, UnknownKindError
    from arva_hil.events import Event, FrameMade
    from arva_hil.links import Address, AddressError, Link, LinkEnded, LinkError, Opening
    from arva_hil.model.field import LocalFrame, Transmitters, dipole_field
    from arva_hil.model.receiver import (
        Answer,
        Antennas,
        ChannelReading,
        Look,
        PaperReceiver,
        Pose,
        Reading,
        ReceiverModel,
        ReceiverSettings,
        Zone,
    )
    from arva_hil.model.receiver.maps import Readings, readings
    from arva_hil.records.reading import Recording
    from arva_hil.records.writing import RecordError
    from arva_hil.runtime.audience import Observer
    from arva_hil.search.strategies.strategy import STILL, Found, Observation, Position, Strategy, Velocity, towards
    from arva_hil.simulated.vehicle import SimulatedVehicle
    from firmware_proto import Format, FrameDecoder

__version__ = "0.1.0"

_MODULES: Final = {
    "api": "load_scenario replay run_live",
    "bench.bench": "Bench BenchTruth",
    "bench.ports": "BenchError",
    "cli.options": "CommandParser",
    "config": "Fault FaultKind Scenario ScenarioError Transmitter",
    "config.constraints": "Number Whole",
    "emulator.engine": "Emulator",
    "emulator.formats": "Format FrameDecoder MavlinkFormat",
    "emulator.ports": "Output",
    "emulator.setup": "ReceiverSetup VehicleSetup one_vehicle",
    "emulator.world": "Snapshot",
    "errors": "ArvaError KindError UnknownKindError",
    "events": "Event FrameMade",
    "model.field": "LocalFrame Transmitters dipole_field",
    "links": "Address AddressError Link LinkEnded LinkError Opening",
    "runtime.audience": "Observer",
    "records.reading": "Recording",
    "records.writing": "RecordError",
    "model.receiver": "Answer Antennas ChannelReading Look PaperReceiver Pose "
    "Reading ReceiverModel ReceiverSettings Zone",
    "model.receiver.maps": "Readings readings",
    "search.strategies.strategy": "STILL Found Observation Position Strategy Velocity towards",
    "simulated.vehicle": "SimulatedVehicle",
    "autopilot.following.session": "Session",
}

__all__ = ["FaultKind", "Number", "Scenario", "ScenarioError", "Whole", "load_scenario", "replay", "run_live"]
__all__ += ["Bench", "BenchError", "BenchTruth"]
__all__ += ["Emulator", "Output", "ReceiverSetup", "VehicleSetup", "one_vehicle"]
__all__ += ["ArvaError", "Event", "FrameMade", "KindError", "UnknownKindError"]
__all__ += ["LocalFrame", "Transmitters", "dipole_field"]
__all__ += ["Address", "AddressError", "Link", "LinkEnded", "LinkError", "Observer", "Opening", "RecordError"]
__all__ += ["Answer", "Antennas", "ChannelReading", "Look", "PaperReceiver", "Pose", "Reading", "Zone"]
__all__ += ["Readings", "ReceiverModel", "ReceiverSettings", "readings"]
__all__ += ["STILL", "Found", "Observation", "Position", "Strategy", "Velocity", "towards"]
__all__ += ["CommandParser", "Fault", "Format", "FrameDecoder", "MavlinkFormat", "Snapshot", "Transmitter"]
__all__ += ["Recording", "Session", "SimulatedVehicle"]


def __getattr__(name: str) -> Any:
    for module, names in _MODULES.items():
        if name in names.split():
            value = globals()[name] = getattr(importlib.import_module(f"{__name__}.{module}"), name)
            return value
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
