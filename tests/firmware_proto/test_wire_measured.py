"""What was measured comes with its frame; the display of `handheld`; commands and their answers."""

from __future__ import annotations

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from arva_hil.config import parse
from arva_hil.emulator.build import receiver, transmitters
from arva_hil.model.field import LocalFrame
from arva_hil.model.receiver import Look
from firmware_proto import (
    INNER,
    MID,
    Channel,
    Command,
    CommandAnswer,
    Decoder,
    Frame,
    LevelChannel,
    Measured,
    NmeaDecoder,
    TextDecoder,
    VectorChannel,
    encode,
    encode_nmea,
    encode_text,
)
from firmware_proto.command_lines import LINE_HOST
from firmware_proto.commands import BINARY_HOST, NAMES, RESULTS
from firmware_proto.handheld import HandheldDecoder, encode_handheld
from firmware_proto.measured import (
    RSSI,
    VECTOR,
    encode_rssi,
    encode_vector,
    exponent_of,
    level_channel,
    vector_channel,
)
from firmware_proto.messages import seal
from tests.every import every
from tests.firmware_proto.wire_reference import FRAMES, crc
from tests.made_records import HOME, pose_at

AMPLITUDE = st.tuples(st.integers(-0x7FFF, 0x7FFF), st.integers(0, 16)).map(lambda one: one[0] << one[1])
AMPLITUDES = st.tuples(AMPLITUDE, AMPLITUDE, AMPLITUDE).map(lambda three: exponent_of(*three)[1])
WHO = st.none() | st.integers(0, 254), st.integers(0, 2), st.booleans()
AGE = st.none() | st.integers(0, 65534)
CARRIER = st.none() | st.integers(-0x7FFF, 0x7FFF)
VECTORS = st.tuples(st.tuples(*WHO), AMPLITUDES, st.integers(0, 65535), CARRIER, AGE).map(
    lambda one: VectorChannel(*one[0], *one[1], *one[2:])
)
LEVELS = st.builds(LevelChannel, *WHO, st.none() | st.integers(-0x7FFF, 0x7FFF), AGE)
FORMATS = {"vector": (VECTOR, VECTORS, VectorChannel), "rssi": (RSSI, LEVELS, LevelChannel)}
ONE = Frame(1, 1, (Channel(1, 1, 1234, 17),))
PULSE = VectorChannel(1, 1, False, 77100, -12300, 400, 10130, -125, 240)


def measured(format):
    def with_channels(frame):
        n = len(frame.channels)
        channels = st.lists(FORMATS[format][1], min_size=n, max_size=n).map(tuple)
        return st.builds(Measured, st.integers(0, 2**32 - 1), channels).map(lambda m: frame._replace(measured=m))

    return FRAMES.flatmap(with_channels)


@pytest.mark.parametrize("format", FORMATS)
@given(data=st.data(), size=st.integers(1, 400))
def test_what_is_sent_comes_out_cut_anywhere(format, data, size):
    frames = data.draw(st.lists(measured(format), min_size=1, max_size=2))
    each = [FORMATS[format][0].encode(frame) for frame in frames]
    raw = b"".join(each)
    decoder = FORMATS[format][0].decoder()
    came = [frame for at in range(0, len(raw), size) for frame in decoder.feed(raw[at : at + size], 0.0)]
    assert came == frames
    assert (decoder.good, decoder.dropped, decoder.bad_crc) == (len(frames), 0, 0)
    first = Decoder()  # of version 1: it has the frames, and no complaint
    for frame, data in zip(frames, each, strict=True):
        assert first.feed(data, 0.0) == [frame._replace(measured=None)]
    assert (first.bad_crc, first.good) == (0, len(frames))


@pytest.mark.parametrize("format", FORMATS)
def test_a_frame_comes_alone_when_its_message_was_damaged_or_is_of_another_frame(format):
    form, _, channel = FORMATS[format]
    with_it = ONE._replace(measured=Measured(5, (channel(1),)))
    raw, decoder = form.encode(with_it), form.decoder()
    message, frame = raw[: -len(encode(ONE))], encode(ONE)
    assert decoder.feed(message[:-1] + bytes([message[-1] ^ 1]) + frame, 0.0) == [ONE]
    assert decoder.bad_crc == 1
    assert decoder.feed(message + encode(ONE._replace(sequence=2)), 1.0) == [ONE._replace(sequence=2)]
    assert decoder.feed(message + frame, 2.0) == [with_it]
    assert decoder.feed(frame, 3.0) == [ONE]  # the message is used up


