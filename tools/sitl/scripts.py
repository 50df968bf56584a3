"""Runs the Lua scripts on ArduPilot's simulator, in real time, and judges them by its truth and by Python.

    python -m tools sitl lua …/build/sitl/bin/arducopter search --runs 10 [--slope 0.3] [--rangefinder]
    python -m tools sitl lua …/build/sitl/bin/arducopter victim can

    search  the Lua search, to a transmitter within ±15 m in any attitude, up to 2 m deep; wind of 7 m/s with gusts, no
            GPS error. Prints its true error, its least true height above the ground, its time and its last message
    victim  arva_victim.lua computes the readings on the autopilot
    can     `arva-hil run` computes them, and sends them through DroneCAN's serial tunnel on the simulator's CAN bus

For victim and can ArduCopter flies a wide circle and turns. Readings are the driver's NAMED_VALUE_FLOAT messages. Those
of the script are compared with the paper's receiver in Python, at the pose that the autopilot reported for the same
instant; the script reads its pose up to 10 ms earlier. Those over CAN have to be the frames of the emulator's record.
The exit code is 1 if a search found nothing, or a reading is missing, differs by more than 10 cm or 2°, or is no frame
of the record.
"""

from __future__ import annotations

import contextlib
import json
import math
import re
import shutil
import signal
import tempfile
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from arva_hil.campaign.plan import draw
from arva_hil.config import Scenario, Transmitter, to_dict
from arva_hil.config.campaign import Random
from arva_hil.config.receiver import Noise
from arva_hil.emulator.build import moving_transmitters
from arva_hil.mavlink.codec import dialect
from arva_hil.model.field import LocalFrame, rotation
from arva_hil.model.receiver import Antennas, maps
from arva_hil.records.reading import load
from tools.options import parser
from tools.sitl.fly import placed
from tools.sitl.judge import Program, off
from tools.sitl.relay import Relay, Weather, run_first
from tools.sitl.simulator import ArduCopter, wait

SCRIPTS: Final = Path(__file__).parents[2] / "firmware_proto" / "ardupilot"
WITHIN_M: Final = 15.0
START_M: Final = 3.0
PATIENCE_S: Final = 600.0
ARRIVES_S: Final = 20.0  # after the place is found, the vehicle flies there
GUIDED: Final = 4
ENDS: Final = ("found ", "search ends", "cannot search")
SECONDS: Final = 150.0
SPEED: Final = 1.5  # m/s
TURN: Final = 0.12  # rad/s, of the path and of the vehicle
MOST_CM: Final = 10
MOST_DEG: Final = 2
PARAMETERS: Final = {
    "victim": "SCR_ENABLE 1\nSCR_SDEV_EN 1\nSCR_SDEV1_PROTO 28\n",
    "can": "SCR_ENABLE 1\nCAN_P1_DRIVER 1\nCAN_D1_PROTOCOL 1\nCAN_D1_UC_SER_EN 1\n"
    "CAN_D1_UC_S1_NOD 42\nCAN_D1_UC_S1_IDX 0\nCAN_D1_UC_S1_PRO 28\n",
}
COPIED: Final = {"search": "arva_[rs]*.lua", "victim": "arva_[rv]*.lua", "can": "arva_receiver.lua"}
WANTED: Final = {
    dialect.MAVLINK_MSG_ID_ATTITUDE: 20_000,
    dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED: 20_000,
    dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 200_000,
    dialect.MAVLINK_MSG_ID_HOME_POSITION: 1_000_000,
    dialect.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN: 1_000_000,
}
"""Messages and their intervals [µs]."""

VELOCITY_AND_YAW_RATE: Final = 0b010111000111  # type_mask of a set-point


def search(binary: Path, folder: Path, seed: int, slope: float, rangefinder: bool) -> bool:
    """Fly the Lua search, and print the result. Returns True if it found a place."""
    scenario, receiver = placed(draw(Random(WITHIN_M), seed), slope), folder / "receiver"
    with contextlib.ExitStack() as stack:
        port = "tcp:127.0.0.1:5832"  # of the simulator, which starts when the receiver is there
        stack.enter_context(emulated(folder, scenario, port, f"pty:{receiver}"))
        wait(receiver.exists, 30)
        ground: dict[str, Any] = {"slope": slope, "rangefinder": rangefinder}
        simulator = ArduCopter(binary, folder, weather=Weather(seed, 7.0, 0.0), receiver=receiver, **ground)
        stack.callback(simulator.close)
        relay = simulator.relay

        def text() -> str:
            notes: list[Any] = [note.message for note in relay.notes if not note.up]
            said = [n.text for n in notes if type(n).id == dialect.MAVLINK_MSG_ID_STATUSTEXT]
            return next((line for line in said if any(word in line for word in ENDS)), "")

        wanted = dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT
        relay.order(dialect.MAV_CMD_SET_MESSAGE_INTERVAL, wanted, 200_000)
        take_off(relay)
        assert relay.weather is not None
        relay.weather.begun = True
        begun = time.monotonic()
        relay.set("ARVS_ENABLE", 1.0)
        with contextlib.suppress(TimeoutError):
            wait(text, PATIENCE_S)
        took_s = time.monotonic() - begun
        time.sleep(ARRIVES_S if "found " in text() else 0.0)
        ended = time.monotonic()
        lowest = min(simulator.heights([place for place in relay.places if begun <= place.time_s <= ended]))
        how, error = text() or "no end", math.nan
        if found := re.search(r"found \d+ at (\S+) (\S+)", how):
            lat, lon = map(float, found.groups())
            error = off(lat, lon, {one.id: one.ned or () for one in scenario.transmitters})
    print(f"{seed:4}  error {error:5.2f} m  lowest {lowest:5.2f} m  {took_s:4.0f} s  {how}", flush=True)
    return error < math.inf


