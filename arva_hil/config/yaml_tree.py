"""YAML read with positions, and every mistake met on the way."""

from __future__ import annotations

import os
import re
from typing import Final, NoReturn

import yaml

from arva_hil.config.tree import Problem, ScenarioError, short

_LARGEST_FILE: Final = 1 << 20  # bytes
_DEEPEST: Final = 20
_REFUSED: Final = "refused"  # the tag of a node that stands for one already complained about
_START: Final = yaml.Mark("", 0, 0, 0, None, 0)
_BREAK: Final = re.compile("\r\n|[\n\r\x85\u2028\u2029]")


class Notes:
    """Remembers the mistakes met in one text, in `problems`."""

    def __init__(self, source: str) -> None:
        self.problems: list[Problem] = []
        self.source = source

    def finish(self) -> None:
        """Raises ScenarioError with every problem, if there was one."""
        if self.problems:
            raise ScenarioError(self.problems)

    def wrong(self, node: yaml.Node, found: str, expected: str, nearest: str | None = None) -> None:
        """Remember a mistake at the start of `node`."""
        if node.tag != _REFUSED:
            self.note(node.start_mark, found, expected, nearest)

    def note(self, at: yaml.Mark, found: str, expected: str, nearest: str | None = None) -> None:
        """Remember a mistake at a place."""
        self.problems.append(Problem(self.source, at.line + 1, at.column + 1, found, expected, nearest))

    def fail(self, at: yaml.Mark, found: str, expected: str) -> NoReturn:
        """Raises ScenarioError with the problems so far and this one, behind which nothing can be read."""
        self.note(at, found, expected)
        raise ScenarioError(self.problems)

    def compose(self, text: str, what: str) -> yaml.Node:
        """The node tree of a text, in which `what` should be. Raises ScenarioError when it is not YAML at all."""
        try:
            loader = _Loader(text, self)
        except yaml.reader.ReaderError as error:
            self.fail(_end(text[: error.position]), f"the character {text[error.position]!r}", "printable text")
        try:
            root = loader.get_node() if loader.check_node() else None
            if root is None:
                self.fail(_START, "an empty file", what)
            if loader.check_node():
                second = loader.peek_event()  # type: ignore[no-untyped-call]
                self.note(second.start_mark, "a second document", "one")
        except yaml.MarkedYAMLError as error:
            at = error.problem_mark or loader.get_mark()
            if text[at.index : at.index + 1] == "\t":
                self.fail(at, "a tab", "spaces")
            self._fail_syntax(error, at, text)
        except (ValueError, OverflowError):  # where PyYAML trusts the number in "\U…" and %YAML
            self.fail(loader.get_mark(), "not YAML (a number too large)", "a smaller one")
        return root

    def _fail_syntax(self, error: yaml.MarkedYAMLError, at: yaml.Mark, text: str) -> NoReturn:
        """Say what PyYAML found, and where the mistake is rather than where it came out."""
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
    """The node tree without what nobody needs here and bombs are made of: aliases, tags and deep nesting."""

    def __init__(self, text: str, notes: Notes) -> None:
        super().__init__(text)
        self._notes = notes
        self._depth = 0

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        event = self.peek_event()  # type: ignore[no-untyped-call]
        node: yaml.Node | None
        if isinstance(event, yaml.AliasEvent):
            self.get_event()  # type: ignore[no-untyped-call]
            found, expected = f"the alias *{short(str(event.anchor))}", "the value itself"
        elif self._depth == _DEEPEST:
            self._notes.fail(event.start_mark, f"more than {_DEEPEST} levels", "fewer")
        else:
            self._depth += 1
            node = super().compose_node(parent, index)
            self._depth -= 1
            if event.tag is None:
                return node
            tag = event.tag.replace("tag:yaml.org,2002:", "!!")
            found, expected = f"the tag {short(tag)!r}", "a value without a tag"
        node = yaml.ScalarNode("", "", event.start_mark, event.end_mark)
        self._notes.wrong(node, found, expected)
        node.tag = _REFUSED
        return node


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
        at = _end(data[: error.start].decode())
        found = f"the byte 0x{data[error.start]:02x}"
        raise ScenarioError([Problem(source, at.line + 1, at.column + 1, found, "UTF-8")]) from error


def open_at_once(path: str, flags: int) -> int:
    """Opens a pipe that nobody writes to without waiting: it is empty."""
    file = os.open(path, flags | getattr(os, "O_NONBLOCK", 0))
    if hasattr(os, "O_NONBLOCK"):
        os.set_blocking(file, True)
    return file


def _end(text: str) -> yaml.Mark:
    """The place behind a text, lines counted as YAML does."""
    lines = _BREAK.split(text)
    return yaml.Mark("", 0, len(lines) - 1, len(lines[-1]), None, 0)


def describe(node: yaml.Node) -> str:
    """What a node is, in one short line."""
    if isinstance(node, yaml.MappingNode):
        return "a mapping"
    if isinstance(node, yaml.SequenceNode):
        return f"a list of {len(node.value)}"
    text = str(node.value)
    if isinstance(node, yaml.ScalarNode) and node.style is not None:
        return f"the text {short(text)!r}"
    return repr(short(text)) if text else "nothing"
