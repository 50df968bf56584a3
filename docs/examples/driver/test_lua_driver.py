"""Test a Lua driver in ArduPilot's simulator (SITL): its receiver is emulated, its messages are read over MAVLink.

ARDUCOPTER=~/ardupilot/build/sitl/bin/arducopter python -m pytest test_lua_driver.py
"""

import os
import shlex
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from pymavlink import mavutil

import firmware_proto
from arva_hil import Bench

ARDUCOPTER = os.environ.get("ARDUCOPTER", "")
DRIVER = Path(firmware_proto.__file__).parent / "ardupilot" / "arva_receiver.lua"
PARAMETERS = "SCR_ENABLE 1\nSERIAL5_PROTOCOL 28\n"
DEADLINE_S = 60


def receive(link: Any, kind: str, condition: str) -> Any:
    message = link.recv_match(type=kind, condition=condition, blocking=True, timeout=DEADLINE_S)
    assert message is not None, f"no {condition} within {DEADLINE_S} s"
    return message


@pytest.mark.skipif(not ARDUCOPTER, reason="ARDUCOPTER names no simulator")
def test_the_driver_reports_d_and_then_silence(arva_bench_factory: Callable[..., Bench], tmp_path: Path) -> None:
    (tmp_path / "scripts").mkdir()
    shutil.copy(DRIVER, tmp_path / "scripts")
    (tmp_path / "my.parm").write_text(PARAMETERS)
    bench = arva_bench_factory(clock="real")
    bench.place_vehicle(north=15, east=5, down=-2)
    link = mavutil.mavlink_connection("udpin:127.0.0.1:0")
    copter = [*shlex.split(ARDUCOPTER), "--model", "quad", "--defaults", "my.parm"]
    copter += ["--serial0", f"udpclient:127.0.0.1:{link.port.getsockname()[1]}", "--serial5", f"uart:{bench.port}"]
    with subprocess.Popen(copter, cwd=tmp_path, stdout=subprocess.DEVNULL) as simulator:
        try:
            receive(link, "HEARTBEAT", "True")
            link.mav.heartbeat_send(6, 8, 0, 0, 0)  # it sends texts and values to ground stations alone
            distance = "NAMED_VALUE_FLOAT.name == 'ARVA1_D' and NAMED_VALUE_FLOAT.value"
            reading = receive(link, "NAMED_VALUE_FLOAT", f"{distance} > 0")
            assert abs(reading.value / 100 - bench.truth().ranges_m[1]) < 1
            bench.inject("transmitter_off=1")
            receive(link, "NAMED_VALUE_FLOAT", f"{distance} <= 0")
        finally:
            simulator.kill()
            link.close()
