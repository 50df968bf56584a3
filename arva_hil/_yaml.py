"""YAML read with positions: typed values out of a node tree, and every mistake met on the way.

Scalars are read from the text as written, so `off` is a word and `1e3` a number, whatever YAML 1.1 says.
"""

from __future__ import annotations

import difflib
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NoReturn, TypeVar

import yaml

__all__ = ["Problem", "Range", "Reader", "ScenarioError", "nearest", "open_at_once", "read_text", "whole"]

_LARGEST_FILE: Final = 1 << 20  # bytes
_DEEPEST: Final = 20
_REFUSED: Final = "refused"  # the tag of a node that stands for one already complained about
_START: Final = yaml.Mark("", 0, 0, 0, None, 0)
_BREAK: Final = re.compile("\r\n|[\n\r\x85\u2028\u2029]")
_FLOAT: Final = re.compile(r"[-+]?((0|[1-9][0-9]*)(\.[0-9]*)?|\.[0-9]+)([eE][-+]?[0-9]+)?")
_TYPED: Final = {ord("\N{MINUS SIGN}"): "-", ord("\N{EN DASH}"): "-", ord(","): "."}  # where a number was meant
_WHOLE: Final = re.compile(r"[-+]?(0|[1-9][0-9]{0,18})")

_Word = TypeVar("_Word", bound=str)


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


class ScenarioError(Exception):
    """A scenario or a plan that cannot be used. `problems` are sorted by place; `str()` is one line for each."""

    def __init__(self, problems: Sequence[Problem]) -> None:
        self.problems = tuple(sorted(problems, key=lambda p: (p.source, p.line, p.column)))
        super().__init__(self.problems)

    def __str__(self) -> str:
        return "\n".join(map(str, self.problems))


@dataclass(frozen=True)
class Range:
    """The numbers from `low` to `high`, `low` itself excluded if `above`. `str()` is what was expected."""

    low: float
    high: float
    what: str = "a number"
    above: bool = False

    def __contains__(self, value: float) -> bool:
        return self.low <= value <= self.high and not (self.above and value == self.low)

    def __str__(self) -> str:
        if self.low == self.high:
            return f"{self.what} {self.low}"
        bounds = f"above {self.low}, at most {self.high}" if self.above else f"from {self.low} to {self.high}"
        return f"{self.what} {bounds}"


