"""The programs of a flight on a simulator, and its judgement by the simulator's own truth."""

from __future__ import annotations

import contextlib
import json
import math
import re
import signal
import subprocess
import sys
import threading
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Final

from arva_hil.autopilot.commanding.authority import BOUND_MS
from arva_hil.mavlink.codec import dialect
from arva_hil.model.field import LocalFrame
from tools.sitl.relay import orders, orders_landing, run_as_others, tells_mode
from tools.sitl.simulator import HOME, Simulator, wait

Buried = dict[int, Sequence[float]]  # transmitters: NED from home, by id

TOUCHED_M: Final = 0.05
APART_S: Final = 0.4  # between two set-points
LEAST_M: Final = 0.3  # a hovering vehicle is higher
BEGINS: Final = "the search begins"
ENDS: Final = r"descending to|; landing|\| landing \||; hovering|taken over|pilot has"
FREE: Final = ("anywhere", "busy")
SILENCE: Final = ("climb", "search", "end", "pause", "sticks", "throttle", "joystick", "other")  # is due in these


class Program:
    """One of our commands; `lines`: its output with times."""

    def __init__(self, folder: Path, *arguments: object) -> None:
        self.lines: list[tuple[float, str]] = []
        self.began = time.monotonic()
        self._out = (folder / f"{arguments[0]}.out").open("w+")
        self._err = (folder / f"{arguments[0]}.err").open("w")
        self.process = subprocess.Popen(
            [sys.executable, "-m", "arva_hil", *map(str, arguments)],
            stdin=subprocess.DEVNULL,
            stdout=self._out,
            stderr=subprocess.PIPE,
            text=True,
            cwd=Path(__file__).parents[2],
            preexec_fn=run_as_others,
        )
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    def _read(self) -> None:
        assert self.process.stderr is not None
        for line in self.process.stderr:
            now = time.monotonic()
            self.lines.append((now, line.strip()))
            print(f"{now - self.began:8.2f} {line}", end="", file=self._err, flush=True)

    @property
    def out(self) -> str:
        self._out.seek(0)
        return self._out.read()

    def said(self, pattern: str) -> float | None:
        """Return the time of the first line that matches."""
        return next((at for at, line in list(self.lines) if re.search(pattern, line)), None)

    def says(self, pattern: str, within_s: float = 180.0) -> float:
        wait(lambda: self.said(pattern) or self.process.poll() is not None, within_s)
        at = self.said(pattern)
        if at is None:
            raise TimeoutError(f"{pattern!r} was not said")
        return at

    def close(self) -> None:
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGCONT)
            self.process.kill()
        self.process.wait()
        self._thread.join(5)
        self._out.close()
        self._err.close()


@dataclass
class Flight:
    """The result of one flight. Heights and errors are horizontal or true, m, as far as they are known."""

    simulator: str
    kind: str
    seed: int
    height_m: float  # requested
    folder: str
    good: bool = False
    code: int | None = None
    outcome: str = ""
    how: str = ""
    time_s: float = 0.0
    reported_m: float | None = None  # largest error of the places reported, by the estimate of the vehicle's place
    stands_m: float | None = None  # distance of the touchdown, by that estimate
    touchdown_m: float | None = None  # the true distance of the touchdown
    lowest_m: float | None = None  # true heights above the ground while searching
    highest_m: float | None = None
    standing_m: float | None = None
    disarmed: bool = False
    kept: bool | None = None  # the mode of the pilot is the vehicle's at the end
    orders: int = 0  # orders after the vehicle's report
    last_ms: float = 0.0
    late: int = 0  # orders after the bound
    words: dict[str, int] = field(default_factory=dict)  # other messages after the report, by name
    apart_s: float = 0.0  # the longest time between two set-points
    modes: list[int] = field(default_factory=list)  # ordered by the search after the pilot has moved
    load: float = 0.0
    problem: str = ""

    def __str__(self) -> str:
        def m(value: float | None) -> str:
            return "    -" if value is None else f"{value:5.2f}"

        silence = f"orders {self.orders}, last {self.last_ms:.0f} ms, late {self.late} {self.modes} {self.words or ''}"
        return (
            f"{self.simulator:10} {self.kind:9} {self.seed:3} {'ok ' if self.good else 'BAD'} {self.code!s:>4} "
            f"{self.outcome:9} {self.time_s:5.0f} s  {m(self.reported_m)} {m(self.stands_m)} {m(self.touchdown_m)}  "
            f"low {m(self.lowest_m)} high {m(self.highest_m)}  {'disarmed' if self.disarmed else 'armed   '} "
            f"kept {self.kept!s:5} {silence}  "
            f"set-points {self.apart_s:.2f} s apart  load {self.load:.1f}  {self.how} {self.problem}"
        )


