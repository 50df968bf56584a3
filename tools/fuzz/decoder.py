"""The decoders of frames: every output was sent, and every byte is counted once."""

from __future__ import annotations

import itertools
import json
import struct
from collections.abc import Iterator
from typing import Final

from fastcrc import crc16

from arva_hil import registry
from arva_hil.emulator.formats import TUNNEL_TYPE, MavlinkDecoder
from arva_hil.mavlink.codec import dialect
from firmware_proto import MAX_CHANNELS, MAX_FRAME_BYTES, Channel, Frame, FrameDecoder, encode
from firmware_proto.messages import MAX_MESSAGE_BYTES
from tools.fuzz.script import PAUSES_S, ROOT, Script, fed, packet, scripted

DECODERS: Final = {
    name: registry.FORMATS[name].decoder for name in registry.FORMATS if name not in registry.MAVLINK_FORMATS
}
ENCODERS: Final = {name: registry.FORMATS[name].encode for name in DECODERS}
FORMATS: Final = tuple(registry.FORMATS)
MEASURED: Final = [name for name in DECODERS if registry.FORMATS[name].measured]
_HELD: Final = {"binary": MAX_FRAME_BYTES, "nmea": 82 * (MAX_CHANNELS + 1), "text": 16, "handheld": 16} | dict.fromkeys(
    MEASURED,
    2 * MAX_MESSAGE_BYTES,  # a message waits for its frame
)  # bytes, at most
_HELD_IN_SILENCE: Final = {"binary": 0, "nmea": 82, "text": 16, "handheld": 16} | dict.fromkeys(
    MEASURED, MAX_MESSAGE_BYTES
)
_COUNTERS: Final = ("good", "bad_crc", "dropped", "lost")
CARRIERS: Final = (
    dialect.MAVLINK_MSG_ID_TUNNEL,
    dialect.MAVLINK_MSG_ID_NAMED_VALUE_INT,
    dialect.MAVLINK_MSG_ID_DEBUG_VECT,
    dialect.MAVLINK_MSG_ID_NAMED_VALUE_FLOAT,
)


def fuzz(data: bytes) -> None:
    """A format, then chunks."""
    s = Script(data)
    format = FORMATS[s.number() % len(FORMATS)]
    chunks = list(s.chunks())
    if format in registry.MAVLINK_FORMATS:
        _through_the_autopilot(MavlinkDecoder(format), chunks)
        return
    chunks.append(((chunks[-1][0] if chunks else 0.0) + 1000, b""))
    whole, piecemeal = DECODERS[format](), DECODERS[format]()
    frames: list[Frame] = []
    total = in_frames = at_most = 0
    for at, chunk in chunks:
        got = fed(whole, piecemeal, chunk, at)
        frames += got
        total += len(chunk)
        in_frames += sum(_sizes(format, frame)[0] for frame in got)
        at_most += sum(_sizes(format, frame)[1] for frame in got)
        assert total - whole.dropped >= in_frames, "bytes counted twice"
        assert total - whole.dropped - at_most <= _HELD[format], "too many bytes held back"
    assert total - whole.dropped - at_most <= _HELD_IN_SILENCE[format], "too many bytes held for ever"
    counts = [getattr(whole, name) for name in _COUNTERS]
    assert counts == [getattr(piecemeal, name) for name in _COUNTERS], "chunking matters to the counters"
    assert whole.good == len(frames)
    assert whole.lost == _lost(frames)
    for frame in frames:
        _plausible(frame)
    if format == "binary" or format in MEASURED:
        _in_order(b"".join(chunk for _, chunk in chunks), frames)


def _sizes(format: str, frame: Frame) -> tuple[int, int]:
    """The fewest and the most bytes that can have brought a frame."""
    count = len(frame.channels)
    if format == "binary" or format in MEASURED:
        measured = 0 if frame.measured is None else 15 + (15 if format == "vector" else 6) * count
        return 9 + 6 * count + measured, 9 + 6 * count + measured
    return (25 * count, 82 * count) if format == "nmea" else (4, 16)


