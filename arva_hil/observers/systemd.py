"""Notifies a service manager by systemd's protocol: datagrams to the socket NOTIFY_SOCKET."""

from __future__ import annotations

import math
import os
import socket
from collections.abc import Mapping, Sequence
from typing import Final

from arva_hil.clock import Clock, Waitable
from arva_hil.events import Event, StatusReport
from arva_hil.events.words.text import status_line

_RETRY_S: Final = 0.5  # after a datagram without a receiver
_STATUS_S: Final = 5.0
_MOST: Final = 4096  # bytes; systemd ignores longer messages


class Watchdog:
    """The messages to a service manager. Sends nothing if NOTIFY_SOCKET is not set.

    It sends READY=1 after the loop's first turn, WATCHDOG=1 twice in every WATCHDOG_USEC after that, STATUS= every few
    seconds, and STOPPING=1 when it is closed.

    It is the last task of the loop: a loop that hangs sends no WATCHDOG=1, and the service manager kills the program
    and starts it again. A socket that fails or is full does not block the loop.
    """

    links: Sequence[Waitable] = ()

    def __init__(self, environment: Mapping[str, str]) -> None:
        self._address = _address(environment.get("NOTIFY_SOCKET", ""))
        self._period_s = _interval_s(environment) / 2
        self._socket = _socket() if self._address else None
        self._ready = False
        self._next = -math.inf if self._socket else math.inf
        self._next_status = 0.0

    @property
    def is_wanted(self) -> bool:
        """True if a service manager started this process."""
        return self._socket is not None

    def service(self, clock: Clock) -> float:
        now = clock.now()
        if now >= self._next:
            sent = self._send("WATCHDOG=1" if self._ready else "READY=1")
            self._ready = self._ready or sent
            self._next = now + (self._period_s if sent else min(_RETRY_S, self._period_s))
        return self._next

    def observe(self, event: Event) -> None:
        if self._socket and isinstance(event, StatusReport) and event.time_s >= self._next_status:
            self._next_status = event.time_s + _STATUS_S
            self._send(_cut(f"STATUS={status_line(event, named=len(event.vehicles) > 1)}"))

    def close(self) -> None:
        if self._socket:
            self._send("STOPPING=1")
            self._socket.close()
            self._socket, self._next = None, math.inf

    def _send(self, message: str) -> bool:
        """Send a datagram; returns whether it was accepted."""
        assert self._socket
        try:
            self._socket.sendto(message.encode(), self._address)
        except OSError:  # no receiver, or a full socket
            return False
        return True


def _cut(message: str) -> str:
    """Return a message that is short enough for systemd."""
    data, more = message.encode(), "…"
    return message if len(data) <= _MOST else data[: _MOST - len(more.encode())].decode(errors="ignore") + more


def _address(name: str) -> str:
    """Return the socket's address: a path, or `@` and an abstract name; "" if there is none."""
    if name.startswith("@"):
        return "\0" + name[1:]
    return name if name.startswith("/") else ""


def _socket() -> socket.socket | None:
    """Return a non-blocking socket, None if the system has no such sockets."""
    try:
        made = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    except (AttributeError, OSError):
        return None
    made.setblocking(False)
    return made


def _interval_s(environment: Mapping[str, str]) -> float:
    """Return the watchdog interval of this process [s]; infinite without a watchdog."""
    microseconds, pid = environment.get("WATCHDOG_USEC", ""), environment.get("WATCHDOG_PID", "")
    if not microseconds.isdecimal() or int(microseconds) == 0 or pid not in ("", str(os.getpid())):
        return math.inf
    return int(microseconds) / 1e6
