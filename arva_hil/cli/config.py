"""`arva-hil config`: prints the effective configuration, and where each value comes from."""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Iterator
from typing import Any, Final

import yaml

from arva_hil.cli import common
from arva_hil.cli.options import DEFAULT_AUTOPILOT
from arva_hil.cli.outcome import UsageError
from arva_hil.cli.run_links import choose_autopilot
from arva_hil.cli.terminal import show, show_json
from arva_hil.config import Scenario, to_dict
from arva_hil.config.profiles import located
from arva_hil.config.reading import read_text

Key = tuple[str | int, ...]

DEFAULT: Final = "default"
_OPTIONS: Final[dict[Key, str]] = {("receiver", "rate_hz"): "rate", ("output", "format"): "format", ("seed",): "seed"}
_PLACES: Final = ("enu", "ned", "lla", "path", "follows")  # a transmitter has one; `enu` in the file becomes `ned`


class Origins:
    """Remembers the line of each key in the scenario's file, and which options were given.

    `options.sources`: where each option comes from.
    """

    def __init__(self, options: argparse.Namespace, chosen: Scenario) -> None:
        self._sources: dict[str, str] = options.sources
        self._file = ""
        self._lines: dict[Key, int] = {}
        self._of_file = 0  # how many of the faults come from the file
        if options.scenario:
            self._file = located(options.scenario)
            root = yaml.compose(read_text(self._file, "a scenario file"), yaml.BaseLoader)
            self._lines = dict(_lines(root)) if root else {}  # of a pipe, which is read only once, no line is known
        given = options.fault or ()
        if None not in given:  # `none` removes all faults before it
            self._of_file = len(chosen.faults) - len(given)

    def of(self, key: Key) -> str:
        """Return the source of the value at the path `key` of the scenario."""
        option = _OPTIONS.get(key)
        if option in self._sources:
            return self._sources[option]
        if key[:1] == ("faults",) and (key == ("faults",) or int(key[1]) >= self._of_file):
            return self._sources.get("fault", self._line(key))
        return self._line(key)

    def _line(self, key: Key) -> str:
        """Return the line of the key in the file, or of a key there with the same meaning."""
        for candidate in _said_as(key):
            if candidate in self._lines:
                return f"{self._file}:{self._lines[candidate]}"
        return DEFAULT if self._lines or not self._file else self._file


def _said_as(key: Key) -> Iterator[Key]:
    """Yield the key itself, and other keys with the same meaning."""
    yield key
    if key[:1] == ("transmitters",) and key[2] in _PLACES:
        yield from ((*key[:2], place) for place in _PLACES)
    if key[:1] == ("vehicles",) and key[2:3] == ("receivers",):  # the file's settings of all receivers
        yield ("receiver", *key[4:])
        if key[4] in ("format", "seed"):
            yield ("output", "format") if key[4] == "format" else ("seed",)


def _lines(node: yaml.Node, key: Key = ()) -> Iterator[tuple[Key, int]]:
    if isinstance(node, yaml.MappingNode):
        for name, value in node.value:
            yield (*key, name.value), name.start_mark.line + 1
            yield from _lines(value, (*key, name.value))
    elif isinstance(node, yaml.SequenceNode):
        for number, value in enumerate(node.value):
            yield (*key, number), value.start_mark.line + 1
            yield from _lines(value, (*key, number))


_IN_THE_SCENARIO: Final = ("rate", "format", "seed", "fault", "json", "sources", "typed")
_COMMENT_AT: Final = 42  # the column of comments, where values leave room for it


def main(options: argparse.Namespace) -> None:
    chosen = common.scenario(options)
    origins = Origins(options, chosen)
    if options.json:
        show_json(
            *({"key": name, "value": value, "from": origin} for name, value, origin in _options(options)),
            *(
                {"key": ".".join(map(str, key)), "value": value, "from": origins.of(key)}
                for _, key, value in _rows(to_dict(chosen))
                if key
            ),
        )
        return
    show(
        "# Options of `arva-hil run`. Weakest first: default, file, environment, command line.",
        *(
            _beside(f"#   {name} {'none' if value is None else value}", origin)
            for name, value, origin in _options(options)
        ),
        "# The scenario:",
        *(
            _beside(f"{lead} {_plain(value)}", origins.of(key)) if key else lead
            for lead, key, value in _rows(to_dict(chosen))
        ),
    )


def _options(options: argparse.Namespace) -> Iterator[tuple[str, Any, str]]:
    """Yield name, value and origin of each option that is not in the scenario."""
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


def _rows(plain: dict[str, Any], key: Key = (), indent: int = 0, dash: str = "") -> Iterator[tuple[str, Key, Any]]:
    """Yield the rows of a mapping in YAML's block style: the text before a value, its path, and the value.

    Without a path there is no value. `dash` begins the first line of a list's item.
    """
    for name, value in plain.items():
        lead, dash = f"{dash.rjust(indent)}{name}:", ""
        if isinstance(value, dict) and value:
            yield lead, (), None
            yield from _rows(value, (*key, name), indent + 2)
        elif isinstance(value, list) and value and isinstance(value[0], dict):
            yield lead, (), None
            for number, item in enumerate(value):
                yield from _rows(item, (*key, name, number), indent + 4, "- ")
        else:
            yield lead, (*key, name), value


def _plain(value: Any) -> str:
    """Return a leaf in YAML's flow style."""
    if isinstance(value, str) and value.isidentifier():
        return value
    if isinstance(value, list):
        return f"[{', '.join(map(_plain, value))}]"
    return json.dumps(value)


def _beside(what: str, origin: str) -> str:
    return f"{what:<{_COMMENT_AT}} # {origin}"
