"""The common map of all vehicles: each has its own datum, and a search its take-off point."""

from __future__ import annotations

from arva_hil.model.field import LocalFrame

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
