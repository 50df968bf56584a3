"""Prints the figures of docs/measurements.md: start-up, replay, schedule, pose.

    python tools/measure.py FLIGHT.tlog [...] [--seconds 60]

Each flight is replayed as fast as possible on one core, and flown live over pseudo-terminals: a process of its own
plays its motion as an autopilot would, at 50 Hz, and what the emulator made of it is compared with that motion.
"""

from __future__ import annotations

import argparse
import gc
import os
import subprocess
import sys
import tempfile
import time
from contextlib import closing
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from arva_hil.autopilot.following.session import Session
from arva_hil.clock import RealClock
from arva_hil.config import parse
from arva_hil.emulator.engine import Emulator
from arva_hil.emulator.setup import one_vehicle
from arva_hil.events import FrameMade
from arva_hil.links import Link, open_link
from arva_hil.links.pty import PtyLink
from arva_hil.links.tlog import TlogReader
from arva_hil.runtime.audience import Audience
from arva_hil.runtime.drivers import Live
from arva_hil.runtime.loop import run
from firmware_proto import Decoder
from tools.bench.alone import Samples
from tools.bench.flight import POSES_HZ, Motion, bare, origin, playing
from tools.bench.timing import COMMAND, wall_of_command

FRAMES_HZ = 50.0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("flights", nargs="+", type=Path, metavar="FLIGHT.tlog")
    parser.add_argument("--seconds", type=float, default=60.0, help="of live flight each; default 60")
    options = parser.parse_args()
    help_s = median(wall_of_command([*COMMAND, "--help"]) for _ in range(9))
    print(f"arva-hil --help: {1e3 * help_s:.0f} ms (median of 9)")
    for flight in options.flights:
        measure_replay(flight)
    measure_machine(min(options.seconds, 20))
    for flight in options.flights:
        motion = Motion(flight)
        measure_first_frame(motion)
        measure_live(motion, min(options.seconds, motion.seconds - 10))


def measure_replay(flight: Path) -> None:
    """Ratio to real time on one core, and the memory of a log four times as long."""
    with tempfile.TemporaryDirectory() as folder, closing(TlogReader(flight)) as log:
        for _ in log:
            pass
        assert log.first_us is not None
        assert log.last_us is not None
        seconds = (log.last_us - log.first_us) / 1e6
        os.sched_setaffinity(0, {0})
        runs = [wall_of_command([*COMMAND, "replay", str(flight), "--record", f"{folder}/{n}"]) for n in range(5)]
        os.sched_setaffinity(0, range(os.cpu_count() or 1))
        long = Path(folder, "long.tlog")
        lengthen(flight, long, 4)
        peaks = [peak_memory([*COMMAND, "replay", str(log), "--out", os.devnull]) for log in (flight, long)]
    print(
        f"{flight.name}: {seconds:.1f} s replayed and recorded in {median(runs):.2f} s (median of 5, one core, "
        f"start-up included): {seconds / median(runs):.0f} × real time; peak memory {peaks[0]:.1f} MB, "
        f"of the same four times over {peaks[1]:.1f} MB"
    )


def lengthen(flight: Path, to: Path, times: int) -> None:
    """The flight again and again, the vehicle rebooted in between."""
    with to.open("wb") as out:
        shift = 0
        for _ in range(times):
            with closing(TlogReader(flight)) as log:
                for record in log:
                    out.write((record.time_us + shift).to_bytes(8, "big") + record.raw)
                assert log.first_us is not None
                assert log.last_us is not None
                shift += log.last_us - log.first_us + 1_000_000


def peak_memory(command: list[str]) -> float:
    """MB, of a process of its own."""
    code = (
        "import resource, subprocess, sys; subprocess.run(sys.argv[1:], check=True, capture_output=True); "
        "print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)"
    )
    done = subprocess.run([sys.executable, "-c", code, *command], check=True, capture_output=True, text=True)
    return int(done.stdout) / 1024


def measure_machine(seconds: float) -> None:
    """How late this machine wakes a program that does nothing else: the floor under what follows."""
    late = bare(FRAMES_HZ, seconds)
    print(
        f"this machine wakes a bare loop at {FRAMES_HZ:g} Hz: median {median(late):.2f} ms late, "
        f"p99 {np.percentile(late, 99):.2f} ms, worst {max(late):.2f} ms"
    )


