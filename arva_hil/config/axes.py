"""Sorts of a campaign's plan: what is one value or a list of them, and what is by strategy."""

from collections.abc import Sequence
from typing import Any, Final

from arva_hil.config.mapping_keys import first
from arva_hil.config.mistake import Mistake, Mistakes
from arva_hil.config.sorts import Number, Sort, Whole, list_of, read_list

MANY: Final = 100_000


class Axis(Sort):
    """One value or a list of them, each once; a tuple in Python."""

    def __init__(self, item: Sort, what: str = "values") -> None:
        self.item, self.what, self.unit = item, what, item.unit
        self.low, self.high = 1, MANY

    def __str__(self) -> str:
        return list_of(self.low, self.high, self.what)

    @property
    def kind(self) -> str:
        return f"{self.item.kind}, or a list of them"

    @property
    def range(self) -> str:
        return self.item.range

    def read(self, value: Any) -> tuple[Any, ...]:
        if not isinstance(value, list | tuple):
            return (self.item.read(value),)
        return unique(value, read_list(self, value, self.item.read))

    def json(self) -> dict[str, Any]:
        return one_or_many(self.item.json())


def one_or_many(one: dict[str, Any]) -> dict[str, Any]:
    return {"anyOf": [one, {"type": "array", "items": one, "minItems": 1, "maxItems": MANY}]}


def unique(items: Sequence[Any], values: Sequence[Any]) -> tuple[Any, ...]:
    """The values of some items. Raises Mistakes for those that are there again."""
    seen: dict[Any, Any] = {}
    again = []
    for at, (item, value) in enumerate(zip(items, values, strict=True)):
        if value in seen:
            again.append(Mistake("each once", f"{value} again{first(seen[value])}", where=(at,)))
        seen.setdefault(value, item)
    if again:
        raise Mistakes(again)
    return tuple(values)


class Seeds(Axis):
    """A list of seeds, or how many there are from 1 on."""

    count: Final = Whole(1, 100_000, "a list of seeds, or how many,")

    def read(self, value: Any) -> Any:
        if isinstance(value, list | tuple):
            return super().read(value)
        return value if isinstance(value, range) else range(1, self.count.read(value) + 1)

    @property
    def kind(self) -> str:
        return "a list of seeds, or how many"

    def json(self) -> dict[str, Any]:
        return {"anyOf": [self.count.json(), super().json()["anyOf"][1]]}


class ByStrategy(Sort):
    """One number for all strategies, or a mapping from their names, which is read when they are known."""

    def __init__(self, number: Number) -> None:
        self.number, self.unit = number, number.unit

    @property
    def kind(self) -> str:
        return "a number, or one by strategy"

    @property
    def range(self) -> str:
        return self.number.range

    def read(self, value: Any) -> Any:
        return value if isinstance(value, dict) else self.number.read(value)

    def json(self) -> dict[str, Any]:
        one = self.number.json()
        return {"anyOf": [one, {"type": "object", "additionalProperties": one}]}


class Strategies(Axis):
    """Names that are compared when it is known which strategies there are."""

    def read(self, value: Any) -> Any:
        return value
