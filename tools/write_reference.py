"""Writes the JSON Schemas from the declarations in arva_hil/config, and makes the tables of docs/scenario.md."""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, get_type_hints

from arva_hil.config.campaign import CampaignPlan, Random
from arva_hil.config.common import Angles
from arva_hil.config.constraints import ListOf
from arva_hil.config.faults import Fault
from arva_hil.config.json_schema import FILES, schema_text
from arva_hil.config.receiver import ReceiverOptions
from arva_hil.config.scenario import Scenario
from arva_hil.config.tables import Field, TableOf, keys
from arva_hil.config.vehicles import ReceiverEntry
from arva_hil.registry import FAULTS, RECEIVERS

ROOT = Path(__file__).parent.parent


def main() -> None:
    for kind in FILES:
        (ROOT / f"arva_hil/config/{kind}.schema.json").write_text(schema_text(kind), encoding="utf-8")


def page() -> str:
    """Return the tables of the reference page, for each kind of file, in Markdown. Sphinx calls this (docs)."""
    lines = [
        "## Scenarios",
        "",
        *_table(_rows(Scenario)),
        "",
        "A vehicle's receiver has every key of `receiver` too; without them, those of `receiver` hold.",
        "",
        "`profile` names a file with keys that are not given here: `builtin:NAME`, or a path from the scenario's",
        "folder. A receiver's file has `spec` and `receiver`; a transmitter's has `spec` and `transmitter`.",
        "",
        "## Receivers of pulses",
        "",
        "`model: pulsed` has these keys beside those of every receiver. `vector` and `rssi` have them with other",
        "defaults; `rssi` neither reverts to sending nor tests itself.",
        "",
        *_model_table("pulsed"),
        "",
        *_defaults("vector"),
        *_defaults("rssi"),
        "",
        "## Faults",
        "",
        "Each item of `faults` has the key of one fault, the keys that it needs, and the time when it is on.",
        "",
        *_table(_fault_rows()),
        "",
        "## Plans of campaigns",
        "",
        "Each axis is one value or a list; all axes are crossed.",
        "",
        *_table([*_rows(CampaignPlan), *_rows(Random, "scenarios[].random.")]),
    ]
    return "\n".join(lines) + "\n"


def _table(rows: Iterable[tuple[str, ...]]) -> Iterator[str]:
    """Yield three columns, so that the meaning is visible without scrolling."""
    yield "| key | value | meaning |"
    yield "|---|---|---|"
    for row in rows:
        key, kind, allowed, unit, default, meaning = (cell.replace("|", chr(92) + "|") for cell in row)
        default = f"= {default}" if default.startswith("`") else default
        size = f"{_brief(allowed)} {unit}".strip()
        value = ", ".join(part for part in (_short(kind, allowed), size, default) if part)
        yield f"| {key} | {value} | {meaning} |"


def _short(kind: str, allowed: str) -> str:
    """Return a kind of value without its article; "" if the range is enough."""
    plain = re.sub(r"^(a|an) ", "", kind)
    return "" if plain == "mapping" or (plain == "number" and allowed) else plain


def _brief(allowed: str) -> str:
    """Return a range as FROM…TO or ±TO; a range above a number, without that number, as >FROM…TO."""
    text = re.sub(r"from -(\S+) to \1(?=;|$)", r"±\1", allowed)
    return re.sub(r"from (\S+) to (\S+)", r"\1…\2", re.sub(r"above (\S+), at most (\S+)", r">\1…\2", text))


def _rows(cls: Any, prefix: str = "", spec: int = 1) -> Iterator[tuple[str, ...]]:
    """Yield key, type, range, unit, default and meaning of every key of a table, and of those below it."""
    for name, one in keys(cls).items():
        if cls is ReceiverEntry and name in keys(ReceiverOptions):
            continue
        constraint, below = one.constraint, one.constraint.table
        usual = "required" if name in cls.__required__ else _default(one)
        said = ("*2* " if one.since > spec else "") + one.help
        yield f"`{prefix}{name}`", constraint.kind, constraint.range, constraint.unit, usual, said
        if below is Angles:
            yield f"`{prefix}{name}.roll`, `.pitch`, `.yaw`", "number", *_angle(below), "about x, y and z"
        elif below is not None and below is not Fault:
            dot = "[]." if isinstance(constraint, ListOf) else "."
            yield from _rows(below, f"{prefix}{name}{dot}", max(one.since, spec))


def _angle(cls: Any) -> tuple[str, str, str]:
    """Return the common range, unit and default of the three angles."""
    one = keys(cls)["roll"]
    return one.constraint.range, one.constraint.unit, _default(one)


def _model_table(model: str) -> Iterator[str]:
    """Yield the table of a receiver model's own keys."""
    yield "| key | default | meaning |"
    yield "|---|---|---|"
    for name, (default, text) in _own_keys(model).items():
        yield f"| `{name}` | {default} | {text} |"


def _defaults(model: str) -> Iterator[str]:
    """Yield the defaults of a model that differ from those of `pulsed`."""
    usual = _own_keys("pulsed")
    others = [
        f"`{name}: {value}`"
        for name, (v, _) in _own_keys(model).items()
        if (value := v.strip("`")) and v != usual.get(name, ("", ""))[0]
    ]
    yield f"- `{model}`: {', '.join(others)}."


def _own_keys(model: str) -> dict[str, tuple[str, str]]:
    """Return default and meaning of each own key of a model."""
    cls = RECEIVERS[model].Options
    texts = get_type_hints(cls, include_extras=True)
    return {
        one.name: (
            "" if one.default is None else f"`{plain(one.default)}`",
            next((m for m in getattr(texts[one.name], "__metadata__", ()) if isinstance(m, str)), ""),
        )
        for one in dataclasses.fields(cls)
    }


def _default(one: Field) -> str:
    """Return the default of a key in the form of files."""
    if one.default in (None, (None,), (), math.inf) or (isinstance(one.constraint, TableOf) and one.default != "home"):
        return ""
    return f"`{plain(one.default)}`"


def plain(value: Any) -> str:
    """Return a value in the form of files."""
    if isinstance(value, range):
        return str(len(value))
    if isinstance(value, tuple):
        return f"[{', '.join(map(plain, value))}]"
    return f"{value:g}" if isinstance(value, float) else str(value)


def _fault_rows() -> Iterator[tuple[str, ...]]:
    for name in FAULTS:
        kind = FAULTS[name]
        constraint = kind.constraint
        needs = f"; needs {', '.join(f'`{key}`' for key in kind.needs)}" if kind.needs else ""
        yield f"`{name}`", constraint.kind, constraint.range, constraint.unit, "", kind.help + needs
    yield from _rows(Fault)
