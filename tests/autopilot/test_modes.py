"""How each autopilot names its modes, and what it is told in."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from arva_hil.autopilot.following.discovery import Vehicle
from arva_hil.autopilot.following.modes import ARDUCOPTER, PX4, modes_of
from arva_hil.mavlink.codec import Encoder, Parser, command, decode, dialect
from tests.every import every

QUADROTOR = dialect.MAV_TYPE_QUADROTOR


def vehicle(autopilot: int = dialect.MAV_AUTOPILOT_PX4, kind: int = QUADROTOR) -> Vehicle:
    return Vehicle(7, 1, autopilot, kind, False, 2)


def px4(main: int, sub: int = 0) -> int:
    return main << 16 | sub << 24


@every(
    "modes, mode, name",
    [
        (ARDUCOPTER, 0, "STABILIZE"),
        (ARDUCOPTER, 4, "GUIDED"),
        (ARDUCOPTER, 9, "LAND"),
        (ARDUCOPTER, 1000, "mode 1000"),
        (PX4, px4(1), "manual"),
        (PX4, px4(3), "position"),
        (PX4, px4(6), "offboard"),
        (PX4, px4(4, 2), "takeoff"),
        (PX4, px4(4, 3), "hold"),
        (PX4, px4(4, 5), "return"),
        (PX4, px4(4, 6), "land"),
        (PX4, px4(3, 6), "position"),  # only AUTO has those sub-modes
        (PX4, px4(4, 200), "mode 4/200"),
        (PX4, 0, "mode 0/0"),
    ],
)
def test_a_mode_has_the_name_that_a_pilot_knows(modes: object, mode: int, name: str) -> None:
    assert modes.name(mode) == name  # type: ignore[attr-defined]


@given(st.integers(0, 2**32 - 1))
def test_every_mode_has_a_name(mode: int) -> None:
    assert ARDUCOPTER.name(mode)
    assert PX4.name(mode)


def test_arducopter_does_all_but_landing_in_guided() -> None:
    modes = {ARDUCOPTER.name(mode) for mode in (ARDUCOPTER.hold, ARDUCOPTER.take_off, ARDUCOPTER.steer)}
    assert modes == {"GUIDED"}
    assert ARDUCOPTER.name(ARDUCOPTER.land) == "LAND"


def test_px4_has_a_mode_for_each() -> None:
    modes = [PX4.name(mode) for mode in (PX4.hold, PX4.take_off, PX4.steer, PX4.land)]
    assert modes == ["hold", "takeoff", "offboard", "land"]


@every(
    "modes, mode, params",
    [(ARDUCOPTER, 4, (1, 4, 0)), (PX4, px4(4, 3), (1, 4, 3)), (PX4, px4(6), (1, 6, 0))],
)
def test_a_mode_is_set_by_number_or_by_main_and_sub_mode(modes: object, mode: int, params: tuple[int, ...]) -> None:
    message = modes.to_set(vehicle(), mode)  # type: ignore[attr-defined]
    assert (message.command, message.target_system, message.target_component) == (dialect.MAV_CMD_DO_SET_MODE, 7, 1)
    assert (message.param1, message.param2, message.param3) == params


@given(st.floats(0.3, 100), st.floats(-400, 8000))
def test_a_take_off_is_above_home_for_arducopter_and_above_the_sea_and_higher_for_px4(
    height: float, ground: float
) -> None:
    encoder, parser = Encoder(7, 193), Parser()
    for modes, level in ((ARDUCOPTER, height), (PX4, ground + height + 2.5)):
        (packet,) = parser.feed(encoder.pack(modes.to_take_off(vehicle(), height, ground)))
        message = decode(packet)
        assert message.param7 == pytest.approx(level, abs=1e-3)
        place = message.param4, message.param5, message.param6
        assert all(map(math.isnan, place)) if modes is PX4 else place == (0, 0, 0)


def test_a_command_is_for_the_vehicle_alone() -> None:
    message = command(7, 1, 400, 1)
    for sent in (message, ARDUCOPTER.to_set(vehicle(), 4), PX4.to_take_off(vehicle(), 2.0, 500.0)):
        assert (sent.target_system, sent.target_component, sent.confirmation) == (7, 1, 0)
    assert message.command == 400
    assert [getattr(message, f"param{n}") for n in range(1, 8)] == [1, 0, 0, 0, 0, 0, 0]


@every("kind", [QUADROTOR, dialect.MAV_TYPE_HEXAROTOR, dialect.MAV_TYPE_OCTOROTOR])
def test_multirotors_of_both_are_flown(kind: int) -> None:
    assert modes_of(vehicle(dialect.MAV_AUTOPILOT_ARDUPILOTMEGA, kind)) is ARDUCOPTER
    assert modes_of(vehicle(dialect.MAV_AUTOPILOT_PX4, kind)) is PX4


@every("kind", [dialect.MAV_TYPE_FIXED_WING, dialect.MAV_TYPE_VTOL_TILTROTOR, 200])
def test_nothing_else_is(kind: int) -> None:
    with pytest.raises(ValueError, match="7/1 is not a multirotor"):
        modes_of(vehicle(kind=kind))
    with pytest.raises(ValueError, match="generic quadrotor 7/1 is neither ArduPilot nor PX4"):
        modes_of(vehicle(dialect.MAV_AUTOPILOT_GENERIC))