def test_the_largest_message_is_255_bytes():
    sixteen = Frame(1, 1, (Channel(),) * 16)
    assert len(encode_vector(sixteen)) == 255 + 105
    assert len(encode_rssi(sixteen)) == 111 + 105


def test_a_frame_without_a_measurement_has_an_empty_message():
    assert VECTOR.decoder().feed(encode_vector(ONE), 0.0)[0].measured == Measured(0, (VectorChannel(1, 1),))
    assert RSSI.decoder().feed(encode_rssi(ONE), 0.0)[0].measured == Measured(0, (LevelChannel(1, 1),))


@given(st.lists(st.integers(-(0x7FFF << 16), 0x7FFF << 16), min_size=3, max_size=3))
def test_an_amplitude_is_exact_to_the_peak_s_15th_bit(amplitudes):
    exponent, arrived = exponent_of(*amplitudes)
    assert all(abs(a - b) <= 1 << exponent >> 1 for a, b in zip(amplitudes, arrived, strict=True))
    assert exponent == 0 or max(map(abs, amplitudes)) >= 0x7FFF << exponent >> 1
    assert exponent_of(*arrived) == (exponent, arrived) or exponent_of(*arrived)[1] == arrived


def test_a_pulse_in_units_of_physics():
    assert vector_channel(1, 1, False, (771.0, -123.0, 4.0), 1.013, -12.5, 0.24) == PULSE
    far = vector_channel(1, 1, False, (1e9, 0.0, -1e9), 9.0, 1e6, 1e6)
    assert (far.x, far.z, far.period, far.carrier, far.age_ms) == (0x7FFF << 16, -0x7FFF << 16, 65535, 0x7FFF, 65534)
    assert vector_channel(1, 1, False, (0.0, 0.0, 0.0), None, None, -0.1)[3:] == (0, 0, 0, 0, None, 0)
    assert level_channel(1, 1, False, -40.004, 0.1) == LevelChannel(1, 1, False, -4000, 100)
    assert level_channel(1, 1, False, -1e9, 0.1).level == -0x7FFF


@every(
    "wrong, said",
    [
        (Measured(0, ()), "measured has 0 channels, expected 1"),
        (Measured(2**32, (PULSE,)), "measured does not fit"),
        (Measured(0, (PULSE._replace(period=65536),)), "measured does not fit"),
        (Measured(0, (PULSE._replace(x=2**31),)), "an amplitude is 2147483648, expected 2147418112 at most"),
        (Measured(0, (LevelChannel(),)), "measured is of another format"),
    ],
)
def test_a_measurement_that_does_not_fit_is_refused(wrong, said):
    with pytest.raises(ValueError, match=said):
        encode_vector(ONE._replace(measured=wrong))


def test_an_exponent_that_there_is_not_is_no_message():
    good = ONE._replace(measured=Measured(0, (PULSE,)))
    raw = encode_vector(good)
    body = bytearray(struct.pack("<BBBI", 1, 1, 1, 0) + bytes(15))
    for exponent, comes in ((16, True), (17, False)):
        body[9] = exponent
        (frame,) = VECTOR.decoder().feed(seal(1, bytes(body)) + encode(ONE), 0.0)
        assert (frame.measured is not None) == comes
    assert VECTOR.decoder().feed(raw, 0.0) == [good]


# -- The display of a handheld: five lights, two digits ---------------------------------------------------


