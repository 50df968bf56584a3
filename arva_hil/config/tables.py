"""Tables: frozen dataclasses that are mappings of a file too. Each key is declared once, with its constraint and help.

    rate_hz: float = key(Number(0.1, 50, unit="Hz"), "frames a second", default=1.0)

is one key of files. It is checked in files and in Python, and is in the JSON Schema and on the reference page.
"""

from __future__ import annotations

import functools
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import MISSING, InitVar, dataclass, field, replace
from types import SimpleNamespace
from typing import Any, ClassVar, NamedTuple, dataclass_transform, get_args

from arva_hil.config.constraints import Anything, Constraint
from arva_hil.config.errors import ConstraintError, Violation, any_of, short, wrong
from arva_hil.config.nodes import NEWEST_SPEC
from arva_hil.config.own_options import own_keys, required_keys
from arva_hil.errors import nearest


def key(constraint: Constraint | None = None, help: str = "", *, since: int = 1, **more: Any) -> Any:
    """Declare a field of a table, and a key of files from spec `since` on. Without `help` it is not a key of files.

    `constraint`: None if it is the table of the annotation. `more`: as of `dataclasses.field`, e.g. `default`.
    """
    return field(**more, metadata={"constraint": constraint, "help": help, "since": since if help else 0})


class Field(NamedTuple):
    """A declared field of a table. `since`: the first spec that has it; 0: it is not a key of files."""

    constraint: Constraint
    help: str
    since: int
    default: Any  # MISSING if there is none
    file_only: bool
    optional: bool  # may be None in Python


class Given(SimpleNamespace):
    """A table of a file that is not wholly valid: its fields, None where wrong. `mapping`: the file's."""


@dataclass_transform(frozen_default=True, field_specifiers=(key,))
class Table:
    """Makes each subclass a frozen dataclass that checks its values, and can be read from a mapping of a file.

    Its fields are made by `key`; an InitVar is a key of files alone. A file has all keys without a default, those in
    `required`, and exactly one of those in `one_of`. Raises ConstraintError, a ValueError.
    """

    __table__: ClassVar[dict[str, Field]]
    """All fields, also those of files alone and those of Python alone."""
    __defaults__: ClassVar[dict[str, Any]]
    """The default of each field, None without one."""
    __required__: ClassVar[list[str]]
    __one_of__: ClassVar[list[str]]

    def __init_subclass__(cls, *, required: str = "", one_of: str = "") -> None:
        made: Any = cls
        if "__post_init__" in vars(cls):
            made.__finish__ = made.__post_init__
        made.__post_init__ = _check
        dataclass(frozen=True)(cls)
        made.__table__ = {one.name: _declared(one) for one in made.__dataclass_fields__.values()}
        made.__defaults__ = {
            name: None if one.default is MISSING else one.default for name, one in made.__table__.items()
        }
        made.__required__ = [*(name for name, one in keys(made).items() if one.default is MISSING), *required.split()]
        made.__one_of__ = one_of.split()

    @classmethod
    def conflicts(cls, of: Any) -> Iterable[Violation]:
        """Return the violations between values of an object, or of a `Given` part of one."""
        return ()

    @classmethod
    def own_class(cls, mapping: Mapping[str, Any]) -> tuple[type[Any] | None, str]:
        """Return the class of own keys in a file's mapping, for the field `options`, and their owner for messages."""
        return None, ""

    @classmethod
    def other_schemas(cls) -> Mapping[str, Any]:
        """Return the JSON Schemas of keys that are not declared."""
        return {}

    def file_keys(self) -> Mapping[str, Any]:
        """Return the keys that differ between a file and Python."""
        return {}


def _declared(one: Any) -> Field:
    file_only = isinstance(one.type, InitVar)
    of = one.type.type if file_only else one.type
    return Field(
        one.metadata["constraint"] or TableOf(*(cls for cls in (of, *get_args(of)) if is_table(cls))),
        one.metadata["help"],
        one.metadata["since"],
        one.default,
        file_only,
        type(None) in get_args(of),
    )


def is_table(value: Any) -> bool:
    """Return True for a table and for a class of tables."""
    return hasattr(value, "__table__")


@functools.cache
def keys(cls: Any, spec: int = 1_000) -> Mapping[str, Field]:
    """Return the keys of a table that files of a spec have."""
    return {name: one for name, one in cls.__table__.items() if 0 < one.since <= spec}


@functools.cache
def _constraints(cls: Any, spec: int) -> dict[str, Constraint]:
    return {name: one.constraint for name, one in keys(cls, spec).items()}


