"""`arva-hil config`: prints the effective configuration, and where each value comes from."""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Iterator
from typing import Any, Final, NamedTuple

from arva_hil.cli import common
from arva_hil.cli.options import DEFAULT_AUTOPILOT
from arva_hil.cli.outcome import OK, UsageError
from arva_hil.cli.provenance import Key, Origins
from arva_hil.cli.run_links import choose_autopilot
from arva_hil.cli.terminal import show, show_json
from arva_hil.config import to_dict

_IN_THE_SCENARIO: Final = ("rate", "format", "seed", "fault", "json", "sources")
_COMMENT_AT: Final = 42  # the column of comments, where values leave room for it
_NONE: Final = "none"


class ConfigRow(NamedTuple):
    """A line of the scenario: the text before the value, the value's path, and the value. No path: no value."""

    lead: str
    key: Key = ()
    value: Any = None


def main(options: argparse.Namespace) -> int:
    chosen = common.scenario(options, fleet=True)
    origins = Origins(options, chosen)
    if options.json:
        for name, value, origin in _options(options):
            show_json({"key": name, "value": value, "from": origin})
        for row in _rows(to_dict(chosen)):
            if row.key:
                show_json({"key": ".".join(map(str, row.key)), "value": row.value, "from": origins.of(row.key)})
        return OK
    show("# Options of `arva-hil run`. Weakest first: default, file, environment, command line.")
    for name, value, origin in _options(options):
        show(_beside(f"#   {name} {_NONE if value is None else value}", origin))
    show("# The scenario:")
    for row in _rows(to_dict(chosen)):
        show(_beside(f"{row.lead} {_plain(row.value)}", origins.of(row.key)) if row.key else row.lead)
    return OK


def _options(options: argparse.Namespace) -> Iterator[tuple[str, Any, str]]:
    """Name, value and origin of each option that is not in the scenario."""
    for dest, value in sorted(vars(options).items()):
        if dest in _IN_THE_SCENARIO:
            continue
        origin = options.sources.get(dest, "default")
        if dest == "autopilot" and value is None:
            value, origin = _found(options.port)
        plain = None if isinstance(value, float) and not math.isfinite(value) else value
        yield "--" + dest.replace("_", "-"), plain, origin


def _found(port: str | None) -> tuple[str | None, str]:
    try:
        address = choose_autopilot(port)
    except UsageError as error:
        return None, str(error)
    return address, "default" if address == DEFAULT_AUTOPILOT else "found on USB"


def _rows(plain: dict[str, Any], key: Key = (), indent: int = 0, dash: str = "") -> Iterator[ConfigRow]:
    """A mapping in YAML's block style, with lists of mappings. `dash` begins the first line of a list's item."""
    for name, value in plain.items():
        lead, dash = f"{dash.rjust(indent)}{name}:", ""
        if isinstance(value, dict) and value:
            yield ConfigRow(lead)
            yield from _rows(value, (*key, name), indent + 2)
        elif isinstance(value, list) and value and isinstance(value[0], dict):
            yield ConfigRow(lead)
            for number, item in enumerate(value):
                yield from _rows(item, (*key, name, number), indent + 4, "- ")
        else:
            yield ConfigRow(lead, (*key, name), value)


def _plain(value: Any) -> str:
    """A leaf in YAML's flow style."""
    if isinstance(value, str) and value.isidentifier():
        return value
    if isinstance(value, list):
        return f"[{', '.join(map(_plain, value))}]"
    return json.dumps(value)


def _beside(what: str, origin: str) -> str:
    return f"{what:<{_COMMENT_AT}} # {origin}"
