"""Lets a pilot take over a search at random moments, and counts the orders after that.

    python -m tools sitl pilot [--runs 50] [--jobs 2] [--seed 1]

Each run is one `arva-hil search`, a process of its own, over UDP or TCP with a simulated vehicle (the built-in one, or
that behind PX4's modes), in real time:

    pause   the process is stopped by SIGSTOP for 1.2 to 14 s, and the pilot switches meanwhile
    end     the pilot switches in the last 200 ms before the search ends, and it would land
    climb   the pilot chooses HOLD or LOITER somewhere in the climb
    other   the vehicle is silent for 0 to 5 s, then another one with its ids sends on the same port

An order is any command or set-point that arrives later than the promised bound after the vehicle has reported the
pilot's mode, or after the other vehicle's first packet. The exit code is 1 after an order.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import random
import select
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from typing import Any, NamedTuple

from arva_hil.autopilot.commanding.authority import BOUND_MS
from arva_hil.clock import RealClock
from arva_hil.links import Link
from arva_hil.links.pty import PtyLink
from arva_hil.links.tcp_server import TcpServerLink
from arva_hil.links.udp import UdpInLink, UdpOutLink
from arva_hil.mavlink.codec import Encoder, Parser, command, decode, dialect
from arva_hil.mavlink.dialect import MAVLINK_MSG_ID_CURRENT_MODE
from arva_hil.simulated import HOME
from arva_hil.simulated.autopilot import Mode
from arva_hil.simulated.vehicle import SimulatedVehicle
from firmware_proto import Channel, Frame, encode
from tests.simulated_px4 import HOLD, STREAMS, Px4
from tools.sitl.relay import orders

KINDS = ("pause", "end", "climb", "other")
LIMIT_S = 4.0  # limit of a search without a signal: then it lands
DEADLINE_S = 60.0
AFTERWARDS_S = 1.0  # read the link for this time after the end of the program
MUCH = (
    dialect.MAVLINK_MSG_ID_ATTITUDE,
    dialect.MAVLINK_MSG_ID_ATTITUDE_QUATERNION,
    dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT,
    dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED,
)
Vehicle = SimulatedVehicle | Px4


class Result(NamedTuple):
    """`late`: orders after the bound. `last_ms`: delay of the last order after the report that ends all orders.

    `kept`: the vehicle was left in the pilot's mode, or the other vehicle alone.
    """

    kind: str
    seed: int
    late: int
    last_ms: float
    kept: bool
    said: str


class Bench:
    """One vehicle or two, one after the other, and the search's process. Times are seconds on `clock`."""

    def __init__(self, vehicle: Vehicle, link: Link, url: str, clock: RealClock, *options: object) -> None:
        self.vehicle = vehicle
        self.clock = clock
        self.err = ""
        self.word_s: float | None = None  # time of the report that ends all orders
        self.last_s: float | None = None  # latest time without the last order
        self.late = 0
        self.pilots_mode = -1
        self.silent = False
        self.another = False  # than the search was begun with
        self._link = link
        self._receiver = PtyLink()
        self._said, self._told = Parser(), Parser()
        self._empty_s = clock.now()
        self._frames = 0
        self._program = subprocess.Popen(
            [
                *(sys.executable, "-m", "arva_hil", "search", "--autopilot", url, "--receiver", self._receiver.path),
                *("--yes", "--countdown", "0", "--limit", str(LIMIT_S), "--area=0,-1,40,1", *map(str, options)),
            ],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            stdin=subprocess.DEVNULL,
        )
        assert self._program.stderr is not None
        os.set_blocking(self._program.stderr.fileno(), False)

    def send(self, number: signal.Signals) -> None:
        self._program.send_signal(number)

    def close(self) -> None:
        self._program.kill()
        self._program.wait()
        assert self._program.stderr is not None
        self._program.stderr.close()
        self._receiver.close()
        self._link.close()

    def until(self, condition: Callable[[], object]) -> None:
        end = self.clock.now() + DEADLINE_S
        while not condition():
            if self.clock.now() > end:
                raise TimeoutError(self.err)
            self._step()

    def wait(self, seconds: float) -> None:
        end = self.clock.now() + seconds
        self.until(lambda: self.clock.now() >= end)

    def ends(self) -> None:
        """Wait until the program has ended, and a moment longer."""
        self.until(lambda: self._program.poll() is not None)
        self.wait(AFTERWARDS_S)

    def switch(self, mode: int) -> None:
        """The pilot chooses a mode."""
        self.pilots_mode = mode
        main, sub = (mode >> 16 & 255, mode >> 24) if isinstance(self.vehicle, Px4) else (mode, 0)
        order = command(1, 1, dialect.MAV_CMD_DO_SET_MODE, 1, main, sub)
        self.vehicle.feed(Encoder(255, 190).pack(order), self.clock.now())

    def say_much(self) -> None:
        """Send 20 kB/s, like PX4: after a pause more waits than one read returns, or is lost."""
        for msgid in MUCH:
            order = command(1, 1, dialect.MAV_CMD_SET_MESSAGE_INTERVAL, msgid, 8_000)
            self.vehicle.feed(Encoder(255, 190).pack(order), self.clock.now())

    @property
    def mode(self) -> int:
        return self.vehicle.mode if isinstance(self.vehicle, Px4) else int(self.vehicle._pilot.mode)

    def _step(self) -> None:
        """Advance the vehicle, and forward messages; at most a few milliseconds."""
        now = self.clock.now()
        data = b"".join(chunk for _, chunk in self._link.receive())
        if data and not self.silent:
            self.vehicle.feed(data, now)
        for packet in self._told.feed(data):
            self._note_order(decode(packet))
        self._empty_s = now
        said = self.vehicle.poll(now)
        if said and not self.silent:
            for at in range(0, len(said), 1024):
                self._link.write(said[at : at + 1024])
            self._note_word(said)
            if self.another and self.word_s is None:
                self.word_s = self.clock.now()
        if now * 5 > self._frames:
            self._frames += 1
            self._receiver.write(encode(Frame(self._frames % 256, 1, (Channel(),))))
        with contextlib.suppress(BlockingIOError, TypeError):
            assert self._program.stderr is not None
            self.err += os.read(self._program.stderr.fileno(), 65536).decode()
        fd = self._link.fileno()
        select.select([] if fd is None else [fd], [], [], 0.002)

    def _note_word(self, said: bytes) -> None:
        for packet in self._said.feed(said):
            if packet.msgid in (dialect.MAVLINK_MSG_ID_HEARTBEAT, MAVLINK_MSG_ID_CURRENT_MODE):
                message: Any = decode(packet)
                if self.word_s is None and message.custom_mode == self.pilots_mode:
                    self.word_s = self.clock.now()

    def _note_order(self, message: Any) -> None:
        """Record an order with its least lateness: it came after the link was last empty."""
        if orders(message) and self.word_s is not None:
            self.last_s = self._empty_s
            self.late += self._empty_s > self.word_s + BOUND_MS / 1e3