def measure_live(motion: Motion, seconds: float) -> None:
    """Lateness of the schedule; the pose against the truth, at its own stamp and at the moment it is for."""
    scenario = parse(f"transmitters: [{{id: 1, ned: [20, 5, 0]}}]\nreceiver: {{rate_hz: {FRAMES_HZ}}}", "measure")
    clock, samples = RealClock(), Samples()
    with playing(motion, seconds + 5) as (device, played), closing(PtyLink()) as port:
        began = played - origin(clock)
        start = clock.now()
        with closing(open_link(device, clock=clock)) as link, closing(Drained(port)) as out:
            emulator = Emulator([one_vehicle(scenario, Session())], start=start)
            live = Live(emulator, {"autopilot": link}, {"port": out}, Audience([samples]))
            gc.freeze()  # as the commands do
            run([live], clock, until=start + seconds)
    late = 1e3 * np.array([s.late_s for s in samples.frames])
    posed = [s for s in samples.frames if s.pose is not None and s.instant_s > 2.0]
    stamped = np.array([error(s, motion, s.boot_s or 0.0) for s in posed])
    lived = np.array([error(s, motion, s.instant_s + start - began) for s in posed])
    early = max((s.boot_s or 0.0) - (s.instant_s + start - began) for s in posed)
    age = 1e3 * np.array([s.age_s for s in posed])
    print(
        f"{motion.name} live, {seconds:.0f} s, poses {POSES_HZ:g} Hz, frames {FRAMES_HZ:g} Hz over ptys: "
        f"{len(late)} frames\n"
        f"  lateness of the schedule: median {median(late):.2f} ms, p99 {np.percentile(late, 99):.2f} ms, "
        f"worst {late.max():.2f} ms\n"
        f"  pose age: median {median(age):.0f} ms, worst {age.max():.0f} ms; "
        f"newest instant asked for: {1e3 * early:+.2f} ms from the vehicle's own\n"
        f"  pose against the truth at its stamp: {spread(stamped)}\n"
        f"  pose against the truth at the frame's moment: {spread(lived)}"
    )


class Drained(Link):
    """A port with a consumer at its other end that reads everything."""

    def __init__(self, port: PtyLink) -> None:
        self.name = port.name
        self._port = port
        self._consumer = open_link(port.path, clock=RealClock())

    def read(self) -> bytes:
        return b""

    def write(self, data: bytes) -> bool:
        self._consumer.read()
        return self._port.write(data)

    def close(self) -> None:
        self._consumer.close()


def error(made: FrameMade, motion: Motion, t: float) -> tuple[float, float]:
    """Metres and degrees between a frame's pose and the truth at `t`."""
    assert made.pose is not None
    position, attitude = motion.at(t)
    turn = Rotation.from_matrix(made.pose.rotation).inv() * attitude
    return float(np.linalg.norm(made.pose.position - position)), float(np.degrees(turn.magnitude()))


def spread(errors: Any) -> str:
    metres, degrees = errors.T
    return (
        f"{100 * np.percentile(metres, 99):.1f} cm and {np.percentile(degrees, 99):.2f}° (p99), "
        f"{100 * metres.max():.1f} cm and {degrees.max():.2f}° (worst)"
    )


def measure_first_frame(motion: Motion) -> None:
    """From starting the command, the stream already flowing, to its first frame, and to the first that hears."""
    first, hearing = [], []
    for _ in range(5):
        with playing(motion, 20.0) as (device, _):
            start = time.perf_counter()
            command = [*COMMAND, "run", "--autopilot", device, "--port", "-", "--rate", "50"]
            with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, bufsize=0) as child:
                assert child.stdout is not None
                decoder = Decoder()
                frames = decoder.feed(child.stdout.read(4096), 0.0)
                first.append(time.perf_counter() - start)
                while not any(frame.channels[0].valid for frame in frames):
                    frames = decoder.feed(child.stdout.read(4096), 0.0)
                hearing.append(time.perf_counter() - start)
                child.terminate()
    print(
        f"arva-hil run, the stream already flowing: first frame after {median(first):.2f} s, "
        f"first that hears after {median(hearing):.2f} s (medians of 5)"
    )


if __name__ == "__main__":
    main()
