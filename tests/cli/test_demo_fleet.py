"""`arva-hil demo` with several drones on one field."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from arva_hil.cli.demo import Pace
from arva_hil.clock import StepClock

from .far_ends import Arva

MAX = ("demo", "--speed", "max", "--headless")

pytestmark = pytest.mark.undrawn
FIELD = "spec: 2\ntransmitters: [{id: 1, ned: [14, -10, 0.5]}, {id: 2, ned: [-12, 12, 1]}]\n"


@pytest.fixture
def field(tmp_path: Path) -> Path:
    path = tmp_path / "field.yaml"
    path.write_text(FIELD)
    return path


def test_two_drones_find_one_transmitter_each(arva: Arva, field: Path, tmp_path: Path) -> None:
    record = tmp_path / "record"
    ended = arva(*MAX, "--scenario", field, "--count", 2, "--area=-20,-20,20,20", "--record", record)
    assert ended.code == 0, ended.err
    for id_ in (1, 2):
        assert ended.err.count(f": found transmitter {id_}: ") == 1
    run = json.loads((record / "run.json").read_text())
    assert run["vehicles"].keys() == {"drone-1", "drone-2"}
    assert run["scenario"]["datum"] == {"lat": 46.0123, "lon": 7.7456, "alt": 1650.0}  # so that a replay has the same
    assert (record / "drone-2" / "receiver" / "frames.bin").stat().st_size > 0


def test_what_was_not_found_is_named(arva: Arva, field: Path) -> None:
    field.write_text(FIELD.replace("-12, 12, 1", "-400, 12, 1"))
    ended = arva(*MAX, "--scenario", field, "--count", 2, "--area=0,-12,16,0")
    assert ended.code == 1
    assert "not found: transmitter 2" in ended.err


def test_a_computer_that_is_too_slow_for_the_speed_is_named_as_the_cause(arva: Arva, field: Path) -> None:
    ended = arva("demo", "--speed", 1000, "--headless", "--scenario", field, "--count", 2, "--limit", 30)
    assert ended.code in (1, 3)  # by what came too late first
    *_, lacking, last = ended.err.splitlines()
    assert lacking.startswith("not found: transmitter 1")
    assert last.startswith("this computer was too slow for --speed 1000: up to ")
    assert last.endswith("choose a lower --speed, or --speed max, which waits for nothing")


def test_who_keeps_pace_is_not_told_that_it_did_not() -> None:
    clock, pace = StepClock(), Pace(0.0)
    clock.wait(pace.service(clock))
    assert pace.service(clock) == pytest.approx(0.2)
    clock.wait(0.4)
    pace.service(clock)
    assert pace.complaint(20.0) == ""
    clock.wait(2.5)
    pace.service(clock)
    assert pace.complaint(1.0) == (
        "this computer was too slow for real time: up to 2.0 s of the flight behind, which may be why the search "
        "failed: choose --speed max"
    )


@pytest.mark.parametrize(
    ("options", "what"),
    [
        (["--count", "65"], "--count"),
        (["--count", "0"], "--count"),
        (["--count", "2", "--format", "text"], "several drones need binary or nmea"),
        (["--count", "2", "--format", "tunnel"], "several drones need binary or nmea"),
        (["--count", "20", "--area=-20,-20,20,20"], "20 drones would have 2.0 m each"),
        (["--scenario", "builtin:eight_drones", "--count", "3"], "has 8 vehicles: leave it out"),
    ],
)
def test_what_several_drones_cannot_do_is_refused(arva: Arva, options: list[str], what: str) -> None:
    ended = arva(*MAX, *options)
    assert ended.code == 2
    assert what in ended.err
    assert "Traceback" not in ended.err


def test_a_drone_with_two_receivers_is_refused(arva: Arva, field: Path) -> None:
    two = "{name: front, port: pty}, {name: rear, port: pty}"
    field.write_text(FIELD + f"vehicles: [{{name: alpha, receivers: [{two}]}}]\n")
    ended = arva(*MAX, "--scenario", field)
    assert (ended.code, "alpha: 2 receivers; a drone has one here" in ended.err) == (2, True)
