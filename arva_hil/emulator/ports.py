"""The port of one receiver: from a frame to bytes with the scenario's faults, the host's commands, and all counters."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final, NamedTuple

from arva_hil import __version__
from arva_hil.autopilot.following.session import Session
from arva_hil.config import Scenario
from arva_hil.events import (
    BytesSent,
    CommandAnswered,
    CommandReceived,
    Event,
    FrameMade,
    FramesLate,
    FramesRefused,
    FramesTaken,
)
from arva_hil.model.receiver import Answer
from arva_hil.registry import FORMATS, over_mavlink
from firmware_proto import MAX_CHANNELS, Command, CommandAnswer, Frame, HostForm
from firmware_proto.commands import BUSY, CHANNELS, DONE, IDENTIFY, REFUSED, RESTART

if TYPE_CHECKING:
    from arva_hil.emulator.faults.plan import Faults  # slow to import, and most runs have none
    from arva_hil.emulator.faults.sending import Outbox

_LATE_S: Final = 0.05  # a frame that is made later than this is late
_OFTEN: Final = 10  # emit an event if there are this many more late frames than others

Obey = Callable[[float, str, Sequence[float]], Answer]
"""Handles a command of the host: the time on the driver's clock, its name and its values."""

_MOST_BYTES: Final = 4096  # used of one read, so that a flood does not delay the frames
_RATE_HZ: Final = 20.0  # commands executed per second on average; as many are answered with "busy"
_BURST: Final = 10  # more commands at once
_CLEAR_S: Final = 0.01  # no answer in this time before a frame; the longest takes 8 ms at 115200 baud


@dataclass
class CommandCounters:
    """The results of the commands: commands = done + refused + unknown + busy + unanswered."""

    commands: int = 0  # complete ones
    done: int = 0
    refused: int = 0
    unknown: int = 0
    busy: int = 0  # not executed, because too many came
    unanswered: int = 0  # not answered either, because far too many came
    answers_dropped: int = 0  # the link did not accept them
    bytes_dropped: int = 0  # that belong to no command


class RateLimit:
    """Allows `rate_hz` commands per second on average, and `burst` at once."""

    def __init__(self, rate_hz: float, burst: int) -> None:
        self._rate_hz = rate_hz
        self._most = self._left = float(burst)
        self._at = math.inf

    def take(self, now: float) -> bool:
        """Return True if one more is allowed at `now`, and count it."""
        self._left = min(self._most, self._left + self._rate_hz * max(0.0, now - self._at))
        self._at = now
        if self._left < 1:
            return False
        self._left -= 1
        return True


class HostCommands:
    """Remembers the commands of a receiver's host that are not executed yet, and the answers that are not sent yet.

    `vehicle`, `name`: for its events. `form`: how commands are encoded on this port. `obey`: the receiver's
    `command`. `channels`: the number in the newest frame.
    """

    def __init__(
        self,
        vehicle: str,
        name: str,
        scenario: Scenario,
        form: HostForm,
        obey: Obey,
    ) -> None:
        self.counters = CommandCounters()
        self._about = vehicle, name
        self._scenario = scenario
        self._form = form
        self._decoder = form.commands()
        self._obey = obey
        self.channels = scenario.receiver.channels
        self.heard = False  # True after the first byte; most hosts only listen
        self._commands: list[Command] = []
        self._answers: list[tuple[bytes, CommandAnswered]] = []
        self._executed = RateLimit(_RATE_HZ, _BURST)
        self._refusals = RateLimit(_RATE_HZ, _BURST)

    def receive(self, data: bytes, now: float) -> None:
        """Use bytes of the host that arrived at `now`."""
        self.heard = True
        self._commands += self._decoder.feed(data[:_MOST_BYTES], now)
        self._decoder.dropped += max(0, len(data) - _MOST_BYTES)

    def advance(self, now: float) -> list[Event]:
        """Execute the commands received. The receiver must have taken its samples until `now`. Returns the events."""
        self._commands += self._decoder.feed(b"", now)
        self.counters.bytes_dropped = self._decoder.dropped
        if not self._commands:
            return []
        commands, self._commands = self._commands, []
        return [event for command in commands if (event := self._take(command, now))]

    def answers(self, now: float, next_frame: float) -> list[tuple[bytes, CommandAnswered]]:
        """Return the answers to send now; none shortly before a frame."""
        if not self._answers or next_frame - now < _CLEAR_S:
            return []
        answers, self._answers = self._answers, []
        return answers

    def _take(self, command: Command, now: float) -> CommandReceived | None:
        """Execute one command, or refuse it if too many came."""
        counters = self.counters
        counters.commands += 1
        received = None
        if self._executed.take(now):
            received = CommandReceived(now, *self._about, command.number, command.name, command.values)
            result, values, text = self._result(command, now)
        elif self._refusals.take(now):
            result, values, text = BUSY, (), ""
        else:
            counters.unanswered += 1
            return None
        setattr(counters, result, getattr(counters, result) + 1)
        answer = CommandAnswer(command.number, command.name, result, values, text)
        told = CommandAnswered(now, *self._about, command.number, command.name, result, values, text, True)
        self._answers.append((self._form.answer(answer), told))
        return received

    def _result(self, command: Command, now: float) -> tuple[str, tuple[int, ...], str]:
        """Return result, values and text of the answer. Some commands do not need the model."""
        name, values = command.name, command.values
        if name == IDENTIFY:
            settings, form = self._scenario.receiver, self._scenario.output_format
            words = (settings.model, 12), (__version__, 8), (form, 10)
            identity = (re.sub(r"[^A-Za-z0-9.+_-]", "_", word)[:size] for word, size in words)
            return DONE, (self.channels,), " ".join(identity)
        if name == CHANNELS and not values:
            return DONE, (self.channels,), ""
        if name == CHANNELS and (len(values) > 1 or not 1 <= values[0] <= MAX_CHANNELS):
            return REFUSED, (), ""
        result = self._obey(now, name, values).value
        if result != DONE:
            return result, (), ""
        if name == RESTART:
            self.channels = self._scenario.receiver.channels
        elif name == CHANNELS:
            self.channels = values[0]
            return DONE, values, ""
        return DONE, (), ""


