"""Formats inside MAVLink: from a frame to messages on the autopilot's own link, and back."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any, Final, NamedTuple

import firmware_proto
from arva_hil.autopilot.following.discovery import Vehicle
from arva_hil.mavlink.codec import Parser, decode, dialect, tunnel, untunnel
from firmware_proto import Channel, Format, Frame, FrameDecoder
from firmware_proto.frame import check

__all__ = ["Format", "FrameDecoder", "MavlinkFormat", "named_values"]

TUNNEL_TYPE: Final = 42071  # 0xA457, in MAVLink's private range

_SILENCE_S: Final = 1.0  # longer than any link takes from one value of a frame to the next


class MavlinkFormat(NamedTuple):
    """A format inside MAVLink. `encode`: (frame, its instant in ms on the vehicle's clock, vehicle) → messages.

    `decoder` and `numbered` as in `firmware_proto.Format`. These frames go over the autopilot's own link.
    """

    encode: Callable[[Frame, int, Vehicle], Sequence[Any]]
    decoder: Callable[[], FrameDecoder]
    numbered: bool = False

    @property
    def over_mavlink(self) -> bool:
        """True for each of these formats."""
        return True


def _tunnel(frame: Frame, boot_ms: int, vehicle: Vehicle) -> list[Any]:
    return [tunnel(TUNNEL_TYPE, firmware_proto.encode(frame), vehicle.system, vehicle.component)]


def _named(message: Callable[[int, bytes, int], Any], frame: Frame, boot_ms: int, vehicle: Vehicle) -> list[Any]:
    return [message(boot_ms, name, value) for name, value in named_values(frame)]


def named_values(frame: Frame) -> Iterator[tuple[bytes, int]]:
    """Yield name and value of each valid channel and of channel 1.

    Names of 10 bytes at most; a float can hold the values.
    """
    for slot, channel in enumerate(frame.channels, 1):
        if slot > 1 and not channel.valid:
            continue
        id_ = 255 if channel.id is None else channel.id
        for suffix, value in (("D", channel.d), ("DIR", channel.delta), ("ID", id_)):
            yield f"ARVA{slot}_{suffix}".encode(), value


def _debug_vect(frame: Frame, boot_ms: int, vehicle: Vehicle) -> list[Any]:
    """Return two vectors of two channels each. The unsigned time_usec holds d as two's complement."""
    pairs = [(c.d, c.delta) for c in frame.channels[:4]]
    pairs += [(-1, -1)] * (4 - len(pairs))
    (d1, a1), (d2, a2), (d3, a3), (d4, a4) = pairs
    return [
        dialect.MAVLink_debug_vect_message(b"a", d1 % 2**64, a1, d2, a2),
        dialect.MAVLink_debug_vect_message(b"b", d3 % 2**64, a3, d4, a4),
    ]


class MavlinkDecoder(FrameDecoder):
    """Reads frames of formats inside MAVLink, from all systems.

    Only `tunnel` carries sequence and status: frames of the others are numbered in the order in which they come. A
    frame of named values ends when a name comes again, or if no more of its values came for 1 s; an empty `feed` is
    enough for that. A channel without its distance or its angle is left out.
    """

    def __init__(self, format: str) -> None:
        super().__init__()
        self._parser = Parser()
        self._msgid, self._read = {
            "tunnel": (dialect.MAVLINK_MSG_ID_TUNNEL, self._on_tunnel),
            "named": (dialect.MAVLINK_MSG_ID_NAMED_VALUE_INT, self._on_named),
            "named_float": (dialect.MAVLINK_MSG_ID_NAMED_VALUE_FLOAT, self._on_named),
            "debug_vect": (dialect.MAVLINK_MSG_ID_DEBUG_VECT, self._on_vector),
        }[format]
        self._frames: list[Frame] = []
        self._binary = firmware_proto.Decoder()
        self._values: dict[str, int] = {}  # of the frame that is not complete
        self._since = 0.0  # the time of the last one
        self._slots: list[Channel] = []

    def feed(self, chunk: bytes, now: float) -> list[Frame]:
        if self._values and now - self._since >= _SILENCE_S:
            self._end_named()
        for packet in self._parser.feed(chunk):
            if packet.msgid == self._msgid and (message := decode(packet)) is not None:
                self._read(message, now)
        self.bad_crc, self.dropped = self._parser.bad_crc, self._parser.skipped
        frames, self._frames = self._frames, []
        return frames

    def _on_tunnel(self, message: Any, now: float) -> None:
        if message.payload_type == TUNNEL_TYPE:
            for frame in self._binary.feed(untunnel(message), now):
                self._count(frame.sequence)
                self._frames.append(frame)

    def _on_named(self, message: Any, now: float) -> None:
        name, value = message.name, float(message.value)
        if not name.startswith("ARVA") or not value.is_integer():  # nor NaN, nor infinite
            return
        if name in self._values:
            self._end_named()
        if (self._values or name == "ARVA1_D") and len(self._values) < 3 * firmware_proto.MAX_CHANNELS:
            self._values[name] = int(value)
            self._since = now

    def _end_named(self) -> None:
        channels = []
        for slot in range(1, firmware_proto.MAX_CHANNELS + 1):
            d, delta = (self._values.get(f"ARVA{slot}_{suffix}") for suffix in ("D", "DIR"))
            if d is not None and delta is not None:  # neither was lost
                id_ = self._values.get(f"ARVA{slot}_ID", 255)
                channels.append(Channel(None if id_ == 255 else id_, zone_of(d, delta), d, delta))
        self._deliver(channels)
        self._values.clear()

    def _on_vector(self, message: Any, now: float) -> None:
        if message.name not in ("a", "b"):
            return
        if not math.isfinite(message.x + message.y + message.z):
            self._slots = []
            return
        d = message.time_usec - 2**64 if message.time_usec >= 2**63 else message.time_usec
        pairs = [(d, int(message.x)), (int(message.y), int(message.z))]
        channels = [Channel(None, zone_of(d, delta), d, delta) for d, delta in pairs]
        self._slots = channels if message.name == "a" else [*self._slots, *channels]
        if message.name == "b":
            self._deliver(self._slots if len(self._slots) == 4 else [])
            self._slots = []

    def _deliver(self, channels: list[Channel]) -> None:
        """Deliver a frame if it is valid. Anybody can send on this link."""
        frame = Frame(self.good % 256, firmware_proto.SYNTHETIC, tuple(channels))
        try:
            check(frame)
        except ValueError:
            return
        self._count(frame.sequence)
        self._frames.append(frame)


def zone_of(d: int, delta: int) -> int:
    """Return the zone, concluded from distance and angle. 0 is no distance: some receivers send it without a signal."""
    if d <= 0:
        return firmware_proto.OUTER
    return firmware_proto.INNER if d <= 300 and delta == 0 else firmware_proto.MID


TUNNEL: Final = MavlinkFormat(_tunnel, partial(MavlinkDecoder, "tunnel"), numbered=True)
NAMED: Final = MavlinkFormat(partial(_named, dialect.MAVLink_named_value_int_message), partial(MavlinkDecoder, "named"))
NAMED_FLOAT: Final = MavlinkFormat(
    partial(_named, dialect.MAVLink_named_value_float_message), partial(MavlinkDecoder, "named_float")
)
DEBUG_VECT: Final = MavlinkFormat(_debug_vect, partial(MavlinkDecoder, "debug_vect"))
