"""The values of a file, each with its place in it. Importing this does not import yaml.

Scalars keep the text as written, so `off` is a string and `1e3` a number, whatever YAML 1.1 says.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from yaml import Node

NEWEST_SPEC: Final = 2
_NAME: Final = re.compile(r"[A-Za-z_][A-Za-z0-9_.:-]*")


class Scalar(str):
    """A scalar's text as written. `plain`: the text if it has no quotes, otherwise ""."""

    node: Node
    plain: str
    spec: int
    file: str
    """In which it is written, also after a profile was taken over."""

    def __new__(cls, node: Node, spec: int = NEWEST_SPEC) -> Scalar:
        text = node.value if isinstance(node.value, str) else ""
        scalar = super().__new__(cls, text)
        scalar.node, scalar.spec, scalar.file = node, spec, node.start_mark.name
        scalar.plain = text if getattr(node, "style", None) is None else ""
        return scalar


class Items(list["Value"]):
    """A sequence."""

    def __init__(self, node: Node, spec: int) -> None:
        super().__init__([_KINDS[type(item).__name__](item, spec) for item in node.value])
        self.node, self.spec = node, spec


class Mapping(dict[str, Any]):
    """A mapping. The name of an impossible or repeated key begins with `?`.

    `key_nodes` are the keys by that name.
    """

    def __init__(self, node: Node, spec: int) -> None:
        super().__init__()
        self.node, self.spec = node, spec
        self.key_nodes: dict[str, Node] = {}
        for number, (key, value) in enumerate(node.value):
            name = key.value if isinstance(key.value, str) else ""
            if name in self or not _NAME.fullmatch(name):
                name = f"?{number}"
            self.key_nodes[name] = key
            self[name] = _KINDS[type(value).__name__](value, spec)

    def inherit(self, other: Mapping, names: Sequence[str]) -> None:
        """Take over those keys of another mapping that are not here."""
        for name in names:
            if name in other and name not in self:
                self.key_nodes[name] = other.key_nodes[name]
                self[name] = other[name]

    def tables(self, key: str) -> list[Mapping]:
        """Return the mappings in a list."""
        items = self.get(key)
        return [one for one in items if isinstance(one, Mapping)] if isinstance(items, Items) else []


Value = Scalar | Items | Mapping
_KINDS: Final[dict[str, Callable[[Node, int], Value]]] = {
    "ScalarNode": Scalar,
    "SequenceNode": Items,
    "MappingNode": Mapping,
}  # by name: yaml is slow to import


def value_of(node: Node, spec: int) -> Value:
    """Return the value of a node in a file of this spec."""
    return _KINDS[type(node).__name__](node, spec)


def folder_of(value: Any) -> str:
    """Return the folder of the file that a scalar is from, "" for others."""
    return os.path.dirname(value.file) if isinstance(value, Scalar) else ""
