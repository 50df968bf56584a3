"""What the command line's tests stand on: the program as a process, and the far ends of its links."""

from __future__ import annotations

import codecs
import contextlib
import os
import re
import resource
import select
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

from arva_hil.cli.main import main
from arva_hil.clock import Clock, RealClock
from arva_hil.links import Link, LinkError
from arva_hil.links.pty import PtyLink
from arva_hil.mavlink.codec import Encoder, Parser, decode, dialect
from arva_hil.mavlink.signing import Signing
from arva_hil.runtime.loop import run
from arva_hil.simulated.vehicle import SimulatedVehicle, Simulator
from firmware_proto import MID, Channel, Decoder, Frame, encode
from tests.waiting import DEADLINE_S, until

from .forked import Forked, possible

__all__ = ["until"]  # of the tests beside it too

_LAST_BYTES_S = 5.0  # what an ended program has written is there by then: the kernel hands it over a little later
HOME = (46.0123, 7.7456, 1650.0)
REAL = [sys.executable, "-m", "arva_hil"]
UNDER_TEST = os.environ.get("PROGRAM_UNDER_TEST")  # that of an installed wheel: `make dist`
PROGRAM = [UNDER_TEST] if UNDER_TEST else REAL
SPEED = 2.0 if PROGRAM is REAL and possible({}) else 1.0  # of the clocks of forked commands and of their far ends

# root reads and writes whatever it likes; without these two capabilities it is like everybody else
ORDINARY = ["setpriv", "--bounding-set", "-dac_override,-dac_read_search"] if os.geteuid() == 0 else []


def full_disk() -> dict[str, Any]:
    """Options of a `Program` that cannot write more than 8000 bytes to a file: nor compiled modules for the others."""
    return {
        "preexec_fn": lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (8000, 8000)),
        "env": os.environ | {"PYTHONDONTWRITEBYTECODE": "1"},
    }


@contextlib.contextmanager
def hurried(speed: float) -> Iterator[None]:
    """Clocks that are made meanwhile run so many times as fast as time, so that nobody waits long."""
    usual = RealClock.__init__.__defaults__
    RealClock.__init__.__defaults__ = (speed,)  # type: ignore[attr-defined]
    try:
        yield
    finally:
        RealClock.__init__.__defaults__ = usual  # type: ignore[attr-defined]


class Ended(NamedTuple):
    """An end of the program in this process: its exit code and what it printed."""

    code: int
    out: str
    err: str


class Program:
    """The program as a process. Its stdout goes to a file unless told otherwise, its stderr to `err`.

    `fresh`: as `python -m arva_hil` for certain, where its start or its command line is what counts; else it is forked
    if that is the same, with clocks of this `speed`. `closed`: standard streams that it does not have, by their
    descriptors. `draws`: its figures, which are files without a picture if it is forked and does not.
    """

    _not_closed: ClassVar[list[Program]] = []

    def __init__(
        self,
        *arguments: object,
        before: Sequence[str] = (),
        fresh: bool = False,
        closed: Sequence[int] = (),
        speed: float = SPEED,
        draws: bool = False,
        **options: Any,
    ) -> None:
        self.err = ""
        self._decoder = codecs.getincrementaldecoder("utf-8")()  # what is read may end within a character
        self._out = tempfile.TemporaryFile()  # noqa: SIM115 (closed in `close`)
        options.setdefault("stdout", self._out)
        options.setdefault("stderr", subprocess.PIPE)
        options.setdefault("stdin", subprocess.DEVNULL)
        self.process: subprocess.Popen[bytes] | Forked
        words = list(map(str, arguments))
        if fresh or before or PROGRAM is not REAL or not possible(options):
            if closed:
                before = ["sh", "-c", 'exec "$@"' + "".join(f" {fd}>&-" for fd in closed), "sh"]
            self.process = subprocess.Popen([*before, *PROGRAM, *words], **options)
        else:
            self.process = Forked(words, closed=closed, speed=speed, draws=draws, **{"env": None, **options})
        self._not_closed.append(self)

    @classmethod
    def running(cls) -> list[Program]:
        """Those of this test that have not ended."""
        return [one for one in cls._not_closed if one.process.poll() is None]

    @classmethod
    def all_ended(cls) -> bool:
        """Whether nobody is left who could write anything: there are programs, and none of them still runs."""
        return bool(cls._not_closed) and not cls.running()

    @property
    def out(self) -> bytes:
        self._out.seek(0)
        return self._out.read()

    def says(self, *patterns: str) -> re.Match[str]:
        """Wait until stderr has said all of it; where the last one is."""
        for pattern in patterns:
            while not (found := re.search(pattern, self.err)):
                assert self._listen(), f"{pattern!r} was not said before the end of:\n{self.err}"
        return found

    def after(self, *patterns: str) -> Program:
        """The program, as soon as stderr has said all of it."""
        self.says(*patterns)
        return self

    def writes(self, least: int) -> None:
        """Wait until so many more bytes are on stdout, which is the file."""
        size = os.fstat(self._out.fileno()).st_size + least
        until(lambda: os.fstat(self._out.fileno()).st_size >= size)

    def stops(self, number: signal.Signals = signal.SIGTERM) -> str:
        """It is told to stop, and ends as it should; all that it has said."""
        self.send(number)
        return self.ends(130)

    def __repr__(self) -> str:
        return f"<a program that said {self.err!r}>"

    def story(self) -> str:
        """For the report of a test that fails: how it was started, whether it has ended, all that it has said."""
        code = self.process.poll()
        state = "still runs" if code is None else f"has ended with {code}"
        pipe = self.process.stderr
        with contextlib.suppress(OSError, ValueError, AssertionError):  # closed, or nothing more to be read
            while pipe and self._listen(0.0):
                pass
        said = self.err if pipe else "(its stderr is not read by this test)"
        return f"{self.process.args}\nprocess {self.process.pid} {state}; it has said:\n{said}"

    def send(self, number: signal.Signals) -> None:
        self.process.send_signal(number)

    def ends(self, *codes: int, within_s: float = DEADLINE_S) -> str:
        """Wait for its end with one of these exit codes (0 if none is named); all that it has said: no traceback."""
        while self.process.stderr and self._listen(within_s):
            pass
        assert self.process.wait(DEADLINE_S) in (codes or (0,)), self.err
        assert "Traceback" not in self.err
        assert "Exception ignored" not in self.err
        return self.err

    def close(self) -> None:
        if self in self._not_closed:
            self._not_closed.remove(self)
        self.process.kill()
        self.process.wait()
        if self.process.stderr:
            self.process.stderr.close()
        self._out.close()

    def _listen(self, within_s: float = DEADLINE_S) -> bool:
        """Take what comes; False at the end."""
        fd = self.process.stderr.fileno()
        assert select.select([fd], [], [], within_s)[0], f"the deadline passed after:\n{self.err}"
        chunk = os.read(fd, 65536)
        self.err += self._decoder.decode(chunk)
        return bool(chunk)


