"""Frames as messages on the autopilot's own link, against vectors.json, and what comes of others' messages."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import pytest

import firmware_proto
from arva_hil.autopilot.following.session import Session
from arva_hil.emulator.formats import MavlinkDecoder, named_values
from arva_hil.emulator.ports import encoder
from arva_hil.mavlink.codec import Encoder, Parser, decode, dialect
from arva_hil.simulated.vehicle import SimulatedVehicle
from firmware_proto import Channel, Frame
from tests.every import every

VECTORS = json.loads((Path(firmware_proto.__file__).parent / "vectors.json").read_text(encoding="utf-8"))
FRAMES = [pytest.param(value, id=value["name"]) for value in VECTORS["frames"] if not value["decode_only"]]
HOME = (46.0123, 7.7456, 1650.0)
MESSAGES = {"named": "NAMED_VALUE_INT", "named_float": "NAMED_VALUE_FLOAT"}


def as_frame(value: Any) -> Frame:
    return Frame(value["sequence"], value["status"], tuple(Channel(**c) for c in value["channels"]))


def packed(*messages: Any) -> bytes:
    return b"".join(map(Encoder(1, 191).pack, messages))


def floats(*values: tuple[str, float]) -> bytes:
    return packed(*(dialect.MAVLink_named_value_float_message(5, name.encode(), value) for name, value in values))


@every("value", FRAMES)
def test_the_named_values_are_those_of_the_vectors(value: Any) -> None:
    assert [[name.decode(), number] for name, number in named_values(as_frame(value))] == value["named"]


@pytest.mark.parametrize("format", MESSAGES)
@every("value", FRAMES)
def test_a_frame_goes_out_as_these_messages_and_is_read_back(format: str, value: Any) -> None:
    session, vehicle = Session(), SimulatedVehicle(HOME)
    session.feed(vehicle.poll(0.0), 0.0)
    frame = as_frame(value)
    raw = encoder(format, session)(frame, 5)
    parser = Parser()
    messages = [decode(packet) for packet in parser.feed(raw)]
    assert {message.get_type() for message in messages} == {MESSAGES[format]}
    assert [[message.name, message.value] for message in messages] == value["named"]
    decoder = MavlinkDecoder(format)
    assert decoder.feed(raw, 0.0) == []
    (read,) = decoder.feed(raw, 1.0)  # it ends where the next begins
    heard = [c for k, c in enumerate(frame.channels) if k == 0 or c.valid]
    assert [(c.id, c.d, c.delta) for c in read.channels] == [(c.id, c.d, c.delta) for c in heard]


def test_what_the_lua_driver_sends_is_read_too() -> None:
    driver = floats(("ARVA1_D", 1234), ("ARVA1_DIR", -17), ("ARVA1_ID", 3), ("ARVA1_ZONE", 1))
    (frame,) = MavlinkDecoder("named_float").feed(driver + driver, 0.0)
    assert frame.channels == (Channel(3, 1, 1234, -17),)


@every("name", ["ARVA1_D", "ARVA1_DIR", "ARVA1_ID"])
@every("value", [math.nan, math.inf, -math.inf, 0.5, 1e30, -32769.0, 32768.0])
def test_a_float_that_no_receiver_can_have_sent_makes_no_such_reading(name: str, value: float) -> None:
    decoder = MavlinkDecoder("named_float")
    frames = decoder.feed(2 * floats(("ARVA1_D", 700), (name, value), ("ARVA1_ID", 3)), 0.0)
    frames += decoder.feed(floats(("ARVA1_D", 700)), 0.0)
    assert value not in [number for frame in frames for c in frame.channels for number in (c.d, c.delta, c.id)]
    assert decoder.good == len(frames)


@every(
    "d, delta, zone",
    [
        *[(0, 0, firmware_proto.OUTER), (1, 0, firmware_proto.INNER)],
        *[(300, 0, firmware_proto.INNER), (301, 0, firmware_proto.MID)],
        *[(300, 1, firmware_proto.MID), (300, -1, firmware_proto.MID), (301, 1, firmware_proto.MID)],
    ],
)
def test_the_zone_is_inner_up_to_3_m_with_direction_0_and_mid_otherwise(d: int, delta: int, zone: int) -> None:
    values = floats(("ARVA1_D", d), ("ARVA1_DIR", delta), ("ARVA1_ID", 3))
    (frame,) = MavlinkDecoder("named_float").feed(values + values, 0.0)
    assert frame.channels == (Channel(3, zone, d, delta),)


def test_integers_are_not_floats_and_names_of_others_are_nobodys() -> None:
    names = 3 * [b"ARVA1_D", b"ARVA1_DIR"]
    ints = packed(*(dialect.MAVLink_named_value_int_message(5, name, 700) for name in names))
    assert MavlinkDecoder("named_float").feed(ints, 0.0) == []
    assert len(MavlinkDecoder("named").feed(ints, 0.0)) == 2
    assert MavlinkDecoder("named_float").feed(floats(*[("BARVA1_D", 700.0)] * 3), 0.0) == []


def test_the_last_frame_of_named_values_comes_when_it_is_followed_by_silence() -> None:
    decoder = MavlinkDecoder("named_float")
    assert decoder.feed(floats(("ARVA1_D", 1234), ("ARVA1_DIR", -17), ("ARVA1_ID", 3)), 5.0) == []
    assert decoder.feed(b"", 5.9) == []  # a slow link may still bring more of it
    (frame,) = decoder.feed(b"", 6.1)
    assert frame.channels == (Channel(3, 1, 1234, -17),)
    assert decoder.feed(b"", 99.0) == []


def test_values_of_a_frame_whose_beginning_was_not_heard_are_no_frame() -> None:
    decoder = MavlinkDecoder("named_float")
    rest = floats(("ARVA1_DIR", -17), ("ARVA1_ID", 3), ("ARVA2_D", 700), ("ARVA2_DIR", 5))
    assert decoder.feed(rest + floats(("ARVA1_D", 900)), 0.0) == []


NAMES = ("ARVA1_D", "ARVA1_DIR", "ARVA1_ID")
READINGS = [(1900, 40, 1), (700, -60, 2), (600, -50, 3)]


@every("apart_s", [0.0, 0.2, 5.0])
@every("lost", range(9))
def test_a_lost_message_of_named_values_loses_at_most_its_frame_and_mixes_no_two(lost: int, apart_s: float) -> None:
    decoder, frames = MavlinkDecoder("named_float"), list[Frame]()
    for number, reading in enumerate(READINGS):
        sent = [value for k, value in enumerate(zip(NAMES, reading, strict=True)) if 3 * number + k != lost]
        frames += decoder.feed(floats(*sent), number * apart_s)
    frames += decoder.feed(b"", 99.0)
    read = [(c.d, c.delta, c.id) for frame in frames for c in frame.channels]
    d, delta, _ = READINGS[lost // 3]
    hit = [(d, delta, None)] if lost % 3 == 2 else []  # without its id a reading is still right
    assert read == READINGS[: lost // 3] + hit + READINGS[lost // 3 + 1 :]
