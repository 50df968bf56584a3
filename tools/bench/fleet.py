"""Many vehicles in one process on one core: 50 Hz poses in, 10 Hz frames out, over UDP and pseudo-terminals.

Vehicles with an odd number use UDP and have their frames on a pseudo-terminal, the others the reverse. One far end, a
process of its own, plays all of them and reads all frames.
"""

from __future__ import annotations

import argparse
import gc
import http.client
import itertools
import json
import multiprocessing
import os
import time
from collections.abc import Iterator
from contextlib import ExitStack, closing
from typing import Any, Final, NamedTuple

import numpy as np

from arva_hil.autopilot.following.session import Session
from arva_hil.clock import RealClock
from arva_hil.config import Scenario, parse
from arva_hil.emulator.engine import Emulator
from arva_hil.emulator.setup import vehicle_setups
from arva_hil.links import Link, open_link
from arva_hil.links.pty import PtyLink
from arva_hil.links.udp import UdpInLink, UdpOutLink
from arva_hil.mavlink.codec import Encoder
from arva_hil.observers.web.address import HostPort
from arva_hil.observers.web.page import WebPage
from arva_hil.observers.web.state import State
from arva_hil.runtime.audience import Audience, Observer
from arva_hil.runtime.drivers import Live
from arva_hil.runtime.loop import run
from tools.bench.stream import POSE_HZ, packets
from tools.bench.table import Row, ratio

FRAMES_HZ: Final = 10
_WARM_S: Final = 2.0
_LATE_MS: Final = 5.0  # p99
_FLAT: Final = 1.2
_MANY: Final = 64
_PAGES: Final = 20
_POLL_S: Final = 0.2  # as a page
_WATCHED: Final = 3.0


class Flown(NamedTuple):
    """The cost of a number of vehicles: CPU seconds of the loop, lateness of each frame [ms], and the numbers of frames
    made, skipped or dropped, and without a pose."""

    vehicles: int
    cpu_s: float
    late_ms: list[float]
    frames: int
    lost: int
    no_pose: int

    @property
    def p99_ms(self) -> float:
        return float(np.percentile(self.late_ms, 99))


def rows(options: argparse.Namespace) -> Iterator[Row]:
    flown = {count: fly(count, options.seconds) for count in (1, 4, 16, _MANY)}
    many = flown[_MANY]
    yield Row(
        f"fleet: p99 lateness of {_MANY} vehicles", "its limit", many.p99_ms, _LATE_MS, "ms", many.p99_ms, _LATE_MS
    )
    lost = float(many.lost + many.no_pose)
    yield Row(f"fleet: frames of {_MANY} vehicles not sent or without a pose", "", lost, 0.0, "", lost, 0.0)
    watched = fly(_MANY, options.seconds, _PAGES)
    work = f"fleet: p99 lateness of {_MANY} vehicles with {_PAGES} pages open"
    yield Row(work, "its limit", watched.p99_ms, _LATE_MS, "ms", watched.p99_ms, _LATE_MS)
    work = f"fleet: CPU of {_MANY} vehicles with {_PAGES} pages open"
    yield ratio(work, "without a page", watched.cpu_s, many.cpu_s, "s", _WATCHED)
    one = flown[1].cpu_s
    for count, of in flown.items():
        if count > 1:
            yield ratio(f"fleet: CPU a vehicle, of {count}", "of one alone", of.cpu_s / count, one, "s", _FLAT)


def fly(count: int, seconds: float, pages: int = 0) -> Flown:
    """Run `count` vehicles for `seconds` in a process on one core. `pages`: number of open pages."""
    context: Any = multiprocessing.get_context("spawn")
    near_end, far_end = context.Pipe()
    done = context.Queue()
    ours = context.Process(target=_emulate, args=(count, seconds, pages, near_end, done), daemon=True)
    far = context.Process(target=_play, args=(count, seconds, far_end), daemon=True)
    ours.start()
    far.start()
    if pages:
        _watch(done.get(timeout=60), pages, time.monotonic() + _WARM_S + seconds)
    flown = Flown(*done.get(timeout=seconds + 120))
    for process in (ours, far):
        process.terminate()
        process.join()
    return flown


def scenario(count: int) -> Scenario:
    """Return a scenario with one receiver a vehicle; the caller opens the links."""
    lines = ["spec: 2", "transmitters: [{id: 1, ned: [20, 5, 0]}]", "vehicles:"]
    for system in range(1, count + 1):
        port = f"{{name: r, port: '/dev/v{system}', rate_hz: {FRAMES_HZ}}}"
        lines.append(
            f"  - {{name: v{system}, system: {1 + system % 250}, autopilot: /dev/a{system}, receivers: [{port}]}}"
        )
    return parse("\n".join(lines), "bench")


