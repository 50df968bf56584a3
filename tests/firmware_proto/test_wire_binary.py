import random
from types import SimpleNamespace

import pytest
from fastcrc import crc16
from hypothesis import assume, given
from hypothesis import strategies as st

from firmware_proto import MAX_FRAME_BYTES, Channel, Decoder, Frame, binary, encode, encode_nmea, encode_text
from tests.every import every
from tests.firmware_proto.wire_reference import FRAMES, Reference, verdict

ONE = encode(Frame(1, 1, (Channel(1, 2, 300, 12),)))
LONG_HEAD = bytes.fromhex("A4570163000010")

# Garbage that looks like frames: heads, parts of frames, whole frames inside damaged ones.
PIECES = st.one_of(
    st.binary(max_size=30),
    st.sampled_from([b"\xa4", b"\xa4\x57", b"\xa4\x57\x01", b"\xa4\x57\x01\x63", LONG_HEAD, LONG_HEAD[:6]]),
    st.builds(lambda frame, k: encode(frame)[: k % MAX_FRAME_BYTES], FRAMES, st.integers(1)),
    st.builds(lambda frame, k: encode(frame)[k % MAX_FRAME_BYTES :], FRAMES, st.integers(1)),
)
CUTS = st.lists(st.tuples(st.integers(0, 40), st.sampled_from([0.0, 0.003, 0.04, 0.07, 0.2])), min_size=1)


def feed_cut(decoder, data, cuts):
    """Feed `data` in chunks of the sizes and pauses of `cuts`, over and over; (now, chunk, answer) of each."""
    at, now, k = 0, 0.0, 0
    while at < len(data):
        size, pause = cuts[k % len(cuts)]
        k += 1
        size = max(size, 1) if k % 3 else size  # empty chunks too, but not for ever
        now += pause
        yield now, data[at : at + size], decoder.feed(data[at : at + size], now)
        at += size


def mutate(data, edits):
    data = bytearray(data)
    for kind, at, value in edits:
        at %= len(data) + 1
        if kind == "insert":
            data.insert(at, value)
        elif at < len(data):
            if kind == "delete":
                del data[at]
            else:
                data[at] = value
    return bytes(data)


EDITS = st.lists(st.tuples(st.sampled_from(["insert", "delete", "set"]), st.integers(0), st.integers(0, 255)))


@given(FRAMES)
def test_round_trip(frame):
    raw = encode(frame)
    assert len(raw) == 9 + 6 * len(frame.channels)
    assert Decoder().feed(raw, 0.0) == [frame]


@given(st.lists(FRAMES, max_size=6), st.lists(st.integers(1, 60), min_size=1))
def test_frames_cut_anywhere(frames, sizes):
    decoder = Decoder()
    data = b"".join(map(encode, frames))
    answers = feed_cut(decoder, data, [(size, 0.0) for size in sizes])
    assert [frame for _, _, some in answers for frame in some] == frames
    assert (decoder.good, decoder.dropped, decoder.bad_crc) == (len(frames), 0, 0)


@given(st.lists(PIECES | FRAMES.map(encode), max_size=8), EDITS, CUTS)
def test_any_stream_is_decoded_as_the_rules_read(pieces, edits, cuts):
    decoder, reference = Decoder(), Reference()
    for now, chunk, frames in feed_cut(decoder, mutate(b"".join(pieces), edits), cuts):
        assert list(map(raw_of, frames)) == list(map(meaning, reference.feed(chunk, now)))
        assert (decoder.dropped, decoder.bad_crc) == (reference.dropped, reference.bad_crc)
        assert decoder._pending._bytes == bytes(byte for byte, _ in reference.held)
        assert decoder._pending._arrived == [at for _, at in reference.held]
        assert len(decoder._pending) < MAX_FRAME_BYTES
    assert decoder.good == len(reference.frames)


def raw_of(frame):
    return frame.sequence, frame.status, [(c.id, c.zone + 128 * c.marked, c.d, c.delta) for c in frame.channels]


def meaning(raw):
    def int16(at):
        return int.from_bytes(raw[at : at + 2], "little", signed=True)

    slots = range(7, len(raw) - 2, 6)
    return (
        raw[4],
        raw[5],
        [(None if raw[k] == 255 else raw[k], raw[k + 1], int16(k + 2), int16(k + 4)) for k in slots],
    )


@given(st.lists(st.tuples(PIECES, FRAMES), min_size=1, max_size=5), PIECES, st.lists(st.integers(1, 60), min_size=1))
def test_every_frame_among_garbage_is_delivered(pairs, last, sizes):
    """The promise: each frame that comes without a pause comes out, 100 ms after the last byte at the latest."""
    data, starts = b"", []
    for garbage, frame in pairs:
        data += garbage
        starts.append(len(data))
        data += encode(frame)
    data += last
    found = [k for k in range(len(data)) if verdict(data[k : k + MAX_FRAME_BYTES]) > 2]
    assume(found == starts)  # no other candidate has a right CRC: the one exception there is
    decoder = Decoder()
    frames = [frame for _, _, some in feed_cut(decoder, data, [(k, 0.0001) for k in sizes]) for frame in some]
    assert frames + decoder.feed(b"", 10.0) == [frame for _, frame in pairs]
    assert decoder.dropped == len(data) - sum(len(encode(frame)) for _, frame in pairs)


def test_a_second_of_waiting_is_not_seven():
    """A stray head each second hides no frame for longer than 100 ms."""
    decoder = Decoder()
    for second in range(7):
        assert decoder.feed(LONG_HEAD, second) == []
        assert decoder.feed(ONE, second + 0.05) == []
        assert len(decoder.feed(b"", second + 0.101)) == 1
    assert (decoder.good, decoder.dropped) == (7, 7 * len(LONG_HEAD))


