"""Frozen dataclasses that are quick to define."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import MISSING, Field, FrozenInstanceError, dataclass, field, fields
from typing import TYPE_CHECKING, Any, ClassVar, Never, dataclass_transform

if TYPE_CHECKING:
    from inspect import Signature


class _LazySignature:
    """Makes the signature of a class when somebody asks for it."""

    def __get__(self, made: object, cls: type) -> Signature:
        from inspect import Parameter, Signature  # slow to import

        parameters = [
            Parameter(
                one.name,
                Parameter.KEYWORD_ONLY if one.kw_only else Parameter.POSITIONAL_OR_KEYWORD,
                default=Parameter.empty if one.default is MISSING else one.default,
                annotation=one.type,
            )
            for one in getattr(cls, "__dataclass_fields__", {}).values()
        ]
        return Signature(sorted(parameters, key=lambda parameter: parameter.kind))


class _LazyFields:
    """Makes a class a dataclass when somebody asks for its fields: a run uses few of the classes of events."""

    def __get__(self, made: object, cls: type[Frozen]) -> dict[str, Field[Any]]:
        dataclass(init=False, repr=False, eq=False)(cls)  # which puts the fields in the place of this
        every = cls.__dataclass_fields__
        cls.__places__ = -1 if hasattr(cls, "__post_init__") or any(f.kw_only for f in every.values()) else len(every)
        return every


@dataclass_transform(frozen_default=True, field_specifiers=(field,))
class Frozen:
    """Makes each subclass a dataclass as `@dataclass(frozen=True)` does, with `fields`, `replace` and equality.

    `@dataclass` compiles six methods for each class, which takes 0.3 ms; with two hundred classes that is a fifth of
    the start-up. Here the classes share these methods, and their fields are found at the first use. Fields have no
    `default_factory`. Raises TypeError for missing or unknown fields, FrozenInstanceError if a field is set later.
    """

    __dataclass_fields__: ClassVar[dict[str, Field[Any]]]
    __places__: ClassVar[int]  # how many values are stored as they are given, all by place; -1 if that is not all
    __signature__: ClassVar[Any] = _LazySignature()

    def __init_subclass__(cls) -> None:
        cls.__places__ = -1  # until the first use
        cls.__dataclass_fields__ = _LazyFields()  # type: ignore[assignment]

    def __init__(self, *values: Any, **named: Any) -> None:
        if named or len(values) != self.__places__:
            _fill(self, values, named)
        else:
            self.__dict__.update(zip(self.__dataclass_fields__, values))  # noqa: B905  # `strict` costs half as much

    def __repr__(self) -> str:
        values = ", ".join(f"{one.name}={getattr(self, one.name)!r}" for one in fields(self) if one.repr)
        return f"{type(self).__qualname__}({values})"

    def __eq__(self, other: object) -> bool:
        return type(self) is type(other) and _compared(self) == _compared(other)

    def __hash__(self) -> int:
        return hash((type(self), *_compared(self)))

    def __setattr__(self, name: str, value: object) -> Never:
        raise FrozenInstanceError(f"cannot assign to field {name!r}")

    def __delattr__(self, name: str) -> Never:
        raise FrozenInstanceError(f"cannot delete field {name!r}")


def _compared(made: Any) -> list[Any]:
    return [getattr(made, one.name) for one in fields(made) if one.compare]


def _fill(made: Any, values: Sequence[Any], named: Mapping[str, Any]) -> None:
    """Set all fields, and call `__post_init__` with the values of those that are an InitVar."""
    every = made.__dataclass_fields__
    places = [name for name, one in every.items() if not one.kw_only]
    given = dict(zip(places, values, strict=False))
    wrong = [name for name in named if name in given or name not in every]
    if wrong or len(values) > len(places):
        what = ", ".join(wrong) or f"{len(values)} values"
        raise TypeError(f"{type(made).__name__} with {what}: its fields are {', '.join(every)}, and each is given once")
    given = {name: one.default for name, one in every.items() if one.default is not MISSING} | given | {**named}
    if missing := [name for name in every if name not in given]:
        raise TypeError(f"{type(made).__name__}: {', '.join(missing)} missing")
    for one in fields(made):
        made.__dict__[one.name] = given.pop(one.name)
    if hasattr(made, "__post_init__"):
        made.__post_init__(*[given[name] for name in every if name in given])
