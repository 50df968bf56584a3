"""The slow computations of a search: the strategy, and the check of the places that it finds.

The answers of a strategy are checked before they are flown; its errors are reported with the cure.

An `Analysis` gets orders and returns one answer. It runs in the steering loop where the clock is stepped, otherwise in
a process of its own (`strategy_process.py`), so that a set-point never waits for it.
"""

from __future__ import annotations

import inspect
import math
import sys
import traceback
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any, Final, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from arva_hil.errors import ArvaError
from arva_hil.safe_text import shown
from arva_hil.search.strategies.agreement import Evidence
from arva_hil.search.strategies.explained import dipole_at
from arva_hil.search.strategies.history import Track
from arva_hil.search.strategies.strategy import (
    FARTHEST_M,
    Belief,
    Found,
    Observation,
    Position,
    Strategy,
    Velocity,
    sigma_of,
)

FAILED: Final = "the strategy has failed: "  # begins the outcome of its search

_REMEMBERED: Final = 256  # observations of each transmitter
_NEWEST_S: Final = 2.0  # age of the readings that confirm a transmitter
_LEAST, _NEWEST = 4, 20  # least and largest number of these readings; the least may be older
_BESIDE_M: Final = 0.5  # least distance of these readings: nearer the field is not that of a dipole
_SURE_M: Final = 0.4  # largest ± of a place that is sure, relative to the drone
_SHAPES: Final = {"now": (2,), "covariance": (3,), "now_covariance": (3,)}  # of a place; other values are numbers
_MOST_HYPOTHESES: Final = 64  # of an estimate
_CURE: Final = "fix the error, and fly it in arva-hil demo first"
_AT_A_TIME: Final = 32  # readings of the past that a new strategy gets in one batch


class AnalysisResult(NamedTuple):
    """The results of one batch of orders."""

    number: int = 0
    """Number of the strategy."""
    velocity: Velocity | None = None
    """None without an order to steer."""
    found: Found | None = None
    """The place that the strategy has found, None before."""
    sure: bool = False
    """True if the readings agree with that place, and ± relative to the drone is at most 0.4 m."""
    dipole: NDArray[np.float64] | None = None
    """The dipole (7,) at that place that fits its readings best; of a transmitter without an id only."""
    belief: Belief | None = None
    """The present estimate of the strategy; None if it has none, or without a new reading."""
    track: Track = ()
    """The track of a transmitter that moves; empty if it stands still."""
    contradictions: tuple[bool, ...] | None = None
    """For each of the newest readings: True if it contradicts that place. None without an order to check it."""
    failed: str = ""
    """Outcome of the search if the strategy has failed."""


class TransmitterReadings:
    """The readings of one transmitter."""

    def __init__(self) -> None:
        self.past: deque[Observation] = deque(maxlen=_REMEMBERED)
        self.evidence = Evidence()

    def add(self, o: Observation) -> None:
        self.past.append(o)
        self.evidence.add(o)

    def judged(self, found: Found, height_m: float) -> tuple[Found, bool]:
        """Return a place with its covariance, and True if the readings agree with it and its ± is small."""
        judgement = self.evidence.judge(found[:2])
        if judgement is None or not judgement.agrees(height_m):
            return found, False
        sure = (sigma_of(found.now_covariance) or 0.0) <= _SURE_M
        return found._replace(covariance=found.covariance or judgement.covariance), sure

    def contradictions(self, time_s: float) -> list[bool]:
        """Return, for each of the newest readings in order of time, True if it contradicts the place judged last."""
        newest = [o for o in self.past if o.d_m > _BESIDE_M]
        count = sum(time_s - o.time_s < _NEWEST_S for o in newest)
        return self.evidence.contradictions(newest[-min(max(count, _LEAST), _NEWEST) :] if count else [])


