"""Tables: frozen dataclasses that pydantic validates, and that are the mappings of a file too.

pydantic takes tables as types of its own. It is imported when a file is read, or when Python gives values that are not
all of their sorts.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import MISSING, InitVar, dataclass, field
from functools import wraps
from typing import TYPE_CHECKING, Any, Final, NamedTuple, TypeVar, dataclass_transform, get_args

from arva_hil.config.marks import Help, NotAKey, Since
from arva_hil.config.mistake import Mistake, Mistakes
from arva_hil.config.sorts import Sort

if TYPE_CHECKING:
    from pydantic import GetCoreSchemaHandler, GetJsonSchemaHandler
    from pydantic.json_schema import JsonSchemaValue
    from pydantic_core import CoreSchema

_T = TypeVar("_T")

NEWER: Final[set[str]] = set()
"""The names of all keys that files of spec 1 do not have."""


class Field(NamedTuple):
    """A field as it was declared."""

    annotation: Any  # Annotated with its sort, help and marks
    type: Any  # without them
    marks: tuple[Any, ...]
    default: Any  # MISSING if there is none
    file_only: bool
    keyword_only: bool

    def mark(self, cls: type[_T]) -> _T | None:
        """The first mark of a class, None if there is none."""
        return next((mark for mark in self.marks if isinstance(mark, cls)), None)


@dataclass_transform(frozen_default=True, field_specifiers=(field,))
def table(*need: str) -> Callable[[type[_T]], type[_T]]:
    """A frozen dataclass that is validated when it is made, and can be read from a mapping, which has exactly one key
    of each group in `need`. Raises ValueError (pydantic's ValidationError) for values that are not of their sorts.

    Its fields are the mapping's keys, an InitVar one of the file alone, a field marked NotAKey none. A class method
    `misfits(mapping)` may give what is wrong between keys, whatever else is wrong, and one `own_keys(mapping)` further
    keys of it, which become the field `options`: they are asked for mappings only.
    """

    def decorate(cls: type[_T]) -> type[_T]:
        made: Any = dataclass(frozen=True)(cls)
        original = made.__init__

        @wraps(original)
        def initialise(self: Any, *args: Any, **kwargs: Any) -> None:
            if not _made_at_once(made, self, args, kwargs):
                from pydantic_core import ArgsKwargs  # slow to import

                from arva_hil.config.validation import validator_of

                validator_of(made).validate_python(ArgsKwargs(args, kwargs), self_instance=self)

        made.__init__ = initialise
        made.__fields__ = {name: _declared(field) for name, field in made.__dataclass_fields__.items()}
        made.__need__ = need
        made.__get_pydantic_core_schema__ = classmethod(_core_schema)
        made.__get_pydantic_json_schema__ = classmethod(_json_schema)
        NEWER.update(name for name, since in keys(made).items() if since > 1)
        return cls

    return decorate


def validate(cls: type[_T], value: Any) -> _T:
    """A table from a mapping. Raises ValidationError."""
    from arva_hil.config.validation import validator_of  # slow to import

    made: _T = validator_of(cls).validate_python(value)
    return made


def is_table(cls: Any) -> bool:
    """Whether a type is a table."""
    return hasattr(cls, "__need__")


def fields_of(cls: Any) -> dict[str, Field]:
    """The fields of a table, also those that are keys of the file alone."""
    declared: dict[str, Field] = cls.__fields__
    return declared


def _declared(field: Any) -> Field:
    annotation = field.type.type if isinstance(field.type, InitVar) else field.type
    marks = getattr(annotation, "__metadata__", ())
    base = annotation.__origin__ if marks else annotation
    return Field(annotation, base, marks, field.default, isinstance(field.type, InitVar), field.kw_only)


def _made_at_once(cls: Any, made: Any, args: tuple[Any, ...], named: dict[str, Any]) -> bool:
    """Fill a table from Python's values if all are there and of their sorts, as nearly always; or else False."""
    fields = fields_of(cls)
    given = dict(zip((name for name, one in fields.items() if not one.keyword_only), args, strict=False))
    if len(given) != len(args) or given.keys() & named or named.keys() - fields:
        return False
    given |= named
    for_init = []
    try:
        for name, one in fields.items():
            value = _from_python(one, given[name]) if name in given else one.default
            if value is MISSING:
                return False
            if one.file_only:
                for_init.append(value)
            else:
                object.__setattr__(made, name, value)
        if hasattr(cls, "__post_init__"):
            made.__post_init__(*for_init)
    except (Mistake, Mistakes, ValueError):
        return False
    return True


def _from_python(field: Field, value: Any) -> Any:
    """A value that is of the field's sort, or the table that it is. Raises Mistake or Mistakes."""
    types = (field.type, *get_args(field.type))
    if (value is None and type(None) in types) or any(is_table(one) and isinstance(value, one) for one in types):
        return value
    sort = field.mark(Sort)
    if sort is None:
        raise Mistake("a table")
    return sort.from_python(value, field.type)


def _core_schema(cls: Any, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
    from arva_hil.config.validation import core_schema_of  # slow to import

    return core_schema_of(cls, handler)


def _json_schema(cls: Any, schema: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
    from arva_hil.config.validation import json_schema_of  # slow to import

    return json_schema_of(cls, schema, handler)


def keys(cls: Any) -> dict[str, int]:
    """The keys of a table, each with the spec since which it is."""
    every = fields_of(cls).items()
    return {name: since.spec if (since := one.mark(Since)) else 1 for name, one in every if not one.mark(NotAKey)}


def sort_of(cls: Any, name: str) -> Sort:
    """The sort of a table's field."""
    return next(mark for mark in fields_of(cls)[name].marks if isinstance(mark, Sort))


def help_of(cls: Any, name: str) -> str:
    """The help of a table's field, "" if there is none."""
    mark = fields_of(cls)[name].mark(Help)
    return mark.text if mark else ""


def right(cls: Any, mapping: Mapping[str, Any], name: str) -> Any:
    """The value of a key where it is right, its default where it is not there, None where it is wrong."""
    if name not in mapping:
        return fields_of(cls)[name].default
    try:
        return sort_of(cls, name).read(mapping[name])
    except (Mistake, Mistakes):
        return None
