"""The way out: a reading becomes a frame, the frame bytes on a wire or messages on the autopilot's own link."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any, Final, Protocol

import firmware_proto
from arva_hil.links import Link
from arva_hil.mavlink.codec import Parser, dialect
from arva_hil.receiver import Reading
from arva_hil.vehicle.session import Session
from firmware_proto import Channel, Frame, FrameDecoder
from firmware_proto.frame import check

MAVLINK_FORMATS: Final = ("tunnel", "named", "named_float", "debug_vect")
TUNNEL_TYPE: Final = 42071  # 0xA457, in MAVLink's private range


class Port(Protocol):
    """Where frames go."""

    def encode(self, frame: Frame, boot_ms: int) -> bytes:
        """The bytes of one frame, b"" while there is nobody to send it to. `boot_ms`: its instant, vehicle's clock."""

    def write(self, data: bytes) -> bool:
        """Send bytes; whether they were taken."""

    @property
    def away(self) -> bool:
        """Whether they are not because the link is lost."""


def frame_of(reading: Reading, sequence: int) -> Frame:
    """A reading as the frame that carries it; always marked as synthetic."""
    status = firmware_proto.SYNTHETIC
    status |= firmware_proto.INTERFERENCE if reading.interference else 0
    status |= firmware_proto.MORE_TRANSMITTERS if reading.more_heard else 0
    channels = (Channel(c.id, c.zone, c.d_cm, c.delta_deg) for c in reading.channels)
    return Frame(sequence, status, tuple(channels))


def encoder(format: str, session: Session) -> Callable[[Frame, int], bytes]:
    """(frame, its instant in ms on the vehicle's clock) → its bytes in a format, b"" while nobody is there."""
    if format not in MAVLINK_FORMATS:
        encode = firmware_proto.ENCODERS[format]
        return lambda frame, boot_ms: encode(frame)
    return MavlinkPort(None, session, format).encode  # type: ignore[arg-type]


class WirePort:
    """A serial line, or what stands for one: `format` is binary, nmea or text."""

    def __init__(self, link: Link, format: str) -> None:
        self._link = link
        self._encode = firmware_proto.ENCODERS[format]

    def encode(self, frame: Frame, boot_ms: int) -> bytes:
        return self._encode(frame)

    def write(self, data: bytes) -> bool:
        return self._link.write(data)

    @property
    def away(self) -> bool:
        return self._link.away


class MavlinkPort:
    """The autopilot's own link: `format` is one of MAVLINK_FORMATS. Silent until there is a vehicle."""

    def __init__(self, link: Link, session: Session, format: str) -> None:
        self._link = link
        self._session = session
        self._messages = {
            "tunnel": self._tunnel,
            "named": _named_int,
            "named_float": _named_float,
            "debug_vect": _debug_vect,
        }[format]

    def encode(self, frame: Frame, boot_ms: int) -> bytes:
        if self._session.vehicle is None:
            return b""
        return b"".join(map(self._session.encoder.pack, self._messages(frame, boot_ms)))

    def write(self, data: bytes) -> bool:
        return self._link.write(data)

    @property
    def away(self) -> bool:
        return self._link.away

    def _tunnel(self, frame: Frame, boot_ms: int) -> list[Any]:
        vehicle = self._session.vehicle
        assert vehicle is not None
        payload = firmware_proto.encode(frame)
        padded = list(payload.ljust(128, b"\0"))
        return [dialect.MAVLink_tunnel_message(vehicle.system, vehicle.component, TUNNEL_TYPE, len(payload), padded)]


def _named_int(frame: Frame, boot_ms: int) -> list[Any]:
    return [dialect.MAVLink_named_value_int_message(boot_ms, name, value) for name, value in named_values(frame)]


def _named_float(frame: Frame, boot_ms: int) -> list[Any]:
    return [dialect.MAVLink_named_value_float_message(boot_ms, name, value) for name, value in named_values(frame)]


def named_values(frame: Frame) -> Iterator[tuple[bytes, int]]:
    """The valid channels, and always channel 1: names of 10 bytes at most, and integers that a float holds."""
    for slot, channel in enumerate(frame.channels, 1):
        if slot > 1 and not channel.valid:
            continue
        id_ = 255 if channel.id is None else channel.id
        for suffix, value in (("D", channel.d), ("DIR", channel.delta), ("ID", id_)):
            yield f"ARVA{slot}_{suffix}".encode(), value