def newer_keys(value: Any) -> set[str]:
    """Return the keys of a table, and of tables in it, that are not in spec 1 and do not have the default value."""
    found = set()
    cls: Any = type(value)
    for name, one in keys(cls).items() if is_table(value) else ():
        item = getattr(value, name)
        if one.since > 1 and item != one.default:
            found.add(name)
        found = found.union(*map(newer_keys, item if isinstance(item, tuple) else (item,)))
    return found


def _check(self: Any, *init_vars: Any) -> None:
    """Check the values of a new table; used as its `__post_init__`."""
    fields, for_file = self.__table__, iter(init_vars)
    values = {name: next(for_file) if one.file_only else getattr(self, name) for name, one in fields.items()}
    unusual = {
        name: values[name]
        for name, one in fields.items()
        if values[name] is not one.default and not (values[name] is None and one.optional)
    }
    right, violations = read_keys(unusual, {name: one.constraint for name, one in fields.items()})
    for name, value in right.items():
        if not fields[name].file_only:
            object.__setattr__(self, name, value)
    if every := violations or [*self.conflicts(self)]:
        raise ConstraintError(*(_described(one, values) for one in every), of=type(self).__name__)
    if hasattr(self, "__finish__"):
        self.__finish__(*((values | right)[name] for name, one in fields.items() if one.file_only))


def _made(cls: Any, values: Mapping[str, Any]) -> Any:
    """Make a table of checked values."""
    made, for_file = object.__new__(cls), []
    for name, one in cls.__table__.items():
        value = values.get(name, one.default)
        if one.file_only:
            for_file.append(value)
        else:
            object.__setattr__(made, name, value)
    if hasattr(cls, "__finish__"):
        made.__finish__(*for_file)
    return made


def _described(violation: Violation, value: Any) -> Violation:
    """Return a violation in Python, with the value that was found."""
    for step in violation.path if violation.found is None else ():
        value = getattr(value, str(step)) if is_table(value) else value[step]
    return replace(violation, found=violation.found or short(repr(value)))


class TableOf(Constraint):
    """A table: a mapping in a file, an object of the class in Python. `more`: fields that are no keys of a file."""

    kind = "a mapping"

    def __init__(self, cls: Any, **more: Any) -> None:
        self.table = cls
        self._more = more

    def __str__(self) -> str:
        return f"a mapping with {', '.join(keys(self.table))}"

    def read(self, value: Any) -> Any:
        cls = self.table
        if isinstance(value, cls):
            return value
        known = _constraints(cls, getattr(value, "spec", NEWEST_SPEC))  # values of Python are of the newest
        if not isinstance(value, Mapping):
            raise wrong(f"a mapping with {', '.join(known)}")
        own, owner = cls.own_class(value)
        valid = known | dict.fromkeys(own_keys(own), Anything()) if own else known
        values, violations = read_keys(value, valid, cls.__required__, cls.__one_of__, keys(cls))
        if own:
            options, more = read_own(own, value, owner)
            values = {name: item for name, item in values.items() if name in known} | {"options": options}
            violations += more
        given = Given(**cls.__defaults__ | values, mapping=value)
        violations += cls.conflicts(given)
        if violations:
            raise ConstraintError(*violations, given=given)
        return _made(cls, values | self._more)

    def plain(self, value: Any, spec: int) -> Any:
        file_keys: dict[str, Any] = dict(value.file_keys())
        made: dict[str, Any] = {}
        for name, one in keys(self.table, spec).items():
            item = None if one.file_only else getattr(value, name)
            if name in file_keys:
                made[name] = file_keys.pop(name)
            elif item is not None and (item != () or one.since == 1):
                made[name] = one.constraint.plain(item, spec)
        return file_keys | made

    def json(self) -> dict[str, Any]:
        cls = self.table
        properties = dict(cls.other_schemas())
        for name, one in keys(cls).items():
            properties[name] = one.constraint.json() | {"description": one.help} | _json_default(one)
        schema = {"type": "object", "properties": properties, "additionalProperties": False}
        if cls.__required__:
            schema["required"] = cls.__required__
        if cls.__one_of__:
            schema["oneOf"] = [{"required": [name]} for name in cls.__one_of__]
        return schema


def _json_default(one: Field) -> dict[str, Any]:
    """Return the default of a key, if a file can contain it."""
    if isinstance(one.default, tuple) and all(isinstance(item, int | float) for item in one.default):
        return {} if isinstance(one.constraint, TableOf) else {"default": list(one.default)}
    return {"default": one.default} if isinstance(one.default, str | int | float) else {}


