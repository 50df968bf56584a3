"""Mistakes on their way through pydantic, and those between the keys of a mapping."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final, TypeVar

from arva_hil.config.sorts import Sort
from arva_hil.config.wrong import SeveralWrong, Wrong, below

if TYPE_CHECKING:
    from pydantic_core import InitErrorDetails, ValidationError

_T = TypeVar("_T")

UNKNOWN: Final = "unknown key"


def validator(read: Callable[[Any], _T]) -> Callable[[Any], _T]:
    """A function that raises Wrong or SeveralWrong, as pydantic calls it."""

    def validate(value: Any) -> _T:
        try:
            return read(value)
        except (Wrong, SeveralWrong) as error:
            every = error.every if isinstance(error, SeveralWrong) else [replace(error, value=value)]
            raise as_validation_error("value", every) from None

    return validate


def as_validation_error(title: str, mistakes: Iterable[Wrong]) -> ValidationError:
    """Mistakes as pydantic has them."""
    from pydantic_core import PydanticCustomError, ValidationError  # slow to import

    every: list[InitErrorDetails] = [
        {"type": PydanticCustomError("wrong", "{wrong}", {"wrong": one}), "loc": one.where, "input": one.value}
        for one in mistakes
    ]
    return ValidationError.from_exception_data(title, every)


def mistakes_of(error: ValidationError) -> list[Wrong]:
    """What `validator` and tables have found wrong."""
    every = []
    for one in error.errors(include_url=False):
        wrong = one.get("ctx", {}).get("wrong")
        if isinstance(wrong, Wrong):
            every.append(replace(wrong, where=one["loc"], value=one["input"]))
        else:
            message = one["msg"].removeprefix("Value error, ")
            every.append(Wrong("something else", message, where=one["loc"], value=one["input"], native=True))
    return every


def unknown(name: str, valid: Mapping[str, int]) -> Wrong:
    """A key that a mapping does not have."""
    return Wrong("{one of keys}", UNKNOWN, where=(name,), at_key=True, keys=valid)


def missing(group: str, keys: Mapping[str, int]) -> Wrong:
    """A key that a mapping must have, or one of several."""
    group_keys = {name: keys[name] for name in group.split()}
    exactly = "exactly one of " if len(group_keys) > 1 else ""
    return Wrong(f"a mapping with {exactly}{{keys}}", "no {or}", keys=group_keys)


def needed(mapping: Mapping[str, Any], need: Iterable[str], keys: Mapping[str, int]) -> Iterator[Wrong]:
    """What is wrong with the groups of keys of which a mapping has exactly one each."""
    for group in need:
        names = group.split()
        given = [name for name in mapping if name in names]
        wrong = missing(group, keys)
        if not given:
            yield wrong
        for name in given[1:]:
            yield Wrong(wrong.expected, f"both {given[0]} and {name}", where=(name,), at_key=True, keys=wrong.keys)


def read_mapping(value: Any, sorts: Mapping[str, Sort], need: Sequence[str]) -> dict[str, Any]:
    """The values of a mapping without a table, which may have keys of these sorts. Raises SeveralWrong."""
    valid = dict.fromkeys(sorts, 1)
    if not isinstance(value, dict):
        raise Wrong("a mapping with {keys}", keys=valid)
    mistakes = [unknown(name, valid) for name in value if name not in sorts]
    mistakes += needed(value, need, valid)
    values = {}
    for name, item in value.items():
        try:
            if name in sorts:
                values[name] = sorts[name].read(item)
        except (Wrong, SeveralWrong) as error:
            mistakes += below(name, error)
    if mistakes:
        raise SeveralWrong(mistakes)
    return values


def first(value: Any) -> str:
    """Where in the file a value is, as a remark for a second one like it."""
    return f" (first on line {value.node.start_mark.line + 1})" if hasattr(value, "node") else ""