def circle(binary: Path, folder: Path, source: str, seed: int) -> bool:
    """Fly a circle beside a transmitter, and print the differences. Returns True if there are none."""
    (drawn,) = draw(Random(area_m=(8.0, -8.0, 20.0, 8.0)), seed).transmitters
    victim = replace(drawn, attitude=(0.0, drawn.attitude[1] * 2 / 3, drawn.attitude[2] / 2))
    with contextlib.ExitStack() as stack:
        simulator = ArduCopter(binary, folder, parameters=PARAMETERS[source])
        stack.callback(simulator.close)
        relay = simulator.relay
        if source == "can":
            scenario = Scenario((victim,))
            quiet = replace(scenario, receiver=replace(scenario.receiver, noise=Noise("off")))
            bus = "can:SERIAL0,node=42,bus=mcast:0"
            emulator = stack.enter_context(emulated(folder, quiet, simulator.telemetry, bus))
        for name, value in settings(victim).items() if source == "victim" else ():
            relay.set(name, value)
        begun = _circle(relay)
        if source == "can":
            emulator.process.send_signal(signal.SIGINT)
            emulator.process.wait(20)
        down = [note for note in relay.notes if not note.up]
    readings = np.array(list(_readings([note.message for note in down if note.time_s > begun])))
    if source == "can":
        return told_can(folder, readings)
    return told_victim(victim, [note.message for note in down], readings)


@contextlib.contextmanager
def emulated(folder: Path, scenario: Scenario, autopilot: str, port: str) -> Iterator[Program]:
    """The emulator, with the scripts of a simulator in the same folder."""
    file = folder / "scenario.yaml"
    file.write_text(json.dumps(to_dict(scenario)))
    options = "--scenario", file, "--record", folder / "record", "--timeout", 120
    emulator = Program(folder, "run", *options, "--autopilot", autopilot, "--port", port)
    try:
        yield emulator
    finally:
        emulator.close()


def settings(victim: Transmitter) -> dict[str, float]:
    """Return the parameters of the victim's script."""
    assert victim.ned is not None
    _, pitch, yaw = victim.attitude
    names = ("NORTH", "EAST", "DOWN", "YAW", "PITCH")
    return {f"ARVV_{name}": value for name, value in zip(names, (*victim.ned, yaw, pitch), strict=True)}


def take_off(relay: Relay) -> None:
    """Arm ArduCopter in GUIDED, and climb to START_M."""
    relay.order(dialect.MAV_CMD_DO_SET_MODE, 1, GUIDED)
    wait(lambda: relay.mode == GUIDED, 10)
    for _ in range(20):
        relay.order(dialect.MAV_CMD_COMPONENT_ARM_DISARM, 1)
        with contextlib.suppress(TimeoutError):
            wait(lambda: relay.armed, 3)
            break
    relay.order(dialect.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, START_M)
    wait(lambda: relay.height > START_M - 0.3, 40)


def _circle(relay: Relay) -> float:
    """Take off, and fly a circle for SECONDS. Returns the time of its begin."""
    for kind, interval_us in WANTED.items():
        relay.order(dialect.MAV_CMD_SET_MESSAGE_INTERVAL, kind, interval_us)
    take_off(relay)
    begun = time.monotonic()
    while (now := time.monotonic() - begun) < SECONDS:
        velocity = SPEED * math.cos(TURN * now), SPEED * math.sin(TURN * now), 0
        zero, target = (0, 0, 0), dialect.MAVLink_set_position_target_local_ned_message
        relay.say(
            target(0, 1, 1, dialect.MAV_FRAME_LOCAL_NED, VELOCITY_AND_YAW_RATE, *zero, *velocity, *zero, 0, -TURN)
        )
        time.sleep(0.5)
    return begun