@every(
    "channel, line, back",
    [
        (Channel(1, MID, 1905, 22), "...*. 19", (MID, 1900, 36)),
        (Channel(1, MID, 1050, -89), "*.... 11", (MID, 1100, -72)),
        (Channel(1, MID, 994, 89), "....* 9.9", (MID, 990, 72)),
        (Channel(1, MID, 995, 0), "..*.. 10", (MID, 1000, 0)),
        (Channel(1, MID, 20000, 0), "..*.. 99", (MID, 9900, 0)),
        (Channel(1, INNER, 85, 0), "..... 0.9", (INNER, 90, 0)),
        (Channel(), "..... --", (0, -1, -1)),
    ],
)
def test_a_display_and_what_it_tells(channel: Channel, line: str, back: tuple[int, int, int]) -> None:
    data = encode_handheld(Frame(5, 1, (Channel(), channel)))
    assert data == f"{line}\r\n".encode()
    (frame,) = HandheldDecoder().feed(data, 0.0)
    (decoded,) = frame.channels
    assert (decoded.zone, decoded.d, decoded.delta) == back
    assert decoded.id is None


@every("line", ["**... 12", "*.... --", "..... 1", "..... 123", "......12", ".*... 1,2", "19,22"])
def test_other_lines_are_dropped(line: str) -> None:
    decoder = HandheldDecoder()
    assert decoder.feed(f"{line}\n".encode(), 0.0) == []
    assert decoder.dropped == len(line) + 1


def test_the_display_of_the_profile_is_late_and_in_classes() -> None:
    text = "spec: 2\ntransmitters: [{id: 1, ned: [20, 0, 0]}]\nreceiver: {profile: builtin:handheld, lag_s: %g}\n"
    shown = {}
    for lag_s in 0.0, 1.5:
        scenario = parse(text % lag_s, "s.yaml")
        model, there = receiver(scenario), transmitters(scenario, LocalFrame(*HOME))
        t, first = 0.0, 0.0
        while not first and t < 20:
            model.look(Look(t, pose_at(0.0), there))
            first = t if model.show(t).channels[0].zone else 0.0
            t = min(model.next_look(t, t + 0.1), t + 0.1)
        shown[lag_s] = first
        channel = model.show(t).channels[0]
        assert channel.d_cm % 100 == 0
        assert channel.delta_deg in (-72, -36, 0, 36, 72)
    assert shown[1.5] - shown[0.0] == pytest.approx(1.5, abs=0.2)


# Commands and answers: what is sent comes out, whatever else is on the line, and decoders of frames do not mind


INT32 = st.integers(-(2**31), 2**31 - 1)
BYTE = st.integers(0, 255)
NAME = st.sampled_from(NAMES) | st.integers(len(NAMES) + 1, 255).map(lambda code: f"command-{code}")
TEXT = st.text([chr(c) for c in range(32, 127) if chr(c) not in "$*,"], max_size=32)
COMMANDS = st.builds(Command, BYTE, NAME, st.lists(INT32, max_size=4).map(tuple))
ANSWERS = st.builds(CommandAnswer, BYTE, NAME, st.sampled_from(RESULTS), st.lists(INT32, max_size=4).map(tuple), TEXT)
SHORT = st.builds(CommandAnswer, BYTE, NAME, st.sampled_from(RESULTS), st.lists(BYTE, max_size=1).map(tuple), TEXT)
FORMS = {
    "binary": (BINARY_HOST, encode, Decoder),
    "nmea": (LINE_HOST, encode_nmea, NmeaDecoder),
    "text": (LINE_HOST, encode_text, TextDecoder),
}
HALF_HEADS = [bytes.fromhex(text) for text in ("A4", "A457", "A45702", "A457020800", "A45702350011")]
MARK = Command(7, "mark", (3,))


@pytest.mark.parametrize("form", FORMS)
@given(commands=st.lists(COMMANDS, min_size=1, max_size=3), answers=st.lists(SHORT, min_size=1, max_size=2),
       size=st.integers(1, 60))  # fmt: skip
def test_commands_come_out_cut_anywhere(form, commands, answers, size):
    host, _, _ = FORMS[form]
    for sent, write, decoder in (
        (commands, host.command, host.commands()),
        (answers, host.answer, host.answers()),
    ):
        data = b"".join(map(write, sent))
        came = [one for at in range(0, len(data), size) for one in decoder.feed(data[at : at + size], 0.0)]
        assert came == sent
        assert (decoder.good, decoder.dropped, decoder.bad_crc) == (len(sent), 0, 0)


