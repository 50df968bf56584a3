"""Tables: frozen dataclasses that pydantic validates, and that are the mappings of a file too.

A table needs no more than pydantic's core to be read, which is quick to import; pydantic itself, which makes the JSON
Schema, takes tables as types of its own.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import MISSING, InitVar, dataclass, field
from functools import partial, wraps
from typing import TYPE_CHECKING, Any, Final, NamedTuple, TypeVar, dataclass_transform, get_args

from pydantic_core import ArgsKwargs, CoreSchema, SchemaValidator, ValidationError, core_schema

from arva_hil.config.marks import Help, NotAKey, Since
from arva_hil.config.mistakes import as_validation_error, missing, mistakes_of, needed, unknown
from arva_hil.config.sorts import Sort
from arva_hil.config.wrong import SeveralWrong, Wrong

if TYPE_CHECKING:
    from pydantic import GetCoreSchemaHandler, GetJsonSchemaHandler
    from pydantic.json_schema import JsonSchemaValue

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
            _validator(made).validate_python(ArgsKwargs(args, kwargs), self_instance=self)

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
    made: _T = _validator(cls).validate_python(value)
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


def _validator(cls: Any) -> SchemaValidator:
    """Made when it is needed."""
    if "__validator__" not in cls.__dict__:
        cls.__validator__ = SchemaValidator(_core_schema(cls, cls, _Quick), {"title": cls.__name__})
    made: SchemaValidator = cls.__validator__
    return made


class _Quick:
    """Makes the schemas of what is in a table, as pydantic would."""

    @staticmethod
    def generate_schema(annotation: Any) -> CoreSchema:
        marks = getattr(annotation, "__metadata__", ())
        base = annotation.__origin__ if marks else annotation
        for sort in marks:
            if isinstance(sort, Sort):
                return sort.__get_pydantic_core_schema__(base, _Quick)  # type: ignore[arg-type]
        (cls,) = (one for one in (base, *get_args(base)) if is_table(one))
        schema = _core_schema(cls, cls, _Quick)
        return schema if cls is base else core_schema.nullable_schema(schema)


def _core_schema(cls: Any, source: Any, handler: type[_Quick] | GetCoreSchemaHandler) -> CoreSchema:
    every = []
    for name, one in sorted(fields_of(cls).items(), key=lambda item: item[1].keyword_only):
        schema = handler.generate_schema(one.annotation)
        if one.default is not MISSING:
            schema = core_schema.with_default_schema(schema, default=one.default)
        every.append(
            core_schema.dataclass_field(name, schema, kw_only=one.keyword_only, init_only=one.file_only or None)
        )
    initial = any(one.file_only for one in fields_of(cls).values())
    arguments = core_schema.dataclass_args_schema(
        cls.__name__, every, collect_init_only=initial or None, extra_behavior="forbid"
    )
    names = [name for name, one in fields_of(cls).items() if not one.file_only]
    schema = core_schema.dataclass_schema(cls, arguments, names, post_init=hasattr(cls, "__post_init__"))
    return core_schema.no_info_wrap_validator_function(partial(_read, cls), schema)


def _json_schema(cls: Any, schema: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
    made = handler(schema) | {"additionalProperties": False}
    if hasattr(cls, "own_schemas"):
        made["properties"] = cls.own_schemas() | made["properties"]
    required = [*made.get("required", ()), *(group for group in cls.__need__ if " " not in group)]
    if required:
        made["required"] = required
    for group in cls.__need__:
        if " " in group:
            made["oneOf"] = [{"required": [name]} for name in group.split()]
    return made


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
    except (Wrong, SeveralWrong):
        return None


def _read(cls: Any, value: Any, handler: Callable[[Any], Any]) -> Any:
    if isinstance(value, ArgsKwargs):
        return handler(value)
    if not isinstance(value, dict):
        try:
            return handler(value)
        except ValidationError as error:
            raise as_validation_error(cls.__name__, _translated(error, cls)) from None
    others = cls.own_keys(value) if hasattr(cls, "own_keys") else None
    valid = keys(cls) | dict(others.names if others else {})
    mistakes = [unknown(name, valid) for name in value if name not in valid]
    own: list[Wrong] = []  # of the whole, said only if nothing else is wrong
    try:
        declared = {name: item for name, item in value.items() if name in keys(cls)}
        result = handler(declared | ({"options": others.options} if others else {}))
    except ValidationError as error:
        for wrong in _translated(error, cls):
            (own if wrong.native and not wrong.where else mistakes).append(wrong)
    mistakes += needed(value, cls.__need__, valid)
    mistakes += others.mistakes if others else ()
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
