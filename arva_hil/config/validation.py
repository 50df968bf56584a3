"""How pydantic validates tables: mappings of a file, and what Python gives that is not right at once.

It needs no more than pydantic's core, which is quick to import; pydantic itself makes the JSON Schema.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import MISSING
from functools import partial
from typing import TYPE_CHECKING, Any, get_args

from pydantic_core import ArgsKwargs, CoreSchema, SchemaValidator, ValidationError, core_schema

from arva_hil.config.mapping_keys import as_validation_error, missing, mistakes_of, needed, unknown
from arva_hil.config.mistake import Mistake
from arva_hil.config.sorts import Sort
from arva_hil.config.tables import fields_of, is_table, keys

if TYPE_CHECKING:
    from pydantic import GetCoreSchemaHandler, GetJsonSchemaHandler
    from pydantic.json_schema import JsonSchemaValue


def validator_of(cls: Any) -> SchemaValidator:
    """The validator of a table, made when it is needed."""
    if "__validator__" not in cls.__dict__:
        cls.__validator__ = SchemaValidator(core_schema_of(cls, _Quick), {"title": cls.__name__})
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
        schema = core_schema_of(cls, _Quick)
        return schema if cls is base else core_schema.nullable_schema(schema)


def core_schema_of(cls: Any, handler: type[_Quick] | GetCoreSchemaHandler) -> CoreSchema:
    """What pydantic validates a table by."""
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


def json_schema_of(cls: Any, schema: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
    """The JSON Schema of a table."""
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
    own: list[Mistake] = []  # of the whole, said only if nothing else is wrong
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


def _translated(error: ValidationError, cls: Any) -> Iterator[Mistake]:
    """The mistakes in a table, pydantic's own in our words."""
    for one, wrong in zip(error.errors(include_url=False, include_input=False), mistakes_of(error), strict=True):
        if one["type"] == "missing" and len(one["loc"]) == 1:
            yield missing(str(one["loc"][0]), keys(cls))
        elif one["type"] == "dataclass_type" and not one["loc"]:
            yield Mistake("a mapping with {keys}", keys=keys(cls), value=wrong.value)
        else:
            yield wrong
