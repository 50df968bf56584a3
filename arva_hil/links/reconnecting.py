"""Opens a lost link again until it works."""

from __future__ import annotations

import contextlib
import errno
import math
import os
import socket
import threading
from collections.abc import Callable
from concurrent.futures import Future
from functools import partial
from typing import Final

from arva_hil.clock import Clock
from arva_hil.links import Address, open_link, parse
from arva_hil.links.base import Absent, Link, LinkEnded, LinkError
from arva_hil.links.processes import far_program
from arva_hil.links.serial_ports import stable_name
from arva_hil.registry import LINKS

Job = Callable[[], None]

_FIRST_PAUSE_S: Final = 0.05  # before the first try, and twice as long before each further one
_LONGEST_PAUSE_S: Final = 0.4
_LASTING_S: Final = 0.3  # a new connection counts as a return after this time, or with its first bytes
_STUBBORN_S: Final = 1.0  # after a port is plugged in, its permissions are set late, and other programs probe it
_BARRED: Final = frozenset((errno.EBUSY, errno.EAGAIN, errno.EACCES, errno.EPERM))


class Barred(LinkError):
    """A link that exists, but can only be opened after a person has done something."""


class SerialOpener:
    """Opens a serial port again by its stable name. If it stays busy or forbidden, raises Barred once with the cause.

    A pseudo-terminal without a symlink must belong to the same program as before, because the system reuses numbers.
    """

    def __init__(self, address: Address, clock: Clock) -> None:
        self.path = stable_name(address.path)
        self._address = address._replace(path=self.path)
        self._clock = clock
        known = os.path.exists(self.path) and not os.path.islink(self.path)
        self._program = far_program(self.path) if known else None
        self._bar = ""  # the error of all tries so far
        self._since = 0.0  # when it began; infinite after it was reported

    def __call__(self) -> Link:
        try:
            link = self._open(brief=True)
        except LinkError as error:
            if not self._stubborn(error.what if _barred(error) else ""):
                raise LinkError(error.link, error.what) from error
            link = self._look_into()
        self._bar = ""
        return link

    def _look_into(self) -> Link:
        try:
            return self._open(brief=False)
        except LinkError as error:
            if _barred(error):
                raise Barred(error.link, error.what, error.hint) from error
            raise

    def _open(self, *, brief: bool) -> Link:
        if self._program and not os.path.exists(self.path):  # do not search for its program
            raise LinkError(self.path, "no such port")
        if self._program is not None and (other := far_program(self.path)) != self._program:
            whose = f": {other[:60]}" if other else ""
            hint = "name a symlink, which finds the pseudo-terminal if its number changes"
            raise Barred(self.path, f"now belongs to another program{whose}", hint)
        return open_link(self._address, clock=self._clock, brief=brief)

    def _stubborn(self, bar: str) -> bool:
        """Return True if the error has lasted for long and was not reported yet."""
        now = self._clock.now()
        if bar != self._bar:
            self._bar, self._since = bar, now
        told = bool(bar) and now - self._since >= _STUBBORN_S
        if told:
            self._since = math.inf
        return told


def _barred(error: LinkError) -> bool:
    cause = error.__cause__
    return isinstance(error, Barred) or getattr(cause, "errno", None) in _BARRED or "PermissionError" in str(cause)


def on_a_thread(job: Job) -> None:
    """Run a job on a thread of its own."""
    threading.Thread(target=job, name="reopen", daemon=True).start()


class Attempts:
    """Opens a link again and again, with pauses that grow. Remembers the present attempt, and when the next one is due.

    `opener`, `start`: see `ReconnectingLink`. `fileno` is readable when an attempt has ended.
    """

    def __init__(self, opener: Callable[[], Link], start: Callable[[Job], None], now: float) -> None:
        self._opener = opener
        self._start = start
        self._attempt: Future[Link] | None = None
        self._waker, self._wake = socket.socketpair()  # to wait on while there is no link
        self._wake.setblocking(False)
        self._pause = _FIRST_PAUSE_S
        self._next_try = now + self._pause

    def put_off(self, now: float, *, first: bool = False) -> None:
        """Wait for the next try: twice as long as the last time, or the shortest time for the `first` one."""
        if first:
            self._pause = _FIRST_PAUSE_S
        self._next_try = now + self._pause
        self._pause = min(2 * self._pause, _LONGEST_PAUSE_S)

    def poll(self, now: float) -> Link | None:
        """Return the link once it is open. Raises the errors of `opener`."""
        if self._attempt is None:
            if now < self._next_try:
                return None
            self._attempt = Future()
            self._start(partial(self._open, self._attempt))
        if not self._attempt.done():
            return None
        attempt, self._attempt = self._attempt, None
        self._waker.recv(1)
        return attempt.result()

    def close(self) -> None:
        if self._attempt:
            self._attempt.add_done_callback(_close_link)
        self._waker.close()
        self._wake.close()

    def fileno(self) -> int:
        return self._waker.fileno()

    def ready(self) -> bool:
        return self._attempt is not None and self._attempt.done()

    def _open(self, attempt: Future[Link]) -> None:
        try:
            settle = partial(attempt.set_result, self._opener())
        except Exception as error:
            settle = partial(attempt.set_exception, error)
        with contextlib.suppress(OSError):  # it is closed if no caller waits
            self._wake.send(b"!")
        settle()