def fly(kind: str, seed: int) -> Result:
    """Fly one run."""
    numbers, clock = random.Random(f"{kind} {seed}"), RealClock()
    with bench(kind, numbers, clock) as b:
        begins = "the search begins"
        pilots = HOLD if isinstance(b.vehicle, Px4) else int(Mode.LOITER)
        if kind == "climb":
            top = numbers.uniform(0.1, 5.0)
            b.until(lambda: -b.vehicle.truth(clock.now()).ned[2] > top)
            b.switch(pilots)
        elif kind == "end":
            b.until(lambda: begins in b.err)
            b.wait(LIMIT_S - numbers.uniform(0.0, 0.2))
            b.switch(pilots)
        elif kind == "pause":
            seconds = numbers.uniform(1.2, 14.0)
            b.until(lambda: begins in b.err)
            b.say_much()
            b.wait(numbers.uniform(0.2, LIMIT_S - 0.5))
            b.send(signal.SIGSTOP)
            before = numbers.uniform(0.0, seconds)
            b.wait(before)
            b.switch(pilots)
            b.wait(seconds - before)
            b.send(signal.SIGCONT)
        else:
            b.until(lambda: begins in b.err)
            b.wait(numbers.uniform(0.2, LIMIT_S - 0.5))
            b.silent = True
            b.wait(numbers.choice((0.3, numbers.uniform(0.3, 5.0))))
            appear(b, numbers)
        b.ends()
        kept = not b.late if kind == "other" else b.mode == b.pilots_mode
        last_ms = 0.0 if b.last_s is None or b.word_s is None else 1e3 * (b.last_s - b.word_s)
        return Result(kind, seed, b.late, max(last_ms, 0.0), kept, b.err.strip().splitlines()[-1] if b.err else "")


