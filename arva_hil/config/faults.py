"""The faults of a scenario and of the command line: their names, values and schedule."""

import math
import re
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import asdict, fields, replace
from typing import Any, Final, Literal, NamedTuple

from arva_hil.config.common import NED_POINT, SPAN, TRANSMITTER_ID, Triple
from arva_hil.config.constraints import Anything, Constraint, Named, Number, On, Whole
from arva_hil.config.errors import ConstraintError, ScenarioError, Violation, wrong
from arva_hil.config.own_options import own_keys
from arva_hil.config.tables import Table, key, own_options, read_keys, read_own, unknown_key
from arva_hil.errors import KindError
from arva_hil.registry import FAULTS, FORMATS, over_mavlink

Stage = Literal["heard", "sent", "wire"]

SHARE: Final = Number(0, 1, "a probability", above=True)
SECONDS: Final = Number(0, 60, "seconds", above=True, unit="s")
TRANSMITTER: Final = Whole(TRANSMITTER_ID.low, TRANSMITTER_ID.high, "a transmitter's id, a whole number")
_TIME: Final = Number(0, 1_000_000, "seconds", unit="s", endless=True)
_SCHEDULE: Final = ("from_s", "until_s", "every_s", "for_s")
_SAME: Final = {"lag": "delay_s", "latency": "delay_s", "loss": "drop", "noise": "interference"}
_OTHER: Final = ("by_ned", "over_s", *_SCHEDULE)  # keys beside the name of a fault


class FaultKind(NamedTuple):
    """A kind of fault: its stage, its valid values (None: only `true`), its help, and the other keys that it needs.

    `strike` depends on the stage; None: `arva_hil.emulator.faults` handles the fault by its name.

    - `heard`: (look, switch) returns the changed sample.
    - `sent`: (sending, value, random) changes the sending of a frame, and returns True if it did.
    - `wire`: (bytes of a frame, value, random) returns the changed bytes and the number of changes.

    `options`: a dataclass whose fields are own keys of the fault; `strike` gets it as the argument `options`.
    """

    stage: Stage
    valid: Number | Whole | None
    help: str
    strike: Callable[..., Any] | None
    needs: tuple[str, ...] = ()
    options: type[Any] | None = None

    @property
    def constraint(self) -> Constraint:
        """The constraint on its value."""
        return self.valid or On()


class Fault(Table):
    """One fault and when it is on, in seconds from the start of the run.

    `value`: a probability per frame or byte, seconds, a factor, a transmitter's id, or 1 for a fault without a value.
    The fault is on from `from_s` until `until_s`; with `every_s` only for the first `for_s` of each period.
    Raises ValueError for a wrong name, value or schedule.
    """

    name: str = key(Named(FAULTS))
    value: float = key(Anything())
    from_s: float = key(_TIME, "on from this time of the run", default=0.0)
    until_s: float = key(_TIME, "off from this time of the run; without it never", default=math.inf)
    every_s: float | None = key(SPAN, "repeated: time from one start to the next", default=None)
    for_s: float | None = key(SPAN, "with every_s: duration of each", default=None)
    by_ned: Triple | None = key(NED_POINT, "of transmitter_moved: north, east, down", default=None)
    over_s: float | None = key(SPAN, "of transmitter_fading: time to silence", default=None)

    options: Any = key(Anything(), default=None)

    def __post_init__(self) -> None:
        kind: FaultKind = FAULTS[self.name]
        object.__setattr__(self, "value", kind.constraint.read(self.value))
        object.__setattr__(self, "options", own_options(kind.options, self.options, f"the fault {self.name}"))

    @classmethod
    def conflicts(cls, fault: Any) -> Iterator[Violation]:
        kind: FaultKind = FAULTS[fault.name]
        try:
            kind.constraint.read(fault.value)
        except ConstraintError as error:
            yield from error.below("value")
        for name in kind.needs:
            if getattr(fault, name) is None:
                yield Violation(f"a fault with {name}", f"{fault.name} without {name}")
        if fault.until_s <= fault.from_s:
            yield Violation(f"later than from_s ({fault.from_s:g})", f"until_s {fault.until_s:g}", path=("until_s",))
        if fault.every_s is None or fault.for_s is None:
            if fault.every_s is not fault.for_s:
                yield Violation(
                    "both or neither", "every_s without for_s" if fault.for_s is None else "for_s without every_s"
                )
        elif fault.for_s >= fault.every_s:
            yield Violation(f"less than every_s ({fault.every_s:g})", f"for_s {fault.for_s:g}", path=("for_s",))

    def since(self, time_us: int) -> int | None:
        """Return the time since it was switched on [µs] at `time_us`, None if it is off."""
        since = time_us - round(self.from_s * 1e6)
        if since < 0 or time_us >= self.until_s * 1e6 - 0.5:
            return None
        if self.every_s is not None and self.for_s is not None:
            since %= max(1, round(self.every_s * 1e6))
            if since >= self.for_s * 1e6 - 0.5:
                return None
        return since

    def __str__(self) -> str:
        """Return the fault as on the command line."""
        plain = plain_fault(self)
        start, end = (f"{plain.pop(key):g}" if key in plain else "" for key in ("from_s", "until_s"))
        keys = (key if value is True else f"{key}={_short(value)}" for key, value in plain.items())
        return ",".join(keys) + (f"@{start}-{end}".removesuffix("-") if start or end else "")


