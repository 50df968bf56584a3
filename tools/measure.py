"""Prints the figures of docs/measurements.md: start-up, replay, schedule, pose.

    python tools/measure.py FLIGHT.tlog [...] [--seconds 60]

Each flight is replayed as fast as possible on one core, and flown live over pseudo-terminals: a process of its own
plays its motion as an autopilot would, at 50 Hz, and what the emulator made of it is compared with that motion.
"""

from __future__ import annotations

import argparse
import gc
import multiprocessing
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
from scipy.interpolate import CubicHermiteSpline
from scipy.spatial.transform import Rotation, RotationSpline

from arva_hil.config import parse
from arva_hil.emulator.emulated_vehicle import one_vehicle
from arva_hil.emulator.engine import Emulator
from arva_hil.events import Event, FrameMade
from arva_hil.field import LocalFrame
from arva_hil.links import Link, open_link
from arva_hil.links.pty import PtyLink
from arva_hil.links.tlog import TlogReader
from arva_hil.mavlink.codec import Encoder, Parser, dialect
from arva_hil.observers.audience import Audience
from arva_hil.runtime.clock import RealClock
from arva_hil.runtime.drivers import Live
from arva_hil.runtime.loop import run
from arva_hil.vehicle.session import Session
from firmware_proto import Decoder

COMMAND = [sys.executable, "-m", "arva_hil"]
AUTOPILOT = Encoder(1, 1)
ATTITUDE = dialect.MAVLINK_MSG_ID_ATTITUDE
GLOBAL_POSITION_INT = dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT
STREAM_HZ = 50.0
FRAMES_HZ = 50.0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("flights", nargs="+", type=Path, metavar="FLIGHT.tlog")
    parser.add_argument("--seconds", type=float, default=60.0, help="of live flight each; default 60")
    options = parser.parse_args()
    print(f"arva-hil --help: {1e3 * median(wall([*COMMAND, '--help']) for _ in range(9)):.0f} ms (median of 9)")
    for flight in options.flights:
        measure_replay(flight)
    measure_machine(min(options.seconds, 20))
    for flight in options.flights:
        motion = Motion(flight)
        measure_first_frame(motion)
        measure_live(motion, min(options.seconds, motion.seconds - 10))


def wall(command: list[str]) -> float:
    start = time.perf_counter()
    subprocess.run(command, check=True, capture_output=True)
    return time.perf_counter() - start


def measure_replay(flight: Path) -> None:
    """Ratio to real time on one core, and the memory of a log four times as long."""
    with tempfile.TemporaryDirectory() as folder, closing(TlogReader(flight)) as log:
        for _ in log:
            pass
        assert log.first_us is not None
        assert log.last_us is not None
        seconds = (log.last_us - log.first_us) / 1e6
        os.sched_setaffinity(0, {0})
        runs = [wall([*COMMAND, "replay", str(flight), "--record", f"{folder}/{n}"]) for n in range(5)]
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


