"""Transmitters whose places were surveyed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from arva_hil.config import DEFAULT, Lla, Scenario, Transmitter


class Surveyed(NamedTuple):
    """One transmitter: its id, and its place in degrees, degrees, metres AMSL."""

    id: int
    lat: float
    lon: float
    alt: float


def surveyed_scenario(places: Sequence[Surveyed]) -> Scenario:
    """Return a scenario with these transmitters. Their attitudes are not known, and have the default.

    Without places it has no transmitters. Raises ValueError if an id occurs twice.
    """
    transmitters = tuple(Transmitter(id=one.id, lla=Lla(one.lat, one.lon, one.alt)) for one in places)
    return Scenario(transmitters, source="surveyed places" if places else DEFAULT.source)
