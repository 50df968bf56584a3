"""A stand-in for ArduPilot's simulator: it runs scripts/*.lua on the stubs, with a real port and MAVLink over UDP."""

from __future__ import annotations

import select
import sys
import time
from pathlib import Path

from pymavlink import mavutil
from serial import Serial

from tests.firmware_proto.lua_stubs import Autopilot


def main() -> None:
    options = dict(zip(sys.argv[1::2], sys.argv[2::2], strict=True))
    assert "SERIAL5_PROTOCOL 28\n" in Path(options["--defaults"]).read_text(encoding="utf-8")
    ground = mavutil.mavlink_connection(options["--serial0"].replace("udpclient", "udpout"), source_system=1)
    ground.mav.heartbeat_send(2, 3, 0, 0, 0)
    assert ground.recv_match(type="HEARTBEAT", blocking=True, timeout=60)
    (script,) = Path("scripts").glob("*.lua")
    autopilot = Autopilot(script.parent).start(script.stem)
    with Serial(options["--serial5"].removeprefix("uart:"), timeout=0) as port:
        first_ms = autopilot.time_ms - time.monotonic() * 1000
        while True:
            select.select([port], [], [], 0.02)
            autopilot.receive(port.read(4096))
            autopilot.run(round(first_ms + time.monotonic() * 1000))
            for name, value in autopilot.floats:
                ground.mav.named_value_float_send(autopilot.time_ms, name.encode(), value)
            autopilot.floats.clear()


main()
