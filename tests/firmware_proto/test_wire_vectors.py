"""vectors.json against the Python codec; tools/make_vectors.py makes the file without it."""

import subprocess
import sys
from pathlib import Path

import pytest
from fastcrc import crc16
from wire_vectors import FRAMES, VECTORS, as_frame, by_name, follow

from firmware_proto import Decoder, NmeaDecoder, TextDecoder, encode, encode_nmea, encode_text

MAKE = Path(__file__).parents[2] / "tools" / "make_vectors.py"


def test_the_file_is_the_one_that_the_tool_makes():
    subprocess.run([sys.executable, MAKE, "--check"], check=True)


def test_crc():
    assert VECTORS["crc"][0] == {"hex": b"123456789".hex(), "crc": 0x6F91}
    for check in VECTORS["crc"]:
        assert crc16.mcrf4xx(bytes.fromhex(check["hex"])) == check["crc"]


def test_every_n_is_there():
    assert {len(frame.channels) for frame in FRAMES.values()} == set(range(1, 17))


@pytest.mark.parametrize("value", by_name(VECTORS["frames"]))
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


@pytest.mark.parametrize("one_byte_a_call", [False, True])
@pytest.mark.parametrize("value", by_name(VECTORS["streams"]))
def test_stream(value, one_byte_a_call):
    decoder = Decoder()
    follow(decoder.feed, value, one_byte_a_call)
    assert {name: getattr(decoder, name) for name in value["counters"]} == value["counters"]
