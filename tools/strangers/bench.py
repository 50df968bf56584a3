"""A running program with its vehicle and one consumer, which strangers disturb: soak_strangers.py."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import socket
import subprocess
import sys
import tempfile
import termios
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Final

from arva_hil.clock import RealClock
from arva_hil.links.tcp_server import TcpServerLink
from arva_hil.links.udp import UdpInLink
from arva_hil.simulated.vehicle import SimulatedVehicle
from firmware_proto import Decoder

_HOME: Final = (46.0123, 7.7456, 1650.0)
_RATE_HZ: Final = 20.0
_MAX_AGE_S: Final = 0.5
_WITHIN_S: Final = 10.0
_PROVEN: Final = 20  # frames that hear, in a row: more than a pose that is no more would give


class WrongError(Exception):
    """What was found is not as it should be."""


class Bench:
    """A program, its vehicle on UDP, and its port: `kind` is pty or tcpin. Others may speak when the vehicle does."""

    def __init__(self, kind: str, folder: Path) -> None:
        self.kind = kind
        self.clock = RealClock()
        self.link = str(folder / "arva0")
        self.noise: list[tuple[socket.socket, bytes]] = []  # sent along with all that the vehicle sends
        self.fly_from = 0.0  # it pauses until then
        self._folder = folder
        with contextlib.closing(UdpInLink()) as udp, contextlib.closing(TcpServerLink()) as tcp:
            self._udp, self._tcp = udp.port, tcp.port
        self._vehicle = SimulatedVehicle(_HOME, boot_time=0.0)
        self._sock = self.sender()
        self._errors = tempfile.TemporaryFile()  # noqa: SIM115 (closed in `close`)
        self.start()

    def fly(self, seconds: float) -> None:
        """Time passes: the vehicle speaks, and so does whoever else is told to."""
        end = self.clock.now() + seconds
        while True:
            now = self.clock.now()
            with contextlib.suppress(BlockingIOError, ConnectionRefusedError):
                while True:
                    self._vehicle.feed(self._sock.recv(65536), now)
            said = self._vehicle.poll(now)
            with contextlib.suppress(OSError):
                if said and now >= self.fly_from:
                    self._sock.send(said)
                for sock, noise in self.noise if said else ():
                    sock.send(noise)
            if now >= end:
                return
            self.clock.wait(min(end, now + 0.01))

    def start(self) -> None:
        """Start the program."""
        to = f"pty:{self.link}" if self.kind == "pty" else f"tcpin:127.0.0.1:{self._tcp}"
        record = self._folder / "record"
        if record.exists():
            record.rename(self._folder / f"record{self.clock.now():.3f}")
        options = ["run", "--autopilot", f"udpin:127.0.0.1:{self._udp}", "--port", to, "--timeout", "60"]
        options += ["--rate", str(_RATE_HZ), "--max-age", str(_MAX_AGE_S), "--record", str(record)]
        self._process = subprocess.Popen(
            [sys.executable, "-m", "arva_hil", *options], stderr=self._errors, stdin=subprocess.DEVNULL
        )

    def move(self) -> None:
        """From now on the vehicle speaks from another port."""
        self._sock.close()
        self._sock = self.sender()

    def kill(self) -> None:
        self._process.kill()
        self._process.wait()

    def descriptors(self) -> int:
        """How many the program has open."""
        return len(os.listdir(f"/proc/{self._process.pid}/fd"))

    def prove(self, after: str) -> None:
        """A new consumer reads whole frames that hear, one number after the other."""
        end = self.clock.now() + _WITHIN_S
        fd, close = self._open(end)
        decoder, run = Decoder(), 0
        try:
            while run < _PROVEN:
                self.fly(0.02)
                with contextlib.suppress(BlockingIOError):
                    frames = decoder.feed(os.read(fd, 65536), self.clock.now())
                    for frame in frames:
                        run = run + 1 if frame.channels[0].valid else 0
                if self.clock.now() > end:
                    raise WrongError(f"{after}: no frame that hears in {_WITHIN_S:g} s")
        finally:
            close()
        if decoder.bad_crc or decoder.lost:
            raise WrongError(f"{after}: {decoder.bad_crc} frames were damaged, {decoder.lost} lost")

    def end(self) -> None:
        """The program is told to end. Raises WrongError if it has not come through."""
        self._process.send_signal(signal.SIGTERM)
        code = self._process.wait(20)
        if code != 130 or "Traceback" in self.said():
            raise WrongError(f"it ended with {code}")
        counters = json.loads((self._folder / "record" / "run.json").read_text())["counters"]
        if counters["skipped"]:
            raise WrongError(f"{counters['skipped']} frames were skipped")

    def said(self) -> str:
        self._errors.seek(0)
        return self._errors.read().decode()

    def close(self) -> None:
        if self._process.poll() is None:
            self.kill()
        self._errors.close()
        self._sock.close()

    def connect(self) -> socket.socket:
        """A consumer on TCP."""
        end = self.clock.now() + _WITHIN_S
        while True:
            with contextlib.suppress(ConnectionRefusedError):
                return socket.create_connection(("127.0.0.1", self._tcp), 1.0)
            self.fly(0.05)
            if self.clock.now() > end:
                raise WrongError("nobody listens")

    def sender(self) -> socket.socket:
        """Of datagrams to where the program listens for its autopilot."""
        sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        sock.connect(("127.0.0.1", self._udp))
        sock.setblocking(False)
        return sock

    def _open(self, end: float) -> tuple[int, Callable[[], None]]:
        if self.kind == "tcpin":
            sock = self.connect()
            sock.setblocking(False)
            return sock.fileno(), sock.close
        while True:
            with contextlib.suppress(OSError):
                fd = os.open(self.link, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
                termios.tcflush(fd, termios.TCIFLUSH)
                return fd, partial(os.close, fd)
            self.fly(0.05)
            if self.clock.now() > end:
                raise WrongError("the terminal cannot be opened")
