"""The base of events: frozen dataclasses that are quick to define."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import MISSING, Field, FrozenInstanceError, dataclass
from typing import Any, ClassVar, Never, dataclass_transform


@dataclass_transform(frozen_default=True)
class Frozen:
    """Makes each subclass a dataclass as `@dataclass(frozen=True)` does, with `fields`, `replace` and equality.

    `@dataclass` compiles six methods for each class, a tenth of the start-up for seventy classes. Here the classes
    share these methods. Raises TypeError for missing or unknown fields, FrozenInstanceError if a field is set later.
    """

    __dataclass_fields__: ClassVar[dict[str, Field[Any]]]

    def __init_subclass__(cls) -> None:
        dataclass(init=False, repr=False, eq=False)(cls)

    def __init__(self, *values: Any, **named: Any) -> None:
        fields = self.__dataclass_fields__
        if named or len(values) != len(fields):
            values = _complete(type(self).__name__, fields, values, named)
        self.__dict__.update(zip(fields, values))  # noqa: B905  # `strict` costs half as much again

    def __repr__(self) -> str:
        return f"{type(self).__name__}({', '.join(f'{name}={value!r}' for name, value in self.__dict__.items())})"

    def __eq__(self, other: object) -> bool:
        return type(self) is type(other) and self.__dict__ == other.__dict__

    def __hash__(self) -> int:
        return hash((type(self), *self.__dict__.values()))

    def __setattr__(self, name: str, value: object) -> Never:
        raise FrozenInstanceError(f"cannot assign to field {name!r}")

    def __delattr__(self, name: str) -> Never:
        raise FrozenInstanceError(f"cannot delete field {name!r}")


def _complete(
    kind: str, fields: Mapping[str, Field[Any]], values: Sequence[Any], named: Mapping[str, Any]
) -> tuple[Any, ...]:
    """The values of all fields, in their order."""
    given = dict(zip(fields, values, strict=False))
    if len(values) > len(fields) or given.keys() & named or named.keys() - fields:
        raise TypeError(f"{kind}: its fields are {', '.join(fields)}, and each is given once")
    given = {name: field.default for name, field in fields.items() if field.default is not MISSING} | given | {**named}
    if missing := [name for name in fields if name not in given]:
        raise TypeError(f"{kind}: {', '.join(missing)} missing")
    return tuple(given[name] for name in fields)