def judge(flight: Flight, simulator: Simulator, search: Program, acted: float | None, buried: Buried) -> None:
    """Complete a flight. `acted`: the time when the pilot or another one has acted."""
    flight.code = search.process.poll()
    with contextlib.suppress(ValueError):
        outcome = json.loads(search.out)
        flight.outcome, flight.how = outcome["outcome"], outcome["how"]
        found = outcome["victims"] or ([outcome["found"] | {"id": outcome["id"]}] if outcome["found"] else [])
        errors = [off(one["lat_lon"][0], one["lat_lon"][1], {one["id"]: buried[one["id"]]}) for one in found]
        flight.reported_m = max(errors, default=None)
    flight.time_s = (search.lines[-1][0] if search.lines else 0.0) - search.began
    flight.disarmed = not simulator.relay.armed
    _judge_way(flight, simulator, search, acted or math.inf, buried)
    high = flight.lowest_m is not None and flight.lowest_m >= flight.height_m / 2
    if flight.kind in FREE:
        flight.good = flight.code == 0 and flight.disarmed and high and flight.apart_s <= APART_S
    elif flight.kind in ("lie", "fence"):
        flight.good = flight.code in (0, 1) and flight.disarmed and high
    elif acted is not None:
        _judge_orders(flight, simulator, acted)


def _judge_way(flight: Flight, simulator: Simulator, search: Program, acted: float, buried: Buried) -> None:
    """Judge the true places, and the times of the set-points."""
    notes, places = list(simulator.relay.notes), list(simulator.relay.places)  # the relay goes on
    landing = next((n.time_s for n in notes if n.up and orders_landing(n.message)), math.inf)
    begun, ended = search.said(BEGINS), min(search.said(ENDS) or math.inf, acted, landing)
    heights = dict(zip(places, simulator.heights(places), strict=True))
    with (Path(flight.folder) / "truth.csv").open("w") as file:
        for place in places:
            print(f"{place.time_s - search.began:.3f},{place.lat},{place.lon},{heights[place]:.3f}", file=file)
    if begun is not None:
        searching = [height for place, height in heights.items() if begun <= place.time_s <= ended]
        flight.lowest_m, flight.highest_m = min(searching, default=None), max(searching, default=None)
    if places:
        down = (place for place in places if place.time_s > ended and heights[place] < TOUCHED_M)
        touched = next(down, places[-1])  # later the wind may push it over the ground
        flight.touchdown_m = off(touched.lat, touched.lon, buried)
        flight.standing_m = heights[places[-1]]
        kind = dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT
        estimates = [n.message for n in notes if type(n.message).id == kind and n.time_s <= touched.time_s]
        flight.stands_m = off(estimates[-1].lat / 1e7, estimates[-1].lon / 1e7, buried) if estimates else None
    target = dialect.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED
    times = [n.time_s for n in notes if n.up and type(n.message).id == target]
    flight.apart_s = max((b - a for a, b in pairwise(times)), default=0.0)


def _judge_orders(flight: Flight, simulator: Simulator, acted: float) -> None:
    """Judge what the search has ordered since the pilot or another vehicle has come."""
    relay, other = simulator.relay, flight.kind == "other"
    since = [n for n in relay.notes if n.time_s > acted]
    after = [n for n in since if n.up]
    flight.modes = [int(m.param2) for _, _, m in after if getattr(m, "command", 0) == dialect.MAV_CMD_DO_SET_MODE]
    flight.modes += [-21 for _, _, m in after if getattr(m, "command", 0) == dialect.MAV_CMD_NAV_LAND]
    if flight.kind in SILENCE:
        words = (n.time_s for n in since if not n.up and (other or tells_mode(n.message) == simulator.pilots))
        word = next(words, None)
        if word is None:
            flight.problem = "the vehicle never said the pilot's mode"
            return
        behind = [n for n in after if n.time_s > word]
        ordered = [n for n in behind if orders(n.message)]
        flight.orders = len(ordered)
        flight.last_ms = max((1e3 * (n.time_s - word) for n in ordered), default=0.0)
        late = [n for n in behind if n.time_s > word + BOUND_MS / 1e3]
        flight.late = sum(orders(n.message) for n in late)
        flight.words = dict(Counter(n.message.get_type() for n in late if not orders(n.message)))
        flight.kept = not flight.late if other else relay.mode == simulator.pilots
        flight.good = flight.kept and not flight.late and flight.code == 1
    elif flight.kind in ("stop", "descent"):
        flight.kept = relay.mode == simulator.still and relay.armed
        hovers = flight.standing_m is not None and flight.standing_m > LEAST_M
        flight.good = flight.kept and flight.code == 130 and hovers
    else:
        flight.good = flight.code == 130 and flight.disarmed


def off(lat: float, lon: float, buried: Buried) -> float:
    """Return the distance from a place to the nearest transmitter."""
    north, east, _ = LocalFrame(*HOME).ned(lat, lon, HOME[2])
    return min(math.dist((north, east), ned[:2]) for ned in buried.values())
