"""Runs the emulator for hours with faults on, and checks that nothing drifts, grows or gets lost.

    python -m tools soak run [--hours 4]      # of emulated time, as fast as it goes
    python -m tools soak can [--hours 0.17]   # in real time, without faults, through DroneCAN on a virtual bus

The built-in vehicle flies circles, the emulator follows and records, a consumer reads the frames. On the bus, a
frame's lateness is the time from its deadline to its bytes at the far end of DroneCAN's serial tunnel: its 99th
percentile must not be above 5 ms. The exit code is 1 after a failure.
"""

from __future__ import annotations

import argparse
import csv
import gc
import json
import math
import sys
import tempfile
import time
from collections import Counter, deque
from collections.abc import Sequence
from contextlib import ExitStack, closing
from dataclasses import replace
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from arva_hil.autopilot.following.session import Session
from arva_hil.cli.summary import counters
from arva_hil.clock import Clock, RealClock, StepClock
from arva_hil.config import DEFAULT, Scenario, load
from arva_hil.emulator.engine import Emulator
from arva_hil.emulator.setup import one_vehicle
from arva_hil.events import Event, FrameMade
from arva_hil.links import Link, memory, open_link
from arva_hil.mavlink.codec import Encoder, dialect
from arva_hil.records.writing import Recorder
from arva_hil.registry import FORMATS
from arva_hil.runtime.audience import Audience
from arva_hil.runtime.drivers import Live
from arva_hil.runtime.loop import Task, run
from arva_hil.simulated import HOME
from arva_hil.simulated.autopilot import Mode
from arva_hil.simulated.vehicle import SimulatedVehicle, Simulator
from tools.options import memory_mb, parser

ROOT = Path(__file__).parents[2]
NEWEST = 600  # frames whose times are kept: memory must not grow
BUS = "virtual:tunnel"
P99_MS = 5.0
HEIGHT_M = 2.0
SPEED_M_S = 2.0
RADIUS_M = 20.0
CLIMB_S = 5.0


def main() -> None:
    can = sys.argv[0].endswith("can")
    options = parser(
        __doc__,
        scenario=(ROOT / "configs" / "faults.yaml", "file"),
        hours=(1 / 6 if can else 4.0, "of emulated time"),
        rate=(50.0, "frames a second on the bus"),
        record=(Path, "keep the record in this folder"),
    ).parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = options.record or Path(temporary, "record")
        sys.exit(0 if (on_the_bus if can else long_run)(options, folder) else 1)


def long_run(options: argparse.Namespace, folder: Path) -> bool:
    """Fly with faults in stepped time, then check. Return True if all is well."""
    return soaked(load(options.scenario), StepClock(), memory.pair(), options.hours, folder)


def on_the_bus(options: argparse.Namespace, folder: Path) -> bool:
    """Fly in real time, with frames through DroneCAN, then check."""
    clock = RealClock()
    scenario = replace(DEFAULT, receiver=replace(DEFAULT.receiver, rate_hz=options.rate))
    with ExitStack() as stack:
        port, far = (
            stack.enter_context(closing(open_link(f"can:SERIAL0,{ids},bus={BUS}", clock=clock)))
            for ids in ("node=42", "node=10,to=42")
        )
        return soaked(scenario, clock, (port, far), options.hours, folder)


def soaked(
    scenario: Scenario, clock: StepClock | RealClock, ports: tuple[Link, Link], hours: float, folder: Path
) -> bool:
    """Fly, then check. `ports`: the emulator's end, the consumer's end."""
    port, reader = ports
    (autopilot, far), wall = memory.pair(), RealClock()
    late = isinstance(clock, RealClock)  # in stepped time nothing is
    recorder, watch = Recorder(folder, 0, patient=True), Watch(None if late else NEWEST)
    start = clock.now()
    vehicle = SimulatedVehicle(HOME, boot_time=start)
    emulator = Emulator([one_vehicle(scenario, Session())], start=start, tell_packets=True)
    live = Live(emulator, {"autopilot": autopilot}, {"port": port}, Audience([recorder, watch]))
    consumer = Consumer(reader, scenario.output_format, None if late else NEWEST)
    gc.freeze()  # as the commands do
    tasks: list[Task] = [Simulator([vehicle], [far]), Pilot(vehicle, start), live, consumer]
    run(tasks, clock, until=start + hours * 3600)
    run([consumer], clock, until=clock.now() + 0.5)  # what is still on its way
    took = wall.now()
    counts = counters(emulator)
    recorder.close({"scenario": scenario.source, "counters": counts})
    checks = [check_time(watch, scenario.receiver.rate_hz, took), *check_counts(counts, consumer, folder, watch)]
    if late:
        checks.append(check_lateness(watch, consumer))
    return all(checks)


