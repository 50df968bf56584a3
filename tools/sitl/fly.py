"""Flies searches on the simulators of ArduPilot and PX4 and on the built-in vehicle, and judges them by the truth.

    python -m tools sitl fly …/build/sitl/bin/arducopter anywhere --runs 10
    python -m tools sitl fly …/build/px4_sitl_default/bin/px4 climb search end pause stop landing -- --height 3
    python -m tools sitl fly vehicle --runs 50 --jobs 3

Each flight has a simulator of its own, `run`, `search`, and a relay between search and simulator that notes the time
of each message. `vehicle` is the built-in one. With a pilot the seed draws its modes, ArduPilot's or PX4's, and its
link, TCP or UDP:

    anywhere  a transmitter within ±30 m. ArduPilot: wind of 5 m/s with gusts, and a GPS whose error walks (1.5 m).
              PX4's own simulator has no wind; its GPS has noise of its own
    climb     the pilot chooses LOITER (PX4: HOLD) in the climb,
    search    2 to 8 s after the search has begun,
    end       in the last 200 ms before it ends, and would land,
    pause     while the process is stopped by SIGSTOP for 1.2 to 14 s
    other     the vehicle is silent for 0 to 5 s, then another one with its ids sends (built-in)
    sticks    roll 1800, pitch 1200, the throttle to its middle; PX4 does not use this radio
    throttle  the same, but the throttle comes to its middle 12 s later (ArduPilot)
    joystick  MANUAL_CONTROL that begins in the search, pitch 70 % (PX4)
    stop      Ctrl-C in the search
    descent   Ctrl-C on the way down by set-points,
    landing   and while it lands
    lie       a sensor lies to the search from a moment in the search on; with a rangefinder
    fence     the vehicle keeps within a fence of 10 m, and the transmitter lies beyond it
    busy      as anywhere, beside two processes that take a core each

`late`: orders and set-points of the search later than the promised bound after the vehicle's report of the pilot's
mode, or after the other vehicle's first message. Each flight has a folder; results.jsonl has all figures. The exit code
is 1 after a failed flight. The simulators of others fly one at a time: their ports are fixed.
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
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Final

from arva_hil.autopilot.commanding.authority import BOUND_MS
from arva_hil.campaign.plan import draw as drawn_at_random
from arva_hil.config import Lla, Scenario, Transmitter, to_dict
from arva_hil.config.campaign import Random
from arva_hil.mavlink.codec import dialect
from tools.fuzz.sensors import Liar, Lie
from tools.options import parser
from tools.sitl import simulator as simulators
from tools.sitl.judge import BEGINS, FREE, SILENCE, Flight, Program, judge
from tools.sitl.relay import Weather, run_as_others, run_first
from tools.sitl.simulator import HOME, BuiltIn, Simulator, wait

WITHIN_M: Final = 30.0
HEIGHT_M: Final = 3.0  # the default
LIMIT_S: Final = 8.0  # of a search that is to end by itself
PATIENCE_S: Final = 420.0
AFTERWARDS_S: Final = 5.0
PILOTS: Final = ("climb", "end", "pause", "other")
KINDS: Final = (*FREE, *SILENCE, "stop", "descent", "landing", "lie", "fence")
LIES: Final = (
    *(("rangefinder", "offset", size) for size in (5.0, 2.0)),
    *(("rangefinder", kind, size) for kind, size in (("affine", 0.0), ("factor", 2.0), ("limit", 0.0), ("drift", 0.1))),
    *(("altitude", kind, size) for kind, size in (("reset", 5.0), ("reset", 9.0), ("drift", 0.05))),
    *(("barometer", kind, size) for kind, size in (("drift", 0.05), ("offset", 5.0))),
)
MUCH: Final = (
    dialect.MAVLINK_MSG_ID_ATTITUDE,
    dialect.MAVLINK_MSG_ID_ATTITUDE_QUATERNION,
    dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT,
    dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED,
)


def fly(
    binary: Path,
    folder: Path,
    kind: str,
    seed: int,
    options: Sequence[str] = (),
    *,
    transmitters: Sequence[Transmitter] | None = None,
    victims: int = 1,
    model: str = "paper",
    slope: float = 0.0,
    rangefinder: bool = False,
) -> Flight:
    """Fly one search to these transmitters, or to those that the kind and the seed draw."""
    height = float(options[options.index("--height") + 1]) if "--height" in options else HEIGHT_M
    flight = Flight(binary.name, kind, seed, height, str(folder))
    numbers = random.Random(f"{kind} {seed}")
    chosen = scenario(kind, seed, victims, model, slope)
    if transmitters is not None:
        chosen = replace(chosen, transmitters=tuple(transmitters))
    file, port, record = folder / "scenario.yaml", folder / "receiver", folder / "record"
    file.write_text(json.dumps(to_dict(chosen)))
    options = [*options, "--victims", str(victims)]
    if kind == "end":
        options += ["--limit", f"{LIMIT_S:g}", "--area=0,-1,40,1"]
    with contextlib.ExitStack() as stack:
        simulator = simulated(binary, folder, kind, seed, slope, rangefinder or kind == "lie")
        stack.callback(simulator.close)
        for _ in range(2 if kind == "busy" else 0):
            burner = subprocess.Popen([sys.executable, "-c", "while True: pass"], preexec_fn=run_as_others)
            stack.callback(burner.kill)
        run = "run", "--scenario", file, "--record", record, "--timeout", 60
        emulator = Program(folder, *run, "--autopilot", simulator.telemetry, "--port", f"pty:{port}")
        stack.callback(emulator.close)
        emulator.says("frames to")
        search = Program(
            *(folder, "search", "--json", "--timeout", 90, "--arm-timeout", 120, "--record", record),
            *("--autopilot", simulator.relay.url, "--receiver", port, *options),
        )
        stack.callback(search.close)
        try:
            acted = act(kind, simulator, search, numbers)
            wait(lambda: search.process.poll() is not None, PATIENCE_S)
            time.sleep(0 if kind in FREE else AFTERWARDS_S)
        except TimeoutError as error:
            flight.problem = f"timed out {error}"
            acted = None
        if kind in ("landing", "lie", "fence"):
            with contextlib.suppress(TimeoutError):
                wait(lambda: not simulator.relay.armed, 60)
        time.sleep(1.5)
        flight.load = os.getloadavg()[0]
        judge(flight, simulator, search, acted, {one.id: one.ned or () for one in chosen.transmitters})
    return flight


def scenario(kind: str, seed: int, victims: int, model: str, slope: float) -> Scenario:
    """Return the transmitters of a flight."""
    drawn = drawn_at_random(Random(WITHIN_M, count=victims, model=model), seed)
    near = (4.0, 3.0, 0.0) if kind in ("descent", "landing") else (20.0, 15.0, 0.0)
    there = [one if kind in FREE else replace(one, ned=near) for one in drawn.transmitters]
    return placed(replace(drawn, transmitters=tuple(there), seed=seed), slope)


def placed(scenario: Scenario, slope: float) -> Scenario:
    """Return a scenario at HOME. On a slope the depths are below the ground, which the autopilot has."""
    if not slope:
        return replace(scenario, datum=Lla(*HOME))
    there = [replace(one, ned=(*one.ned[:2], 0.0), depth_m=one.ned[2]) for one in scenario.transmitters if one.ned]
    return replace(scenario, transmitters=tuple(there), terrain="autopilot")


def simulated(binary: Path, folder: Path, kind: str, seed: int, slope: float, rangefinder: bool) -> Simulator:
    if binary.name == "arducopter":
        weather = Weather(seed) if kind in FREE else None
        parameters = simulators.FENCE if kind == "fence" else ""
        ground: dict[str, Any] = {"slope": slope, "rangefinder": rangefinder}
        return simulators.ArduCopter(binary, folder, weather=weather, parameters=parameters, **ground)
    if binary.name == "px4":
        return simulators.Px4(binary, folder, simulators.PX4_FENCE if kind == "fence" else {})
    return BuiltIn(seed, drawn=kind in SILENCE and kind != "other")


def act(kind: str, simulator: Simulator, search: Program, draw: random.Random) -> float | None:
    """Do what the pilot does, or whoever else. Returns the time."""
    relay = simulator.relay
    if kind == "climb":
        top = draw.uniform(0.3, 2.2)
        wait(lambda: (relay.armed and relay.height > top) or search.process.poll() is not None, 200)
        return simulator.switch()
    if kind in FREE:
        search.says("climbing", 200)
        if relay.weather:
            relay.weather.begun = True
        return None
    pulses = [1500, 1500, 1000, 1500]  # with any other throttle ArduPilot does not arm
    if kind in ("sticks", "throttle"):
        radio = dialect.MAVLink_rc_channels_override_message
        relay.hold(lambda: radio(simulator.system, 1, *pulses, 0, 0, 0, 0))
    begun = search.says(BEGINS, 200)
    if kind == "fence":
        return None
    if kind == "lie":
        time.sleep(draw.uniform(1, 12))
        lie = Lie(*draw.choice(LIES), from_s=time.monotonic())
        print(f"lie: {lie}, {lie.from_s - begun:.1f} s after the search began", flush=True)
        liar = Liar(lie, HOME[2])
        relay.lie = lambda message: liar.changed(message, time.monotonic(), relay.height, relay.height)
        return None
    if kind == "end":
        time.sleep(max(0.0, begun + LIMIT_S - draw.uniform(0.0, 0.2) - time.monotonic()))
        return simulator.switch()
    if kind == "pause":
        return pause(simulator, search, draw)
    if kind in ("descent", "landing"):
        search.says("coming down onto" if kind == "descent" else "; landing")
        time.sleep(draw.uniform(0.5, 2.5))
    else:
        time.sleep(draw.uniform(2, 8))
    if kind == "search":
        return simulator.switch()
    if kind == "other":
        assert isinstance(simulator, BuiltIn)
        relay.silent = True  # no order reaches the other vehicle late
        simulator.vanish()
        time.sleep(draw.choice((0.3, draw.uniform(0.3, 5.0))))
        return simulator.replace(draw)
    at = time.monotonic()
    if kind == "joystick":
        relay.hold(lambda: dialect.MAVLink_manual_control_message(simulator.system, 700, 0, 500, 0, 0))
    elif kind in ("sticks", "throttle"):
        pulses[:] = [1800, 1200, 1500 if kind == "sticks" else 1000, 1500]
        with contextlib.suppress(TimeoutError):
            wait(lambda: search.process.poll() is not None, 12)
        pulses[2] = 1500  # at last
    else:
        search.process.send_signal(signal.SIGINT)
    return at


def pause(simulator: Simulator, search: Program, draw: random.Random) -> float:
    """Stop the search for a while, in which the pilot chooses a mode. Returns the time."""
    for message in MUCH:  # 20 kB/s: after a pause more waits than one read returns, or is lost
        simulator.relay.order(dialect.MAV_CMD_SET_MESSAGE_INTERVAL, message, 8_000)
    time.sleep(draw.uniform(1, 4))
    at, seconds = time.monotonic(), draw.uniform(1.2, 14.0)
    search.process.send_signal(signal.SIGSTOP)
    before = draw.uniform(0.0, seconds)
    time.sleep(before)
    simulator.switch()
    time.sleep(seconds - before)
    search.process.send_signal(signal.SIGCONT)
    return at


def one(options: argparse.Namespace, folder: Path, kind: str, seed: int) -> Flight:
    """Fly in a folder of its own."""
    of_one = folder / f"{options.binary.name}-{kind}-{seed}-{int(time.time())}"
    of_one.mkdir(parents=True)
    of: dict[str, Any] = {"slope": options.slope, "rangefinder": options.rangefinder}
    return fly(options.binary, of_one, kind, seed, options.options, victims=options.victims, model=options.model, **of)


def main(arguments: Sequence[str] | None = None) -> int:
    words = list(sys.argv[1:] if arguments is None else arguments)
    at = words.index("--") if "--" in words else len(words)
    made = parser(
        __doc__,
        runs=(3, "of each kind"),
        seed=(1, "of the first run of each kind"),
        jobs=(1, "flights of the built-in vehicle at a time"),
        victims=(1, "transmitters, all searched for"),
        model=("paper", "of the receiver"),
        slope=(0.0, "ArduPilot: ground that rises to the north, m a metre"),
        rangefinder=(False, "ArduPilot: with one"),
        folder=(Path, "for all files; default: a new one"),
    )
    made.add_argument("binary", type=lambda name: Path(name).resolve())
    made.add_argument("kinds", nargs="*", metavar="KIND", help=f"default {' '.join(PILOTS)}")
    options = made.parse_args(words[:at])
    options.options = words[at + 1 :]
    options.kinds = options.kinds or PILOTS
    if unknown := set(options.kinds) - set(KINDS):
        made.error(f"{unknown.pop()}: no such kind; there are {', '.join(KINDS)}")
    others = options.binary.name != "vehicle"
    if (options.slope or options.rangefinder) and options.binary.name != "arducopter":
        made.error("--slope and --rangefinder are for arducopter")
    if others and (options.jobs > 1 or "other" in options.kinds):
        made.error("--jobs and other are for vehicle, the built-in one")
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))
    folder: Path = options.folder or Path(tempfile.mkdtemp(prefix="flights-"))
    seeds = range(options.seed, options.seed + options.runs)
    every = [(kind, seed) for kind in options.kinds for seed in seeds]
    flown: list[Flight] = []
    if others:
        run_first()
    with ProcessPoolExecutor(options.jobs) as pool:
        for flight in pool.map(partial(one, options, folder), *zip(*every, strict=True)):
            print(flight, flush=True)
            flown.append(flight)
            with (folder / "results.jsonl").open("a") as results:
                print(json.dumps(vars(flight)), file=results)
    bad, late = sum(not flight.good for flight in flown), sum(flight.late for flight in flown)
    print(f"{len(flown)} flights, {bad} bad; {late} orders later than {BOUND_MS} ms")
    return 1 if bad else 0
