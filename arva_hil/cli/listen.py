"""`arva-hil listen`: decodes frames and prints them, or guesses their format."""

from __future__ import annotations

import argparse
import math
import os
import select
import sys
from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from arva_hil.autopilot.following.session import heartbeat
from arva_hil.cli import common
from arva_hil.cli.outcome import FAILED, INTERRUPTED, OK, Failure, UsageError
from arva_hil.cli.terminal import show_one, tell
from arva_hil.clock import Clock, RealClock
from arva_hil.events.words import text
from arva_hil.links import AddressError, Link, parse
from arva_hil.mavlink.codec import Encoder, Parser, dialect
from arva_hil.registry import FORMATS, over_mavlink
from firmware_proto import FrameDecoder
from firmware_proto.frame import PAUSE_S

SAMPLE_BYTES: Final = 1 << 14  # enough of any format for several frames


def guess_format(sample: bytes, expected: str) -> str:
    """Guess, in words, the format of a stream without a frame of the `expected` one. `sample`: its first bytes."""
    frames = {name: _frames(sample, name) for name in FORMATS if name != expected}
    best = max(reversed(frames), key=lambda name: frames[name])  # tunnel before the binary frames that are in it
    if frames[best]:
        return f"the bytes are {best}: --format {best}"
    if packets := len(Parser().feed(sample)):
        return f"the bytes are MAVLink ({packets} packets) without frames of a receiver in it"
    return "the bytes are of no other known format: is it the right port, and the right baud rate?"


def _frames(sample: bytes, name: str) -> int:
    decoder = FORMATS[name].decoder()
    frames = decoder.feed(sample, 0.0) + decoder.feed(b"", math.inf)
    return sum(not getattr(FORMATS[name], "measured", "") or frame.measured is not None for frame in frames)


_LOOK_S: Final = 0.1  # between looks at the clock while stdin is silent
_WATCHDOG_S: Final = 2.0  # after this time without a frame, consumers report that the receiver does not work
_COMPONENT: Final = dialect.MAV_COMP_ID_ONBOARD_COMPUTER2  # the emulator is the first


def main(options: argparse.Namespace) -> int:
    listener = Listener(
        FORMATS[options.format].decoder(),
        Encoder(1, _COMPONENT) if over_mavlink(options.format) else None,
        options.format,
        options.json,
        options.count,
    )
    path = Path(options.url)
    if os.path.isfile(path) and path.suffix != ".tlog":
        try:
            listener.take(path.read_bytes(), 0.0)
        except OSError as error:
            raise UsageError(f"{path}: cannot be read: {error.strerror}") from None
        listener.finish()
        return listener.verdict()
    if options.url and os.path.isdir(path):
        raise UsageError(f"{path}: is a directory: write the file in it, e.g. {path / 'frames.bin'}")
    try:
        parse(options.url)
    except AddressError as error:
        raise UsageError(f"{error}; there is no file of that name either" if options.url else error) from None
    clock = RealClock()
    if options.url == "-":
        for chunk in _chunks(sys.stdin.fileno(), clock, options.duration):
            listener.take(chunk, clock.now())
            if listener.enough:
                break
        listener.finish()
        return listener.verdict()
    with closing(common.open_or_fail(options.url, clock)) as link:
        tell(f"listening at {link.name}")
        listener.links = [link]
        try:
            interrupted = common.attend([listener], clock, until=options.duration, over=lambda: listener.enough)
        finally:
            listener.finish()
    return INTERRUPTED if interrupted else listener.verdict()


def _chunks(fd: int, clock: Clock, duration: float) -> Iterator[bytes]:
    """Yield the bytes of a file until it ends, or for a time [s]."""
    until = clock.now() + duration
    while (left := until - clock.now()) > 0:
        if left < math.inf and not select.select([fd], [], [], min(left, _LOOK_S))[0]:
            continue
        if not (chunk := os.read(fd, 4096)):
            return
        yield chunk


@dataclass
class Listener:
    """A consumer. Remembers its decoder, how many frames are `left` to print, and the first bytes.

    Over MAVLink it sends a heartbeat each second with `hello`: autopilots forward nothing to a silent link.
    """

    decoder: FrameDecoder
    hello: Encoder | None
    format: str
    as_json: bool
    left: float
    links: Sequence[Link] = ()
    sample: bytes = b""  # the first bytes, until there is a frame
    alive_until: float = _WATCHDOG_S
    next_hello: float = 0.0

    @property
    def enough(self) -> bool:
        return self.left <= 0

    def service(self, clock: Clock) -> float:
        """Print the frames; warn once if they stop."""
        now = clock.now()
        for link in self.links:
            self.take(link.read(), now)
        if self.hello and now >= self.next_hello:
            self.next_hello = now + 1.0
            for link in self.links:
                link.write(self.hello.pack(heartbeat()))
        if now > self.alive_until:
            self.alive_until = math.inf
            tell(f"no frame for {_WATCHDOG_S:g} s" + (f": {self._doubt()}" if self.sample else ""))
        return now + PAUSE_S

    def take(self, chunk: bytes, now: float) -> None:
        """Decode and print."""
        frames = self.decoder.feed(chunk, now)
        if not self.decoder.good:
            self.sample += chunk[: SAMPLE_BYTES - len(self.sample)]
        elif self.sample:
            self.sample = b""
        for frame in frames:
            if self.left > 0:
                line = f"{frame.sequence:3d}  {text.reading(frame.channels)}"
                show_one(text.frame_json(frame), line, as_json=self.as_json)
            self.left -= 1
            self.alive_until = now + _WATCHDOG_S

    def finish(self) -> None:
        """Print the frames that are complete at the end of the stream, and a summary."""
        self.take(b"", math.inf)
        d = self.decoder
        tell(f"{d.good} frames, {d.lost} lost, {d.bad_crc} bad checksums, {d.dropped} bytes dropped")

    def verdict(self) -> int:
        """Return the exit code. Raises Failure if bytes came, but no frame."""
        if self.sample:
            raise Failure(FAILED, self._doubt())
        return OK

    def _doubt(self) -> str:
        return f"no {self.format} frame in {len(self.sample)} bytes: {guess_format(self.sample, self.format)}"