class Analysis:
    """The readings of all transmitters, and the strategy that flies to one of them.

    `make` makes a strategy. `at_once`: each batch completes its work. Otherwise a place is judged in the batch after
    the one that finds it, and a new strategy gets earlier readings in several batches, so that no answer takes long.
    """

    def __init__(self, make: Callable[[], Strategy], *, at_once: bool) -> None:
        self._make = make
        self._at_once = at_once
        self._unheard: deque[Observation] = deque()  # readings that the strategy gets later
        self._unjudged: tuple[Found, float] | None = None  # a place found, and the height wanted
        self._strategy: Strategy | None = None
        self._records: dict[int, TransmitterReadings] = {}
        self._record, self._has_id = TransmitterReadings(), False  # of the transmitter that the strategy flies to
        self._answer = AnalysisResult()

    def answer(self, orders: Sequence[Order]) -> AnalysisResult:
        """Follow the orders. An error of the strategy ends the search."""
        self._answer = self._answer._replace(velocity=None, belief=None, contradictions=None)
        try:
            if self._unjudged:
                self._judge(*self._unjudged)
            if self._unheard:
                self._replay(_AT_A_TIME)
            for follow, *arguments in orders:
                follow(self, *arguments)
        except (Exception, SystemExit) as error:
            self._answer = self._answer._replace(failed=failed(error))
        return self._answer

    def add(self, id_: int, o: Observation) -> None:
        """Add a reading of a transmitter."""
        if id_ not in self._records:
            self._records[id_] = TransmitterReadings()
        self._records[id_].add(o)

    def forget(self, id_: int) -> None:
        """Forget the readings of a transmitter."""
        self._records.pop(id_, None)

    def begin(self, number: int, id_: int, has_id: bool) -> None:
        """Begin a new strategy for a transmitter, with all of its readings but the newest."""
        self._answer, self._record, self._has_id = AnalysisResult(number), self._records[id_], has_id
        self._unjudged = None
        self._strategy, self._unheard = self._make(), deque(list(self._record.past)[:-1])
        if self._at_once:
            self._replay(len(self._unheard))

    def observe(self, o: Observation, height_m: float) -> None:
        """Give the strategy a reading. `height_m`: the height wanted."""
        strategy = self._strategy
        if strategy is None or self._finished:
            return
        if self._unheard:
            self._unheard.append(o)
            return
        self._observe(o)
        found, belief = checked_found(strategy.found), getattr(strategy, "belief", None)
        if isinstance(belief, Belief):
            belief = belief._replace(hypotheses=belief.hypotheses[:_MOST_HYPOTHESES])
            self._answer = self._answer._replace(belief=belief)
        track = getattr(strategy, "track", ())  # another's strategy may have anything there
        self._answer = self._answer._replace(track=_track(track) if isinstance(track, tuple) and track else ())
        if found is not None:
            self._unjudged = found, height_m
            if self._at_once:
                self._judge(found, height_m)

    def steer(self, time_s: float, position: Position) -> None:
        """Ask the strategy for the velocity."""
        if self._strategy is not None and not self._finished and not self._unheard:
            velocity = checked_velocity(self._strategy.velocity(time_s, position))
            self._answer = self._answer._replace(velocity=velocity)

    def check(self, time_s: float) -> None:
        """Compare the newest readings with the place found."""
        self._answer = self._answer._replace(contradictions=tuple(self._record.contradictions(time_s)))

    @property
    def _finished(self) -> bool:
        return self._unjudged is not None or self._answer.found is not None

    def _observe(self, o: Observation) -> None:
        strategy: Any = self._strategy
        (strategy.hear if hasattr(strategy, "hear") else strategy.observe)(o)  # `hear`: the old name of `observe`

    def _replay(self, most: int) -> None:
        for _ in range(min(most, len(self._unheard))):
            self._observe(self._unheard.popleft())

    def _judge(self, found: Found, height_m: float) -> None:
        dipole = None if self._has_id else dipole_at(found, self._record.past)
        found, sure = self._record.judged(found, height_m)
        self._unjudged, self._answer = None, self._answer._replace(found=found, sure=sure, dipole=dipole)


Order = tuple[Any, ...]  # a method of Analysis and its arguments


class Worker(Protocol):
    """Follows orders somewhere."""

    def send(self, orders: Sequence[Order]) -> None:
        """Send a batch. The previous batch must have been answered."""

    def receive(self) -> AnalysisResult | None:
        """Return the answer to the batch, None before it has come. Does not wait."""

    @property
    def starved_s(self) -> float:
        """Time for which it could compute, but other programs had the processors [s]."""