def test_exactly_100_ms_is_too_long():
    decoder = Decoder()
    decoder.feed(ONE[:-1], 0.0)
    assert decoder.feed(ONE[-1:], 0.1) == []
    assert decoder.dropped == len(ONE)


@pytest.mark.parametrize("cast", [bytes, bytearray, memoryview])
def test_chunks_of_any_bytes_like_kind(cast):
    decoder = Decoder()
    assert decoder.feed(cast(ONE[:5]), 0.0) == []
    assert decoder.feed(cast(ONE[5:]), 0.0) == Decoder().feed(ONE, 0.0)


@given(FRAMES, st.integers(0), st.integers(0, 7))
def test_no_flipped_bit_goes_unseen(frame, at, bit):
    raw = bytearray(encode(frame))
    raw[at % len(raw)] ^= 1 << bit
    decoder = Decoder()
    assert frame not in decoder.feed(bytes(raw), 0.0) + decoder.feed(b"", 1.0)


@every(
    "sequences, lost",
    [
        *[([5], 0), ([5, 6, 7], 0), ([254, 255, 0, 1], 0), ([5, 5], 0), ([5, 8], 2), ([255, 1], 1), ([105, 104], 254)],
        *[([239, 0], 16), ([228, 0], 0), ([229, 15], 0), ([5, 4], 0), ([5, 16], 10), ([20, 16], 251)],
    ],
)
def test_lost(sequences, lost):
    decoder = Decoder()
    for sequence in sequences:
        decoder.feed(encode(Frame(sequence, 1, (Channel(),))), 0.0)
    assert (decoder.good, decoder.lost) == (len(sequences), lost)


def one(**fields):
    return Frame(1, 1, (Channel(), Channel(**fields)))


@every(
    "frame, message",
    [
        (Frame(-1, 1, (Channel(),)), "sequence is -1, expected an integer 0…255"),
        (Frame(256, 1, (Channel(),)), "sequence is 256, expected an integer 0…255"),
        (Frame(1, -1, (Channel(),)), "status is -1, expected an integer 0…255"),
        (Frame(1, 256, (Channel(),)), "status is 256, expected an integer 0…255"),
        (Frame(1, 1, ()), "n is 0, expected an integer 1…16"),
        (Frame(1, 1, (Channel(),) * 17), "n is 17, expected an integer 1…16"),
        (one(id=-1), "channels[1].id is -1, expected an integer 0…254"),
        (one(id=255), "channels[1].id is 255, expected an integer 0…254"),
        (one(zone=-1), "channels[1].zone is -1, expected an integer 0…2"),
        (one(zone=3), "channels[1].zone is 3, expected an integer 0…2"),
        (one(d=-32769), "channels[1].d is -32769, expected an integer -32768…32767"),
        (one(d=32768), "channels[1].d is 32768, expected an integer -32768…32767"),
        (one(delta=-32769), "channels[1].delta is -32769, expected an integer -32768…32767"),
        (one(delta=32768), "channels[1].delta is 32768, expected an integer -32768…32767"),
        (one(d=1.5), "channels[1].d is 1.5, expected an integer -32768…32767"),
        (one(d=float("nan")), "channels[1].d is nan, expected an integer -32768…32767"),
    ],
)
def test_what_does_not_fit_is_refused_by_name(frame, message):
    for refuse in (encode, encode_nmea, encode_text):
        with pytest.raises(ValueError) as caught:  # noqa: PT011 - the whole message is compared
            refuse(frame)
        assert str(caught.value) == message


@every("d, valid", [(-0x8000, False), (-1, False), (0, False), (1, True), (0x7FFF, True)])
def test_valid_by_distance_alone(d, valid):
    assert Channel(d=d, delta=-1).valid is Channel(1, 2, d, 90).valid is valid


class Counting:
    """Stands for the head search and for the CRC, and adds up the bytes that they look at."""

    def __init__(self, monkeypatch):
        self.looks = self.bytes = 0
        search = binary._CANDIDATE.search
        monkeypatch.setattr(binary, "_CANDIDATE", SimpleNamespace(search=lambda *a: self._search(search, *a)))
        monkeypatch.setattr(binary, "crc16", SimpleNamespace(mcrf4xx=self._crc))

    def _search(self, search, data, at):
        found = search(data, at)
        self.looks += 1
        self.bytes += (found.end() if found else len(data)) - at
        return found

    def _crc(self, data):
        self.bytes += len(data)
        return crc16.mcrf4xx(data)


@every("size", [1, 7, 4096, 1 << 20])
@every(
    "pattern",
    [b"\xa4", b"\xa4\x57\x01", LONG_HEAD, bytes.fromhex("A4570109"), random.Random(457).randbytes(9973)],
)
def test_work_grows_with_the_bytes_and_no_faster(monkeypatch, pattern, size):
    def work(total):
        counting = Counting(monkeypatch)
        decoder = Decoder()
        data = (pattern * (total // len(pattern) + 1))[:total]
        for at in range(0, total, size):
            decoder.feed(data[at : at + size], at * 1e-5)
            assert len(decoder._pending) < MAX_FRAME_BYTES
            assert len(decoder._pending._arrived) == len(decoder._pending)
        assert decoder.good == 0
        assert decoder.dropped == total - len(decoder._pending)
        monkeypatch.undo()
        return counting

    small, large = work(10_000), work(40_000)
    assert large.looks <= 5 * small.looks  # four times the bytes; sixteen would be quadratic
    assert large.bytes <= 5 * small.bytes
    # each byte starts one candidate at most, and each call looks at the head of the one it holds
    assert large.bytes <= 40_000 * (1 + MAX_FRAME_BYTES) + 8 * large.looks
