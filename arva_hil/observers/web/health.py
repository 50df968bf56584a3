"""Vehicles, receivers and links for the page: their state, rates and losses."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, Final, NamedTuple

from arva_hil import events
from arva_hil.autopilot.following.discovery import Vehicle
from arva_hil.autopilot.following.modes import modes_of
from arva_hil.events import Event, PacketsReceived, StatusReport, VehicleStatus, vehicles
from arva_hil.mavlink.codec import Packet, decode, dialect
from arva_hil.safe_text import one_line

_AUTOPILOT: Final = dialect.MAV_COMP_ID_AUTOPILOT1
_OLD_S: Final = 3.0  # of the newest packet
_LOW, _EMPTY = 30, 15  # % of the battery
_FEW: Final = 6  # satellites
_FIXES: Final = {2: "2D fix", 3: "3D fix", 4: "DGPS fix", 5: "RTK float", 6: "RTK fix"}
_NO_PLACE: Final = "the estimator has no position: wait for GPS, or restart the autopilot"
_ABSOLUTE: Final = dialect.EKF_POS_HORIZ_ABS  # the same bit as ESTIMATOR_POS_HORIZ_ABS
_WRONG: Final = 0.8  # a variance, or a test ratio, that ArduPilot calls bad


Source = tuple[str, int]  # link, system id


class Check(NamedTuple):
    """A line of the health. `level`: good, warn or bad. `cure`: "" if nothing is wrong."""

    level: str
    name: str
    value: str
    cure: str = ""


def _mode(beat: Any) -> Check:
    armed = beat.base_mode & dialect.MAV_MODE_FLAG_SAFETY_ARMED
    mode = f"mode {beat.custom_mode}"
    with contextlib.suppress(ValueError):  # it is neither ArduPilot nor PX4
        mode = modes_of(Vehicle(1, 1, beat.autopilot, beat.type, bool(armed), 2)).name(beat.custom_mode)
    if beat.system_status >= dialect.MAV_STATE_CRITICAL:
        return Check("bad", "mode", f"{mode}, failsafe", "a failsafe acts: watch the vehicle, take the sticks")
    return Check("good", "mode", f"{mode}, {'armed' if armed else 'disarmed'}")


def _battery(status: Any) -> Check | None:
    left = status.battery_remaining
    volts = "" if status.voltage_battery in (0, 0xFFFF) else f"{status.voltage_battery / 1e3:.1f} V"
    value = ", ".join(filter(None, [f"{left} %" if left >= 0 else "", volts]))
    if not value:
        return None
    if 0 <= left < _LOW:
        return Check("bad" if left < _EMPTY else "warn", "battery", value, "land, and change the battery")
    return Check("good", "battery", value)


def _gps(raw: Any) -> Check:
    count = raw.satellites_visible
    value = f"{_FIXES.get(raw.fix_type, 'no fix')}{'' if count == 255 else f', {count} satellites'}"
    if raw.fix_type < 3:
        return Check("bad", "GPS", value, "wait for a fix; the antenna needs a free view of the sky")
    few = count < _FEW
    return Check("warn" if few else "good", "GPS", value, "positions may jump: wait for more satellites" if few else "")


def _estimator(fields: Mapping[str, str], status: Any) -> Check:
    """Judge the estimator. `fields`: of the ratio of each of its sources."""
    ratios: dict[str, float] = {source: getattr(status, field) for source, field in fields.items()}
    if not status.flags & _ABSOLUTE:
        return Check("bad", "EKF", "no position", _NO_PLACE)
    worst = max(ratios, key=lambda name: ratios[name])
    if ratios[worst] >= _WRONG:
        cure = f"its {worst} disagrees: remove metal near by, calibrate the compass, wait for GPS"
        return Check("warn", "EKF", f"{worst} {ratios[worst]:.1f}", cure)
    return Check("good", "EKF", "position known")


CHECKS: Final[Mapping[int, Callable[[Any], Check | None]]] = {  # by message id, in the order of the lines
    dialect.MAVLINK_MSG_ID_HEARTBEAT: _mode,
    dialect.MAVLINK_MSG_ID_SYS_STATUS: _battery,
    dialect.MAVLINK_MSG_ID_GPS_RAW_INT: _gps,
    dialect.MAVLINK_MSG_ID_EKF_STATUS_REPORT: partial(
        _estimator,
        {"velocity": "velocity_variance", "position": "pos_horiz_variance", "compass": "compass_variance"},
    ),
    dialect.MAVLINK_MSG_ID_ESTIMATOR_STATUS: partial(
        _estimator, {"velocity": "vel_ratio", "position": "pos_horiz_ratio", "compass": "mag_ratio"}
    ),
}


class Health:
    """Remembers the newest status, the newest packets of each autopilot, which vehicles and links are lost, and why.

    `asked_hz`: the requested rates by message name.
    """

    def __init__(self, asked_hz: dict[str, float]) -> None:
        self._asked_hz = asked_hz
        self._links: dict[str, dict[str, Any]] = {}  # by the engine's names
        self._labels: dict[str, str] = {}
        self._silent: set[str] = set()
        self._report: StatusReport | None = None
        self._heard_s: dict[Source, float] = {}
        self._newest: dict[Source, dict[int, Packet]] = {}  # by message

    def observe(self, event: Event) -> None:
        if isinstance(event, events.PacketsReceived):
            self._on_packets(event)
        elif isinstance(event, StatusReport):
            self._report = event
        elif isinstance(event, events.LinkLost | events.LinkBlocked | events.LinkThere | events.LinkBack):
            self._on_link(event)
        elif isinstance(event, vehicles.VehicleFound | vehicles.VehicleBack | vehicles.VehicleRebooted):
            self._labels[event.vehicle] = event.label
            self._silent.discard(event.vehicle)
        elif isinstance(event, vehicles.VehicleLost):
            self._silent.add(event.vehicle)
        elif isinstance(event, vehicles.StreamRateLowered):
            self._asked_hz = {**self._asked_hz, event.stream: event.next_hz}

    def forget(self) -> None:
        """Forget the past."""
        self._labels.clear()
        self._silent.clear()
        self._heard_s.clear()
        self._newest.clear()
        self._report = None
        for name, link in self._links.items():
            self._links[name] = _link(link["address"])

    def add_link(self, name: str, address: str) -> None:
        """Add an open link."""
        self._links.setdefault(name, _link(address))

    def vehicles(self, now: float = 0.0) -> list[dict[str, Any]]:
        """Return the vehicles, each with its streams, counters, receivers and checks at time `now`."""
        if self._report is None:  # of a search: each vehicle has its packets under its own name
            sources = {link: (link, system) for link, system in reversed(self._heard_s)}
            return [{**self._bare(name), "checks": self._checks(sources.get(name), now)} for name in self._labels]
        return [{**self._vehicle(one), "checks": self._checks(one.source, now)} for one in self._report.vehicles]

    def links(self) -> list[dict[str, Any]]:
        """Return the links, each with address, state, and number and reason of its losses."""
        return [{"name": name, **link} for name, link in self._links.items()]

    def _on_packets(self, event: PacketsReceived) -> None:
        """Keep the newest packets of each kind."""
        for packet in event.packets:
            if packet.component == _AUTOPILOT and not packet.refused:
                source = event.link, packet.system
                self._heard_s[source] = event.time_s
                if packet.msgid in CHECKS:
                    self._newest.setdefault(source, {})[packet.msgid] = packet

    def _checks(self, source: Source | None, now: float) -> list[Check]:
        """Return the lines of a vehicle; none for values that it does not report."""
        if source not in self._heard_s:
            return []
        newest = self._newest.get(source, {})
        age_s = max(0.0, now - self._heard_s[source])
        cure = "" if age_s < _OLD_S else "is it powered, and in range of its link?"
        packets = ((check, newest[id_]) for id_, check in CHECKS.items() if id_ in newest)
        lines = [check(message) for check, packet in packets if (message := decode(packet)) is not None]
        lines.append(Check("bad" if cure else "good", "link", f"{age_s:.1f} s ago", cure))
        return [line for line in lines if line]

    def _vehicle(self, status: VehicleStatus) -> dict[str, Any]:
        return {
            **self._bare(status.name),
            "label": one_line(status.label or self._labels.get(status.name, "")),
            "streams": [
                {"name": name, "hz": round(hz, 1), "asked_hz": self._asked_hz.get(name)}
                for name, hz in status.rates.items()
                if hz or name in self._asked_hz
            ],
            "counters": dict(status.counters),
            "receivers": [
                {"name": one_line(r.name), "frames": r.frames, "dropped": r.dropped} for r in status.receivers
            ],
        }

    def _bare(self, name: str) -> dict[str, Any]:
        return {
            "name": one_line(name),
            "label": one_line(self._labels.get(name, "")),
            "silent": name in self._silent,
            "streams": [],
            "counters": {},
            "receivers": [],
            "checks": [],
        }

    def _on_link(self, event: events.LinkLost | events.LinkBlocked | events.LinkThere | events.LinkBack) -> None:
        link = self._links.setdefault(event.link, _link(event.address))
        link["address"] = one_line(event.address)
        link["open"] = isinstance(event, events.LinkThere | events.LinkBack)
        link["why"] = one_line(event.reason) if isinstance(event, events.LinkLost | events.LinkBlocked) else ""
        link["losses"] += isinstance(event, events.LinkLost)


def _link(address: str) -> dict[str, Any]:
    return {"address": one_line(address), "open": True, "why": "", "losses": 0}
