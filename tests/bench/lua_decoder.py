"""The Lua decoder of the ArduPilot driver as a program for `conform`: lua_decoder.py FOLDER_OF_THE_SCRIPT."""

from __future__ import annotations

import json
import os
import select
import sys
import time
from pathlib import Path

from tests.firmware_proto.lua_stubs import Autopilot, LuaDecoder


def main() -> None:
    decoder = LuaDecoder(Autopilot(Path(sys.argv[1])))
    ended = False
    while not ended:
        chunk = b""
        if select.select([0], [], [], 0.05)[0]:
            chunk = os.read(0, 4096)
            ended = not chunk
        for frame in decoder.feed(chunk, time.monotonic()):
            for slot, c in enumerate(frame.channels, 1):
                reading = {"seq": frame.sequence, "slot": slot, "id": c.id, "zone": c.zone}
                print(json.dumps(reading | {"d_cm": c.d, "delta_deg": c.delta}))
        sys.stdout.flush()


main()
