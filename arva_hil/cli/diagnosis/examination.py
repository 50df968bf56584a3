"""The probes of `arva-hil doctor`: one reads the autopilot's link, one sends frames to the port. Both count."""

from __future__ import annotations

import math
import os
from collections import Counter, deque
from collections.abc import Callable, Sequence
from typing import Any, Final

from arva_hil.autopilot.following.discovery import is_autopilot, short_name
from arva_hil.autopilot.following.session import Session
from arva_hil.cli.diagnosis.diagnosis import PortTraffic, Source, StreamRate, Traffic, rate
from arva_hil.clock import Clock
from arva_hil.config import DEFAULT
from arva_hil.emulator.build import receiver
from arva_hil.emulator.receivers import frame_of
from arva_hil.events import Event
from arva_hil.events.vehicles import StreamEvent
from arva_hil.events.words.reasons import request
from arva_hil.events.words.sentences import sentence
from arva_hil.links import Address, Link, LinkEnded, LinkError, Sender
from arva_hil.links.processes import far_program, holders
from arva_hil.links.pty import PtyLink
from arva_hil.mavlink.codec import Packet, decode, dialect
from firmware_proto import Frame

_FRAME_S: Final = 0.5
_SAMPLE: Final = 4096  # bytes kept from the beginning
_LATELY_S: Final = 2.0
_MOST_SOURCES: Final = 32  # of heartbeats; a hostile link has 65,536
_READ: Final = (
    dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT,
    dialect.MAVLINK_MSG_ID_ATTITUDE,
    dialect.MAVLINK_MSG_ID_ATTITUDE_QUATERNION,
    dialect.MAVLINK_MSG_ID_GPS_RAW_INT,
)


class PoseMessages:
    """Counts the vehicle's pose messages, and remembers their delays and the fix of GPS_RAW_INT in words."""

    def __init__(self) -> None:
        self.count: Counter[int] = Counter()  # by message id
        self.fix = ""
        self._offsets: deque[tuple[float, float]] = deque(maxlen=4096)  # host time, host − boot

    def add(self, msgid: int, message: Any, now: float) -> None:
        if msgid == dialect.MAVLINK_MSG_ID_GPS_RAW_INT:
            fix = short_name("GPS_FIX_TYPE", message.fix_type)
            self.fix = f"GPS {fix}, {message.satellites_visible} satellites"
        else:
            self.count[msgid] += 1
            self._offsets.append((now, now - message.time_boot_ms / 1e3))

    def lags(self, now: float) -> list[float]:
        """Return the delay of each recent message against the quickest one [s]."""
        offsets = [offset for at, offset in self._offsets if at > now - _LATELY_S]
        return [offset - min(offsets) for offset in offsets]


