"""Tables: frozen pydantic dataclasses that are also the mappings of a file, and every mistake of one at once."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import field, replace
from typing import Any, Final, TypeVar, cast, dataclass_transform, get_args

import pydantic.dataclasses
from pydantic import (
    ConfigDict,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    TypeAdapter,
    ValidationError,
    model_validator,
)
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import ArgsKwargs, CoreSchema, InitErrorDetails, PydanticCustomError, core_schema

from arva_hil.config.sorts import Help, NotAKey, Numbers, SeveralWrong, Since, Sort, Wrong, below, list_of, read_list

_T = TypeVar("_T")

NEWER: Final[set[str]] = set()
"""The names of all keys that files of spec 1 do not have."""


@dataclass_transform(frozen_default=True, field_specifiers=(field,))
def table(*need: str) -> Callable[[type[_T]], type[_T]]:
    """A frozen pydantic dataclass that is read from a mapping too, which has exactly one key of each group in `need`.

    Its fields are the mapping's keys, an InitVar one of the file alone, a field marked NotAKey none. A class method
    `misfits(mapping)` may give what is wrong between keys, whatever else is wrong: it is asked for mappings only.
    """

    def decorate(cls: type[_T]) -> type[_T]:
        def check(cls: type[_T], value: Any, handler: Callable[[Any], _T]) -> _T:
            return _read(cls, value, handler, need)

        cls._check = model_validator(mode="wrap")(classmethod(check))  # type: ignore[attr-defined, arg-type]
        made: Any = pydantic.dataclasses.dataclass(frozen=True, config=_CONFIG)(cls)
        NEWER.update(name for name, since in keys(made).items() if since > 1)
        return cast("type[_T]", made)

    return decorate


UNKNOWN: Final = "unknown key"
_CONFIG: Final = ConfigDict(extra="forbid", defer_build=True)


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


def keys(cls: Any) -> dict[str, int]:
    """The keys of a table, each with the spec since which it is."""
    return {
        name: next((mark.spec for mark in info.metadata if isinstance(mark, Since)), 1)
        for name, info in cls.__pydantic_fields__.items()
        if not any(isinstance(mark, NotAKey) for mark in info.metadata)
    }


def sort_of(cls: Any, name: str) -> Sort:
    """The sort of a table's field."""
    return next(mark for mark in cls.__pydantic_fields__[name].metadata if isinstance(mark, Sort))


def help_of(cls: Any, name: str) -> str:
    """The help of a table's field, "" if there is none."""
    return next((mark.text for mark in cls.__pydantic_fields__[name].metadata if isinstance(mark, Help)), "")


def right(cls: Any, mapping: Mapping[str, Any], name: str) -> Any:
    """The value of a key where it is right, its default where it is not there, None where it is wrong."""
    if name not in mapping:
        return cls.__pydantic_fields__[name].default
    try:
        return sort_of(cls, name).read(mapping[name])
    except (Wrong, SeveralWrong):
        return None


def _read(cls: Any, value: Any, handler: Callable[[Any], _T], need: tuple[str, ...]) -> _T:
    if isinstance(value, ArgsKwargs):
        return handler(value)
    if not isinstance(value, dict):
        try:
            return handler(value)
        except ValidationError as error:
            raise as_validation_error(cls.__name__, _translated(error, cls)) from None
    valid = keys(cls)
    mistakes = [unknown(name, valid) for name in value if name not in valid]
    own: list[Wrong] = []  # of the whole, said only if nothing else is wrong
    try:
        result = handler({name: item for name, item in value.items() if name in valid})
    except ValidationError as error:
        for wrong in _translated(error, cls):
            (own if wrong.native and not wrong.where else mistakes).append(wrong)
    mistakes += needed(value, need, valid)
    mistakes += cls.misfits(value) if hasattr(cls, "misfits") else ()
    if mistakes or own:
        raise as_validation_error(cls.__name__, mistakes or own)
    return result


