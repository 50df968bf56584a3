"""MCAP with ROS 2 messages, for Foxglove, Lichtblick, PlotJuggler and rosbag2. Needs the extra `mcap`."""

from __future__ import annotations

from typing import IO, BinaryIO, Final, cast

from mcap.writer import Writer

from arva_hil import __version__
from arva_hil.records.reading import Recording
from arva_hil.records.ros_messages.cdr import encode
from arva_hil.records.ros_messages.message import Message, schema
from arva_hil.records.ros_messages.recorded import messages_of

_PROFILE: Final = "ros2"


class _Counting:
    """Writes to `out` and counts, so that it may be a pipe. Has all of a file that the writer uses."""

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
    """See `arva_hil.records.exports`: the messages of a record, in the order of their times."""
    writer = Writer(cast(IO[bytes], _Counting(out)))
    writer.start(profile=_PROFILE, library=f"arva-hil {__version__}")
    schemas: dict[type[Message], int] = {}
    channels: dict[str, int] = {}
    for number, (topic, stamp_ns, message) in enumerate(messages_of(recording)):
        kind = type(message)
        if kind not in schemas:
            schemas[kind] = writer.register_schema(kind.ros_name(), "ros2msg", schema(kind).encode())
        if topic not in channels:
            channels[topic] = writer.register_channel(topic, "cdr", schemas[kind])
        writer.add_message(channels[topic], stamp_ns, encode(message), stamp_ns, sequence=number)
    writer.finish()  # type: ignore[no-untyped-call]
