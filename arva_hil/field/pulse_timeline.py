"""The pulses of several transmitters in the order of their ends, each with those of others that it touches."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple

from arva_hil.field.keying import Keying

__all__ = ["Pulse", "PulseTimeline", "SentPulse"]

_CHUNK_PULSES: Final = 256  # made at a time, about


class Pulse(NamedTuple):
    """One pulse: seconds from the start of the run. `sender`: the index of its transmitter."""

    sender: int
    start_s: float
    end_s: float
    amplitude: float  # relative to a full battery


class SentPulse(NamedTuple):
    """A pulse, and the pulses of other transmitters that are on while it is on."""

    pulse: Pulse
    touching: tuple[Pulse, ...]


class PulseTimeline:
    """The pulses of transmitters, by `keyings` in their order. Remembers those of a stretch of time that is near.

    Asking goes forward: `next_end` and `take` never give a pulse that ended earlier than one already taken.
    """

    def __init__(self, keyings: Sequence[Keying], start_s: float) -> None:
        self._keyings = keyings
        rate = sum(1 / keying.period_s for keying in keyings)
        self._chunk_s = max(2 * max((k.period_s for k in keyings), default=1.0), _CHUNK_PULSES / max(rate, 1e-3))
        self._margin_s = max((keying.pulse_s for keying in keyings), default=0.0)
        self._until_s = start_s
        self._waiting: list[SentPulse] = []  # the next one last

    def next_end(self, after_s: float, until_s: float) -> float:
        """The end of the first pulse that ends after `after_s`; `until_s` if there is none before."""
        while self._waiting and self._waiting[-1].pulse.end_s <= after_s:
            self._waiting.pop()
        while not self._waiting and self._until_s < until_s:
            self._fill(max(self._until_s, after_s))
        return min(self._waiting[-1].pulse.end_s, until_s) if self._waiting else until_s

    def take(self, until_s: float) -> Iterator[SentPulse]:
        """The pulses that `next_end` has not passed over and that end until then, in time."""
        while self._waiting and self._waiting[-1].pulse.end_s <= until_s:
            yield self._waiting.pop()

    def _fill(self, from_s: float) -> None:
        """The pulses that end after `from_s`, for a while."""
        until_s = from_s + self._chunk_s
        every = sorted(self._pulses(from_s - 2 * self._margin_s, until_s + self._margin_s), key=lambda p: p.start_s)
        touching = _touching(every)
        sent = [
            SentPulse(pulse, tuple(others))
            for pulse, others in zip(every, touching, strict=True)
            if from_s < pulse.end_s <= until_s
        ]
        sent.sort(key=lambda one: one.pulse.end_s, reverse=True)
        self._waiting = sent
        self._until_s = until_s

    def _pulses(self, t0: float, t1: float) -> Iterator[Pulse]:
        for index, keying in enumerate(self._keyings):
            of = keying.pulses(t0, t1)
            for start, end, amplitude in zip(of.starts.tolist(), of.ends.tolist(), of.amplitudes.tolist(), strict=True):
                yield Pulse(index, start, end, amplitude)


def _touching(every: Sequence[Pulse]) -> list[list[Pulse]]:
    """For each pulse, which are sorted by their starts, those of other transmitters that are on at the same time."""
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
