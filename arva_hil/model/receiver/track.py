"""The rhythm of one transmitter, and the mark of the host.

A slot opens after two pulses in rhythm. After that a pulse counts if it is within 3 ms of the rhythm, and within 10 Hz
of the carrier. If pulses between those two were missed, the rhythm is too slow: the first pulse in between corrects it.
Without pulses the slot becomes blank, then it is dropped; later its mark is lost.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, NamedTuple

from arva_hil.model.receiver.separation import SeparatedPulse, Vector

_GATE_S: Final = 3e-3
_GATE_HZ: Final = 10.0
_PERIODS_S: Final = (0.4, 2.0)  # of two pulses in rhythm
_SMOOTHING: Final = 0.5  # of the period
_HOLD, _DROP, _FORGET = 1.5, 5.5, 8.5  # assumed: periods without a pulse until a slot is blank, dropped, unmarked


@dataclass(frozen=True, slots=True)
class Shown:
    """The values of one pulse: those of the display, and the signed signal of the antennas [nA/m]."""

    zone: int
    d_cm: int
    delta_deg: int
    signal_na_m: Vector


class Mark(NamedTuple):
    """A marked transmitter that was lost."""

    period_s: float
    carrier_hz: float


class PulseTrack:
    """Remembers one transmitter's last pulse, its rhythm and values, and whether it is marked.

    `shown`: the values of the last pulse in rhythm, None while there is no slot. `heard_s`: the end of that pulse.
    `touched`: the newest pulse was disturbed by another transmitter's. `lost`: the lost marks of all.
    """

    def __init__(self, lost: list[Mark]) -> None:
        self.shown: Shown | None = None
        self.heard_s = -math.inf
        self.period_s = 1.0
        self.carrier_hz = math.nan
        self.marked = False
        self.touched = False
        self._lost = lost
        self._start_s = -math.inf  # of the last pulse in rhythm, or of a first one

    def hear(self, event: SeparatedPulse, end_s: float, shown: Shown) -> bool:
        """Use a pulse above the threshold. Return True if it is in rhythm. `end_s`: its end."""
        self.touched = event.touched
        self.pass_time(end_s)
        if self.shown is None:
            return self._open(event, end_s, shown)
        if abs(event.carrier_hz - self.carrier_hz) > _GATE_HZ:
            return False
        gap_s = event.start_s - self._start_s
        periods = max(1, round(gap_s / self.period_s))
        late = gap_s - periods * self.period_s
        if abs(late) <= _GATE_S:
            self.period_s += _SMOOTHING * late / periods
        elif self._divides(gap_s):
            self.period_s = gap_s
            self._regain_mark()
        else:
            return False
        self._take(event, end_s, shown)
        return True

    def miss(self, end_s: float, touched: bool) -> None:
        """Handle a pulse that was not received."""
        self.touched = touched
        self.pass_time(end_s)

    def pass_time(self, time_s: float) -> None:
        """Drop the slot, and lose the mark, after too many missed pulses."""
        if time_s < self.drops_s:
            return
        self.shown = None
        if time_s >= self.heard_s + _FORGET * self.period_s:
            self.lose_mark()

    def lose_mark(self) -> None:
        """Allow another transmitter to get the mark from now on."""
        if self.marked:
            self.marked = False
            self._lost.append(Mark(self.period_s, self.carrier_hz))

    @property
    def blank_s(self) -> float:
        """The time from which the slot is blank."""
        return self.heard_s + _HOLD * self.period_s

    @property
    def drops_s(self) -> float:
        """The time from which there is no slot."""
        return self.heard_s + _DROP * self.period_s

    def _open(self, event: SeparatedPulse, end_s: float, shown: Shown) -> bool:
        """Open a slot with the second pulse of a rhythm; otherwise the pulse may be the first one."""
        period_s = event.start_s - self._start_s
        if not _PERIODS_S[0] <= period_s <= _PERIODS_S[1]:
            self._start_s = event.start_s
            return False
        self.period_s, self.carrier_hz = period_s, event.carrier_hz
        self._regain_mark()
        self._take(event, end_s, shown)
        return True

    def _divides(self, gap_s: float) -> bool:
        """Return True if the period is a multiple of this time: a half or a third of it."""
        parts = round(self.period_s / gap_s)
        return parts > 1 and gap_s >= _PERIODS_S[0] and abs(gap_s - self.period_s / parts) <= _GATE_S

    def _regain_mark(self) -> None:
        """Take over a lost mark of the same rhythm and carrier."""
        for mark in self._lost if not self.marked else ():
            near_hz = abs(mark.carrier_hz - self.carrier_hz) <= _GATE_HZ
            if near_hz and abs(mark.period_s - self.period_s) <= _GATE_S:
                self._lost.remove(mark)
                self.marked = True
                return

    def _take(self, event: SeparatedPulse, end_s: float, shown: Shown) -> None:
        self.shown, self.heard_s, self._start_s = shown, end_s, event.start_s
