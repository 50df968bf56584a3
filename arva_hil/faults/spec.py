"""What faults there are, and how they are written: in a scenario, or on the command line."""

from __future__ import annotations

import math
import re
from collections.abc import Collection
from dataclasses import dataclass, fields
from typing import Any, Final, Literal, NamedTuple

import yaml

from arva_hil._yaml import Range, Reader, ScenarioError

__all__ = ["KINDS", "Fault", "misfit", "parse_fault", "plain_fault", "read_fault", "read_faults"]

Stage = Literal["heard", "sent", "wire"]

_SHARE: Final = Range(0, 1, "a probability", above=True)
_SECONDS: Final = Range(0, 60, "seconds", above=True)
_TRANSMITTER: Final = Range(0, 254, "a transmitter's id, a whole number")
_TIME_S: Final = Range(0, 1_000_000, "seconds")
_SPAN_S: Final = Range(0, 1_000_000, "seconds", above=True)
_WORLD_M: Final = (Range(-1_000_000, 1_000_000),) * 3
_NUMBER: Final = range(0, 1001)
_SCHEDULE: Final = "from_s until_s every_s for_s"
_WIRE_FORMATS: Final = ("binary", "nmea", "text")
_NUMBERED: Final = ("binary", "nmea", "tunnel")  # formats that carry sequence and status


class Kind(NamedTuple):
    """A sort of fault: where it strikes, which values it takes (None: only `true`), which keys it needs besides."""

    stage: Stage
    valid: Range | None
    needs: str = ""


KINDS: Final = {  # in the order in which they strike
    "transmitter_off": Kind("heard", _TRANSMITTER),
    "transmitter_moved": Kind("heard", _TRANSMITTER, "by_ned"),
    "transmitter_fading": Kind("heard", _TRANSMITTER, "over_s"),
    "interference": Kind("heard", Range(1, 1_000_000, above=True)),
    "stuck": Kind("heard", None),
    "silence": Kind("sent", None),
    "drop": Kind("sent", _SHARE),
    "self_test": Kind("sent", None),
    "sequence": Kind("sent", _SHARE),
    "duplicate": Kind("sent", _SHARE),
    "delay_s": Kind("sent", _SECONDS),
    "jitter_s": Kind("sent", _SECONDS),
    "reorder": Kind("sent", _SHARE),
    "truncate": Kind("wire", _SHARE),
    "corrupt": Kind("wire", _SHARE),
    "drop_bytes": Kind("wire", _SHARE),
    "insert_bytes": Kind("wire", _SHARE),
    "flip_bytes": Kind("wire", _SHARE),
    "baud_ratio": Kind("wire", Range(0.1, 10, above=True)),
}


@dataclass(frozen=True)
class Fault:
    """One fault and when it is on, in seconds from the start of the run.

    `value`: a probability a frame or a byte, seconds, a factor, a transmitter's id, or 1 where there is nothing to
    say but that it is on. From `from_s` until `until_s`, and with `every_s` only for the first `for_s` of each.
    """

    name: str
    value: float
    from_s: float = 0.0
    until_s: float = math.inf
    every_s: float | None = None
    for_s: float | None = None
    by_ned: tuple[float, float, float] | None = None  # metres, of transmitter_moved
    over_s: float | None = None  # until nothing is left, of transmitter_fading

    def since(self, time_us: int) -> int | None:
        """How long it has been on [µs] at `time_us`, None when it is off."""
        since = time_us - round(self.from_s * 1e6)
        if since < 0 or time_us >= self.until_s * 1e6 - 0.5:
            return None
        if self.every_s is not None and self.for_s is not None:
            since %= round(self.every_s * 1e6)
            if since >= self.for_s * 1e6 - 0.5:
                return None
        return since

    def __str__(self) -> str:
        """As on the command line."""
        plain = plain_fault(self)
        start, end = (f"{plain.pop(key):g}" if key in plain else "" for key in ("from_s", "until_s"))
        keys = (key if value is True else f"{key}={_short(value)}" for key, value in plain.items())
        return ",".join(keys) + (f"@{start}-{end}".removesuffix("-") if start or end else "")


def read_faults(r: Reader, node: yaml.Node | None, ids: Collection[int], format: str) -> tuple[Fault, ...]:
    """The faults in a list, for a scenario with these transmitters and this format."""
    faults = []
    for item in r.items(node, _NUMBER, "faults"):
        fault = read_fault(r, item)
        if fault is not None and (wrong := misfit(fault, ids, format)):
            r.wrong(item, *wrong)
        elif fault is not None:
            faults.append(fault)
    return tuple(faults)


