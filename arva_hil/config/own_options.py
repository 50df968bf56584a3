"""Own keys of receiver models, faults and observers: the fields of their `Options`, a dataclass.

pydantic validates them by their annotations (`Annotated[int, pydantic.Field(ge=1)]`).
"""

import dataclasses
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any, Final

from arva_hil.config.constraints import FLOAT, WHOLE
from arva_hil.config.errors import Violation, any_of
from arva_hil.config.nodes import Scalar
from arva_hil.config.tables import OtherKeys

if TYPE_CHECKING:
    from pydantic import TypeAdapter
    from pydantic_core import ValidationError

_ADAPTERS: Final[dict[type[Any], "TypeAdapter[Any]"]] = {}
_WORDS: Final = {"true": True, "false": False, "null": None, "~": None}


def read(cls: type[Any], mapping: Mapping[str, Any], what: str) -> OtherKeys:
    """Return the own keys in a mapping of a file. `what`: their owner, for messages."""
    names = [field.name for field in dataclasses.fields(cls)]
    from pydantic import ValidationError  # slow to import

    try:
        options = adapter(cls).validate_python({name: plain(mapping[name]) for name in names if name in mapping})
    except ValidationError as error:
        return OtherKeys(names, None, list(_violations(error, what)))
    return OtherKeys(names, options)


def checked(cls: type[Any] | None, options: Any, what: str) -> Any:
    """Return the options from Python: `cls`, a mapping, or None for the defaults. Raises ValueError."""
    if cls is None:
        if options is not None:
            raise ValueError(f"options: {options!r}, expected None: {what} has no keys of its own")
        return None
    if isinstance(options, cls):
        return options
    if not isinstance(options, Mapping | None):
        raise ValueError(f"options: {options!r}, expected {cls.__qualname__} or a mapping")
    names = [field.name for field in dataclasses.fields(cls)]
    if unknown := [name for name in options or () if name not in names]:
        raise ValueError(f"options: {unknown[0]!r}, expected {any_of(names)}")
    return adapter(cls).validate_python(dict(options or {}))


def schemas(cls: type[Any]) -> dict[str, Any]:
    """Return the JSON Schema of each own key."""
    schema = adapter(cls).json_schema()
    return {name: {} if "$defs" in schema else _tidy(one) for name, one in schema["properties"].items()}


def adapter(cls: type[Any]) -> "TypeAdapter[Any]":
    """Return the validator of a class, made once: making it takes a millisecond."""
    from pydantic import TypeAdapter  # slow to import

    if cls not in _ADAPTERS:
        _ADAPTERS[cls] = TypeAdapter(cls)
    return _ADAPTERS[cls]


def _tidy(schema: dict[str, Any]) -> dict[str, Any]:
    """Return a schema without its title and without null, which no file has."""
    kept = {key: value for key, value in schema.items() if key != "title" and value is not None}
    if "anyOf" in kept:
        kept["anyOf"] = [one for one in kept["anyOf"] if one != {"type": "null"}]
        if len(kept["anyOf"]) == 1:
            kept |= kept.pop("anyOf")[0]
    return kept


def plain(value: Any) -> Any:
    """Return a value of a file as plain data: true, false, null, numbers, texts, lists and mappings."""
    if isinstance(value, Scalar):
        if value.plain in _WORDS:
            return _WORDS[value.plain]
        if WHOLE.fullmatch(value.plain):
            return int(value.plain)
        return float(value.plain) if FLOAT.fullmatch(value.plain) else str(value)
    if isinstance(value, dict):
        return {key: plain(item) for key, item in value.items()}
    return [plain(item) for item in value] if isinstance(value, list) else value


def _violations(error: "ValidationError", what: str) -> Iterator[Violation]:
    for one in error.errors(include_url=False, include_input=False):
        message, path = one["msg"], one["loc"]
        if one["type"] == "missing" and len(path) == 1:
            yield Violation(f"a mapping with {path[0]}", f"no {path[0]}")
        elif message.startswith("Input should be "):
            expected = message.removeprefix("Input should be ").partition(", unable to parse")[0]
            yield Violation(expected, path=path)
        else:
            found, _, expected = message.removeprefix("Value error, ").partition(": expected ")
            yield Violation(expected or f"what {what} takes", found, path=path)
