"""Flies the Lua search on ArduPilot's simulator, in real time, and judges it by the simulator's own truth.

    python -m tools sitl lua …/build/sitl/bin/arducopter --runs 10 [--slope 0.3] [--rangefinder]

A transmitter within ±15 m lies in any attitude, up to 2 m deep; wind of 7 m/s with gusts, no GPS error. For each
flight: the script's last message, the true error of its place, the lowest true height above the ground from the start
of the search to its end, and its time. The exit code is 1 if a flight found nothing.
"""

from __future__ import annotations

import argparse
import contextlib
import math
import random
import re
import shutil
import tempfile
import time
from pathlib import Path
from typing import Any, Final

from arva_hil.mavlink.codec import command, dialect
from arva_hil.model.field import LocalFrame
from tools.sitl.judge import Program
from tools.sitl.relay import Relay, run_first
from tools.sitl.simulator import HOME, Simulator, wait

SCRIPTS: Final = Path(__file__).parents[1] / "firmware_proto" / "ardupilot"
WITHIN_M: Final = 15.0
START_M: Final = 3.0
PATIENCE_S: Final = 600.0
GUIDED: Final = 4
ENDS: Final = ("found ", "search ends", "cannot search")


def fly(binary: Path, folder: Path, seed: int, slope: float, rangefinder: bool) -> bool:
    draw = random.Random(f"lua {seed}")
    north, east, deep = draw.uniform(-WITHIN_M, WITHIN_M), draw.uniform(-WITHIN_M, WITHIN_M), draw.uniform(0, 2)
    turned = draw.uniform(-180, 180), draw.uniform(-90, 90), draw.uniform(-180, 180)
    scenario, receiver = folder / "scenario.yaml", folder / "receiver"
    scenario.write_text(
        "spec: 2\n"
        + ("datum: home\nterrain: autopilot\n" if slope else "datum: {{lat: {}, lon: {}, alt: {}}}\n".format(*HOME))
        + f"transmitters: [{{id: 1, ned: [{north}, {east}, {0 if slope else deep}], "
        + (f"depth_m: {deep}, " if slope else "")
        + "attitude: {{roll: {}, pitch: {}, yaw: {}}}}}]\n".format(*turned)
    )
    (folder / "scripts").mkdir()
    for script in SCRIPTS.glob("*.lua"):
        shutil.copy(script, folder / "scripts")
    with contextlib.ExitStack() as stack:
        port = 5760 + 10 * 7 + 2  # Simulator.telemetry
        emulator = Program(
            *(folder, "run", "--scenario", scenario, "--timeout", 120),
            *("--autopilot", f"tcp:127.0.0.1:{port}", "--port", f"pty:{receiver}"),
        )
        stack.callback(emulator.close)
        wait(receiver.exists, 30)
        simulator = Simulator(binary, folder, "lua", seed, slope, rangefinder, receiver)
        stack.callback(simulator.close)
        relay = simulator.relay
        emulator.says("readings are real")

        def text(begins: tuple[str, ...]) -> str:
            notes: list[Any] = [note.message for note in relay.notes if not note.up]
            said = [n.text for n in notes if type(n).id == dialect.MAVLINK_MSG_ID_STATUSTEXT]
            return next((line for line in said if any(word in line for word in begins)), "")

        wanted = dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT
        relay.say(command(1, 1, dialect.MAV_CMD_SET_MESSAGE_INTERVAL, wanted, 200_000))
        take_off(relay)
        assert simulator.weather is not None
        simulator.weather.begun = True
        begun = time.monotonic()
        relay.say(dialect.MAVLink_param_set_message(1, 1, b"ARVS_ENABLE", 1.0, dialect.MAV_PARAM_TYPE_REAL32))
        with contextlib.suppress(TimeoutError):
            wait(lambda: text(ENDS), PATIENCE_S)
        ended = time.monotonic()
        how = text(ENDS) or "no end"
        places = [place for place in simulator.places if begun <= place.time_s <= ended]
        error, lowest = math.nan, min(simulator.heights(places))
        if found := re.search(r"found \d+ at (\S+) (\S+)", how):
            lat, lon = map(float, found.groups())
            there = LocalFrame(*HOME).ned_of(lat, lon, HOME[2])
            error = math.dist(there[:2], (north, east))
    print(f"{seed:4}  error {error:5.2f} m  lowest {lowest:5.2f} m  {ended - begun:4.0f} s  {how}", flush=True)
    return error < math.inf


def take_off(relay: Relay) -> None:
    """Arm ArduCopter in GUIDED, and climb to START_M."""
    relay.say(command(1, 1, dialect.MAV_CMD_DO_SET_MODE, 1, GUIDED))
    wait(lambda: relay.mode == GUIDED, 10)
    for _ in range(20):
        relay.say(command(1, 1, dialect.MAV_CMD_COMPONENT_ARM_DISARM, 1))
        with contextlib.suppress(TimeoutError):
            wait(lambda: relay.armed, 3)
            break
    relay.say(command(1, 1, dialect.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, START_M))
    wait(lambda: relay.height > START_M - 0.3, 40)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("binary", type=lambda name: Path(name).resolve())
    parser.add_argument("--runs", type=int, default=3, metavar="N", help="default 3")
    parser.add_argument("--seed", type=int, default=1, help="of the first run")
    parser.add_argument(
        "--slope", type=float, default=0.0, metavar="M", help="ground that rises to the north, m a metre"
    )
    parser.add_argument("--rangefinder", action="store_true", help="the vehicle has one")
    options = parser.parse_args()
    found = []
    run_first()
    for seed in range(options.seed, options.seed + options.runs):
        folder = Path(tempfile.mkdtemp(prefix="lua-"))
        found.append(fly(options.binary, folder, seed, options.slope, options.rangefinder))
    return 0 if all(found) else 1