class Output(NamedTuple):
    """Bytes to write, from the time `due` [s] on. Then the driver calls `Emulator.written` with the `id`."""

    id: int
    link: str
    data: bytes
    due: float


class Parcel(NamedTuple):
    """Bytes for a port, and what to report when they are written."""

    data: bytes
    due: float
    whole: bool = True
    """The frame in them is undamaged."""
    made: FrameMade | None = None
    """The frame that is sent when they are accepted."""
    answer: CommandAnswered | None = None
    """The answer to a command, if they are one instead of a frame."""


@dataclass
class Counters:
    """The results of all frames: frames + duplicated = delivered + damaged + withheld + dropped + waiting."""

    frames: int = 0
    duplicated: int = 0  # copies that a fault added
    delivered: int = 0  # sent, undamaged
    damaged: int = 0  # sent, but changed by a fault
    withheld: int = 0  # not sent because of a fault
    dropped: int = 0  # the link did not accept it
    waiting: int = 0  # delayed by a fault, not sent yet
    no_pose: int = 0  # without a signal because the pose was unknown or too old
    skipped: int = 0  # not made because the loop was blocked for more than a second
    latest_s: float = 0.0  # the worst lateness


class LateWatch:
    """Remembers the number of recent late frames. `vehicle`, `receiver`: names for events."""

    def __init__(self, vehicle: str, receiver: str) -> None:
        self._about = vehicle, receiver
        self._late = 0  # late frames minus those in time; those of one instant count once
        self._checked_at = -math.inf
        self._reported = False

    def check(self, late_s: float, now: float) -> list[Event]:
        """Return an event if most frames are late, and the next one only after as many were in time."""
        if now == self._checked_at:  # one of a backlog, as after a stop of the process
            return []
        self._checked_at = now
        self._late = min(self._late + 1, _OFTEN) if late_s > _LATE_S else max(self._late - 1, 0)
        often, reported = self._late == _OFTEN, self._reported
        self._reported = often or (reported and self._late > 0)
        return [FramesLate(now, *self._about, late_s)] if often and not reported else []


