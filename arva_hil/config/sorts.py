"""Sorts of values: what a key takes, written once. Range, unit and wording of a mistake and of the JSON Schema come
from here.

A sort reads the text of a file (`Scalar`) and a value of Python alike. Importing this does not import pydantic.
"""

from __future__ import annotations

import math
import numbers
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, get_args

from arva_hil.config.mistake import Mistake, each
from arva_hil.config.tree import Items, Scalar

if TYPE_CHECKING:
    from pydantic import GetCoreSchemaHandler, GetJsonSchemaHandler
    from pydantic.json_schema import JsonSchemaValue
    from pydantic_core import CoreSchema


FLOAT: Final = re.compile(r"[-+]?((0|[1-9][0-9]*)(\.[0-9]*)?|\.[0-9]+)([eE][-+]?[0-9]+)?")
WHOLE: Final = re.compile(r"[-+]?(0|[1-9][0-9]{0,18})")
_TYPED: Final = {ord("\N{MINUS SIGN}"): "-", ord("\N{EN DASH}"): "-", ord(","): "."}  # where a number was meant


class Sort:
    """A sort of value: `str()` is what is expected. None is read as None where the field may be None."""

    unit: str = ""

    def read(self, value: Any) -> Any:
        """The value, from a file or Python. Raises Mistake or Mistakes."""
        raise NotImplementedError

    def from_python(self, value: Any, source: Any) -> Any:
        """The value from Python alone, where it is that already; `source`: the field's type. Raises as `read`."""
        return self.read(value)

    def json(self) -> dict[str, Any]:
        """The JSON Schema of it."""
        raise NotImplementedError

    @property
    def kind(self) -> str:
        """What it is, without its range."""
        return str(self)

    @property
    def range(self) -> str:
        """Which of them are valid, "" if all."""
        return ""

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        from pydantic_core import core_schema

        from arva_hil.config.mapping_keys import validator

        read = _or_none(self.read) if type(None) in get_args(source) else self.read
        return core_schema.no_info_plain_validator_function(validator(read))

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        return self.json()


def _or_none(read: Callable[[Any], Any]) -> Callable[[Any], Any]:
    return lambda value: None if value is None else read(value)


@dataclass(frozen=True)
class Number(Sort):
    """A finite number from `low` to `high`, `low` itself excluded if `above`. In Python, `endless` allows infinity."""

    low: float
    high: float
    what: str = "a number"
    above: bool = False
    unit: str = ""
    endless: bool = False

    def __contains__(self, value: float) -> bool:
        return self.low <= value <= self.high and not (self.above and value == self.low)

    def __str__(self) -> str:
        return f"{self.what} {self.range}"

    @property
    def kind(self) -> str:
        return self.what

    @property
    def range(self) -> str:
        return f"above {self.low}, at most {self.high}" if self.above else f"from {self.low} to {self.high}"

    def read(self, value: Any) -> float:
        if isinstance(value, Scalar):
            number = float(value.plain) if FLOAT.fullmatch(value.plain) else math.nan
        elif isinstance(value, numbers.Real) and not isinstance(value, bool):
            number = float(value)
        else:
            number = math.nan
        if number in self or (self.endless and number == math.inf and not isinstance(value, Scalar)):
            return number
        meant = value.plain.translate(_TYPED) if isinstance(value, Scalar) else ""
        hint = meant if FLOAT.fullmatch(meant) and float(meant) in self else None
        raise Mistake(str(self), nearest=hint)

    def json(self) -> dict[str, Any]:
        return {"type": "number", "exclusiveMinimum" if self.above else "minimum": self.low, "maximum": self.high}


