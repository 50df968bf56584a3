"""Print the readings of an ARVA receiver, one JSON line for each frame and channel."""

import json
import os
import select
import sys
import time

from firmware_proto import Decoder

port = os.environ.get("ARVA_PORT")
fd = os.open(port, os.O_RDWR | os.O_NOCTTY) if port else sys.stdin.fileno()
decoder = Decoder()
ended = False
while not ended:
    chunk = b""
    if select.select([fd], [], [], 0.05)[0]:
        try:
            chunk = os.read(fd, 4096)
        except OSError:  # unplugged
            chunk = b""
        ended = not chunk
    for frame in decoder.feed(chunk, time.monotonic()):
        for slot, channel in enumerate(frame.channels, 1):
            reading = {"seq": frame.sequence, "slot": slot, "id": channel.id, "zone": int(channel.zone)}
            print(json.dumps(reading | {"d_cm": channel.d, "delta_deg": channel.delta}))
    sys.stdout.flush()
