"""vectors.json against the Python codec; tools/vectors/make.py makes the file without it."""

import pytest
from fastcrc import crc16

from firmware_proto import (
    Channel,
    Decoder,
    Frame,
    NmeaDecoder,
    TextDecoder,
    encode,
    encode_nmea,
    encode_text,
)
from firmware_proto.command_lines import LINE_HOST
from firmware_proto.commands import encode_answer, encode_command
from firmware_proto.measured import encode_rssi, encode_vector
from tests.every import every
from tests.firmware_proto.wire_vectors import FRAMES, MESSAGES, VECTORS, as_frame, by_name, follow, follow_messages
from tools.vectors import make
from tools.vectors.c_codec import python_decoder


def test_the_file_is_the_one_that_the_tool_makes():
    assert make.FILE.read_text(encoding="utf-8") == make.vectors(), "run python -m tools vectors"


def test_crc():
    assert VECTORS["crc"][0] == {"hex": b"123456789".hex(), "crc": 0x6F91}
    for check in VECTORS["crc"]:
        assert crc16.mcrf4xx(bytes.fromhex(check["hex"])) == check["crc"]


def test_every_n_is_there():
    assert {len(frame.channels) for frame in FRAMES.values()} == set(range(1, 17))


@every("value", by_name(VECTORS["frames"]))
def test_frame(value):
    frame = as_frame(value)
    raw = bytes.fromhex(value["hex"])
    assert Decoder().feed(raw, 0.0) == [frame]
    if value["decode_only"]:
        with pytest.raises(ValueError, match="zone"):
            encode(frame)
        return
    assert encode(frame) == raw
    assert encode_nmea(frame).decode() == value["nmea"]
    assert encode_text(frame).decode() == value["text"]
    assert NmeaDecoder().feed(value["nmea"].encode(), 0.0) == [frame]
    (heard,) = TextDecoder().feed(value["text"].encode(), 0.0)
    assert (heard.channels[0].d, heard.channels[0].delta) in {(c.d, c.delta) for c in frame.channels}


@every("one_byte_a_call", [False, True])
@every("value", by_name(VECTORS["streams"]))
def test_stream(value, one_byte_a_call):
    decoder = Decoder()
    follow(decoder.feed, value, one_byte_a_call)
    assert {name: getattr(decoder, name) for name in value["counters"]} == value["counters"]


@every("value", by_name(VECTORS["messages"]))
def test_message(value):
    message, raw = MESSAGES[value["name"]], bytes.fromhex(value["hex"])
    assert python_decoder().feed(raw, 0.0) == [message]
    if value["type"] == "command":
        assert encode_command(message) == raw
        assert LINE_HOST.commands().feed(value["line"].encode(), 0.0) == [message]
        assert LINE_HOST.command(message).decode() == value["line"]
    elif value["type"] == "answer":
        assert encode_answer(message) == raw
        assert "line" not in value or LINE_HOST.answer(message).decode() == value["line"]
    else:
        n = len(message.measured.channels)
        frame = Frame(message.sequence, message.status, (Channel(),) * n, message.measured)
        write = encode_vector if value["type"] == "vector" else encode_rssi
        if value["name"] == "vector_low":  # −32768 · 2^16 is beyond what an encoder takes
            return
        assert python_decoder().feed(write(frame), 0.0) == [message]
        if value["name"] not in ("vector_1", "vector_zone_127") and not value["name"].endswith("_channels"):
            assert write(frame) == raw + encode(frame)  # the others have not the lowest exponent


@every("one_byte_a_call", [False, True])
@every("value", by_name(VECTORS["message_streams"]))
def test_message_stream(value, one_byte_a_call):
    decoder = python_decoder()
    follow_messages(decoder.feed, value, one_byte_a_call)
    assert {name: getattr(decoder, name) for name in value["counters"]} == value["counters"]
