"""Where the values of an effective scenario come from: file, environment, command line or default."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from typing import Final

import yaml

from arva_hil.config import Scenario, load
from arva_hil.config.builtin import located
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
            self._lines = dict(_lines(root)) if root else {}
            self._of_file = len(load(self._file).faults)
        added = list(options.fault or ())
        if None in added:  # `none` removes all faults before it
            self._of_file = 0
        self._of_file = min(self._of_file, len(chosen.faults))

    def of(self, key: Key) -> str:
        """Where the value at the path `key` of the scenario comes from."""
        option = _OPTIONS.get(key)
        if option in self._sources:
            return self._sources[option]
        if key[:1] == ("faults",) and (key == ("faults",) or int(key[1]) >= self._of_file):
            return self._sources.get("fault", self._line(key))
        return self._line(key)

    def _line(self, key: Key) -> str:
        """The line of the key in the file, or of a key there with the same meaning."""
        for candidate in _said_as(key):
            if candidate in self._lines:
                return f"{self._file}:{self._lines[candidate]}"
        return DEFAULT


def _said_as(key: Key) -> Iterator[Key]:
    """The key itself, and other keys with the same meaning."""
    yield key
    if key[:1] == ("transmitters",) and key[2] in _PLACES:
        yield from ((*key[:2], place) for place in _PLACES)
    if key[:1] == ("vehicles",) and key[2:3] == ("receivers",):  # the file's settings of all receivers
        yield ("receiver", *key[4:])
        if key[4] in ("format", "seed"):
            yield ("output", "format") if key[4] == "format" else ("seed",)


def _lines(node: yaml.Node, key: Key = ()) -> Iterator[tuple[Key, int]]:
    """The line of each key in a tree, from 1."""
    if isinstance(node, yaml.MappingNode):
        for name, value in node.value:
            yield (*key, name.value), name.start_mark.line + 1
            yield from _lines(value, (*key, name.value))
    elif isinstance(node, yaml.SequenceNode):
        for number, value in enumerate(node.value):
            yield (*key, number), value.start_mark.line + 1
            yield from _lines(value, (*key, number))
