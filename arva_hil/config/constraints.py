"""Constraints on the values of keys: the check of each, its wording and its JSON Schema.

A constraint reads the values of a file (`nodes`) and those of Python alike.
"""

from __future__ import annotations

import math
import numbers
import os
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Final

from arva_hil.config.errors import ConstraintError, ScenarioError, Violation, any_of, wrong
from arva_hil.config.nodes import Items, Scalar, folder_of
from arva_hil.errors import KindError, UnknownKindError, nearest
from arva_hil.registry import Registry

FLOAT: Final = re.compile(r"[-+]?((0|[1-9][0-9]*)(\.[0-9]*)?|\.[0-9]+)([eE][-+]?[0-9]+)?")
WHOLE: Final = re.compile(r"[-+]?(0|[1-9][0-9]{0,18})")


class Constraint:
    """A constraint on a value; `str()` is the expectation in words. `unit`: of its numbers, "" without one.

    `table`: the class of the table at this place of a file, or of a list of tables; None if it has none.
    """

    unit: str = ""
    table: Any = None

    def read(self, value: Any) -> Any:
        """Return the value, from a file or Python. Raises ConstraintError."""
        raise NotImplementedError

    def plain(self, value: Any, spec: int) -> Any:
        """Return the value as a file of a spec has it, in plain JSON types."""
        return list(value) if isinstance(value, tuple) else value

    def json(self) -> dict[str, Any]:
        """Return the JSON Schema of a value in a file."""
        raise NotImplementedError

    @property
    def kind(self) -> str:
        """The kind of value, without its range."""
        return str(self)

    @property
    def range(self) -> str:
        """The valid range of that kind, "" if all are valid."""
        return ""


@dataclass(frozen=True)
class Number(Constraint):
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
        raise wrong(str(self))

    def json(self) -> dict[str, Any]:
        return {"type": "number", "exclusiveMinimum" if self.above else "minimum": self.low, "maximum": self.high}


@dataclass(frozen=True)
class Whole(Number):
    """A whole number from `low` to `high`, in a file written without a point."""

    what: str = "a whole number"

    def read(self, value: Any) -> int:
        number = whole(value)
        if number is None or number not in self:
            raise wrong(str(self))
        return number

    def json(self) -> dict[str, Any]:
        return super().json() | {"type": "integer"}


def whole(value: Any) -> int | None:
    """Return the value as a whole number (of 19 digits at most in a file); None if it is none."""
    if isinstance(value, Scalar):
        return int(value.plain) if WHOLE.fullmatch(value.plain) else None
    return int(value) if isinstance(value, numbers.Integral) and not isinstance(value, bool) else None


@dataclass(frozen=True)
class Word(Constraint):
    """One of several words, quoted or not."""

    words: Sequence[str]
    expected: str = ""

    def __str__(self) -> str:
        return self.expected or any_of(self.words)

    def read(self, value: Any) -> str:
        if not isinstance(value, str):
            raise wrong(str(self))
        if value not in self.words:
            raise wrong(str(self), nearest=nearest(value.lower(), self.words))
        return str(value)

    def json(self) -> dict[str, Any]:
        return {"enum": list(self.words)}


@dataclass(frozen=True)
class Named(Constraint):
    """A name in a registry: built in, or of a package that works. `word`: the kind, if not all names."""

    registry: Registry
    word: str = ""

    def __str__(self) -> str:
        return any_of(list(self.registry))

    @property
    def kind(self) -> str:
        return self.word or str(self)

    def read(self, value: Any) -> str:
        if not isinstance(value, str):
            raise wrong(str(self))
        if value not in list(self.registry):
            try:
                self.registry[str(value)]
            except UnknownKindError as error:
                raise wrong(any_of(self.registry.names()), nearest=error.nearest) from None
            except KindError as error:
                raise wrong(f"one that works: {error.cure}", error.found) from None
        return str(value)

    def json(self) -> dict[str, Any]:
        return {"type": "string", "minLength": 1} if self.registry.references else {"enum": self.registry.names()}


@dataclass(frozen=True)
class Text(Constraint):
    """A text that matches `pattern`, quoted or not."""

    what: str
    pattern: str = r"(?s:.+)"

    def __str__(self) -> str:
        return self.what

    def read(self, value: Any) -> str:
        if not isinstance(value, str) or not re.fullmatch(self.pattern, value):
            raise wrong(self.what)
        return str(value)

    def json(self) -> dict[str, Any]:
        limit = {"minLength": 1} if self.pattern == Text.pattern else {"pattern": f"^{self.pattern}$"}
        return {"type": "string", **limit}


class On(Constraint):
    """Only `true`, for a fault without a value; read as 1."""

    def __str__(self) -> str:
        return "true"

    def read(self, value: Any) -> int:
        if value != "true" and (isinstance(value, str) or value != 1):
            raise wrong("true", nearest=nearest(value.lower(), ["true"]) if isinstance(value, str) else None)
        return 1

    def json(self) -> dict[str, Any]:
        return {"const": True}