class AutopilotProbe:
    """Reads the autopilot's link as `run` does, and counts packets and messages. A task for the loop.

    `first`: called with the time until the first bytes [s].
    """

    def __init__(
        self, link: Link, session: Session, start: float, first: Callable[[float], None] = lambda after_s: None
    ) -> None:
        self.session = session
        self.start = start
        self.links: Sequence[Link] = [link]
        self.sample = bytearray()
        self.packets: Counter[str] = Counter()  # known (the checksum could be verified), old (MAVLink 1), signed
        self.messages = PoseMessages()
        self.followed_at = math.inf  # when a vehicle was first followed
        self.lost = ""
        self.link = link
        self._first = first
        self._sources: dict[tuple[int, int], Source] = {}
        self._said: dict[str, str] = {}

    @property
    def over(self) -> bool:
        """True if the link has ended."""
        return not self.links

    def close(self) -> None:
        self.links = []
        self.link.close()

    def service(self, clock: Clock) -> float:
        now = clock.now()
        if self.over:
            return now + 1.0
        try:
            for sender, chunk in self.link.receive():
                self.receive(chunk, now, sender)
            self.link.follow(self.session.senders.vehicle, self.session.senders.candidates)
            out, events = self.session.poll(now)
            if out:
                self.link.write(out)
            self._remember(events)
        except LinkEnded:
            self.links = []
        except LinkError as error:
            self.links, self.lost = [], str(error)
        return self.session.next_due

    def receive(self, chunk: bytes, now: float, sender: Sender = None) -> None:
        """Count the packets in `chunk`."""
        if chunk and not self.session.reader.bytes:
            self._first(now - self.start)
        self.sample += chunk[: _SAMPLE - len(self.sample)]
        received = self.session.feed(chunk, now, sender)
        for packet in (*received.accepted, *received.refused):
            self.packets.update(known=packet.known, old=packet.version == 1, signed=packet.signed)
            if packet.msgid == dialect.MAVLINK_MSG_ID_HEARTBEAT:
                self._on_heartbeat(packet, now)
        for msgid, message in received.messages(_READ):
            self.messages.add(msgid, message, now)
        if self.session.vehicle:
            self.followed_at = min(self.followed_at, now)
        self._remember(received.events)

    def _remember(self, events: Sequence[Event]) -> None:
        """Remember the last sentence about each stream."""
        for event in events:
            if isinstance(event, StreamEvent) and (said := sentence(event)):
                self._said[event.stream] = said.text.removeprefix(event.stream).lstrip(": ")

    def _on_heartbeat(self, packet: Packet, now: float) -> None:
        if (message := decode(packet)) is None:
            return
        key = packet.system, packet.component
        if key not in self._sources:
            if len(self._sources) >= _MOST_SOURCES:
                return
            kind, pilot = short_name("MAV_TYPE", message.type), is_autopilot(message)
            name = f"{short_name('MAV_AUTOPILOT', message.autopilot)} {kind}" if pilot else kind
            self._sources[key] = Source(*key, name, pilot, 0, None, now)
        source = self._sources[key]
        source.hz = source.count / (now - source.first_s) if now > source.first_s else None
        source.count += 1

    def traffic(self, now: float) -> Traffic:
        reader = self.session.reader
        return Traffic(
            now - self.start,
            reader.bytes,
            reader.parser.packets,
            self.packets["old"],
            self.packets["signed"],
            reader.parser.bad_crc,
            self.session.disbelieved_signatures(),
        )

    def sources(self) -> list[Source]:
        """Return the sources, autopilots first."""
        return sorted(self._sources.values(), key=lambda source: not source.pilot)

    def streams(self, now: float, wanted_hz: float, *, recorded: bool) -> list[StreamRate]:
        return [
            StreamRate(
                stream.name,
                sum(self.messages.count[msgid] for msgid in stream.ids),
                max(rate(times, now) for times in stream.seen.values()),
                wanted_hz,
                "" if recorded else self._said.get(stream.name, request(*stream.asked)),
                recorded,
                stream.promised,
            )
            for stream in self.session.streams.wanted
        ]


class PortProbe:
    """Sends frames with no signal to the port, and counts those that were accepted. A task for the loop.

    `encode`: (frame, its instant in ms) → bytes, b"" if there is no vehicle to send them to. `address`: the port's;
    None if frames go over the autopilot's link, which another task reads.
    """

    def __init__(
        self, encode: Callable[[Frame, int], bytes], link: Link, address: Address | None, start: float
    ) -> None:
        self._encode = encode
        self._link = link
        self._out = link if address else None
        self.links: Sequence[Link] = [link] if address else []
        self._address = address
        self._traffic = PortTraffic(*(address.kind, str(address)) if address else ("mavlink", ""))
        self._receiver = receiver(DEFAULT)
        self._next = start
        self._sequence = 0
        self._refusals = 0  # before the last frame; the consumer may have come since

    def service(self, clock: Clock) -> float:
        now = clock.now()
        if self._traffic.lost:
            return now + 1.0
        try:
            if self._out:
                self._traffic.answered += len(self._out.read())
            if now >= self._next:
                self._next = now + _FRAME_S
                self._send(now)
        except LinkError as error:
            self._traffic.lost, self.links = str(error), []
        return self._next

    def _send(self, now: float) -> None:
        data = self._encode(frame_of(self._receiver.show(now), self._sequence % 256), round(now * 1e3))
        self._sequence += 1
        if data:
            sent = self._link.write(data)
            self._refusals = self._out.refusals if self._out else 0
            self._traffic.taken += sent
            self._traffic.dropped += not sent

    def traffic(self) -> PortTraffic:
        """Return the number of frames accepted, and the programs at the other end."""
        traffic = self._traffic
        if isinstance(self._out, PtyLink):
            traffic.name = self._out.symlink or self._out.path
            own = str(os.getpid())
            traffic.seen = [who for who in holders(self._out.path) if who.split()[0] != own]
            traffic.unread = self._out.unread()
        elif self._address and traffic.kind == "serial" and (program := far_program(self._address.path)):
            traffic.seen = [program]
        traffic.refused = self._out is not None and self._out.refusals > self._refusals
        return traffic
