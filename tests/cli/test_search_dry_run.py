"""`arva-hil search --dry-run` as somebody at the bench types it: all but arming and moving."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import pytest

from arva_hil.mavlink.codec import Parser, decode, dialect

from .far_ends import Autopilot, Beacon, Keep, Start
from .test_search import orders
from .test_search_permission import arguments

QUESTIONS = {
    dialect.MAV_CMD_SET_MESSAGE_INTERVAL,
    dialect.MAV_CMD_REQUEST_MESSAGE,
    dialect.MAV_CMD_GET_HOME_POSITION,
}


def nothing_moves(autopilot: Autopilot) -> None:
    """Of all bytes that were sent to it, none moves it."""
    parser = Parser()
    messages: list[Any] = [decode(packet) for packet in parser.feed(bytes(autopilot.heard))]
    assert messages
    assert {m.get_type() for m in messages} <= {"HEARTBEAT", "COMMAND_LONG", "PARAM_REQUEST_READ"}
    assert {m.command for m in messages if m.get_type() == "COMMAND_LONG"} <= QUESTIONS
    assert orders(autopilot) == []


def test_it_says_what_it_would_order_and_orders_nothing(
    start: Start, autopilot: Autopilot, beacon: Beacon, tmp_path: Path
) -> None:
    folder = tmp_path / "record"
    program = start(*arguments(autopilot, beacon), "--dry-run", "--json", "--record", folder)
    assert program.ends() == 0
    nothing_moves(autopilot)
    told = program.err
    steps = ["DO_SET_MODE: GUIDED", "COMPONENT_ARM_DISARM: arm", "NAV_TAKEOFF: to 3 m above the take-off point"]
    steps += ["SET_POSITION_TARGET_LOCAL_NED: ", "NAV_LAND: at the end"]
    places = [told.index(step) for step in steps]
    assert places == sorted(places)
    assert "arming" not in told
    assert told.count("SET_POSITION_TARGET_LOCAL_NED: ") >= 4
    assert "dry run: nothing was ordered; it would have flown" in told
    made = json.loads(program.out)
    assert made["outcome"] == "would fly"
    assert [order["order"] for order in made["would_order"]][:3] == [step.partition(":")[0] for step in steps[:3]]
    assert "dry run" in (folder / "search.csv").read_text()


@pytest.mark.parametrize("how", ["option", "environment"])
def test_what_is_no_simulator_needs_neither_yes_nor_a_terminal_for_it(
    start: Start, real: Autopilot, beacon: Beacon, how: str
) -> None:
    """A variable that is left in a shell makes it safer, and so it counts."""
    option = ("--dry-run",) if how == "option" else ()
    environment = os.environ | ({"ARVA_HIL_DRY_RUN": "1"} if how == "environment" else {})
    program = start(*arguments(real, beacon), *option, env=environment)
    assert program.ends() == 0
    assert "is not known to be a simulator: before it flies, it would need --yes" in program.err
    nothing_moves(real)


def test_without_frames_it_would_not_have_flown(start: Start, autopilot: Autopilot, keep: Keep, beacon: Beacon) -> None:
    beacon.quiet.set()
    program = start(*arguments(autopilot, beacon), "--dry-run", "--timeout", 3)
    assert program.ends() == 3
    assert "no frame from the receiver" in program.err
    nothing_moves(autopilot)
