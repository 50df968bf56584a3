"""A fault on the wire: with some probability the first bytes of a frame are sent in reverse."""

from __future__ import annotations

from dataclasses import dataclass
from random import Random
from typing import Annotated

from annotated_types import Ge, Le

from arva_hil import FaultKind, Number


@dataclass(frozen=True)
class Options:
    """Own keys of the fault."""

    first: Annotated[int, Ge(2), Le(1000)] = 1000


def _reversed(data: bytes, share: float, random: Random, options: Options) -> tuple[bytes, int]:
    if random.random() >= share:
        return data, 0
    head = data[: options.first]
    return head[::-1] + data[len(head) :], len(head)


REVERSED = FaultKind(
    "wire", Number(0, 1, "a probability", above=True), "probability a frame: backwards", _reversed, options=Options
)
