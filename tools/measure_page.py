"""Prints what the page costs: lateness of frames, processor time and memory with 20 pages and under attack.

    python tools/measure_page.py [--seconds 20] [--pages 20] [--first]

It also prints the size of the page and the time to the first picture.

`arva-hil vehicle` and `arva-hil run` at 50 Hz are processes of their own; lateness is that of the record. The runs
with and without pages go on at the same time, so that whatever else the machine does delays them alike. A page asks for
what is new five times a second, on a connection that stays open, as a browser does. The first picture is that of
Chromium, if Playwright and Chromium are there.

The attacks come one after another, on `--web`, and on `--foxglove` if foxglove-sdk is installed. Each comes from 128
connections of a process with low priority, as fast as it can:

- headers: request headers without an end, in lines of 65 kB
- bytes: request headers without an end, one byte at a time
- documents: requests for everything there is, without reading the answers
- connections: connections that are closed at once
"""

from __future__ import annotations

import argparse
import csv
import functools
import http.client
import importlib.util
import json
import multiprocessing
import os
import selectors
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Mapping
from contextlib import closing
from pathlib import Path
from typing import cast
from urllib.parse import urlsplit

import numpy as np

from arva_hil.links.udp import UdpInLink
from arva_hil.observers.web.server import pages

COMMAND = [sys.executable, "-m", "arva_hil"]
RATE_HZ = 50
ASKED_HZ = 5.0
ATTACKERS = 128  # connections
START_S = 3.0  # left out: the program starts


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=20.0, help="of each run; default 20")
    parser.add_argument("--pages", type=int, default=20, help="that ask at the same time; default 20")
    parser.add_argument("--first", action="store_true", help="run before all else on this machine, as root may")
    options = parser.parse_args()
    print(f"size of the page: {sum(len(page.body) for page in pages().values()) / 1e3:.0f} kB")
    print("| pages | lateness p50 | p99 | worst | processor | memory |")
    print("|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        counts = (None, 0, options.pages)
        runs = [Run(count, options, Path(folder) / str(count)) for count in counts]
        for run in runs:
            print(run.row(), flush=True)
        for kind in ATTACKS:
            print(Run(0, options, Path(folder) / kind, kind).row(), flush=True)
        if importlib.util.find_spec("foxglove"):
            for kind in ATTACKS:
                print(Run(0, options, Path(folder) / f"foxglove {kind}", kind, "foxglove").row(), flush=True)
    first_picture()


class Run:
    """One run, its pages and the attack on it, from now on.

    `count`: of pages; None: without --web. `kind`: of the attack, "" for none. `of`: the option that is attacked.
    """

    def __init__(
        self, count: int | None, options: argparse.Namespace, record: Path, kind: str = "", of: str = "web"
    ) -> None:
        self._count = count
        self._kind = kind
        self._of = of
        self._record = record
        self._seconds = options.seconds + START_S
        self._stop = threading.Event()
        with closing(UdpInLink()) as free:
            port = free.port
        vehicle = ["vehicle", "--link", f"udpout:127.0.0.1:{port}"]
        self._vehicle = subprocess.Popen([*COMMAND, *vehicle], stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
        arguments = ["run", "--autopilot", f"udpin:127.0.0.1:{port}", "--port", "pty", "--rate", str(RATE_HZ)]
        arguments += ["--record", str(record), "--duration", str(self._seconds)]
        arguments += [] if count is None else [f"--{of}", "127.0.0.1:0"]
        self._program = subprocess.Popen([*COMMAND, *arguments], stderr=subprocess.PIPE, text=True)
        if options.first:
            for process in (self._vehicle, self._program):
                os.sched_setscheduler(process.pid, os.SCHED_FIFO, os.sched_param(1))
        threading.Thread(target=self._read, daemon=True).start()

    def row(self) -> str:
        """What it cost, when it has ended."""
        _, status, usage = os.wait4(self._program.pid, 0)
        self._stop.set()
        self._vehicle.send_signal(signal.SIGINT)
        self._vehicle.wait()
        assert status == 0, f"the program has ended with {status}"
        with open(self._record / "readings.csv", newline="") as file:
            rows = [row for row in csv.DictReader(file) if row["slot"] == "1" and float(row["time_s"]) > START_S]
        late = np.array([float(row["late_ms"]) for row in rows])
        share = (usage.ru_utime + usage.ru_stime) / self._seconds
        name = f"{self._of}: {self._kind}" if self._kind else str(self._count)
        if self._count is None:
            name = "no --web"
        p50, p99 = np.percentile(late, [50, 99])
        return (
            f"| {name} | {p50:.2f} ms | {p99:.2f} ms | {late.max():.1f} ms | {100 * share:.1f} % of a core | "
            f"{usage.ru_maxrss / 1024:.0f} MiB |"
        )

    def _read(self) -> None:
        assert self._program.stderr is not None
        for line in self._program.stderr:
            if "127.0.0.1" in line and line.startswith(("page: ", "messages for Foxglove: ")):
                address = urlsplit(line.split()[-1]).netloc
                for i in range(self._count or 0):
                    threading.Thread(target=poll, args=(address, self._stop, i), daemon=True).start()
                if self._kind:
                    attack = multiprocessing.Process(target=ATTACKS[self._kind], args=(address,), daemon=True)
                    attack.start()
                    self._stop.wait()
                    attack.terminate()


def poll(address: str, stop: threading.Event, number: int) -> None:
    """One page: what is new, five times a second."""
    connection = http.client.HTTPConnection(address, timeout=10)
    version, due = 0, time.monotonic() + 0.01 * number
    while not stop.wait(max(0.0, due - time.monotonic())):
        due += 1 / ASKED_HZ
        try:
            connection.request("GET", f"/state.json?since={version}")
            version = json.loads(connection.getresponse().read())["version"]
        except (OSError, http.client.HTTPException):
            return


def flood(address: str, data: bytes, *, then_close: bool = False) -> None:
    """Attack a page: send the data again and again on every connection, and connect again when one ends."""
    os.nice(10)
    host, port = address.split(":")
    with selectors.DefaultSelector() as selector:
        while True:
            while len(selector.get_map()) < ATTACKERS:
                client = socket.socket()
                client.setblocking(False)
                client.connect_ex((host, int(port)))
                selector.register(client, selectors.EVENT_WRITE)
            for key, _ in selector.select():
                client = cast(socket.socket, key.fileobj)
                try:
                    client.send(data)
                except BlockingIOError:
                    continue
                except OSError:
                    gone = True
                else:
                    gone = then_close
                if gone:
                    selector.unregister(client)
                    client.close()


HEAD = b"GET /state.json?since=1 HTTP/1.1\r\nHost: localhost\r\n"
ATTACKS: Mapping[str, Callable[[str], None]] = {
    "headers": functools.partial(flood, data=HEAD + b"X: " + b"y" * 65_000 + b"\r\n"),
    "bytes": functools.partial(flood, data=b"y"),
    "documents": functools.partial(flood, data=HEAD + b"\r\n"),
    "connections": functools.partial(flood, data=b"y", then_close=True),
}


def first_picture() -> None:
    """From the request to the first picture, and until the run is shown."""
    chromium = shutil.which("chromium")
    try:
        from playwright.sync_api import sync_playwright
    except ImportError:
        chromium = None
    if chromium is None:
        print("first picture: not measured, there is no Chromium or no Playwright")
        return
    with tempfile.TemporaryDirectory() as folder:
        arguments = ["demo", "--headless", "--web", "127.0.0.1:0", "--record", str(Path(folder) / "record")]
        program = subprocess.Popen([*COMMAND, *arguments], stderr=subprocess.PIPE, text=True)
        assert program.stderr is not None
        url = program.stderr.readline().split()[1]
        with sync_playwright() as playwright:
            browser = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox", "--disable-gpu"])
            page = browser.new_page()
            page.goto("about:blank")
            before = time.monotonic()
            page.goto(url)
            page.wait_for_selector("html[data-ready=true]")
            shown_s = time.monotonic() - before
            paint = page.evaluate("performance.getEntriesByName('first-contentful-paint')[0].startTime")
            browser.close()
        program.send_signal(signal.SIGINT)
        program.stderr.read()
        program.wait()
    print(f"first picture: {paint:.0f} ms; the run is shown after {1e3 * shown_s:.0f} ms")


if __name__ == "__main__":
    main()