class Pilot:
    """A pilot that flies circles."""

    links: Sequence[Link] = ()

    def __init__(self, vehicle: SimulatedVehicle, start: float) -> None:
        self._vehicle = vehicle
        self._say = Encoder(255, 190)
        self._next = start + CLIMB_S
        vehicle.poll(start)
        vehicle._pilot.set_mode(Mode.GUIDED)
        vehicle._pilot.arm()
        vehicle._pilot.take_off(HEIGHT_M)

    def service(self, clock: Clock) -> float:
        if (now := clock.now()) >= self._next:
            self._next = now + 0.5
            turned = now * SPEED_M_S / RADIUS_M
            north, east = SPEED_M_S * math.cos(turned), SPEED_M_S * math.sin(turned)
            move = dialect.MAVLink_set_position_target_local_ned_message(
                0, 1, 1, 1, 0b110111000111, 0, 0, 0, north, east, 0, 0, 0, 0, 0, 0
            )
            self._vehicle.feed(self._say.pack(move), now)
        return self._next


class Consumer:
    """A driver: it reads the port and counts."""

    def __init__(self, link: Link, format: str, keep: int | None) -> None:
        self.links: Sequence[Link] = [link]
        self.decoder = FORMATS[format].decoder()
        self.bytes = 0
        self.came_s: deque[float] = deque(maxlen=keep)

    def service(self, clock: Clock) -> float:
        now = clock.now()
        chunk = self.links[0].read()
        self.bytes += len(chunk)
        self.came_s.extend([now] * len(self.decoder.feed(chunk, now)))
        return now + 0.1


class Watch:
    """Remembers the last frame, the faults met, times of the newest `keep` frames, and the memory each minute."""

    def __init__(self, keep: int | None) -> None:
        self.last: FrameMade | None = None
        self.due_s: deque[float] = deque(maxlen=keep)
        self.late_s: deque[float] = deque(maxlen=keep)
        self.met: Counter[str] = Counter()
        self.memory_mb: list[float] = []
        self._keep = keep

    def observe(self, event: Event) -> None:
        if isinstance(event, FrameMade):
            self.last = event
            self.due_s.append(event.time_s - event.late_s)
            self.late_s.append(event.late_s)
            self.met.update(event.faults)
            if self._keep and event.instant_s >= 60 * (len(self.memory_mb) + 1):
                self.memory_mb.append(memory_mb())


def check_time(watch: Watch, rate_hz: float, took_s: float) -> bool:
    """Check that the last deadline is exact, and that memory has not grown."""
    assert watch.last is not None
    last, memory_mb = watch.last, watch.memory_mb
    drift_s = last.instant_s - last.number / rate_hz
    late_ms = 1e3 * median(watch.late_s)
    print(
        f"{last.instant_s:.0f} s in {took_s:.0f} s of real time: {last.instant_s / took_s:.1f} ×; "
        f"{time.process_time():.0f} s of processor time\n"
        f"the last frame, number {last.number}: deadline {1e3 * drift_s:+.6f} ms from number / rate; "
        f"the last {len(watch.late_s)} frames were {late_ms:.3f} ms late in the median"
    )
    growth_mb = max(memory_mb, default=0.0) - memory_mb[0] if memory_mb else math.nan
    if memory_mb:
        print(
            f"memory: {memory_mb[0]:.2f} MB after the first minute, {memory_mb[len(memory_mb) // 2]:.2f} MB half-way, "
            f"{memory_mb[-1]:.2f} MB at the end, at most {growth_mb:+.2f} MB more"
        )
    return abs(drift_s) < 1e-3 and not growth_mb >= 1.0


def check_lateness(watch: Watch, consumer: Consumer) -> bool:
    """Check that the newest frames came soon to the far end."""
    for name, late_s in (
        ("made", np.array(watch.late_s)),
        ("at the far end", np.array(consumer.came_s) - np.array(watch.due_s)),
    ):
        p50, p99, most = 1e3 * np.percentile(late_s, [50, 99, 100])
        print(f"late {name}: median {p50:.2f} ms, p99 {p99:.2f} ms, at most {most:.2f} ms")
    return bool(p99 <= P99_MS)


def check_counts(counts: dict[str, Any], consumer: Consumer, folder: Path, watch: Watch) -> list[bool]:
    """Check that every frame is accounted for, and that all counters agree."""
    print(json.dumps(counts))
    c = {name: value for name, value in counts.items() if isinstance(value, int)}
    made = c["frames"] + c["duplicated"]
    gone = sum(c[name] for name in ("delivered", "damaged", "withheld", "dropped", "waiting"))
    decoder = consumer.decoder
    print(f"{made} frames and copies, {gone} accounted for; skipped {c['skipped']}")
    print(
        f"the consumer read {decoder.good} frames ({c['delivered']} were delivered whole), {decoder.bad_crc} bad "
        f"checksums, {decoder.dropped} bytes dropped, {decoder.lost} lost by the sequence"
    )
    met: Counter[str] = Counter()
    rows = 0
    with (folder / "readings.csv").open(newline="") as file:
        for row in csv.DictReader(file):
            if row["slot"] == "1":
                rows += 1
                met.update(filter(None, row["faults"].split("+")))
    size = (folder / "frames.bin").stat().st_size
    counted = {name: count["frames"] for name, count in counts["faults"].items() if count["frames"]}
    print(f"readings.csv: {rows} frames, faults marked {sum(met.values())} times; frames.bin: {size} bytes")
    return [
        made == gone,
        decoder.good == c["delivered"],
        rows == c["frames"],
        size == consumer.bytes,
        met == watch.met == counted,
    ]