class Motion:
    """The motion of a recorded flight, smooth between its samples: the truth that a live run is held against.

    Position: cubic Hermite through GLOBAL_POSITION_INT; attitude: a spline through ATTITUDE. By scipy.
    """

    def __init__(self, flight: Path) -> None:
        self.name = flight.name
        positions, attitudes = {}, {}
        parser = Parser()
        with closing(TlogReader(flight)) as log:
            for record in log:
                for packet in parser.feed(record.raw):
                    if packet.component == 1 and packet.msgid == GLOBAL_POSITION_INT:
                        m = parser.decode(packet)
                        here = (m.lat / 1e7, m.lon / 1e7, m.alt / 1e3, m.vx / 100, m.vy / 100, m.vz / 100)
                        positions[m.time_boot_ms / 1e3] = here
                    elif packet.component == 1 and packet.msgid == ATTITUDE:
                        m = parser.decode(packet)
                        attitudes[m.time_boot_ms / 1e3] = (m.yaw, m.pitch, m.roll)
        where = np.array(list(positions.values()))
        self.home = tuple(where[0, :3])
        ned = np.array([LocalFrame(*self.home).ned(*row[:3]) for row in where])
        start = max(min(positions), min(attitudes))
        self.seconds = min(max(positions), max(attitudes)) - start
        self._position = CubicHermiteSpline(np.array(list(positions)) - start, ned, where[:, 3:])
        self._attitude = RotationSpline(
            np.array(list(attitudes)) - start, Rotation.from_euler("ZYX", list(attitudes.values()))
        )
        self._frame = LocalFrame(*self.home)

    def at(self, t: float) -> tuple[Any, Rotation]:
        """NED position [m] from home, and the attitude, `t` seconds into the flight."""
        return self._position(t), self._attitude(t)

    def packets(self, t: float) -> bytes:
        """Position and attitude as an autopilot would send them; `t` in whole milliseconds."""
        ned, velocity = self._position(t), self._position(t, 1)
        lat, lon, alt = self._frame.lla(ned)
        yaw, pitch, roll = self._attitude(t).as_euler("ZYX")
        rates = self._attitude(t, 1)
        ms = round(t * 1e3)
        position = dialect.MAVLink_global_position_int_message(
            ms, round(lat * 1e7), round(lon * 1e7), round(alt * 1e3), 0, *(round(v * 100) for v in velocity), 0
        )
        attitude = dialect.MAVLink_attitude_message(ms, roll, pitch, yaw, *rates)
        return AUTOPILOT.pack(position) + AUTOPILOT.pack(attitude)

    def beat(self) -> bytes:
        """Heartbeat and home."""
        lat, lon, alt = self.home
        heartbeat = dialect.MAVLink_heartbeat_message(2, 3, 0x81, 4, 4, 3)
        home = dialect.MAVLink_home_position_message(
            round(lat * 1e7), round(lon * 1e7), round(alt * 1e3), 0, 0, 0, [1, 0, 0, 0], 0, 0, 0
        )
        return AUTOPILOT.pack(heartbeat) + AUTOPILOT.pack(home)


def play(motion: Motion, seconds: float, started: Any) -> None:
    """The far end, in its own process: the motion on a new pty, in real time. Tells the path, and when it began."""
    times = np.arange(0, seconds, 1 / STREAM_HZ).round(3)
    packets = [(motion.beat() if n % STREAM_HZ == 0 else b"") + motion.packets(t) for n, t in enumerate(times)]
    clock = RealClock()
    with closing(PtyLink()) as link:
        start = clock.now()
        started.put((link.path, start + origin(clock)))
        for t, data in zip(times, packets, strict=True):
            clock.wait(start + t)
            link.read()
            link.write(data)


def origin(clock: RealClock) -> float:
    """The monotonic time at which a clock read 0; looked at again until nothing came between the two looks."""
    while True:
        before, there, after = clock.now(), time.monotonic(), clock.now()
        if after - before < 1e-4:
            return there - before


@contextmanager
def playing(motion: Motion, seconds: float) -> Iterator[tuple[str, float]]:
    """The pty that the motion is played on, and the monotonic time at which it began."""
    started: Any = multiprocessing.Queue()
    player = multiprocessing.Process(target=play, args=(motion, seconds, started), daemon=True)
    player.start()
    yield started.get(timeout=60)
    player.terminate()
    player.join()


def bare(hz: float, seconds: float) -> list[float]:
    """How late a loop is that does nothing, ms."""
    clock, late = RealClock(), []
    for n in range(round(seconds * hz)):
        clock.wait(n / hz)
        late.append(1e3 * (clock.now() - n / hz))
    return late


def measure_machine(seconds: float) -> None:
    """How late this machine wakes a program that does nothing else: the floor under what follows."""
    late = bare(FRAMES_HZ, seconds)
    print(
        f"this machine wakes a bare loop at {FRAMES_HZ:g} Hz: median {median(late):.2f} ms late, "
        f"p99 {np.percentile(late, 99):.2f} ms, worst {max(late):.2f} ms"
    )


class Samples:
    """Keeps every frame."""

    def __init__(self) -> None:
        self.frames: list[FrameMade] = []

    def observe(self, event: Event) -> None:
        if isinstance(event, FrameMade):
            self.frames.append(event)


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
        f"{motion.name} live, {seconds:.0f} s, poses {STREAM_HZ:g} Hz, frames {FRAMES_HZ:g} Hz over ptys: "
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
