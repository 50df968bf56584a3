"""Plain data that knows where in a file it was, and what a mistake in a file is. Importing this does not import yaml.

Scalars keep the text as written, so `off` is a word and `1e3` a number, whatever YAML 1.1 says.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from arva_hil.errors import ArvaError

if TYPE_CHECKING:
    from yaml import Node

_NAME: Final = re.compile(r"[A-Za-z_][A-Za-z0-9_.:-]*")


@dataclass(frozen=True, order=True)
class Problem:
    """One mistake in a file. Lines and columns count from 1; 1:1 when it concerns the whole file."""

    source: str
    line: int
    column: int
    found: str
    expected: str
    nearest: str | None = None

    def __str__(self) -> str:
        hint = "" if self.nearest is None else f", did you mean {self.nearest!r}?"
        return f"{self.source}:{self.line}:{self.column}: {self.found}, expected {self.expected}{hint}"


class ScenarioError(ArvaError):
    """A scenario or a plan that cannot be used. `problems` are sorted by place; `str()` is one line for each."""

    def __init__(self, problems: Sequence[Problem]) -> None:
        self.problems = tuple(sorted(problems, key=lambda p: (p.source, p.line, p.column)))
        super().__init__(self.problems)

    def __str__(self) -> str:
        return "\n".join(map(str, self.problems))


class Scalar(str):
    """A scalar's text as written. `plain` is that text without quotes, and "" when there were quotes."""

    node: Node
    plain: str

    def __new__(cls, node: Node) -> Scalar:
        scalar = super().__new__(cls, node.value if isinstance(node.value, str) else "")
        scalar.node = node
        scalar.plain = node.value if isinstance(node.value, str) and getattr(node, "style", None) is None else ""
        return scalar


class Items(list["Tree"]):
    """A sequence."""

    def __init__(self, node: Node, hidden: Collection[str]) -> None:
        super().__init__(tree(item, hidden) for item in node.value)
        self.node = node


class Mapping(dict[str, Any]):
    """A mapping. A key that no mapping can have, or that was there already, stands under a name that begins with `?`.

    `key_nodes` are the keys by that name.
    """

    def __init__(self, node: Node, hidden: Collection[str]) -> None:
        super().__init__()
        self.node = node
        self.key_nodes: dict[str, Node] = {}
        for number, (key, value) in enumerate(node.value):
            name = key.value if isinstance(key.value, str) else ""
            if name in self or name in hidden or not _NAME.fullmatch(name):
                name = f"?{number}"
            self.key_nodes[name] = key
            self[name] = tree(value, hidden)

    def inherit(self, other: Mapping, names: Sequence[str]) -> None:
        """Take over those keys of another mapping that are not here."""
        for name in names:
            if name in other and name not in self:
                self.key_nodes[name] = other.key_nodes[name]
                self[name] = other[name]


Tree = Scalar | Items | Mapping


def tree(node: Node, hidden: Collection[str] = ()) -> Tree:
    """A node as plain data that knows where it was. Keys in `hidden` are unknown keys wherever they are."""
    import yaml  # slow; here it is imported already

    if isinstance(node, yaml.MappingNode):
        return Mapping(node, hidden)
    return Items(node, hidden) if isinstance(node, yaml.SequenceNode) else Scalar(node)


def short(text: str) -> str:
    return text if len(text) <= 40 else text[:39] + "…"


def any_of(names: Sequence[str]) -> str:
    """What was expected, where one of some names is."""
    return names[0] if len(names) == 1 else f"one of {', '.join(names)}"


def nearest(text: str, names: Sequence[str]) -> str | None:
    """The name most like a text, None when none is."""
    return next(iter(difflib.get_close_matches(text, names, 1)), None)
