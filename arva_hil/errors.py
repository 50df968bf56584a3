"""The root of arva-hil's errors. Each module defines its own, and `import arva_hil` has them all."""

from __future__ import annotations

from collections.abc import Iterable


def nearest(text: str, names: Iterable[str]) -> str | None:
    """Return the name that is most similar to a text; None if no name is similar."""
    from difflib import get_close_matches  # slow to import

    return next(iter(get_close_matches(text, list(names), 1)), None)


class ArvaError(Exception):
    """The base of all errors of this package. `str()` gives the problem, its place, and the cure.

    A caller's mistake raises ValueError; some of these are ArvaErrors too.
    """


class KindError(ArvaError):
    """A receiver model, format, link, fault, strategy or observer cannot be used.

    `found`: the mistake; `cure`: its cure; `nearest`: the most similar name.
    """

    def __init__(self, found: str, cure: str, nearest: str | None = None) -> None:
        self.found = found
        self.cure = cure
        self.nearest = nearest
        super().__init__(f"{found}: " + (f"did you mean {nearest}? " if nearest else "") + cure)


class UnknownKindError(KindError):
    """There is no kind of this name, neither built in nor in an installed package."""