class FaultItem(Constraint):
    """A fault as a file has it: a mapping with the name of one fault, and its schedule."""

    table = Fault
    kind = "a mapping"

    def __str__(self) -> str:
        return "a mapping with the name of a fault"

    def read(self, value: Any) -> Fault:
        if isinstance(value, Fault):
            return value
        if not isinstance(value, dict):
            raise wrong(f"a mapping with {', '.join([*FAULTS, *_OTHER])}")
        named = [key for key in value if key in [*FAULTS] or (key not in _OTHER and key in FAULTS)]  # ours first
        if len(named) != 1:
            raise ConstraintError(*_not_one(value, named))
        (name,) = named
        try:
            kind: FaultKind = FAULTS[name]
        except KindError as error:
            raise ConstraintError(
                Violation(f"one that works: {error.cure}", error.found, None, (name,), at_key=True)
            ) from None
        options, violations = read_own(kind.options, value, f"the fault {name}")
        keys = _keys(name)
        values, more = read_keys(value, keys | dict.fromkeys(own_keys(kind.options), Anything()), [name, *kind.needs])
        if violations := [*more, *violations]:
            raise ConstraintError(*violations)
        values = {key: item for key, item in values.items() if key in keys}
        return Fault(name, values.pop(name), **values, options=options)

    def plain(self, value: Fault, spec: int) -> Any:
        return plain_fault(value)

    def json(self) -> dict[str, Any]:
        return {"oneOf": [_schema(name, FAULTS[name]) for name in FAULTS.names()]}


def _schema(name: str, kind: FaultKind) -> dict[str, Any]:
    """Return the JSON Schema of one fault."""
    helps = {key: one.help for key, one in Fault.__table__.items()} | {name: kind.help}
    properties = {key: one.json() | {"description": helps[key]} for key, one in _keys(name).items()}
    properties |= {key: one.json() for key, one in own_keys(kind.options).items()}
    return {"type": "object", "properties": properties, "required": [name, *kind.needs], "additionalProperties": False}


def _keys(name: str) -> dict[str, Constraint]:
    kind: FaultKind = FAULTS[name]
    return {name: kind.constraint} | {key: Fault.__table__[key].constraint for key in (*kind.needs, *_SCHEDULE)}


def _not_one(value: Mapping[str, Any], named: list[str]) -> Iterator[Violation]:
    """Yield the errors of a mapping that is not one fault."""
    known = [*FAULTS, *_OTHER]
    if unknown := [unknown_key(value, name, known) for name in value if name not in known]:
        yield from (replace(one, nearest=_SAME.get(str(one.path[0]), one.nearest)) for one in unknown)
    elif not named:
        yield Violation(f"one of {', '.join(FAULTS)}", "no fault")
    if len(named) > 1:
        yield Violation("one fault an item", f"both {named[0]} and {named[1]}", None, (named[1],), at_key=True)


