"""The contents of a frame in any format: its values and their limits, and the base of all decoders.

Layout and meaning: PROTOCOL.md, next to this file.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Final, NamedTuple

SYNTHETIC: Final = 1  # status bits; always set by an emulator
INTERFERENCE: Final = 2  # above the receiver's limit
MORE_TRANSMITTERS: Final = 4  # more transmitters are received than there are channels
SELF_TEST_FAULT: Final = 8
OVERLAP: Final = 16  # pulses of several transmitters overlap
NOT_SEARCHING: Final = 32  # it sends again by itself, and receives nothing

OUTER: Final = 0  # zones
MID: Final = 1
INNER: Final = 2
MARKED: Final = 0x80  # added to the zone on the wire

MAX_CHANNELS: Final = 16
NO_SIGNAL: Final = -1  # d and δ of a channel without a signal
RESTART: Final = 16  # a lower number after a gap of more than this many frames means that the receiver has restarted
PAUSE_S: Final = 0.1  # [s] there is no pause of this length inside a frame


class Channel(NamedTuple):
    """One channel of a reading: `d` in centimetres, `delta` in degrees. `Channel()` has no signal.

    `id`: of the transmitter, 0…254, or None. `zone`: OUTER, MID or INNER; a decoder keeps an unknown zone (3…127).
    """

    id: int | None = None
    zone: int = OUTER
    d: int = NO_SIGNAL
    delta: int = NO_SIGNAL
    marked: bool = False

    @property
    def valid(self) -> bool:
        """True if the channel receives a transmitter: d > 0, for any δ and id (PROTOCOL.md, "No signal")."""
        return self.d > 0


class VectorChannel(NamedTuple):
    """The newest pulse of one transmitter at three antennas.

    `x`, `y`, `z`: signed amplitudes in 0.01 nA/m; their signs are relative to each other. `period`: of the transmitter
    in 0.1 ms, 0 if unknown. `carrier`: its offset from 457 kHz in 0.1 Hz, None if unknown. `age_ms`: from the pulse's
    end to the message's time, None if there was no pulse. `id`, `zone`, `marked`: as in `Channel`.
    """

    id: int | None = None
    zone: int = OUTER
    marked: bool = False
    x: int = 0
    y: int = 0
    z: int = 0
    period: int = 0
    carrier: int | None = None
    age_ms: int | None = None


class LevelChannel(NamedTuple):
    """The strength of the newest pulse of one transmitter at one antenna.

    `level`: in 0.01 dB of the receiver's full scale (dBFS), None without a signal. The others as in `VectorChannel`.
    """

    id: int | None = None
    zone: int = OUTER
    marked: bool = False
    level: int | None = None
    age_ms: int | None = None


class Measured(NamedTuple):
    """The measured values of a receiver: `time_ms` is its clock, below 2³²; a pulse ended `age_ms` before it."""

    time_ms: int
    channels: tuple[VectorChannel, ...] | tuple[LevelChannel, ...]


class Frame(NamedTuple):
    """One reading of the receiver, 1…16 channels. `status` is the byte as it came, unknown bits included.

    `measured`: what the antennas measured, in the formats that carry it.
    """

    sequence: int
    status: int
    channels: tuple[Channel, ...]
    measured: Measured | None = None


class FrameDecoder(ABC):
    """The base of all decoders of frames: `feed` takes bytes and returns frames. Wrong bytes are counted, not raised.

    Counters: `good` (frames returned), `bad_crc` (candidates whose checksum failed), `dropped` (bytes in no frame) and
    `lost` (frames missing from the sequence; a receiver that restarts has lost none).
    """

    def __init__(self) -> None:
        self.good = 0
        self.bad_crc = 0
        self.dropped = 0
        self.lost = 0
        self._sequence: int | None = None

    @abstractmethod
    def feed(self, chunk: bytes, now: float) -> list[Frame]:
        """Return the frames completed by `chunk`, which may be empty or cut anywhere.

        `now`: arrival of the chunk, in seconds of any clock that never goes back.
        """

    def _count(self, sequence: int) -> None:
        """Count a valid frame and those missing before it. A frame that comes twice is no gap."""
        self.good += 1
        if self._sequence is not None:
            self.lost += missing(self._sequence, sequence)
        self._sequence = sequence


class Pending:
    """Remembers the bytes of an incomplete candidate, and when each of them came."""

    def __init__(self) -> None:
        self._bytes = b""
        self._arrived: list[float] = []  # one time for each byte

    def __len__(self) -> int:
        return len(self._bytes)

    def feed(self, chunk: bytes, now: float, scan: Callable[[bytes, int], int]) -> int:
        """Scan the pending bytes and `chunk`. Return the number of refused candidates; each drops one byte.

        `scan`: (bytes, start) → the start of an incomplete candidate, or the end. A candidate that is incomplete 100 ms
        after its first byte is refused, and the bytes after its first one are scanned again.
        """
        given_up, held, arrived = 0, self._bytes, self._arrived
        while held and now - arrived[0] >= PAUSE_S:
            given_up += 1
            at = scan(held, 1)
            held, arrived = held[at:], arrived[at:]
        if chunk:
            data = held + chunk
            at = scan(data, 0)
            arrived = arrived[at:] + [now] * (len(data) - max(at, len(held)))
            held = data[at:]
        self._bytes, self._arrived = held, arrived
        return given_up


def missing(before: int, sequence: int) -> int:
    """Return the number of frames lost between two valid ones, by sequence numbers (PROTOCOL.md, "Lost frames")."""
    gap = max((sequence - before) % 256 - 1, 0)
    return 0 if sequence < RESTART < gap else gap


def check(frame: Frame) -> None:
    """Raise ValueError with the field and its range if a frame cannot be encoded."""
    values = [
        ("sequence", frame.sequence, 0, 255),
        ("status", frame.status, 0, 255),
        ("n", len(frame.channels), 1, MAX_CHANNELS),
    ]
    for k, (id, zone, d, delta, _) in enumerate(frame.channels):
        values += [
            (f"channels[{k}].id", 0 if id is None else id, 0, 254),
            (f"channels[{k}].zone", zone, OUTER, INNER),
            (f"channels[{k}].d", d, -0x8000, 0x7FFF),
            (f"channels[{k}].delta", delta, -0x8000, 0x7FFF),
        ]
    for name, value, low, high in values:
        if not isinstance(value, int) or not low <= value <= high:
            raise ValueError(f"{name} is {value!r}, expected an integer {low}…{high}")