class Reader:
    """Walks the nodes of one YAML document; remembers its mistakes in `problems`.

    Each method takes a node (None: the key is not there) and gives the default when there is none or when it
    is wrong, so that the walk goes on and finds every mistake. Call `finish` at the end.
    """

    def __init__(self, text: str, source: str, what: str = "a mapping with transmitters") -> None:
        """`what` should be in the text. Raises ScenarioError when it is not YAML at all."""
        self.problems: list[Problem] = []
        self.source = source
        self.root = self._compose(text, what)

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

    def mapping(self, node: yaml.Node | None, keys: str, need: Sequence[str] = ()) -> dict[str, yaml.Node]:
        """The values by key. `keys` are the valid ones; of those in each of `need` exactly one is due."""
        if node is None:
            return {}
        names = keys.split()
        if not isinstance(node, yaml.MappingNode):
            self.wrong(node, _describe(node), f"a mapping with {', '.join(names)}")
            return {}
        seen: dict[str, tuple[yaml.Node, yaml.Node]] = {}
        for key, value in node.value:
            name = key.value if isinstance(key, yaml.ScalarNode) else ""
            if name not in names:
                self.wrong(key, f"unknown key {_describe(key)}", _any_of(names), _nearest(key, names))
            elif name in seen:
                line = seen[name][0].start_mark.line + 1
                self.wrong(key, f"key {name!r} again (first on line {line})", "each key once")
            else:
                seen[name] = key, value
        for group in map(str.split, need):
            given = [name for name in seen if name in group]
            exactly = f"a mapping with {'exactly one of ' if len(group) > 1 else ''}{', '.join(group)}"
            if not given:
                self.wrong(node, f"no {' or '.join(group)}", exactly)
            for name in given[1:]:
                self.wrong(seen[name][0], f"both {given[0]} and {name}", exactly)
        return {name: value for name, (_, value) in seen.items()}

    def items(self, node: yaml.Node | None, count: range, what: str) -> list[yaml.Node]:
        """The items of a list, empty when it is not one. Their number is checked against `count`."""
        if node is None:
            return []
        if not isinstance(node, yaml.SequenceNode) or len(node.value) not in count:
            size = f"{count[0]}" if len(count) == 1 else f"{count[0]} to {count[-1]}"
            self.wrong(node, _describe(node), f"a list of {size} {what}")
        return list(node.value) if isinstance(node, yaml.SequenceNode) else []

    def number(self, node: yaml.Node | None, default: float, valid: Range) -> float:
        """A finite number in the range."""
        if node is None:
            return default
        plain = _plain(node)
        value = float(plain) if _FLOAT.fullmatch(plain) else float("nan")
        if value in valid:
            return value
        meant = plain.translate(_TYPED)
        hint = meant if _FLOAT.fullmatch(meant) and float(meant) in valid else None
        self.wrong(node, _describe(node), str(valid), hint)
        return default

    def integer(self, node: yaml.Node | None, default: int, valid: Range) -> int:
        """A whole number in the range, written without a point."""
        if node is None:
            return default
        value = whole(node)
        if value is not None and value in valid:
            return value
        self.wrong(node, _describe(node), str(valid))
        return default

    def triple(
        self, node: yaml.Node | None, default: tuple[float, float, float], valid: Sequence[Range]
    ) -> tuple[float, float, float]:
        """A list of three numbers, each in its own range."""
        items = self.items(node, range(3, 4), "numbers")
        if len(items) != 3:
            return default
        x, y, z = (self.number(item, 0.0, one) for item, one in zip(items, valid, strict=True))
        return x, y, z

    def word(self, node: yaml.Node | None, default: _Word, valid: Sequence[_Word], expected: str = "") -> _Word:
        """One of the valid words, quoted or not."""
        if node is None:
            return default
        for word in valid:
            if isinstance(node, yaml.ScalarNode) and node.value == word:
                return word
        self.wrong(node, _describe(node), expected or _any_of(valid), _nearest(node, valid))
        return default

    def text(self, node: yaml.Node, what: str) -> str:
        """Some text, quoted or not; "" when it is something else."""
        if isinstance(node, yaml.ScalarNode) and node.value:
            return str(node.value)
        self.wrong(node, _describe(node), what)
        return ""

    def spec(self, node: yaml.Node | None, known: int) -> None:
        """The version of the file's format. Raises ScenarioError when it is newer than what is `known`."""
        if node is not None and (newer := whole(node) or 0) > known:
            self.problems.clear()  # what looks wrong may be right in that version
            found = f"spec {newer} is newer than this program reads ({known}): upgrade arva-hil"
            self.wrong(node, found, f"spec {known}")
            self.finish()
        self.integer(node, known, Range(known, known, "spec"))

    def _compose(self, text: str, what: str) -> yaml.Node:
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
            self.fail(begun, repr(_short(line)), "a key, a colon and a blank")
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

    def __init__(self, text: str, reader: Reader) -> None:
        super().__init__(text)
        self._reader = reader
        self._depth = 0

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        event = self.peek_event()  # type: ignore[no-untyped-call]
        node: yaml.Node | None
        if isinstance(event, yaml.AliasEvent):
            self.get_event()  # type: ignore[no-untyped-call]
            found, expected = f"the alias *{_short(str(event.anchor))}", "the value itself"
        elif self._depth == _DEEPEST:
            self._reader.fail(event.start_mark, f"more than {_DEEPEST} levels", "fewer")
        else:
            self._depth += 1
            node = super().compose_node(parent, index)
            self._depth -= 1
            if event.tag is None:
                return node
            tag = event.tag.replace("tag:yaml.org,2002:", "!!")
            found, expected = f"the tag {_short(tag)!r}", "a value without a tag"
        node = yaml.ScalarNode("", "", event.start_mark, event.end_mark)
        self._reader.wrong(node, found, expected)
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


def whole(node: yaml.Node) -> int | None:
    """The whole number (19 digits at most) that a node is, None when it is something else."""
    plain = _plain(node)
    return int(plain) if _WHOLE.fullmatch(plain) else None


def _plain(node: yaml.Node) -> str:
    """The text of a scalar without quotes; "" for anything else."""
    return str(node.value) if isinstance(node, yaml.ScalarNode) and node.style is None else ""


def _describe(node: yaml.Node) -> str:
    """What a node is, in one short line."""
    if isinstance(node, yaml.MappingNode):
        return "a mapping"
    if isinstance(node, yaml.SequenceNode):
        return f"a list of {len(node.value)}"
    text = str(node.value)
    if isinstance(node, yaml.ScalarNode) and node.style is not None:
        return f"the text {_short(text)!r}"
    return repr(_short(text)) if text else "nothing"


def _short(text: str) -> str:
    return text if len(text) <= 40 else text[:39] + "…"


def _any_of(names: Sequence[str]) -> str:
    return names[0] if len(names) == 1 else f"one of {', '.join(names)}"


def _nearest(node: yaml.Node, names: Sequence[str]) -> str | None:
    """The name that was probably meant."""
    return nearest(str(node.value).lower(), names) if isinstance(node, yaml.ScalarNode) else None


def nearest(text: str, names: Sequence[str]) -> str | None:
    """The name most like a text, None when none is."""
    return next(iter(difflib.get_close_matches(text, names, 1)), None)
