"""Does to the links of `arva-hil run` what strangers and careless consumers do, and checks that it comes through.

    python tools/soak_strangers.py [--rounds 200]

A program listens for its autopilot on UDP; its frames go to a pseudo-terminal in the first half, to TCP clients in the
second. In each round one thing is done to a link, drawn by --seed, and then the frames have to be whole and hear the
transmitter again within 10 s. Ends with 1 when something is not as it should be. Linux.
"""

from __future__ import annotations

import argparse
import contextlib
import fcntl
import json
import os
import random
import signal
import socket
import subprocess
import sys
import tempfile
import termios
from collections import Counter
from collections.abc import Callable
from functools import partial
from pathlib import Path

from arva_hil.links.tcp_server import TcpServerLink
from arva_hil.links.udp import UdpInLink
from arva_hil.mavlink.codec import Encoder, dialect
from arva_hil.runtime.clock import RealClock
from arva_hil.simulated.vehicle import SimulatedVehicle
from firmware_proto import Decoder

HOME = (46.0123, 7.7456, 1650.0)
RATE_HZ = 20.0
MAX_AGE_S = 0.5
WITHIN_S = 10.0
PROVEN = 20  # frames that hear, in a row: more than a pose that is no more would give


class WrongError(Exception):
    """What was found is not as it should be."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=200, metavar="N", help="things done; default 200")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    wrong = False
    for kind in ("pty", "tcpin"):
        with tempfile.TemporaryDirectory() as folder:
            bench = Bench(kind, Path(folder), random.Random(options.seed))
            try:
                bench.prove("start")
                for _ in range(options.rounds // 2):
                    bench.round()
                bench.end()
            except WrongError as error:
                wrong = True
                print(f"WRONG: {error}\n{bench.said()[-2000:]}")
            finally:
                bench.close()
            bench.report()
    sys.exit(wrong)


def heartbeat(system: int, kind: int, autopilot: int) -> bytes:
    return Encoder(system, 1).pack(dialect.MAVLink_heartbeat_message(kind, autopilot, 0, 0, 3, 3))


STATION = heartbeat(255, dialect.MAV_TYPE_GCS, dialect.MAV_AUTOPILOT_INVALID)
TWIN = heartbeat(1, dialect.MAV_TYPE_QUADROTOR, dialect.MAV_AUTOPILOT_ARDUPILOTMEGA)


class Bench:
    """A program, its vehicle and one consumer: remembers what was done to them, and how long each recovery took."""

    def __init__(self, kind: str, folder: Path, numbers: random.Random) -> None:
        self.kind = kind
        self._folder = folder
        self._numbers = numbers
        self._clock = RealClock()
        with contextlib.closing(UdpInLink()) as udp, contextlib.closing(TcpServerLink()) as tcp:
            self._udp, self._tcp = udp.port, tcp.port
        self._link = str(folder / "arva0")
        self._vehicle = SimulatedVehicle(HOME, boot_time=0.0)
        self._sock = self._socket()
        self._strangers = [self._socket() for _ in range(12)]
        self._noise: list[tuple[socket.socket, bytes]] = []  # sent along with all that the vehicle sends
        self._fly_from = 0.0  # it pauses until then
        self._silent: list[socket.socket] = []
        self._errors = tempfile.TemporaryFile()  # noqa: SIM115 (closed in `close`)
        self.done: Counter[str] = Counter()
        self.worst: dict[str, float] = {}
        self._descriptors: list[int] = []
        of_the_port = {
            "pty": [self.left_cooked, self.wanted_alone, self.killed_and_its_link_stale],
            "tcpin": [self.silent_consumer, self.consumer_gone_without_reading, self.nine_consumers],
        }
        of_the_autopilot = [self.bytes_of_strangers, self.ground_station_in_a_pause, self.twin]
        self._actions = [*of_the_autopilot, self.vehicle_on_another_port, *of_the_port[kind]]
        self._start()

    def round(self) -> None:
        action = self._numbers.choice(self._actions)
        name = action.__name__
        before = self._clock.now()
        self._noise.clear()
        action()
        self.prove(name)
        self.done[name] += 1
        self.worst[name] = max(self.worst.get(name, 0.0), self._clock.now() - before)
        self._noise.clear()
        for sock in self._silent:
            sock.close()
        self._silent.clear()
        self.fly(0.3)
        if name != "killed_and_its_link_stale":
            self._descriptors.append(len(os.listdir(f"/proc/{self._process.pid}/fd")))

    # -- what is done ----------------------------------------------------------------------------------------

    def bytes_of_strangers(self) -> None:
        for sock in self._strangers:
            self._noise.append((sock, self._numbers.choice([b"x", b"\xfd", b"\xfe\xff\x00", b"", os.urandom(200)])))
        self.fly(1.0)

    def ground_station_in_a_pause(self) -> None:
        self._noise.append((self._strangers[0], STATION))
        self._fly_from = self._clock.now() + self._numbers.uniform(3.5, 4.5)
        self.fly(self._fly_from - self._clock.now())

    def twin(self) -> None:
        """Another vehicle of the same ids, which never may take this one's place while it speaks."""
        self._noise.append((self._strangers[1], TWIN))
        self.fly(4.0)
        with contextlib.suppress(BlockingIOError):
            if self._strangers[1].recv(65536):
                raise WrongError("a twin was answered")

    def vehicle_on_another_port(self) -> None:
        self._sock.close()
        self._sock = self._socket()
        self.fly(1.0)

    def left_cooked(self) -> None:
        fd = os.open(self._link, os.O_RDWR | os.O_NOCTTY)
        mode = termios.tcgetattr(fd)
        mode[0] |= termios.ICRNL | termios.IXON
        mode[1] |= termios.OPOST
        mode[3] |= termios.ICANON | termios.ECHO | termios.ISIG
        termios.tcsetattr(fd, termios.TCSANOW, mode)
        self.fly(0.2)
        os.close(fd)
        self.fly(0.2)

    def wanted_alone(self) -> None:
        fd = os.open(self._link, os.O_RDWR | os.O_NOCTTY)
        fcntl.ioctl(fd, termios.TIOCEXCL)
        self.fly(0.2)
        os.close(fd)
        self.fly(0.2)
        fd = os.open(self._link, os.O_RDWR | os.O_NOCTTY)
        if any(fcntl.ioctl(fd, 0x80045440, bytes(4))):  # TIOCGEXCL; root may open it all the same
            raise WrongError("a consumer that has gone still has it alone")
        os.close(fd)

    def killed_and_its_link_stale(self) -> None:
        self._process.kill()
        self._process.wait()
        number, taken = os.readlink(self._link), []
        while not os.path.exists(number):
            taken.append(os.openpty())
        for master, _ in taken:
            os.write(master, b"foreign bytes\n")
        command = [sys.executable, "-m", "arva_hil", "listen", self._link, "--count", "1", "--duration", "2"]
        heard = subprocess.run(command, capture_output=True, text=True)
        if heard.returncode != 3 or "another program has opened since" not in heard.stderr or heard.stdout:
            raise WrongError(f"a stale link was read, or not refused: {heard}")
        self._start()
        while os.readlink(self._link) == number:
            self.fly(0.1)
        for pair in taken:
            for fd in pair:
                os.close(fd)

    def silent_consumer(self) -> None:
        """It reads nothing for as long as the round takes; others do not wait for it."""
        self._silent.append(self._connect())

    def consumer_gone_without_reading(self) -> None:
        sock = self._connect()
        self.fly(0.3)
        sock.close()

    def nine_consumers(self) -> None:
        """The ninth is let in when another has gone."""
        many = [self._connect() for _ in range(9)]
        self.fly(0.3)
        for sock in many:
            sock.close()

    # -- what has to be so -----------------------------------------------------------------------------------

    def prove(self, after: str) -> None:
        """A new consumer reads whole frames that hear, one number after the other."""
        end = self._clock.now() + WITHIN_S
        fd, close = self._open(end)
        decoder, run = Decoder(), 0
        try:
            while run < PROVEN:
                self.fly(0.02)
                with contextlib.suppress(BlockingIOError):
                    frames = decoder.feed(os.read(fd, 65536), self._clock.now())
                    for frame in frames:
                        run = run + 1 if frame.channels[0].valid else 0
                if self._clock.now() > end:
                    raise WrongError(f"{after}: no frame that hears in {WITHIN_S:g} s")
        finally:
            close()
        if decoder.bad_crc or decoder.lost:
            raise WrongError(f"{after}: {decoder.bad_crc} frames were damaged, {decoder.lost} lost")

    def end(self) -> None:
        self._process.send_signal(signal.SIGTERM)
        code = self._process.wait(20)
        if code != 130 or "Traceback" in self.said():
            raise WrongError(f"it ended with {code}")
        if len(set(self._descriptors)) > 3:
            raise WrongError(f"descriptors: {sorted(set(self._descriptors))}")
        counters = json.loads((self._folder / "record" / "run.json").read_text())["counters"]
        if counters["skipped"]:
            raise WrongError(f"{counters['skipped']} frames were skipped")

    def report(self) -> None:
        print(f"{self.kind}: {sum(self.done.values())} rounds, descriptors {sorted(set(self._descriptors))}")
        for name, count in sorted(self.done.items()):
            print(f"  {name.replace('_', ' ')}: {count} ×, frames right again after {self.worst[name]:.1f} s at worst")

    def said(self) -> str:
        self._errors.seek(0)
        return self._errors.read().decode()

    def close(self) -> None:
        if self._process.poll() is None:
            self._process.kill()
            self._process.wait()
        self._errors.close()
        for sock in (self._sock, *self._strangers, *self._silent):
            sock.close()

    # -- the program, the vehicle, the consumer --------------------------------------------------------------

    def fly(self, seconds: float) -> None:
        """Time passes: the vehicle speaks, and so does whoever else is told to."""
        end = self._clock.now() + seconds
        while True:
            now = self._clock.now()
            with contextlib.suppress(BlockingIOError, ConnectionRefusedError):
                while True:
                    self._vehicle.feed(self._sock.recv(65536), now)
            said = self._vehicle.poll(now)
            with contextlib.suppress(OSError):
                if said and now >= self._fly_from:
                    self._sock.send(said)
                for sock, noise in self._noise if said else ():
                    sock.send(noise)
            if now >= end:
                return
            self._clock.wait(min(end, now + 0.01))

    def _start(self) -> None:
        to = f"pty:{self._link}" if self.kind == "pty" else f"tcpin:127.0.0.1:{self._tcp}"
        record = self._folder / "record"
        if record.exists():
            record.rename(self._folder / f"record{self._clock.now():.3f}")
        options = ["run", "--autopilot", f"udpin:127.0.0.1:{self._udp}", "--port", to, "--timeout", "60"]
        options += ["--rate", str(RATE_HZ), "--max-age", str(MAX_AGE_S), "--record", str(record)]
        self._process = subprocess.Popen(
            [sys.executable, "-m", "arva_hil", *options], stderr=self._errors, stdin=subprocess.DEVNULL
        )

    def _open(self, end: float) -> tuple[int, Callable[[], None]]:
        if self.kind == "tcpin":
            sock = self._connect()
            sock.setblocking(False)
            return sock.fileno(), sock.close
        while True:
            with contextlib.suppress(OSError):
                fd = os.open(self._link, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
                termios.tcflush(fd, termios.TCIFLUSH)
                return fd, partial(os.close, fd)
            self.fly(0.05)
            if self._clock.now() > end:
                raise WrongError("the terminal cannot be opened")

    def _connect(self) -> socket.socket:
        end = self._clock.now() + WITHIN_S
        while True:
            with contextlib.suppress(ConnectionRefusedError):
                return socket.create_connection(("127.0.0.1", self._tcp), 1.0)
            self.fly(0.05)
            if self._clock.now() > end:
                raise WrongError("nobody listens")

    def _socket(self) -> socket.socket:
        sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        sock.connect(("127.0.0.1", self._udp))
        sock.setblocking(False)
        return sock


if __name__ == "__main__":
    main()
