"""Checks the answers of a strategy before they are flown, and reports its errors with the cure."""

from __future__ import annotations

import inspect
import math
import traceback
from pathlib import Path
from typing import Any, Final

from arva_hil.errors import ArvaError
from arva_hil.safe_text import shown
from arva_hil.search.strategies.strategy import Found, Velocity

_CURE: Final = "mend it, and fly it in arva-hil demo first"
_CALLERS: Final = [Path(__file__).with_name("analysis.py")]


class StrategyError(ArvaError):
    """A strategy has returned an invalid value."""


def checked_velocity(said: Any) -> Velocity:
    """The result of `velocity` [m/s north and east]. Raises StrategyError unless it is two finite numbers."""
    try:
        north, east = said
        if math.isfinite(math.hypot(north, east)):
            return float(north), float(east)
    except Exception:  # not a velocity
        pass
    raise StrategyError(f"velocity returned {_shown(said)}, expected two finite numbers, m/s north and east")


def checked_found(said: Any) -> Found | None:
    """The value of `found`, None if a coordinate is not finite. Raises StrategyError unless it is a Found."""
    if said is None:
        return None
    if not isinstance(said, Found):
        raise StrategyError(f"found is {_shown(said)}, expected None or arva_hil.Found(north, east)")
    try:
        return _sound(said)
    except Exception:
        raise StrategyError(f"found is {_shown(said)}, expected numbers, m north and east") from None


def failed(error: BaseException) -> str:
    """The outcome of a search whose strategy has raised this error."""
    said = str(error) if isinstance(error, StrategyError) else f"{_shown(error)}{_where(error)}"
    return f"the strategy has failed: {said}; {_CURE}"


def silent(took_s: float) -> str:
    """The outcome of a search whose strategy does not answer any more."""
    return f"the strategy has failed: it has not answered for {took_s:.1f} s; {_CURE}"


def killed(exit_code: int | None) -> str:
    """The outcome of a search whose strategy has ended its own process, or was killed in it by a signal."""
    why = f"signal {-exit_code}" if exit_code and exit_code < 0 else f"exit code {exit_code}"
    return f"the strategy has failed: its process has ended ({why}); {_CURE}"


def _sound(found: Found) -> Found | None:
    """The place without what is invalid of the rest."""
    north, east, down, covariance, now = found
    if not math.isfinite(north + east):
        return None
    if down is not None and not math.isfinite(down):
        down = None
    if covariance is not None and not (math.isfinite(sum(covariance)) and min(covariance[0], covariance[2]) >= 0):
        covariance = None
    if now is not None and not math.isfinite(math.hypot(*now)):
        now = None
    return Found(north, east, down, covariance, now)


def _shown(thing: Any) -> str:
    """The repr of a value, shortened."""
    if inspect.iscoroutine(thing):
        thing.close()  # otherwise Python warns later that it was never awaited
        return "a coroutine (write def, not async def)"
    return shown(thing)


def _where(error: BaseException) -> str:
    """The last line that was run in the file of the strategy."""
    frames = traceback.extract_tb(error.__traceback__)
    file = next((frame.filename for frame in frames if Path(frame.filename) not in _CALLERS), "")
    lines = [frame.lineno for frame in frames if frame.filename == file]
    return f" ({Path(file).name}:{lines[-1]})" if lines else ""
