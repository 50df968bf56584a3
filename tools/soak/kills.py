"""Ends `run`, `search`, `replay` and `campaign` at random moments, and checks that they leave nothing behind.

    python -m tools soak kills [--kills 200] [--seed 1]

A quarter of the programs gets SIGKILL, the others SIGINT or SIGTERM, alone or with all their processes, as from a
terminal. After each end no process of it may be left; after a signal also no symlink and no unfinished file, no
traceback of the program, and the exit code is 130, or that of an end before. SIGKILL leaves the symlink and the
record: the next start replaces the symlink, as all starts of a command use the same name. The exit code is 1 after a
failure.
"""

from __future__ import annotations

import contextlib
import os
import random
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Final

from arva_hil.clock import Clock, RealClock
from arva_hil.links import Link, open_link
from arva_hil.runtime.loop import Task, run
from arva_hil.simulated import HOME
from arva_hil.simulated.vehicle import SimulatedVehicle, Simulator
from firmware_proto import Channel, Frame, encode
from tests.free_ports import free_port
from tools.options import parser

ROOT: Final = Path(__file__).parents[2]
COMMANDS: Final = ("run", "search", "search", "replay", "campaign")
LATEST_S: Final = 2.0  # after the moment from which the delay counts: the start of the process, or one of these words
WORDS: Final = {
    "run": ("autopilot:", "datum:"),
    "search": ("autopilot:", "arming", "search begins", "search begins"),
    "replay": ("scenario", "datum:"),
    "campaign": ("trials",),
}
ENDS_S: Final = 30.0  # allowed after a signal
LEFT_S: Final = 30.0  # allowed to processes of an ended one: a worker that starts on a busy computer ends after that
PLAN: Final = f"spec: 1\nscenarios: [{ROOT}/configs/default.yaml]\nseeds: 1000\nstrategies: [flux]\n"
_NULL: Final = subprocess.DEVNULL


