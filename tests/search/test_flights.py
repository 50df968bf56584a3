"""Whole searches over the built-in vehicle, judged by its true motion: height, landing place, what is no find."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from arva_hil.clock import StepClock
from arva_hil.config import parse
from arva_hil.events import Event
from arva_hil.events.reasons import Why, because
from arva_hil.events.searches import FromSearch, HeightSource, SearchPaused
from arva_hil.events.words.reasons import in_words
from arva_hil.mavlink.codec import dialect
from arva_hil.model.field.rotation import Mount, from_euler
from arva_hil.registry import STRATEGIES
from arva_hil.runtime.loop import run
from arva_hil.search.strategies.plan import SearchPlan
from arva_hil.simulated.closed_loop import ClosedLoop
from arva_hil.simulated.messages import SENSORS

NOT_SURE = in_words(because(Why.NOT_SURE))

VICTIM = "{id: 1, ned: [14, 9, 1], attitude: {pitch: 20, yaw: 70}}"
WIND, CALM = (4.0, -3.0, 0.0), (0.0, 0.0, 0.0)
MOUNTED = "receiver: {mount: {position: [0.5, -0.2, 0.1], attitude: {roll: 5, yaw: 90}}}"


class Flight:
    """A search flown to its end. `lowest`: its least true height while it searches, above the ground, m."""

    def __init__(
        self,
        strategy: str,
        *more: str,
        victim: str = VICTIM,
        gps_noise_m: float = 0.0,
        wind: tuple[float, float, float] = CALM,
        seed: int = 1,
        sensors: int = SENSORS,
        **plan: Any,
    ) -> None:
        clock = StepClock()
        text = "\n".join(["spec: 1", f"seed: {seed}", f"transmitters: [{victim}]", *more, ""])
        self.heights: list[float] = []
        self.events: list[Event] = []  # of the search
        self.loop = ClosedLoop(
            parse(text, "flight"),
            SearchPlan(STRATEGIES[strategy], **plan),
            start=clock.now(),
            stream_hz=10.0,
            wind=wind,
            gps_noise_m=gps_noise_m,
            sensors=sensors,
            observers=[self],
            log=lambda row: self._note(row.phase, clock.now()),
        )
        self._searching = True
        run(self.loop.tasks, clock, until=1200.0, stopped=lambda: self.loop.drones[0].search.outcome is not None)
        outcome = self.loop.drones[0].search.outcome
        assert outcome is not None
        self.outcome = outcome
        self.touchdown = self.loop.drones[0].vehicle.truth(clock.now()).ned

    def _note(self, phase: str, now: float) -> None:
        if phase == "flying" and not self.loop.drones[0].decided:
            self.heights.append(-self.loop.drones[0].vehicle.truth(now).ned[2])

    def observe(self, event: Event) -> None:
        if isinstance(event, FromSearch):
            self.events.append(event.event)

    @property
    def height_sources(self) -> list[str]:
        return [event.source for event in self.events if isinstance(event, HeightSource)]

    @property
    def lowest(self) -> float:
        return min(self.heights)

    @property
    def off(self) -> float | None:
        """The place reported to the transmitter, horizontally, m."""
        return self.loop.drones[0].error()


# -- the ground --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("height", "seed"), [(1.0, 0), (3.0, 4)])
def test_the_ground_is_not_touched_though_the_position_wanders(height: float, seed: int) -> None:
    flight = Flight("estimate", gps_noise_m=1.5, height=height, seed=seed, limit_s=40.0)
    assert flight.outcome.kind in ("found", "not found")
    assert flight.lowest > height / 2
    assert "rangefinder" in flight.height_sources


def test_without_a_rangefinder_the_barometer_keeps_it_up() -> None:
    flight = Flight(
        "estimate", gps_noise_m=1.5, seed=3, sensors=dialect.MAV_SYS_STATUS_SENSOR_ABSOLUTE_PRESSURE, limit_s=40.0
    )
    assert flight.outcome.kind in ("found", "not found")
    assert flight.lowest > 1.5
    assert "estimate" in flight.height_sources


def test_with_gps_alone_it_flies_higher() -> None:
    flight = Flight("estimate", gps_noise_m=1.5, seed=0, sensors=0, limit_s=30.0)
    assert flight.lowest > 1.5
    assert flight.height_sources == ["GPS"]
    assert flight.touchdown[2] == pytest.approx(0.0, abs=0.05)


def test_who_insists_flies_as_low_as_asked_for_by_gps_alone() -> None:
    flight = Flight("estimate", sensors=0, trust_gps=True, limit_s=20.0)
    assert max(flight.heights) < 3.5
    assert flight.height_sources == ["GPS"]


# -- where it lands ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("strategy", "within_m", "wind"), [("estimate", 0.2, WIND), ("flux", 0.7, CALM), ("extremum", 1.0, WIND)]
)
def test_a_receiver_that_is_mounted_aside_finds_as_well_in_wind_and_it_lands_there(
    strategy: str, within_m: float, wind: tuple[float, float, float]
) -> None:
    flight = Flight(strategy, MOUNTED, mount=mount(), wind=wind)
    assert flight.outcome.kind == "found"
    assert flight.off is not None
    assert flight.off < within_m
    assert flight.touchdown[2] == pytest.approx(0.0, abs=0.05)
    assert flight.outcome.found is not None
    assert math.dist(flight.touchdown[:2], flight.outcome.found[:2]) < 0.35  # the vehicle's centre


# -- a receiver off the centre, and turned -----------------------------------------------------------------


def mount() -> Mount:
    return Mount((0.5, -0.2, 0.1), from_euler(*np.radians((5, 0, 90))))


def test_a_mount_that_nobody_told_of_is_an_error_of_the_place() -> None:
    flight = Flight("estimate", "receiver: {mount: {position: [0.5, 0, 0]}}")
    assert flight.off == pytest.approx(0.5, abs=0.1)


def test_mounted_aside_with_late_readings_and_a_position_that_wanders_no_find_is_false() -> None:
    flight = Flight("estimate", MOUNTED, "faults: [{delay_s: 1}]", mount=mount(), gps_noise_m=1.0, limit_s=120.0)
    if flight.outcome.kind == "found":
        assert flight.off is not None
        assert flight.off < 3.0


# -- what is not found -------------------------------------------------------------------------------------

STUCK, LATE = "{stuck: true, from_s: 25}", "{delay_s: 5}"
REPEATS = ("failed", "the receiver repeats the same reading: it is stuck")


@pytest.mark.parametrize(
    ("strategy", "fault"),
    [("estimate", STUCK), ("estimate", LATE), ("flux", STUCK), ("extremum", LATE)],
)
def test_what_is_found_lies_there_or_is_not_called_found(strategy: str, fault: str) -> None:
    """The other two: below."""
    flight = Flight(strategy, f"faults: [{fault}]", limit_s=60.0)
    assert flight.touchdown[2] == pytest.approx(0.0, abs=0.05)
    if flight.outcome.kind == "found":
        assert flight.off is not None
        assert flight.off < 2.5
    else:
        assert flight.outcome.kind in ("not sure", "failed", "not found")


NEAR = (  # searches that end 20 to 22 s from the start of the vehicle
    "{id: 1, ned: [-8.189, 10.766, 1.79], attitude: {roll: -51.283, pitch: 26.181, yaw: 134.321}}",
    "{id: 1, ned: [12.114, -7.159, 1.839], attitude: {roll: 13.919, pitch: -63.731, yaw: -144.578}}",
)


@pytest.mark.parametrize(("seed", "victim", "since"), [(4, NEAR[0], 18.0), (12, NEAR[1], 19.2)])
def test_a_receiver_that_sticks_near_the_end_has_found_nothing_it_cannot_know(
    seed: int, victim: str, since: float
) -> None:
    """The vehicle goes on for a metre or two: too little to be called stuck, enough to be that far off."""
    flight = Flight("estimate", f"faults: [{{stuck: true, from_s: {since}}}]", victim=victim, seed=seed)
    if flight.outcome.kind == "found":
        assert flight.off is not None
        assert flight.off < 1.0
    else:
        assert (flight.outcome.kind, in_words(flight.outcome.how)) == REPEATS


def test_a_receiver_that_sticks_is_said_and_landed_on() -> None:
    flight = Flight("extremum", "faults: [{stuck: true, from_s: 20}]")
    assert (flight.outcome.kind, in_words(flight.outcome.how)) == REPEATS
    assert "same readings" in [event.reason for event in flight.events if isinstance(event, SearchPaused)]


def test_readings_that_come_late_end_not_sure() -> None:
    flight = Flight("flux", "faults: [{delay_s: 5}]", victim="{id: 1, ned: [8, 8, 0]}")
    assert (flight.outcome.kind, in_words(flight.outcome.how)) == ("not sure", NOT_SURE)
    assert flight.off is not None
    assert flight.off > 2.5
