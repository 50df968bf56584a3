"""Compares the readings of the Lua driver on ArduPilot's simulator with Python's, reading for reading.

    python -m tools sitl victim …/build/sitl/bin/arducopter lua can

    lua   arva_victim.lua computes the readings on the autopilot
    can   `arva-hil run` computes them, and sends them through DroneCAN's serial tunnel on the simulator's CAN bus

ArduCopter flies a wide circle and turns. Readings are the driver's NAMED_VALUE_FLOAT messages. Those of the script are
compared with the paper's receiver in Python, at the pose that the autopilot reported for the same instant; the script
reads its pose up to 10 ms earlier. Those over CAN have to be the frames of the emulator's record. The exit code is 1 if
a reading is missing, differs by more than 10 cm or 2°, or is no frame of the record.
"""

from __future__ import annotations

import argparse
import contextlib
import math
import random
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from arva_hil.mavlink.codec import command, dialect
from arva_hil.model.field import LocalFrame, rotation
from arva_hil.model.field.dipole import field_of
from arva_hil.model.receiver.paper import outputs
from arva_hil.records.reading import load
from tools.fly_lua import SCRIPTS, take_off
from tools.sitl.judge import Program
from tools.sitl.relay import run_first
from tools.sitl.simulator import Simulator

SECONDS: Final = 150.0
SPEED: Final = 1.5  # m/s
TURN: Final = 0.12  # rad/s, of the path and of the vehicle
MOST_CM: Final = 10
MOST_DEG: Final = 2
KAPPA_EQ: Final = 1.542
PARAMETERS: Final = {
    "lua": "SCR_ENABLE 1\nSCR_SDEV_EN 1\nSCR_SDEV1_PROTO 28\n",
    "can": "SCR_ENABLE 1\nCAN_P1_DRIVER 1\nCAN_D1_PROTOCOL 1\nCAN_D1_UC_SER_EN 1\n"
    "CAN_D1_UC_S1_NOD 42\nCAN_D1_UC_S1_IDX 0\nCAN_D1_UC_S1_PRO 28\n",
}
WANTED: Final = {
    dialect.MAVLINK_MSG_ID_ATTITUDE: 20_000,
    dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED: 20_000,
    dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 200_000,
    dialect.MAVLINK_MSG_ID_HOME_POSITION: 1_000_000,
    dialect.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN: 1_000_000,
}
"""Messages and their intervals [µs]."""

VELOCITY_AND_YAW_RATE: Final = 0b010111000111  # type_mask of a set-point


class Victim(NamedTuple):
    """A transmitter: metres NED from home, degrees."""

    north: float
    east: float
    down: float
    yaw: float
    pitch: float


def fly(binary: Path, folder: Path, source: str, seed: int) -> bool:
    """Fly one source, and print the differences. Returns True if there are none."""
    draw = random.Random(f"victim {seed}")
    victim = Victim(*(round(draw.uniform(*ends), 1) for ends in ((8, 20), (-8, 8), (0, 2), (-90, 90), (-60, 60))))
    (folder / "scripts").mkdir()
    for name in ("arva_receiver.lua", "arva_victim.lua")[: 2 if source == "lua" else 1]:
        shutil.copy(SCRIPTS / name, folder / "scripts")
    with contextlib.ExitStack() as stack:
        simulator = Simulator(binary, folder, "victim", seed, parameters=PARAMETERS[source])
        stack.callback(simulator.close)
        if source == "can":
            emulator = _emulator(folder, simulator, victim)
            stack.callback(emulator.close)
        else:
            real = dialect.MAV_PARAM_TYPE_REAL32
            for name, value in victim._asdict().items():
                key = f"ARVV_{name.upper()}".encode()
                simulator.relay.say(dialect.MAVLink_param_set_message(1, 1, key, value, real))
        begun = _circle(simulator)
        if source == "can":
            emulator.process.send_signal(signal.SIGINT)
            emulator.process.wait(20)
        down = [note for note in simulator.relay.notes if not note.up]
    messages = [note.message for note in down]
    readings = np.array(list(_readings([note.message for note in down if note.time_s > begun])))
    return told_can(folder, readings) if source == "can" else told_lua(victim, messages, readings)


def _emulator(folder: Path, simulator: Simulator, victim: Victim) -> Program:
    north, east, down, yaw, pitch = victim
    scenario = folder / "scenario.yaml"
    scenario.write_text(
        f"spec: 2\nreceiver: {{noise: {{kind: off}}}}\ntransmitters: [{{id: 1, ned: [{north}, {east}, {down}], "
        f"attitude: {{roll: 0, pitch: {pitch}, yaw: {yaw}}}}}]\n"
    )
    emulator = Program(
        *(folder, "run", "--scenario", scenario, "--record", folder / "record", "--timeout", 60),
        *("--autopilot", simulator.telemetry, "--port", "can:SERIAL0,node=42,bus=mcast:0"),
    )
    emulator.says("readings are real")
    return emulator


def _circle(simulator: Simulator) -> float:
    """Take off, and fly a circle for SECONDS. Returns the time of its begin."""
    relay = simulator.relay
    for kind, interval_us in WANTED.items():
        relay.say(command(1, 1, dialect.MAV_CMD_SET_MESSAGE_INTERVAL, kind, interval_us))
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


def told_lua(victim: Victim, messages: list[Any], readings: Any) -> bool:
    """Print the differences. Returns True if they are small, and no reading is missing."""
    time_s, d_cm, delta_deg = readings.T
    expected_cm, expected_deg = _expected(victim, messages, time_s)
    off_cm = np.abs(d_cm - expected_cm)
    off_deg = np.abs((delta_deg - expected_deg + 90) % 180 - 90)
    print(
        f"lua: {len(d_cm)} readings, d {d_cm.min():.0f} to {d_cm.max():.0f} cm; equal d {(off_cm == 0).sum()}, "
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


def _expected(victim: Victim, messages: list[Any], time_s: Any) -> tuple[Any, Any]:
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
    axis = rotation.to_matrix(rotation.from_euler(0.0, *np.radians([victim.pitch, victim.yaw])))[:, 0]
    place = np.array(victim[:3])
    h = field_of(position[:, None], place[:, None, None], axis[:, None, None] / (4 * math.pi))[:, 0]
    body = rotation.to_matrix(rotation.from_euler(roll, pitch, yaw))
    d_cm, delta_deg, _ = outputs(np.einsum("nij,in->nj", body, h), KAPPA_EQ)
    return d_cm, delta_deg


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("binary", type=lambda name: Path(name).resolve())
    parser.add_argument("sources", nargs="+", choices=tuple(PARAMETERS))
    parser.add_argument("--seed", type=int, default=1, help="of the transmitter's place")
    options = parser.parse_args()
    run_first()
    good = [
        fly(options.binary, Path(tempfile.mkdtemp(prefix=f"victim-{source}-")), source, options.seed)
        for source in options.sources
    ]
    return 0 if all(good) else 1


if __name__ == "__main__":
    sys.exit(main())
