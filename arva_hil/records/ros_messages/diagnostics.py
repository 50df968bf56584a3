"""The status of a run as ROS diagnostics: one entry for each vehicle and for each receiver."""

from __future__ import annotations

from typing import Final

from arva_hil.events import ReceiverStatus, StatusReport, VehicleStatus
from arva_hil.records.ros_messages.types import DiagnosticArray, DiagnosticStatus, Header, KeyValue
from arva_hil.safe_text import one_line

_OK, _WARNING, _STALE = 0, 1, 3
_PROGRAM: Final = "arva-hil"


def diagnostics(report: StatusReport, header: Header) -> DiagnosticArray:
    """Return the diagnostics of a report."""
    status = []
    for vehicle in report.vehicles:
        status.append(_of_vehicle(vehicle))
        status += [_of_receiver(vehicle.name, receiver) for receiver in vehicle.receivers]
    return DiagnosticArray(header, status)


def _of_vehicle(vehicle: VehicleStatus) -> DiagnosticStatus:
    level, message = (_OK, "received") if vehicle.label else (_WARNING, "no autopilot is received")
    values = [KeyValue(f"{one_line(stream)} [Hz]", f"{rate:.1f}") for stream, rate in vehicle.rates.items()]
    values += [KeyValue(one_line(name), str(count)) for name, count in vehicle.counters]
    return DiagnosticStatus(level, f"{_PROGRAM}: {vehicle.name}", message, one_line(vehicle.label), values)


def _of_receiver(vehicle: str, receiver: ReceiverStatus) -> DiagnosticStatus:
    last = receiver.last
    values = {"frames": str(receiver.frames), "dropped": str(receiver.dropped)}
    level, message = (_OK, "frames are sent") if receiver.frames else (_STALE, "no frame yet")
    if last is not None:
        heard = sum(bool(channel.zone) for channel in last.reading.channels)
        level, message = _OK, f"{heard} heard"
        values["lateness [ms]"] = f"{1e3 * last.late_s:.3f}"
        if last.age_s is not None:
            values["age of the pose [ms]"] = f"{1e3 * last.age_s:.1f}"
        if last.faults:
            values["faults"] = one_line(" ".join(last.faults))
            level, message = _WARNING, f"{heard} received, a fault is active"
        if last.pose is None:
            level, message = _WARNING, "no pose"
    name = f"{_PROGRAM}: {vehicle}/{receiver.name}"
    return DiagnosticStatus(level, name, message, "", [KeyValue(*value) for value in values.items()])