def _translated(error: ValidationError, cls: Any) -> Iterator[Wrong]:
    """The mistakes in a table, pydantic's own in our words."""
    for one, wrong in zip(error.errors(include_url=False, include_input=False), mistakes_of(error), strict=True):
        if one["type"] == "missing" and len(one["loc"]) == 1:
            yield missing(str(one["loc"][0]), keys(cls))
        elif one["type"] == "dataclass_type" and not one["loc"]:
            yield Wrong("a mapping with {keys}", keys=keys(cls), value=wrong.value)
        else:
            yield wrong


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


class Tables(Sort):
    """A list of tables; its length is that of a file, which Python need not keep to.

    With `entry` a file's items are of that table, and `made` makes of each what the list has in Python.
    """

    def __init__(
        self, low: int, high: int, what: str, entry: Any = None, made: Callable[[Any], Any] | None = None
    ) -> None:
        self.low, self.high, self.what = low, high, what
        self._entry, self._made = entry, made

    def __str__(self) -> str:
        return list_of(self.low, self.high, self.what)

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        cls = get_args(source)[0]

        def item_of(item: Any, one: Callable[[Any], Any]) -> Any:
            if self._made is None or isinstance(item, cls):
                return item if isinstance(item, cls) else read_by(one, item)
            return self._made(read_by(one, item))

        def read(value: Any, one: Callable[[Any], Any]) -> tuple[Any, ...]:
            return validator(lambda items: read_list(self, items, lambda item: item_of(item, one)))(value)

        return core_schema.no_info_wrap_validator_function(read, handler.generate_schema(self._entry or cls))

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        items = handler(schema["schema"])
        return {"type": "array", "items": items, "minItems": self.low, "maxItems": self.high}


class Reshaped(Sort):
    """What a file has as a table, and Python as a tuple of a sort."""

    def __init__(self, cls: type[_T], tuple_of: Callable[[Any], tuple[Any, ...]], sort: Numbers) -> None:
        self.cls, self.sort, self._tuple_of = cls, sort, tuple_of
        self.unit = sort.unit

    def __str__(self) -> str:
        return f"a mapping with {', '.join(keys(self.cls))}"

    def read(self, value: Any) -> tuple[Any, ...]:
        """From Python."""
        return self.sort.read(value)

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        def read(value: Any, one: Callable[[Any], Any]) -> tuple[Any, ...]:
            return validator(self.read)(value) if isinstance(value, tuple) else self._tuple_of(one(value))

        return core_schema.no_info_wrap_validator_function(read, handler.generate_schema(self.cls))

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        return handler(schema["schema"])


class Either(Sort):
    """A table, or something else of a sort of its own."""

    def __init__(self, other: Sort, expected: str) -> None:
        self.other, self.expected = other, expected

    def __str__(self) -> str:
        return self.expected

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        (cls,) = (one for one in get_args(source) if hasattr(one, "__pydantic_fields__"))

        def read(value: Any, one: Callable[[Any], Any]) -> Any:
            return one(value) if isinstance(value, dict | cls) else validator(self.other.read)(value)

        return core_schema.no_info_wrap_validator_function(read, handler.generate_schema(cls))

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        return {"anyOf": [self.other.json(), handler(schema["schema"])]}


class TableSort(Sort):
    """A table within what is no table."""

    def __init__(self, cls: type[Any]) -> None:
        self._cls = cls

    def read(self, value: Any) -> Any:
        return read_by(TypeAdapter(self._cls).validate_python, value)


def read_by(one: Callable[[Any], Any], value: Any) -> Any:
    """What a pydantic validator makes of a value. Raises SeveralWrong."""
    try:
        return one(value)
    except ValidationError as error:
        raise SeveralWrong(mistakes_of(error)) from None


def first(value: Any) -> str:
    """Where in the file a value is, as a remark for a second one like it."""
    return f" (first on line {value.node.start_mark.line + 1})" if hasattr(value, "node") else ""
