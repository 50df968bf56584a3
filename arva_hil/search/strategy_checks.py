"""What a strategy says is judged before it is flown, and what it does wrong is told with the cure."""

from __future__ import annotations

import inspect
import math
import traceback
from pathlib import Path
from typing import Any, Final

from arva_hil.errors import ArvaError
from arva_hil.search.strategy import Found, Velocity

SLOW_S: Final = 1.0  # for one answer: no set-point leaves meanwhile, and PX4 waits no longer (COM_OF_LOSS_T)
OFTEN: Final = 2  # as slow as that: it is the strategy, and no pause of the computer

_CURE: Final = "mend it, and fly it in arva-hil demo first"
_CALLER: Final = Path(__file__).with_name("mission.py")
_MOST: Final = 200  # characters of an error that is not ours


class StrategyError(ArvaError):
    """A strategy has said what it must not say."""


def checked_velocity(said: Any) -> Velocity:
    """What `velocity` returned, m/s north and east. Raises StrategyError for anything but two finite numbers."""
    try:
        north, east = said
        if math.isfinite(math.hypot(north, east)):
            return float(north), float(east)
    except Exception:  # whatever that is, it is no velocity
        pass
    raise StrategyError(f"velocity returned {_shown(said)}, expected two finite numbers, m/s north and east")


def checked_found(said: Any) -> Found | None:
    """What is at `found`; None where a coordinate is no number. Raises StrategyError for anything but a Found."""
    if said is None:
        return None
    if not isinstance(said, Found):
        raise StrategyError(f"found is {_shown(said)}, expected None or arva_hil.Found(north, east)")
    try:
        return _sound(said)
    except Exception:
        raise StrategyError(f"found is {_shown(said)}, expected numbers, m north and east") from None


def failed(error: BaseException) -> str:
    """How a search ends whose strategy has raised this."""
    said = str(error) if isinstance(error, StrategyError) else f"{_shown(error)}{_where(error)}"
    return f"the strategy has failed: {said}; {_CURE}"


def too_slow(took_s: float) -> str:
    """How a search ends whose strategy needs so long."""
    said = f"it took {took_s:.1f} s to answer, more than {SLOW_S:g} s, and the vehicle was not steered meanwhile"
    return f"the strategy has failed: {said}; {_CURE}"


def _sound(found: Found) -> Found | None:
    """Without what is no number or no variance."""
    north, east, down, covariance = found
    if not math.isfinite(north + east):
        return None
    if down is not None and not math.isfinite(down):
        down = None
    if covariance is not None and not (math.isfinite(sum(covariance)) and min(covariance[0], covariance[2]) >= 0):
        covariance = None
    return Found(north, east, down, covariance)


def _shown(thing: Any) -> str:
    """As Python shows it, and not longer than a person reads."""
    if inspect.iscoroutine(thing):
        thing.close()  # or Python says later that nobody waited for it
        return "a coroutine (write def, not async def)"
    try:
        text = repr(thing)
    except Exception:  # its own __repr__ raises
        text = f"a {type(thing).__name__}"
    return text if len(text) <= _MOST else f"{text[:_MOST]}…"


def _where(error: BaseException) -> str:
    """The last line that was run of the file that the strategy is in."""
    frames = traceback.extract_tb(error.__traceback__)
    file = next((frame.filename for frame in frames if Path(frame.filename) != _CALLER), "")
    lines = [frame.lineno for frame in frames if frame.filename == file]
    return f" ({Path(file).name}:{lines[-1]})" if lines else ""