@given(answer=ANSWERS)
def test_a_long_answer_fits_the_binary_form(answer):
    assert BINARY_HOST.answers().feed(BINARY_HOST.answer(answer), 0.0) == [answer]


def test_a_command_byte_by_byte():
    assert BINARY_HOST.command(MARK).hex(" ") == "a4 57 02 08 00 10 07 02 03 00 00 00 5e 21"
    assert BINARY_HOST.command(Command(0xA4, "scan")).hex(" ").startswith("a4 57 02 04 01 11 a5 06 ")
    assert LINE_HOST.command(MARK) == b"$PARVC,7,mark,3*6B\r\n"
    done = CommandAnswer(7, "identify", "done", (4,), "paper 1.0 nmea")
    assert LINE_HOST.answer(done) == b"$PARVR,7,identify,done,paper 1.0 nmea,4*32\r\n"


@given(kind=BYTE, body=st.binary(max_size=247))
def test_in_a_message_the_first_sync_byte_occurs_once(kind, body):
    """But for its CRC, whose bytes a head of version 1 cannot begin with: A4 begins what follows, not 57 or 01."""
    message = seal(kind, body)
    assert 0xA4 not in message[1:-2]
    assert message[-2:] == crc(message[2:-2]).to_bytes(2, "little")
    mask = message[4]
    assert bytes(byte ^ mask for byte in message[5:-2]) == bytes([kind]) + body


@given(pieces=st.lists(st.tuples(FRAMES, ANSWERS | st.binary(max_size=247), st.booleans()), min_size=1, max_size=3))
def test_a_decoder_of_version_1_delivers_every_frame_at_once_and_takes_messages_for_bytes_in_no_frame(pieces):
    decoder, sent, skipped = Decoder(), [], 0
    for frame, what, known in pieces:
        message = seal(1 if known else 200, what) if isinstance(what, bytes) else BINARY_HOST.answer(what)
        assert decoder.feed(message + encode(frame), 0.0) == [frame]
        sent.append(frame)
        skipped += len(message)
    assert (decoder.good, decoder.bad_crc, decoder.dropped) == (len(sent), 0, skipped)


@pytest.mark.parametrize("form", FORMS)
@given(frames=st.lists(FRAMES, min_size=2, max_size=2), answer=SHORT)
def test_an_answer_between_two_frames_changes_neither(form, frames, answer):
    host, write, decoder_of = FORMS[form]
    with_answers, without = decoder_of(), decoder_of()
    got = [f for one in frames for f in with_answers.feed(host.answer(answer) + write(one), 0.0)]
    assert got == [f for one in frames for f in without.feed(write(one), 0.0)]
    assert (with_answers.lost, with_answers.bad_crc) == (without.lost, 0)
    assert with_answers.dropped == len(frames) * len(host.answer(answer))


@every("form", FORMS)
def test_half_a_command_is_dropped_after_100_ms_and_counted(form):
    host, _, _ = FORMS[form]
    decoder, raw = host.commands(), host.command(MARK)
    for at in range(1, len(raw)):
        decoder.feed(raw[:at], at)
        assert decoder.feed(b"", at + 0.099) == []
        assert decoder.feed(b"", at + 0.101) == []
        assert decoder.feed(raw[at:], at + 0.2) == []
        assert decoder.feed(raw, at + 0.4) == [MARK]
    decoder.feed(b"", 1000)
    assert decoder.dropped == len(raw) * (len(raw) - 1)
    assert decoder.feed(raw[:5], 1001) == []
    assert decoder.feed(raw[5:], 1001.099) == [MARK]


@every("head", HALF_HEADS)
def test_a_command_behind_half_another_is_found(head):
    decoder = BINARY_HOST.commands()
    came = decoder.feed(head + BINARY_HOST.command(MARK), 0.0) + decoder.feed(b"", 0.11)
    assert came == [MARK]
    assert decoder.dropped == len(head)


def test_a_torn_sentence_costs_nothing_behind_it():
    decoder, raw = LINE_HOST.commands(), LINE_HOST.command(MARK)
    assert decoder.feed(raw[:9] + raw, 0.0) == [MARK]
    assert decoder.dropped == 9


