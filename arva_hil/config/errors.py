"""Errors in a value or a file: what was found, what was expected, and where."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import Any

from arva_hil.errors import ArvaError


@dataclass(frozen=True)
class Problem:
    """One mistake in a file. Lines and columns count from 1; 1:1 is the whole file."""

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


@dataclass(frozen=True)
class Violation:
    """A value that violates a constraint.

    - `expected`: the valid values, in words.
    - `found`: the value in words; None if a description of the value is enough.
    - `nearest`: the nearest valid value.
    - `path`: the keys and indices that lead to the wrong value. With `at_key` the key there is wrong.
    - `first`: the path of the value or key that this one repeats.
    - `problem`: the problem of another file that the value names.
    """

    expected: str
    found: str | None = None
    nearest: str | None = None
    path: tuple[str | int, ...] = ()
    at_key: bool = False
    first: tuple[str | int, ...] = ()
    problem: Problem | None = None

    def __str__(self) -> str:
        where = "".join(f"[{step}]" if isinstance(step, int) else f".{step}" for step in self.path).lstrip(".")
        return f"{where and where + ': '}{self.found or 'wrong'}, expected {self.expected}"


class ConstraintError(ArvaError, ValueError):
    """A value violates its constraints: all `violations`, those of an object with its class in `of`.

    `given`: the valid part of the value, None without one.
    """

    def __init__(self, *violations: Violation, of: str = "", given: Any = None) -> None:
        super().__init__(*violations)
        self.violations, self.of, self.given = violations, of, given

    def __str__(self) -> str:
        return f"{self.of} {'; '.join(map(str, self.violations))}".lstrip()

    def below(self, *steps: str | int) -> list[Violation]:
        """Return the violations of a part, as those of the whole."""
        return [
            replace(one, path=(*steps, *one.path), first=one.first and (*steps, *one.first)) for one in self.violations
        ]


def elsewhere(error: ScenarioError) -> ConstraintError:
    """Return the error of a value that names a wrong file."""
    return ConstraintError(*(Violation(p.expected, p.found, problem=p) for p in error.problems))


def wrong(expected: str, found: str | None = None, nearest: str | None = None) -> ConstraintError:
    """Return the error for one value."""
    return ConstraintError(Violation(expected, found, nearest))


def any_of(names: Collection[str]) -> str:
    """Return the expectation of one of some names, in words."""
    return next(iter(names)) if len(names) == 1 else f"one of {', '.join(names)}"


def short(text: str) -> str:
    """Return the first 40 characters of a text."""
    return text if len(text) <= 40 else text[:39] + "…"
