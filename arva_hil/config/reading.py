"""From a file or its text to a value, with every mistake at its line and column."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable
from typing import Any, Final, NoReturn, TypeVar

import yaml

from arva_hil.config.constraints import whole
from arva_hil.config.errors import ConstraintError, Problem, ScenarioError, Violation, short
from arva_hil.config.nodes import Items, Mapping, Scalar, Value, value_of

_DEEPEST: Final = 20
_MOST_PARTS: Final = 1000  # keys of one mapping, or mappings in one list
_REFUSED: Final = "refused"  # the tag of a node that stands for one already reported
_START: Final = yaml.Mark("", 0, 0, 0, None, 0)
_BREAK: Final = re.compile("\r\n|[\n\r\x85\u2028\u2029]")


class Problems:
    """The mistakes of one text, in `found`."""

    def __init__(self, source: str) -> None:
        self.found: list[Problem] = []
        self.source = source

    def add(self, at: yaml.Mark, found: str, expected: str, nearest: str | None = None) -> None:
        """Add a problem at a place."""
        self.found.append(Problem(self.source, at.line + 1, at.column + 1, found, expected, nearest))

    def fail(self, at: yaml.Mark, found: str, expected: str) -> NoReturn:
        """Raise ScenarioError with the problems so far and this one, after which nothing can be read."""
        self.add(at, found, expected)
        raise ScenarioError(self.found)

    def compose(self, text: str, what: str) -> yaml.Node:
        """Return the node tree of a text, in which `what` should be.

        Raises ScenarioError when it is not YAML at all.
        """
        try:
            loader = _Loader(text, self)
        except yaml.reader.ReaderError as error:
            self.fail(end_of(text[: error.position]), f"the character {text[error.position]!r}", "printable text")
        try:
            root = loader.get_node() if loader.check_node() else None
            if root is None:
                self.fail(_START, "an empty file", what)
            if loader.check_node():
                self.add(loader.peek_event().start_mark, "a second document", "one")  # type: ignore[no-untyped-call]
        except yaml.MarkedYAMLError as error:
            at = error.problem_mark or loader.get_mark()
            if text[at.index : at.index + 1] == "\t":
                self.fail(at, "a tab", "spaces")
            self._fail_syntax(error, at, text)
        except (ValueError, OverflowError):  # PyYAML trusts the number in "\U…" and %YAML
            self.fail(loader.get_mark(), "not YAML (a number too large)", "a smaller one")
        return root

    def _fail_syntax(self, error: yaml.MarkedYAMLError, at: yaml.Mark, text: str) -> NoReturn:
        """Report PyYAML's error at the place of the mistake, which is often earlier than PyYAML's."""
        context, problem, begun = error.context or "", error.problem or "", error.context_mark
        if begun and context == "while scanning a simple key":
            line = _BREAK.split(text[begun.index : begun.index + 1000])[0].strip()
            self.fail(begun, repr(short(line)), "a key, a colon and a blank")
        if begun and context == "while scanning a quoted scalar" and "end of stream" in problem:
            self.fail(begun, "a quote that is not closed", "another one")
        if problem.startswith("expected '<document start>'"):
            self.fail(at, "text behind the end of the document", "one document")
        if begun and begun.line < at.line:
            context += f" that began on line {begun.line + 1}"
        why = ", ".join(part for part in (context, problem) if part)
        self.fail(at, f"not YAML ({why})", "indentation, brackets and quotes that match")


class _Loader(yaml.BaseLoader):
    """Composes nodes. It refuses aliases, tags and deep nesting, of which YAML bombs are made."""

    def __init__(self, text: str, problems: Problems) -> None:
        super().__init__(text)
        self.name = problems.source  # of all marks
        self._problems = problems
        self._depth = 0

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        event = self.peek_event()  # type: ignore[no-untyped-call]
        node: yaml.Node | None
        if isinstance(event, yaml.AliasEvent):
            self.get_event()  # type: ignore[no-untyped-call]
            found, expected = f"the alias *{short(str(event.anchor))}", "the value itself"
        elif self._depth == _DEEPEST:
            self._problems.fail(event.start_mark, f"more than {_DEEPEST} levels", "fewer")
        elif (
            parent is not None
            and len(parent.value) >= _MOST_PARTS
            and (isinstance(parent, yaml.MappingNode) or isinstance(event, yaml.MappingStartEvent))
        ):
            what = "keys" if isinstance(parent, yaml.MappingNode) else "mappings in a list"
            self._problems.fail(event.start_mark, f"more than {_MOST_PARTS} {what}", "fewer")
        else:
            self._depth += 1
            node = super().compose_node(parent, index)
            self._depth -= 1
            if event.tag is None:
                return node
            tag = event.tag.replace("tag:yaml.org,2002:", "!!")
            found, expected = f"the tag {short(tag)!r}", "a value without a tag"
        self._problems.add(event.start_mark, found, expected)
        return yaml.ScalarNode(_REFUSED, "", event.start_mark, event.end_mark)


def keys_in(text: str) -> set[str]:
    """Return the keys of a text that is a mapping; otherwise none."""
    try:
        root = value_of(Problems("").compose(text, ""), 1)
    except ScenarioError:
        return set()
    return set(root) if isinstance(root, Mapping) else set()


def end_of(text: str) -> yaml.Mark:
    """Return the place after a text; lines are counted as in YAML."""
    lines = _BREAK.split(text)
    return yaml.Mark("", 0, len(lines) - 1, len(lines[-1]), None, 0)


def text_of(node: yaml.Node) -> str:
    """Return the text of a scalar, "" for others."""
    return str(node.value) if isinstance(node, yaml.ScalarNode) else ""


def describe(node: yaml.Node) -> str:
    """Describe a node in one short line."""
    if isinstance(node, yaml.MappingNode):
        return "a mapping"
    if isinstance(node, yaml.SequenceNode):
        return f"a list of {len(node.value)}"
    text = str(node.value)
    if isinstance(node, yaml.ScalarNode) and node.style is not None:
        return f"the text {short(text)!r}"
    return repr(short(text)) if text else "nothing"


_T = TypeVar("_T")

_LARGEST_FILE: Final = 1 << 20  # bytes


def read_text(path: str | os.PathLike[str], what: str, largest: int = _LARGEST_FILE) -> str:
    """Return the text of a file of at most `largest` bytes.

    Raises ScenarioError if it cannot be read; `what` was expected.
    """
    source = os.fspath(path)
    if not source:
        raise ScenarioError([Problem("''", 1, 1, "an empty name", what)])
    try:
        with open(source, "rb", opener=open_at_once) as file:
            if file.isatty():  # which would wait for typed text
                raise ValueError("a terminal")
            data = file.read(largest + 1)
    except (OSError, ValueError) as error:
        why = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        raise ScenarioError([Problem(source, 1, 1, why, what)]) from error
    if len(data) > largest:
        raise ScenarioError([Problem(source, 1, 1, f"more than {largest >> 20} MiB", what)])
    try:
        return data.decode()
    except UnicodeDecodeError as error:
        at = end_of(data[: error.start].decode())
        raise ScenarioError(
            [Problem(source, at.line + 1, at.column + 1, f"the byte 0x{data[error.start]:02x}", "UTF-8")]
        ) from error


def open_at_once(path: str, flags: int) -> int:
    """Open a pipe without a writer at once, as an empty file."""
    file = os.open(path, flags | getattr(os, "O_NONBLOCK", 0))
    if hasattr(os, "O_NONBLOCK"):
        os.set_blocking(file, True)
    return file


def read(text: str, source: str, what: str, reader: Callable[[Value], _T], newest: int = 1) -> _T:
    """Read a text of a spec up to `newest` with `reader`. `what`: its kind, `source`: its name, for messages.

    Raises ScenarioError with all mistakes.
    """
    problems = Problems(source)
    root = problems.compose(text, what)
    top = value_of(root, _spec(problems, root, newest))
    try:
        value = reader(top)
    except ConstraintError as error:
        _add(problems, top, error.violations)
        raise ScenarioError(problems.found) from None
    if problems.found:
        raise ScenarioError(problems.found)
    return value


def _add(problems: Problems, top: Value, violations: Iterable[Violation]) -> None:
    """Add violations at the places of their values, each once, those of keys first."""
    seen = set()
    for one in sorted(violations, key=lambda one: not one.at_key):
        if one.problem:
            problems.found.append(one.problem)
            continue
        node = _node(top, one.path, at_key=one.at_key)
        found = _key(one) + (describe(node) if one.found is None else one.found)
        if one.first:
            found += f" (first on line {_node(top, one.first, at_key=True).start_mark.line + 1})"
        place = node.start_mark.index, found, one.expected
        if place not in seen and node.tag != _REFUSED:
            seen.add(place)
            problems.add(node.start_mark, found, one.expected, one.nearest)


def _key(violation: Violation) -> str:
    """Return the key of a wrong value and a colon, or "" if the violation describes more than the value."""
    key = next((step for step in reversed(violation.path) if isinstance(step, str)), "?")
    only_the_value = violation.found is None or (violation.found[0] in "-[0123456789" and not violation.first)
    return f"{key}: " if only_the_value and not violation.at_key and not key.startswith("?") else ""


def _node(top: Value, path: Iterable[str | int], *, at_key: bool) -> yaml.Node:
    """Return the last node that exists along a path: of a key, or of a value."""
    value: Any = top
    node: yaml.Node = top.node
    for step in path:
        if isinstance(value, Mapping) and step in value:
            node, value = value.key_nodes[str(step)], value[str(step)]
        elif isinstance(value, Items) and isinstance(step, int) and step < len(value):
            value = value[step]
            node = value.node
        else:
            return node
    return node if at_key else value.node


def _spec(problems: Problems, root: yaml.Node, newest: int) -> int:
    """Return the spec of a file. Raises ScenarioError when it is newer than the program."""
    pairs = root.value if isinstance(root, yaml.MappingNode) else []
    every = [value for key, value in pairs if isinstance(key, yaml.ScalarNode) and key.value == "spec"]
    if not every:
        return 1
    node = every[0]
    spec = whole(Scalar(node))
    if spec is not None and spec > newest:
        problems.found.clear()  # a newer program may accept the other mistakes
        problems.fail(
            node.start_mark,
            f"spec {spec} is newer than this program reads ({newest}): upgrade arva-hil",
            f"spec {newest}",
        )
    return newest if spec is None or spec < 1 else spec