def _debug_vect(frame: Frame, boot_ms: int) -> list[Any]:
    """Two vectors of two channels each; d goes into the unsigned time_usec as two's complement."""
    pairs = [(c.d, c.delta) for c in frame.channels[:4]]
    pairs += [(-1, -1)] * (4 - len(pairs))
    (d1, a1), (d2, a2), (d3, a3), (d4, a4) = pairs
    return [
        dialect.MAVLink_debug_vect_message(b"a", d1 % 2**64, a1, d2, a2),
        dialect.MAVLink_debug_vect_message(b"b", d3 % 2**64, a3, d4, a4),
    ]


class MavlinkDecoder(FrameDecoder):
    """What `MavlinkPort` sends, read back into frames; messages of every system count. `now` is not needed.

    Only `tunnel` carries sequence and status: frames of the others are numbered as they come. A frame of theirs ends
    where the next begins, so it is delivered then.
    """

    def __init__(self, format: str) -> None:
        super().__init__()
        self._parser = Parser()
        self._read = {
            "tunnel": self._tunnel,
            "named": self._on_int,
            "named_float": self._on_float,
            "debug_vect": self._on_vector,
        }[format]
        self._frames: list[Frame] = []
        self._binary = firmware_proto.Decoder()
        self._values: dict[str, int] = {}
        self._slots: list[Channel] = []

    def feed(self, chunk: bytes, now: float) -> list[Frame]:
        for packet in self._parser.feed(chunk):
            if (message := self._parser.decode(packet)) is not None:
                self._read(message, now)
        self.bad_crc, self.dropped = self._parser.bad_crc, self._parser.skipped
        frames, self._frames = self._frames, []
        return frames

    def _tunnel(self, message: Any, now: float) -> None:
        if message.get_type() == "TUNNEL" and message.payload_type == TUNNEL_TYPE:
            for frame in self._binary.feed(bytes(message.payload[: message.payload_length]), now):
                self._count(frame.sequence)
                self._frames.append(frame)

    def _on_int(self, message: Any, now: float) -> None:
        if message.get_type() == "NAMED_VALUE_INT":
            self._on_named(message.name, message.value)

    def _on_float(self, message: Any, now: float) -> None:
        if message.get_type() == "NAMED_VALUE_FLOAT" and message.value.is_integer():  # neither NaN nor infinite
            self._on_named(message.name, int(message.value))

    def _on_named(self, name: str, value: int) -> None:
        if not name.startswith("ARVA"):
            return
        if name == "ARVA1_D":
            channels = []
            for slot in range(1, firmware_proto.MAX_CHANNELS + 1):
                if (d := self._values.get(f"ARVA{slot}_D")) is not None:
                    id_ = self._values.get(f"ARVA{slot}_ID", 255)
                    delta = self._values.get(f"ARVA{slot}_DIR", -1)
                    channels.append(Channel(None if id_ == 255 else id_, _zone(d, delta), d, delta))
            self._deliver(channels)
            self._values.clear()
        if len(self._values) < 3 * firmware_proto.MAX_CHANNELS:
            self._values[name] = value

    def _on_vector(self, message: Any, now: float) -> None:
        if message.get_type() != "DEBUG_VECT" or message.name not in ("a", "b"):
            return
        if not math.isfinite(message.x + message.y + message.z):
            self._slots = []
            return
        d = message.time_usec - 2**64 if message.time_usec >= 2**63 else message.time_usec
        pairs = [(d, int(message.x)), (int(message.y), int(message.z))]
        channels = [Channel(None, _zone(d, delta), d, delta) for d, delta in pairs]
        self._slots = channels if message.name == "a" else [*self._slots, *channels]
        if message.name == "b":
            self._deliver(self._slots if len(self._slots) == 4 else [])
            self._slots = []

    def _deliver(self, channels: list[Channel]) -> None:
        """A frame, unless no receiver can have said it: this link is everybody's."""
        frame = Frame(self.good % 256, firmware_proto.SYNTHETIC, tuple(channels))
        try:
            check(frame)
        except ValueError:
            return
        self._count(frame.sequence)
        self._frames.append(frame)


def _zone(d: int, delta: int) -> int:
    """The zone that a distance and an angle leave to conclude."""
    if d < 0:
        return firmware_proto.OUTER
    return firmware_proto.INNER if d <= 300 and delta == 0 else firmware_proto.MID