class Autopilot:
    """The built-in vehicle at its home, on a link, served by a thread. `heard` is all that was sent to it.

    It is switched on when somebody speaks to it, so that its heartbeat comes at once; or now, if it `speaks_first`.
    `key`: it signs, and obeys only what is signed. `system`: its id. `speed`: that of the program it speaks to.
    """

    def __init__(
        self,
        link: Link,
        *,
        speaks_first: bool = False,
        key: bytes | None = None,
        system: int = 1,
        speed: float = SPEED,
    ) -> None:
        self.heard = bytearray()
        self.link = link
        self.address = link.path if isinstance(link, PtyLink) else link.name
        self._stop = threading.Event()
        self._speaks_first = speaks_first
        self._key = key
        self._system = system
        self._speed = speed
        self._thread = threading.Thread(target=self._fly)
        read = link.read

        def tapped() -> bytes:
            self.heard += (data := read())
            return data

        link.read = tapped  # type: ignore[method-assign]
        self._thread.start()

    def _fly(self) -> None:
        clock = RealClock(self._speed)
        while not (self._speaks_first or self.link.ready() or self._stop.is_set()):
            clock.wait(clock.now() + 0.1, [self.link])
        signing = Signing(self._key, clock.epoch_us) if self._key else None
        vehicle = SimulatedVehicle(HOME, self._system, boot_time=clock.now(), signing=signing)
        with contextlib.suppress(LinkError):  # the program has ended
            run([Simulator([vehicle], [self.link])], clock, stopped=self._stop.is_set)

    def story(self) -> str:
        """For the report of a test that fails."""
        state = "serves" if self._thread.is_alive() else "no longer serves"
        return f"built-in vehicle {self._system}, which {state} {self.link.name}; it has heard {len(self.heard)} bytes"

    def pause(self) -> None:
        """Say no more."""
        self._stop.set()
        self._thread.join(DEADLINE_S)

    def close(self) -> None:
        self.pause()
        self.link.close()


class Arva:
    """The program in this process. `capsys`: takes what it prints; `around`: what is replaced meanwhile."""

    def __init__(self, capsys: Any, around: Callable[[], AbstractContextManager[None]]) -> None:
        self._capsys = capsys
        self._around = around

    def __call__(self, *arguments: object, code: int | tuple[int, ...] = 0, speed: float = SPEED) -> Ended:
        """Run a command that ends with this exit code, or with one of these."""
        self._capsys.readouterr()
        with self._around(), hurried(speed):
            ended = Ended(main([str(argument) for argument in arguments]), *self._capsys.readouterr())
        assert ended.code in (code if isinstance(code, tuple) else (code,)), ended.err
        return ended

    def refused(self, *arguments: object, code: int = 2) -> str:
        """Run a command that is refused: all it prints is an error message, which is returned."""
        ended = self(*arguments, code=code)
        assert ended.out == ""
        assert "Traceback" not in ended.err
        return ended.err