def appear(b: Bench, numbers: random.Random) -> None:
    """Start another vehicle with the ids of the first one, in the air and in its mode; its clock is seconds off."""
    now = b.clock.now()
    north = numbers.uniform(0.0, 60.0)
    first = b.vehicle._vehicle if isinstance(b.vehicle, Px4) else b.vehicle
    booted = first._origin - numbers.uniform(2.0, 20.0)
    if numbers.random() < 0.5:
        booted = numbers.uniform(first._origin + 2.0, now - 0.5)
    other = SimulatedVehicle((HOME[0] + north / 111_200, *HOME[1:]), streams=STREAMS, boot_time=booted)
    other.poll(now)
    other._pilot.set_mode(Mode.GUIDED)
    other._pilot.arm()
    other._pilot.take_off(2.0)
    b.vehicle, b.silent, b.another = other, False, True


@contextlib.contextmanager
def bench(kind: str, numbers: random.Random, clock: RealClock) -> Iterator[Bench]:
    """A vehicle in the air and a search; over UDP or TCP."""
    px4 = kind != "other" and numbers.random() < 0.5
    vehicle = (Px4 if px4 else _ardupilot)(HOME, boot_time=clock.now())
    link: Link
    if numbers.random() < 0.5:
        with contextlib.closing(UdpInLink()) as free:
            port = free.port
        link, url = UdpOutLink("127.0.0.1", port), f"udpin:127.0.0.1:{port}"
    else:
        link = TcpServerLink()
        url = f"tcp:127.0.0.1:{link.port}"
    made = Bench(vehicle, link, url, clock, *(("--take-off", 6, "--height", 6) if kind == "climb" else ()))
    try:
        yield made
    finally:
        made.close()


def _ardupilot(home: tuple[float, float, float], **options: Any) -> SimulatedVehicle:
    return SimulatedVehicle(home, streams=STREAMS, **options)


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=50, metavar="N", help="of each kind; default 50")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, metavar="N", help="at a time; default: cores")
    parser.add_argument("--seed", type=int, default=1, help="of the first run of each kind")
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=KINDS)
    parser.add_argument("-v", action="store_true", dest="verbose", help="a line for each run")
    options = parser.parse_args(arguments)
    print(f"bound: {BOUND_MS} ms\n{'kind':8}{'runs':>6}{'orders after it':>18}{'last order, ms':>16}{'kept':>8}")
    late = 0
    with ProcessPoolExecutor(options.jobs) as pool:
        for kind in options.kinds:
            seeds = range(options.seed, options.seed + options.runs)
            results = list(pool.map(fly, [kind] * len(seeds), seeds))
            for result in results:
                if options.verbose or result.late or not result.kept:
                    print(f"    {result}")
            late += sum(result.late for result in results)
            last, kept = max(result.last_ms for result in results), sum(result.kept for result in results)
            print(f"{kind:8}{len(results):6}{sum(r.late for r in results):18}{last:16.0f}{kept:8}", flush=True)
    return 1 if late else 0
