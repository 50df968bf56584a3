"""Flies searches on ArduPilot's and PX4's simulators, in real time, and judges them by the simulators' own truth.

    python -m tools sitl fly …/build/sitl/bin/arducopter anywhere --runs 10
    python -m tools sitl fly …/build/px4_sitl_default/bin/px4 climb search end pause stop landing -- --height 3

Each flight has a simulator of its own, `run`, `search`, and a relay between search and simulator that notes the time
of each message:

    anywhere  a transmitter within ±30 m. ArduPilot: wind of 5 m/s with gusts, and a GPS whose error walks (1.5 m).
              PX4's own simulator has no wind; its GPS has noise of its own
    climb     the pilot chooses LOITER (PX4: HOLD) in the climb,
    search    2 to 8 s after the search has begun,
    end       50 to 150 ms before it ends, and would land,
    pause     while the process is stopped by SIGSTOP for 14 s
    sticks    roll 1800, pitch 1200, the throttle to its middle; PX4 does not use this radio
    throttle  the same, but the throttle comes to its middle 12 s later (ArduPilot)
    joystick  MANUAL_CONTROL that begins in the search, pitch 70 % (PX4)
    stop      Ctrl-C in the search
    descent   Ctrl-C on the way down by set-points,
    landing   and while it lands
    lie       a sensor lies to the search from a moment in the search on (sitl/lies.py); with a rangefinder
    fence     the vehicle keeps within a fence of 10 m, and the transmitter lies beyond it
    busy      as anywhere, beside two processes that take a core each

`late`: orders and set-points of the search later than the promised bound after the vehicle's report of the pilot's
mode. Each flight has a folder; results.jsonl has all figures. The exit code is 1 after a failed flight. One at a time:
ports are fixed.
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
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from arva_hil.mavlink.codec import command, dialect
from tools.sitl.judge import BEGINS, SILENCE, Buried, Flight, Program, judge
from tools.sitl.lies import LIES, Lie
from tools.sitl.relay import Hands, run_as_others, run_first
from tools.sitl.simulator import HOME, Simulator, wait

WITHIN_M: Final = 30.0
HEIGHT_M: Final = 3.0  # the default
LIMIT_S: Final = 8.0  # of a search that is to end by itself
PATIENCE_S: Final = 420.0
AFTERWARDS_S: Final = 5.0
FREE: Final = ("anywhere", "busy")
KINDS: Final = (*FREE, *SILENCE, "stop", "descent", "landing", "lie", "fence")


def fly(
    binary: Path,
    folder: Path,
    kind: str,
    seed: int,
    options: list[str],
    victims: int = 1,
    model: str = "paper",
    slope: float = 0.0,
    rangefinder: bool = False,
) -> Flight:
    flight = Flight(binary.name, kind, seed, height_m(options), str(folder))
    draw = random.Random(f"{kind} {seed}")
    place = random.Random(f"transmitter {seed}")
    within = (-WITHIN_M, WITHIN_M), (-WITHIN_M, WITHIN_M), (0, 2)
    buried, lines = Buried(), list[str]()
    for id_ in range(1, victims + 1):
        ned = [round(place.uniform(low, high), 2) for low, high in within]
        roll, pitch, yaw = place.uniform(-180, 180), place.uniform(-90, 90), place.uniform(-180, 180)
        if kind in ("descent", "landing"):
            ned = [4.0, 3.0, 0.0]
        elif kind not in FREE:
            ned = [20.0, 15.0, 0.0]
        buried[id_] = ned
        place_of_it = f"ned: {[*ned[:2], 0.0]}, depth_m: {ned[2]}" if slope else f"ned: {ned}"
        lines.append(f"{{id: {id_}, {place_of_it}, attitude: {{roll: {roll}, pitch: {pitch}, yaw: {yaw}}}}}")
    scenario, port = folder / "scenario.yaml", folder / "receiver"
    datum = "home\nterrain: autopilot" if slope else "{{lat: {}, lon: {}, alt: {}}}".format(*HOME)
    scenario.write_text(
        f"spec: 2\nseed: {seed}\ndatum: {datum}\ntransmitters: [{', '.join(lines)}]\nreceiver: {{model: {model}}}\n"
    )
    options = [*options, "--victims", str(victims)]
    if kind == "end":
        options = [*options, "--limit", f"{LIMIT_S:g}", "--area=0,-1,40,1"]
    stack = contextlib.ExitStack()
    with stack:
        simulator = Simulator(binary, folder, kind, seed, slope, rangefinder or kind == "lie")
        stack.callback(simulator.close)
        for _ in range(2 if kind == "busy" else 0):
            burner = subprocess.Popen([sys.executable, "-c", "while True: pass"], preexec_fn=run_as_others)
            stack.callback(burner.kill)
        emulator = Program(
            *(folder, "run", "--scenario", scenario, "--record", folder / "record", "--timeout", 60),
            *("--autopilot", simulator.telemetry, "--port", f"pty:{port}"),
        )
        stack.callback(emulator.close)
        emulator.says("frames to")
        search = Program(
            *(folder, "search", "--json", "--timeout", 90, "--arm-timeout", 120, "--record", folder / "record"),
            *("--autopilot", simulator.relay.url, "--receiver", port, *options),
        )
        stack.callback(search.close)
        try:
            acted = act(kind, simulator, search, draw)
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
        judge(flight, simulator, search, acted, buried)
    return flight


def act(kind: str, simulator: Simulator, search: Program, draw: random.Random) -> float | None:
    """What the pilot does, and whoever else; when."""
    relay = simulator.relay

    def sleep(seconds: float) -> None:
        time.sleep(max(0.0, seconds))

    def switch() -> float:
        now, mode = time.monotonic(), simulator.pilots
        main, sub = (mode, 0) if simulator.copter else (mode >> 16 & 255, mode >> 24)
        relay.say(command(simulator.system, 1, dialect.MAV_CMD_DO_SET_MODE, 1, main, sub))
        return now

    if kind in ("sticks", "throttle"):
        pulses = [1500, 1500, 1000, 1500]  # with any other throttle ArduPilot does not arm
        radio = dialect.MAVLink_rc_channels_override_message
        Hands(relay, lambda: radio(simulator.system, 1, *pulses, 0, 0, 0, 0))
        search.says(BEGINS)
        sleep(draw.uniform(2, 6))
        pulses[:] = [1800, 1200, 1500 if kind == "sticks" else 1000, 1500]
        at = time.monotonic()
        with contextlib.suppress(TimeoutError):
            wait(lambda: search.process.poll() is not None, 12)
        if search.process.poll() is None:
            pulses[2] = 1500  # at last
        return at
    if kind == "joystick":
        search.says(BEGINS)
        sleep(draw.uniform(2, 6))
        Hands(relay, lambda: dialect.MAVLink_manual_control_message(simulator.system, 700, 0, 500, 0, 0))
        return time.monotonic()
    if kind == "climb":
        top = draw.uniform(0.3, 2.2)
        wait(lambda: (relay.armed and relay.height > top) or search.process.poll() is not None, 200)
        return switch()
    if kind in FREE:
        search.says("climbing", 200)
        if simulator.weather:
            simulator.weather.begun = True
        return None
    begun = search.says(BEGINS, 200)
    if kind == "fence":
        return None
    if kind == "lie":
        sleep(draw.uniform(1, 12))
        relay.lie = Lie(draw.choice(LIES))
        print(f"lie: {relay.lie.name}, {time.monotonic() - begun:.1f} s after the search began", flush=True)
        return None
    if kind == "search":
        sleep(draw.uniform(2, 8))
        return switch()
    if kind == "end":
        sleep(begun + LIMIT_S - draw.uniform(0.05, 0.15) - time.monotonic())
        return switch()
    if kind == "pause":
        sleep(draw.uniform(1, 4))
        at = time.monotonic()
        search.process.send_signal(signal.SIGSTOP)
        before = draw.uniform(1, 13)
        sleep(before)
        switch()
        sleep(14 - before)
        search.process.send_signal(signal.SIGCONT)
        return at
    if kind == "stop":
        sleep(draw.uniform(2, 8))
    else:
        search.says("coming down onto" if kind == "descent" else "; landing")
        sleep(draw.uniform(0.5, 2.5))
    search.process.send_signal(signal.SIGINT)
    return time.monotonic()


def height_m(options: list[str]) -> float:
    """Asked for."""
    return float(options[options.index("--height") + 1]) if "--height" in options else HEIGHT_M


def flights(options: argparse.Namespace) -> Iterator[Flight]:
    folder = Path(options.folder or tempfile.mkdtemp(prefix="flights-"))
    for kind in options.kinds:
        for seed in range(options.seed, options.seed + options.runs):
            of_one = folder / f"{options.binary.name}-{kind}-{seed}-{int(time.time())}"
            of_one.mkdir(parents=True)
            ground = options.slope, options.rangefinder
            flight = fly(options.binary, of_one, kind, seed, options.options, options.victims, options.model, *ground)
            with (folder / "results.jsonl").open("a") as results:
                print(json.dumps(vars(flight)), file=results)
            yield flight


def main() -> int:
    arguments = sys.argv[1:]
    ours, theirs = arguments, []
    if "--" in arguments:
        at = arguments.index("--")
        ours, theirs = arguments[:at], arguments[at + 1 :]
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("binary", type=lambda name: Path(name).resolve())
    parser.add_argument("kinds", nargs="+", choices=KINDS)
    parser.add_argument("--runs", type=int, default=3, metavar="N", help="of each kind; default 3")
    parser.add_argument("--seed", type=int, default=1, help="of the first run of each kind")
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))
    parser.add_argument("--victims", type=int, default=1, metavar="N", help="transmitters, all searched for; default 1")
    parser.add_argument("--model", default="paper", help="of the receiver; default paper")
    parser.add_argument(
        "--slope", type=float, default=0.0, metavar="M", help="ArduPilot: ground that rises to the north"
    )
    parser.add_argument("--rangefinder", action="store_true", help="ArduPilot: with one")
    parser.add_argument("--folder", help="for all files; default: a new one")
    options = parser.parse_args(ours)
    options.options = theirs
    if (options.slope or options.rangefinder) and options.binary.name != "arducopter":
        parser.error("--slope and --rangefinder are for arducopter")
    good = True
    run_first()
    for flight in flights(options):
        print(flight, flush=True)
        good = good and flight.good
    return 0 if good else 1
