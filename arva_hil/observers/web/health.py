"""Vehicles, receivers and links for the page: their state, rates and losses."""

from __future__ import annotations

from typing import Any

from arva_hil import events
from arva_hil.events import Event, StatusReport, VehicleStatus, vehicles
from arva_hil.observers.web.vitals import Vitals
from arva_hil.safe_text import one_line


class Health:
    """Remembers the newest status, which vehicles and links are lost, and why.

    `asked_hz`: the requested rates by message name. `links`: connection strings by the engine's names.
    """

    def __init__(self, asked_hz: dict[str, float], links: dict[str, str]) -> None:
        self._asked_hz = asked_hz
        self._links: dict[str, dict[str, Any]] = {name: _link(address) for name, address in links.items()}
        self._labels: dict[str, str] = {}
        self._silent: set[str] = set()
        self._report: StatusReport | None = None
        self._vitals = Vitals()

    def observe(self, event: Event) -> None:
        if isinstance(event, events.PacketsReceived):
            self._vitals.on_packets(event)
        elif isinstance(event, StatusReport):
            self._report = event
        elif isinstance(event, events.LinkEvent):
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
        self._vitals.forget()
        self._report = None
        for name, link in self._links.items():
            self._links[name] = _link(link["address"])

    def add_link(self, name: str, address: str) -> None:
        """Add an open link."""
        self._links.setdefault(name, _link(address))

    def vehicles(self, now: float = 0.0) -> list[dict[str, Any]]:
        """Return the vehicles, each with its streams, counters, receivers and checks at time `now`."""
        if self._report is None:  # of a search: each vehicle has its packets under its own name
            return [{**self._bare(name), "checks": self._vitals.checks_of_link(name, now)} for name in self._labels]
        every = self._report.vehicles
        return [{**self._vehicle(one), "checks": self._vitals.checks(one.source, now)} for one in every]

    def links(self) -> list[dict[str, Any]]:
        """Return the links, each with address, state, and number and reason of its losses."""
        return [{"name": name, **link} for name, link in self._links.items()]

    def _vehicle(self, status: VehicleStatus) -> dict[str, Any]:
        label = one_line(status.label or self._labels.get(status.name, ""))
        return {
            **self._bare(status.name),
            "label": label,
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

    def _on_link(self, event: events.LinkEvent) -> None:
        if not isinstance(event, events.LinkLost | events.LinkBlocked | events.LinkThere | events.LinkBack):
            return
        link = self._links.setdefault(event.link, _link(event.address))
        link["address"] = one_line(event.address)
        link["open"] = isinstance(event, events.LinkThere | events.LinkBack)
        link["why"] = one_line(event.reason) if isinstance(event, events.LinkLost | events.LinkBlocked) else ""
        link["losses"] += isinstance(event, events.LinkLost)


def _link(address: str) -> dict[str, Any]:
    return {"address": one_line(address), "open": True, "why": "", "losses": 0}
