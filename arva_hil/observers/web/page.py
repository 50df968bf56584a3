"""The observer for the page in a browser. It queues the events; a thread of its own does the rest."""

from __future__ import annotations

import sys
import threading
from collections import deque
from collections.abc import Mapping
from typing import Final

from arva_hil.clock import RealClock
from arva_hil.events import BytesSent, Event
from arva_hil.observers.web.address import HostPort
from arva_hil.observers.web.server import Server, Source
from arva_hil.observers.web.state import State

_UPDATE_S: Final = 0.1  # between updates while a browser is connected
_IDLE_S: Final = 0.5
_LOOKING_S: Final = 3.0  # a browser counts as connected for this time after a request
_FIELD_S: Final = 2.0  # between two pictures of the field
_LAST_S: Final = 1.5  # longest wait until browsers have the end of the run
_SENT_S: Final = 0.05  # until an answer is sent
_MOST_WAITING: Final = 100_000  # events
_SWITCH_S: Final = 0.0005  # the longest wait of the loop for a computing thread of the page


class WebPage:
    """Serves the page of one run from `address` on. Raises WebError.

    `observe` only puts the event into a queue of bounded size. Remembers the last request of each connection.
    """

    def __init__(self, address: HostPort, state: State) -> None:
        self.state = state
        self._waiting: deque[Event] = deque(maxlen=_MOST_WAITING)
        self._lock = threading.Lock()  # of the state; the loop never takes it
        self._closing = threading.Event()
        self._clock = RealClock()
        self._asked_s: dict[int, float] = {}  # by the number of the connection
        self._drawn_s = -_FIELD_S
        sources: dict[str, Source] = {"/state.json": self._state_json}
        sources["/field.json"] = lambda query, client: state.field()
        sources["/background.png"] = lambda query, client: state.background()
        self._server = Server(address, sources)
        self.address = self._server.address
        sys.setswitchinterval(_SWITCH_S)
        threading.Thread(target=self._work, name="web state", daemon=True).start()

    def observe(self, event: Event) -> None:
        """See `Observer`."""
        if not isinstance(event, BytesSent):
            self._waiting.append(event)

    def close(self, how: str = "ended", failed: bool = False) -> None:
        """Report the end of the run, give the browsers a moment to ask, and stop."""
        if self._closing.is_set():
            return
        self._closing.set()
        with self._lock:
            self._update()
            self.state.end(how, failed=failed)
            looking, self._asked_s = self._looking(), {}
        until = self._clock.now() + _LAST_S
        while looking - self._asked_s.keys() and self._clock.now() < until:
            self._clock.wait(self._clock.now() + _SENT_S)
        if looking:
            self._clock.wait(self._clock.now() + _SENT_S)
        self._server.close()

    def _looking(self) -> set[int]:
        """Return the connections with a recent request."""
        now = self._clock.now()
        return {client for client, asked_s in tuple(self._asked_s.items()) if now - asked_s < _LOOKING_S}

    def _work(self) -> None:
        while not self._closing.wait(_UPDATE_S if self._looking() else _IDLE_S):
            with self._lock:
                self._update()
                for client in self._asked_s.keys() - self._looking():
                    del self._asked_s[client]

    def _update(self) -> None:
        batch = list[Event]()
        while self._waiting:
            batch.append(self._waiting.popleft())
        try:
            self.state.update(batch)
            if (now := self._clock.now()) - self._drawn_s >= _FIELD_S:
                self._drawn_s = now
                self.state.draw_field()
        except Exception as error:  # the page continues with the next events
            self.state.fail(repr(error))

    def _state_json(self, query: Mapping[str, str], client: int) -> bytes:
        since = query.get("since", "")
        with self._lock:
            self._asked_s[client] = self._clock.now()
            return self.state.document(int(since) if since.isdecimal() and len(since) < 16 else 0)
