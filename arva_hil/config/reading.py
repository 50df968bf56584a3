"""From a file or its text to a value: every mistake at the line and column where it is."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from typing import Any, Final, TypeVar

import yaml

from arva_hil.config.constraints import whole
from arva_hil.config.errors import ConstraintError, Problem, ScenarioError, Violation
from arva_hil.config.nodes import Items, Mapping, Scalar, Value, value_of
from arva_hil.config.yaml_document import Problems, describe, end_of

_T = TypeVar("_T")

_LARGEST_FILE: Final = 1 << 20  # bytes


def read_text(path: str | os.PathLike[str], what: str) -> str:
    """What is in a file of at most 1 MiB. Raises ScenarioError when it cannot be read; `what` was expected."""
    source = os.fspath(path)
    if not source:
        raise ScenarioError([Problem("''", 1, 1, "an empty name", what)])
    try:
        with open(source, "rb", opener=open_at_once) as file:
            if file.isatty():  # which would wait for somebody to type
                raise ValueError("a terminal")
            data = file.read(_LARGEST_FILE + 1)
    except (OSError, ValueError) as error:
        why = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        raise ScenarioError([Problem(source, 1, 1, why, what)]) from error
    if len(data) > _LARGEST_FILE:
        raise ScenarioError([Problem(source, 1, 1, "more than 1 MiB", what)])
    try:
        return data.decode()
    except UnicodeDecodeError as error:
        at = end_of(data[: error.start].decode())
        found = f"the byte 0x{data[error.start]:02x}"
        raise ScenarioError([Problem(source, at.line + 1, at.column + 1, found, "UTF-8")]) from error


def open_at_once(path: str, flags: int) -> int:
    """Opens a pipe that nobody writes to without waiting: it is empty."""
    file = os.open(path, flags | getattr(os, "O_NONBLOCK", 0))
    if hasattr(os, "O_NONBLOCK"):
        os.set_blocking(file, True)
    return file


def read(text: str, source: str, what: str, reader: Callable[[Value], _T], newest: int = 1) -> _T:
    """What `reader` makes of a text of a spec up to `newest`, in which `what` should be; `source` names it in messages.

    Raises ScenarioError with all mistakes.
    """
    problems = Problems(source)
    root = problems.compose(text, what)
    top = value_of(root, _spec(problems, root, newest))
    try:
        value = reader(top)
    except ConstraintError as error:
        _add(problems, top, error.violations)
        problems.found += error.problems
        raise ScenarioError(problems.found) from None
    problems.raise_any()
    return value


def _add(problems: Problems, top: Value, violations: Iterable[Violation]) -> None:
    """Add violations at the places of their values, each once, those of keys before those of values."""
    seen = set()
    for one in sorted(violations, key=lambda one: not one.at_key):
        node = _node(top, one)
        found = describe(node) if one.found is None else one.found
        if (place := (node.start_mark.index, found, one.expected)) not in seen:
            seen.add(place)
            problems.add(node, found, one.expected, one.nearest)


def _node(top: Value, violation: Violation) -> yaml.Node:
    """The node of a violation: as far along its path as there is one."""
    value: Any = top
    node: yaml.Node = top.node
    for step in violation.path:
        if isinstance(value, Mapping) and step in value:
            node, value = value.key_nodes[str(step)], value[str(step)]
        elif isinstance(value, Items) and isinstance(step, int) and step < len(value):
            value = value[step]
            node = value.node
        else:
            return node
    return node if violation.at_key else value.node


def _spec(problems: Problems, root: yaml.Node, newest: int) -> int:
    """The spec of a file. Raises ScenarioError when it is newer than the program."""
    pairs = root.value if isinstance(root, yaml.MappingNode) else []
    node = next((value for key, value in pairs if isinstance(key, yaml.ScalarNode) and key.value == "spec"), None)
    if node is None:
        return 1
    spec = whole(Scalar(node))
    if spec is not None and spec > newest:
        problems.found.clear()  # what looks wrong may be right in that version
        found = f"spec {spec} is newer than this program reads ({newest}): upgrade arva-hil"
        problems.add(node, found, f"spec {newest}")
        problems.raise_any()
    return newest if spec is None or spec < 1 else spec
