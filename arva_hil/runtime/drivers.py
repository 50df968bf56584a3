"""The drivers of an engine: `Live` with a clock and links, as a task of the loop; `replay` with a log.

`Live` with a stepped clock is the third: tests and campaigns use the same calls as fast as possible.
"""

from __future__ import annotations

import math
import selectors
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from functools import partial
from typing import Final, Protocol

from arva_hil.clock import Clock, Waitable, any_ready, await_descriptors
from arva_hil.emulator.engine import Addressees, Emulator, EngineOptions
from arva_hil.emulator.ports import Output
from arva_hil.events import Event, LinkLost
from arva_hil.links import Link, LinkError
from arva_hil.links.tlog_timeline import Record
from arva_hil.runtime.audience import Audience
from arva_hil.runtime.link_monitor import LinkMonitor


class ReadyLinks:
    """Remembers which descriptors of several links the system watches. To wait for all of them, wait for `waitables`.

    A link that is away or has no descriptor counts as ready, because it must be polled. Without epoll
    every link counts as ready.
    """

    def __init__(self, links: Mapping[str, Link]) -> None:
        self._links = links
        self._selector = selectors.DefaultSelector()
        self._polled: list[str] = []  # those that are read every time
        self.waitables: Sequence[Waitable] = ()
        self.renew()

    def names(self) -> list[str]:
        """Return the links to read now, in their order."""
        if not self._selector.get_map():
            return self._polled
        ready = {key.data for key, _ in self._selector.select(0)}
        return [name for name in self._links if name in ready or name in self._polled]

    def renew(self) -> None:
        """Watch the present descriptors of the links: a link that comes back has a new one."""
        for fd in [*self._selector.get_map()]:
            self._selector.unregister(fd)
        self._polled = [name for name, link in self._links.items() if not self._watch(name, link)]
        watched = [self] if self._selector.get_map() else []
        self.waitables = [*watched, *(self._links[name] for name in self._polled)]

    def forget(self, name: str) -> None:
        """Forget a link that is lost for ever."""
        self._links = {other: link for other, link in self._links.items() if other != name}
        self.renew()

    def close(self) -> None:
        """Give the descriptor back. The links stay open."""
        self._selector.close()
        self.waitables = ()

    def fileno(self) -> int | None:
        """Return a descriptor that is readable while one of the watched links is."""
        return self._selector.fileno() if hasattr(self._selector, "fileno") else None

    def ready(self) -> bool:
        """Return True if one of the watched links can be read."""
        fd = self.fileno()
        return fd is not None and await_descriptors([fd])

    def _watch(self, name: str, link: Link) -> bool:
        """Return True if the system watches the descriptor of a link."""
        fd = link.fileno()
        if link.away or fd is None or self.fileno() is None:
            return False
        try:
            self._selector.register(fd, selectors.EVENT_READ, name)
        except OSError:  # of a file
            return False
        return True


LOOK_AHEAD_S: Final = 1.0  # how far a log is read after the instant of a frame, to interpolate

_LOOK_S: Final = 0.05  # the shortest time between two checks of the links; these are no deadlines
_HELD_UP_S: Final = 0.001  # due frames wait this long for bytes that have arrived
_CATCH_UP_S: Final = 0.25  # late frames wait as long again as they are late, but no longer than this
_PIECE: Final = 4096  # bytes that are used before the time is checked again
_REST_S: Final = 0.05  # bytes may wait this long for others, or for a frame, to halve the CPU time of a busy stream
_PROMPT: Final = 8  # bytes after each eighth read do not wait, because they give the vehicle's clock
_SIGNALS_S: Final = 0.1  # a replay notices a signal within this time


class Engine(Protocol):
    """The calls that `Live` needs. `Emulator` explains them."""

    @property
    def options(self) -> EngineOptions:
        """See `EngineOptions`."""

    def receive(self, link: str, data: bytes, now: float, sender: Hashable = None) -> Addressees:
        """Use bytes that came on a link."""

    def advance(self, now: float) -> None:
        """Do everything that is due."""

    def output(self) -> list[Output]:
        """Return the outputs to write."""

    def written(self, output: int, accepted: bool, now: float) -> None:
        """Handle a written output."""

    def events(self) -> Sequence[Event]:
        """Return the events since the last call."""

    def next_deadline(self) -> float:
        """Return the latest time for the next call of `advance`."""

    def link_lost(self, link: str, why: str, now: float) -> None:
        """Handle a lost link."""

    def link_back(self, link: str, now: float) -> None:
        """Handle a link that is back."""


