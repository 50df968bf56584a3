"""PROTOCOL.md against the code; the lines of text and NMEA; the binary frames."""

from __future__ import annotations

import math
import random
import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from fastcrc import crc16
from hypothesis import assume, given
from hypothesis import strategies as st

import firmware_proto
from arva_hil.model.field import dipole_field
from arva_hil.model.receiver import outputs
from firmware_proto import (
    INNER,
    MAX_FRAME_BYTES,
    MID,
    Channel,
    Command,
    CommandAnswer,
    Decoder,
    Frame,
    Measured,
    NmeaDecoder,
    TextDecoder,
    VectorChannel,
    binary,
    encode,
    encode_nmea,
    encode_text,
)
from firmware_proto.binary import BINARY
from firmware_proto.command_lines import LINE_HOST
from firmware_proto.commands import NAMES, RESULTS, encode_answer, encode_command
from firmware_proto.measured import encode_rssi, encode_vector
from firmware_proto.nmea import NMEA
from firmware_proto.text import TEXT
from tests.every import every
from tests.firmware_proto.wire_reference import FRAMES, Reference, verdict

PAGE = (Path(firmware_proto.__file__).parent / "PROTOCOL.md").read_text(encoding="utf-8")
ONE = Frame(1, 1, (Channel(1, MID, 1234, 17),))
FOUR = Frame(7, 1, (Channel(3, INNER, 85, 0), Channel(1, MID, 1250, -35), Channel(2, MID, 4020, 17), Channel()))
PULSE = VectorChannel(1, MID, False, 77100, -12300, 400, 10130, -125, 240)
MEASURED = ONE._replace(measured=Measured(12345, (PULSE,)))


def section(title):
    return re.split(r"\n#+ ", PAGE.split(f"# {title}\n")[1])[0]


def block(kind):
    return re.search(rf"```{kind}\n(.*?)```", PAGE, re.DOTALL)[1].replace("\n", "\r\n").encode()


def test_the_crc_of_the_worked_bytes():
    assert Decoder().feed(encode(FOUR), 0.0) == [FOUR]
    assert f"CRC 0x{crc16.mcrf4xx(encode(FOUR)[2:-2]):04X}" in section("Four channels, byte by byte")


@pytest.mark.parametrize("data", [encode(ONE), encode_answer(CommandAnswer(7, "mark", "done"))])
def test_worked_bytes_in_a_line(data):
    assert f": `{data.hex(' ').upper()}`." in PAGE


@every(
    "title, data",
    [
        ("Four channels, byte by byte", encode(FOUR)),
        ("A command, byte by byte", encode_command(Command(7, "mark", (3,)))),
        ("A command with a mask, byte by byte", encode_command(Command(0xA4, "scan"))),
        ("A vector, byte by byte", encode_vector(MEASURED)[: -len(encode(MEASURED))]),
    ],
)
def test_worked_bytes(title, data):
    worked = b""
    for offset, column in re.findall(r"\| (\d+) \| ([0-9A-F ]+) \|", section(title)):
        assert int(offset) == len(worked)
        worked += bytes.fromhex(column)
    assert worked == data


def test_commands_and_results():
    rows = re.findall(r"\| (\d) \| ([a-z]+) \| [^|]*\| [^|]*\| [^|]*\|\n", section("Commands"))
    assert [name for _, name in rows] == list(NAMES)
    assert [int(code) for code, _ in rows] == list(range(1, len(NAMES) + 1))
    for code, result in enumerate(RESULTS):
        assert re.search(rf"\b{code} {result}\b", section("Commands"))


def test_commands_in_lines():
    assert block("commands") == (
        LINE_HOST.command(Command(7, "mark", (3,)))
        + LINE_HOST.answer(CommandAnswer(7, "mark", "done"))
        + LINE_HOST.command(Command(8, "identify"))
        + LINE_HOST.answer(CommandAnswer(8, "identify", "done", (4,), "paper 1.0 nmea"))
    )


