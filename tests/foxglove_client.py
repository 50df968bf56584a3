"""A client of Foxglove's live protocol (`foxglove.sdk.v1`) that knows nothing of the SDK which serves it."""

from __future__ import annotations

import contextlib
import json
import threading
from collections.abc import Mapping
from typing import Any, NamedTuple

from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Origin, Subprotocol

from tests.records.ros_messages.oracle import plain

SPOKEN = Subprotocol("foxglove.sdk.v1")


class Told(NamedTuple):
    topic: str
    stamp_ns: int
    message: Mapping[str, Any]


class FoxgloveClient:
    """Subscribes to every channel and keeps what comes until the server goes away."""

    def __init__(self, port: int, *, origin: Origin | None = None) -> None:
        self.told: list[Told] = []
        self.channels: dict[str, tuple[str, str, str]] = {}  # topic → encoding, schema's name and encoding
        self.ready = threading.Event()
        self._topics: dict[int, str] = {}
        self._types = get_typestore(Stores.EMPTY)
        self._thread = threading.Thread(target=self._listen, args=(port, origin), daemon=True)
        self._thread.start()
        assert self.ready.wait(20)

    def until_closed(self) -> list[Told]:
        """All that came, when the server has gone."""
        self._thread.join(60)
        assert not self._thread.is_alive()
        return self.told

    def of(self, topic: str) -> list[Told]:
        return [told for told in self.told if told.topic == topic]

    def _listen(self, port: int, origin: Origin | None) -> None:
        address = f"ws://127.0.0.1:{port}"
        with contextlib.suppress(ConnectionClosed), connect(address, subprotocols=[SPOKEN], origin=origin) as socket:
            for message in socket:
                if isinstance(message, str):
                    self._answer(socket, json.loads(message))
                elif message[0] == 1:
                    topic = self._topics[int.from_bytes(message[1:5], "little")]
                    stamp, data = int.from_bytes(message[5:13], "little"), message[13:]
                    told = self._types.deserialize_cdr(data, self.channels[topic][1])
                    self.told.append(Told(topic, stamp, plain(told)))

    def _answer(self, socket: ClientConnection, said: dict[str, Any]) -> None:
        if said["op"] != "advertise":
            return
        for channel in said["channels"]:
            self._topics[channel["id"]] = channel["topic"]
            self.channels[channel["topic"]] = (channel["encoding"], channel["schemaName"], channel["schemaEncoding"])
            self._types.register(get_types_from_msg(channel["schema"], channel["schemaName"]))
        ids = [{"id": channel["id"], "channelId": channel["id"]} for channel in said["channels"]]
        socket.send(json.dumps({"op": "subscribe", "subscriptions": ids}))
        self.ready.set()
