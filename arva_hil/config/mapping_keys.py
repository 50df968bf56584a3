"""Mistakes between the keys of a mapping, and all mistakes on their way through pydantic."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final, TypeVar

from arva_hil.config.mistake import Mistake, Mistakes, below
from arva_hil.config.sorts import Sort

if TYPE_CHECKING:
    from pydantic_core import InitErrorDetails, ValidationError

_T = TypeVar("_T")

UNKNOWN: Final = "unknown key"


def validator(read: Callable[[Any], _T]) -> Callable[[Any], _T]:
    """A function that raises Mistake or Mistakes, as pydantic calls it."""

    def validate(value: Any) -> _T:
        try:
            return read(value)
        except (Mistake, Mistakes) as error:
            every = error.every if isinstance(error, Mistakes) else [replace(error, value=value)]
            raise as_validation_error("value", every) from None

    return validate


def as_validation_error(title: str, mistakes: Iterable[Mistake]) -> ValidationError:
    """Mistakes as pydantic has them."""
    from pydantic_core import PydanticCustomError, ValidationError  # slow to import

    every: list[InitErrorDetails] = [
        {"type": PydanticCustomError("wrong", "{wrong}", {"wrong": one}), "loc": one.where, "input": one.value}
        for one in mistakes
    ]
    return ValidationError.from_exception_data(title, every)


def mistakes_of(error: ValidationError) -> list[Mistake]:
    """What `validator` and tables have found wrong."""
    every = []
    for one in error.errors(include_url=False):
        wrong = one.get("ctx", {}).get("wrong")
        if isinstance(wrong, Mistake):
            every.append(replace(wrong, where=one["loc"], value=one["input"]))
        else:
            message = one["msg"].removeprefix("Value error, ")
            every.append(Mistake("something else", message, where=one["loc"], value=one["input"], native=True))
    return every


def unknown(name: str, valid: Mapping[str, int]) -> Mistake:
    """A key that a mapping does not have."""
    return Mistake("{one of keys}", UNKNOWN, where=(name,), at_key=True, keys=valid)


def missing(group: str, keys: Mapping[str, int]) -> Mistake:
    """A key that a mapping must have, or one of several."""
    group_keys = {name: keys[name] for name in group.split()}
    exactly = "exactly one of " if len(group_keys) > 1 else ""
    return Mistake(f"a mapping with {exactly}{{keys}}", "no {or}", keys=group_keys)


def needed(mapping: Mapping[str, Any], need: Iterable[str], keys: Mapping[str, int]) -> Iterator[Mistake]:
    """What is wrong with the groups of keys of which a mapping has exactly one each."""
    for group in need:
        names = group.split()
        given = [name for name in mapping if name in names]
        wrong = missing(group, keys)
        if not given:
            yield wrong
        for name in given[1:]:
            yield Mistake(wrong.expected, f"both {given[0]} and {name}", where=(name,), at_key=True, keys=wrong.keys)


def read_mapping(value: Any, sorts: Mapping[str, Sort], need: Sequence[str]) -> dict[str, Any]:
    """The values of a mapping without a table, which may have keys of these sorts. Raises Mistakes."""
    valid = dict.fromkeys(sorts, 1)
    if not isinstance(value, dict):
        raise Mistake("a mapping with {keys}", keys=valid)
    mistakes = [unknown(name, valid) for name in value if name not in sorts]
    mistakes += needed(value, need, valid)
    values = {}
    for name, item in value.items():
        try:
            if name in sorts:
                values[name] = sorts[name].read(item)
        except (Mistake, Mistakes) as error:
            mistakes += below(name, error)
    if mistakes:
        raise Mistakes(mistakes)
    return values


def first(value: Any) -> str:
    """Where in the file a value is, as a remark for a second one like it."""
    return f" (first on line {value.node.start_mark.line + 1})" if hasattr(value, "node") else ""
