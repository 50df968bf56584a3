"""A history of bounded size: all recent entries, and fewer of the older ones."""

from __future__ import annotations

import bisect
from collections.abc import Iterable

RECENT = 1500
OLD = 3000


class TextHistory:
    """Remembers JSON texts in order, each with the version of the state in which it came.

    It keeps the newest `recent` texts, and every n-th of the older ones. n doubles whenever there are more than `old`.
    So a history of any length has at most `recent` + `old` texts.
    """

    def __init__(self, recent: int = RECENT, old: int = OLD) -> None:
        self._most_recent = recent
        self._most_old = old
        self._recent: list[tuple[int, str]] = []  # with their versions
        self._old: list[str] = []
        self._stride = 1
        self._passed = 0  # number of texts that have left _recent

    def __len__(self) -> int:
        return len(self._old) + len(self._recent)

    def extend(self, texts: Iterable[str], version: int) -> None:
        """Add texts that came with `version`, which is not below the one before."""
        self._recent += ((version, text) for text in texts)
        if (surplus := len(self._recent) - self._most_recent) > 0:
            for _, text in self._recent[:surplus]:
                self._pass(text)
            del self._recent[:surplus]

    def since(self, version: int) -> list[str] | None:
        """Return the lines after `version`; None if some of them are gone."""
        first = bisect.bisect_right(self._recent, version, key=lambda one: one[0])
        return None if first == 0 and self._passed else [text for _, text in self._recent[first:]]

    def whole(self) -> list[str]:
        """Return all lines."""
        return self._old + [text for _, text in self._recent]

    def _pass(self, text: str) -> None:
        if self._passed % self._stride == 0:
            self._old.append(text)
            if len(self._old) > self._most_old:
                del self._old[1::2]
                self._stride *= 2
        self._passed += 1
