"""What follows from the declarations: the JSON Schema, the reference page, and what configs/default.yaml shows."""

from __future__ import annotations

import functools
import re
from pathlib import Path
from typing import Any

import jsonschema
import pytest
import yaml

from arva_hil.cli.main import main
from arva_hil.config.campaign import CampaignPlan
from arva_hil.config.json_schema import FILES, SchemaKind, schema, schema_text
from arva_hil.config.scenario import Scenario
from arva_hil.config.tables import keys
from tests.cli.test_broken import SCENARIOS
from tests.every import every
from tools.write_reference import page

ROOT = Path(__file__).parent.parent.parent
CONFIGS = ROOT / "configs"
NUMBER = re.compile(r"[-+]?((0|[1-9][0-9]*)(\.[0-9]*)?|\.[0-9]+)([eE][-+]?[0-9]+)?")
BETWEEN_KEYS = re.compile(
    r"again \(|half the period|later than|less than every_s|both or neither|with the format|of transmitter \d|"
    r"separates vehicles|one vehicle has|no port|a port for frames|of spec 2|no receiver profile"
)
THE_SAME_NUMBER = {  # in JSON, written otherwise
    "channels by an exponent",
    "no_signal with points",
    "spec 1 with a point",
    "an id that is negative zero point",
    "a negative zero for a seed with a point",
}


def plain(node: yaml.Node) -> Any:
    """A node as an editor with YAML 1.2 sees it."""
    if isinstance(node, yaml.MappingNode):
        return {str(key.value): plain(value) for key, value in node.value}
    if isinstance(node, yaml.SequenceNode):
        return [plain(item) for item in node.value]
    text = str(node.value)
    if node.style is not None:  # type: ignore[attr-defined]
        return text
    if NUMBER.fullmatch(text):
        return int(text) if re.fullmatch("[-+]?[0-9]+", text) else float(text)
    return {"true": True, "false": False, "": None, "null": None}.get(text, text)


@functools.cache
def validator(kind: SchemaKind) -> jsonschema.Draft202012Validator:
    return jsonschema.Draft202012Validator(schema(kind))


def valid(kind: SchemaKind, text: str) -> bool:
    return bool(validator(kind).is_valid(plain(yaml.compose(text, yaml.BaseLoader))))


@pytest.mark.parametrize("kind", FILES)
def test_the_schema_in_the_package_is_the_declarations(kind: SchemaKind) -> None:
    jsonschema.Draft202012Validator.check_schema(schema(kind))
    assert (ROOT / f"arva_hil/config/{kind}.schema.json").read_text(encoding="utf-8") == schema_text(kind), (
        "run python -m tools reference"
    )


def test_the_reference_page_has_every_key() -> None:
    shown = page()
    for cls in (Scenario, CampaignPlan):
        assert [name for name in keys(cls) if f"| `{name}` |" not in shown] == []


@pytest.mark.parametrize("cls", [Scenario, CampaignPlan])
def test_every_key_has_its_help(cls: Any) -> None:
    assert all(one.help for one in keys(cls).values())


@every("path", sorted(CONFIGS.rglob("*.yaml")))
def test_every_config_names_its_schema_and_is_valid(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    (named,) = re.findall(r"(?m)^# yaml-language-server: \$schema=(\S+)$", text)
    kinds: dict[str, SchemaKind] = {"campaigns": "campaign", "receivers": "receiver", "transmitters": "transmitter"}
    kind = kinds.get(path.parent.name, "scenario")
    assert (path.parent / named).resolve() == ROOT / f"arva_hil/config/{kind}.schema.json"
    assert valid(kind, text)


@pytest.mark.parametrize("name", ["keys", "types", "ranges", "numbers", "faults", "spec_2"])
def test_the_schema_refuses_what_is_refused_for_its_keys_types_and_ranges(name: str) -> None:
    entries = [e for e in SCENARIOS[name] if not any(map(BETWEEN_KEYS.search, e.answers))]
    accepted = {entry.title for entry in entries if valid("scenario", entry.data.decode())}
    assert accepted <= THE_SAME_NUMBER
    assert len(entries) >= 20


def commented(text: str) -> dict[tuple[str, ...], str]:
    """The comment behind each key, by the way to it."""
    lines = text.splitlines()
    found = {}

    def walk(node: yaml.Node, way: tuple[str, ...]) -> None:
        if isinstance(node, yaml.MappingNode):
            for key, value in node.value:
                found[*way, key.value] = lines[key.start_mark.line].partition("# ")[2]
                walk(value, (*way, key.value))
        elif isinstance(node, yaml.SequenceNode):
            for item in node.value:
                walk(item, way)

    walk(yaml.compose(text, yaml.BaseLoader), ())
    return found


def test_default_yaml_shows_every_key_of_spec_1_with_its_help_and_unit() -> None:
    comments = commented((CONFIGS / "default.yaml").read_text(encoding="utf-8"))
    elsewhere = {"enu", "lla"}  # a transmitter has one place: those stand in the comment of `ned`
    shown = set()

    def check(cls: Any, way: tuple[str, ...]) -> None:
        for name, one in keys(cls).items():
            if one.since > 1 or name in elsewhere:
                continue
            comment = comments[*way, name]
            shown.add((*way, name))
            assert comment.startswith(one.help), (way, name)
            if one.constraint.unit:
                assert f"[{one.constraint.unit}]" in comment, (way, name)
            if one.constraint.table and name not in ("datum", "faults"):  # a word, and a list of none
                check(one.constraint.table, (*way, name))

    check(Scenario, ())
    assert shown == set(comments)
    assert elsewhere <= set(re.findall(r"\w+", comments["transmitters", "ned"]))


def test_check_prints_the_schemas(capsys: pytest.CaptureFixture[str]) -> None:
    for arguments, kind in [([], "scenario"), (["campaign"], "campaign")]:
        assert main(["check", "--schema", *arguments]) == 0
        assert capsys.readouterr().out == schema_text(kind)  # type: ignore[arg-type]