def test_the_approach_is_what_the_paper_s_receiver_says_on_its_way():
    rows = re.findall(r"\| ([−\d.]+) " * 7 + r"\|", section("An approach"))
    assert len(rows) == 8
    north, east, heading = -25.0, 20.0, 0
    flat = np.eye(3)[None]  # the dipole points north
    for row in rows:
        said = [float(value.replace("−", "-")) for value in row]
        place = np.array([north, east, -1.5])
        field = dipole_field(place, np.zeros((1, 3)), flat, np.ones(1))
        d, delta, zone = (int(one[0]) for one in outputs(field @ turned(heading), 1.542))
        behind = outputs(field @ turned(heading + 180), 1.542)
        assert [int(one[0]) for one in behind] == [d, delta, zone]
        assert said == [
            round(north, 1),
            round(east, 1),
            heading,
            round(float(np.linalg.norm(place)), 1),
            d,
            delta,
            zone,
        ]
        heading += delta
        north += d / 300 * math.cos(math.radians(heading))
        east += d / 300 * math.sin(math.radians(heading))


def turned(degrees):
    """Receiver → NED, level, with a heading."""
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])


def test_crc():
    assert crc16.mcrf4xx(b"123456789") == 0x6F91
    assert '"123456789" → 0x6F91' in section("CRC")


def test_nmea_and_text():
    assert block("nmea") == encode_nmea(FOUR)
    assert block("text") == encode_text(FOUR)


def test_status_bits():
    rows = re.findall(r"\| (\d) \| (\d+) \| ([^|]+)", section("Status"))
    names = ("SYNTHETIC", "INTERFERENCE", "MORE_TRANSMITTERS", "SELF_TEST_FAULT", "OVERLAP", "NOT_SEARCHING")
    assert [int(value) for _, value, _ in rows] == [getattr(firmware_proto, name) for name in names]
    assert [1 << int(bit) for bit, _, _ in rows] == [int(value) for _, value, _ in rows]
    for name, (_, _, meaning) in zip(names, rows, strict=True):
        assert meaning.replace("-", " ").startswith(name.lower().replace("_", " "))


@every(
    "form, encode",
    [
        ("binary", encode),
        ("nmea", encode_nmea),
        ("text", encode_text),
        ("vector", encode_vector),
        ("rssi", encode_rssi),
    ],
)
def test_sizes_and_times(form, encode):
    longest = Channel(254, INNER, -0x8000, -0x8000, True)
    sizes = [len(encode(Frame(255, 255, (longest,) * n))) for n in (1, 4, 16)]
    row = " | ".join(map(str, sizes))
    assert f"| {form}, bytes | {row} |" in section("Timing")
    row = " | ".join(f"{size * 10 / 115.2:.1f}" for size in sizes)
    assert f"| {form}, ms | {row} |" in section("Timing")


def test_the_lowest_baud_rate():
    def milliseconds(n):
        return (len(encode(Frame(1, 1, (Channel(),) * n))) - 1) * 10 / 9.6

    assert milliseconds(14) < 100 < milliseconds(15)
    assert f"16 channels take {milliseconds(16):.0f} ms" in PAGE
    assert f"at most 14 channels fit ({milliseconds(14):.0f} ms)" in PAGE
    assert f"One fixed buffer of {MAX_FRAME_BYTES} bytes" in PAGE


def test_mavlink_fits():
    assert MAX_FRAME_BYTES <= 128  # TUNNEL's payload
    assert len("ARVA16_DIR") == 10  # a name of NAMED_VALUE_INT
    assert f"{0xA457} (0xA457;" in PAGE
    assert encode(ONE)[:2].hex() == "a457"


# -- The two forms that are lines of text: NMEA 0183 and plain --------------------------------------------


FORMATS = {"binary": BINARY, "nmea": NMEA, "text": TEXT}

