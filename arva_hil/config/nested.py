"""Sorts that have tables in them: lists of tables, a table or a word, a table that is a tuple in Python."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any, TypeVar, get_args

from arva_hil.config.mapping_keys import mistakes_of, validator
from arva_hil.config.mistake import Mistake, Mistakes
from arva_hil.config.sorts import Numbers, Sort, list_of, read_list
from arva_hil.config.tables import is_table, keys, validate

if TYPE_CHECKING:
    from pydantic import GetCoreSchemaHandler, GetJsonSchemaHandler
    from pydantic.json_schema import JsonSchemaValue
    from pydantic_core import CoreSchema

_T = TypeVar("_T")


class Tables(Sort):
    """A list of tables; its length is that of a file, which Python need not keep to.

    With `entry` a file's items are of that table, and `made` makes of each what the list has in Python.
    """

    def __init__(
        self, low: int, high: int, what: str, entry: Any = None, made: Callable[[Any], Any] | None = None
    ) -> None:
        self.low, self.high, self.what = low, high, what
        self.entry, self._made = entry, made

    def __str__(self) -> str:
        return list_of(self.low, self.high, self.what)

    def from_python(self, value: Any, source: Any) -> tuple[Any, ...]:
        if not isinstance(value, list | tuple) or not all(isinstance(item, get_args(source)[0]) for item in value):
            raise Mistake(str(self))
        return tuple(value)

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        from pydantic_core import core_schema  # slow to import

        cls = get_args(source)[0]

        def item_of(item: Any, one: Callable[[Any], Any]) -> Any:
            if self._made is None or isinstance(item, cls):
                return item if isinstance(item, cls) else read_by(one, item)
            return self._made(read_by(one, item))

        def read(value: Any, one: Callable[[Any], Any]) -> tuple[Any, ...]:
            return validator(lambda items: read_list(self, items, lambda item: item_of(item, one)))(value)

        return core_schema.no_info_wrap_validator_function(read, handler.generate_schema(self.entry or cls))

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        items = handler(schema)
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

    def from_python(self, value: Any, source: Any) -> Any:
        if not isinstance(value, tuple):
            raise Mistake(str(self))
        return self.read(value)

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        from pydantic_core import core_schema  # slow to import

        def read(value: Any, one: Callable[[Any], Any]) -> tuple[Any, ...]:
            return validator(self.read)(value) if isinstance(value, tuple) else self._tuple_of(one(value))

        return core_schema.no_info_wrap_validator_function(read, handler.generate_schema(self.cls))

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        return handler(schema)


class Either(Sort):
    """A table, or something else of a sort of its own."""

    def __init__(self, other: Sort, expected: str) -> None:
        self.other, self.expected = other, expected

    def __str__(self) -> str:
        return self.expected

    def from_python(self, value: Any, source: Any) -> Any:
        return self.other.read(value)

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        from pydantic_core import core_schema  # slow to import

        (cls,) = (one for one in get_args(source) if is_table(one))

        def read(value: Any, one: Callable[[Any], Any]) -> Any:
            return one(value) if isinstance(value, dict | cls) else validator(self.other.read)(value)

        return core_schema.no_info_wrap_validator_function(read, handler.generate_schema(cls))

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        return {"anyOf": [self.other.json(), handler(schema)]}


class TableSort(Sort):
    """A table within what is no table."""

    def __init__(self, cls: type[Any]) -> None:
        self._cls = cls

    def read(self, value: Any) -> Any:
        return read_by(partial(validate, self._cls), value)


def read_by(one: Callable[[Any], Any], value: Any) -> Any:
    """What a pydantic validator makes of a value. Raises Mistakes."""
    from pydantic_core import ValidationError  # slow to import

    try:
        return one(value)
    except ValidationError as error:
        raise Mistakes(mistakes_of(error)) from None