class Inline:
    """A worker in the steering loop: an answer takes no time of a stepped clock."""

    starved_s = 0.0

    def __init__(self, make: Callable[[], Strategy]) -> None:
        self._analysis = Analysis(make, at_once=True)
        self._answer: AnalysisResult | None = None

    def send(self, orders: Sequence[Order]) -> None:
        with redirect_stdout(sys.stderr):  # for what the strategy prints: stdout has the results of the command
            self._answer = self._analysis.answer(orders)

    def receive(self) -> AnalysisResult | None:
        return self._answer


class StrategyError(ArvaError):
    """A strategy has returned an invalid value."""


def checked_velocity(said: Any) -> Velocity:
    """Return the result of `velocity` [m/s north and east]. Raises StrategyError unless it is two finite numbers."""
    try:
        north, east = said
        if math.isfinite(math.hypot(north, east)):
            return float(north), float(east)
    except Exception:  # not a velocity
        pass
    raise StrategyError(f"velocity returned {_shown(said)}, expected two finite numbers, m/s north and east")


def checked_found(said: Any) -> Found | None:
    """Return the value of `found`, None if it is not on Earth. Raises StrategyError unless it is a Found."""
    if said is None:
        return None
    if not isinstance(said, Found):
        raise StrategyError(f"found is {_shown(said)}, expected None or arva_hil.Found(north, east)")
    try:
        return _sound(said)
    except Exception:
        raise StrategyError(f"found is {_shown(said)}, expected numbers, m north and east") from None


def failed(error: BaseException) -> str:
    """Return the outcome of a search whose strategy has raised this error."""
    said = str(error) if isinstance(error, StrategyError) else f"{_shown(error)}{_where(error)}"
    return f"{FAILED}{said}; {_CURE}"


def silent(took_s: float) -> str:
    """Return the outcome of a search whose strategy does not answer any more."""
    return f"{FAILED}it has not answered for {took_s:.1f} s; {_CURE}"


def killed(exit_code: int) -> str:
    """Return the outcome of a search whose strategy process has ended or was killed by a signal."""
    why = f"signal {-exit_code}" if exit_code < 0 else f"exit code {exit_code}"
    return f"{FAILED}its process has ended ({why}); {_CURE}"


def _sound(found: Found) -> Found | None:
    """Return the place without its invalid optional values; None if it is not on Earth."""
    if not math.hypot(found.north, found.east) < FARTHEST_M:  # true for NaN
        return None
    values = {name: value for name, value in found._asdict().items() if value is not None and np.isfinite(value).all()}
    for name, value in values.items():
        numbers = np.array(value, float)
        if numbers.shape != _SHAPES.get(name, ()):
            raise ValueError
        values[name] = tuple(numbers.tolist()) if numbers.shape else float(numbers)
    for name in ("covariance", "now_covariance"):
        if name in values and min(values[name][0], values[name][2]) < 0:
            del values[name]
    return Found(**values)


def _track(said: tuple[Any, ...]) -> Track:
    """Return a track, empty if it is none."""
    try:
        numbers = np.array(said, float).reshape(len(said), 3)
    except (TypeError, ValueError):
        return ()
    if not np.isfinite(numbers).all():
        return ()
    return tuple((time_s, north, east) for time_s, north, east in numbers.tolist())


def _shown(thing: Any) -> str:
    """Return the repr of a value, shortened."""
    if inspect.iscoroutine(thing):
        thing.close()  # otherwise Python warns later that it was never awaited
        return "a coroutine (write def, not async def)"
    return shown(thing)


def _where(error: BaseException) -> str:
    """Return the last line that was run in the file of the strategy."""
    frames = traceback.extract_tb(error.__traceback__)
    file = next((frame.filename for frame in frames if frame.filename != __file__), "")
    lines = [frame.lineno for frame in frames if frame.filename == file]
    return f" ({Path(file).name}:{lines[-1]})" if lines else ""
