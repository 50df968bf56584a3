"""What both decoders of binary frames promise about a bad line: the Python one and the C one."""

from random import Random

import pytest

from firmware_proto import MAX_CHANNELS, Channel, Decoder, Frame, encode
from tools.codecs.c_frames import CDecoder

BYTE_MS = 10 / 115.2
HEADS = [b"\xa4", b"\xa4\x57", b"\xa4\x57\x01", bytes.fromhex("A4570163"), bytes.fromhex("A4570163000010")]


@pytest.fixture(params=["Python", "C"])
def decoder(request, codec):
    return Decoder() if request.param == "Python" else CDecoder(codec)


def frames(random, count):
    """No two alike."""
    for k in range(count):
        channels = [
            Channel(random.choice((None, 0xA4, 7)), random.randrange(3), k, random.choice((-1, 0x57A4, 90)))
            for _ in range(random.choice((1, 4, random.randint(1, MAX_CHANNELS))))
        ]
        yield Frame(k % 256, 1, tuple(channels))


def damaged(random, raw):
    """2 % of the bytes dropped, given another before them, or changed."""
    out = bytearray()
    for byte in raw:
        fate = random.random() * 150
        if fate < 1:
            continue
        if fate < 2:
            out.append(random.randrange(256))
        out.append(byte ^ random.randrange(1, 256) if 2 <= fate < 3 else byte)
    return bytes(out)


def play(decoder, line):
    """Feed (ms, bytes) as they come, a call each millisecond for as long as a byte can be waited for; (ms, frame)."""
    heard = []
    for k, (at, data) in enumerate(line):
        heard += [(at, frame) for frame in decoder.feed(data, at / 1000)]
        end = line[k + 1][0] if k + 1 < len(line) else at + 1000
        for now in range(at + 1, min(end, at + 103)):
            heard += [(now, frame) for frame in decoder.feed(b"", now / 1000)]
    return heard


@pytest.mark.parametrize(("hertz", "count"), [(1, 300), (50, 2000)])
def test_every_whole_frame_of_a_bad_line_comes_out_within_100_ms(decoder, hertz, count):
    """And nothing else does: with this seed no damaged frame has a right CRC by chance."""
    random = Random(457)
    arrivals: dict[int, bytearray] = {}
    last_ms = {}

    def put(at, data):
        for k, byte in enumerate(data):
            arrivals.setdefault(int(at + k * BYTE_MS), bytearray()).append(byte)

    sent = list(frames(random, count))
    for k, frame in enumerate(sent):
        start = 1000 * k / hertz
        raw = damaged(random, encode(frame))
        if (at := raw.find(encode(frame))) >= 0:
            last_ms[frame] = int(start + (at + len(encode(frame)) - 1) * BYTE_MS)
        put(start, raw)
        noise = random.choice([b"", random.randbytes(random.randrange(30)), random.choice(HEADS)])
        put(start + random.choice((10, 15, 1000 / hertz - 2.7)), noise)
    heard = play(decoder, sorted((at, bytes(data)) for at, data in arrivals.items()))
    assert [frame for _, frame in heard] == [frame for frame in sent if frame in last_ms]
    assert 0.4 * count < len(heard) < 0.8 * count
    assert max(at - last_ms[frame] for at, frame in heard) <= 100
    everything = sum(map(len, arrivals.values()))
    assert decoder.dropped == everything - sum(len(encode(frame)) for _, frame in heard)


def test_what_passes_of_damaged_frames_is_what_a_crc_of_16_bits_lets_pass(decoder):
    """One in 65536 of those that are damaged beyond three bits; here of frames with three random bytes."""
    random, passed, count = Random(1), 0, 40_000
    raw = encode(Frame(5, 1, (Channel(1, 2, 300, 12),)))
    for k in range(count):
        bad = bytearray(raw)
        for at in random.sample(range(7, len(raw)), 3):
            bad[at] ^= random.randrange(1, 256)
        passed += len(decoder.feed(bytes(bad), k)) + len(decoder.feed(b"", k + 0.5))
    assert passed <= 5  # 0.6 expected
    assert decoder.dropped == len(raw) * (count - passed)
