"""Sorts of text: one of some words, a name in a registry, what matches a pattern. It imports no pydantic."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from arva_hil.config.mistake import Mistake
from arva_hil.config.sorts import Sort
from arva_hil.config.tree import Scalar, any_of, nearest
from arva_hil.errors import KindError, UnknownKindError
from arva_hil.registry import Registry


@dataclass(frozen=True)
class Word(Sort):
    """One of some words, quoted or not."""

    words: Sequence[str]
    expected: str = ""

    def __str__(self) -> str:
        return self.expected or any_of(self.words)

    def read(self, value: Any) -> str:
        for word in self.words:
            if isinstance(value, str) and value == word:
                return word
        hint = nearest(value.lower(), self.words) if isinstance(value, str) else None
        raise Mistake(str(self), nearest=hint)

    def json(self) -> dict[str, Any]:
        return {"enum": list(self.words)}


@dataclass(frozen=True)
class Named(Sort):
    """A name of what is in a registry: built in, or of a package that works."""

    registry: Registry

    def __str__(self) -> str:
        return any_of(list(self.registry))

    def read(self, value: Any) -> str:
        if not isinstance(value, str):
            raise Mistake(str(self))
        if value in list(self.registry):
            return str(value)
        try:
            self.registry[str(value)]
        except UnknownKindError as error:
            raise Mistake(any_of(self.registry.names()), nearest=error.nearest) from None
        except KindError as error:
            raise Mistake(f"one that works: {error.cure}", error.found) from None
        return str(value)

    def json(self) -> dict[str, Any]:
        return {"enum": self.registry.names()}


class Yes(Word):
    """Only `true`, for what there is nothing to say of but that it is on; read as 1."""

    def __init__(self) -> None:
        super().__init__(("true",))

    def read(self, value: Any) -> Any:
        if not isinstance(value, Scalar) and value == 1:
            return 1
        super().read(value)
        return 1

    def json(self) -> dict[str, Any]:
        return {"const": True}


@dataclass(frozen=True)
class Text(Sort):
    """Some text that matches `pattern`, quoted or not."""

    what: str
    pattern: str = r"(?s:.+)"

    def __str__(self) -> str:
        return self.what

    def read(self, value: Any) -> str:
        if not isinstance(value, str) or not re.fullmatch(self.pattern, value):
            raise Mistake(self.what)
        return str(value)

    def json(self) -> dict[str, Any]:
        return {"type": "string"} | (
            {"minLength": 1} if self.pattern == Text.pattern else {"pattern": f"^{self.pattern}$"}
        )