class _Timed(Link):
    """A port that records the lateness of each frame [ms]."""

    def __init__(self, port: Link, clock: RealClock) -> None:
        self.name = port.name
        self.late_ms: list[float] = []
        self.start = 0.0
        self._port = port
        self._clock = clock
        self._written = 0

    def read(self) -> bytes:
        return self._port.read()

    def write(self, data: bytes) -> bool:
        taken = self._port.write(data)
        at = self._clock.now() - self.start - self._written / FRAMES_HZ
        self._written += 1
        if self._written > _WARM_S * FRAMES_HZ:
            self.late_ms.append(1e3 * at)
        return taken

    def close(self) -> None:
        self._port.close()


def _emulate(count: int, seconds: float, pages: int, far: Any, done: Any) -> None:
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    chosen, clock = scenario(count), RealClock()
    with ExitStack() as stack:
        udp = [stack.enter_context(closing(UdpInLink())) for _ in range(1, count + 1, 2)]
        far.send([link.port for link in udp])
        ptys, ports_in = far.recv()
        far_ptys = iter(ptys)
        autopilots, ports = dict[str, Link](), dict[str, _Timed]()
        for number, vehicle in enumerate(chosen.vehicles):
            line = stack.enter_context(closing(open_link(next(far_ptys), clock=clock)))
            name = f"{vehicle.name}/r"
            if number % 2 == 0:
                autopilots[vehicle.name], ports[name] = udp[number // 2], _Timed(line, clock)
            else:
                out = stack.enter_context(closing(open_link(f"udpout:127.0.0.1:{ports_in}", clock=clock)))
                autopilots[vehicle.name], ports[name] = line, _Timed(out, clock)
        start = clock.now()
        setups = vehicle_setups(chosen, lambda v: v.name, lambda v: Session(target_system=v.system, name=v.name))
        observers = list[Observer]()
        if pages:
            page = WebPage(HostPort("127.0.0.1", 0), State("run", "bench", named=True))
            stack.callback(page.close)
            observers.append(page)
            done.put(page.address.port)
        emulator = Emulator(setups, start=start, spread=True, tell_packets=pages > 0)
        for emulated in emulator.vehicles:
            for receiver, port in emulated.units:
                ports[port.link].start = receiver.schedule.deadline
        live = Live(emulator, autopilots, ports, Audience(observers))
        far.send("ready")
        gc.freeze()  # as the commands do
        run([live], clock, until=start + _WARM_S)
        before = time.process_time()
        run([live], clock, until=start + _WARM_S + seconds)
        cpu = time.process_time() - before
    late = [ms for port in ports.values() for ms in port.late_ms]
    counters = [port.counters for emulated in emulator.vehicles for _, port in emulated.units]
    made = sum(c.frames for c in counters)
    lost = sum(c.dropped + c.skipped for c in counters)
    no_pose = sum(max(0, c.no_pose - round(_WARM_S * FRAMES_HZ)) for c in counters)
    done.put((count, cpu, late, made, lost, no_pose))


def _watch(port: int, pages: int, until: float) -> None:
    """Request the state as `pages` pages do, until a time."""
    versions = [0] * pages
    clients = [http.client.HTTPConnection("127.0.0.1", port, timeout=10) for _ in range(pages)]
    for turn in itertools.cycle(range(pages)):
        if time.monotonic() > until:
            return
        clients[turn].request("GET", f"/state.json?since={versions[turn]}")
        versions[turn] = json.loads(clients[turn].getresponse().read())["version"]
        time.sleep(_POLL_S / pages)


def _play(count: int, seconds: float, ours: Any) -> None:
    """Play the far end: every vehicle's poses, spread over the period, and a reader of all frames."""
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    ticks = round((seconds + _WARM_S + 2) * POSE_HZ)
    encoders = [Encoder(1 + system % 250, 1) for system in range(1, count + 1)]
    bodies = [[packets(encoder, n) for n in range(ticks)] for encoder in encoders]
    lines = [PtyLink() for _ in range(count)]
    senders = [UdpOutLink("127.0.0.1", port) for port in ours.recv()]
    frames_in = UdpInLink()
    ours.send(([line.path for line in lines], frames_in.port))
    assert ours.recv() == "ready"
    start = time.monotonic()
    for n in range(ticks):
        for number in range(count):
            due = start + (n + number / count) / POSE_HZ
            while (left := due - time.monotonic()) > 0:
                time.sleep(min(left, 0.002))
            link = lines[number] if number % 2 else senders[number // 2]
            link.write(bodies[number][n])
        for one in (*lines, *senders, frames_in):
            one.read()
