"""The common map of all vehicles, the transmitters of a run on it, and the lines of their field."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np

from arva_hil.events import StatusReport
from arva_hil.model.field import LocalFrame, Transmitters
from arva_hil.model.field_lines import MOST, field_lines
from arva_hil.observers.web import jsons

Offset = tuple[float, float, float]  # NED, metres

HERE: Offset = (0.0, 0.0, 0.0)


class Places:
    """Remembers the origin of the map, which is the first place added, and the other origins in that map."""

    def __init__(self) -> None:
        self.origin: tuple[float, float, float] | None = None  # degrees, degrees, metres AMSL
        self._frame: LocalFrame | None = None
        self._offsets: dict[str, Offset] = {}

    def put(self, name: str, lat: float, lon: float, alt: float) -> None:
        """Set the origin of `name`."""
        if self._frame is None:
            self._frame, self.origin = LocalFrame(lat, lon, alt), (lat, lon, alt)
        north, east, down = self._frame.ned(lat, lon, alt).tolist()
        self._offsets[name] = (north, east, down)

    def lat_lon(self, north_m: float, east_m: float) -> tuple[float, float] | None:
        """Return the latitude and longitude [degrees] of a place on the map; None without an origin."""
        if self._frame is None:
            return None
        lat, lon, _ = self._frame.lla([north_m, east_m, 0.0])
        return float(lat), float(lon)

    def offset(self, name: str) -> Offset:
        """Return the place of the origin of `name` in the map."""
        return self._offsets.get(name, HERE)


_MOST_TRANSMITTERS: Final = 256
_MOVED_M: Final = 0.25  # of a transmitter: its lines are computed again
_CLIMBED_M: Final = 1.0  # of the receiver
_HEIGHT_M: Final = 2.5  # of the plane of the lines, before there is a pose


class TransmitterView:
    """Remembers the places of the transmitters, and the last lines with their `version`.

    `text`: the transmitters as JSON. `lines`: `/field.json`.
    """

    def __init__(self, places: Places, kappa_eq: float) -> None:
        self.version = 0
        self.text = "[]"
        self.lines = b'{"version":0,"down_m":null,"transmitters":[],"left_out":0}'
        self._places = places
        self._kappa_eq = kappa_eq
        self._around: dict[str, tuple[Transmitters, Offset]] = {}  # by vehicle
        self._there: Transmitters | None = None  # all of them, in the map
        self._drawn: tuple[Transmitters, float] | None = None

    def observe(self, report: StatusReport) -> None:
        """Use the present places of the transmitters."""
        changed = False
        for vehicle in report.vehicles:
            there = next((r.transmitters for r in vehicle.receivers if r.transmitters is not None), None)
            offset = self._places.offset(vehicle.name)
            before = self._around.get(vehicle.name, (None, offset))
            if there is not None and (there is not before[0] or offset != before[1]):
                self._around[vehicle.name] = there, offset
                changed = True
        if changed:
            self._there, owners = self._merged()
            self.text = _text(self._there, owners)

    def draw(self, down_m: float | None) -> bool:
        """Compute the lines again if transmitters or the plane have moved. Return True if they have.

        `down_m`: of the receiver, NED in the map; None if it is not known.
        """
        there = self._there
        if there is None:
            return False
        plane_m = -_HEIGHT_M if down_m is None or not math.isfinite(down_m) else float(round(down_m))
        if self._drawn is not None and _alike(self._drawn[0], there) and abs(self._drawn[1] - plane_m) <= _CLIMBED_M:
            return False
        self._drawn = there, plane_m
        self.version += 1
        document = {
            "version": self.version,
            "down_m": round(plane_m, 2),
            "transmitters": field_lines(there, plane_m, self._kappa_eq),
            "left_out": max(0, len(there.ids) - MOST),
        }
        self.lines = jsons.dump(document).encode()
        return True

    def _merged(self) -> tuple[Transmitters, list[list[str]]]:
        """Return the transmitters of all vehicles, each place once, and the vehicles whose receivers are among them."""
        every: dict[tuple[Any, ...], tuple[int, Any, Any, float]] = {}
        owners: dict[tuple[Any, ...], list[str]] = {}
        for vehicle, (there, offset) in self._around.items():
            places = there.positions + np.array(offset)
            for i, (id_, place) in enumerate(zip(there.ids, places.tolist(), strict=True)):
                is_placed = id_ not in there.unplaced and np.isfinite(place).all()
                if is_placed and len(every) < _MOST_TRANSMITTERS:
                    key = (id_, *(round(x, 1) for x in place))
                    every.setdefault(key, (id_, place, there.rotations[i], float(there.strengths[i])))
                    owners.setdefault(key, []).append(vehicle)
        ids, positions, rotations, strengths = zip(*every.values(), strict=True) if every else ((), (), (), ())
        n = len(ids)
        merged = Transmitters(
            ids, np.array(positions).reshape(n, 3), np.array(rotations).reshape(n, 3, 3), np.array(strengths)
        )
        return merged, list(owners.values())


def _alike(a: Transmitters, b: Transmitters) -> bool:
    return a is b or (
        a.ids == b.ids
        and bool((abs(a.positions - b.positions) < _MOVED_M).all())
        and bool((abs(a.rotations - b.rotations) < 0.05).all())
    )


def _text(there: Transmitters, owners: list[list[str]]) -> str:
    """Return a list of objects: id, place and axis of the dipole, NED, strength, and vehicles that may receive it."""
    columns = zip(
        there.ids,
        there.positions.round(6).tolist(),
        there.rotations[:, :, 0].round(3).tolist(),
        there.strengths.round(3).tolist(),
        owners,
        strict=True,
    )
    names = ("id", "place", "axis", "strength", "of")
    return jsons.dump([dict(zip(names, one, strict=True)) for one in columns])
