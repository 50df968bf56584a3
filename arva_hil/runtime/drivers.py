"""The drivers of an engine: `Live` with a clock and links, as a task of the loop; `replay` with a log.

`Live` with a stepped clock is the third: tests and campaigns use the same calls as fast as possible.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from typing import Final

from arva_hil.emulator.engine import Emulator
from arva_hil.emulator.frame_source import Output
from arva_hil.events import LinkLost
from arva_hil.links import Link, LinkError
from arva_hil.links.base import Sender
from arva_hil.links.tlog_timeline import Record
from arva_hil.observers.audience import Audience
from arva_hil.runtime.clock import Clock, Waitable
from arva_hil.runtime.link_monitor import LinkMonitor
from arva_hil.runtime.ready_links import ReadyLinks
from arva_hil.runtime.rests import Rests

_LONGEST_WAIT_S: Final = 0.1  # a signal is noticed within this time
_LOOK_S: Final = 0.05  # the shortest time between two checks of the links; these are no deadlines
_STALL_S: Final = 0.05  # a frame that is later than this waits until everything that arrived is read
_CATCH_UP_S: Final = 0.25  # at most: where more arrives than can be read, frames are late, but they are sent
_PIECE: Final = 4096  # bytes that are used at a time
_MOST_BYTES: Final = 1 << 16  # that wait to be used
_PAUSE_S: Final = 0.11  # what comes so long after the last use is used at once,
_SHORTLY_S: Final = 0.005  # and so shortly before something is due; the rest waits for one of these
_HELD_UP_S: Final = 0.001  # after this time of reading, frames that are due are sent first
_MOST_RECORDS: Final = 256
LOOK_AHEAD_S: Final = 1.0  # how far a log is read after the instant of a frame, to interpolate


class Live:
    """Drives an engine with links and the loop's clock, and gives events to the audience. A task of the loop.

    `autopilots`: the links on which vehicles are heard; `ports`: the links for frames, on which commands of the
    receiver's host come; both by the engine's names. A link that is lost for ever is left out while there are others of
    its kind; the error of the last one is raised.
    """

    def __init__(
        self, emulator: Emulator, autopilots: Mapping[str, Link], ports: Mapping[str, Link], audience: Audience
    ) -> None:
        self.emulator = emulator
        self._autopilots = autopilots
        self._ports = ports
        self.sinks = {**ports, **autopilots}
        lost, back = emulator.link_lost, emulator.link_back
        self._monitors = [LinkMonitor(n, link, partial(lost, n), partial(back, n)) for n, link in self.sinks.items()]
        self._audience = audience
        self._ready = ReadyLinks(autopilots)
        self._rests = Rests(emulator.clock_samples)
        self._resting = False
        self._next_look = -math.inf
        self._arrived: list[tuple[str, bytes, float, Sender]] = []  # and not used yet
        self._waiting = 0  # bytes of it
        self._read_bytes = 0  # in this call
        self._use_at = -math.inf
        self._deadline = emulator.next_deadline()
        self._gone: set[str] = set()
        for name, link in autopilots.items():
            link.follow(*emulator.addressees(name))  # a client that says nothing gets nothing
            if link.away:  # it is not there yet
                emulator.link_lost(name, link.why, -math.inf)

    @property
    def links(self) -> Sequence[Waitable]:
        return () if self._resting else self._ready.waitables

    def service(self, clock: Clock) -> float:
        """Read the links, and do what is due. Returns the next time to call.

        The time is read after the bytes: a late time stamp makes a pose older, an early one newer than it is. Bytes of
        a busy stream are used together, shortly before something is due: that costs less than one packet at a time. For
        most of the time they are also read together, unless the time of each packet counts.
        The clock says how early it should be called after a longer sleep, because a processor that wakes up is slow.
        """
        now = clock.now()
        stalled = now - self._deadline > _STALL_S
        patience = now + (_CATCH_UP_S if stalled else _HELD_UP_S)
        self._read_bytes = 0
        for name in self._ready.names():
            while (came := self._read(name, self._autopilots[name], clock, patience)) is not None:
                now = came
                if not stalled or now > patience:
                    break
        if self._read_bytes and not self.emulator.needs_times:
            self._rests.read(self._read_bytes, now)
        shortly = now >= self._deadline - _SHORTLY_S
        if now >= self._use_at or shortly or self._resting or self._waiting > _MOST_BYTES:
            self._use_arrived(clock, patience)
            now = clock.now()
        if due := now >= self._deadline:
            self._do_due(now)
        if now >= self._next_look and (due or now >= self._next_look + _LOOK_S):  # rather behind a frame than before it
            self._next_look = now + _LOOK_S
            self._look_at_links(now)
            if now >= self._deadline:
                self._do_due(now)
        if now >= self._deadline - _SHORTLY_S:
            self._resting = False
            return self._deadline
        self._resting = self._rests.rest(now)
        return self._deadline - clock.early_s

    def finish(self, clock: Clock) -> None:
        """At the end of a run: use what came, and tell what has happened."""
        self._use_arrived(clock, math.inf)
        self._do_due(clock.now())

    def counts(self) -> dict[str, int]:
        """For each link: how often it was lost and came back, and the number of reads from strangers."""
        return {
            f"{name}_link_{what}": getattr(link, what)
            for name, link in self.sinks.items()
            for what in ("losses", "returns", "strangers")
        }

    def _read(self, name: str, link: Link, clock: Clock, patience: float) -> float | None:
        """Read a link once. Returns when the bytes came; None if there were none."""
        try:
            came = link.receive()
        except LinkError as error:
            self._use_arrived(clock, patience)
            self._do_due(now := clock.now())
            if self._is_last(name, error, now):
                raise
            return None
        if not came:  # the link may be lost
            self._use_arrived(clock, patience)
            return None
        now = clock.now()
        for sender, data in came:
            self._waiting += len(data)
            self._read_bytes += len(data)
            self._arrived.append((name, data, now, sender))
        return now

    def _use_arrived(self, clock: Clock, patience: float) -> None:
        """Give the engine what came. Frames that are due go first after the time `patience`."""
        if not (arrived := self._arrived):
            return
        self._arrived, self._waiting = [], 0
        for name, data, came, sender in arrived:
            for at in range(0, len(data), _PIECE):
                now = clock.now()
                if now > patience and now >= self._deadline:
                    self._do_due(now)
                self.emulator.receive(name, data[at : at + _PIECE], came, sender)
        for name in {name for name, *_ in arrived}:
            self._autopilots[name].follow(*self.emulator.addressees(name))
        self._use_at = clock.now() + _PAUSE_S
        self._deadline = self.emulator.next_deadline()

    def _do_due(self, now: float) -> None:
        """Do everything that is due. Raises the LinkError of the last link of its kind."""
        emulator = self.emulator
        emulator.advance(now)
        lost = [error for output in emulator.output() if (error := self._write(output, now))]
        self._audience.tell(emulator.events())
        self._deadline = emulator.next_deadline()
        if lost:
            raise lost[0]

    def _write(self, output: Output, now: float) -> LinkError | None:
        """Write one output. Returns the error if the last link of its kind is lost for ever."""
        taken, last, link = False, None, self.sinks[output.sink]
        try:
            taken = output.sink not in self._gone and link.write(output.data)
        except LinkError as error:
            last = error if self._is_last(output.sink, error, now) else None
        if link.away:
            self._look_at_links(now)
        self.emulator.written(output, taken, now)
        return last

    def _is_last(self, name: str, error: LinkError, now: float) -> bool:
        """A link is lost for ever. Returns whether it was the last of its kind; otherwise the others continue."""
        kind = self._autopilots if name in self._autopilots else self._ports
        self._gone.add(name)
        if self._gone >= kind.keys():
            return True
        self._ready.forget(name)
        self.emulator.link_lost(name, str(error), now)
        self._audience.tell([LinkLost(now, name, self.sinks[name].name, str(error))])
        return False

    def _look_at_links(self, now: float) -> None:
        called = False  # by a receiver's host
        for name, port in self._ports.items():
            if name not in self._gone:
                try:
                    data = port.read() if port.away or port.ready() else b""
                except LinkError as error:
                    if self._is_last(name, error, now):
                        raise
                    continue
                if data:
                    self.emulator.receive(name, data, now)
                    called = True
        self._ready.renew()
        for monitor in self._monitors:
            self._audience.tell(monitor.look(now))
        self._deadline = now if called else self.emulator.next_deadline()


def replay(
    emulator: Emulator,
    records: Iterable[Record],
    link: str,
    write: Callable[[Output], bool],
    audience: Audience,
    *,
    clock: Clock | None = None,
    stopped: Callable[[], bool] = lambda: False,
) -> None:
    """Feed a log to an engine, as if it came on `link`. Times are those of the log, from 0 at its start.

    With a `clock`, an output is written at its instant; otherwise as soon as it is made.
    """
    start_us: int | None = None
    heard = tend_at = 0.0
    due = emulator.next_deadline()
    batch: list[tuple[float, bytes]] = []  # between two deadlines

    def receive() -> None:
        emulator.receive_records(link, batch)
        batch.clear()

    def settle() -> float:
        for output in emulator.output():
            while clock is not None and clock.now() < output.due and not stopped():
                clock.wait(min(output.due, clock.now() + _LONGEST_WAIT_S))
            emulator.written(output, write(output), output.due)
        audience.tell(emulator.events())
        return emulator.next_deadline()

    for time_us, raw in records:
        if start_us is None:
            start_us = time_us
        if (time_s := (time_us - start_us) / 1e6) > heard:
            heard = time_s
        if due <= heard:
            receive()
            emulator.advance(heard)
            due = settle()
            if stopped():
                return
        batch.append((heard, raw))
        if heard >= tend_at:
            receive()
            emulator.advance(heard)
            due = settle()
            tend_at = heard + _LONGEST_WAIT_S
        elif len(batch) >= _MOST_RECORDS:  # of one instant
            receive()
    receive()
    emulator.finish(heard)
    settle()
