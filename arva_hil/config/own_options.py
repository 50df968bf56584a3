"""Own keys of receiver models, faults and observers: the fields of their `Options`, a dataclass.

Their constraints follow from their annotations: the type, and limits of annotated-types (`Annotated[int, Ge(1)]`).
"""

import functools
import math
import numbers
import operator
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import MISSING, dataclass, fields, is_dataclass
from enum import Enum
from types import NoneType, UnionType
from typing import Annotated, Any, Final, Literal, Union, get_args, get_origin, get_type_hints

from arva_hil.config.constraints import FLOAT, WHOLE, Constraint, read_each
from arva_hil.config.errors import ConstraintError, wrong
from arva_hil.errors import KindError

_LIMITS: Final = {  # by the name in annotated-types: the comparison, its words, its name in a JSON Schema
    "gt": (operator.gt, "greater than", "exclusiveMinimum"),
    "ge": (operator.ge, "greater than or equal to", "minimum"),
    "lt": (operator.lt, "less than", "exclusiveMaximum"),
    "le": (operator.le, "less than or equal to", "maximum"),
}
_TRUE: Final = "(?i:true|yes|on|y|t|1)"
_TYPES: Final[Mapping[Any, tuple[str, str, Any]]] = {  # the name in a JSON Schema, the texts, the values in Python
    bool: ("boolean", rf"{_TRUE}|(?i:false|no|off|n|f|0)", bool),
    int: ("integer", rf"(?:{WHOLE.pattern})(?:\.0*)?", numbers.Integral),
    float: ("number", FLOAT.pattern, numbers.Real),
    str: ("string", "(?s:.*)", str),
}


@dataclass(frozen=True)
class OwnKey(Constraint):
    """The constraint of a field. `hint`: its annotation; `default`: MISSING if it has none, or makes one."""

    hint: Any
    default: Any
    required: bool

    def read(self, value: Any) -> Any:
        return _read(self.hint, value)

    def json(self) -> dict[str, Any]:
        has_one = isinstance(self.default, str | int | float | tuple) and not isinstance(self.default, Enum)
        return _schema(self.hint) | ({"default": self.plain(self.default, 1)} if has_one else {})


def own_keys(cls: type[Any] | None) -> Mapping[str, OwnKey]:
    """Return the constraints of own keys; `cls`: the class of the options, None without one."""
    if cls is None:
        return {}
    if not isinstance(cls, type) or not is_dataclass(cls):
        named = getattr(cls, "__qualname__", repr(cls))
        raise KindError(f"the Options {named} are no dataclass", "decorate them with @dataclass")
    try:
        hints = get_type_hints(cls, include_extras=True)
    except Exception as error:  # e.g. a name that is imported under TYPE_CHECKING
        raise KindError(
            f"the Options {cls.__qualname__} have an annotation that cannot be read ({error})", "import its names"
        ) from error
    return {
        one.name: OwnKey(hints[one.name], one.default, one.default is MISSING and one.default_factory is MISSING)
        for one in fields(cls)
    }


def required_keys(cls: type[Any] | None) -> list[str]:
    """Return the own keys without a default."""
    return [name for name, one in own_keys(cls).items() if one.required]


def _read(hint: Any, value: Any) -> Any:
    """Return a value of a file or of Python as the type that is annotated."""
    origin, args = get_origin(hint), get_args(hint)
    if origin is Annotated:
        made = _read(args[0], value)
        for limit, (fits, words, _) in _limits(args):
            if made is not None and not fits(made, limit):
                raise wrong(f"{words} {limit}")
        return made
    if origin in (Union, UnionType):  # with None
        return None if getattr(value, "plain", value) in (None, "null", "~") else _read(_not_none(args), value)
    if origin in (tuple, list):
        return _several(origin, args, value)
    if origin is Literal:
        return _word(args, value)
    return _one(hint, value)


def _one(cls: Any, value: Any) -> Any:
    """Return a value of a simple type, or of a class that is made of a text."""
    name, texts, kinds = _TYPES.get(cls, (cls.__name__, "(?s:.+)", cls))
    plain = getattr(value, "plain", value) if cls in (bool, int, float) else value
    if isinstance(plain, str):
        fits = bool(re.fullmatch(texts, plain))
    else:
        fits = isinstance(plain, kinds) and (cls is bool or not isinstance(plain, bool))
    if not fits:
        raise wrong(f"a valid {name}")
    if cls is bool:
        return bool(re.fullmatch(_TRUE, str(plain)))
    try:
        made = cls(plain.partition(".")[0] if cls is int and isinstance(plain, str) else plain)
    except (ValueError, OverflowError):  # of another class; a whole number too large for a float
        raise wrong(f"a valid {name}") from None
    if cls is float and not math.isfinite(made):
        raise wrong("a finite number")
    return made


def _word(words: Sequence[Any], value: Any) -> Any:
    """Return the word that the value is."""
    made = value
    with suppress(ConstraintError):
        made = _one(type(words[0]), value)
    if made not in words:
        *first, last = map(repr, words)
        raise wrong(f"{', '.join(first)} or {last}" if first else last)
    return made


def _several(cls: Any, args: Sequence[Any], value: Any) -> Any:
    """Return a list or a tuple. `args`: the types of its items, or one and an ellipsis for any number."""
    if isinstance(value, str) or not isinstance(value, Sequence):
        raise wrong(f"a valid {cls.__name__}")
    each = [args[0]] * len(value) if cls is list or args[-1] is ... else args
    if len(value) != len(each):
        raise wrong(f"a list of {len(each)}")
    values, violations = read_each(value, [functools.partial(_read, one) for one in each])
    if violations:
        raise ConstraintError(*violations)
    return cls(values)


def _schema(hint: Any) -> dict[str, Any]:
    """Return the JSON Schema of the type that is annotated."""
    origin, args = get_origin(hint), get_args(hint)
    if origin is Annotated:
        return _schema(args[0]) | {name: limit for limit, (_, _, name) in _limits(args)}
    if origin in (Union, UnionType):
        return _schema(_not_none(args))
    if origin is Literal:
        return {"enum": list(args)} | _schema(type(args[0]))
    if origin is list or (origin is tuple and args[-1] is ...):
        return {"type": "array", "items": _schema(args[0])}
    if origin is tuple:
        size = len(args)
        return {"type": "array", "minItems": size, "maxItems": size, "prefixItems": [_schema(one) for one in args]}
    return {"type": _TYPES[hint][0] if hint in _TYPES else "string"}


def _limits(args: Sequence[Any]) -> Iterator[tuple[Any, tuple[Any, str, str]]]:
    """Yield the limits in an annotation."""
    for annotation in args[1:]:
        for name, limit in _LIMITS.items():
            if (value := getattr(annotation, name, None)) is not None:
                yield value, limit


def _not_none(args: Sequence[Any]) -> Any:
    """Return the type in `X | None`."""
    return next(one for one in args if one is not NoneType)
