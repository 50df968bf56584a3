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
import os
import random
import socket
import subprocess
import sys
import tempfile
import termios
from collections import Counter
from pathlib import Path

from arva_hil.mavlink.codec import Encoder, dialect
from tools.strangers.bench import Bench, WrongError


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=200, metavar="N", help="things done; default 200")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    wrong = False
    for kind in ("pty", "tcpin"):
        with tempfile.TemporaryDirectory() as folder:
            bench = Bench(kind, Path(folder))
            strangers = Strangers(bench, random.Random(options.seed))
            try:
                bench.prove("start")
                for _ in range(options.rounds // 2):
                    strangers.round()
                strangers.end()
            except WrongError as error:
                wrong = True
                print(f"WRONG: {error}\n{bench.said()[-2000:]}")
            finally:
                strangers.close()
                bench.close()
            strangers.report()
    sys.exit(wrong)


def heartbeat(system: int, kind: int, autopilot: int) -> bytes:
    return Encoder(system, 1).pack(dialect.MAVLink_heartbeat_message(kind, autopilot, 0, 0, 3, 3))


STATION = heartbeat(255, dialect.MAV_TYPE_GCS, dialect.MAV_AUTOPILOT_INVALID)
TWIN = heartbeat(1, dialect.MAV_TYPE_QUADROTOR, dialect.MAV_AUTOPILOT_ARDUPILOTMEGA)


class Strangers:
    """What is done to a program's links: remembers how often, and how long each recovery took."""

    def __init__(self, bench: Bench, numbers: random.Random) -> None:
        self._bench = bench
        self._numbers = numbers
        self._strangers = [bench.sender() for _ in range(12)]
        self._silent: list[socket.socket] = []
        self._done: Counter[str] = Counter()
        self._worst: dict[str, float] = {}
        self._descriptors: list[int] = []
        of_the_port = {
            "pty": [self.left_cooked, self.wanted_alone, self.killed_and_its_link_stale],
            "tcpin": [self.silent_consumer, self.consumer_gone_without_reading, self.nine_consumers],
        }
        of_the_autopilot = [self.bytes_of_strangers, self.ground_station_in_a_pause, self.twin]
        self._actions = [*of_the_autopilot, self.vehicle_on_another_port, *of_the_port[bench.kind]]

    def round(self) -> None:
        action = self._numbers.choice(self._actions)
        name = action.__name__
        before = self._bench.clock.now()
        self._bench.noise.clear()
        action()
        self._bench.prove(name)
        self._done[name] += 1
        self._worst[name] = max(self._worst.get(name, 0.0), self._bench.clock.now() - before)
        self._bench.noise.clear()
        for sock in self._silent:
            sock.close()
        self._silent.clear()
        self._bench.fly(0.3)
        if name != "killed_and_its_link_stale":
            self._descriptors.append(self._bench.descriptors())

    def bytes_of_strangers(self) -> None:
        for sock in self._strangers:
            self._bench.noise.append(
                (sock, self._numbers.choice([b"x", b"\xfd", b"\xfe\xff\x00", b"", os.urandom(200)]))
            )
        self._bench.fly(1.0)

    def ground_station_in_a_pause(self) -> None:
        self._bench.noise.append((self._strangers[0], STATION))
        self._bench.fly_from = self._bench.clock.now() + self._numbers.uniform(3.5, 4.5)
        self._bench.fly(self._bench.fly_from - self._bench.clock.now())

    def twin(self) -> None:
        """Another vehicle of the same ids, which never may take this one's place while it speaks."""
        self._bench.noise.append((self._strangers[1], TWIN))
        self._bench.fly(4.0)
        with contextlib.suppress(BlockingIOError):
            if self._strangers[1].recv(65536):
                raise WrongError("a twin was answered")

    def vehicle_on_another_port(self) -> None:
        self._bench.move()
        self._bench.fly(1.0)

    def left_cooked(self) -> None:
        fd = os.open(self._bench.link, os.O_RDWR | os.O_NOCTTY)
        mode = termios.tcgetattr(fd)
        mode[0] |= termios.ICRNL | termios.IXON
        mode[1] |= termios.OPOST
        mode[3] |= termios.ICANON | termios.ECHO | termios.ISIG
        termios.tcsetattr(fd, termios.TCSANOW, mode)
        self._bench.fly(0.2)
        os.close(fd)
        self._bench.fly(0.2)

    def wanted_alone(self) -> None:
        fd = os.open(self._bench.link, os.O_RDWR | os.O_NOCTTY)
        fcntl.ioctl(fd, termios.TIOCEXCL)
        self._bench.fly(0.2)
        os.close(fd)
        self._bench.fly(0.2)
        fd = os.open(self._bench.link, os.O_RDWR | os.O_NOCTTY)
        if any(fcntl.ioctl(fd, 0x80045440, bytes(4))):  # TIOCGEXCL; root may open it all the same
            raise WrongError("a consumer that has gone still has it alone")
        os.close(fd)

    def killed_and_its_link_stale(self) -> None:
        self._bench.kill()
        number, taken = os.readlink(self._bench.link), []
        while not os.path.exists(number):
            taken.append(os.openpty())
        for master, _ in taken:
            os.write(master, b"foreign bytes\n")
        command = [sys.executable, "-m", "arva_hil", "listen", self._bench.link, "--count", "1", "--duration", "2"]
        heard = subprocess.run(command, capture_output=True, text=True)
        if heard.returncode != 3 or "another program has opened since" not in heard.stderr or heard.stdout:
            raise WrongError(f"a stale link was read, or not refused: {heard}")
        self._bench.start()
        while os.readlink(self._bench.link) == number:
            self._bench.fly(0.1)
        for pair in taken:
            for fd in pair:
                os.close(fd)

    def silent_consumer(self) -> None:
        """It reads nothing for as long as the round takes; others do not wait for it."""
        self._silent.append(self._bench.connect())

    def consumer_gone_without_reading(self) -> None:
        sock = self._bench.connect()
        self._bench.fly(0.3)
        sock.close()

    def nine_consumers(self) -> None:
        """The ninth is let in when another has gone."""
        many = [self._bench.connect() for _ in range(9)]
        self._bench.fly(0.3)
        for sock in many:
            sock.close()

    def end(self) -> None:
        """See `Bench.end`."""
        self._bench.end()
        if len(set(self._descriptors)) > 3:
            raise WrongError(f"descriptors: {sorted(set(self._descriptors))}")

    def report(self) -> None:
        print(f"{self._bench.kind}: {sum(self._done.values())} rounds, descriptors {sorted(set(self._descriptors))}")
        for name, count in sorted(self._done.items()):
            print(f"  {name.replace('_', ' ')}: {count} ×, frames right again after {self._worst[name]:.1f} s at worst")

    def close(self) -> None:
        for sock in (*self._strangers, *self._silent):
            sock.close()


if __name__ == "__main__":
    main()
