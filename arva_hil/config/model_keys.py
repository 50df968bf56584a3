"""The keys of a receiver model's own, beside those of every receiver: the fields of its `Options`, a dataclass.

pydantic validates them by their annotations, which may have limits (`Annotated[int, pydantic.Field(ge=1)]`).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any, Final

from arva_hil.config.constraints import FLOAT, WHOLE
from arva_hil.config.errors import Violation, any_of
from arva_hil.config.nodes import Scalar
from arva_hil.config.tables import OtherKeys
from arva_hil.errors import KindError
from arva_hil.registry import RECEIVERS

if TYPE_CHECKING:
    from pydantic_core import ValidationError

PAPER: Final = "paper"  # it has no keys of its own; a scenario without another model imports none
_WORDS: Final = {"true": True, "false": False, "null": None, "~": None}


def read_options(model: str | None, mapping: Mapping[str, Any]) -> OtherKeys:
    """The own keys in a mapping whose model is this one (None: it is not known)."""
    cls = options_class(model)
    if cls is None:
        return OtherKeys()
    names = [field.name for field in dataclasses.fields(cls)]
    from pydantic import TypeAdapter, ValidationError  # slow to import

    try:
        options = TypeAdapter(cls).validate_python({name: _plain(mapping[name]) for name in names if name in mapping})
    except ValidationError as error:
        return OtherKeys(names, None, list(_violations(error, model)))
    return OtherKeys(names, options)


def checked_options(model: str, options: Any) -> Any:
    """The options of a model from Python: its `Options`, a mapping, or None for the defaults. Raises ValueError."""
    cls = options_class(model)
    if cls is None:
        if options is not None:
            raise ValueError(f"options: {options!r}, expected None: the receiver model {model} has no keys of its own")
        return None
    if isinstance(options, cls):
        return options
    if not isinstance(options, Mapping | None):
        raise ValueError(f"options: {options!r}, expected {cls.__qualname__} or a mapping")
    names = [field.name for field in dataclasses.fields(cls)]
    if unknown := [name for name in options or () if name not in names]:
        raise ValueError(f"options: {unknown[0]!r}, expected {any_of(names)}")
    from pydantic import TypeAdapter  # slow to import

    return TypeAdapter(cls).validate_python(dict(options or {}))


def options_class(model: str | None) -> type[Any] | None:
    """The class of a model's own keys, None if it has none or cannot be used. Raises KindError for no dataclass."""
    if model is None or model == PAPER:
        return None
    try:
        cls = getattr(RECEIVERS[model], "Options", None)
    except KindError:  # reported where the model is named
        return None
    if cls is not None and not (isinstance(cls, type) and dataclasses.is_dataclass(cls)):
        raise KindError(f"the Options of the receiver model {model} are no dataclass", "decorate them with @dataclass")
    return cls


def schemas() -> dict[str, Any]:
    """The JSON Schema of each own key of all models that are installed."""
    every: dict[str, Any] = {}
    for cls in filter(None, map(options_class, RECEIVERS.names())):
        from pydantic import TypeAdapter  # slow to import

        schema = TypeAdapter(cls).json_schema()
        for name, one in schema["properties"].items():
            every.setdefault(name, {} if "$defs" in schema else _tidy(one))
    return every


def _tidy(schema: dict[str, Any]) -> dict[str, Any]:
    """Without its title and without null, which no file has."""
    kept = {key: value for key, value in schema.items() if key != "title" and value is not None}
    if "anyOf" in kept:
        kept["anyOf"] = [one for one in kept["anyOf"] if one != {"type": "null"}]
        if len(kept["anyOf"]) == 1:
            kept |= kept.pop("anyOf")[0]
    return kept


def _plain(value: Any) -> Any:
    """A value of a file as plain data: true, false, null, numbers, texts, lists and mappings."""
    if isinstance(value, Scalar):
        if value.plain in _WORDS:
            return _WORDS[value.plain]
        if WHOLE.fullmatch(value.plain):
            return int(value.plain)
        return float(value.plain) if FLOAT.fullmatch(value.plain) else str(value)
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    return [_plain(item) for item in value] if isinstance(value, list) else value


def _violations(error: ValidationError, model: str | None) -> Iterator[Violation]:
    for one in error.errors(include_url=False, include_input=False):
        message, path = one["msg"], one["loc"]
        if one["type"] == "missing" and len(path) == 1:
            yield Violation(f"a mapping with {path[0]}", f"no {path[0]}")
        elif message.startswith("Input should be "):
            expected = message.removeprefix("Input should be ").partition(", unable to parse")[0]
            yield Violation(expected, path=path)
        else:
            yield Violation(f"what the receiver model {model} takes", message.removeprefix("Value error, "), path=path)
