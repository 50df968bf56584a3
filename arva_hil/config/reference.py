"""What follows from the declarations: the JSON Schema for editors, and the reference page."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import MISSING
from typing import Any, Final, Literal, get_args

from pydantic import TypeAdapter
from pydantic.json_schema import GenerateJsonSchema

from arva_hil.config.campaign import PlanFile, Random
from arva_hil.config.faults import Fault
from arva_hil.config.nested import Either, Reshaped, Tables
from arva_hil.config.receiver import ReceiverOptions
from arva_hil.config.scenario import Scenario
from arva_hil.config.sorts import Sort
from arva_hil.config.tables import fields_of, help_of, is_table, keys
from arva_hil.config.vehicles import ReceiverEntry
from arva_hil.registry import FAULTS

SchemaKind = Literal["scenario", "campaign"]
FILES: Final[Mapping[SchemaKind, tuple[Any, str]]] = {
    "scenario": (Scenario, "A scenario of arva-hil"),
    "campaign": (PlanFile, "The plan of a campaign of arva-hil"),
}


class _Generator(GenerateJsonSchema):
    """With only those defaults that a file can have as they are."""

    def encode_default(self, dft: Any) -> Any:
        if isinstance(dft, tuple) and all(isinstance(item, int | float) for item in dft):
            return list(dft)
        return dft if isinstance(dft, str | int | float) else None


def schema(kind: SchemaKind) -> dict[str, Any]:
    """The JSON Schema (2020-12) of a kind of file."""
    cls, title = FILES[kind]
    made: dict[str, Any] = _tidy(TypeAdapter(cls).json_schema(schema_generator=_Generator))
    made |= {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": title}
    if newer := [name for name, since in keys(cls).items() if since > 1]:
        made["if"] = {"properties": {"spec": {"const": 2}}, "required": ["spec"]}
        made["else"] = {"properties": dict.fromkeys(newer, False)}
    return made


def schema_text(kind: SchemaKind) -> str:
    """The same as it is in a file."""
    return json.dumps(schema(kind), indent=2, ensure_ascii=False) + "\n"


def _tidy(value: Any) -> Any:
    """Without titles, docstrings of classes, nulls and defaults of mappings: what is left out is not in the file."""
    if isinstance(value, list):
        return [_tidy(item) for item in value if item != {"type": "null"}]
    if not isinstance(value, dict):
        return value
    mapping = "$ref" in value or value.get("type") == "object"
    kept = {key: item for key, item in value.items() if not (key == "default" and (mapping or item is None))}
    if mapping and "properties" in kept:
        kept.pop("description", None)
    if isinstance(kept.get("title"), str):
        del kept["title"]
    tidy = {key: _tidy(item) for key, item in kept.items()}
    if len(tidy.get("anyOf", ())) == 1:
        tidy |= tidy.pop("anyOf")[0]
    return tidy


def page() -> str:
    """The reference page in Markdown: every key of every kind of file."""
    lines = [
        "# The files: every key",
        "",
        "Made from the declarations in `arva_hil/config` by `tools/write_reference.py`; do not edit.",
        "`arva-hil check FILE…` checks a file; `arva-hil check --schema` prints the JSON Schema for editors.",
        "A key of spec 2 needs `spec: 2` in the file.",
        "Each transmitter has exactly one of `enu`, `ned`, `lla`, `path` and `follows`.",
        "",
        "## Scenarios",
        "",
        *_table(_rows(Scenario)),
        "",
        "A vehicle's receiver has every key of `receiver` too; what it has not is as in `receiver`.",
        "",
        "## Faults",
        "",
        "Each item of `faults` has the key of one fault, what that fault needs, and when it is on.",
        "",
        *_table(_fault_rows()),
        "",
        "## Plans of campaigns",
        "",
        "Each axis is one value or a list of them, and all are crossed.",
        "",
        *_table([*_rows(PlanFile), *_rows(Random, "scenarios[].random.")]),
    ]
    return "\n".join(lines) + "\n"


def _table(rows: Iterable[tuple[str, ...]]) -> Iterator[str]:
    yield "| key | type | range | unit | default | meaning |"
    yield "|---|---|---|---|---|---|"
    for row in rows:
        yield f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in row)} |"


def _rows(cls: Any, prefix: str = "", spec: int = 1) -> Iterator[tuple[str, ...]]:
    """Key, type, range, unit, default and meaning of every key of a table, and of those below it."""
    must = [group for group in cls.__need__ if " " not in group]
    for name, since in keys(cls).items():
        info = fields_of(cls)[name]
        sort = next((mark for mark in info.marks if isinstance(mark, Sort)), None)
        below, inner = _below(info.type, sort)
        said = help_of(cls, name) + (f" (spec {since})" if since > spec else "")
        shown = (sort.kind, sort.range, sort.unit) if sort and not isinstance(sort, Reshaped) else ("a mapping", "", "")
        usual = "required" if name in must else "" if below and info.default is not MISSING else _default(info)
        yield f"`{prefix}{name}`", *shown, usual, said
        if below and below is not Fault:
            own = {key: 1 for key in keys(below) if not (below is ReceiverEntry and key in keys(ReceiverOptions))}
            dot = f"{prefix}{name}{inner}."
            yield from (row for row in _rows(below, dot, max(since, spec)) if _key(row[0], dot) in own)


def _key(cell: str, prefix: str) -> str:
    """The first key below a prefix in a cell of the page."""
    return cell.strip("`").removeprefix(prefix).split(".")[0].removesuffix("[]")


def _below(annotation: Any, sort: Sort | None) -> tuple[Any, str]:
    """The table that a key has below it, None if none, and the mark of a list."""
    if isinstance(sort, Tables):
        return sort.entry or get_args(annotation)[0], "[]"
    if isinstance(sort, Reshaped):
        return sort.cls, ""
    if sort is not None and not isinstance(sort, Either):
        return None, ""
    of = [one for one in (annotation, *get_args(annotation)) if is_table(one)]
    return (of[0] if of else None), ""


def _default(info: Any) -> str:
    """The default of a key as a file has it."""
    if info.default is MISSING:
        return "required"
    return "" if info.default in (None, (None,), (), math.inf) else f"`{plain(info.default)}`"


def plain(value: Any) -> str:
    """A value as a file has it."""
    if isinstance(value, range):
        return str(len(value))
    if isinstance(value, tuple):
        return f"[{', '.join(map(plain, value))}]"
    return f"{value:g}" if isinstance(value, float) else str(value)


def _fault_rows() -> Iterator[tuple[str, ...]]:
    for name in FAULTS:
        kind = FAULTS[name]
        sort = kind.sort
        needs = f"; needs {', '.join(f'`{key}`' for key in kind.needs)}" if kind.needs else ""
        yield f"`{name}`", sort.kind, sort.range, sort.unit, "", kind.help + needs
    yield from _rows(Fault)
