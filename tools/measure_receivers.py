"""Prints what the receivers of pulses cost, held against the paper's, and whether 16 transmitters keep up at 50 Hz.

    python tools/measure_receivers.py [--seconds 600] [--rounds 5] [--live 20]

CPU time of the model alone, and of the emulator with a built-in vehicle, all kinds by turns; medians are printed.
Live: frames at 50 Hz in real time to a link in memory, by turns; the worst lateness of each. Each promise is printed as
kept or MISSED.
"""

from __future__ import annotations

import argparse
import gc
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from statistics import median
from typing import Final

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parent.parent))

import numpy as np

from arva_hil.autopilot.following.session import Session
from arva_hil.clock import Clock, RealClock, StepClock
from arva_hil.config import ReceiverOptions, Scenario, Transmitter
from arva_hil.emulator.build import receiver, transmitters
from arva_hil.emulator.engine import Emulator
from arva_hil.emulator.setup import one_vehicle
from arva_hil.links import Link, memory
from arva_hil.model.field import LocalFrame
from arva_hil.model.receiver import Look, Pose
from arva_hil.runtime.audience import Audience
from arva_hil.runtime.drivers import Live
from arva_hil.runtime.loop import run
from arva_hil.simulated.simulator import Simulator
from arva_hil.simulated.vehicle import SimulatedVehicle

MODELS: Final = ("paper", "pulsed", "vector", "rssi")
HOME: Final = (46.0123, 7.7456, 1650.0)


def scenario(model: str, count: int, rate_hz: float) -> Scenario:
    around = np.random.default_rng(1).uniform(-30, 30, (count, 2)).tolist()
    options = {"frames": "rate"} if model != "paper" else None
    return Scenario(
        tuple(Transmitter(n + 1, ned=(north, east, 1.0)) for n, (north, east) in enumerate(around)),
        receiver=ReceiverOptions(channels=16, rate_hz=rate_hz, model=model, options=options),
    )


def frames(chosen: Scenario, seconds: float) -> Iterator[None]:
    """One after the other, hovering: the model's reading and all looks before it."""
    model, there = receiver(chosen), transmitters(chosen, LocalFrame(*HOME))
    pose, frame_s, looked_s = Pose(np.zeros(3), np.eye(3)), 0.0, -1e-9
    while frame_s < seconds:
        while looked_s < frame_s and (t := model.next_look(looked_s, frame_s)) <= frame_s:
            model.look(Look(t, pose, there))
            looked_s = t
        model.show(frame_s)
        yield
        frame_s += 1 / chosen.receiver.rate_hz


def of_model(chosen: Scenario, seconds: float) -> None:
    for _ in frames(chosen, seconds):
        pass


def of_emulator(chosen: Scenario, seconds: float, clock: Clock | None = None) -> float:
    """With the vehicle's streams at 10 Hz; the worst lateness of a frame [s]."""
    clock = clock or StepClock()
    autopilot, far = memory.pair()
    port, reader = memory.pair()
    start = clock.now()
    emulator = Emulator([one_vehicle(chosen, Session(rate_hz=10))], start=start)
    live = Live(emulator, {"autopilot": autopilot}, {"port": port}, Audience([]))

    class Reader:
        links: Sequence[Link] = ()

        def service(self, clock: Clock) -> float:
            reader.read()
            return clock.now() + 0.5

    run([Simulator([SimulatedVehicle(HOME, boot_time=start)], [far]), live, Reader()], clock, until=start + seconds)
    return emulator.vehicles[0].units[0].port.counters.latest_s


def cpu(work: Callable[[], object]) -> float:
    start = time.process_time()
    work()
    return time.process_time() - start


def longest_steps(chosen: Scenario, seconds: float) -> tuple[float, float]:
    """The CPU time [ms] of making one frame, all looks before it included: 999 of 1000 take less, and the longest."""
    gc.disable()
    times = [time.thread_time() for _ in frames(chosen, seconds)]
    gc.enable()
    most, longest = np.percentile(np.diff(times), [99.9, 100]).tolist()
    return 1e3 * most, 1e3 * longest


def by_turns(count: int, rate_hz: float, seconds: float, rounds: int, models: Sequence[str] = MODELS) -> None:
    chosen = {model: scenario(model, count, rate_hz) for model in models}
    for what, work in (("model alone", of_model), ("emulator", of_emulator)):
        costs: dict[str, list[float]] = {model: [] for model in models}
        for _ in range(rounds):
            for model in models:
                costs[model].append(cpu(lambda model=model, work=work: work(chosen[model], seconds)))  # type: ignore[misc]
        usual = median(costs["paper"])
        each = ", ".join(
            f"{model} {1e6 * median(costs[model]) / seconds:.0f} µs a second ({median(costs[model]) / usual:.2f} ×)"
            for model in models
        )
        print(f"{count} transmitters, frames at {rate_hz:g} Hz, {what}: {each}", flush=True)
        if count == 1:
            print(f"    {verdict(median(costs['pulsed']) <= 3 * usual)}: pulsed costs at most 3 × paper", flush=True)


def verdict(kept: bool) -> str:
    return "kept" if kept else "MISSED"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=600.0, help="of each run in stepped time; default 600")
    parser.add_argument("--rounds", type=int, default=5, help="of each kind; default 5")
    parser.add_argument(
        "--live", type=float, default=20.0, help="seconds in real time of each of six turns; default 20"
    )
    options = parser.parse_args()
    for count, rate_hz in [(1, 1.0), (1, 10.0), (1, 50.0), (16, 1.0), (16, 50.0)]:
        by_turns(count, rate_hz, options.seconds if rate_hz < 50 else options.seconds / 5, options.rounds)
    for model in ("paper", "pulsed"):
        most, longest = longest_steps(scenario(model, 16, 50.0), options.seconds)
        print(
            f"16 transmitters, one frame, {model}: {most:.2f} ms of CPU time, at the longest {longest:.2f} ms",
            flush=True,
        )
    latest_s = {"paper": 0.0, "pulsed": 0.0}
    for model in [*latest_s] * 3:
        late_s = of_emulator(scenario(model, 16, 50.0), options.live, RealClock())
        print(f"live, 16 transmitters, frames at 50 Hz, {model}: none later than {1e3 * late_s:.2f} ms", flush=True)
        latest_s[model] = max(latest_s[model], late_s)
    later_ms = 1e3 * (latest_s["pulsed"] - latest_s["paper"])
    print(f"    {verdict(later_ms <= 1)}: pulsed at most 1 ms later than paper; it was {later_ms:+.2f} ms")


if __name__ == "__main__":
    main()