# The XOR by hand. PARVA is 50 41 52 56 41: 50 ^ 41 = 11, ^ 52 = 43, ^ 56 = 15, ^ 41 = 54. Of ",1,1,1,1,1,2,300,12"
# the commas (eight), ones (six), twos (two) and zeros (two) cancel in pairs, and 33 stays. 54 ^ 33 = 67.
ONE_LINE = Frame(1, 1, (Channel(1, 2, 300, 12),))
ONE_NMEA = b"$PARVA,1,1,1,1,1,2,300,12*67\r\n"
TWO = Frame(9, 1, (Channel(1, 1, 900, -4), Channel(None, 0, -1, -1)))
FIRST, SECOND = encode_nmea(TWO).splitlines(keepends=True)

NOISE = st.binary(max_size=60) | st.sampled_from([b"$", b"*", b"\r\n", b"$PARVA,1,1", b"$" * 100, b"1,", b"-", b"7"])


def feed(decoder, data, size=1, now=0.0):
    return [frame for at in range(0, len(data), size) for frame in decoder.feed(data[at : at + size], now)]


def test_nmea_checksum_by_hand():
    assert encode_nmea(ONE_LINE) == ONE_NMEA
    assert NmeaDecoder().feed(ONE_NMEA, 0.0) == [ONE_LINE]


@given(st.lists(FRAMES, max_size=4), st.integers(1, 200))
def test_nmea_round_trip_cut_anywhere(frames, size):
    decoder = NmeaDecoder()
    data = b"".join(map(encode_nmea, frames))
    assert feed(decoder, data, size) == frames
    assert (decoder.good, decoder.dropped, decoder.bad_crc) == (len(frames), 0, 0)
    assert all(len(line) <= 82 for line in data.splitlines(keepends=True))


@pytest.mark.parametrize("name", FORMATS)
@given(pieces=st.lists(NOISE | FRAMES.map(encode_nmea) | FRAMES.map(encode_text), max_size=5), size=st.integers(1, 50))
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
        (ONE_NMEA.replace(b"67", b"66") * 3, [], 3),
        (ONE_NMEA.replace(b"300", b"301"), [], 1),
        (b"$PARVA,1,1" + ONE_NMEA, [ONE_LINE], 0),
        (b"x" * 500 + ONE_NMEA, [ONE_LINE], 0),
        (b"$" + b"x" * 500 + b"\r\n" + ONE_NMEA, [ONE_LINE], 0),
        (b"$" + b"x" * 500 + ONE_NMEA, [ONE_LINE], 0),
        (b"$GPGLL,5300.97914,N,00259.98174,E,125926,A*28\r\n" + ONE_NMEA, [ONE_LINE], 0),
        (b"$*00\r\n" + ONE_NMEA, [ONE_LINE], 0),
        (FIRST + SECOND, [TWO], 0),
        (FIRST, [], 0),
        (SECOND, [], 0),
        (SECOND + FIRST, [], 0),
        (FIRST + FIRST + SECOND, [TWO], 0),
        (FIRST + ONE_NMEA + SECOND, [ONE_LINE], 0),
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
    assert decoder.feed(sentence(b"PARVA,1,1,1,1,1,2,300,12"), 0.0) == [ONE_LINE]


@pytest.mark.parametrize(("pause", "frames"), [(0.099, [TWO]), (0.101, [])])
def test_nmea_sentences_of_a_frame_come_without_a_pause(pause, frames):
    decoder = NmeaDecoder()
    decoder.feed(FIRST, 1.0)
    assert decoder.feed(SECOND, 1.0 + pause) == frames
    assert decoder.feed(encode_nmea(TWO), 9.0) == [TWO]
    assert decoder.lost == 0


