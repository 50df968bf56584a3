"""MCAP with ROS 2 messages, for Foxglove, Lichtblick, PlotJuggler and rosbag2. Needs the extra `mcap`."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import IO, Any, BinaryIO, Final, cast

from mcap.writer import Writer

from arva_hil import __version__
from arva_hil.records.reading import Recording
from arva_hil.records.ros_messages.recorded import messages_of
from arva_hil.records.ros_messages.types import Message, encode, schema

_PROFILE: Final = "ros2"


class _Counting:
    """Writes to `out` and counts, so that `out` may be a pipe. It has the methods of a file that the writer uses."""

    def __init__(self, out: BinaryIO) -> None:
        self._out = out
        self._written = 0

    def write(self, data: bytes) -> int:
        self._out.write(data)
        self._written += len(data)
        return len(data)

    def tell(self) -> int:
        return self._written


def write(recording: Recording, out: BinaryIO) -> None:
    """Write a record as MCAP: its messages in the order of their times, and its settings as attachments."""
    writer = Writer(cast(IO[bytes], _Counting(out)))
    writer.start(profile=_PROFILE, library=f"arva-hil {__version__}")
    schemas: dict[type[Message], int] = {}
    channels: dict[str, int] = {}
    for number, (topic, stamp_ns, message) in enumerate(messages_of(recording)):
        kind = type(message)
        if kind not in schemas:
            schemas[kind] = writer.register_schema(kind.__msgtype__, "ros2msg", schema(kind).encode())
        if topic not in channels:
            channels[topic] = writer.register_channel(topic, "cdr", schemas[kind])
        writer.add_message(channels[topic], stamp_ns, encode(message), stamp_ns, sequence=number)
    for name, data in _attachments(recording):
        writer.add_attachment(0, 0, name, "application/json", data)
    writer.finish()  # type: ignore[no-untyped-call]


def _attachments(recording: Recording) -> Iterator[tuple[str, bytes]]:
    """Yield names and contents: run.json, its scenario as a file of its own, and search.json."""
    if recording.run is not None:
        yield "run.json", _json(recording.run.json)
        if scenario := recording.run.json.get("scenario"):
            yield "scenario.yaml", _json(scenario)  # JSON is YAML
    if recording.search is not None and recording.search.how:  # it has ended
        yield "search.json", _json(recording.search.outcome)


def _json(value: Any) -> bytes:
    return json.dumps(value, indent=2).encode()
