"""The two forms that are lines of text: NMEA 0183 and plain."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_proto import Channel, Frame, NmeaDecoder, TextDecoder, encode_nmea, encode_text
from firmware_proto.binary import BINARY
from firmware_proto.nmea import NMEA
from firmware_proto.text import TEXT
from tests.every import every
from tests.firmware_proto.wire_reference import FRAMES

FORMATS = {"binary": BINARY, "nmea": NMEA, "text": TEXT}

# The XOR by hand. PARVA is 50 41 52 56 41: 50 ^ 41 = 11, ^ 52 = 43, ^ 56 = 15, ^ 41 = 54. Of ",1,1,1,1,1,2,300,12"
# the commas (eight), ones (six), twos (two) and zeros (two) cancel in pairs, and 33 stays. 54 ^ 33 = 67.
ONE = Frame(1, 1, (Channel(1, 2, 300, 12),))
ONE_NMEA = b"$PARVA,1,1,1,1,1,2,300,12*67\r\n"
TWO = Frame(9, 1, (Channel(1, 1, 900, -4), Channel(None, 0, -1, -1)))
FIRST, SECOND = encode_nmea(TWO).splitlines(keepends=True)

NOISE = st.binary(max_size=60) | st.sampled_from([b"$", b"*", b"\r\n", b"$PARVA,1,1", b"$" * 100, b"1,", b"-", b"7"])


def feed(decoder, data, size=1, now=0.0):
    return [frame for at in range(0, len(data), size) for frame in decoder.feed(data[at : at + size], now)]


def test_nmea_checksum_by_hand():
    assert encode_nmea(ONE) == ONE_NMEA
    assert NmeaDecoder().feed(ONE_NMEA, 0.0) == [ONE]


@given(st.lists(FRAMES, max_size=4), st.integers(1, 200))
def test_nmea_round_trip_cut_anywhere(frames, size):
    decoder = NmeaDecoder()
    data = b"".join(map(encode_nmea, frames))
    assert feed(decoder, data, size) == frames
    assert (decoder.good, decoder.dropped, decoder.bad_crc) == (len(frames), 0, 0)
    assert all(len(line) <= 82 for line in data.splitlines(keepends=True))


@pytest.mark.parametrize("name", FORMATS)
@given(pieces=st.lists(NOISE | FRAMES.map(encode_nmea) | FRAMES.map(encode_text)), size=st.integers(1, 50))
def test_cutting_changes_nothing_and_nothing_raises(name, pieces, size):
    data = b"".join(pieces)
    whole, cut = FORMATS[name].decoder(), FORMATS[name].decoder()
    assert whole.feed(data, 0.0) == feed(cut, data, size)
    counters = ("good", "bad_crc", "dropped", "lost")
    assert [getattr(whole, c) for c in counters] == [getattr(cut, c) for c in counters]
    assert max(len(getattr(cut, "_part", b"")), len(getattr(cut, "_tail", b""))) <= 104


@given(st.lists(NOISE | FRAMES.map(encode_nmea)), st.integers(1, 50))
def test_nmea_counts_every_byte(pieces, size):
    data = b"".join(pieces)
    decoder = NmeaDecoder()
    delivered = sum(len(encode_nmea(f)) for f in feed(decoder, data, size) if f.channels[0].zone <= 2)
    assert delivered + decoder.dropped + len(decoder._part) + decoder._bytes == len(data)


@every(
    "data, frames, bad_crc",
    [
        (ONE_NMEA.replace(b"67", b"66"), [], 1),
        (ONE_NMEA.replace(b"300", b"301"), [], 1),
        (b"$PARVA,1,1" + ONE_NMEA, [ONE], 0),
        (b"x" * 500 + ONE_NMEA, [ONE], 0),
        (b"$" + b"x" * 500 + b"\r\n" + ONE_NMEA, [ONE], 0),
        (b"$" + b"x" * 500 + ONE_NMEA, [ONE], 0),
        (b"$GPGLL,5300.97914,N,00259.98174,E,125926,A*28\r\n" + ONE_NMEA, [ONE], 0),
        (b"$*00\r\n" + ONE_NMEA, [ONE], 0),
        (FIRST + SECOND, [TWO], 0),
        (FIRST, [], 0),
        (SECOND, [], 0),
        (SECOND + FIRST, [], 0),
        (FIRST + FIRST + SECOND, [TWO], 0),
        (FIRST + ONE_NMEA + SECOND, [ONE], 0),
        (FIRST + b"$GPGLL\r\n" + SECOND, [TWO], 0),
        (FIRST + encode_nmea(TWO._replace(sequence=10)), [TWO._replace(sequence=10)], 0),
        (FIRST + encode_nmea(TWO._replace(status=3)), [TWO._replace(status=3)], 0),
        (FIRST + encode_nmea(TWO._replace(status=3)).splitlines(keepends=True)[1], [], 0),
    ],
)
def test_nmea_streams(data, frames, bad_crc):
    for size in (1, 13, len(data)):
        decoder = NmeaDecoder()
        assert feed(decoder, data, size) == frames
        assert (decoder.good, decoder.bad_crc) == (len(frames), bad_crc)
        inside = sum(len(encode_nmea(frame)) for frame in frames)
        assert decoder.dropped + decoder._bytes == len(data) - inside


def sentence(body):
    checksum = 0
    for letter in body:
        checksum ^= letter
    return b"$%b*%02X\r\n" % (body, checksum)


@every(
    "body",
    [
        b"PARVA,256,1,1,1,1,2,300,12",
        b"PARVA,1,256,1,1,1,2,300,12",
        b"PARVA,1,1,0,0,1,2,300,12",
        b"PARVA,1,1,17,1,1,2,300,12",
        b"PARVA,1,1,1,2,1,2,300,12",
        b"PARVA,1,1,1,1,255,2,300,12",
        b"PARVA,1,1,1,1,1,256,300,12",
        b"PARVA,1,1,1,1,1,2,32768,12",
        b"PARVA,1,1,1,1,1,2,300,-32769",
        b"PARVA,1,1,1,1,1,2,,12",
        b"PARVA,1,1,1,1,1,2,300,12,",
        b"PARVA,1,1,1,1,1,2,300",
        b"PARVB,1,1,1,1,1,2,300,12",
        b"PARVA,1,1,1,1,1,2,+300,12",
    ],
)
def test_nmea_with_a_right_checksum_and_wrong_fields(body):
    decoder = NmeaDecoder()
    assert decoder.feed(sentence(body), 0.0) == []
    assert (decoder.bad_crc, decoder.dropped) == (0, len(sentence(body)))
    assert decoder.feed(sentence(b"PARVA,1,1,1,1,1,2,300,12"), 0.0) == [ONE]


@pytest.mark.parametrize(("pause", "frames"), [(0.099, [TWO]), (0.101, [])])
def test_nmea_sentences_of_a_frame_come_without_a_pause(pause, frames):
    decoder = NmeaDecoder()
    decoder.feed(FIRST, 1.0)
    assert decoder.feed(SECOND, 1.0 + pause) == frames
    assert decoder.feed(encode_nmea(TWO), 9.0) == [TWO]
    assert decoder.lost == 0


def test_a_pause_of_100_ms_is_one():
    nmea, text = NmeaDecoder(), TextDecoder()
    nmea.feed(FIRST, 0.0)
    assert nmea.feed(SECOND, 0.1) == []
    text.feed(b"12", 0.0)
    assert text.feed(b"34,5\r\n", 0.1) == []


def test_nmea_a_frame_that_is_given_up_costs_all_its_sentences():
    whole = encode_nmea(Frame(9, 1, (Channel(), Channel(), Channel())))
    first, second, third = whole.splitlines(keepends=True)
    decoder = NmeaDecoder()
    decoder.feed(first + second, 0.0)
    assert decoder.feed(third, 9.0) == []
    assert decoder.dropped == len(whole)


def test_nmea_every_wrong_checksum_is_counted():
    decoder = NmeaDecoder()
    for count in range(1, 4):
        decoder.feed(ONE_NMEA.replace(b"67", b"66"), 0.0)
        assert decoder.bad_crc == count


def test_nmea_line_end_and_checksum_in_either_case():
    marked = sentence(b"PARVA,1,1,1,1,,128,-1,-1")
    assert marked.endswith(b"*6F\r\n")
    for line in (marked, marked.replace(b"\r", b""), marked.replace(b"6F", b"6f")):
        decoder = NmeaDecoder()
        assert decoder.feed(line, 0.0) == [Frame(1, 1, (Channel(marked=True),))]
        assert decoder.dropped == 0


def test_nmea_lost():
    decoder = NmeaDecoder()
    for sequence in (254, 255, 0, 3):
        decoder.feed(encode_nmea(ONE._replace(sequence=sequence)), 0.0)
    assert (decoder.good, decoder.lost) == (4, 2)


@pytest.mark.parametrize(
    ("channels", "line"),
    [
        ([Channel(1, 0, 900, 5), Channel(2, 0, 30, -6), Channel()], b"30,-6\r\n"),
        ([Channel(d=0, delta=0), Channel(2, 0, 30, -6)], b"30,-6\r\n"),
        ([Channel(1, 0, 30, 5), Channel(2, 0, 30, -6)], b"30,5\r\n"),
        ([Channel(), Channel(2, 0, 30, -6)], b"30,-6\r\n"),
        ([Channel(), Channel()], b"-1,-1\r\n"),
        ([Channel(d=-2, delta=7)], b"-2,7\r\n"),
    ],
)
def test_text_is_the_nearest(channels, line):
    assert encode_text(Frame(1, 1, tuple(channels))) == line


@given(st.lists(FRAMES, max_size=5), st.integers(1, 40))
def test_text_round_trip_cut_anywhere(frames, size):
    decoder = TextDecoder()
    data = b"".join(map(encode_text, frames))
    heard = feed(decoder, data, size)
    assert b"".join(map(encode_text, heard)) == data
    assert [frame.sequence for frame in heard] == list(range(len(frames)))
    assert decoder.dropped == 0


def test_text_frames_are_numbered_as_they_come_and_begin_anew_after_255():
    frames = feed(TextDecoder(), b"12,5\r\n" * 600, 100)
    assert [frame.sequence for frame in frames] == [n % 256 for n in range(600)]


def test_text_says_nothing_of_id_zone_and_status():
    assert TextDecoder().feed(b"1250,-35\r\n", 0.0) == [Frame(0, 0, (Channel(None, 0, 1250, -35),))]


@pytest.mark.parametrize(
    "line",
    [
        b"",
        b"1",
        b"1,",
        b",1",
        b"1,2,3",
        b" 1,2",
        b"1.0,2",
        b"32768,0",
        b"0,-32769",
        b"123456,1",
        b"x" * 99 + b"1,2",
        b"0" * 40 + b"12,5",
    ],
)
def test_text_that_is_not_a_line_is_dropped(line):
    for size in (1, 200):
        decoder = TextDecoder()
        assert feed(decoder, line + b"\r\n12,5\r\n", size) == [Frame(0, 0, (Channel(d=12, delta=5),))]
        assert decoder.dropped == len(line) + 2


def test_text_torn_lines_make_no_distance():
    decoder = TextDecoder()
    assert decoder.feed(b"12", 0.0) == []
    assert decoder.feed(b"34,5\r\n", 1.0) == []  # not 1234 and not 34
    assert [f.channels[0].d for f in decoder.feed(b"56,7\r\n", 2.0)] == [56]
    assert decoder.feed(b"78", 3.0) == []
    assert [f.channels[0].d for f in decoder.feed(b",9\r\n", 3.099)] == [78]
    assert decoder.dropped == len(b"1234,5\r\n")


def test_text_a_torn_line_costs_none_behind_it():
    decoder = TextDecoder()
    assert decoder.feed(b"12", 0.0) == []
    assert [f.channels[0].d for f in decoder.feed(b"3,4\r\n56,7\r\n8", 1.0)] == [56]
    assert [f.channels[0].d for f in decoder.feed(b"9,1\r\n", 1.05)] == [89]


@pytest.mark.parametrize("name", ["nmea", "text"])
def test_a_line_without_end_is_not_kept(name):
    decoder = FORMATS[name].decoder()
    for _ in range(500):
        decoder.feed(b"$" if decoder.dropped == 0 and not decoder._part else b"7", 0.0)
        assert len(decoder._part) <= 82
    assert decoder.dropped + len(decoder._part) == 500


def test_each_form_reads_back_what_it_wrote():
    for form in FORMATS.values():
        (frame,) = form.decoder().feed(form.encode(ONE), 0.0)
        assert (frame.channels[0].d, frame.channels[0].delta) == (300, 12)
