"""Random scenarios of a campaign's plan, and the number of transmitters that a search is for."""

from typing import Any, Final, get_args

from arva_hil.config.constraints import Constraint, Named, Number, Numbers, Whole, Word
from arva_hil.config.errors import ConstraintError, wrong
from arva_hil.config.tables import Table, key
from arva_hil.config.transmitter import KeyingKind
from arva_hil.registry import RECEIVERS

_DEPTH: Final = Number(-100, 100, unit="m")


class _Depths(Numbers):
    def read(self, value: Any) -> Any:
        low, high = super().read(value)
        if low > high:
            raise wrong("the smaller one first", f"[{low:g}, {high:g}]")
        return low, high


_FAR: Final = Number(-10_000, 10_000, unit="m")
Area = tuple[float, float, float, float]  # south, west, north, east of home, m


class AreaM(Numbers):
    """An area: south, west, north and east edge."""

    def __init__(self) -> None:
        super().__init__(_FAR, _FAR, _FAR, _FAR, names="south, west, north, east")

    def read(self, value: Any) -> Any:
        south, west, north, east = super().read(value)
        if not (south < north and west < east):
            raise wrong("south, west, north, east", f"[{south:g}, {west:g}, {north:g}, {east:g}]")
        return south, west, north, east


class HowMany(Constraint):
    """The number of transmitters searched for, None: all."""

    kind = "a whole number, or all"
    range = "1…16"
    _number: Final = Whole(1, 16)

    def __str__(self) -> str:
        return "a whole number 1…16, or all"

    def read(self, value: Any) -> int | None:
        if value is None or str(getattr(value, "plain", value)) == "all":
            return None
        try:
            return self._number.read(value)
        except ConstraintError:
            raise wrong(str(self)) from None

    def json(self) -> dict[str, Any]:
        return {"anyOf": [self._number.json(), {"const": "all"}]}


class Random(Table, one_of="within_m area_m"):
    """A scenario with `count` transmitters, drawn by the seed.

    The places are uniform within ±`within_m` north and east of home, or in `area_m`. The depths are uniform from
    `depth_m`[0] to `depth_m`[1], the attitudes uniform among all rotations.
    """

    within_m: float | None = key(
        Number(0, 10_000, above=True, unit="m"), "of home to the north, east, south and west", default=None
    )
    depth_m: tuple[float, float] = key(_Depths(_DEPTH, _DEPTH), "from, to", default=(0.0, 2.0))
    area_m: Area | None = key(AreaM(), "instead: south, west, north, east of home", default=None)
    count: int = key(Whole(1, 16), "the number of transmitters", default=1)
    model: str = key(Named(RECEIVERS), "of the receiver", default="paper")
    keying: KeyingKind | None = key(Word(get_args(KeyingKind)), "of the transmitters: the class of sets", default=None)

    def __str__(self) -> str:
        low, high = self.depth_m
        count = f"{self.count} " if self.count > 1 else ""
        there = f"within {self.within_m:g} m" if self.area_m is None else f"in {list(self.area_m)} m"
        heard = f", {self.model}" if self.model != "paper" else ""
        sent = f", {self.keying}" if self.keying else ""
        return f"{count}random {there} at {low:g} to {high:g} m{heard}{sent}"
