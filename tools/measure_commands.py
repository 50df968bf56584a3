"""Send commands to the port of a live run as fast as told, and print what became of them and of the frames.

    python tools/measure_commands.py [--per-second 1000] [--seconds 10] [--rate 50]

The run follows the built-in vehicle over UDP; its port is a pseudo-terminal, and this program is its host.
"""

from __future__ import annotations

import argparse
import json
import os
import select
import subprocess
import sys
import tempfile
import time
import tty
from pathlib import Path

from firmware_proto import Command, Decoder
from firmware_proto.commands import BINARY_HOST

VEHICLE = "127.0.0.1:14771"
PROGRAM = [sys.executable, "-m", "arva_hil"]
START_S = 5.0  # for the run to find the vehicle


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--per-second", type=float, default=1000)
    parser.add_argument("--seconds", type=float, default=10)
    parser.add_argument("--rate", type=float, default=50, help="frames a second")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        duration = START_S + options.seconds + 2
        words = ["--autopilot", f"udpin:{VEHICLE}", "--port", f"pty:{folder / 'port'}", "--rate", str(options.rate)]
        words += ["--record", str(folder / "record"), "--duration", str(duration)]
        with (
            subprocess.Popen(
                [*PROGRAM, "vehicle", "--link", f"udpout:{VEHICLE}"], stderr=subprocess.DEVNULL
            ) as vehicle,
            subprocess.Popen([*PROGRAM, "run", *words], stderr=subprocess.DEVNULL) as run,
        ):
            told = ask(folder / "port", run, options.per_second, options.seconds)
            run.wait()
            vehicle.terminate()
        counters = json.loads((folder / "record" / "run.json").read_text())["counters"]
    names = ("frames", "delivered", "dropped", "latest_s", "commands")
    print(json.dumps({**told, **{name: counters[name] for name in names}}, indent=2))
    return 0


def ask(port: Path, run: subprocess.Popen[bytes], per_second: float, seconds: float) -> dict[str, int]:
    """Be the host until the run ends: what was sent, and what came."""
    deadline = time.monotonic() + 20
    while not port.exists() and time.monotonic() < deadline:
        time.sleep(0.05)
    descriptor = os.open(port, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    tty.setraw(descriptor)
    decoder, answers = Decoder(), BINARY_HOST.answers()
    begin, sent = time.monotonic() + START_S, 0
    while run.poll() is None:
        ready, _, _ = select.select([descriptor], [], [], 0.01)
        try:
            data = os.read(descriptor, 65536) if ready else b""
        except OSError:  # the run has ended
            break
        now = time.monotonic()
        decoder.feed(data, now)
        answers.feed(data, now)
        while sent < per_second * min(now - begin, seconds):
            os.write(descriptor, BINARY_HOST.command(Command(sent % 256, "mark", (1,))))
            sent += 1
    os.close(descriptor)
    return {
        "commands_sent": sent,
        "frames_heard": decoder.good,
        "frames_lost": decoder.lost,
        "bad_crc": decoder.bad_crc,
        "answers_heard": answers.good,
    }


if __name__ == "__main__":
    sys.exit(main())
