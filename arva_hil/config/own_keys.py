"""The keys of a receiver model's own, beside those of every receiver: the fields of its `Options`, a dataclass.

pydantic validates them by their annotations, which may have limits (`Annotated[int, pydantic.Field(ge=1)]`).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from arva_hil.config.mapping_keys import missing
from arva_hil.config.mistake import Mistake
from arva_hil.config.sorts import FLOAT, WHOLE
from arva_hil.config.tree import Scalar, any_of
from arva_hil.errors import KindError
from arva_hil.registry import RECEIVERS

if TYPE_CHECKING:
    from pydantic_core import ValidationError

PAPER: Final = "paper"  # it has no keys of its own; a scenario without another model imports none


class OwnKeys(NamedTuple):
    """The own keys of a mapping's model: their `names`, the `Options` that they make, what is wrong with them."""

    names: Mapping[str, int] = {}
    options: Any = None
    mistakes: Sequence[Mistake] = ()


def own_keys(model: str | None, mapping: Mapping[str, Any]) -> OwnKeys:
    """The own keys in a mapping whose model is this one; None: it is not known."""
    cls = options_class(model)
    if cls is None:
        return OwnKeys()
    names = {field.name: 1 for field in dataclasses.fields(cls)}
    given = {name: _plain(value) for name, value in mapping.items() if name in names}
    from pydantic_core import ValidationError  # slow to import

    try:
        return OwnKeys(names, _validated(cls, given))
    except ValidationError as error:
        return OwnKeys(names, None, list(_mistakes(error, model, names)))


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
    if strangers := [name for name in options or () if name not in names]:
        raise ValueError(f"options: {strangers[0]!r}, expected {any_of(names)}")
    return _validated(cls, dict(options or {}))


def options_class(model: str | None) -> type[Any] | None:
    """The class of a model's own keys, None if it has none or cannot be used. Raises KindError for no dataclass."""
    if model is None or model == PAPER:
        return None
    try:
        cls = getattr(RECEIVERS[model], "Options", None)
    except KindError:  # said where the model is named
        return None
    if cls is not None and not (isinstance(cls, type) and dataclasses.is_dataclass(cls)):
        raise KindError(f"the Options of the receiver model {model} are no dataclass", "decorate them with @dataclass")
    return cls


def schemas() -> dict[str, Any]:
    """The JSON Schema of each own key of all models that are installed."""
    from pydantic import TypeAdapter

    every: dict[str, Any] = {}
    for cls in filter(None, map(options_class, RECEIVERS.names())):
        made = TypeAdapter(cls).json_schema()
        for name, schema in made["properties"].items():
            every.setdefault(name, {} if "$defs" in made else schema)
    return every


def _plain(value: Any) -> Any:
    """A value of a file as plain data: true, false, null, numbers, texts, lists and mappings."""
    if isinstance(value, Scalar):
        words = {"true": True, "false": False, "null": None, "~": None}
        if value.plain in words:
            return words[value.plain]
        if WHOLE.fullmatch(value.plain):
            return int(value.plain)
        return float(value.plain) if FLOAT.fullmatch(value.plain) else str(value)
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    return [_plain(item) for item in value] if isinstance(value, list) else value


def _validated(cls: type[Any], given: Mapping[str, Any]) -> Any:
    """Raises ValidationError."""
    from pydantic import TypeAdapter  # slow to import

    return TypeAdapter(cls).validate_python(given)


def _mistakes(error: ValidationError, model: str | None, names: Mapping[str, int]) -> Iterator[Mistake]:
    for one in error.errors(include_url=False, include_input=False):
        message, where = one["msg"], one["loc"]
        if one["type"] == "missing" and len(where) == 1:
            yield missing(str(where[0]), names)
        elif message.startswith("Input should be "):
            expected = message.removeprefix("Input should be ").partition(", unable to parse")[0]
            yield Mistake(expected, where=where)
        else:
            found = message.removeprefix("Value error, ")
            yield Mistake(f"what the receiver model {model} takes", found, where=where)
