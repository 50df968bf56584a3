"""From a text to a value: every mistake at the line and column where it is."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable
from typing import Any, TypeVar

import yaml
from pydantic_core import ValidationError

from arva_hil.config.mapping_keys import UNKNOWN, mistakes_of
from arva_hil.config.mistake import Mistake, Mistakes
from arva_hil.config.sorts import whole
from arva_hil.config.tree import Items, Mapping, Scalar, Tree, any_of, nearest, tree
from arva_hil.config.yaml_tree import Notes, describe

_T = TypeVar("_T")


def read(
    text: str,
    source: str,
    what: str,
    reader: Callable[[Tree], _T],
    newest: int = 1,
    hidden: Callable[[int], Collection[str]] = lambda _: (),
) -> _T:
    """What `reader` makes of a text, in which `what` should be; `source` names it in messages.

    The text may be of a spec up to `newest`; `hidden` are the keys that files of a spec do not have.
    Raises ScenarioError with all mistakes.
    """
    notes = Notes(source)
    root = notes.compose(text, what)
    spec = _spec(notes, root, newest)
    data = tree(root, hidden(spec))
    value = None
    try:
        value = reader(data)
    except (ValidationError, Mistake, Mistakes) as error:
        _note(notes, data, _mistakes(error), spec)
        notes.problems += error.problems if isinstance(error, Mistakes) else ()
    notes.finish()
    assert value is not None
    return value


def _mistakes(error: ValidationError | Mistake | Mistakes) -> Iterable[Mistake]:
    """All that is wrong with a value."""
    if isinstance(error, ValidationError):
        return mistakes_of(error)
    return error.every if isinstance(error, Mistakes) else [error]


def _note(notes: Notes, data: Tree, every: Iterable[Mistake], spec: int) -> None:
    """Remember mistakes at their places, each once, unknown keys before what is missing."""
    seen = set()
    for wrong in sorted(every, key=lambda wrong: not wrong.at_key):
        value, holder, key = _place(data, wrong.where)
        near = wrong.nearest
        if wrong.at_key and holder is not None:
            node = holder.key_nodes[key]
            found, expected = wrong.told(wrong.found, spec), wrong.told(spec=spec)
            if wrong.found == UNKNOWN:
                found, expected, near = _unknown(node, holder, wrong, spec)
        else:
            node = value.node
            found = describe(node) if wrong.found is None else wrong.told(wrong.found, spec)
            expected = wrong.told(spec=spec)
        if (place := (node.start_mark.index, found, expected)) not in seen:
            seen.add(place)
            notes.wrong(node, found, expected, near)


def _place(data: Tree, where: Iterable[str | int]) -> tuple[Tree, Mapping | None, str]:
    """The value at the end of a way, the mapping that has it and its key there."""
    value: Any = data
    holder: Mapping | None = None
    key = ""
    for step in where:
        if isinstance(value, Mapping) and isinstance(step, str) and step in value:
            value, holder, key = value[step], value, step
        elif isinstance(value, Items) and isinstance(step, int) and step < len(value):
            value = value[step]
    return value, holder, key


def _unknown(node: yaml.Node, holder: Mapping, wrong: Mistake, spec: int) -> tuple[str, str, str | None]:
    """What was found, what was expected and the nearest, for a key that a mapping does not have, or has already."""
    text = str(node.value) if isinstance(node, yaml.ScalarNode) else ""
    names = [name for name, since in wrong.keys.items() if since <= spec]
    if text in names:
        line = holder.key_nodes[text].start_mark.line + 1
        return f"key {text!r} again (first on line {line})", "each key once", None
    newer = f" (spec {wrong.keys[text]} has it)" if text in wrong.keys else ""
    return f"unknown key {describe(node)}{newer}", any_of(names), nearest(text.lower(), names)


def _spec(notes: Notes, root: yaml.Node, newest: int) -> int:
    """The spec of a file. Raises ScenarioError when it is newer than the program."""
    pairs = root.value if isinstance(root, yaml.MappingNode) else []
    node = next((value for key, value in pairs if isinstance(key, yaml.ScalarNode) and key.value == "spec"), None)
    if node is None:
        return 1
    spec = whole(Scalar(node))
    if spec is not None and spec > newest:
        notes.problems.clear()  # what looks wrong may be right in that version
        found = f"spec {spec} is newer than this program reads ({newest}): upgrade arva-hil"
        notes.wrong(node, found, f"spec {newest}")
        notes.finish()
    return newest if spec is None or spec < 1 else spec