class Anything(Constraint):
    """Any value; it is checked elsewhere."""

    def read(self, value: Any) -> Any:
        return value


class Numbers(Constraint):
    """A list of numbers, one for each constraint; a tuple in Python.

    `fits`: returns False for numbers that do not fit together; `expected`: those that do, in words.
    """

    def __init__(
        self,
        *each: Number | Whole,
        unit: str = "",
        names: str = "",
        fits: Callable[[tuple[Any, ...]], bool] | None = None,
        expected: str = "",
    ) -> None:
        self.each = each
        self.unit = unit or each[0].unit
        self.names = f" ({names})" if names else ""
        self.fits, self.expected = fits, expected

    def __str__(self) -> str:
        return f"a list of {len(self.each)} {'whole numbers' if isinstance(self.each[0], Whole) else 'numbers'}"

    @property
    def range(self) -> str:
        ranges = dict.fromkeys(one.range for one in self.each)
        return "; ".join(one.range for one in self.each) if len(ranges) > 1 else next(iter(ranges))

    def read(self, value: Any) -> Any:
        if isinstance(value, str) or not isinstance(value, Sequence):
            raise wrong(f"{self}{self.names}")
        if len(value) != len(self.each):
            raise wrong(f"{len(self.each)}{self.names}", f"{len(value)} number{'' if len(value) == 1 else 's'}")
        values, violations = read_each(value, [one.read for one in self.each])
        if violations:
            raise ConstraintError(*violations)
        if self.fits and not self.fits(tuple(values)):
            raise wrong(self.expected, f"[{', '.join(f'{one:g}' for one in values)}]")
        return tuple(values)

    def json(self) -> dict[str, Any]:
        every = [one.json() for one in self.each]
        size = {"type": "array", "minItems": len(every), "maxItems": len(every)}
        return size | ({"items": every[0]} if all(one == every[0] for one in every) else {"prefixItems": every})


class ListOf(Constraint):
    """A list of items of one kind, a tuple in Python. The limits of its length are for files alone."""

    def __init__(self, item: Constraint, low: int, high: int, what: str, unit: str = "") -> None:
        self.item, self.low, self.high, self.what, self.unit = item, low, high, what, unit
        self.table = item.table

    def __str__(self) -> str:
        return f"a list of {self.low if self.low == self.high else f'{self.low} to {self.high}'} {self.what}"

    def read(self, value: Any) -> tuple[Any, ...]:
        if isinstance(value, str) or not isinstance(value, Sequence):
            raise wrong(str(self))
        some = value[: self.high] if isinstance(value, Items) else value  # report a thousand items too many once
        values, violations = read_each(some, [self.item.read] * len(some))
        if isinstance(value, Items) and not self.low <= len(value) <= self.high:
            violations.insert(0, Violation(str(self)))
        if violations:
            raise ConstraintError(*violations, given=values)
        return tuple(values)

    def plain(self, value: Any, spec: int) -> Any:
        return [self.item.plain(item, spec) for item in value]

    def json(self) -> dict[str, Any]:
        return {"type": "array", "items": self.item.json(), "minItems": self.low, "maxItems": self.high}


def read_each(items: Sequence[Any], reads: Iterable[Callable[[Any], Any]]) -> tuple[list[Any], list[Violation]]:
    """Read every item. Returns the values, or the given parts of wrong ones; and all problems."""
    values, violations = list[Any](), list[Violation]()
    for index, (item, read) in enumerate(zip(items, reads, strict=True)):
        try:
            values.append(read(item))
        except ConstraintError as error:
            values.append(error.given)
            violations += error.below(index)
    return values, violations


@dataclass(frozen=True)
class NamedFile(Constraint):
    """The name of a file, from the folder of the file that names it; in Python also its content.

    `content`: returns a value that is no name, None for others. `load`: returns the content of the file at a path;
    raises ScenarioError with the first mistake.
    """

    what: str
    content: Callable[[Any], Any]
    load: Callable[[str], Any]

    def __str__(self) -> str:
        return self.what

    def read(self, value: Any) -> Any:
        if (content := self.content(value)) is not None:
            return content
        if not isinstance(value, str) or not value:
            raise wrong(str(self))
        try:
            return self.load(os.path.join(folder_of(value), value))
        except ScenarioError as error:
            (problem,) = error.problems
            found = f"{problem.source}:{problem.line}:{problem.column}: {problem.found}"
            raise wrong(problem.expected, found) from None

    def plain(self, value: Any, spec: int) -> str:
        return value if isinstance(value, str) else str(value.source)

    def json(self) -> dict[str, Any]:
        return {"type": "string", "minLength": 1}
