"""The formats `vector` and `rssi`: what was measured comes with its frame, and decoders of frames do not mind it."""

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_proto import Channel, Decoder, Frame, LevelChannel, Measured, VectorChannel, encode
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
from tests.firmware_proto.wire_reference import FRAMES

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
    frames = data.draw(st.lists(measured(format), min_size=1, max_size=4))
    raw = b"".join(map(FORMATS[format][0].encode, frames))
    decoder = FORMATS[format][0].decoder()
    came = [frame for at in range(0, len(raw), size) for frame in decoder.feed(raw[at : at + size], 0.0)]
    assert came == frames
    assert (decoder.good, decoder.dropped, decoder.bad_crc) == (len(frames), 0, 0)


@pytest.mark.parametrize("format", FORMATS)
@given(data=st.data())
def test_a_decoder_of_version_1_has_the_frames_and_no_complaint(format, data):
    frames = data.draw(st.lists(measured(format), min_size=1, max_size=3))
    decoder = Decoder()
    for frame in frames:
        raw = FORMATS[format][0].encode(frame)
        assert decoder.feed(raw, 0.0) == [frame._replace(measured=None)]
    assert (decoder.bad_crc, decoder.good) == (0, len(frames))


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


@pytest.mark.parametrize(
    ("wrong", "said"),
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
