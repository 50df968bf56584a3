"""The two links of a search: the autopilot's, read until it is empty so that no order is late; the receiver's."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Final

from arva_hil.clock import Clock
from arva_hil.events import Event
from arva_hil.events.reasons import Reason, Why, because
from arva_hil.events.searches import ReceiverGone
from arva_hil.links import Link, LinkError, Sender
from arva_hil.runtime.link_monitor import LinkMonitor
from arva_hil.search.mission.victims import ReceiverHost
from firmware_proto import Frame, FrameDecoder, HostForm

_GAP_S: Final = 1.0  # after this time without reading, another person may have controlled the vehicle
_AT_ONCE: Final = 1 << 18  # the most bytes to read at a time
_AT_ONCE_S: Final = 0.2
_HELD_UP_S: Final = 0.04  # an order is sent within this time after the link was empty
_LOOKS: Final = 3
_AGAIN_S: Final = 0.02


class AutopilotLink:
    """Remembers when the link was last empty. Times are seconds on the caller's clock.

    `on_bytes(sender, chunk, now, since)` gets the bytes; `since`: when the link was empty before. `on_gap(now, gap_s)`
    is called after a gap, before anything is read.
    """

    def __init__(
        self,
        link: Link,
        start: float,
        *,
        on_bytes: Callable[[Sender, bytes, float, float], None],
        on_gap: Callable[[float, float], None],
    ) -> None:
        self.link = link
        self._on_bytes = on_bytes
        self._on_gap = on_gap
        self._empty_s = start
        self._gap = False  # whether there was a gap
        self._losses: int | None = None  # of the link, when it was pinned

    def pin(self) -> None:
        """Accept no new far end from now on: `take_in` raises LinkError."""
        self.link.pin()
        self._losses = self.link.losses

    def take_in(self, clock: Clock) -> bool:
        """Read until the link is empty. Return True if it is; the rest of a flood is read the next time."""
        begun = now = clock.now()
        since, read = self._empty_s, 0
        if now - since > _GAP_S and not self._gap:
            self._gap = True
            self._on_gap(now, now - since)
        while True:
            came = self.link.receive()
            if self._losses is not None and self.link.losses > self._losses:
                raise LinkError(self.link.name, self.link.why.removeprefix(f"{self.link.name}: "))
            for sender, chunk in came:
                self._on_bytes(sender, chunk, now, since)
                read += len(chunk)
            now = clock.now()
            if not self.link.ready():
                self._empty_s, self._gap = now, False
                return True
            if read > _AT_ONCE or now - begun > _AT_ONCE_S:
                return False

    def speak(self, clock: Clock, due: Callable[[float], tuple[bytes, bytes]], sent: Callable[[float], float]) -> float:
        """Send bytes, and orders only if the link was empty a moment ago; then call `sent`.

        Returns when to call it again: the result of `sent`, soon if orders were not sent, infinite if there are none.
        """
        for _ in range(_LOOKS):  # with a stepped clock the link stays as empty as before
            empty = (self._empty_s == clock.now() and not self.link.ready()) or self.take_in(clock)
            out, orders = due(clock.now())
            in_time = empty and clock.now() - self._empty_s <= _HELD_UP_S
            data = out + orders if in_time else out
            went = self.link.write(data) if data else True
            if in_time and went:
                return sent(clock.now())
            if in_time or not empty:
                break
        return clock.now() + _AGAIN_S if orders else math.inf


_LATE: Final = 8  # frames before the last one: it was overtaken; a larger step back is a restart of the receiver


class NewFrames:
    """Remembers the sequence number of the last frame.

    A repeated number is the same frame, and a slightly lower one is late: neither is used. The decoders of formats
    without a sequence number count, so that each of their frames is new.
    """

    def __init__(self) -> None:
        self.repeats = 0  # of the last frame, in a row
        self._last: int | None = None

    def new(self, frame: Frame) -> bool:
        ahead = _LATE if self._last is None else (frame.sequence - self._last + _LATE) % 256
        if self._last is not None and ahead <= _LATE:
            self.repeats += ahead == _LATE
            return False
        self._last, self.repeats = frame.sequence, 0
        return True


_SILENT_S: Final = 2.0  # after this time without a frame the receiver is lost
_MOST_READS: Final = 64
_SHOWN: Final = 16  # report so many bytes, if there is no frame in them


class ReceiverLink:
    """The receiver's link, with its newest frames and their times. An unplugged link is silent, without an error.

    `emit` gets the events of a link that is lost and comes back. Other kinds of links do not come back. `host`: for
    commands on the same port, None without `form`.
    """

    def __init__(
        self, link: Link, decoder: FrameDecoder, emit: Callable[[Event], None], form: HostForm | None = None
    ) -> None:
        self.links: Sequence[Link] = [link]  # to wait for; empty if the link is gone
        self.last: Frame | None = None
        self._link = link
        self._emit = emit
        self._monitor = LinkMonitor("receiver", link)
        self._decoder = decoder
        self._last_s = -math.inf
        self._first_bytes = b""
        self._fresh = NewFrames()
        self.host = ReceiverHost(form, self._write) if form else None

    @property
    def name(self) -> str:
        return self._link.name

    def read(self, now: float) -> list[Frame]:
        """Return the new frames until `now` [s]. A repeated frame is not new."""
        if chunk := self._read(now) if self.links else b"":
            self._first_bytes += chunk[: _SHOWN - len(self._first_bytes)]
        every = self._decoder.feed(chunk, now)
        if not every or self._monitor.away:
            for event in self._monitor.poll(now):
                self._emit(event)
        if frames := [frame for frame in every if self._fresh.new(frame)]:
            self.last, self._last_s = frames[-1], now
        return frames

    def skip(self, now: float) -> None:
        """Discard waiting bytes: they came in a gap, in which the vehicle's place is unknown."""
        for _ in range(_MOST_READS):
            if not self.links or not self._link.ready():
                break
            self._decoder.feed(self._read(now), now)

    def silent(self, now: float, limit_s: float = _SILENT_S) -> bool:
        return now - self._last_s > limit_s

    def why_silent(self, now: float) -> Reason:
        """Return the data received instead of frames."""
        if self._link.away:
            return because(Why.RECEIVER_AWAY, text=self._link.why)
        return because(
            Why.RECEIVER_SILENT,
            link=self._link.name,
            age_s=now - self._last_s if self.last else None,
            repeated=self.last.sequence if self.last and self._fresh.repeats else None,
            first_bytes=self._first_bytes,
        )

    def _read(self, now: float) -> bytes:
        try:
            chunk = self._link.read()
        except LinkError as error:
            self.links = []
            self._emit(ReceiverGone(now, str(error)))
            return b""
        if self.host and self.host.waiting:
            self.host.feed(chunk, now)
        return chunk

    def _write(self, data: bytes) -> bool:
        try:
            return bool(self.links) and self._link.write(data)
        except LinkError:  # the next read reports it
            return False
