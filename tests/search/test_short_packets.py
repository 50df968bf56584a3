"""Packets of the vehicle's ids that are too short for their message."""

from __future__ import annotations

import struct

from fastcrc import crc16

from arva_hil.mavlink.codec import dialect
from arva_hil.mavlink.dialect import CRC_EXTRA
from tests.search.test_pilot import World, px4


def short(msgid: int) -> bytes:
    """A whole MAVLink 1 packet of system 1 with one byte of payload, and the right checksum."""
    covered = bytes([1, 0, 1, 1, msgid, 7])
    return b"\xfe" + covered + struct.pack("<H", crc16.mcrf4xx(covered + CRC_EXTRA[msgid]))


def test_they_end_no_search_before_it_arms() -> None:
    vehicle = px4(healthy=False)
    world = World(vehicle)
    world.reach("arming")
    every = (
        dialect.MAVLINK_MSG_ID_PARAM_VALUE,
        dialect.MAVLINK_MSG_ID_HEARTBEAT,
        dialect.MAVLINK_MSG_ID_COMMAND_ACK,
        dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT,
    )
    world.between = lambda data: data + b"".join(map(short, every))
    world.pass_s(3)
    assert world.client.outcome is None
    world.between = bytes
    vehicle.healthy = True
    assert world.end() == ("found", "found")
