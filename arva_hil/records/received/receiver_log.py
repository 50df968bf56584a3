"""The log of a real receiver: packets of an autopilot and frames of a receiver in; events for a record out.

It has the same calls as the emulator's engine, so that the same driver serves it. It opens no link, and sends nothing
but what a session requests from its vehicle.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

from arva_hil.autopilot.following.session import Session
from arva_hil.config import DEFAULT, Lla, Scenario, Transmitter
from arva_hil.emulator.engine import NOBODY, Addressees, EngineOptions
from arva_hil.emulator.formats import zone_of
from arva_hil.emulator.ports import Output
from arva_hil.emulator.receivers import Mounting
from arva_hil.emulator.setup import VehicleSetup
from arva_hil.emulator.world import Snapshot, VehicleWorld
from arva_hil.events import (
    BytesSent,
    Event,
    FrameMade,
    HeartbeatMissing,
    PacketsReceived,
    ReceiverRestarted,
    ReceiverStatus,
    StatusReport,
    VehicleStatus,
)
from arva_hil.model.receiver import ChannelReading, Reading, with_true_ranges
from firmware_proto import Frame, FrameDecoder
from firmware_proto.frame import INTERFERENCE, MORE_TRANSMITTERS, NOT_SEARCHING, OVERLAP, RESTART, SELF_TEST_FAULT

AUTOPILOT, RECEIVER = "autopilot", "receiver"
"""The names of the two links."""

Surveyed = tuple[int, float, float, float]
"""A transmitter whose place was surveyed: its id, and degrees, degrees, metres AMSL."""

SAMPLE_BYTES: Final = 1 << 14  # enough of any format for several frames

_ABOUT: Final = ("vehicle", "receiver")
_PATIENCE_S: Final = 1.0  # a frame waits this long for the packets that its pose needs
_STATUS_S: Final = 0.25


class _Waiting(NamedTuple):
    """A frame and the time at which its last byte came."""

    t: float
    frame: Frame


class ReceivedFrames:
    """The frames of a receiver that wait for their poses.

    - `decoder`: of the receiver's format. `numbered`: the frames have sequence numbers.
    - `restarts`: number of restarts of the receiver. `first_bytes`: those that came before the first frame.
    """

    def __init__(self, decoder: FrameDecoder, *, numbered: bool) -> None:
        self.decoder = decoder
        self.restarts = 0
        self.first_bytes = b""
        self.waiting: deque[_Waiting] = deque()
        self._numbered = numbered
        self._before: _Waiting | None = None

    def feed(self, data: bytes, now: float, at: float) -> list[Event]:
        """Use bytes that came at `at`, decoded at `now`. Returns the events."""
        frames = self.decoder.feed(data, now)
        events: list[Event] = [BytesSent(at, *_ABOUT, data)] if data else []
        if not self.decoder.good:
            self.first_bytes += data[: SAMPLE_BYTES - len(self.first_bytes)]
        for frame in frames:
            came = _Waiting(at, frame)
            if self._numbered and self._before and _restarted(self._before, came):
                self.restarts += 1
                events.append(ReceiverRestarted(at, *_ABOUT, self._before.frame.sequence, frame.sequence))
            self._before = came
            self.waiting.append(came)
        return events


@dataclass
class _Made:
    """The frames made so far: their number, those without a pose, and the newest."""

    frames: int = 0
    no_pose: int = 0
    last: FrameMade | None = None


class ReceiverLog:
    """Remembers the vehicle, the frames that wait for their poses, and the faults.

    - `scenario`: the surveyed transmitters, and the mount. `session`: follows the vehicle.
    - `received`: the receiver's frames.
    - `start`: of the record. `timeout_s`: without a heartbeat, until there is an event.
    - `max_age_s`: an older pose is not used.
    - `made`: the counters of frames. `missing`: no heartbeat came in time.
    """

    options: Final = EngineOptions(_PATIENCE_S, tell_packets=True, tell_status=True, needs_times=True)

    def __init__(
        self,
        scenario: Scenario,
        session: Session,
        received: ReceivedFrames,
        *,
        start: float,
        timeout_s: float = math.inf,
        max_age_s: float = 2.0,
    ) -> None:
        self.session = session
        self.received = received
        self.world = VehicleWorld(
            VehicleSetup(_ABOUT[0], AUTOPILOT, session, scenario, ()), {}, start=start, max_age_s=max_age_s
        )
        self.made = _Made()
        self.missing = False
        self._mounting = Mounting(scenario)
        self._start = self._now = start
        self._missing_from = start + timeout_s
        self._next_status = start
        self._events: list[Event] = []
        self._outputs: list[Output] = []

    def receive(
        self, link: str, data: bytes, now: float, sender: Hashable = None, *, whole: bool = False
    ) -> Addressees:
        """Use bytes that came at `now`. Returns the senders to which the autopilot's link writes from now on."""
        if link == RECEIVER:
            self._on_receiver(data, now)
            return NOBODY
        session = self.session
        packets = session.reader.feed(data, now, sender, stranger=not session.accepts(sender, now), whole=whole)
        self._events.append(PacketsReceived(now, AUTOPILOT, packets if session.follows(sender) else ()))
        self._events += self.world.update(session.receive(packets, now, sender), now)
        self._make_frames(now)
        return NOBODY if sender is None else Addressees(session.senders.vehicle, session.senders.candidates)

    def link_lost(self, link: str, why: str, now: float) -> None:
        """Handle a link that is lost until `link_back`."""
        if link == AUTOPILOT:
            self.session.interrupt(why)

    def link_back(self, link: str, now: float) -> None:
        """Handle a link that is back."""
        if link == AUTOPILOT:
            self.session.resume(now)

    def advance(self, now: float, *, final: bool = False) -> None:
        """Do what is due until `now`. `final`: nothing more will come."""
        self._now = now
        self._on_receiver(b"", math.inf if final else now)
        self._make_frames(now, final=final)
        data, events = self.world.poll(now)
        self._events += events
        if data:
            self._outputs.append(Output(0, AUTOPILOT, data, now))
        if now >= self._missing_from or final:
            self._missing_from = math.inf
            if self.session.vehicle is None and not self.missing:
                self.missing = True
                self._events.append(HeartbeatMissing(now, _ABOUT[0], self.session.why_no_vehicle()))

    def next_deadline(self) -> float:
        """Return the latest time for the next call of `advance`."""
        return min(self._next_status, self.session.next_due, self._missing_from)

    def output(self) -> list[Output]:
        """Return the requests to the autopilot."""
        outputs, self._outputs = self._outputs, []
        return outputs

    def written(self, output: int, accepted: bool, now: float) -> None:
        """Do nothing: requests are repeated until the autopilot answers."""

    def events(self) -> list[Event]:
        """Return the events since the last call."""
        if self._now >= self._next_status:
            self._next_status = self._now + _STATUS_S
            self._events.append(self._status())
        events, self._events = self._events, []
        return events

    def counts(self) -> dict[str, int]:
        """Return counters by name."""
        d, restarts = self.received.decoder, self.received.restarts
        of_frames = {"frames": self.made.frames, "no_pose": self.made.no_pose, "restarts": restarts, "lost": d.lost}
        return {**of_frames, "bad_crc": d.bad_crc, "bytes_dropped": d.dropped, **self.session.counts()}

    def _status(self) -> StatusReport:
        session, now = self.session, self._now
        receiver = ReceiverStatus(_ABOUT[1], self.made.last, self.made.frames, 0, self.world.at(now).transmitters)
        found = session.vehicle
        label, source = (found.short, (AUTOPILOT, found.system)) if found else ("", None)
        return StatusReport(now, [VehicleStatus(_ABOUT[0], label, session.rates(now), [receiver], (), source)])

    def _on_receiver(self, data: bytes, now: float) -> None:
        self._events += self.received.feed(data, now, self._now if math.isinf(now) else now)

    def _make_frames(self, now: float, *, final: bool = False) -> None:
        waiting = self.received.waiting
        while waiting and (final or self.world.is_known(waiting[0].t) or now - waiting[0].t >= _PATIENCE_S):
            came = waiting.popleft()
            self.made.last = event = self._frame_made(came, self.world.at(came.t))
            self.made.frames += 1
            self.made.no_pose += event.pose is None
            self._events.append(event)

    def _frame_made(self, came: _Waiting, seen: Snapshot) -> FrameMade:
        pose = self._mounting.pose(seen.pose, came.t - self._start, swings=True)
        ranges = seen.transmitters.ranges(pose.position) if pose else {}
        slots = [
            ChannelReading(c.id, c.zone or zone_of(c.d, c.delta), c.d, c.delta, None, c.marked)
            for c in came.frame.channels  # some formats do not carry the zone
        ]
        status, instant_s = came.frame.status, came.t - self._start
        reading = Reading(
            with_true_ranges(slots, ranges),
            interference=bool(status & INTERFERENCE),
            more_heard=bool(status & MORE_TRANSMITTERS),
            overlapping=bool(status & OVERLAP),
            searching=not status & NOT_SEARCHING,
            failed=bool(status & SELF_TEST_FAULT),
        )
        return FrameMade(
            came.t,
            *_ABOUT,
            self.made.frames,
            instant_s,
            seen.boot_s,
            pose,
            seen.age_s if pose else None,
            reading,
            came.frame,
            True,
            0.0,
            (),
            pose,
        )


def surveyed_scenario(places: Sequence[Surveyed]) -> Scenario:
    """Return a scenario with these transmitters. Their attitudes are not known, and have the default.

    Without places it has no transmitters. Raises ValueError if an id occurs twice.
    """
    return Scenario(
        tuple(Transmitter(id=id_, lla=Lla(*place)) for id_, *place in places),
        source="surveyed places" if places else DEFAULT.source,
    )


def _restarted(before: _Waiting, came: _Waiting) -> bool:
    """Return True if the sequence number began again from 0."""
    return came.frame.sequence < RESTART < (came.frame.sequence - before.frame.sequence) % 256 - 1
