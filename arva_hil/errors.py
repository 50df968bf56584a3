"""The errors of arva-hil: one root. Each leaf is where it is raised, and `import arva_hil` has them all."""

from __future__ import annotations

__all__ = ["ArvaError", "KindError", "UnknownKindError"]


class ArvaError(Exception):
    """What this program raises on purpose; `str()` says what is wrong, where and the cure.

    A caller's mistake is a ValueError, some of which are ArvaErrors too.
    """


class KindError(ArvaError):
    """A receiver model, format, link, fault, strategy or observer cannot be used.

    `found` says what is wrong, `cure` what to do; `nearest` is the name that may have been meant.
    """

    def __init__(self, found: str, cure: str, nearest: str | None = None) -> None:
        self.found = found
        self.cure = cure
        self.nearest = nearest
        super().__init__(f"{found}: " + (f"did you mean {nearest}? " if nearest else "") + cure)


class UnknownKindError(KindError):
    """Nothing is built in under that name, and no installed package has it."""
