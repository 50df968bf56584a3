"""Live and recorded streams beside pymavlink's reader, starts beside `import numpy`, closed loops beside real time.

A recorded stream becomes a pose track, or is replayed. Times are the least of several.
"""

from __future__ import annotations

import argparse
import gc
import resource
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Final

from arva_hil import config
from arva_hil.autopilot.following.session import Session
from arva_hil.campaign.trial import Trial, fly
from arva_hil.links.tlog import TlogReader
from tools.bench.stream import playing
from tools.bench.table import Row, once, ratio, wall_of

COMMAND: Final = [sys.executable, "-m", "arva_hil"]
_TURNS: Final = 4  # ours and the peer's in turn, so that both have the same load of the machine
_WARM_S: Final = 3.0  # the time of a start is another row

_READ = """
import sys
from pymavlink import mavutil
link = mavutil.mavlink_connection(sys.argv[1])
while True:
    link.recv_match(blocking=True, timeout=0.5)
"""


def live(options: argparse.Namespace) -> Iterator[Row]:
    ours, peer = list[float](), list[float]()
    for _ in range(_TURNS):
        ours.append(_cpu_of_process([*COMMAND, "run", "--port", "-", "--rate", "10", "--autopilot"], options.seconds))
        peer.append(_cpu_of_process([sys.executable, "-c", _READ], options.seconds))
    work = "live, 50 Hz pose in, 10 Hz frames out: its CPU"
    yield ratio(work, "pymavlink, only reading", min(ours), min(peer), "s", 1.3)


def _cpu_of_process(command: list[str], seconds: float) -> float:
    """Return the CPU time [s] of a process that follows the flight, without its start."""
    with playing(_WARM_S + seconds + 5) as device:
        process = subprocess.Popen([*command, device], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        clock = ~process.pid << 3 | 2  # clock_getcpuclockid of Linux
        time.sleep(_WARM_S)
        before = time.clock_gettime(clock)
        time.sleep(seconds)
        taken = time.clock_gettime(clock) - before
        process.kill()
        process.wait()
    return taken


_NUMPY = [sys.executable, "-c", "import numpy"]
_COMMANDS = ("run", "replay", "search", "campaign")


def starts(_: argparse.Namespace) -> Iterator[Row]:
    numpy = cpu_of_command(_NUMPY)
    for name in _COMMANDS:
        ours = cpu_of_command([*COMMAND, name, "--help"])
        yield ratio(f"arva-hil {name} --help", "import numpy", ours, numpy, "s", 1.0)
    first = min(_first_frame() for _ in range(5))
    numpy = wall_of(partial(subprocess.run, _NUMPY, check=True, capture_output=True), 5)
    yield ratio("arva-hil run to its first frame", "import numpy", first, numpy, "s", 3.0)


def _first_frame() -> float:
    """Return the wall time of the command until its first frame [s], with the stream already flowing."""
    with playing(20.0) as device:
        start = time.perf_counter()
        command = [*COMMAND, "run", "--autopilot", device, "--port", "-", "--rate", "50"]
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, bufsize=0) as child:
            assert child.stdout is not None
            child.stdout.read(1)
            taken = time.perf_counter() - start
            child.terminate()
    return taken


_MAVUTIL = """
import sys, time
from pymavlink import mavutil
log = mavutil.mavlink_connection(sys.argv[1])
start = time.process_time()
while log.recv_match() is not None:
    pass
print(time.process_time() - start)
"""


def streams(options: argparse.Namespace) -> Iterator[Row]:
    flight = options.flight
    records = [record.raw for record in TlogReader(flight)]

    def track() -> float:
        session, start = Session(passive=True), time.process_time()
        for n, raw in enumerate(records):
            session.feed(raw, n * 1e-3, whole=True)
        return time.process_time() - start

    peer = min(figure_of("-c", _MAVUTIL, str(flight)) for _ in range(3))
    yield ratio(
        "MAVLink in: a recorded PX4 stream → pose track",
        "mavutil recv_match",
        min(track() for _ in range(3)),
        peer,
        "s",
        0.25,
    )
    replay = cpu_of_command([*COMMAND, "replay", str(flight), "--out", "/dev/null"])
    reading = cpu_of_command([sys.executable, "-c", _MAVUTIL, str(flight)], 3)
    yield ratio(
        "whole replay of a recorded flight, start-up included", "mavutil, only reading it", replay, reading, "s", 0.6
    )


_REACH: Final = {"flux": 500.0, "estimate": 300.0}
_CONFIGS: Final = Path(__file__).parents[2] / "configs"


def closed_loop(strategy: str, trials: int) -> float:
    """Return the seconds searched in a second of one core, over the paper's cases; the take-off does not count."""
    cases = [config.load(str(_CONFIGS / f"paper_case_{case}.yaml")) for case in (1, 2, 3, 4)]
    fly(Trial(strategy, cases[0]))
    gc.freeze()  # as the processes of a campaign do
    start, flown = time.process_time(), 0.0
    for seed in range(trials):
        flown += fly(Trial(strategy, replace(cases[seed % 4], seed=seed))).time_s
    return flown / (time.process_time() - start)


def loops(_: argparse.Namespace) -> Iterator[Row]:
    for strategy, reach in _REACH.items():
        speed = max(closed_loop(strategy, 8) for _ in range(3))
        yield Row(
            f"closed loop ({strategy}), one core", "real time", 1 / speed, 1.0, "s a second", 1 / speed, 1 / reach
        )


def cpu_of_command(command: Sequence[str], times: int = 5) -> float:
    """Return the CPU seconds of a command, with its start-up. Raises CalledProcessError if it fails."""
    run = partial(subprocess.run, command, check=True, capture_output=True)
    return min(once(run, _children_s) for _ in range(times))


def _children_s() -> float:
    """Return the CPU seconds of all processes that this one has waited for."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def figure_of(*arguments: str) -> float:
    """Return the number in the last line of a Python program's output. Raises CalledProcessError if it fails."""
    done = subprocess.run([sys.executable, *arguments], check=True, capture_output=True, text=True)
    return float(done.stdout.splitlines()[-1])
