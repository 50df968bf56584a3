"""In which order several workers run the tests, so that they finish together and no core is idle.

pytest-xdist gives each worker one piece of the list, and one that has finished takes from the end of another's piece.
Tests that wait (for processes, for real time) stand together in a few folders: left as they are, one worker waits for
minutes, and it is the last. So every piece gets as many of them, spread over it, the last folders (pages, sitl) first,
for they wait longest, and none at its end.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import groupby
from typing import Final, TypeVar

_T = TypeVar("_T")

BLOCK: Final = 4  # tests of one file that stay together, for what they share is made once
_SPREAD: Final = 0.8  # of a piece: its end is left to tests that take no time


def dealt(tests: Sequence[_T], workers: int, waits: Callable[[_T], bool], file: Callable[[_T], object]) -> list[_T]:
    """`tests` in the order in which `workers` shall take them. `waits`: whether one waits; `file`: where it is."""
    slow = [test for test in tests if waits(test)]
    blocks = [
        same[i : i + BLOCK]
        for _, group in groupby(slow, file)
        for same in [list(group)]
        for i in range(0, len(same), BLOCK)
    ][::-1]
    quick = [test for test in tests if not waits(test)]
    order: list[_T] = []
    for worker in range(workers):
        mine = blocks[worker::workers]
        count = (len(tests) - len(order)) // (workers - worker) - sum(map(len, mine))
        count = max(0, count) if worker < workers - 1 else len(quick)
        order += _spread(mine, quick[:count])
        quick = quick[count:]
    return order


def _spread(blocks: list[list[_T]], quick: list[_T]) -> list[_T]:
    """`blocks` at even distances among `quick`, in order."""
    result, done = [], 0
    for i, block in enumerate(blocks):
        upto = int(_SPREAD * len(quick) * i / len(blocks))
        result += [*quick[done:upto], *block]
        done = upto
    return result + quick[done:]
