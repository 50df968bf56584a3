"""The JSON Schema of each kind of file, for editors, from the declarations."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any, Final, Literal

from arva_hil.config.campaign import CampaignPlan
from arva_hil.config.profiles import ReceiverProfile, TransmitterProfile
from arva_hil.config.scenario import Scenario
from arva_hil.config.tables import TableOf, keys

SchemaKind = Literal["scenario", "campaign", "receiver", "transmitter"]
FILES: Final[Mapping[SchemaKind, tuple[Any, str]]] = {
    "scenario": (Scenario, "A scenario of arva-hil"),
    "campaign": (CampaignPlan, "The plan of a campaign of arva-hil"),
    "receiver": (ReceiverProfile, "The profile of a receiver of arva-hil"),
    "transmitter": (TransmitterProfile, "The profile of a transmitter of arva-hil"),
}


def schema(kind: SchemaKind) -> dict[str, Any]:
    """Return the JSON Schema (2020-12) of a kind of file."""
    cls, title = FILES[kind]
    made = TableOf(cls).json() | {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": title}
    if newer := [name for name, one in keys(cls).items() if one.since > 1]:
        made["if"] = {"properties": {"spec": {"const": 2}}, "required": ["spec"]}
        made["else"] = {"properties": dict.fromkeys(newer, False)}
    return made


def schema_text(kind: SchemaKind) -> str:
    """Return the text of the file with the schema."""
    return json.dumps(schema(kind), indent=2, ensure_ascii=False) + "\n"
