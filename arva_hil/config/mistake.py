"""What is wrong with a value: what was found, what was expected, and where."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from arva_hil.config.tree import Problem, any_of
from arva_hil.errors import ArvaError


@dataclass(eq=False)
class Mistake(ArvaError):
    """A value that is not of its sort: what was `expected`; what was `found`, where describing the value is not enough;
    the `nearest` valid one. `where` is the way to its place from the value that was read, `at_key` if its key is meant.

    `keys` are valid there, each with the spec since which it is: in the texts `{keys}` and `{or}` stand for them.
    """

    expected: str
    found: str | None = None
    nearest: str | None = None
    where: tuple[str | int, ...] = ()
    at_key: bool = False
    keys: Mapping[str, int] = field(default_factory=dict)
    value: Any = None  # what is wrong, for Python
    native: bool = False  # from a constructor, not from a sort

    def __str__(self) -> str:
        return f"{self.told(self.found)}, expected {self.told()}" if self.found else f"expected {self.told()}"

    def told(self, text: str | None = None, spec: int = 1_000) -> str:
        """What is expected or another text, with the keys that files of a spec have."""
        names = [name for name, since in self.keys.items() if since <= spec]
        text = self.expected if text is None else text
        if not names:
            return text
        for mark, said in (
            ("{one of keys}", any_of(names)),
            ("{keys}", ", ".join(names)),
            ("{or}", " or ".join(names)),
        ):
            text = text.replace(mark, said)
        return text


class Mistakes(ArvaError):
    """All that is wrong with a value, and the `problems` of other files that it names."""

    def __init__(self, every: Sequence[Mistake], problems: Sequence[Problem] = ()) -> None:
        super().__init__(*every)
        self.every, self.problems = tuple(every), tuple(problems)


def each(items: Sequence[Any], read: Callable[[int, Any], Any], mistakes: Sequence[Mistake] = ()) -> list[Any]:
    """Every item read. Raises Mistakes with the mistakes of all, behind those that there are."""
    values = []
    wrong = list(mistakes)
    for at, item in enumerate(items):
        try:
            values.append(read(at, item))
        except (Mistake, Mistakes) as error:
            wrong += below(at, error)
    if wrong:
        raise Mistakes(wrong)
    return values


def below(step: str | int, error: Mistake | Mistakes) -> list[Mistake]:
    """The mistakes of a part, as those of the whole."""
    every = error.every if isinstance(error, Mistakes) else (error,)
    return [replace(one, where=(step, *one.where)) for one in every]
