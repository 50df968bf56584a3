"""The ground as a grid of heights."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class TerrainGrid:
    """Heights [m AMSL] at the centres of square cells, `cell_deg` wide, of WGS-84 latitude and longitude.

    `heights`: doubles, row by row from the north-western cell, whose centre is at `north_deg`, `west_deg`; NaN is a
    hole. `source`: the file. Raises ValueError if there are not `rows` × `columns` heights, two of each at least.
    """

    source: str
    north_deg: float
    west_deg: float
    cell_deg: float
    rows: int
    columns: int
    heights: bytes

    def __post_init__(self) -> None:
        if min(self.rows, self.columns) < 2 or len(self.heights) != 8 * self.rows * self.columns:
            raise ValueError(f"{len(self.heights) // 8} heights in {self.rows} × {self.columns} cells")

    def height(self, lat_deg: float, lon_deg: float) -> float | None:
        """Return the height [m AMSL], linear between the centres of cells; None outside of them, or beside a hole."""
        down = round((self.north_deg - lat_deg) / self.cell_deg, 6)
        right = round((lon_deg - self.west_deg) / self.cell_deg, 6)
        if not (0 <= down <= self.rows - 1 and 0 <= right <= self.columns - 1):
            return None
        heights = memoryview(self.heights).cast("d")
        row, column = min(int(down), self.rows - 2), min(int(right), self.columns - 2)
        first, (v, u) = row * self.columns + column, (down - row, right - column)
        corners = {first: (1 - v) * (1 - u), first + 1: (1 - v) * u}
        corners |= {first + self.columns: v * (1 - u), first + self.columns + 1: v * u}
        metres: float = sum(heights[at] * share for at, share in corners.items() if share)
        return metres if metres == metres else None
