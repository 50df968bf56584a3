"""Whole searches with one sensor that lies, judged by the true height: tools/fuzz/sensors.py, a few flights of it."""

from __future__ import annotations

import pytest

from arva_hil.simulated.messages import SENSORS
from tools.fuzz import sensors as tool
from tools.fuzz.sensors import BAROMETER, Flight, Lie


@pytest.mark.parametrize(
    ("kind", "size", "from_s"),
    [
        ("offset", 5.0, 0.0),
        ("limit", 0.0, 15.0),
        ("offset", 2.0, 15.0),
        ("affine", 0.0, 0.0),
        ("factor", 2.0, 15.0),
    ],
)
def test_a_rangefinder_that_reads_too_high_lands_nothing(kind: str, size: float, from_s: float) -> None:
    report = Flight(Lie("rangefinder", kind, size, from_s), limit_s=30.0).report()
    assert not report.fault
    assert report.lowest > 2.0
    assert kind == "limit" or [e.sensor for e in report.disagreements] == ["rangefinder"]


def test_the_height_reference_moves_with_an_altitude_that_jumps() -> None:
    report = Flight(Lie("altitude", "reset", 5.0, 15.0), sensors=BAROMETER, limit_s=30.0).report()
    assert not report.fault
    assert report.lowest > 2.0
    (event,) = report.disagreements
    assert (event.sensor, event.value_m - event.other_m) == ("altitude", pytest.approx(5.0, abs=0.3))


def test_a_rangefinder_that_drifts_is_found_by_hovering_and_ends_the_search() -> None:
    report = Flight(Lie("rangefinder", "drift", 0.05, 10.0), limit_s=90.0).report()
    assert not report.fault
    assert report.how.startswith("the rangefinder says")


def test_falling_ground_is_no_drift() -> None:
    flight = Flight(ground=lambda north, east: max(-2.0, -0.1 * (north + east)), limit_s=60.0)
    report = flight.report()
    assert not report.fault
    assert not report.disagreements
    assert report.kind != "failed"


def test_the_program_prints_what_fails(capsys: pytest.CaptureFixture[str]) -> None:
    assert tool.main(["--runs", "1", "--seed", "3", "--verbose"]) == 0
    flight, total = capsys.readouterr().out.splitlines()
    assert flight.startswith("3: rangefinder noise")
    assert total.startswith("1 flights, 0 failures")


def test_an_end_names_both_values_and_the_vehicle_is_disarmed() -> None:
    flight = Flight(Lie("rangefinder", "offset", 5.0, 0.0), sensors=SENSORS, limit_s=60.0)
    assert flight.report().how.startswith("the rangefinder says 7.")
    assert flight.loop.drones[0].vehicle.state == "LAND, disarmed, on the ground"
