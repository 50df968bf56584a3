"""The ground around a scenario's datum, for transmitters with a depth."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from numpy.typing import ArrayLike

from arva_hil.autopilot.following.terrain_requests import LatLon
from arva_hil.config import Scenario, Transmitter
from arva_hil.model.field import LocalFrame


class ScenarioGround:
    """The scenario's grid, or the `heights` [m AMSL] that an autopilot reported for `ground_places`; else level ground.

    With `datum: home` the vehicle stands on the ground there, at any reported altitude.
    """

    def __init__(self, scenario: Scenario, frame: LocalFrame, heights: Mapping[LatLon, float] | None = None) -> None:
        self._grid = scenario.terrain
        self._frame = frame
        self._heights = heights
        self._at_home = scenario.datum == "home"
        self._level = self._grid is None or (self._grid == "autopilot" and heights is None)

    def place(self, transmitter: Transmitter) -> tuple[tuple[float, float, float], float]:
        """Of a transmitter with a depth: its place NED [m], and the ground there, down [m]; NaN if it is not known."""
        lat, lon = lat_lon(transmitter, self._frame)
        north, east, ground = self._frame.ned(lat, lon, self._alt((lat, lon))).tolist()
        if transmitter.ned is not None:
            north, east, level = transmitter.ned
            ground = level if self._level else ground
        return (north, east, ground + (transmitter.depth_m or 0.0)), ground

    def _alt(self, place: LatLon) -> float:
        home = self._frame.lla((0.0, 0.0, 0.0))
        if self._level:
            return float(home[2])
        return self._height(place) + (float(home[2]) - self._height(_rounded(home)) if self._at_home else 0.0)

    def _height(self, place: LatLon) -> float:
        told = (self._heights or {}).get(place) if self._grid == "autopilot" else self._grid.height(*place)
        return math.nan if told is None else told


def ground_places(scenario: Scenario, frame: LocalFrame) -> list[LatLon]:
    """The places with a needed height: each transmitter with a depth, and the datum if it is home."""
    places = [lat_lon(t, frame) for t in scenario.transmitters if t.depth_m is not None]
    return [_rounded(frame.lla((0.0, 0.0, 0.0))), *places] if places and scenario.datum == "home" else places


def lat_lon(transmitter: Transmitter, frame: LocalFrame) -> LatLon:
    """The place of a transmitter at rest."""
    lla = transmitter.lla
    return _rounded((lla.lat, lla.lon) if lla else frame.lla(transmitter.ned or (0.0, 0.0, 0.0)))


def _rounded(place: Sequence[ArrayLike]) -> LatLon:
    lat, lon = (round(float(value), 7) for value in place[:2])  # type: ignore[arg-type]
    return lat, lon
