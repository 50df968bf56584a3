"""The receiver of a search: frames from a link, and the reason if none come."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Final

from arva_hil.events import Event
from arva_hil.events.reasons import Reason, Why, because
from arva_hil.events.searches import ReceiverGone
from arva_hil.links import Link, LinkError
from arva_hil.runtime.link_monitor import LinkMonitor
from arva_hil.search.mission.reading_checks import NewFrames
from arva_hil.search.mission.receiver_host import ReceiverHost
from firmware_proto import Frame, FrameDecoder, HostForm

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
        if not (every := self._decoder.feed(chunk, now)):
            return every
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
        for event in self._monitor.poll(now):
            self._emit(event)
        if self.host:
            self.host.feed(chunk, now)
        return chunk

    def _write(self, data: bytes) -> bool:
        try:
            return bool(self.links) and self._link.write(data)
        except LinkError:  # the next read reports it
            return False
