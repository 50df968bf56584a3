"""What follows from the declarations: the JSON Schema for editors, and the reference page."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any, Final, Literal

from pydantic import TypeAdapter

from arva_hil.config.campaign import PlanFile
from arva_hil.config.scenario import Scenario
from arva_hil.config.tables import keys

SchemaKind = Literal["scenario", "campaign"]
FILES: Final[Mapping[SchemaKind, tuple[Any, str]]] = {
    "scenario": (Scenario, "A scenario of arva-hil"),
    "campaign": (PlanFile, "The plan of a campaign of arva-hil"),
}


def schema(kind: SchemaKind) -> dict[str, Any]:
    """The JSON Schema (2020-12) of a kind of file."""
    cls, title = FILES[kind]
    made: dict[str, Any] = _tidy(TypeAdapter(cls).json_schema())
    made |= {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": title}
    if newer := [name for name, since in keys(cls).items() if since > 1]:
        made["if"] = {"properties": {"spec": {"const": 2}}, "required": ["spec"]}
        made["else"] = {"properties": dict.fromkeys(newer, False)}
    return made


def schema_text(kind: SchemaKind) -> str:
    """The same as it is in a file."""
    return json.dumps(schema(kind), indent=2, ensure_ascii=False) + "\n"


def _tidy(value: Any) -> Any:
    """Without titles, docstrings of classes and nulls: what a file does not have is left out of it."""
    if isinstance(value, list):
        return [_tidy(item) for item in value if item != {"type": "null"}]
    if not isinstance(value, dict):
        return value
    kept = {key: item for key, item in value.items() if not (key == "default" and item is None)}
    if kept.get("type") == "object" and "properties" in kept:
        kept = {key: item for key, item in kept.items() if key != "description"}
    if isinstance(kept.get("title"), str):
        del kept["title"]
    tidy = {key: _tidy(item) for key, item in kept.items()}
    if len(tidy.get("anyOf", ())) == 1:
        tidy |= tidy.pop("anyOf")[0]
    return tidy