class Live:
    """Drives an engine with links and the loop's clock, and gives events to the audience. A task of the loop.

    `autopilots`: the links of the vehicles; `ports`: the links for frames, on which commands of the
    receiver's host come; both by the engine's names. A link that is lost for ever is left out while there are others of
    its kind; the error of the last one is raised.
    """

    def __init__(
        self, emulator: Engine, autopilots: Mapping[str, Link], ports: Mapping[str, Link], audience: Audience
    ) -> None:
        self.emulator = emulator
        self.sinks = {**ports, **autopilots}
        self._autopilots = autopilots
        self._ports = ports
        lost, back = emulator.link_lost, emulator.link_back
        self._monitors = {n: LinkMonitor(n, link, partial(lost, n), partial(back, n)) for n, link in self.sinks.items()}
        self._audience = audience
        self._ready = ReadyLinks(autopilots)
        self._next_look = -math.inf
        self._rests = False  # the links are not waited for
        self._reads = 0
        self._gone: set[str] = set()
        for name, link in autopilots.items():
            link.follow(None)  # a client that sends nothing gets nothing
            if link.away:  # it is not there yet
                emulator.link_lost(name, link.why, -math.inf)

    @property
    def links(self) -> Sequence[Waitable]:
        return () if self._rests else self._ready.waitables

    def service(self, clock: Clock) -> float:
        """Read the links, and do what is due. Returns the next time to call.

        `clock.early_s` is the advance after a longer sleep, because a processor that wakes up is slow.
        """
        now = clock.now()
        late_s = now - self.emulator.next_deadline()
        patience = now + min(max(late_s, _HELD_UP_S), _CATCH_UP_S)
        reads = self._reads
        for name in self._ready.names():
            while self._read(name, clock, patience) and late_s > _HELD_UP_S and clock.now() <= patience:
                pass  # after a delay read all waiting bytes
        now = clock.now()
        if now - self.emulator.next_deadline() > _CATCH_UP_S > late_s:
            return now  # the process was stopped while it read: read again before frames are made
        may_rest = clock.early_s > 0 and not self.emulator.options.needs_times
        may_rest = may_rest and self._reads > reads and self._reads % _PROMPT > 0
        self._rests = may_rest and not any_ready(self._ready.waitables)
        rested = now + _REST_S if self._rests else math.inf
        due = now >= self.emulator.next_deadline()
        if due:
            self._do_due(now)
        if now >= self._next_look and (due or now >= self._next_look + _LOOK_S):  # check links after a frame
            self._next_look = now + _LOOK_S
            self._check_links(now)
            if now >= self.emulator.next_deadline():  # a receiver's host sent a command
                self._do_due(now)
        deadline = min(self.emulator.next_deadline(), rested)
        early = deadline - clock.early_s
        return early if now < early else deadline

    def finish(self, clock: Clock) -> None:
        """Do what is due at the end of a run."""
        self._do_due(clock.now())

    def close(self) -> None:
        """Give back what belongs to the driver; its links are the caller's."""
        self._ready.close()

    def counts(self) -> dict[str, int]:
        """Return for each link the number of losses, of returns, of reads from strangers, and of dropped writes."""
        return {
            f"{name}_link_{what}": getattr(link, what)
            for name, link in self.sinks.items()
            for what in ("losses", "returns", "strangers", "dropped")
        }

    def _read(self, name: str, clock: Clock, patience: float) -> bool:
        """Read a link once. Returns False without bytes.

        After the time `patience` frames that are due go first. Long after it the process was stopped: bytes go first.
        """
        link = self._autopilots[name]
        try:
            chunks = link.receive()
        except LinkError as error:
            self._do_due(now := clock.now())
            if self._is_last(name, error, now):
                raise
            return False
        came = clock.now()  # after the bytes: an early time stamp would make a pose newer than it is
        if chunks:  # a loss cuts only what came before it
            self._audience.emit(self._monitors[name].poll(came))
        for sender, data in chunks:
            for at in range(0, len(data), _PIECE):
                now = clock.now()
                if patience < now < patience + _CATCH_UP_S and now >= self.emulator.next_deadline():
                    self._do_due(now)
                link.follow(*self.emulator.receive(name, data[at : at + _PIECE], came, sender))
        self._reads += bool(chunks)
        return bool(chunks)

    def _do_due(self, now: float) -> None:
        """Do everything that is due. Raises the LinkError of the last link of its kind."""
        emulator = self.emulator
        emulator.advance(now)
        lost = [error for output in emulator.output() if (error := self._write(output, now))]
        self._audience.emit(emulator.events())
        if lost:
            raise lost[0]

    def _write(self, output: Output, now: float) -> LinkError | None:
        """Write one output. Returns the error if the last link of its kind is lost for ever."""
        accepted, last, link = False, None, self.sinks[output.link]
        try:
            accepted = output.link not in self._gone and link.write(output.data)
        except LinkError as error:
            last = error if self._is_last(output.link, error, now) else None
        if link.away:  # the loss of the link comes before the refused output
            self._audience.emit(self._monitors[output.link].poll(now))
        self.emulator.written(output.id, accepted, now)
        return last

    def _is_last(self, name: str, error: LinkError, now: float) -> bool:
        """Handle a link that is lost for ever.

        Returns whether it was the last of its kind; otherwise the others continue.
        """
        kind = self._autopilots if name in self._autopilots else self._ports
        self._gone.add(name)
        if self._gone >= kind.keys():
            return True
        self._ready.forget(name)
        self.emulator.link_lost(name, str(error), now)
        self._audience.emit([LinkLost(now, name, self.sinks[name].name, str(error))])
        return False

    def _check_links(self, now: float) -> None:
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
        self._ready.renew()
        for monitor in self._monitors.values():
            self._audience.emit(monitor.poll(now))


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
    now = 0.0

    def settle() -> float:
        for output in emulator.output():
            while clock is not None and clock.now() < output.due and not stopped():
                clock.wait(min(output.due, clock.now() + _SIGNALS_S))
            emulator.written(output.id, write(output), output.due)
        audience.emit(emulator.events())
        return emulator.next_deadline()

    due = emulator.next_deadline()
    for time_us, raw in records:
        if start_us is None:
            start_us = time_us
        now = max(now, (time_us - start_us) / 1e6)
        if due <= now:
            emulator.advance(now)
            due = settle()
            if stopped():
                return
        emulator.receive(link, raw, now, whole=True)
    emulator.advance(now, final=True)
    settle()
