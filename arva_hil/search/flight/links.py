"""The two links of a search: the autopilot's, read until it is empty so that no order is late; the receiver's.

On the autopilot's link are the other searches: those of the team, and those that claim the same vehicle.
"""

from __future__ import annotations

import math
import os
import platform
import secrets
import struct
from collections.abc import Callable, Sequence
from typing import Any, Final, NamedTuple

from arva_hil.autopilot.following.discovery import Vehicle
from arva_hil.autopilot.following.navigation import ClockMap
from arva_hil.autopilot.following.session import Received
from arva_hil.clock import Clock
from arva_hil.events import Event
from arva_hil.events.reasons import Reason, Why, because
from arva_hil.events.searches import ReceiverGone
from arva_hil.links import Link, LinkError, Sender
from arva_hil.mavlink.codec import Packet, tunnel
from arva_hil.runtime.link_monitor import LinkMonitor
from arva_hil.search.mission.choice import SILENT_S
from arva_hil.search.mission.victims import ReceiverHost
from arva_hil.search.team.team import Teammate
from arva_hil.search.team.team_tunnel import TeamTunnel, payload_of
from firmware_proto import NOT_SEARCHING, SELF_TEST_FAULT, Frame, FrameDecoder, HostForm

_GAP_S: Final = 1.0  # after this time without reading, another person may have controlled the vehicle
_AT_ONCE: Final = 1 << 18  # the most bytes to read at a time
_AT_ONCE_S: Final = 0.2
_HELD_UP_S: Final = 0.04  # an order is sent within this time after the link was empty
_LOOKS: Final = 3
_AGAIN_S: Final = 0.02


class AutopilotLink:
    """Remembers when the link was last empty (`empty_s`). Times are seconds on the caller's clock.

    `others`: the other searches on the link.
    `on_bytes(sender, chunk, now, since)` gets the bytes; `since`: when the link was empty before. `on_gap(now, gap_s)`
    is called after a gap, before anything is read.
    """

    def __init__(
        self,
        link: Link,
        others: OtherSearches,
        start: float,
        *,
        on_bytes: Callable[[Sender, bytes, float, float], None],
        on_gap: Callable[[float, float], None],
    ) -> None:
        self.link = link
        self.others = others
        self.empty_s = start
        self._on_bytes = on_bytes
        self._on_gap = on_gap
        self._gap = False  # whether there was a gap
        self._losses: int | None = None  # of the link, when it was pinned

    def pin(self) -> None:
        """Accept no new far end from now on: `take_in` raises LinkError."""
        self.link.pin()
        self._losses = self.link.losses

    def take_in(self, clock: Clock) -> bool:
        """Read until the link is empty. Return True if it is; the rest of a flood is read the next time."""
        begun = now = clock.now()
        since, read = self.empty_s, 0
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
                self.empty_s, self._gap = now, False
                return True
            if read > _AT_ONCE or now - begun > _AT_ONCE_S:
                return False

    def speak(self, clock: Clock, due: Callable[[float], tuple[bytes, bytes]], sent: Callable[[float], float]) -> float:
        """Send bytes, and orders only if the link was empty a moment ago; then call `sent`.

        Returns when to call it again: the result of `sent`, soon if orders were not sent, infinite if there are none.
        """
        for _ in range(_LOOKS):  # with a stepped clock the link stays as empty as before
            empty = (self.empty_s == clock.now() and not self.link.ready()) or self.take_in(clock)
            out, orders = due(clock.now())
            in_time = empty and clock.now() - self.empty_s <= _HELD_UP_S
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


_UNFIT: Final = SELF_TEST_FAULT | NOT_SEARCHING  # of the status: do not search with this receiver
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
        self._unfit = 0  # bits of the newest status
        self._fresh = NewFrames()
        self.host = ReceiverHost(form, self._write) if form else None

    @property
    def name(self) -> str:
        return self._link.name

    def read(self, now: float) -> list[Frame]:
        """Return the good new frames until `now` [s]. A repeated frame is not new."""
        if chunk := self._read(now) if self.links else b"":
            self._first_bytes += chunk[: _SHOWN - len(self._first_bytes)]
        every = self._decoder.feed(chunk, now)
        if not every or self._monitor.away:
            for event in self._monitor.poll(now):
                self._emit(event)
        fresh = [frame for frame in every if self._fresh.new(frame)]
        if fresh:
            self._unfit = fresh[-1].status & _UNFIT
        if frames := [frame for frame in fresh if not frame.status & _UNFIT]:
            self.last, self._last_s = frames[-1], now
        return frames

    def skip(self, now: float) -> None:
        """Discard waiting bytes: they came in a gap, in which the vehicle's place is unknown."""
        for _ in range(_MOST_READS):
            if not self.links or not self._link.ready():
                break
            self._decoder.feed(self._read(now), now)

    def silent(self, now: float, limit_s: float = SILENT_S) -> bool:
        return now - self._last_s > limit_s

    def why_silent(self, now: float) -> Reason:
        """Return the data received instead of frames."""
        if self._link.away:
            return because(Why.RECEIVER_AWAY, text=self._link.why)
        if self._unfit:
            return because(Why.RECEIVER_UNFIT, failed=bool(self._unfit & SELF_TEST_FAULT))
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


