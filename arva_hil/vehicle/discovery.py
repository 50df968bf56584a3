"""Finds the vehicle to follow: the first autopilot heard, or the one asked for. Lists other senders on the link."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

from arva_hil.mavlink.codec import Packet, dialect
from arva_hil.vehicle.reasons import HeardSource

_MOST_SOURCES: Final = 32  # that are remembered; a hostile link may have 65,536
_NOT_VEHICLES: Final = {
    dialect.MAV_TYPE_GCS,
    dialect.MAV_TYPE_GIMBAL,
    dialect.MAV_TYPE_ADSB,
    dialect.MAV_TYPE_CAMERA,
    dialect.MAV_TYPE_ONBOARD_CONTROLLER,
    dialect.MAV_TYPE_ANTENNA_TRACKER,
}


@dataclass(frozen=True, slots=True)
class Vehicle:
    """The autopilot that is followed."""

    system: int
    component: int
    autopilot: int  # MAV_AUTOPILOT
    kind: int  # MAV_TYPE
    armed: bool
    version: int  # of MAVLink in its heartbeats

    def __str__(self) -> str:
        return f"{short_name('MAV_AUTOPILOT', self.autopilot)} {self.short}"

    @property
    def short(self) -> str:
        """Its kind and ids, e.g. 'quadrotor 1/1'."""
        return f"{short_name('MAV_TYPE', self.kind)} {self.system}/{self.component}"

    def sent(self, packet: Packet) -> bool:
        """Whether a packet has this vehicle's ids."""
        return packet.system == self.system and packet.component == self.component

    def is_like(self, heartbeat: Any) -> bool:
        """Whether a heartbeat may be from this vehicle."""
        return bool(heartbeat.autopilot == self.autopilot and heartbeat.type not in _NOT_VEHICLES)


class VehicleDiscovery:
    """Remembers the sources heard. `system`, `component`: accept only these (default: any system, component 1)."""

    def __init__(self, system: int | None, component: int | None) -> None:
        self._system = system
        self._component = dialect.MAV_COMP_ID_AUTOPILOT1 if component is None else component
        self._heard: dict[tuple[int, int, str], int] = {}

    def vehicle(self, packet: Packet, heartbeat: Any) -> Vehicle | None:
        """The vehicle that sent a heartbeat; None if it is not an autopilot, or not the one asked for."""
        if (
            packet.system == (self._system or packet.system or -1)
            and packet.component == self._component
            and is_autopilot(heartbeat)
        ):
            armed = bool(heartbeat.base_mode & dialect.MAV_MODE_FLAG_SAFETY_ARMED)
            return Vehicle(packet.system, packet.component, heartbeat.autopilot, heartbeat.type, armed, packet.version)
        self.note(packet, f"heartbeats of {short_name('MAV_TYPE', heartbeat.type)}")
        return None

    def note(self, packet: Packet, kind: str) -> bool:
        """Count a source. Returns whether it is new."""
        key = (packet.system, packet.component, kind)
        if key not in self._heard and len(self._heard) >= _MOST_SOURCES:
            return False
        self._heard[key] = self._heard.get(key, 0) + 1
        return self._heard[key] == 1

    @property
    def sources(self) -> tuple[HeardSource, ...]:
        """The sources heard."""
        return tuple(HeardSource(kind, s, c, n) for (s, c, kind), n in self._heard.items())


def is_autopilot(heartbeat: Any) -> bool:
    """Whether a heartbeat is from an autopilot, not from a ground station or a gimbal."""
    return heartbeat.autopilot != dialect.MAV_AUTOPILOT_INVALID and heartbeat.type not in _NOT_VEHICLES


def short_name(enum: str, value: int) -> str:
    """The name of an enum entry without the prefix of its enum, e.g. 'quadrotor'."""
    entry = dialect.enums[enum].get(value)
    return entry.name.removeprefix(enum + "_").lower() if entry else f"{enum} {value}"
