"""The pulses of several transmitters in the order of their ends, each with the overlapping pulses of others."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple

from arva_hil.model.field.keying import Keying, pulses_of

_STRETCH_PULSES: Final = 64  # calculated at a time, about


class Pulse(NamedTuple):
    """One pulse: seconds from the start of the run. `sender`: the index of its transmitter."""

    sender: int
    start_s: float
    end_s: float
    amplitude: float  # relative to a full battery


class SentPulse(NamedTuple):
    """A pulse, and the pulses of other transmitters at the same time."""

    pulse: Pulse
    touching: tuple[Pulse, ...]


class PulseTimeline:
    """The pulses of transmitters with these `keyings`.

    It keeps the pulses of a short stretch of time, so that no call takes long. Calls go forward in time:
    `next_end` and `take` never return a pulse that ended before one already taken.
    """

    def __init__(self, keyings: Sequence[Keying], start_s: float) -> None:
        self._keyings = keyings
        rate = sum(1 / keying.period_s for keying in keyings)
        self._stretch_s = max(2 * max((k.period_s for k in keyings), default=1.0), _STRETCH_PULSES / max(rate, 1e-3))
        self._margin_s = max((keying.pulse_s for keying in keyings), default=0.0)
        self._waiting: list[SentPulse] = []  # the next one last
        self._from_s = start_s  # of the next stretch

    def next_end(self, after_s: float, until_s: float) -> float:
        """Return the end of the first pulse that ends after `after_s`; at most `until_s`."""
        while self._waiting and self._waiting[-1].pulse.end_s <= after_s:
            self._waiting.pop()
        while not self._waiting and self._from_s < until_s:
            self._from_s = max(self._from_s, after_s)
            self._fill()
        return min(self._waiting[-1].pulse.end_s, until_s) if self._waiting else until_s

    def take(self, until_s: float) -> Iterator[SentPulse]:
        """Yield the pulses that end until `until_s` and that `next_end` has not skipped, in their order."""
        while self._waiting and self._waiting[-1].pulse.end_s <= until_s:
            yield self._waiting.pop()

    def _fill(self) -> None:
        """Change to the next stretch."""
        t0, t1 = self._from_s - 2 * self._margin_s, self._from_s + self._stretch_s + self._margin_s
        senders, (_, *columns) = pulses_of(self._keyings, t0, t1)
        made = (Pulse(*row) for row in zip(*(one.tolist() for one in (senders, *columns)), strict=True))
        until_s = self._from_s + self._stretch_s
        every = sorted(made, key=lambda pulse: pulse.start_s)
        sent = [
            SentPulse(pulse, tuple(others))
            for pulse, others in zip(every, _touching(every), strict=True)
            if self._from_s < pulse.end_s <= until_s
        ]
        sent.sort(key=lambda one: one.pulse.end_s, reverse=True)
        self._waiting = sent
        self._from_s = until_s


def _touching(every: Sequence[Pulse]) -> list[list[Pulse]]:
    """Return for each pulse the pulses of other transmitters at the same time. `every`: sorted by their starts."""
    touching: list[list[Pulse]] = [[] for _ in every]
    for n, pulse in enumerate(every):
        for m in range(n + 1, len(every)):
            other = every[m]
            if other.start_s >= pulse.end_s:
                break
            if other.sender != pulse.sender:
                touching[n].append(other)
                touching[m].append(pulse)
    return touching