CLAIM_TYPE: Final = 42073  # the payload type, in MAVLink's private range; a team's news have the one before
QUIET_S: Final = 1.5  # arm after this time without an objection to the first announcement
_VERSION: Final = 1  # of the payload
_HEAD: Final = struct.Struct("<BBqQ")
_LAUNCHED: Final = 1
_LONGEST: Final = 64  # bytes of a name
_LATEST: Final = 2**63 - 1  # ms, before the own first announcement: every other search precedes
_EVERY_S: Final = 0.5  # between two claims


class Claim(NamedTuple):
    """One search that wants the vehicle.

    It announces itself to other searches of this vehicle by a broadcast TUNNEL message. All searches of a vehicle have
    the same system and component. ArduPilot does not forward a heartbeat between two links that send the same ids, but
    both autopilots forward a broadcast TUNNEL.

    A payload has the version, flags (1: launched), `since_ms`, the vehicle's boot time at the start of the search,
    `number`, which is random and distinguishes searches, and the name in ASCII. All numbers are little-endian.
    """

    launched: bool
    since_ms: int
    number: int
    name: str

    def precedes(self, other: Claim) -> bool:
        """Return True if this search gets the vehicle: it flies it already, or it began first."""
        return (not self.launched, *self[1:3]) < (not other.launched, *other[1:3])

    def encode(self) -> bytes:
        """Return the payload."""
        name = self.name.encode("ascii", "replace")[:_LONGEST]
        return _HEAD.pack(_VERSION, self.launched, self.since_ms, self.number) + name

    @classmethod
    def parse(cls, payload: bytes) -> Claim | None:
        """Return the claim in a payload, None if it is something else."""
        if not _HEAD.size <= len(payload) <= _HEAD.size + _LONGEST:
            return None
        version, flags, since_ms, number = _HEAD.unpack_from(payload)
        name = payload[_HEAD.size :].decode("ascii", "replace")
        if version != _VERSION or flags > _LAUNCHED or not name.isprintable():
            return None
        return cls(bool(flags), since_ms, number, name)


class OtherSearches:
    """The other searches: those of the team, and those that claim the vehicle of this one.

    `component`: of all searches. `team`: if this search is one of several; `tunnel`: to them, if they are other
    programs. `first`: the claim of another search that gets the vehicle; None without one.
    """

    def __init__(self, component: int, team: Teammate | None, tunnel: TeamTunnel | None) -> None:
        self.first: Claim | None = None
        name = f"process {os.getpid()} on {platform.node() or 'an unknown computer'}"
        self._own = Claim(False, _LATEST, secrets.randbits(64), name)
        self._component = component
        self._team = team
        self._tunnel = tunnel
        self._first_s: float | None = None  # of the own announcements
        self._next_s = -math.inf

    def is_settled(self, now: float) -> bool:
        """Return True if other searches have had the time to object to the own claim."""
        return self._first_s is not None and now - self._first_s >= QUIET_S

    def on_packets(self, received: Received, vehicle: Vehicle | None, now: float) -> None:
        """Use what the session received."""
        if self._tunnel and self._team:
            for packet in received.accepted:
                if news := self._tunnel.on_packet(packet, now):
                    self._team.on_news(news)
        if vehicle and not self.first:
            self.first = self._find_first(received.others, vehicle.system)

    def poll(self, now: float, clock: ClockMap | None, *, launched: bool) -> list[Any]:
        """Return the news and the claim to send now. `clock`: the vehicle's; None: claim nothing."""
        messages = self._tunnel.poll() if self._tunnel else []
        due = now >= self._next_s or launched != self._own.launched
        boot_s = clock.boot(now) if clock and due else None
        if boot_s is None:
            return messages
        if self._first_s is None:
            self._first_s = now
            self._own = self._own._replace(since_ms=round(boot_s * 1e3))
        self._own = self._own._replace(launched=launched)
        self._next_s = now + _EVERY_S
        return [*messages, tunnel(CLAIM_TYPE, self._own.encode())]

    def _find_first(self, packets: Sequence[Packet], system: int) -> Claim | None:
        """Return the claim of another search that gets the vehicle of this system, None if there is none."""
        for packet in packets:
            payload = payload_of(packet, CLAIM_TYPE, self._component) if packet.system == system else None
            claim = Claim.parse(payload) if payload is not None else None
            if claim and claim.number != self._own.number and claim.precedes(self._own):
                return claim
        return None