def misfit(fault: Fault, ids: Collection[int], format: str) -> tuple[str, str] | None:
    """Return what was found and what was expected if the fault does not fit these transmitters and this format."""
    kind: FaultKind = FAULTS[fault.name]
    if kind.valid is TRANSMITTER and fault.value not in ids:
        return f"{fault.name} of transmitter {fault.value:g}", f"one of {', '.join(map(str, sorted(ids)))}"
    if kind.stage == "wire" and over_mavlink(format):
        return (
            f"{fault.name} with the format {format}",
            f"{' or '.join(name for name in FORMATS if not over_mavlink(name))}, because it would break the "
            "autopilot's own link",
        )
    if fault.name in ("sequence", "self_test") and not FORMATS[format].numbered:
        return (
            f"{fault.name} with the format {format}",
            f"{' or '.join(name for name in FORMATS if FORMATS[name].numbered)}, which carry it",
        )
    return None


def plain_fault(fault: Fault) -> dict[str, Any]:
    """Return the fault as plain JSON types, from which a file gives an equal fault."""
    plain: dict[str, Any] = {fault.name: True if FAULTS[fault.name].valid is None else fault.value}
    if fault.options is not None:
        own = asdict(fault.options)
        plain |= {one.name: own[one.name] for one in fields(fault.options) if own[one.name] != one.default}
    for one in fields(fault):
        value = getattr(fault, one.name)
        if one.name not in ("name", "value", "options") and value != one.default:
            plain[one.name] = list(value) if isinstance(value, tuple) else value
    return plain


_VALUE: Final = r"\[[\w.+,-]*\]|[\w.+-]*"
_CLOCK: Final = r"(?:\d[\d.]*)?"
_OPTION: Final = re.compile(rf"(\w+(?:=(?:{_VALUE}))?(?:,\w+(?:=(?:{_VALUE}))?)*)(?:@({_CLOCK})(?:-({_CLOCK}))?)?")


def parse_fault(text: str) -> Fault:
    """Parse `NAME=VALUE,KEY=VALUE@FROM-UNTIL`. Raises ValueError with the mistake and the cure."""
    if share := re.search(r"=(\d+\.?\d*)%", text):
        raise ValueError(f"{text!r}: {share[1]}%, expected a share of 1: write {float(share[1]) / 100:g}")
    match = _OPTION.fullmatch(text)
    if match is None or ("@" in text and not any(match.groups()[1:])):
        raise ValueError(f"{text!r}: expected NAME=VALUE@FROM-UNTIL, e.g. drop=0.02@10-60 or silence@30-35")
    keys, start, end = match.groups()
    name, equals, _ = keys.partition(",")[0].partition("=")
    if not equals and name in FAULTS and FAULTS[name].valid:
        raise ValueError(f"{text!r}: {name} without a value, expected {FAULTS[name].valid}, e.g. {_example(name)}")
    pairs = [item.partition("=") for item in re.split(r",(?![^\[]*\])", keys)]
    pairs += [(key, "=", time) for key, time in (("from_s", start), ("until_s", end)) if time]
    file = "{" + ", ".join(f"{key}: {value if equals else 'true'}" for key, equals, value in pairs) + "}"
    from arva_hil.config.reading import read  # slow to import

    try:
        return read(file, text, "a fault", FaultItem().read)
    except ScenarioError as error:
        hints = (f", did you mean {p.nearest!r}?" if p.nearest else "" for p in error.problems)
        why = (f"{p.found}, expected {p.expected}{hint}" for p, hint in zip(error.problems, hints, strict=True))
        raise ValueError(f"{text!r}: {'; '.join(why)}") from None


def _example(name: str) -> str:
    """Return a fault with a valid value, as on the command line."""
    kind: FaultKind = FAULTS[name]
    assert kind.valid
    usual = (value for value in (0.05, 1, 2, kind.valid.high) if value in kind.valid)
    value = 1 if isinstance(kind.valid, Whole) else next(usual)
    return ",".join([f"{name}={value:g}", *(f"{need}=…" for need in kind.needs)])


def _short(value: Any) -> str:
    if isinstance(value, str):
        return value
    return f"[{','.join(f'{x:g}' for x in value)}]" if isinstance(value, list) else f"{value:g}"
