"""What a frame says, whatever its bytes look like: the values, their limits and the face of every decoder.

Layout and meaning: PROTOCOL.md, next to this file.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import TYPE_CHECKING, Final, NamedTuple

if TYPE_CHECKING:
    from firmware_proto.commands import HostForm

SYNTHETIC: Final = 1  # status bits; always set by an emulator
INTERFERENCE: Final = 2  # above the receiver's limit
MORE_TRANSMITTERS: Final = 4  # more heard than there are channels
SELF_TEST_FAULT: Final = 8

OUTER: Final = 0  # zones
MID: Final = 1
INNER: Final = 2
MARKED: Final = 0x80  # added to the zone on the wire

MAX_CHANNELS: Final = 16
NO_SIGNAL: Final = -1  # d and δ of a channel that hears nothing
RESTART: Final = 16  # a number below it, where more frames than this would be missing: the receiver has restarted
PAUSE_S: Final = 0.1  # seconds; the bytes of one frame come without a pause as long as this


class Channel(NamedTuple):
    """One channel of a reading: `d` in centimetres, `delta` in degrees. `Channel()` hears nothing.

    `id` is the transmitter's, 0…254, or None. `zone` is OUTER, MID or INNER; a decoder delivers a zone that
    it does not know (3…127) as it came.
    """

    id: int | None = None
    zone: int = OUTER
    d: int = NO_SIGNAL
    delta: int = NO_SIGNAL
    marked: bool = False

    @property
    def valid(self) -> bool:
        """Whether the channel hears a transmitter: d > 0, whatever δ and id say (PROTOCOL.md, "No signal")."""
        return self.d > 0


class Frame(NamedTuple):
    """One reading of the receiver, 1…16 channels. `status` is the byte as it came, unknown bits included."""

    sequence: int
    status: int
    channels: tuple[Channel, ...]


class FrameDecoder(ABC):
    """The face of the three decoders: feed bytes, get frames. Wrong bytes are counted and never raise.

    Counters: `good` (frames delivered), `bad_crc` (candidates whose checksum failed), `dropped` (bytes in no
    frame) and `lost` (frames missing from the sequence; a receiver that restarts has lost none).
    """

    def __init__(self) -> None:
        self.good = 0
        self.bad_crc = 0
        self.dropped = 0
        self.lost = 0
        self._sequence: int | None = None

    @abstractmethod
    def feed(self, chunk: bytes, now: float) -> list[Frame]:
        """The frames completed by `chunk`, which may be empty or cut anywhere.

        `now` is when the chunk arrived, in seconds of any clock that never goes back.
        """

    def _count(self, sequence: int) -> None:
        """Count a good frame and those missing before it; one that comes twice is not a gap."""
        self.good += 1
        if self._sequence is not None:
            self.lost += missing(self._sequence, sequence)
        self._sequence = sequence


class Format(NamedTuple):
    """A wire format: how a frame becomes bytes, and bytes frames again.

    `encode` raises ValueError for a frame that does not fit. `decoder` makes a decoder for one stream of bytes.
    `numbered`: a frame's sequence number and status are in its bytes. `host`: how commands and answers travel on the
    same port, None if the receiver takes none.
    """

    encode: Callable[[Frame], bytes]
    decoder: Callable[[], FrameDecoder]
    numbered: bool = False
    host: HostForm | None = None


def missing(before: int, sequence: int) -> int:
    """How many frames were lost between two good ones, by their sequence numbers (PROTOCOL.md, "Lost frames")."""
    gap = max((sequence - before) % 256 - 1, 0)
    return 0 if sequence < RESTART < gap else gap


def check(frame: Frame) -> None:
    """Raise ValueError, naming field and range, when the frame does not fit on the wire."""
    _fits("sequence", frame.sequence, 0, 255)
    _fits("status", frame.status, 0, 255)
    _fits("n", len(frame.channels), 1, MAX_CHANNELS)
    for k, channel in enumerate(frame.channels):
        if channel.id is not None:
            _fits(f"channels[{k}].id", channel.id, 0, 254)
        _fits(f"channels[{k}].zone", channel.zone, OUTER, INNER)
        _fits(f"channels[{k}].d", channel.d, -0x8000, 0x7FFF)
        _fits(f"channels[{k}].delta", channel.delta, -0x8000, 0x7FFF)


def _fits(name: str, value: int, low: int, high: int) -> None:
    if not isinstance(value, int) or not low <= value <= high:
        raise ValueError(f"{name} is {value!r}, expected an integer {low}…{high}")
