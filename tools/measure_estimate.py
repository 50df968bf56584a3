"""Measures the processor time of each answer of `estimate`, as its own process gives them.

    python tools/measure_estimate.py [--seeds 3] [--victims 1 2 4 8]

Flies closed loops with a stepped clock: random victims, a receiver of pulses; then one victim with a GPS that walks by
1.5 m. A row for each: answers, their median, 99 % and worst time, and the worst that the steering loop itself needs for
a frame or a set-point.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Sequence
from typing import Any

from arva_hil.campaign.plan import draw
from arva_hil.campaign.trial import Trial, fly
from arva_hil.config.drawn import Random
from arva_hil.search.mission import mission
from arva_hil.search.strategies.analysis import Analysis, AnalysisResult, Order
from arva_hil.search.strategies.strategy import Strategy

answers: list[float] = []  # ms
loop: list[float] = []


class Timed:
    """A worker in the loop that answers as the process does."""

    def __init__(self, make: Callable[[], Strategy]) -> None:
        self._analysis = Analysis(make, at_once=False)
        self._answer: AnalysisResult | None = None

    def send(self, orders: Sequence[Order]) -> None:
        start = time.process_time()
        self._answer = self._analysis.answer(orders)
        answers.append((time.process_time() - start) * 1e3)

    def receive(self) -> AnalysisResult | None:
        return self._answer

    @property
    def starved_s(self) -> float:
        return 0.0


def loop_time(name: str) -> None:
    """Measure a method of the mission, without the answers in it."""
    method = getattr(mission.Mission, name)

    def timed(*given: Any, **options: Any) -> Any:
        before, start = len(answers), time.process_time()
        result = method(*given, **options)
        loop.append((time.process_time() - start) * 1e3 - sum(answers[before:]))
        return result

    setattr(mission.Mission, name, timed)


def row(label: str, victims: int, seeds: int, gps_noise_m: float) -> str:
    answers.clear()
    loop.clear()
    kind = Random(within_m=50, count=victims, model="pulsed", keying="modern")
    ends = []
    for seed in range(1, seeds + 1):
        trial = Trial("estimate", draw(kind, seed), victims=victims, gps_noise_m=gps_noise_m)
        ends.append(fly(trial).outcome)
    times = sorted(answers)
    median, late, worst = times[len(times) // 2], times[int(len(times) * 0.99)], times[-1]
    figures = f"{median:.1f} | {late:.0f} | {worst:.0f} | {max(loop):.1f}"
    return f"| {label} | {ends.count('found')} of {seeds} | {len(times)} | {figures} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=3, help="flights of each row")
    parser.add_argument("--victims", type=int, nargs="*", default=[1, 2, 4, 8])
    options = parser.parse_args()
    mission.Inline = Timed  # type: ignore[assignment, misc]
    loop_time("hear")
    loop_time("fly")
    print("| victims | found | answers | median, ms | 99 %, ms | worst, ms | loop, ms |")
    print("|---|---|---|---|---|---|---|")
    for victims in options.victims:
        print(row(str(victims), victims, options.seeds, 0.0), flush=True)
    print(row("1, GPS walks by 1.5 m", 1, options.seeds, 1.5), flush=True)


if __name__ == "__main__":
    main()