def test_nmea_a_frame_that_is_given_up_costs_all_its_sentences():
    whole = encode_nmea(Frame(9, 1, (Channel(), Channel(), Channel())))
    first, second, third = whole.splitlines(keepends=True)
    decoder = NmeaDecoder()
    decoder.feed(first + second, 0.0)
    assert decoder.feed(third, 9.0) == []
    assert decoder.dropped == len(whole)


def test_nmea_line_end_and_checksum_in_either_case():
    marked = sentence(b"PARVA,1,1,1,1,,128,-1,-1")
    assert marked.endswith(b"*6F\r\n")
    for line in (marked, marked.replace(b"\r", b""), marked.replace(b"6F", b"6f")):
        decoder = NmeaDecoder()
        assert decoder.feed(line, 0.0) == [Frame(1, 1, (Channel(marked=True),))]
        assert decoder.dropped == 0


@every(
    "channels, line",
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


@every(
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
        (frame,) = form.decoder().feed(form.encode(ONE_LINE), 0.0)
        assert (frame.channels[0].d, frame.channels[0].delta) == (300, 12)


# --  -----------------------------------------------------------------------------------------------------


ONE_FRAME = encode(Frame(1, 1, (Channel(1, 2, 300, 12),)))
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


@given(st.lists(st.tuples(PIECES, FRAMES), min_size=1, max_size=3), PIECES, st.lists(st.integers(1, 60), min_size=1))
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
        assert decoder.feed(ONE_FRAME, second + 0.05) == []
        assert len(decoder.feed(b"", second + 0.101)) == 1
    assert (decoder.good, decoder.dropped) == (7, 7 * len(LONG_HEAD))


@every(
    "name, first, second",
    [("nmea", FIRST, SECOND), ("text", b"12", b"34,5\r\n"), ("binary", ONE_FRAME[:-1], ONE_FRAME[-1:])],
)
def test_exactly_100_ms_is_too_long(name, first, second):
    decoder = FORMATS[name].decoder()
    decoder.feed(first, 0.0)
    assert decoder.feed(second, 0.1) == []
    assert decoder.dropped == len(first + second)


@every("cast", [bytes, bytearray, memoryview])
def test_chunks_of_any_bytes_like_kind(cast):
    decoder = Decoder()
    assert decoder.feed(cast(ONE_FRAME[:5]), 0.0) == []
    assert decoder.feed(cast(ONE_FRAME[5:]), 0.0) == Decoder().feed(ONE_FRAME, 0.0)


@given(FRAMES, st.integers(0), st.integers(0, 7))
def test_no_flipped_bit_goes_unseen(frame, at, bit):
    raw = bytearray(encode(frame))
    raw[at % len(raw)] ^= 1 << bit
    decoder = Decoder()
    assert frame not in decoder.feed(bytes(raw), 0.0) + decoder.feed(b"", 1.0)


@every(
    "sequences, lost",
    [
        *[
            ([5], 0),
            ([5, 6, 7], 0),
            ([254, 255, 0, 1], 0),
            ([254, 255, 0, 3], 2),
            ([5, 5], 0),
            ([5, 8], 2),
            ([255, 1], 1),
            ([105, 104], 254),
        ],
        *[
            ([239, 0], 16),
            ([228, 0], 0),
            ([229, 15], 0),
            ([5, 4], 0),
            ([5, 16], 10),
            ([20, 16], 251),
            ([254, 255, 0, 3], 2),
        ],
    ],
)
def test_lost(sequences, lost):
    for form in (BINARY, NMEA):
        decoder = form.decoder()
        for sequence in sequences:
            decoder.feed(form.encode(Frame(sequence, 1, (Channel(),))), 0.0)
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

    small, large = work(4_000), work(16_000)
    assert large.looks <= 5 * small.looks  # four times the bytes; sixteen would be quadratic
    assert large.bytes <= 5 * small.bytes
    # each byte starts one candidate at most, and each call looks at the head of the one it holds
    assert large.bytes <= 16_000 * (1 + MAX_FRAME_BYTES) + 8 * large.looks