class ReconnectingLink(Link):
    """Wraps a link that may be lost. While it is away, reads return b"", and writes are dropped and counted.

    - `link`: an open link, or the error of one that is not there yet, which does not count as a loss.
    - `opener`: opens it again. After a LinkError or OSError it is called again; a Barred error sets `why`. `read` and
      `write` raise its other errors.
    - `start`: runs `opener` on a thread, because it may block.
    - `sought`: the name of the link in messages.
    - `wanted`: called at a loss. If it returns False, the loss is raised and the link stays closed.
    """

    def __init__(
        self,
        link: Link | LinkError,
        opener: Callable[[], Link],
        clock: Clock,
        sought: str = "it",
        start: Callable[[Job], None] = on_a_thread,
        wanted: Callable[[], bool] = lambda: True,
    ) -> None:
        self._link: Link | None = None
        self._awaited = isinstance(link, LinkError)  # it has never been open
        if isinstance(link, LinkError):
            self.name, self.why = link.link, str(link)
        else:
            self.name, self._link = link.name, link
        self._clock = clock
        self._sought = sought
        self._wanted = wanted
        self._since = -math.inf
        self._attempts = Attempts(opener, start, clock.now())

    @property
    def away(self) -> bool:
        return self._awaited or super().away

    def pin(self) -> None:
        self._wanted = lambda: False
        if self._link:
            self._link.pin()

    def read(self) -> bytes:
        link = self._current()
        try:
            data = link.read() if link else b""
        except LinkEnded:
            raise
        except LinkError as error:
            self._lose(error)
            return b""
        if data and self.away:
            self.returns += 1
        return data

    def write(self, data: bytes) -> bool:
        link = self._current()
        try:
            sent = link is not None and link.write(data)
        except LinkError as error:
            self._lose(error)
            sent = False
        self.dropped += not sent
        return sent

    def close(self) -> None:
        if self._open:
            self._open = False
            if self._link:
                self._link.close()
            self._attempts.close()

    def fileno(self) -> int | None:
        return (self._link or self._attempts).fileno() if self._open else None

    def ready(self) -> bool:
        return self._open and (self._link or self._attempts).ready()

    def _current(self) -> Link | None:
        """Return the link; try to open it if it is lost."""
        self._check_open()
        now = self._clock.now()
        if self._link is None:
            self._try(now)
        elif self.away and now - self._since >= _LASTING_S:
            self.returns += 1
        return self._link

    def _lose(self, error: LinkError) -> None:
        assert self._link is not None
        with contextlib.suppress(OSError):
            self._link.close()
        self._link = None
        if not self._wanted():
            self.close()
            raise error
        self._attempts.put_off(self._clock.now(), first=not self.away)
        self._gone(LinkError(self.name, f"{error.what}, searching for {self._sought}", error.hint))

    def _try(self, now: float) -> None:
        try:
            self._link = self._attempts.poll(now)
        except (LinkError, OSError) as error:
            if isinstance(error, Barred):
                self.why = str(error)
            self._attempts.put_off(self._clock.now())
        if self._link:
            self.name = self._link.name
            self._since = now
            self._awaited = False
            self._renewed(lasting=False)


def _close_link(attempt: Future[Link]) -> None:
    """Close a link that was opened too late."""
    if attempt.exception() is None:
        attempt.result().close()


def open_reconnecting(
    address: str | Address,
    *,
    clock: Clock,
    answered: bool = False,
    patient: bool = False,
    wanted: Callable[[], bool] = lambda: True,
) -> Link:
    """Open a link that is opened again after each loss if `wanted()` is true. Raises the errors of `open_link`.

    `patient`: if the link is not there yet, wait for it instead of raising Absent. A serial port is found by its
    stable name. Kinds without `reopened` are returned as they are: a server waits for its next client by itself, and
    a log or a pipe cannot return.
    """
    if isinstance(address, str):
        address = parse(address)
    link: Link | LinkError
    try:
        link = open_link(address, clock=clock, answered=answered)
    except Absent as error:
        if not patient:
            raise
        link = error
    if address.kind == "serial":
        again = SerialOpener(address, clock)
        sought = again.path if again.path != address.path else "it"
        return ReconnectingLink(link, again, clock, sought, wanted=wanted)
    if LINKS[address.kind].reopened:
        opener = partial(open_link, address, clock=clock, brief=True, answered=answered)
        return ReconnectingLink(link, opener, clock, wanted=wanted)
    assert isinstance(link, Link)
    return link