def told_can(folder: Path, readings: Any) -> bool:
    """Print how many readings are frames of the record, in order. Returns True if all are, and none is missing."""
    (receiver,) = load(folder / "record").receivers
    d_m, delta_deg, _, _ = receiver.of_transmitter(1)
    there = np.isfinite(d_m)
    frames = np.stack([np.round(100 * d_m[there]), delta_deg[there]], axis=1)
    n = len(readings)
    equal = any(np.array_equal(frames[at : at + n], readings[:, 1:]) for at in range(len(frames) - n + 1))
    print(
        f"can: {n} readings, {'equal to' if equal else 'NOT'} frames of the record, which has {len(frames)}", flush=True
    )
    return equal and n >= SECONDS - 2


def told_victim(victim: Transmitter, messages: list[Any], readings: Any) -> bool:
    """Print the differences. Returns True if they are small, and no reading is missing."""
    time_s, d_cm, delta_deg = readings.T
    expected_cm, expected_deg = _expected(victim, messages, time_s)
    off_cm = np.abs(d_cm - expected_cm)
    off_deg = np.abs((delta_deg - expected_deg + 90) % 180 - 90)
    print(
        f"victim: {len(d_cm)} readings, d {d_cm.min():.0f} to {d_cm.max():.0f} cm; equal d {(off_cm == 0).sum()}, "
        f"at most {off_cm.max():.0f} cm off; equal δ {(off_deg == 0).sum()}, at most {off_deg.max():.0f}° off",
        flush=True,
    )
    return bool(len(d_cm) >= SECONDS - 2 and off_cm.max() <= MOST_CM and off_deg.max() <= MOST_DEG)


def _readings(messages: list[Any]) -> Iterator[tuple[float, float, float]]:
    """Yield time [s], d [cm] and δ [°] of each reading with a signal."""
    d_cm = 0.0
    for message in messages:
        if type(message).id != dialect.MAVLINK_MSG_ID_NAMED_VALUE_FLOAT:
            continue
        if message.name == "ARVA1_D":
            d_cm = message.value
        elif message.name == "ARVA1_DIR" and d_cm > 0:
            yield message.time_boot_ms / 1e3, d_cm, message.value


def _expected(victim: Transmitter, messages: list[Any], time_s: Any) -> tuple[Any, Any]:
    """Return d [cm] and δ [°] of Python's receiver at these times, by the reported poses."""

    def series(kind: int, *names: str) -> Any:
        rows = [(m.time_boot_ms / 1e3, *(getattr(m, name) for name in names)) for m in messages if type(m).id == kind]
        return np.array(rows).T

    def last(kind: int) -> tuple[float, float, float]:
        found = [m for m in messages if type(m).id == kind][-1]
        return found.latitude / 1e7, found.longitude / 1e7, found.altitude / 1e3

    origin, home = last(dialect.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN), last(dialect.MAVLINK_MSG_ID_HOME_POSITION)
    shift = np.array(LocalFrame(*origin).ned(*home))
    at, *places = series(dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED, "x", "y", "z")
    position = np.stack([np.interp(time_s, at, place) for place in places]) - shift[:, None]
    at, *angles = series(dialect.MAVLINK_MSG_ID_ATTITUDE, "roll", "pitch", "yaw")
    roll, pitch, yaw = (np.interp(time_s, at, np.unwrap(angle)) for angle in angles)
    body = rotation.to_matrix(rotation.from_euler(roll, pitch, yaw))
    there = moving_transmitters(Scenario((victim,)), LocalFrame(*home)).at(0.0)
    d_cm, delta_deg, _ = maps.readings(position.T, body, there, Antennas(noise="off"))
    return d_cm[:, 0], delta_deg[:, 0]


def main() -> int:
    made = parser(
        __doc__,
        runs=(1, "of each kind"),
        seed=(1, "of the first run"),
        slope=(0.0, "of the ground, m a metre to the north"),
        rangefinder=(False, "the vehicle has one"),
    )
    made.add_argument("binary", type=lambda name: Path(name).resolve())
    made.add_argument("kinds", nargs="+", choices=("search", *PARAMETERS))
    options = made.parse_args()
    run_first()
    good = []
    for kind in options.kinds:
        for seed in range(options.seed, options.seed + options.runs):
            folder = Path(tempfile.mkdtemp(prefix=f"lua-{kind}-"))
            (folder / "scripts").mkdir()
            for script in SCRIPTS.glob(COPIED[kind]):
                shutil.copy(script, folder / "scripts")
            if kind == "search":
                good.append(search(options.binary, folder, seed, options.slope, options.rangefinder))
            else:
                good.append(circle(options.binary, folder, kind, seed))
    return 0 if all(good) else 1
