"""The Lua decoder of the ArduPilot driver: vectors.json, and the same events as Python's on the same bytes."""

import math
import os
from random import Random

from firmware_proto import Channel, Decoder, Frame, encode
from tests.every import every
from tests.firmware_proto.lua_stubs import Autopilot, LuaDecoder, LuaMessageDecoder
from tests.firmware_proto.wire_vectors import FRAMES as VECTOR_FRAMES
from tests.firmware_proto.wire_vectors import MESSAGES, VECTORS, by_name, follow, follow_messages
from tools.fuzz.codecs import SECONDS, message_streams, streams
from tools.vectors.c_codec import python_decoder

STREAMS = int(os.environ.get("ARVA_HIL_LUA_STREAMS", "200"))
COUNTERS = ("good", "bad_crc", "dropped", "lost")

autopilot = Autopilot()


@every("value", by_name(VECTORS["messages"]))
def test_message(value):
    decoder, message = LuaMessageDecoder(autopilot), MESSAGES[value["name"]]
    assert decoder.feed(bytes.fromhex(value["hex"]), 0.0) == [message]
    if value["type"] == "command":
        assert decoder.encode(message).hex() == value["hex"]


@every("value", by_name(VECTORS["message_streams"]))
def test_message_stream(value):
    decoder = LuaMessageDecoder(autopilot)
    follow_messages(decoder.feed, value, one_byte_a_call=False)
    assert {name: getattr(decoder, name) for name in value["counters"]} == value["counters"]


def test_python_and_lua_make_the_same_of_the_same_messages():
    for calls in message_streams(457, STREAMS):
        python, lua = python_decoder(), LuaMessageDecoder(autopilot)
        for now_ms, chunk in calls:
            assert lua.feed_ms(chunk, now_ms) == python.feed(chunk, now_ms * SECONDS), calls
        assert (lua.good, lua.bad_crc, lua.dropped) == (python.good, python.bad_crc, python.dropped)


@every("value", by_name(VECTORS["frames"]))
def test_frame(value):
    assert LuaDecoder(autopilot).feed(bytes.fromhex(value["hex"]), 0.0) == [VECTOR_FRAMES[value["name"]]]


@every("work", [math.inf, 1])
@every("one_byte_a_call", [False, True])
@every("value", by_name(VECTORS["streams"]))
def test_stream(value, one_byte_a_call, work):
    decoder = LuaDecoder(autopilot)
    follow(lambda chunk, now: decoder.feed(chunk, now, work), value, one_byte_a_call)
    assert decoder.counters == value["counters"]


def test_python_and_lua_make_the_same_of_the_same_bytes():
    """ARVA_HIL_LUA_STREAMS: how many streams. In every second one a pass may only do some work."""
    random, heard, refused = Random(457), 0, 0
    for k, calls in enumerate(streams(457, STREAMS)):
        python, lua = Decoder(), LuaDecoder(autopilot)
        past = []
        for now_ms, chunk in calls:
            past.append((now_ms, chunk.hex()))
            work = random.randint(1, 300) if k % 2 else math.inf
            assert lua.feed_ms(chunk, now_ms, work) == python.feed(chunk, now_ms * SECONDS), (k, past)
        assert lua.counters == {name: getattr(python, name) for name in COUNTERS}, (k, past)
        heard += python.good
        refused += python.dropped
    assert heard > STREAMS / 2
    assert refused > 10 * STREAMS


def test_the_time_of_a_frame_is_that_of_its_last_byte_not_of_its_delivery():
    decoder, one = LuaDecoder(autopilot), encode(Frame(1, 1, (Channel(1, 2, 300, 12),)))
    assert decoder.feed_timed(bytes.fromhex("A4570163000010"), 1000) == []
    assert decoder.feed_timed(one[:5], 1020) == []
    assert decoder.feed_timed(one[5:], 1030) == []
    assert [time for time, _ in decoder.feed_timed(b"", 1200)] == [1030]