def _in_order(data: bytes, frames: list[Frame]) -> None:
    at = 0
    for frame in frames:
        known = tuple(c._replace(zone=min(c.zone, 2)) for c in frame.channels)
        raw = bytearray(encode(frame._replace(channels=known)))  # without what was measured
        for k, c in enumerate(frame.channels):
            raw[8 + 6 * k] = c.zone | (0x80 if c.marked else 0)
        raw[-2:] = crc16.mcrf4xx(bytes(raw[2:-2])).to_bytes(2, "little")
        found = data.find(raw, at)
        assert found >= 0, f"{frame} was never sent"
        at = found + len(raw)


def _through_the_autopilot(decoder: FrameDecoder, chunks: list[tuple[float, bytes]]) -> None:
    """MAVLink's own framing is right here, so that what is inside it is what is mutated."""
    got: list[Frame] = []
    for k, (at, chunk) in enumerate(chunks):
        if chunk[:1] in (b"\xfe", b"\xfd"):
            raw = chunk
        else:
            kind = CARRIERS[(chunk or b"\0")[0] % len(CARRIERS)]
            raw = packet(kind, chunk[1:255], (1, 1), sequence=k % 256)
        got += decoder.feed(raw, at)
    assert decoder.good == len(got)
    assert decoder.lost == _lost(got)
    for frame in got:
        _plausible(frame)


def _plausible(frame: Frame) -> None:
    assert 0 <= frame.sequence <= 255
    assert 0 <= frame.status <= 255
    assert 1 <= len(frame.channels) <= MAX_CHANNELS, frame
    for c in frame.channels:
        assert c.id is None or 0 <= c.id <= 254, c
        assert 0 <= c.zone < 128, c


def _lost(frames: list[Frame]) -> int:
    numbers = [frame.sequence for frame in frames]
    gaps = [(b, max((b - a) % 256 - 1, 0)) for a, b in itertools.pairwise(numbers)]
    return sum(gap for number, gap in gaps if number > 15 or gap < 17)


def seeds() -> Iterator[bytes]:
    vectors = json.loads((ROOT / "firmware_proto/vectors.json").read_text(encoding="utf-8"))
    frames = [Frame(v["sequence"], v["status"], tuple(Channel(**c) for c in v["channels"])) for v in vectors["frames"]]
    for stream in vectors["streams"]:
        script, now = bytearray([list(DECODERS).index(stream.get("format", "binary"))]), 0.0
        for step in stream["steps"]:
            pause = max(k for k, s in enumerate(PAUSES_S) if s <= step["t"] - now + 1e-9)
            data, now = bytes.fromhex(step["hex"]), step["t"]
            for at in range(0, len(data) or 1, 255):
                script += bytes([0 if at else pause, len(data[at : at + 255])]) + data[at : at + 255]
        yield bytes(script)
    for vector in vectors["frames"]:
        for number, form in enumerate(DECODERS):
            data = bytes.fromhex(vector["hex"]) if form == "binary" else vector.get(form, "").encode()
            yield bytes([number]) + scripted(data[k : k + 255] for k in range(0, len(data), 255))
    for number, form in enumerate(DECODERS):
        for first, second in itertools.pairwise(frames[:12]):
            data = ENCODERS[form](first) + ENCODERS[form](second)
            cuts = [0, len(data) // 3, len(data) // 2, len(data) * 2 // 3, len(data)]
            yield bytes([number]) + scripted((data[a:b][:255] for a, b in itertools.pairwise(cuts)), pause=3)
    for frame in frames[:6]:
        raw = encode(frame)
        inside = b"\0" + struct.pack("<HBBB", TUNNEL_TYPE, 1, 1, len(raw)) + raw
        yield bytes([FORMATS.index("tunnel")]) + scripted([inside, inside])
    named = [(b"ARVA1_D", 1234), (b"ARVA1_DIR", 17), (b"ARVA1_ID", 1), (b"ARVA2_D", 99), (b"ARVA1_D", 1)]
    for form, parts in (
        ("named", [b"\1" + struct.pack("<Ii10s", 1, value, name) for name, value in named]),
        ("named_float", [b"\3" + struct.pack("<If10s", 1, value, name) for name, value in named]),
        ("debug_vect", [b"\2" + struct.pack("<Qfff10s", 1234, 17.0, 99.0, 3.0, name) for name in (b"a", b"b") * 2]),
    ):
        yield bytes([FORMATS.index(form)]) + scripted(parts)
