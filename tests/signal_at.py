"""A signal at a certain line, as it may come at any."""

from __future__ import annotations

import math
import signal
import sys
from collections.abc import Callable, Collection
from types import FrameType, FunctionType, ModuleType
from typing import Any, TypeVar

_T = TypeVar("_T")


def signalled(
    line: int,
    modules: Collection[ModuleType],
    call: Callable[[], _T],
    number: int,
    *,
    since: FunctionType | None = None,
) -> tuple[_T, int]:
    """Call it, with a signal before the line of these modules that is run as the `line`-th; what the call returns, and
    how many lines have been run until it returned or raised. `since`: lines count from the call of this function on.
    """
    files = {module.__file__ for module in modules}
    run = -math.inf if since else 0

    def trace(frame: FrameType, event: str, arg: object) -> Any:
        nonlocal run
        if since and event == "call" and frame.f_code is since.__code__:
            run = 0
        if frame.f_code.co_filename not in files:
            return None
        run += event == "line"
        if event == "line" and run == line:
            signal.raise_signal(number)
        return trace

    before = sys.gettrace()
    sys.settrace(trace)
    try:
        return call(), int(max(run, 0))
    finally:
        sys.settrace(before)