@dataclass(frozen=True)
class Whole(Sort):
    """A whole number from `low` to `high`, in a file written without a point."""

    low: int
    high: int
    what: str = "a whole number"
    unit: str = ""

    def __contains__(self, value: float) -> bool:
        return self.low <= value <= self.high

    def __str__(self) -> str:
        return f"{self.what} {self.range}"

    @property
    def kind(self) -> str:
        return self.what

    @property
    def range(self) -> str:
        return f"from {self.low} to {self.high}"

    def read(self, value: Any) -> int:
        number = whole(value)
        if number is None or number not in self:
            raise Mistake(str(self))
        return number

    def json(self) -> dict[str, Any]:
        return {"type": "integer", "minimum": self.low, "maximum": self.high}


def whole(value: Any) -> int | None:
    """The whole number (in a file of 19 digits at most) that a value is, None when it is something else."""
    if isinstance(value, Scalar):
        return int(value.plain) if WHOLE.fullmatch(value.plain) else None
    return int(value) if isinstance(value, numbers.Integral) and not isinstance(value, bool) else None


@dataclass(frozen=True)
class Spec(Sort):
    """The version of a file's format, `newest` or an older one."""

    newest: int

    def __str__(self) -> str:
        return f"spec {' or '.join(map(str, range(1, self.newest + 1)))}"

    def read(self, value: Any) -> int:
        number = whole(value)
        if number is None or not 1 <= number <= self.newest:
            raise Mistake(str(self))
        return number

    def json(self) -> dict[str, Any]:
        return {"enum": list(range(1, self.newest + 1))}


class Anything(Sort):
    """What is checked when it is known what it has to be."""

    def __str__(self) -> str:
        return "anything"

    def read(self, value: Any) -> Any:
        return value

    def json(self) -> dict[str, Any]:
        return {}


class Numbers(Sort):
    """A list of numbers, one of each sort; a tuple in Python."""

    def __init__(self, *sorts: Number | Whole, unit: str = "") -> None:
        self.sorts = sorts
        self.unit = unit or sorts[0].unit
        self.what = "whole numbers" if isinstance(sorts[0], Whole) else "numbers"

    def __str__(self) -> str:
        return f"a list of {len(self.sorts)} {self.what}"

    @property
    def range(self) -> str:
        each = [sort.range for sort in self.sorts]
        return each[0] if len(set(each)) == 1 else "; ".join(each)

    def read(self, value: Any) -> tuple[Any, ...]:
        if isinstance(value, str) or not isinstance(value, Sequence) or len(value) != len(self.sorts):
            raise Mistake(str(self))
        return tuple(each(value, lambda at, item: self.sorts[at].read(item)))

    def json(self) -> dict[str, Any]:
        every = [sort.json() for sort in self.sorts]
        size = {"type": "array", "minItems": len(every), "maxItems": len(every)}
        return size | ({"items": every[0]} if all(one == every[0] for one in every) else {"prefixItems": every})


@dataclass(frozen=True)
class Listed(Sort):
    """A list of one sort; its length is that of a file, which Python need not keep to."""

    item: Sort
    low: int
    high: int
    what: str
    unit: str = ""

    def __str__(self) -> str:
        return list_of(self.low, self.high, self.what)

    def read(self, value: Any) -> tuple[Any, ...]:
        return read_list(self, value, self.item.read)

    def json(self) -> dict[str, Any]:
        return {"type": "array", "items": self.item.json(), "minItems": self.low, "maxItems": self.high}


def list_of(low: int, high: int, what: str) -> str:
    """A list of that many, in words."""
    return f"a list of {low if low == high else f'{low} to {high}'} {what}"


def read_list(sort: Any, value: Any, read: Callable[[Any], Any]) -> tuple[Any, ...]:
    """The items of a list, each read, and their number checked when it comes from a file. Raises Mistakes."""
    if isinstance(value, str) or not isinstance(value, Sequence):
        raise Mistake(str(sort))
    mistakes: list[Mistake] = []
    if isinstance(value, Items) and not sort.low <= len(value) <= sort.high:
        mistakes.append(Mistake(str(sort)))
    return tuple(each(value, lambda _, item: read(item), mistakes))
