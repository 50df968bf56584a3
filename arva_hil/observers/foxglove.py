"""Serves the messages of a running program to Foxglove, Lichtblick and PlotJuggler. Needs the extra `foxglove`.

The server is foxglove-sdk's. It takes connections from web pages of any origin.
"""

from __future__ import annotations

import logging
import threading
from typing import Any, Final

from arva_hil.errors import ArvaError
from arva_hil.events import Event
from arva_hil.observers.web.address import HostPort
from arva_hil.records.ros_messages.readings import LiveMessages
from arva_hil.records.ros_messages.types import Message, encode, schema

INSTALL: Final = "pip install 'arva-hil[foxglove]'"
_NEXT: Final = 20  # ports that are tried
_SILENT: Final = logging.CRITICAL + 1  # the SDK logs each client that fails, and takes Python's lock for it
_GOODBYE_S: Final = 0.3  # for clients to receive the last messages


class FoxgloveError(ArvaError):
    """The messages cannot be served. `str()` says why, and the cure."""


class FoxgloveServer:
    """An observer that serves each message of `messages` on its topic. `url` is where it is.

    If the port is taken, the next free one is used. A client that does not read loses its oldest messages, and does not
    delay the others. Raises FoxgloveError if foxglove-sdk is missing or there is no port.
    """

    def __init__(self, messages: LiveMessages, address: HostPort) -> None:
        try:
            import foxglove
        except ImportError as error:
            raise FoxgloveError(f"--foxglove needs foxglove-sdk, which is not installed ({error}): {INSTALL}") from None
        logging.getLogger("foxglove").setLevel(_SILENT)
        self._foxglove = foxglove
        self._context = foxglove.Context()
        self._messages = messages
        self._channels = {topic: self._channel(topic, kind) for topic, kind in messages.topics.items()}
        self._server = self._start(address)
        self.port: int = self._server.port
        self.url = f"ws://{address._replace(port=self.port)}"

    def observe(self, event: Event) -> None:
        for topic, stamp_ns, message in self._messages.of_event(event):
            self._channels[topic].log(encode(message), log_time=stamp_ns)

    def close(self) -> None:
        """Stop the server, without waiting for clients that do not read."""
        goodbye = threading.Thread(target=self._server.stop, daemon=True)  # it waits for them
        goodbye.start()
        goodbye.join(_GOODBYE_S)

    def _channel(self, topic: str, kind: type[Message]) -> Any:
        described = self._foxglove.Schema(name=kind.__msgtype__, encoding="ros2msg", data=schema(kind).encode())
        return self._foxglove.Channel(topic, schema=described, message_encoding="cdr", context=self._context)

    def _start(self, address: HostPort) -> Any:
        host, port = address
        for free in range(port, min(port + _NEXT, 65536) if port else 1):
            try:
                return self._foxglove.start_server(name="arva-hil", host=host, port=free, context=self._context)
            except RuntimeError as error:
                why = str(error)
                if "in use" not in why:
                    break
        raise FoxgloveError(f"--foxglove {address}: cannot be served there ({why}): name another HOST:PORT")