Start = Callable[..., Program]  # these two are fixtures
Keep = Callable[[Any], Any]


class Beacon:
    """A receiver's wire that says ten times a second what it hears, until it is `quiet`."""

    def __init__(self, encode: Callable[[Frame], bytes] = encode, *, symlink: str = "") -> None:
        self.link = PtyLink(symlink)
        self.quiet = threading.Event()
        self._encode = encode
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._speak)
        self._thread.start()

    def _speak(self) -> None:
        clock, n = RealClock(SPEED), 0
        while not self._stop.is_set():
            if not self.quiet.is_set():
                self.link.write(
                    self._encode(Frame(n % 256, 1, (Channel(4, MID, 2000, 10), Channel(9, MID, 4500, -40))))
                )
            n += 1
            clock.wait(n * 0.1)

    def close(self) -> None:
        self._stop.set()
        self._thread.join()
        self.link.close()


class Denier:
    """An autopilot that says hello and refuses everything it is asked for: `result`. A task for `run`."""

    def __init__(self, link: Link, result: int) -> None:
        self.links = [link]
        self._link = link
        self._result = result
        self._parser = Parser()
        self._encoder = Encoder(1, 1)
        self._next = 0.0

    def service(self, clock: Clock) -> float:
        now = clock.now()
        for packet in self._parser.feed(self._link.read()):
            if packet.msgid == dialect.MAVLINK_MSG_ID_COMMAND_LONG:
                self._link.write(
                    self._encoder.pack(dialect.MAVLink_command_ack_message(decode(packet).command, self._result))
                )
        if now >= self._next:
            self._next = now + 1.0
            self._link.write(heartbeat(self._encoder))
        return self._next


def heartbeat(
    encoder: Encoder, kind: int = dialect.MAV_TYPE_QUADROTOR, autopilot: int = dialect.MAV_AUTOPILOT_ARDUPILOTMEGA
) -> bytes:
    return encoder.pack(dialect.MAVLink_heartbeat_message(kind, autopilot, 0, 0, dialect.MAV_STATE_STANDBY, 3))


class Consumer:
    """A program that reads frames from a link: each is whole, and none is missing. `frames`: all that have come."""

    def __init__(self, link: Link) -> None:
        self.frames: list[Frame] = []
        self.decoder = Decoder()
        self._link = link

    def hears(self) -> bool:
        """Read on; whether the last frame hears a transmitter."""
        self._feed(0.0)
        return bool(self.frames) and hears(self.frames[-1])

    def read(self, least: int) -> list[Frame]:
        """At least so many more frames. It fails soon after the last program of this test has ended."""
        clock, before = RealClock(), len(self.frames)
        deadline = DEADLINE_S
        while True:
            self._feed(clock.now())
            if len(self.frames) >= before + least:
                return self.frames[before:]
            came = len(self.frames) - before
            assert clock.now() < deadline, f"only {came} of {least} frames came"
            if deadline == DEADLINE_S and Program.all_ended():
                deadline = min(deadline, clock.now() + _LAST_BYTES_S)
            clock.wait(clock.now() + 0.05, [self._link])

    def _feed(self, now: float) -> None:
        self.frames += self.decoder.feed(self._link.read(), now)
        assert (self.decoder.lost, self.decoder.bad_crc) == (0, 0)


def read_until_heard(link: Link, least: int = 1) -> list[Frame]:
    """What a consumer reads, from the first frame to at least so many behind the first that hears the transmitter."""
    consumer = Consumer(link)
    while not consumer.hears():
        consumer.read(1)
    consumer.read(least)
    return consumer.frames


def read_frames(link: Link, least: int) -> list[Frame]:
    """What a consumer reads: at least so many frames."""
    return Consumer(link).read(least)


def frames_in(data: bytes) -> list[Frame]:
    """The frames in a file; nothing else may be in it."""
    decoder = Decoder()
    frames = decoder.feed(data, 0.0) + decoder.feed(b"", 1.0)
    assert (decoder.lost, decoder.bad_crc, decoder.dropped) == (0, 0, 0)
    return frames


def hears(frame: Frame) -> bool:
    """Whether a frame hears the transmitter 20.6 m from home, as far as noise lets it say."""
    channel = frame.channels[0]
    return channel.id == 1 and 1000 < channel.d < 4000


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}
