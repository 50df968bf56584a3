"""The Lua decoder of the ArduPilot driver: vectors.json, and the same events as Python's on the same bytes."""

import json
import math
import os
from pathlib import Path
from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st
from lua_stubs import Autopilot, LuaDecoder
from wire_reference import FRAMES, Reference

import firmware_proto
from firmware_proto import Channel, Decoder, Frame, encode

VECTORS = json.loads((Path(firmware_proto.__file__).parent / "vectors.json").read_text(encoding="utf-8"))
STREAMS = int(os.environ.get("ARVA_HIL_LUA_STREAMS", "500"))
COUNTERS = ("good", "bad_crc", "dropped", "lost")
SECONDS = 1e-3 * (1 + 1e-9)  # a millisecond, so that 100 of them are not less than PAUSE_S by rounding
PAUSES_MS = (0, 0, 1, 3, 20, 40, 60, 99, 100, 101, 1000, 70_000)
PIECES = [bytes.fromhex(text) for text in ("A4", "A457", "A45701", "A4570163", "A4570163000010", "A4570109", "")]

autopilot = Autopilot()


def by_name(values):
    return [pytest.param(value, id=value["name"]) for value in values]


def vector_frame(value):
    return Frame(value["sequence"], value["status"], tuple(Channel(**c) for c in value["channels"]))


NAMED = {value["name"]: vector_frame(value) for value in VECTORS["frames"]}


@pytest.mark.parametrize("value", by_name(VECTORS["frames"]))
def test_frame(value):
    assert LuaDecoder(autopilot).feed(bytes.fromhex(value["hex"]), 0.0) == [NAMED[value["name"]]]


@pytest.mark.parametrize("work", [math.inf, 1], ids=["all at once", "little in a pass"])
@pytest.mark.parametrize("one_byte_a_call", [False, True])
@pytest.mark.parametrize("value", by_name(VECTORS["streams"]))
def test_stream(value, one_byte_a_call, work):
    decoder = LuaDecoder(autopilot)
    for step in value["steps"]:
        data = bytes.fromhex(step["hex"])
        chunks = [data[k : k + 1] for k in range(len(data))] if one_byte_a_call and data else [data]
        frames = [frame for chunk in chunks for frame in decoder.feed(chunk, step["t"], work)]
        assert frames == [NAMED[name] for name in step["frames"]]
    assert decoder.counters == value["counters"]


def frame(random):
    n = random.choice((1, 1, 1, 2, 4, random.randint(1, 16)))
    slots = [
        Channel(
            random.choice((None, 0xA4, 0x57, random.randint(0, 254))),
            random.randint(0, 2),
            random.choice((-1, 0x57A4, random.randint(-0x8000, 0x7FFF))),
            random.choice((-1, 0x0901, random.randint(-0x8000, 0x7FFF))),
            random.random() < 0.5,
        )
        for _ in range(n)
    ]
    return encode(Frame(random.getrandbits(8), random.getrandbits(8), tuple(slots)))


def piece(random, frames):
    """A frame, a part of one, the head of a false one, or noise."""
    raw = random.choice(frames)
    at = random.randrange(len(raw))
    return random.choice((raw, raw, raw, raw[:at], raw[at:], random.choice(PIECES), random.randbytes(at)))


def damage(random, data):
    for _ in range(random.choice((0, 0, 1, 2, 5))):
        at = random.randrange(len(data) + 1)
        kind = random.random()
        if kind < 0.3:
            data.insert(at, random.getrandbits(8))
        elif kind < 0.6:
            del data[at : at + 1]
        elif at < len(data):
            data[at] ^= 1 << random.getrandbits(3)


def calls(random, data):
    """(ms, chunk), cut anywhere; the last two are of silence."""
    at, now, longest, paused = 0, 0, random.choice((1, 5, 40, 150)), random.choice((0.0, 0.02, 0.1, 0.4))
    while at < len(data):
        now += random.choice(PAUSES_MS) if random.random() < paused else 0
        size = random.randint(0, longest) if longest > 1 else 1
        yield now, data[at : at + size]
        at += size
    yield now + random.choice(PAUSES_MS), b""
    yield now + 100_000, b""


def test_python_and_lua_make_the_same_of_the_same_bytes():
    """ARVA_HIL_LUA_STREAMS: how many streams. In every second one a pass may only do some work."""
    random, heard, refused = Random(457), 0, 0
    for k in range(STREAMS):
        if k % 50 == 0:
            frames = [frame(random) for _ in range(20)]
        data = bytearray(b"".join(piece(random, frames) for _ in range(random.randint(1, 6))))
        damage(random, data)
        python, lua = Decoder(), LuaDecoder(autopilot)
        past = []
        for now_ms, chunk in calls(random, bytes(data)):
            past.append((now_ms, chunk.hex()))
            work = random.randint(1, 300) if k % 2 else math.inf
            assert lua.feed_ms(chunk, now_ms, work) == python.feed(chunk, now_ms * SECONDS), (k, past)
        assert lua.counters == {name: getattr(python, name) for name in COUNTERS}, (k, past)
        heard += python.good
        refused += python.dropped
    assert heard > STREAMS / 2
    assert refused > 10 * STREAMS


@given(st.lists(FRAMES, min_size=1, max_size=4), st.integers(1, 60))
def test_frames_cut_anywhere(frames, size):
    decoder = LuaDecoder(autopilot)
    data = b"".join(map(encode, frames))
    heard = [frame for at in range(0, len(data), size) for frame in decoder.feed(data[at : at + size], 0.0)]
    assert heard == frames
    assert (decoder.counters["dropped"], decoder.counters["bad_crc"]) == (0, 0)


@given(st.lists(st.sampled_from(PIECES) | st.binary(max_size=20) | FRAMES.map(encode), max_size=6), st.data())
def test_any_stream_is_decoded_as_the_rules_read(pieces, data):
    decoder, reference, now = LuaDecoder(autopilot), Reference(), 0
    raw = b"".join(pieces)
    while raw:
        size, pause = data.draw(st.tuples(st.integers(1, 40), st.sampled_from([0, 3, 70, 200])))
        now += pause
        heard = decoder.feed_ms(raw[:size], now)
        assert [frame.sequence for frame in heard] == [whole[4] for whole in reference.feed(raw[:size], now * SECONDS)]
        raw = raw[size:]
    assert (decoder.counters["dropped"], decoder.counters["bad_crc"]) == (reference.dropped, reference.bad_crc)


def test_the_time_of_a_frame_is_that_of_its_last_byte_not_of_its_delivery():
    decoder, one = LuaDecoder(autopilot), encode(Frame(1, 1, (Channel(1, 2, 300, 12),)))
    assert decoder.feed_timed(bytes.fromhex("A4570163000010"), 1000) == []
    assert decoder.feed_timed(one[:5], 1020) == []
    assert decoder.feed_timed(one[5:], 1030) == []
    assert [time for time, _ in decoder.feed_timed(b"", 1200)] == [1030]
