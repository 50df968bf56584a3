"""Runs the emulator for hours with faults on, and checks that nothing drifts, grows or gets lost.

    python -m tools soak run [--hours 4]      # of emulated time, as fast as it goes

The built-in vehicle flies a square, the emulator follows and records, a consumer reads the frames. The exit code is 1
after a failure.
"""

from __future__ import annotations

import argparse
import csv
import gc
import json
import math
import os
import sys
import tempfile
import time
from collections import Counter, deque
from collections.abc import Sequence
from pathlib import Path
from statistics import median
from typing import Any

from arva_hil.autopilot.following.session import Session
from arva_hil.cli.summary import counters
from arva_hil.clock import Clock, RealClock, StepClock
from arva_hil.config import load
from arva_hil.emulator.engine import Emulator
from arva_hil.emulator.setup import one_vehicle
from arva_hil.events import Event, FrameMade
from arva_hil.links import Link, memory
from arva_hil.mavlink.codec import Encoder, command, dialect
from arva_hil.records.writing import Recorder
from arva_hil.registry import FORMATS
from arva_hil.runtime.audience import Audience
from arva_hil.runtime.drivers import Live
from arva_hil.runtime.loop import Task, run
from arva_hil.simulated import HOME
from arva_hil.simulated.vehicle import SimulatedVehicle, Simulator
from tools.options import parser

ROOT = Path(__file__).parents[2]
HEIGHT_M = 2.0
SPEED_M_S = 2.0
SQUARE = ((30.0, 20.0), (30.0, -20.0), (-10.0, -20.0), (-10.0, 20.0))
GUIDED = 4


def main() -> None:
    options = parser(
        __doc__,
        scenario=(ROOT / "configs" / "faults.yaml", "file"),
        hours=(4.0, "of emulated time"),
        record=(Path, "keep the record in this folder"),
    ).parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        sys.exit(0 if long_run(options, options.record or Path(temporary, "record")) else 1)


def long_run(options: argparse.Namespace, folder: Path) -> bool:
    """Fly, then check. Return True if all is well."""
    scenario = load(options.scenario)
    clock, wall = StepClock(), RealClock()
    (autopilot, far), (port, reader) = memory.pair(), memory.pair()
    recorder, watch = Recorder(folder, 0, patient=True), Watch()
    start = clock.now()
    vehicle = SimulatedVehicle(HOME, boot_time=start)
    emulator = Emulator([one_vehicle(scenario, Session())], start=start, tell_packets=True)
    live = Live(emulator, {"autopilot": autopilot}, {"port": port}, Audience([recorder, watch]))
    consumer = Consumer(reader, scenario.output_format)
    gc.freeze()  # as the commands do
    tasks: list[Task] = [Simulator([vehicle], [far]), Pilot(vehicle), live, consumer]
    run(tasks, clock, until=start + options.hours * 3600)
    run([consumer], clock, until=clock.now() + 0.5)  # what is still on its way
    took = wall.now()
    counts = counters(emulator)
    recorder.close({"scenario": os.fspath(options.scenario), "counters": counts})
    return all([check_time(watch, scenario.receiver.rate_hz, took), *check_counts(counts, consumer, folder, watch)])


class Pilot:
    """A pilot that takes off and flies squares."""

    links: Sequence[Link] = ()

    def __init__(self, vehicle: SimulatedVehicle) -> None:
        self._vehicle = vehicle
        self._say = Encoder(255, 190)
        self._next = 0.0
        self._corner = 0

    def service(self, clock: Clock) -> float:
        if (now := clock.now()) >= self._next:
            self._next = now + 0.5
            self._steer(now)
        return self._next

    def _steer(self, now: float) -> None:
        north, east, down = self._vehicle.truth(now).ned
        if down > -0.8 * HEIGHT_M:
            self._command(now, dialect.MAV_CMD_DO_SET_MODE, dialect.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED, GUIDED)
            self._command(now, dialect.MAV_CMD_COMPONENT_ARM_DISARM, 1)
            self._command(now, dialect.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, HEIGHT_M)
            return
        to_north, to_east = SQUARE[self._corner][0] - north, SQUARE[self._corner][1] - east
        away = math.hypot(to_north, to_east)
        if away < 1.0:
            self._corner = (self._corner + 1) % len(SQUARE)
        speed = min(SPEED_M_S / away, 1.0)
        move = dialect.MAVLink_set_position_target_local_ned_message(
            0, 1, 1, 1, 0b110111000111, 0, 0, 0, speed * to_north, speed * to_east, 0, 0, 0, 0, 0, 0
        )
        self._vehicle.feed(self._say.pack(move), now)

    def _command(self, now: float, number: int, *params: float) -> None:
        self._vehicle.feed(self._say.pack(command(1, 1, number, *params)), now)


class Consumer:
    """A driver: it reads the port and counts."""

    def __init__(self, link: Link, format: str) -> None:
        self.links: Sequence[Link] = [link]
        self.decoder = FORMATS[format].decoder()
        self.bytes = 0

    def service(self, clock: Clock) -> float:
        now = clock.now()
        chunk = self.links[0].read()
        self.bytes += len(chunk)
        self.decoder.feed(chunk, now)
        return now + 0.1


class Watch:
    """Remembers the last frame, the lateness of frames, the number with a fault, and the memory each minute."""

    def __init__(self) -> None:
        self.last: FrameMade | None = None
        self.late_s: deque[float] = deque(maxlen=600)
        self.met: Counter[str] = Counter()
        self.memory_mb: list[float] = []

    def observe(self, event: Event) -> None:
        if isinstance(event, FrameMade):
            self.last = event
            self.late_s.append(event.late_s)
            self.met.update(event.faults)
            if event.instant_s >= 60 * (len(self.memory_mb) + 1):
                pages = int(Path("/proc/self/statm").read_text().split()[1])
                self.memory_mb.append(pages * os.sysconf("SC_PAGE_SIZE") / 1e6)


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