class Seat:
    """One command with its folder, its links, and the random moments at which it is ended. `wrong`: what was found."""

    links: Sequence[Link] = ()

    def __init__(self, command: str, folder: Path, seed: int) -> None:
        self.wrong: list[str] = []
        self.codes: Counter[int | None] = Counter()
        self._command = command
        self._frames = 0
        self._folder = folder
        self._before: set[tuple[str, int]] = set()  # left by SIGKILL
        self._random = random.Random(f"{command} {seed}")
        self._link = self._folder / "port"
        self._port = free_port(socket.SOCK_DGRAM)
        (self._folder / "tmp").mkdir(parents=True)
        (self._folder / "plan.yaml").write_text(PLAN)

    def ends(self, kills: int) -> None:
        """Start and end the command so many times."""
        for number in range(kills):
            with self._far_ends():
                self._once(number)

    def _once(self, number: int) -> None:
        shutil.rmtree(self._folder / "record", ignore_errors=True)
        self._before = self._unfinished()
        environment = os.environ | {"TMPDIR": str(self._folder / "tmp"), "OPENBLAS_NUM_THREADS": "1"}
        words = [sys.executable, "-m", "arva_hil", self._command, *self._words()]
        with tempfile.NamedTemporaryFile() as said:
            process = subprocess.Popen(
                words, stdin=_NULL, stdout=_NULL, stderr=said, env=environment, cwd=ROOT, start_new_session=True
            )
            kind = self._random.choice((signal.SIGKILL, signal.SIGINT, signal.SIGTERM, signal.SIGINT))
            whole = kind != signal.SIGKILL and self._random.random() < 0.5
            self._until(self._random.choice(("", *WORDS[self._command])), process, Path(said.name))
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(self._random.uniform(0.0, LATEST_S))
            if process.poll() is None:
                (os.killpg if whole else os.kill)(process.pid, kind)
            try:
                code = process.wait(ENDS_S)
            except subprocess.TimeoutExpired:
                code = None
            said.seek(0)
            err = said.read().decode(errors="replace")
        self.codes[code] += 1
        found = self._mistakes(process.pid, code, kind, err)
        what = f"{self._command} {number}, {kind.name}{' to all' * whole}"
        self.wrong += [f"{what}: {one}\n{err[-800:]}" for one in found]

    def _until(self, word: str, process: subprocess.Popen[bytes], said: Path) -> None:
        """Wait until the process has said a word, or has ended."""
        clock = RealClock()
        while word not in said.read_text(errors="replace") and process.poll() is None and clock.now() < ENDS_S:
            clock.wait(clock.now() + 0.02)

    def _words(self) -> list[str]:
        record, link = str(self._folder / "record"), f"pty:{self._link}"
        followed = ["--autopilot", f"udpin:127.0.0.1:{self._port}", "--record", record]
        return {
            "run": ["--port", link, *followed, "--rate", "20"],
            "search": ["--receiver", link, *followed, "--web", "0", "--countdown", "0"],
            "replay": ["tests/data/px4.tlog", "--port", link, "--speed", "1", "--record", record],
            "campaign": [str(self._folder / "plan.yaml"), "--out", str(self._folder / "results"), "--jobs", "2"],
        }[self._command]

    def _mistakes(self, pid: int, code: int | None, kind: signal.Signals, err: str) -> list[str]:
        found = ["it does not end"] if code is None else []
        clock = RealClock()
        while (left := processes_of(pid)) and clock.now() < LEFT_S:
            clock.wait(clock.now() + 0.05)
        for process in left:
            found.append(f"process {process} is left")
            with contextlib.suppress(ProcessLookupError):
                os.kill(process, signal.SIGKILL)
        if code == -signal.SIGKILL:
            return found
        if code not in (0, 1, 130, -kind):
            found.append(f"exit code {code}")
        if "Traceback" in err and f"{os.sep}arva_hil{os.sep}" in err:  # else the interpreter itself was not ready
            found.append("a traceback")
        return found + [f"{path} is left" for path in self._unfinished() - self._before]

    def _unfinished(self) -> set[tuple[str, int]]:
        """Return the names and inodes of what a command makes and removes."""
        names = ["port", "port.*", "tmp/*", "record/*.new", "results/*.new", "results/*-journal"]
        return {(str(path), path.lstat().st_ino) for name in names for path in self._folder.glob(name)}

    @contextlib.contextmanager
    def _far_ends(self) -> Iterator[None]:
        """An autopilot that is new each time, and for a search a receiver on its pseudo-terminal."""
        if self._command not in ("run", "search"):
            yield
            return
        stop, clock = threading.Event(), RealClock()
        with contextlib.closing(open_link(f"udpout:127.0.0.1:{self._port}", clock=clock)) as link:
            vehicle = Simulator([SimulatedVehicle(HOME, boot_time=clock.now())], [link])
            tasks: list[Task] = [vehicle, self] if self._command == "search" else [vehicle]
            thread = threading.Thread(target=lambda: run(tasks, clock, stopped=stop.is_set))
            thread.start()
            try:
                yield
            finally:
                stop.set()
                thread.join()

    def service(self, clock: Clock) -> float:
        """Send a frame of the receiver, if the search has made its pseudo-terminal."""
        self._frames += 1
        with contextlib.suppress(OSError):
            fd = os.open(self._link, os.O_WRONLY | os.O_NONBLOCK | os.O_NOCTTY)
            os.write(fd, encode(Frame(self._frames % 256, 0, (Channel(1, 1, 2000 + self._frames, 10),))))
            os.close(fd)
        return clock.now() + 0.2


def processes_of(session: int) -> list[int]:
    """Return the processes of a session, also those that have ended and wait for their parent."""
    found = []
    for path in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):
            if int(path.read_text().rpartition(")")[2].split()[3]) == session:
                found.append(int(path.parent.name))
    return found


def main(words: list[str] | None = None) -> int:
    """Run all commands at once; 1 if one of them has left something."""
    options = parser(__doc__, kills=(200, "of all commands"), seed=(1, "of the first command")).parse_args(words)
    begun = RealClock()
    with tempfile.TemporaryDirectory(prefix="arva-kills-") as name:
        seats = [Seat(command, Path(name, str(n)), options.seed + n) for n, command in enumerate(COMMANDS)]
        with ThreadPoolExecutor() as pool:
            list(pool.map(lambda seat: seat.ends(-(-options.kills // len(seats))), seats))
    for seat, command in zip(seats, COMMANDS, strict=True):
        print(f"{command}: exit codes {dict(sorted(seat.codes.items(), key=str))}, mistakes: {len(seat.wrong)}")
        print("\n".join(seat.wrong))
    print(f"{begun.now():.0f} s")
    return 1 if any(seat.wrong for seat in seats) else 0
