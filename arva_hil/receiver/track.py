"""The rhythm of one transmitter as a receiver follows it, and the marks of its host.

A slot opens after two pulses in step. From then on a pulse counts when it comes within 3 ms of the rhythm, on the same
carrier to 10 Hz. Missed pulses blank the slot, then drop it; a mark is lost later still.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, NamedTuple

from arva_hil.receiver.separation import Event, Vector

_GATE_S: Final = 3e-3
_GATE_HZ: Final = 10.0
_PERIODS_S: Final = (0.4, 2.0)  # in which two pulses are taken for a rhythm
_SMOOTHING: Final = 0.5  # of the period
_HOLD, _DROP, _FORGET = 1.5, 5.5, 8.5  # assumed: periods without a pulse until a slot is blank, dropped, unmarked


@dataclass(frozen=True, slots=True)
class Shown:
    """What one pulse gives: the display's values, and the signed signal of the antennas [nA/m]."""

    zone: int
    d_cm: int
    delta_deg: int
    signal_na_m: Vector


class Mark(NamedTuple):
    """What a receiver knows of a marked transmitter that it has lost."""

    period_s: float
    carrier_hz: float


class Track:
    """Remembers one transmitter's last pulse, its rhythm, what it gave, and whether it is marked.

    `shown`: of the last pulse in step, None while there is no slot. `heard_s`: the end of that pulse. `touched`: the
    newest pulse was disturbed by another transmitter's. `lost`: the marks of all transmitters that were lost.
    """

    def __init__(self, lost: list[Mark]) -> None:
        self.shown: Shown | None = None
        self.heard_s = -math.inf
        self.period_s = 1.0
        self.carrier_hz = math.nan
        self.marked = False
        self.touched = False
        self._lost = lost
        self._start_s = -math.inf  # of the last pulse in step, or of a first one

    def hear(self, event: Event, end_s: float, shown: Shown) -> bool:
        """A pulse above the threshold; whether it is in step. `end_s`: its end."""
        self.touched = event.touched
        self.pass_time(end_s)
        if self.shown is None:
            return self._open(event, end_s, shown)
        periods = max(1, round((event.start_s - self._start_s) / self.period_s))
        late = event.start_s - self._start_s - periods * self.period_s
        if abs(late) > _GATE_S or abs(event.carrier_hz - self.carrier_hz) > _GATE_HZ:
            return False
        self.period_s += _SMOOTHING * late / periods
        self._take(event, end_s, shown)
        return True

    def miss(self, end_s: float, touched: bool) -> None:
        """A pulse that was not heard."""
        self.touched = touched
        self.pass_time(end_s)

    def pass_time(self, time_s: float) -> None:
        """Drop the slot, and lose the mark, when too many pulses were missed."""
        if time_s < self.drops_s:
            return
        self.shown = None
        if time_s >= self.heard_s + _FORGET * self.period_s:
            self.lose_mark()

    def lose_mark(self) -> None:
        """From now on a transmitter that is heard anew may get the mark."""
        if self.marked:
            self.marked = False
            self._lost.append(Mark(self.period_s, self.carrier_hz))

    @property
    def blank_s(self) -> float:
        """From when on there is nothing to show."""
        return self.heard_s + _HOLD * self.period_s

    @property
    def drops_s(self) -> float:
        """From when on it has no slot."""
        return self.heard_s + _DROP * self.period_s

    def _open(self, event: Event, end_s: float, shown: Shown) -> bool:
        """The second pulse of a rhythm opens a slot; else it may be the first of one."""
        period_s = event.start_s - self._start_s
        if not _PERIODS_S[0] <= period_s <= _PERIODS_S[1]:
            self._start_s = event.start_s
            return False
        for mark in self._lost if not self.marked else ():
            if abs(mark.period_s - period_s) <= _GATE_S and abs(mark.carrier_hz - event.carrier_hz) <= _GATE_HZ:
                self._lost.remove(mark)
                self.marked = True
                break
        self.period_s, self.carrier_hz = period_s, event.carrier_hz
        self._take(event, end_s, shown)
        return True

    def _take(self, event: Event, end_s: float, shown: Shown) -> None:
        self.shown, self.heard_s, self._start_s = shown, end_s, event.start_s
