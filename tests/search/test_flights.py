"""Whole searches over the built-in vehicle, judged by its true motion; with faults, lies, and anywhere on Earth."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from arva_hil.autopilot.following.navigation import VehicleState
from arva_hil.campaign.trial import FOUND
from arva_hil.clock import StepClock
from arva_hil.config import parse
from arva_hil.events import Event
from arva_hil.events.reasons import Why, because
from arva_hil.events.searches import (
    BeliefChanged,
    FrameHeard,
    FromSearch,
    HeightSource,
    PlaceFound,
    SearchPaused,
    TakeOffPoint,
)
from arva_hil.events.words.reasons import in_words
from arva_hil.mavlink.codec import dialect
from arva_hil.model.field import LocalFrame
from arva_hil.model.field.rotation import Mount, from_euler
from arva_hil.registry import STRATEGIES
from arva_hil.runtime.loop import run
from arva_hil.search.flight.airborne import FlightSetup, MissionRun
from arva_hil.search.mission.mission import Mission
from arva_hil.search.strategies.estimate import Estimate
from arva_hil.search.strategies.extremum import Extremum
from arva_hil.search.strategies.plan import SearchPlan
from arva_hil.search.strategies.strategy import Belief
from arva_hil.simulated import HOME, closed_loop
from arva_hil.simulated.closed_loop import ClosedLoop
from arva_hil.simulated.messages import SENSORS
from firmware_proto import Channel, Frame
from tests.search.test_client import VICTIM, World
from tests.search.world import PAPER, fly
from tests.simulated_px4 import Px4
from tools.bench import finds, worlds
from tools.fuzz import sensors

NOT_SURE = in_words(because(Why.NOT_SURE))

BURIED = "{id: 1, ned: [6, 4, 1], attitude: {pitch: 20, yaw: 70}}"
WIND, CALM = (4.0, -3.0, 0.0), (0.0, 0.0, 0.0)
MOUNTED = "receiver: {mount: {position: [0.5, -0.2, 0.1], attitude: {roll: 5, yaw: 90}}}"


class Flight:
    """A search flown to its end. `lowest`: its least true height while it searches, above the ground, m."""

    def __init__(
        self,
        strategy: str,
        *more: str,
        victim: str = BURIED,
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


@pytest.mark.parametrize(
    ("height", "seed", "reported", "source"),
    [(1.0, 0, SENSORS, "rangefinder"), (3.0, 3, dialect.MAV_SYS_STATUS_SENSOR_ABSOLUTE_PRESSURE, "estimate")],
)
def test_the_ground_is_not_touched_though_the_position_wanders(
    height: float, seed: int, reported: int, source: str
) -> None:
    """Without a rangefinder the barometer keeps it up."""
    flight = Flight("flux", gps_noise_m=1.5, height=height, seed=seed, sensors=reported, limit_s=40.0)
    assert flight.outcome.kind in ("found", "not found")
    assert flight.lowest > height / 2
    assert source in flight.height_sources


@pytest.mark.parametrize(("trusted", "least", "most"), [(False, 1.5, 12.0), (True, 1.5, 3.5)])
def test_with_gps_alone_it_flies_higher_unless_it_is_trusted(trusted: bool, least: float, most: float) -> None:
    noise_m = 0.0 if trusted else 1.5
    flight = Flight("flux", gps_noise_m=noise_m, seed=0, sensors=0, trust_gps=trusted, limit_s=15.0)
    assert least < flight.lowest < max(flight.heights) < most
    assert trusted or max(flight.heights) > 5.0
    assert flight.height_sources == ["GPS"]
    assert flight.touchdown[2] == pytest.approx(0.0, abs=0.05)


# -- where it lands ----------------------------------------------------------------------------------------


def test_a_receiver_that_is_mounted_aside_finds_as_well_in_wind_and_it_lands_there() -> None:
    mount = Mount((0.5, -0.2, 0.1), from_euler(*np.radians((5, 0, 90))))
    flight = Flight("estimate", MOUNTED, mount=mount, wind=WIND)
    assert flight.outcome.kind == "found"
    assert flight.off < 0.2
    assert flight.touchdown[2] == pytest.approx(0.0, abs=0.05)
    assert math.dist(flight.touchdown[:2], flight.outcome.found[:2]) < 0.35  # the vehicle's centre


# -- what is not found -------------------------------------------------------------------------------------

REPEATS = ("failed", "the receiver repeats the same reading: it is stuck")


def test_a_receiver_that_sticks_near_the_end_has_found_nothing_it_cannot_know() -> None:
    """The vehicle goes on for a metre or two: too little to be called stuck, enough to be that far off."""
    victim = "{id: 1, ned: [-8.189, 10.766, 1.79], attitude: {roll: -51.283, pitch: 26.181, yaw: 134.321}}"
    flight = Flight("estimate", "faults: [{stuck: true, from_s: 18}]", victim=victim, seed=4)  # it would end after 21 s
    assert (flight.outcome.kind, in_words(flight.outcome.how)) == REPEATS


def test_a_receiver_that_sticks_is_said_and_landed_on() -> None:
    flight = Flight("extremum", "faults: [{stuck: true, from_s: 20}]")
    assert (flight.outcome.kind, in_words(flight.outcome.how)) == REPEATS
    assert "same readings" in [event.reason for event in flight.events if isinstance(event, SearchPaused)]


@pytest.mark.parametrize(("back_s", "kind"), [(26, "found"), (28, "not sure")])
def test_a_place_that_a_transmitter_has_left_while_the_vehicle_comes_down_is_no_find(back_s: int, kind: str) -> None:
    """It goes back by 3 m in the search or just after it: to where it then lies, or nothing is called found."""
    flight = Flight("estimate", f"faults: [{{transmitter_moved: 1, by_ned: [1.2, -2.9, 0], until_s: {back_s}}}]")
    assert flight.outcome.kind == kind
    assert flight.off < 0.1 if kind == "found" else in_words(flight.outcome.how) == NOT_SURE


def test_the_program_that_counts_false_finds_flies_with_the_faults_it_draws(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(finds, "_LIMIT_S", 5.0)
    one = finds.flown("flux", 126, most=3)
    assert "antenna_y=0" in one.faults
    assert one.kind == "not found in 5 s"
    assert [one._replace(outcome=FOUND, error_m=metres).kind for metres in (2.9, 3.1)] == [FOUND, "false"]


def test_where_nobody_sends_a_loud_drone_receives_no_signal() -> None:
    """All readings are noise of the antennas, and ghost signals."""
    faults = "faults: [interference: 100, impulses: 0.02]"
    flight = Flight("estimate", faults, victim="{id: 1, ned: [2000, 0, 0]}", area=(-6, -6, 6, 6))
    assert flight.outcome.others
    assert in_words(flight.outcome.how).startswith("no signal agrees with a place: all strips are flown")
    assert flight.outcome.time_s < 200.0


def test_a_dead_antenna_is_noticed_and_the_transmitter_found() -> None:
    victim = "{id: 1, ned: [4, 2, 0.5], attitude: {pitch: 50, yaw: 100}}"
    flight = Flight("estimate", "faults: [antenna_y: 0]", victim=victim, limit_s=50.0)
    assert flight.outcome.kind == "found"
    assert flight.off < 0.1


def test_one_antenna_alone_confirms_a_place_that_is_right() -> None:
    one = worlds.fly("rssi", 95048)
    assert one.relative < 0.02
    assert one.outcome == FOUND


# What a search tells of itself to whoever watches: frames and where they were heard, beliefs, the place found


FRAME = Frame(1, 1, (Channel(1, 1, 1234, 17),))


class Watcher:
    def __init__(self) -> None:
        self.told: list[Event] = []

    def observe(self, event: Event) -> None:
        if isinstance(event, FromSearch):
            self.told.append(event.event)


class Thinker(Estimate):
    """Believes what it is told to."""

    said: object = Belief(((1.0, 2.0, 1.0),), None, (3.0, 4.0))

    @property
    def belief(self) -> Belief:
        return self.said  # type: ignore[return-value]


def test_a_flight_tells_its_take_off_point_its_frames_its_beliefs_and_the_place() -> None:
    watcher, clock = Watcher(), StepClock()
    loop = ClosedLoop(
        parse(f"spec: 1\ntransmitters: [{BURIED}]", "flight"),
        SearchPlan(Estimate),
        start=clock.now(),
        stream_hz=10.0,
        observers=[watcher],
    )
    run(loop.tasks, clock, until=300.0, stopped=lambda: loop.drones[0].search.outcome is not None)
    (point,) = (event for event in watcher.told if isinstance(event, TakeOffPoint))
    assert (point.lat, point.lon, point.alt) == pytest.approx(HOME, abs=1e-3)
    frames = [event for event in watcher.told if isinstance(event, FrameHeard)]
    placed = [event.position for event in frames if event.position is not None]
    assert placed
    assert any(event.position is None for event in frames)  # on the ground, before the take-off point is known
    beliefs = [event for event in watcher.told if isinstance(event, BeliefChanged)]
    assert all(math.isclose(sum(share for _, _, share in b.hypotheses), 1.0, abs_tol=1e-9) for b in beliefs)
    assert len(beliefs[0].hypotheses) > 1
    assert all(belief.goal is not None for belief in beliefs)
    (found,) = (event for event in watcher.told if isinstance(event, PlaceFound))
    assert math.dist((found.north_m, found.east_m), (6.0, 4.0)) < 0.2
    assert found.sure
    assert found.covariance is not None


def test_beliefs_are_told_twice_a_second_at_most() -> None:
    told: list[Event] = []
    mission = Mission(SearchPlan(Thinker), 0.0, (0.0, 0.0, -3.0), emit=told.append)
    for step in range(21):
        mission.on_frame(
            Frame(step, 1, (Channel(1, 1, 1234 - step, 17),)), step / 10, (0.1 * step, 0.0, -3.0), np.eye(3)
        )
    beliefs = [event for event in told if isinstance(event, BeliefChanged)]
    assert [event.time_s for event in beliefs] == [0.0, 0.5, 1.0, 1.5, 2.0]
    assert beliefs[0] == BeliefChanged(0.0, 1, ((1.0, 2.0, 1.0),), None, (3.0, 4.0))


def test_an_estimate_believes_in_where_it_goes() -> None:
    estimate = Estimate(1.0)
    assert estimate.belief == Belief()
    flight = fly(estimate, PAPER[0])
    assert flight.found is not None
    best = max(estimate.belief.hypotheses, key=lambda place: place[2])
    assert math.dist(best[:2], flight.found[:2]) < 0.5
    assert Extremum(1.0).belief == Belief()


def test_frames_are_told_ten_times_a_second_with_the_place_of_the_receiver() -> None:
    told: list[Event] = []
    half = math.sqrt(0.5)
    east = VehicleState(0.0, np.array([3.0, 2.0, -1.0]), np.zeros(3), (half, 0.0, 0.0, half), 0.0)
    poses = {0.0: None}
    session: Any = SimpleNamespace(navigation=SimpleNamespace(state_at=lambda now, origin: poses.get(now, east)))
    ground: Any = None
    setup = FlightSetup(SearchPlan(Estimate, mount=Mount((1.0, 0.0, 0.0))), session, ground, 0.0, told.append)
    flight = MissionRun(setup)
    flight.origin = LocalFrame(46.0, 7.0, 500.0)
    for step in range(5):
        flight.on_frame(FRAME, flight.pose(step / 20), step / 20)
    assert told[0] == FrameHeard(0.0, FRAME, None, None)
    (second, third) = told[1:]
    assert (second.time_s, third.time_s) == (0.1, 0.2)
    assert isinstance(second, FrameHeard)
    assert second.position == pytest.approx((3.0, 3.0, -1.0))
    assert second.heading_deg == pytest.approx(90.0)


# Whole searches with one sensor that lies, judged by the true height: tools/fuzz/sensors.py, a few flights of it


@pytest.mark.parametrize(
    ("lie", "sensors_"),
    [
        (sensors.Lie("rangefinder", "limit", 0.0, 8.0), SENSORS),
        (sensors.Lie("rangefinder", "factor", 2.0, 8.0), SENSORS),
        (sensors.Lie("altitude", "reset", 5.0, 8.0), sensors.BAROMETER),
    ],
)
def test_a_sensor_that_reads_too_high_lands_nothing(lie: sensors.Lie, sensors_: int) -> None:
    report = sensors.Flight(lie, strategy="flux", sensors=sensors_, limit_s=10.0).report()
    assert not report.fault
    assert report.lowest > 2.0
    assert [event.sensor for event in report.disagreements] == [lie.sensor] * (lie.kind != "limit")
    for event in report.disagreements:  # the altitude's reference moves with it
        assert lie.kind != "reset" or event.value_m - event.other_m == pytest.approx(5.0, abs=0.3)


def test_a_rangefinder_that_drifts_is_found_by_hovering_and_ends_the_search() -> None:
    lie = sensors.Lie("rangefinder", "drift", 0.2, 0.0)
    report = sensors.Flight(lie, strategy="flux", limit_s=150.0).report()
    assert not report.fault
    assert report.lowest > 2.0
    assert report.how.startswith("the rangefinder says")


def test_falling_ground_is_no_drift() -> None:
    flight = sensors.Flight(ground=lambda north, east: max(-2.0, -0.1 * (north + east)), strategy="flux", limit_s=25.0)
    report = flight.report()
    assert not report.fault
    assert not report.disagreements
    assert report.kind != "failed"


def test_the_program_prints_what_fails(capsys: pytest.CaptureFixture[str]) -> None:
    assert sensors.main(["--runs", "1", "--seed", "3", "--verbose"]) == 0
    flight, total = capsys.readouterr().out.splitlines()
    assert flight.startswith("3: rangefinder noise")
    assert total.startswith("1 flights, 0 failures")


def test_an_end_names_both_values_and_the_vehicle_is_disarmed() -> None:
    flight = sensors.Flight(sensors.Lie("rangefinder", "offset", 5.0, 0.0), strategy="flux", limit_s=60.0)
    report = flight.report()
    assert not report.fault
    assert report.lowest > 2.0
    assert [event.sensor for event in report.disagreements] == ["rangefinder"]
    assert report.how.startswith("the rangefinder says 7.")
    assert flight.loop.drones[0].vehicle.state == "LAND, disarmed, on the ground"


# -- A search is the same everywhere on Earth: at the date line, near the poles, at 4,300 m ---------------


@pytest.mark.parametrize("home", [(-16.5, 179.99998, 10.0), (-89.9, 120.0, 2800.0)])  # west of the date line; a pole
def test_a_transmitter_is_found_and_its_place_on_earth_said(home: tuple[float, float, float]) -> None:
    """PX4 is told a place on Earth to take off to, ArduPilot is not."""
    world = World(Px4(home))
    assert world.end() == ("found", "found")
    lat, lon = world.client.outcome.lat_lon
    assert -180.0 <= lon <= 180.0
    north, east, _ = LocalFrame(*home).ned(lat, lon, home[2])
    assert math.dist((north, east), VICTIM) < 0.1
    assert math.dist(world.ned[:2], VICTIM) < 0.6


def test_the_emulator_and_a_search_agree_there(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(closed_loop, "HOME", (-89.9, 179.99999, 4300.0))
    scenario = parse("spec: 1\ntransmitters: [{id: 1, ned: [5, 3, 0.5]}]", "test")
    plan, clock = SearchPlan(STRATEGIES["estimate"], area=(-20, -20, 20, 20)), StepClock()
    loop = ClosedLoop(scenario, plan, start=0.0, stream_hz=10.0)
    run(loop.tasks, clock, until=60.0, stopped=lambda: loop.drones[0].decided)
    assert loop.drones[0].error() < 0.1
