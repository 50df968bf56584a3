"""The virtual victim on ArduPilot: its readings are those of the emulator's receiver, reading for reading."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from arva_hil.model.field import Transmitters, rotation
from arva_hil.model.receiver import Antennas
from arva_hil.model.receiver.maps import readings
from firmware_proto import SYNTHETIC, Channel, Decoder, Frame, encode
from tests.firmware_proto.lua_stubs import Autopilot


@pytest.fixture(scope="module")
def script() -> Any:
    autopilot = Autopilot()
    return autopilot, autopilot.require("arva_victim")


def test_its_readings_are_those_of_python(script: Any) -> None:
    autopilot, lua = script
    random = np.random.default_rng(457)
    n, dipole = 1500, (0.7, -0.4)
    places = random.uniform(-1, 1, (n, 3)) * random.choice([2.0, 8.0, 60.0], (n, 1))
    angles = random.uniform((-0.5, -0.5, -3.2), (0.5, 0.5, 3.2), (n, 3))
    there = Transmitters((1,), [[0, 0, 0]], [rotation.to_matrix(rotation.from_euler(0, dipole[1], dipole[0]))], [1.0])
    turned = np.array([rotation.to_matrix(rotation.from_euler(*one)) for one in angles])
    python = readings(places, turned, there, Antennas(noise="off"))
    mine = [
        tuple(lua.reading(autopilot.table(place), *turn, *dipole))
        for place, turn in zip(places.tolist(), angles.tolist(), strict=True)
    ]
    expected = list(zip(*(one[:, 0].tolist() for one in (python.zone, python.d_cm, python.delta_deg)), strict=True))
    assert {zone for zone, _, _ in expected} == {0, 1, 2}
    assert mine == expected


def test_on_the_transmitter_it_is_near(script: Any) -> None:
    autopilot, lua = script
    assert tuple(lua.reading(autopilot.table([0.0, 0.0, 0.0]), 0, 0, 0, 0, 0)) == (2, 1, 0)


def test_its_frames_are_those_of_the_codec(script: Any) -> None:
    _, lua = script
    for sequence, (zone, d, delta) in enumerate([(1, 1905, -22), (2, 40, 0), (0, -1, -1), (1, 5000, 89)]):
        channel = Channel(1 if zone else None, zone, d, delta)
        assert lua.encode(sequence, zone, d, delta).encode("latin-1") == encode(Frame(sequence, SYNTHETIC, (channel,)))


def test_one_frame_a_second_goes_to_the_scripting_port() -> None:
    autopilot = Autopilot(ARVV_NORTH=10, ARVV_EAST=0).start("arva_victim")
    autopilot.run(autopilot.time_ms + 1500)
    autopilot.has_position = False
    autopilot.run(autopilot.time_ms + 1000)
    frames = Decoder().feed(bytes(byte for _, byte in autopilot.written), 0.0)
    assert [frame.sequence for frame in frames] == [0, 1, 2]
    assert [frame.channels[0].zone for frame in frames] == [1, 1, 0]
    assert frames[0].channels[0].d == pytest.approx(954, abs=2)  # 10.2 m away, near the axis
    assert all(frame.status & SYNTHETIC for frame in frames)
    assert autopilot.said() == ["ARVV: virtual victim: not a real receiver"]


def test_without_a_simulated_port_it_says_what_to_set() -> None:
    autopilot = Autopilot(port=None).start("arva_victim")
    assert autopilot.said() == ["ARVV: set SCR_SDEV_EN 1 and SCR_SDEV1_PROTO 28"]
    assert not autopilot.running