def read_fault(r: Reader, node: yaml.Node) -> Fault | None:
    """The fault that a node is; None, and the reader knows why, when it is wrong."""
    mistakes = len(r.problems)
    items = node.value if isinstance(node, yaml.MappingNode) else []
    named = {key.value: key for key, _ in items if isinstance(key, yaml.ScalarNode) and key.value in KINDS}
    if len(named) != 1:
        every = " ".join(dict.fromkeys([*KINDS, *(key for kind in KINDS.values() for key in kind.needs.split())]))
        r.mapping(node, f"{every} {_SCHEDULE}")
        if len(named) > 1:
            first, second = list(named)[:2]
            r.wrong(named[second], f"both {first} and {second}", "one fault an item")
        elif mistakes == len(r.problems):
            r.wrong(node, "no fault", f"one of {', '.join(KINDS)}")
        return None
    (name,) = named
    kind = KINDS[name]
    f = r.mapping(node, f"{name} {kind.needs} {_SCHEDULE}", need=[name, *kind.needs.split()])
    value: float = 1
    if kind.valid is None:
        r.word(f[name], "true", ("true",))
    elif kind.valid is _TRANSMITTER:
        value = r.integer(f[name], 0, kind.valid)
    else:
        value = r.number(f[name], 1, kind.valid)
    fault = Fault(
        name,
        value,
        from_s=r.number(f.get("from_s"), 0.0, _TIME_S),
        until_s=r.number(f.get("until_s"), math.inf, _TIME_S),
        every_s=r.number(f["every_s"], 1, _SPAN_S) if "every_s" in f else None,
        for_s=r.number(f["for_s"], 1, _SPAN_S) if "for_s" in f else None,
        by_ned=r.triple(f["by_ned"], (0, 0, 0), _WORLD_M) if "by_ned" in f else None,
        over_s=r.number(f["over_s"], 1, _SPAN_S) if "over_s" in f else None,
    )
    if mistakes == len(r.problems):
        _check_schedule(r, fault, f, node)
    return fault if mistakes == len(r.problems) else None


def _check_schedule(r: Reader, fault: Fault, f: dict[str, yaml.Node], node: yaml.Node) -> None:
    every_s, for_s = fault.every_s, fault.for_s
    if fault.until_s <= fault.from_s:
        r.wrong(f["until_s"], f"until_s {fault.until_s:g}", f"later than from_s ({fault.from_s:g})")
    if every_s is not None and for_s is not None:
        if for_s >= every_s:
            r.wrong(f["for_s"], f"for_s {for_s:g}", f"less than every_s ({every_s:g})")
    elif every_s is not None or for_s is not None:
        r.wrong(node, "every_s without for_s" if for_s is None else "for_s without every_s", "both or neither")


def misfit(fault: Fault, ids: Collection[int], format: str) -> tuple[str, str] | None:
    """What was found and what was expected, when a scenario with these transmitters and this format cannot have it."""
    kind = KINDS[fault.name]
    if kind.valid is _TRANSMITTER and fault.value not in ids:
        return f"{fault.name} of transmitter {fault.value:g}", f"one of {', '.join(map(str, sorted(ids)))}"
    if kind.stage == "wire" and format not in _WIRE_FORMATS:
        return (
            f"{fault.name} with the format {format}",
            f"{' or '.join(_WIRE_FORMATS)}, because it would break the autopilot's own link",
        )
    if fault.name in ("sequence", "self_test") and format not in _NUMBERED:
        return f"{fault.name} with the format {format}", f"{' or '.join(_NUMBERED)}, which carry it"
    return None


def plain_fault(fault: Fault) -> dict[str, Any]:
    """The fault as plain JSON types; `read_fault` reads it back equal."""
    kind = KINDS[fault.name]
    plain: dict[str, Any] = {fault.name: True if kind.valid is None else fault.value}
    for key in fields(fault):
        value = getattr(fault, key.name)
        if key.name not in ("name", "value") and value != key.default:
            plain[key.name] = list(value) if isinstance(value, tuple) else value
    return plain


_VALUE: Final = r"\[[\w.+,-]*\]|[\w.+-]*"
_TIME: Final = r"(?:\d[\d.]*)?"
_OPTION: Final = re.compile(rf"(\w+(?:=(?:{_VALUE}))?(?:,\w+(?:=(?:{_VALUE}))?)*)(?:@({_TIME})(?:-({_TIME}))?)?")


def parse_fault(text: str) -> Fault:
    """The fault that `NAME=VALUE,KEY=VALUE@FROM-UNTIL` is. Raises ValueError that says what is wrong with it."""
    match = _OPTION.fullmatch(text)
    if match is None or ("@" in text and not any(match.groups()[1:])):
        raise ValueError(f"{text!r}: expected NAME=VALUE@FROM-UNTIL, e.g. drop=0.02@10-60 or silence@30-35")
    keys, start, end = match.groups()
    pairs = [item.partition("=") for item in re.split(r",(?![^\[]*\])", keys)]
    pairs += [(key, "=", time) for key, time in (("from_s", start), ("until_s", end)) if time]
    try:
        r = Reader("{" + ", ".join(f"{key}: {value if equals else 'true'}" for key, equals, value in pairs) + "}", text)
        fault = read_fault(r, r.root)
        r.finish()
    except ScenarioError as error:
        hints = (f", did you mean {p.nearest!r}?" if p.nearest else "" for p in error.problems)
        why = (f"{p.found}, expected {p.expected}{hint}" for p, hint in zip(error.problems, hints, strict=True))
        raise ValueError(f"{text!r}: {'; '.join(why)}") from None
    assert fault is not None
    return fault


def _short(value: Any) -> str:
    return f"[{','.join(f'{x:g}' for x in value)}]" if isinstance(value, list) else f"{value:g}"