class Port:
    """Remembers what was sent, and what waits because of faults or commands.

    `vehicle`, `name`: names for events. `link`: to which the bytes go. `encode`: the bytes of a frame at an instant of
    the vehicle's clock [ms]; b"" without a receiver of them.
    """

    def __init__(
        self,
        vehicle: str,
        name: str,
        link: str,
        encode: Callable[[Frame, int], bytes],
        faults: Faults | None,
        commands: HostCommands | None,
    ) -> None:
        self.name = name
        self.link = link
        self.counters = Counters()
        self.last: FrameMade | None = None
        self.commands = commands
        self._about = vehicle, name
        self._encode = encode
        self.faults = faults
        self._refused = False
        self._next_number = 0
        self._late_watch = LateWatch(vehicle, name)

    @property
    def next_due(self) -> float:
        """The time of the next bytes that a fault has delayed."""
        return self.faults.outbox.next_due if self.faults else math.inf

    def send(self, made: FrameMade, t: float) -> tuple[list[Parcel], list[Event]]:
        """Encode the frame of the instant `t`, with faults. Returns the bytes, and the events.

        The frame itself is an event here only if no bytes go out for it, otherwise when they are written.
        """
        events = self._late_watch.check(made.late_s, made.time_s)
        counters = self.counters
        counters.frames += 1
        counters.no_pose += made.pose is None
        counters.skipped += made.number - self._next_number
        counters.latest_s = max(counters.latest_s, made.late_s)
        self._next_number = made.number + 1
        boot_ms = 0 if made.boot_s is None else max(0, round(made.boot_s * 1e3)) % 2**32
        if self.commands:
            self.commands.channels = len(made.frame.channels)
        if self.faults and (self.faults.present or self.faults.outbox):
            parcels, unsent = self._send_with_faults(self.faults, made, t, boot_ms)
        else:
            data = self._encode(made.frame, boot_ms)
            parcels = [Parcel(data, t, made=made)] if data else []
            unsent = None if data else replace(made, sent=False)
            counters.dropped += not data
        if unsent is not None:
            self.last = unsent
            events.append(unsent)
        return parcels, events

    def release(self, now: float, next_frame: float) -> tuple[Sequence[Parcel], Sequence[Event]]:
        """Return the bytes that faults have delayed until now, or until the next frame, and the answers to commands.

        Commands are executed after all that is due; they are answered if no frame is due soon.
        """
        parcels = self._delayed(self.faults.outbox, min(now, next_frame)) if self.faults else []
        if not self.commands or not self.commands.heard:
            return parcels, ()
        events = self.commands.advance(now)
        answers = self.commands.answers(now, min(next_frame, self.next_due))
        return parcels + [Parcel(data, now, answer=answer) for data, answer in answers], events

    def _delayed(self, outbox: Outbox, until: float) -> list[Parcel]:
        """Return the bytes that faults have delayed until then."""
        parcels: list[Parcel] = []
        while (due := outbox.next_due) <= until and (queued := outbox.take(until)):
            data = self._encode(queued.frame, queued.boot_ms) if queued.data is None else queued.data
            if data:
                parcels.append(Parcel(data, due, queued.whole))
            else:
                self.counters.dropped += 1
        self.counters.waiting = len(outbox)
        return parcels

    def written(self, parcel: Parcel, accepted: bool, now: float, *, quiet: bool) -> list[Event]:
        """Count bytes that were written. `accepted`: the link has taken all of them.

        `quiet`: a refusal needs no event, because the link is lost or there is no vehicle yet.
        """
        if parcel.answer is not None:
            assert self.commands is not None
            self.commands.counters.answers_dropped += not accepted
            return [parcel.answer if accepted else replace(parcel.answer, sent=False)]
        counters, about = self.counters, (now, *self._about)
        events: list[Event] = []
        counters.dropped += not accepted
        counters.delivered += accepted and parcel.whole
        counters.damaged += accepted and not parcel.whole
        if self._refused == accepted and not quiet:
            self._refused = not accepted
            events.append(FramesTaken(*about, counters.dropped) if accepted else FramesRefused(*about))
        if accepted:
            events.append(BytesSent(*about, parcel.data))
        if parcel.made is not None:
            self.last = parcel.made if accepted else replace(parcel.made, sent=False)
            events.append(self.last)
        return events

    def fault_counts(self) -> dict[str, dict[str, int]]:
        """Return the numbers of frames and bytes that each fault changed, by its name."""
        return self.faults.counts() if self.faults else {}

    def _send_with_faults(
        self, faults: Faults, made: FrameMade, t: float, boot_ms: int
    ) -> tuple[list[Parcel], FrameMade | None]:
        """Return the bytes to write now; the frame, if none of them are for it."""
        faults.begin(made.number, made.instant_s)
        before = self._delayed(faults.outbox, t)
        frame, copies = faults.send(made.frame, t, boot_ms, self._encode)
        counters = self.counters
        counters.withheld += not copies
        counters.duplicated += max(0, copies - 1)
        parcels = self._delayed(faults.outbox, t)
        made = replace(made, frame=frame, sent=copies > 0, faults=faults.met)
        if parcels:
            parcels[-1] = parcels[-1]._replace(made=made)
            return before + parcels, None
        return before, made


def encoder(format: str, session: Session) -> Callable[[Frame, int], bytes]:
    """Return the encoder of a format: (frame, its instant in ms on the vehicle's clock) → bytes.

    Formats inside MAVLink give b"" while there is no vehicle. Raises KindError for an unknown format.
    """
    encode = FORMATS[format].encode
    if not over_mavlink(format):
        return lambda frame, boot_ms: encode(frame)

    def packed(frame: Frame, boot_ms: int) -> bytes:
        vehicle = session.vehicle
        return b"".join(map(session.encoder.pack, encode(frame, boot_ms, vehicle))) if vehicle else b""

    return packed
