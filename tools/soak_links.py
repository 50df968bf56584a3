"""Unplugs and plugs in again, a thousand times, and checks that `arva-hil run` comes through.

    python tools/soak_links.py [--cycles 1000]

Two programs run at once, one with its autopilot on a pseudo-terminal and its consumer on TCP, one the other way round.
Each has its two sides unplugged in turn. Back is the autopilot when frames are computed from its pose again, the
consumer when it has read a whole frame. Ends with 1 when something is not as it should be. `soak_strangers.py` does to
links what strangers and careless consumers do.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from statistics import median, quantiles
from typing import Literal, NamedTuple

from arva_hil.clock import RealClock
from arva_hil.links import Link, LinkError
from arva_hil.links.pty import PtyLink
from arva_hil.links.tcp_server import TcpServerLink
from arva_hil.simulated.vehicle import SimulatedVehicle
from firmware_proto import Decoder

Side = Literal["autopilot", "port"]

HOME = (46.0123, 7.7456, 1650.0)
RATE_HZ = 20.0
MAX_AGE_S = 0.3  # a pose older than this is none: so an autopilot's absence shows in the frames
AWAY_S = (0.5, 1.0)
SETTLE_S = 0.5
RECOVERY_S = 2.0  # allowed
GIVE_UP_S = 30.0
HELD_UP_S = 0.5  # this program itself, by a busy machine
REBOOT_EVERY = 4  # so many returns of an autopilot, it has rebooted meanwhile
LEAST = 8  # cycles: two of each end of each program
WARM_UP = 50  # cycles before memory is looked at
GROWTH_KB = 1024


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cycles", type=int, default=1000, metavar="N", help="unplugged and plugged; default 1000")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    if options.cycles < LEAST:
        parser.error(f"--cycles {options.cycles}: {LEAST} at least, two of each end of each program")
    clock, numbers = RealClock(), random.Random(options.seed)
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        pty = lambda name: PtyLink(str(folder / name))  # noqa: E731
        benches = [
            Bench("pty/tcp", folder / "a", options.cycles // 2, clock, numbers, lambda: pty("fc"), server()),
            Bench("tcp/pty", folder / "b", options.cycles // 2, clock, numbers, server(), lambda: pty("consumer")),
        ]
        try:
            while not all(bench.done for bench in benches):
                links = [end.link for bench in benches for end in bench.ends.values() if end.link]
                clock.wait(clock.now() + 0.005, links)
                for bench in benches:
                    bench.serve()
        except BrokenError as error:
            print(f"WRONG: {error}")
            for bench in benches:
                bench.end()
                print(bench.said[-2000:])
            sys.exit(1)
        finally:
            if sys.exc_info()[0] not in (None, SystemExit):
                for bench in benches:
                    bench.process.kill()
        codes = [bench.end() for bench in benches]
        well = [report(bench, code) for bench, code in zip(benches, codes, strict=True)]
        sys.exit(0 if all(well) else 1)


def server() -> Callable[[], TcpServerLink]:
    """Makes servers at one and the same free port, one after the other."""
    with contextlib.closing(TcpServerLink()) as free:
        port = free.port
    return lambda: TcpServerLink("127.0.0.1", port)


class BrokenError(Exception):
    """There is no going on."""


class Cycle(NamedTuple):
    side: Side
    recovery_s: float
    descriptors: int
    memory_kb: int


class End:
    """One far end: plugged in while there is a `link`."""

    def __init__(self, make: Callable[[], PtyLink | TcpServerLink]) -> None:
        self._make = make
        self.link: Link | None = None
        self.plug()

    def plug(self) -> None:
        made = self._make()
        self.link = made
        self.url = made.symlink if isinstance(made, PtyLink) else f"tcp:127.0.0.1:{made.port}"

    def unplug(self) -> None:
        if self.link:
            self.link.close()
        self.link = None

    def read(self) -> bytes:
        with contextlib.suppress(LinkError):
            return self.link.read() if self.link else b""
        return b""


class Bench:
    """A program between two far ends: remembers which of them is unplugged, and how it went before."""

    def __init__(
        self,
        name: str,
        folder: Path,
        times: int,
        clock: RealClock,
        numbers: random.Random,
        autopilot: Callable[[], PtyLink | TcpServerLink],
        port: Callable[[], PtyLink | TcpServerLink],
    ) -> None:
        self.name = name
        self.folder = folder
        self.ends: dict[Side, End] = {"autopilot": End(autopilot), "port": End(port)}
        self.cycles: list[Cycle] = []
        self.wrong: list[str] = []
        self._times = times
        self._clock = clock
        self._numbers = numbers
        self._vehicle = SimulatedVehicle(HOME, boot_time=clock.now())
        self._decoder = Decoder()
        self._frame: tuple[float, int, bool] | None = None  # when the last one came, its number, whether it hears
        self._side: Side = "port"
        self._state: Literal["settling", "away", "returning"] = "returning"
        self._since = clock.now()
        self._until = 0.0
        self._before: tuple[float, int] | None = None
        self._started = False
        self._errors = tempfile.TemporaryFile()  # noqa: SIM115 (closed in `end`)
        urls = [part for side, end in self.ends.items() for part in (f"--{side}", end.url)]
        options = ["--rate", str(RATE_HZ), "--max-age", str(MAX_AGE_S), "--record", str(folder)]
        self.process = subprocess.Popen(
            [sys.executable, "-m", "arva_hil", "run", *urls, *options], stderr=self._errors, stdin=subprocess.DEVNULL
        )

    @property
    def done(self) -> bool:
        """All cycles are done, and the last one has settled."""
        return len(self.cycles) >= self._times and self._state == "settling" and self._clock.now() >= self._until

    def serve(self) -> None:
        """Do what vehicle and consumer do, and what is next in the cycle."""
        now = self._clock.now()
        self._fly(now)
        self._consume(now)
        if self.process.poll() is not None:
            raise BrokenError(f"{self.name}: the program has ended with {self.process.returncode}")
        if self._state == "returning" and self._is_back():
            self._note(now)
            self._state, self._until = "settling", now + SETTLE_S
        elif self._state == "returning" and now - self._since > GIVE_UP_S:
            raise BrokenError(f"{self.name}: the {self._side} did not come back in {GIVE_UP_S:g} s")
        elif self._state == "settling" and now >= self._until and self._hears() and not self.done:
            self._side = "autopilot" if self._side == "port" else "port"
            self._before = self._frame[:2] if self._frame else None
            self.ends[self._side].unplug()
            self._state, self._until = "away", now + self._numbers.uniform(*AWAY_S)
        elif self._state == "away" and now >= self._until:
            if self._side == "autopilot":
                if self._hears():
                    self.wrong.append(f"cycle {len(self.cycles)}: frames hear though the pose is too old")
                if len(self.cycles) % (2 * REBOOT_EVERY) < 2:
                    self._vehicle.reboot(now)
            else:
                self._decoder, self._frame = Decoder(), None
            self.ends[self._side].plug()
            self._state, self._since = "returning", now

    def end(self) -> int:
        """SIGTERM; the exit code."""
        self.process.send_signal(signal.SIGTERM)
        code = self.process.wait(20)
        self._errors.seek(0)
        self.said = self._errors.read().decode()
        self._errors.close()
        for end in self.ends.values():
            end.unplug()
        return code

    def _fly(self, now: float) -> None:
        end = self.ends["autopilot"]
        self._vehicle.feed(end.read(), now)
        said = self._vehicle.poll(now)
        if said and end.link:
            with contextlib.suppress(LinkError):
                end.link.write(said)

    def _consume(self, now: float) -> None:
        for frame in self._decoder.feed(self.ends["port"].read(), now):
            self._frame = (now, frame.sequence, frame.channels[0].valid)
            if self._side == "port" and self._state == "returning" and self._before:
                self._check_rhythm(now, frame.sequence)
        if self._decoder.lost or self._decoder.bad_crc:
            self.wrong.append(
                f"cycle {len(self.cycles)}: {self._decoder.lost} frames lost, {self._decoder.bad_crc} bad"
            )
            self._decoder.lost = self._decoder.bad_crc = 0

    def _check_rhythm(self, now: float, number: int) -> None:
        """As many frames were made meanwhile as at any other time."""
        assert self._before
        then, last = self._before
        made = (number - last) % 256
        self._before = None
        if abs(made - (now - then) * RATE_HZ) > HELD_UP_S * RATE_HZ:
            self.wrong.append(f"cycle {len(self.cycles)}: {made} frames in {now - then:.2f} s without a consumer")

    def _hears(self) -> bool:
        return self._frame is not None and self._frame[2]

    def _is_back(self) -> bool:
        return self._hears() if self._side == "autopilot" or not self._started else self._frame is not None

    def _note(self, now: float) -> None:
        if not self._started:  # this was the start
            self._started = True
            return
        process = Path("/proc", str(self.process.pid))
        memory = int((process / "statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") // 1024
        self.cycles.append(Cycle(self._side, now - self._since, len(os.listdir(process / "fd")), memory))
        if len(self.cycles) % 100 == 0:
            print(f"{self.name}: {len(self.cycles)} cycles, {memory} kB", file=sys.stderr)


def report(bench: Bench, code: int) -> bool:
    """Print how it went; whether it went as it should."""
    wrong = list(bench.wrong)
    media = dict(zip(("autopilot", "port"), bench.name.split("/"), strict=True))
    counters = json.loads((bench.folder / "run.json").read_text())["counters"]
    print(f"{bench.name}: {len(bench.cycles)} cycles, exit code {code}")
    for side, medium in media.items():
        times = [cycle.recovery_s for cycle in bench.cycles if cycle.side == side]
        lost, back = counters[f"{side}_link_losses"], counters[f"{side}_link_returns"]
        p99 = quantiles(times, n=100, method="inclusive")[98]
        print(
            f"  {side} on {medium}: {len(times)} × unplugged, {lost} × lost, {back} × back; after "
            f"{median(times):.2f} s (median), {p99:.2f} s (p99), {max(times):.2f} s (worst)"
        )
        lines = [
            bench.said.count(what) for what in (f"{bench.ends[side].url}: lost: ", f"{bench.ends[side].url}: back")
        ]
        if not lost == back == len(times) == lines[0] == lines[1]:
            wrong.append(f"{side}: {len(times)} × unplugged, {lost} × lost, {back} × back; lines for them: {lines}")
        if max(times) > RECOVERY_S:
            wrong.append(f"{side}: {sum(time > RECOVERY_S for time in times)} × not back in {RECOVERY_S:g} s")
    descriptors = sorted({cycle.descriptors for cycle in bench.cycles})
    warm = [cycle.memory_kb for cycle in bench.cycles[min(WARM_UP, len(bench.cycles) // 2) :]]
    print(f"  descriptors {descriptors}; memory {warm[0]} kB after the warm-up, {warm[-1]} kB in the end")
    print(f"  {counters['frames']} frames, {counters['skipped']} skipped, latest {counters['latest_s'] * 1e3:.1f} ms")
    if counters["skipped"]:
        wrong.append(f"{counters['skipped']} frames skipped")
    if len(descriptors) > 1:
        wrong.append(f"descriptors: {descriptors}")
    if warm[-1] - warm[0] > GROWTH_KB:
        wrong.append(f"memory grew by {warm[-1] - warm[0]} kB")
    if code != 130 or "Traceback" in bench.said:
        wrong.append(f"the program ended with {code}:\n{bench.said[-2000:]}")
    for line in wrong:
        print(f"  WRONG: {line}")
    return not wrong


if __name__ == "__main__":
    main()
