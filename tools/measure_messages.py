"""Prints what ROS 2 messages cost: one frame's in processor time, a record as MCAP, and the schedule with --foxglove.

    python tools/measure_messages.py [--seconds 30] [--readings 1000000]

The schedule is that of `arva-hil run` at 50 Hz with the built-in vehicle on UDP: alone, with a server without clients,
with 10 clients that subscribe to everything and never read, and with 3 that do read.
"""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import io
import json
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Subprotocol

from arva_hil.links.udp import UdpInLink
from arva_hil.records.reading import Recording, load
from arva_hil.records.ros_messages.cdr import encode
from arva_hil.records.ros_messages.recorded import messages_of
from arva_hil.registry import EXPORTS

COMMAND = [sys.executable, "-m", "arva_hil"]
SPOKEN = Subprotocol("foxglove.sdk.v1")
RATE_HZ = 50
LEAST = 100  # frames: of fewer, p99 is the worst one


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=30.0, help="of each schedule; default 30")
    parser.add_argument("--readings", type=int, default=1_000_000, help="of the record; default 1000000")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for what, stalled, reading, served in (
            ("without --foxglove", 0, 0, False),
            ("--foxglove, no client", 0, 0, True),
            ("--foxglove, 10 clients that never read", 10, 0, True),
            ("--foxglove, 3 clients that read", 0, 3, True),
        ):
            run = folder / what.replace(" ", "-")
            cpu_s, ending_s = measure_schedule(run, options.seconds, stalled, reading, served)
            late_ms = load(run).receivers[0].late_ms[RATE_HZ:]
            if len(late_ms) < LEAST:
                sys.exit(f"{what}: {len(late_ms)} frames after the first second, {LEAST} are needed: more --seconds")
            p50, p99 = np.nanpercentile(late_ms, [50, 99])
            share = 100 * cpu_s / options.seconds
            print(f"{what}: lateness median {p50:.2f} ms, p99 {p99:.2f} ms; {share:.1f} % of a core; ", end="")
            print(f"ends in {1e3 * ending_s:.0f} ms")
        measure_record(load(run), options.readings)


def measure_schedule(run: Path, seconds: float, stalled: int, reading: int, served: bool) -> tuple[float, float]:
    """Processor time of the emulator, and how long it took to end."""
    with contextlib.closing(UdpInLink()) as free:
        port = free.port
    vehicle = subprocess.Popen([*COMMAND, "vehicle", "--link", f"udpout:127.0.0.1:{port}"], stderr=subprocess.DEVNULL)
    words = ["run", "--autopilot", f"udpin:127.0.0.1:{port}", "--port", "pty", "--rate", str(RATE_HZ)]
    emulator = subprocess.Popen(
        [*COMMAND, *words, "--record", str(run), *(["--foxglove", "0"] if served else [])],
        stderr=subprocess.PIPE,
        text=True,
    )
    assert emulator.stderr is not None
    try:
        where = next(line for line in emulator.stderr if "Foxglove" in line).split()[-1] if served else ""
        threading.Thread(target=emulator.stderr.read, daemon=True).start()
        with contextlib.ExitStack() as stack:
            clients = [stack.enter_context(subscribed(where)) for _ in range(stalled + reading)]
            for client in clients[stalled:]:
                threading.Thread(target=lambda client=client: list(client), daemon=True).start()
            before = cpu(emulator.pid)
            time.sleep(seconds)
            used = cpu(emulator.pid) - before
            told = time.monotonic()
            emulator.send_signal(signal.SIGINT)
            emulator.wait(60)
            return used, time.monotonic() - told
    finally:
        for process in (emulator, vehicle):
            process.kill()
            process.wait()


@contextlib.contextmanager
def subscribed(where: str) -> Iterator[ClientConnection]:
    """A client of all channels; it reads nothing more."""
    with connect(where, subprotocols=[SPOKEN], max_queue=1, close_timeout=0.1) as client:
        channels = []
        while not channels:
            said = client.recv()
            channels = json.loads(said).get("channels", []) if isinstance(said, str) else []
        ids = [{"id": channel["id"], "channelId": channel["id"]} for channel in channels]
        client.send(json.dumps({"op": "subscribe", "subscriptions": ids}))
        yield client


def cpu(pid: int) -> float:
    """Processor time of a process so far, s."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def measure_record(recording: Recording, readings: int) -> None:
    """A record of so many readings, made of the frames of one."""
    (receiver,) = recording.receivers
    slots = len(receiver.id)
    times = -(-readings // slots)
    columns = {
        field.name: np.concatenate([value] * times)
        for field in dataclasses.fields(receiver)
        if isinstance(value := getattr(receiver, field.name), np.ndarray)
    }
    begins = [receiver.begins[:-1] + n * slots for n in range(times)]
    columns["begins"] = np.concatenate([*begins, [times * slots]])
    columns["time_s"] = np.arange(len(columns["time_s"])) / RATE_HZ
    large = dataclasses.replace(recording, receivers=(dataclasses.replace(receiver, **columns),))
    frames = len(columns["time_s"])
    begun = time.process_time()
    for publication in messages_of(dataclasses.replace(recording)):
        encode(publication.message)
    each_us = 1e6 * (time.process_time() - begun) / len(receiver)
    print(f"messages of one frame, made and encoded: {each_us:.0f} µs")
    out = io.BytesIO()
    begun = time.process_time()
    EXPORTS["mcap"](large, out)
    seconds = time.process_time() - begun
    size = out.getbuffer().nbytes
    print(f"MCAP of {times * slots} readings ({frames} frames): {seconds:.1f} s, {size / 1e6:.0f} MB")


if __name__ == "__main__":
    main()