@given(chunks=st.lists(st.tuples(st.binary(max_size=40) | COMMANDS.map(BINARY_HOST.command), st.floats(0, 0.2))))
def test_any_bytes_give_the_same_in_one_piece_and_byte_by_byte(chunks):
    now, whole, single = 0.0, BINARY_HOST.commands(), BINARY_HOST.commands()
    for data, pause in chunks:
        now += pause
        one_by_one = [data[k : k + 1] for k in range(len(data))] or [b""]
        assert whole.feed(data, now) == [command for byte in one_by_one for command in single.feed(byte, now)]
    assert (whole.good, whole.bad_crc, whole.dropped) == (single.good, single.bad_crc, single.dropped)


@every(
    "command, said",
    [
        (Command(256, "mark"), "number is 256, expected an integer 0…255"),
        (Command(0, "mrak"), "name is 'mrak', expected one of identify, mark,"),
        (Command(0, "command-1"), "name is 'command-1'"),
        (Command(0, "command-256"), "name is 'command-256'"),
        (Command(0, "command-008"), "name is 'command-008'"),
        (Command(0, "Mark me"), "name is 'Mark me', expected 1…16 lower-case"),
        (Command(0, "mark", (1, 2, 3, 4, 5)), "5 values, expected 4 at most"),
        (Command(0, "mark", (2**31,)), r"values\[0\] is 2147483648"),
        (Command(0, "mark", (1.5,)), r"values\[0\] is 1.5"),
    ],
)
def test_a_command_that_does_not_fit_is_refused_by_name(command, said):
    with pytest.raises(ValueError, match=said):
        BINARY_HOST.command(command)


@every(
    "answer, said",
    [
        (CommandAnswer(0, "mark", "perhaps"), "result is 'perhaps', expected one of done, refused, unknown, busy"),
        (CommandAnswer(0, "mark", "done", (), "a,b"), "text is 'a,b'"),
        (CommandAnswer(0, "mark", "done", (), "x" * 33), "expected 32 printable"),
    ],
)
def test_an_answer_that_does_not_fit_is_refused_by_name(answer, said):
    for host in (BINARY_HOST, LINE_HOST):
        with pytest.raises(ValueError, match=said):
            host.answer(answer)
    with pytest.raises(ValueError, match="a sentence of 86 bytes, expected 82 at most"):
        LINE_HOST.answer(CommandAnswer(255, "identify", "done", (-(2**31),) * 2, "x" * 32))


@every(
    "line",
    [
        b"$PARVC,7*5E\r\n",
        b"$PARVC,7,mark,3*00\r\n",
        b"$PARVC,256,mark*",
        b"$PARVC,7,Mark*",
        b"$PARVC,7,mark,*",
        b"$PARVC,7,mark,1,2,3,4,5*",
        b"$PARVC,7,mark,99999999999*",
        b"$PARVC,7,mark,2147483648*",
        b"$PARVC,7,mark,\xb2*",
        b"$PARVA,7,1,4,1,3,2,85,0*6B\r\n",
        b"hello\r\n",
    ],
)
def test_a_line_that_is_no_command_is_dropped_whole(line):
    if line.endswith(b"*"):
        checksum = 0
        for byte in line[1:-1]:
            checksum ^= byte
        line += b"%02X\r\n" % checksum
    decoder = LINE_HOST.commands()
    assert decoder.feed(line, 0.0) == []
    assert decoder.dropped == len(line)


@every(
    "body",
    [
        bytes([7, 1, 4, 0]),  # a result that there is not
        bytes([7, 1, 0, 5]) + bytes(20),  # five values
        bytes([7, 1, 0, 2]) + bytes(4),  # two values in the room of one
        bytes([7, 1, 0, 0]) + b"a,b",
        bytes([7, 1, 0, 0]) + b"\xff",
    ],
)
def test_an_answer_that_makes_no_sense_is_dropped_though_its_crc_is_right(body):
    decoder, raw = BINARY_HOST.answers(), seal(17, body)
    assert decoder.feed(raw + BINARY_HOST.answer(CommandAnswer(1, "scan", "done")), 0.0) == [
        CommandAnswer(1, "scan", "done")
    ]
    assert (decoder.dropped, decoder.bad_crc) == (len(raw), 0)
