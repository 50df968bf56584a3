"""The clauses of PROTOCOL.md as data: bytes for a decoder of the binary form, and the lines that it must print."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from random import Random
from typing import Final, NamedTuple

from firmware_proto import INNER, MAX_CHANNELS, Channel, Command, Frame, encode
from firmware_proto.commands import encode_command

NO_ID: Final = 255
_RULES: Final = "Finding frames: the rules of a decoder"  # a section
_SYNC: Final = b"\xa4\x57"
_FALSE_HEAD: Final = bytes.fromhex("A4570163000010")  # of 16 channels
_KNOWN_ZONES: Final = 3


class Line(NamedTuple):
    """One line of a decoder: a channel of a frame. None: any value is right."""

    seq: int
    slot: int
    id: int
    zone: int | None
    d_cm: int
    """0 without a signal."""
    delta_deg: int | None


class Step(NamedTuple):
    """Bytes for the decoder, and what follows them."""

    data: bytes
    pause_s: float = 0.0
    """Silence after the bytes."""
    lines: int = 0
    """The lines that must come, on a silent line, before the next step."""


@dataclass(frozen=True)
class Clause:
    """One promise that a decoder keeps."""

    name: str
    section: str
    """Heading in PROTOCOL.md."""
    text: str
    steps: tuple[Step, ...]
    expected: tuple[Line, ...]
    pty: bool = False
    """It needs a port that can be unplugged."""


def lines_of(frames: Iterable[Frame]) -> tuple[Line, ...]:
    """Return the lines of good frames."""
    return tuple(_line(frame, slot, one) for frame in frames for slot, one in enumerate(frame.channels, 1))


def _line(frame: Frame, slot: int, one: Channel) -> Line:
    id_ = NO_ID if one.id is None else one.id
    zone = one.zone if one.zone < _KNOWN_ZONES else None
    if not one.valid:
        return Line(frame.sequence, slot, id_, None, 0, None)
    return Line(frame.sequence, slot, id_, zone, one.d, None if one.zone == INNER else one.delta)


def _frames(count: int, n: int = 1, first: int = 0) -> list[Frame]:
    """Return frames with different values in every channel."""
    random = Random(457 + n)
    return [
        Frame(
            (first + k) % 256,
            1,
            tuple(
                Channel(random.randrange(255), 1, random.randrange(300, 5000), random.randrange(-89, 90))
                for _ in range(n)
            ),
        )
        for k in range(count)
    ]


def _one(sequence: int, *channels: Channel, status: int = 1) -> Frame:
    return Frame(sequence, status, channels)


def _raw(version: int, length: int, payload: bytes) -> bytes:
    """Return a candidate with a right CRC and any head."""
    from fastcrc import crc16

    body = bytes([version, length]) + payload
    return _SYNC + body + crc16.mcrf4xx(body).to_bytes(2, "little")


def _clause(
    name: str, section: str, text: str, frames: Sequence[Frame], *steps: Step | bytes, pty: bool = False
) -> Clause:
    """Return a clause; without steps the frames are sent as they are, one write each."""
    made = [Step(one) if isinstance(one, bytes) else one for one in steps or map(encode, frames)]
    return Clause(name, section, text, tuple(made), lines_of(frames), pty)


def _candidates(name: str, text: str, wrong: Iterable[bytes]) -> Clause:
    good, data = [], b""
    for k, raw in enumerate(wrong):
        good += _frames(1, 1, k)
        data += raw + encode(good[-1])
    return _clause(name, "Binary frame", text, good, data)


def _of_channels() -> Iterator[Clause]:
    """Yield the clauses about the channels of a frame."""
    yield _clause(
        "whole",
        "Four channels, byte by byte",
        "a whole frame is printed, a line a channel",
        [_one(7, Channel(3, 2, 85, 0), Channel(1, 1, 1250, -35), Channel(2, 1, 4020, 17), Channel())],
    )

    yield _clause(
        "channels",
        "Binary frame",
        "a frame has 1…16 channels",
        [_frames(1, n, n)[0] for n in range(1, MAX_CHANNELS + 1)],
    )

    yield _clause(
        "slots",
        "Binary frame",
        "a slot keeps its number, also behind an empty one",
        [
            _one(0, Channel(), Channel(5, 1, 900, 9), Channel(), Channel(6, 2, 200, 0)),
            _one(1, Channel(7, 1, 901, 8)),
        ],
    )

    yield _clause(
        "ids",
        "Binary frame",
        "an id is 0…254; 255 is none",
        [_one(0, *(Channel(i, 1, 700, 7) for i in (0, 1, 127, 128, 164, 254, None)))],
    )

    channels = [
        Channel(k, zone, 1000, 10, marked)
        for k, (zone, marked) in enumerate((z, m) for z in (1, 2, 0) for m in (False, True))
    ]
    yield _clause(
        "zones", "Binary frame", "bit 7 of the zone is the mark, not the zone", [_one(k, *channels) for k in range(2)]
    )


def _of_values() -> Iterator[Clause]:
    """Yield the clauses about the values of a channel."""
    yield _clause(
        "distance",
        "Binary frame",
        "d is a little-endian int16 in centimetres",
        [_one(0, *(Channel(1, 1, d, 3) for d in (1, 127, 128, 255, 256, 4660, 5000, 32767)))],
    )

    channels = [Channel(1, 1, 800, delta) for delta in (-1, 0, 1, -89, 89, -45, 17)]
    yield _clause(
        "delta",
        "What a reading means",
        "δ is signed, positive to the right; −1 is a direction where d > 0",
        [_one(0, *channels), _one(1, channels[0])],
    )

    heard = Channel(1, 1, 1500, 20)
    silent = [
        Channel(),
        Channel(None, 0, -1, 0),
        Channel(None, 0, 0, 0),
        Channel(1, 0, -2, 20),
        Channel(1, 1, -32768, 5),
    ]
    frames = [
        one
        for k, channel in enumerate(silent)
        for one in (_one(2 * k, heard, heard), _one(2 * k + 1, channel, channel))
    ]
    yield _clause("no-signal", "No signal", "d ≤ 0: no signal, and no earlier value is kept", frames)

    strange = _raw(1, 9, bytes([2, 1, 1, 4, 3, 244, 1, 5, 0]))
    frames = [_one(3 + k, Channel(4, 1, 500, 5), status=status) for k, status in enumerate((0xC1, 0, 2, 4, 8, 16, 32))]
    text = "unknown zones and status bits are no fault, and a frame of any status is printed"
    steps = [strange, *map(encode, frames)]
    yield _clause("unknown", "Status", text, [_one(2, Channel(4, 3, 500, 5)), *frames], *steps)


def _of_checks() -> Iterator[Clause]:
    """Yield the clauses about frames that are refused."""
    good, data = _frames(40, 1), b""
    for k, frame in enumerate(good):
        hurt = bytearray(encode(_one(k + 100, Channel(9, 1, 999, 9))))
        hurt[4 + k % 11] ^= 1 << k % 8  # sequence … CRC; n makes it a false head
        data += bytes(hurt) + encode(frame)
    yield _clause("checksum", "CRC", "a frame with one wrong bit is refused", good, data)

    found: list[Frame] = []  # their CRCs have bytes that are easily mistaken: 0, A4, 255
    wanted = [(at, value) for at in (-1, -2) for value in (0x00, 0xA4, 0xFF, 0x57)]
    for d in range(1, 5000):
        frame = _one(len(found), Channel(1, 1, d, 0))
        raw = encode(frame)
        if hit := next((one for one in wanted if raw[one[0]] == one[1]), None):
            wanted.remove(hit)
            found.append(frame)
        if not wanted:
            break
    yield _clause("checksum-bytes", "CRC", "each byte of a CRC may have any value", found)

    payload = encode(_one(99, Channel(9, 1, 999, 9)))[4:-2]
    yield _candidates(
        "version",
        "frames of another version are refused",
        [_raw(version, 9, payload) for version in (0, 2, 3, 129, 255)],
    )

    channel = bytes([9, 1, 231, 3, 9, 0])
    wrong = [_raw(1, 3, bytes([99, 1, 0])), _raw(1, 8, bytes([99, 1, 1]) + channel[:5])]
    wrong += [_raw(1, 10, bytes([99, 1, 1]) + channel + b"\0"), _raw(1, 105, bytes([99, 1, 17]) + channel * 17)]
    yield _candidates("length", "a length other than 9, 15 … 99 is refused", wrong)

    wrong = [_raw(1, 9, bytes([99, 1, n]) + channel) for n in (0, 2, 16, 17, 255)]
    wrong.append(_raw(1, 15, bytes([99, 1, 1]) + channel * 2))
    yield _candidates("count", "n must agree with the length", wrong)

    frames, data = _frames(9), b""
    for k, frame in enumerate(frames):
        data += encode_command(Command(k, "mark", (3 * k,))) + encode(frame)
    yield _clause("messages", "Messages: version 2", "messages between frames are passed over", frames, data)


def _of_cuts() -> Iterator[Clause]:
    """Yield the clauses about frames in pieces, and bytes between them."""
    frames = _frames(27, 3)
    first, *others = map(encode, frames)
    steps = [Step(first, lines=3)]  # the decoder has started, and sees the pauses
    for k, raw in enumerate(others, 1):
        steps += [Step(raw[:k], 0.03 if k == 1 else 0.002), Step(raw[k:], 0.002)]  # 30 ms: an adapter for USB
    yield _clause("split", _RULES, "a frame may be cut at every byte", frames, *steps)

    frames = _frames(2, 2)
    steps = [Step(bytes([byte])) for frame in frames for byte in encode(frame)]
    yield _clause("bytewise", _RULES, "a frame may come byte by byte", frames, *steps)

    frames = [frame for n in (1, 4, 16, 2) for frame in _frames(20, n, 20 * n)]
    yield _clause("joined", _RULES, "many frames may come at once", frames, b"".join(map(encode, frames)))

    random, frames, data = Random(458), _frames(40, 2), b""
    for frame in frames:
        noise = bytes(
            random.choice((0xA4, 0x57, 0x01, 0x00, random.randrange(256))) for _ in range(random.randrange(1, 40))
        )
        data += noise.replace(_SYNC + b"\x01", b"\x00") + b"\x00" + encode(frame)
    yield _clause("noise", _RULES, "bytes between frames cost no frame", frames, data)

    cuts = [b"\xa4", b"\xa4\xa4", b"\xa4\x57\xa4\x57\x01", *(_FALSE_HEAD[:size] for size in (2, 3, 4, 5, 6))]
    frames = _frames(len(cuts))
    data = b"".join(cut + encode(frame) for cut, frame in zip(cuts, frames, strict=True))
    yield _clause("sync", _RULES, "the beginning of a head before a frame costs no frame", frames, data)

    yield _clause(
        "inside",
        _RULES,
        "A4 57 may be inside a frame",
        [_one(164, Channel(164, 1, 0x57A4, 1)), _one(1, Channel(0xA4, 1, 0x0157, 9)), *_frames(1)],
    )


def _of_false_heads() -> Iterator[Clause]:
    """Yield the clauses about false heads."""
    frames = _frames(6)
    data = _FALSE_HEAD + b"".join(map(encode, frames)) + bytes(8)
    yield _clause("resync", _RULES, "a refused candidate costs one byte, not the frames in it", frames, data)

    frames = _frames(2)
    yield _clause(
        "false-head",
        _RULES,
        "a frame behind a false head comes 100 ms later, on a silent line too",
        frames,
        Step(_FALSE_HEAD + encode(frames[0]), 0.0, 1),
        encode(frames[1]),
    )

    before, half, after = _frames(3)
    cut = len(encode(half)) // 2
    yield _clause(
        "pause",
        _RULES,
        "a candidate that is not whole after 100 ms is refused",
        [before, after],
        Step(encode(before) + encode(half)[:cut], 0.0, 1),
        Step(b"", 0.4),
        Step(encode(half)[cut:] + encode(after), 0.0),
    )


def _of_time() -> Iterator[Clause]:
    """Yield the clauses about time, gaps and the end."""
    yield _clause(
        "sequence",
        "Lost frames",
        "frames are printed after gaps, at 255 → 0 and after a restart",
        [_frames(1, 1, number)[0] for number in (5, 6, 9, 250, 255, 0, 1, 200, 0, 1)],
    )

    first, second = _frames(2)
    yield _clause(
        "silence",
        "Timing",
        "frames are printed after a silence",
        [first, second],
        Step(encode(first), 0.7),
        encode(second),
    )

    frames, data = _frames(1800, 9), b""
    for frame in frames:
        data += encode(frame) + b"\0"  # 64 bytes: no read cuts a frame, so a slow decoder sees no pause in one
    yield _clause("burst", "Timing", "115 kB may come at once", frames, data)

    (frame,) = _frames(1)
    half = encode(_one(1, Channel(2, 1, 400, 4)))[:-1]
    yield _clause("end", _RULES, "half a frame at the end is none", [frame], encode(frame) + half)

    yield _clause("empty", _RULES, "without bytes there is no line", [], b"")

    frames = _frames(3)
    text = "the program ends when its port is unplugged"
    whole = list(map(encode, frames))
    yield _clause("unplugged", "Timing", text, frames[:2], *whole[:2], whole[2][:7], pty=True)


def clauses() -> Iterator[Clause]:
    """Make all clauses, in the order of their names in `--list`."""
    for group in (_of_channels, _of_values, _of_checks, _of_cuts, _of_false_heads, _of_time):
        yield from group()
