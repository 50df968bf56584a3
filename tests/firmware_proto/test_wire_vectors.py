"""vectors.json against the Python codec; tools/make_vectors.py makes the file without it."""

import json
import subprocess
import sys
from pathlib import Path

import pytest
from fastcrc import crc16

import firmware_proto
from firmware_proto import Channel, Decoder, Frame, NmeaDecoder, TextDecoder, encode, encode_nmea, encode_text

VECTORS = json.loads((Path(firmware_proto.__file__).parent / "vectors.json").read_text(encoding="utf-8"))
MAKE = Path(__file__).parents[2] / "tools" / "make_vectors.py"


def by_name(values):
    return [pytest.param(value, id=value["name"]) for value in values]


def as_frame(value):
    return Frame(value["sequence"], value["status"], tuple(Channel(**c) for c in value["channels"]))


FRAMES = {value["name"]: as_frame(value) for value in VECTORS["frames"]}


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
    for step in value["steps"]:
        data = bytes.fromhex(step["hex"])
        chunks = [data[k : k + 1] for k in range(len(data))] if one_byte_a_call and data else [data]
        frames = [frame for chunk in chunks for frame in decoder.feed(chunk, step["t"])]
        assert frames == [FRAMES[name] for name in step["frames"]]
    assert {name: getattr(decoder, name) for name in value["counters"]} == value["counters"]