def read_keys(
    mapping: Mapping[str, Any],
    valid: Mapping[str, Constraint],
    required: Iterable[str] = (),
    one_of: Iterable[str] = (),
    newer: Mapping[str, Field] | None = None,
) -> tuple[dict[str, Any], list[Violation]]:
    """Read a mapping. Returns its values, the given parts of wrong ones, and all problems.

    `valid`: its keys. It has those in `required`, and exactly one of those in `one_of`, as far as they are valid.
    `newer`: the keys of files of any spec.
    """
    values: dict[str, Any] = {}
    violations: list[Violation] = []
    for name, item in mapping.items():
        if name not in valid:
            violations.append(unknown_key(mapping, name, valid, newer))
            continue
        try:
            values[name] = valid[name].read(item)
        except ConstraintError as error:
            values[name] = error.given
            violations += error.below(name)
    for name in required:
        if name not in mapping:
            violations.append(Violation(f"a mapping with {name}", f"no {name}"))
    if one_of and (group := [name for name in one_of if name in valid]):
        given = [name for name in mapping if name in group]
        expected = f"a mapping with exactly one of {', '.join(group)}"
        if not given:
            violations.append(Violation(expected, f"no {' or '.join(group)}"))
        for name in given[1:]:
            violations.append(Violation(expected, f"both {given[0]} and {name}", None, (name,), at_key=True))
    return values, violations


def unknown_key(
    mapping: Mapping[str, Any], name: str, valid: Collection[str], newer: Mapping[str, Field] | None = None
) -> Violation:
    """Return the violation of an unknown or repeated key."""
    text, shown = name, repr(name)
    if hasattr(mapping, "key_nodes"):
        from arva_hil.config.reading import describe, text_of  # imports yaml; here it is imported already

        text, shown = text_of(mapping.key_nodes[name]), describe(mapping.key_nodes[name])
        if text in valid:
            return Violation("each key once", f"key {text!r} again", None, (name,), at_key=True, first=(text,))
    if newer and text in newer:
        spec = newer[text].since
        return Violation(
            f"`spec: {spec}` at the top of the file", f"key {shown} of spec {spec}", None, (name,), at_key=True
        )
    return Violation(any_of(valid), f"unknown key {shown}", nearest(text.lower(), valid), (name,), at_key=True)


def valid_value(cls: Any, mapping: Mapping[str, Any], key: str) -> Any:
    """Return the value of a key in an unread mapping; the default if it is absent, None if it is wrong."""
    one = cls.__table__[key]
    try:
        return one.constraint.read(mapping[key]) if key in mapping else one.default
    except ConstraintError:
        return None


def lacks(of: Any, key: str) -> bool:
    """Return True if a table, or a `Given` part of one, lacks a key; a wrong value counts as present."""
    return getattr(of, key) is None and not (isinstance(of, Given) and key in of.mapping)


def items_of(of: Any, key: str) -> list[tuple[tuple[str | int, ...], Any]]:
    """Return the items of a list in a table, each with its path; empty items of a file are left out."""
    return [((key, at), one) for at, one in enumerate(getattr(of, key) or ()) if one is not None]


def duplicates(items: Iterable[tuple[tuple[str | int, ...], Any]], key: str, what: str) -> Iterator[Violation]:
    """Yield the violations where several tables have the same value of a key; each table comes with its path."""
    seen: dict[Any, tuple[str | int, ...]] = {}
    for path, one in items:
        value = getattr(one, key)
        if value is not None and (first := seen.setdefault(value, path)) != path:
            expected = f"{'an' if key[0] in 'aeiou' else 'a'} {key} of its own"
            yield Violation(expected, f"{what} {value} again", None, (*path, key), first=(*first, key))


def read_own(cls: type[Any] | None, mapping: Mapping[str, Any], owner: str) -> tuple[Any, list[Violation]]:
    """Return the options of the class in a mapping of a file, which may have other keys; and all problems."""
    own = own_keys(cls)
    values, violations = read_keys({name: mapping[name] for name in own if name in mapping}, own, required_keys(cls))
    if cls is None or violations:
        return None, violations
    try:
        return cls(**values), []
    except ValueError as error:  # of its `__post_init__`
        found, _, expected = str(error).partition(": expected ")
        return None, [Violation(expected or f"what {owner} takes", found or None)]


def own_options(cls: type[Any] | None, options: Any, owner: str) -> Any:
    """Return the options from Python: of `cls`, a mapping, or None for the defaults. Raises ValueError."""
    if cls is None:
        if options is not None:
            raise ValueError(f"options: {options!r}, expected None: {owner} has no keys of its own")
        return None
    own = own_keys(cls)
    if isinstance(options, cls):
        return options
    if not isinstance(options, Mapping | None):
        raise ValueError(f"options: {options!r}, expected {cls.__qualname__} or a mapping")
    if unknown := [name for name in options or () if name not in own]:
        raise ValueError(f"options: {unknown[0]!r}, expected {any_of(own)}")
    values, violations = read_keys(options or {}, own, required_keys(cls))
    if violations:
        raise ConstraintError(*(_described(one, options) for one in violations))
    return cls(**values)
