"""The height above the ground: what measures it, what is not believed, and how it is kept."""

from __future__ import annotations

import math
import random
from collections import deque
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from arva_hil.autopilot.following.navigation import VehicleState
from arva_hil.autopilot.following.session import Session
from arva_hil.events import Event
from arva_hil.events.searches import HeightSource, SensorsDisagree, TooLow
from arva_hil.events.words.reasons import in_words
from arva_hil.mavlink.codec import Encoder, dialect
from arva_hil.model.field.rotation import from_angles
from arva_hil.registry import STRATEGIES
from arva_hil.search.mission.ground import Descent, Ground, Height, HeightKeeper
from arva_hil.search.mission.height_sensors import Odometry, RangeCheck
from arva_hil.search.strategies.plan import SearchPlan
from tests.every import every

DOWN = dialect.MAV_SENSOR_ROTATION_PITCH_270
QUAD, ARDUPILOT = dialect.MAV_TYPE_QUADROTOR, dialect.MAV_AUTOPILOT_ARDUPILOTMEGA


class Vehicle:
    """A session with a vehicle that says what a test wants, and the ground that is made of it."""

    def __init__(self, *, trust_gps: bool = False) -> None:
        self.session = Session()
        self.events: list[Event] = []
        self.ground = Ground(self.session, SearchPlan(STRATEGIES["estimate"], trust_gps=trust_gps), self.events.append)
        self._encoder = Encoder(1, 1)
        self.arm(False)

    def arm(self, armed: bool = True) -> None:
        mode = dialect.MAV_MODE_FLAG_SAFETY_ARMED if armed else 0
        self.says(0.0, dialect.MAVLink_heartbeat_message(QUAD, ARDUPILOT, mode, 4, 4, 3))

    def says(self, now: float, *messages: Any) -> Vehicle:
        self.ground.on_packets(self.session.feed(b"".join(map(self._encoder.pack, messages)), now), now)
        return self

    def height(self, now: float, above: float, *, sinks: float = 0.0, roll: float = 0.0) -> Height:
        place, velocity = np.array([0.0, 0.0, -above]), np.array([0.0, 0.0, sinks])
        return self.ground.height(now, VehicleState(now, place, velocity, from_angles(roll, 0.0, 0.0), 0.0))

    def take_events(self) -> list[Event]:
        """Return the events since the last call."""
        events = self.events[:]
        self.events.clear()
        return events

    def height_sources(self) -> list[str]:
        return [event.source for event in self.take_events() if isinstance(event, HeightSource)]


@pytest.fixture
def vehicle() -> Vehicle:
    return Vehicle()


def distance(cm: int, *, low: int = 20, high: int = 1200, turned: int = DOWN, quality: int = 0) -> Any:
    return dialect.MAVLink_distance_sensor_message(0, low, high, cm, 0, 0, turned, 255, 0, 0, [0] * 4, quality)


def rangefinder(metres: float) -> Any:
    return dialect.MAVLink_rangefinder_message(metres, 0.0)


def pressure(metres: float) -> Any:
    return dialect.MAVLink_scaled_pressure_message(0, 850 * math.exp(-metres / (29.27 * 273)), 0.0, 0)


def terrain(height: float, spacing: int = 100) -> Any:
    return dialect.MAVLink_terrain_report_message(0, 0, spacing, 500.0, height, 0, 10)


def altitude(clearance: float) -> Any:
    return dialect.MAVLink_altitude_message(0, 0.0, 0.0, 0.0, 0.0, 0.0, clearance)


@pytest.mark.parametrize("message", [distance(240), rangefinder(2.4)])
def test_a_rangefinder_measures_it_whatever_the_position_says(vehicle: Vehicle, message: Any) -> None:
    assert vehicle.says(1.0, message).height(1.1, 7.0) == Height(
        pytest.approx(2.4), True, ground=pytest.approx(4.6), still=True
    )
    assert vehicle.height_sources() == ["rangefinder"]
    assert vehicle.height(1.2, 7.0).measured
    assert vehicle.height_sources() == []


def test_a_leaning_vehicle_looks_aside(vehicle: Vehicle) -> None:
    assert vehicle.says(1.0, distance(240)).height(1.1, 7.0, roll=math.radians(20)).metres == pytest.approx(
        2.4 * math.cos(math.radians(20))
    )
    assert not vehicle.height(1.1, 7.0, roll=math.radians(45)).measured


@pytest.mark.parametrize(
    "message",
    [
        distance(240, turned=0),
        distance(10),
        distance(1200),
        distance(0, low=0),
        distance(240, quality=1),
        rangefinder(0.0),
        rangefinder(math.nan),
        rangefinder(-1.0),
    ],
)
def test_what_measures_nothing_is_no_height(vehicle: Vehicle, message: Any) -> None:
    assert vehicle.says(1.0, message).height(1.1, 7.0) == Height(7.0, False)
    assert vehicle.height_sources() == ["estimate"]


def test_one_echo_of_something_else_is_no_ground(vehicle: Vehicle) -> None:
    for cm in (300, 900, 301):
        vehicle.says(1.0, distance(cm))
    assert vehicle.height(1.1, 3.0).metres == pytest.approx(3.0, abs=0.02)


def test_a_rangefinder_that_says_the_same_however_it_sinks_is_not_believed(vehicle: Vehicle) -> None:
    measured = []
    for n in range(20):
        vehicle.says(n * 0.2, distance(900))
        measured.append(vehicle.height(n * 0.2, 3.0, sinks=0.5).measured)
    assert measured[0]
    assert not measured[-1]
    assert vehicle.says(4.0, distance(120)).height(4.0, 3.0, sinks=0.5).measured


def test_a_rangefinder_that_goes_leaves_the_highest_ground_it_saw(vehicle: Vehicle) -> None:
    assert vehicle.says(1.0, distance(300)).height(1.0, 8.0).metres == pytest.approx(3.0)  # the ground has risen by 5 m
    vehicle.says(1.5, distance(299))
    assert vehicle.says(1.5, distance(299)).height(1.5, 7.99).metres == pytest.approx(2.99)
    vehicle.height_sources()
    assert vehicle.height(3.0, 8.0) == Height(pytest.approx(3.0), False, ground=pytest.approx(5.0))
    assert vehicle.height_sources() == ["highest ground"]


def test_the_barometer_may_say_less_and_never_more(vehicle: Vehicle) -> None:
    for n in range(50):
        vehicle.says(n * 0.2, pressure(0.0))
    vehicle.arm()
    for n in range(50, 400):
        vehicle.says(n * 0.2, pressure(1.5))
        height = vehicle.height(n * 0.2, 3.0)
    assert height == Height(pytest.approx(1.5, abs=0.1), False)
    for n in range(400, 800):
        vehicle.says(n * 0.2, pressure(6.0))
        height = vehicle.height(n * 0.2, 3.0)
    assert height == Height(3.0, False)


def test_a_barometer_that_says_much_less_is_flown_by_and_ends_the_search(vehicle: Vehicle) -> None:
    vehicle.says(0.0, pressure(0.0)).arm()
    vehicle.height(0.0, 3.0)
    for n in range(100):
        vehicle.says(n * 0.2, pressure(-50.0))
        height = vehicle.height(n * 0.2, 3.0)
        assert n > 75 or not height.doubt  # 15 s
    assert height.metres == pytest.approx(-50.0, abs=0.1)
    assert height.still
    assert height.doubt
    assert in_words(height.doubt) == "the altitude says 3.0 m, and the barometer -50.0 m"
    (event,) = [event for event in vehicle.take_events() if isinstance(event, SensorsDisagree)]
    assert (event.sensor, event.value_m, event.other) == ("altitude", 3.0, "barometer")


def test_the_terrain_database_counts_from_the_take_off_and_may_only_say_less(vehicle: Vehicle) -> None:
    vehicle.says(1.0, pressure(0.0), terrain(-7.0)).arm()
    vehicle.says(2.0, terrain(-6.0))  # 1 m above where it stood
    assert vehicle.height(2.0, 3.0) == Height(pytest.approx(1.0), False, ground=0.0)
    assert vehicle.says(3.0, terrain(40.0)).height(3.0, 3.0) == Height(3.0, False)
    vehicle.says(3.0, terrain(-7.0, spacing=0))  # it has no data here
    assert vehicle.height(3.1, 3.0) == Height(3.0, False)


@pytest.mark.parametrize(("clearance", "height"), [(1.2, 1.2), (20.0, 3.0), (math.nan, 3.0), (-1.0, 3.0)])
def test_the_estimate_of_the_clearance_may_say_less(vehicle: Vehicle, clearance: float, height: float) -> None:
    assert vehicle.says(1.0, altitude(clearance)).height(1.1, 3.0) == Height(pytest.approx(height), False)


BAROMETER = dialect.MAV_SYS_STATUS_SENSOR_ABSOLUTE_PRESSURE


def status(present: int, enabled: int | None = None, health: int | None = None) -> Any:
    """Enabled and healthy is what is present, when nothing is said."""
    bits = present, present if enabled is None else enabled, present if health is None else health
    return dialect.MAVLink_sys_status_message(*bits, 0, 0, -1, -1, 0, 0, 0, 0, 0, 0)


def gps(v_acc_mm: int, metres: float = 0.0) -> Any:
    return dialect.MAVLink_gps_raw_int_message(0, 3, 0, 0, round(metres * 1e3), 0, 0, 0, 0, 9, 0, 0, v_acc_mm)


@pytest.mark.parametrize("words", [status(0), status(BAROMETER, 0), status(BAROMETER, health=0)])
def test_without_rangefinder_and_barometer_gps_may_be_far_off(vehicle: Vehicle, words: Any) -> None:
    assert vehicle.says(1.0, words).height(1.1, 7.0) == Height(7.0, False, 6.0)
    (event,) = [event for event in vehicle.take_events() if isinstance(event, HeightSource)]
    assert (event.source, event.margin_m) == ("GPS", 6.0)


@pytest.mark.parametrize(("v_acc_mm", "margin"), [(1200, 3.6), (20, 1.5), (90_000, 15.0), (0, 6.0)])
def test_how_far_is_what_it_says_of_its_accuracy(vehicle: Vehicle, v_acc_mm: int, margin: float) -> None:
    assert vehicle.says(1.0, status(0), gps(v_acc_mm)).height(1.1, 7.0).margin == pytest.approx(margin)


@pytest.mark.parametrize("words", [[], [status(BAROMETER)], [status(0), pressure(0.0)], [status(0), distance(700)]])
def test_a_barometer_a_rangefinder_or_no_word_of_them_needs_no_margin(vehicle: Vehicle, words: list[Any]) -> None:
    assert vehicle.says(1.0, *words).height(1.1, 7.0).margin == 0.0
    assert "GPS" not in vehicle.height_sources()


def test_who_trusts_gps_gets_no_margin() -> None:
    vehicle = Vehicle(trust_gps=True)
    assert vehicle.says(1.0, status(0)).height(1.1, 7.0) == Height(7.0, False, 0.0)
    assert vehicle.height_sources() == ["GPS"]


def test_what_is_old_says_nothing(vehicle: Vehicle) -> None:
    vehicle.says(1.0, pressure(0.0), terrain(0.0)).arm()
    assert vehicle.says(1.0, altitude(1.0), pressure(1.0), distance(100), terrain(1.0)).height(1.5, 3.0).measured
    late = vehicle.height(9.0, 5.0)
    assert late == Height(
        pytest.approx(3.0), False, ground=pytest.approx(2.0)
    )  # of all that, the highest ground is left


@pytest.mark.parametrize("stranger", [(2, 1), (1, 99), (255, 190)])
def test_other_systems_and_components_say_nothing_of_the_ground(vehicle: Vehicle, stranger: tuple[int, int]) -> None:
    own = vehicle._encoder
    vehicle.says(1.0, pressure(0.0), terrain(-7.0)).arm()
    vehicle.says(2.0, pressure(3.0), terrain(-4.0))
    vehicle._encoder = Encoder(*stranger)
    assert vehicle.says(
        2.0, terrain(-9.0), distance(100), rangefinder(1.0), altitude(1.0), pressure(2.0), status(0)
    ).height(2.0, 3.0) == Height(pytest.approx(3.0, abs=0.01), False, ground=0.0)
    vehicle._encoder = own
    assert vehicle.says(2.0, terrain(-6.0)).height(2.1, 3.0) == Height(pytest.approx(1.0), False, ground=0.0)
    assert vehicle.height_sources() == ["estimate"]


# -- down a slope by the terrain database --------------------------------------------------------------------


class Slope(Vehicle):
    """Flies north at 2 m/s, 3 m above the ground as far as that is known, above a slope that falls by `fall` m a metre.

    `report`: what the autopilot's report is changed to, 2 a second; `terrain`: how it believes that the ground lies.
    `reach_m`: of its rangefinder.
    """

    def __init__(self, fall: float, terrain: float | None = None, reach_m: float = 0.0) -> None:
        super().__init__()
        self.reach_m = reach_m
        self.keeper = HeightKeeper(3.0, lambda event: None)
        self.fall, self.terrain = fall, fall if terrain is None else terrain
        self.now, self.north, self.above, self.velocity = 0.0, 0.0, 0.0, 0.0
        for _ in range(20):
            self.step(lambda report: report)
        self.arm()
        self.velocity = -1.0
        for _ in range(30):
            self.step(lambda report: report)
        self.velocity = 0.0

    def step(self, report: Callable[[Any], Any], north: float = 0.0) -> Height:
        """A tenth of a second."""
        self.now, self.north = self.now + 0.1, self.north + 0.1 * north
        self.above -= 0.1 * self.velocity
        ground = -self.terrain * self.north
        said = [pressure(self.above)]
        clear = self.above + self.fall * self.north
        if 0.2 < clear < self.reach_m:
            said.append(distance(round(100 * clear), high=round(100 * self.reach_m)))
        if round(self.now * 10) % 5 == 0:
            place = round((46 + self.north / 111_200) * 1e7), 70_000_000
            made = dialect.MAVLink_terrain_report_message(*place, 30, 1650 + ground, self.above - ground, 0, 10)
            said += [made] if (made := report(made)) else []
        self.says(self.now, *said)
        at, velocity = np.array([self.north, 0.0, -self.above]), np.array([0.0, 0.0, self.velocity])
        return self.ground.height(self.now, VehicleState(self.now, at, velocity, from_angles(0.0, 0.0, 0.0), 0.0))

    def fly(
        self, seconds: float, report: Callable[[Any], Any] = lambda report: report, speed: float = 2.0
    ) -> list[float]:
        """The true heights above the ground."""
        clear = []
        for _ in range(round(10 * seconds)):
            height = self.step(report, speed * self.keeper.pace)
            self.velocity = self.keeper.velocity(self.now, height)
            clear.append(self.above + self.fall * self.north)
        return clear


def test_above_level_ground_the_terrain_database_changes_nothing() -> None:
    slope = Slope(0.0)
    assert slope.fly(20) == pytest.approx([3.0] * 200, abs=0.05)
    assert slope.height_sources() == ["estimate"]


def test_down_a_slope_it_is_followed_ten_metres_higher_than_asked() -> None:
    slope = Slope(0.2)
    clear = slope.fly(60)
    assert clear[-1] == pytest.approx(13.0, abs=1.0)  # and not 27
    assert slope.height_sources() == ["estimate", "terrain"]
    for wrong_by in (0.05, -0.05):  # the slope is less steep than the database has it, or steeper
        assert min(Slope(0.2, 0.2 + wrong_by).fly(60)) > 2.9


def test_down_up_and_down_a_slope_what_is_followed_is_said_once() -> None:
    slope = Slope(0.4)
    for speed in (2.0, -2.0, 2.0):
        slope.fly(30, speed=speed)
    assert slope.height_sources() == ["estimate", "terrain"]


def changed(**values: Any) -> Callable[[Any], Any]:
    def report(made: Any) -> Any:
        for name, value in values.items():
            setattr(made, name, value)
        return made

    return report


class Frozen:
    """Says the same again and again, from the second report on."""

    def __init__(self) -> None:
        self.first: Any = None

    def __call__(self, made: Any) -> Any:
        self.first = self.first or made
        return self.first


class Delayed:
    """Says everything so many reports later."""

    def __init__(self, by: int) -> None:
        self.waiting: deque[Any] = deque([None] * by)

    def __call__(self, made: Any) -> Any:
        self.waiting.append(made)
        return self.waiting.popleft()


@pytest.mark.parametrize(
    "report",
    [
        Frozen(),
        changed(lat=460_100_000),  # of another place
        changed(current_height=60.0),  # higher than it is
        changed(terrain_height=1560.0),  # lower ground: a cliff under the take-off point
        changed(terrain_height=1560.0, current_height=93.0),  # both, so that they agree
        Delayed(10),  # 5 s old
    ],
)
@pytest.mark.parametrize("fall", [0.4, -0.3])
def test_reports_that_lie_are_not_followed_and_that_is_said(report: Callable[[Any], Any], fall: float) -> None:
    slope = Slope(fall)
    before = slope.above
    slope.fly(30, report)
    assert slope.above >= before - 0.05
    assert slope.height_sources() == ["estimate", "doubtful terrain"]
    slope.fly(5)
    assert slope.above >= before - 0.05  # not again in this flight


@pytest.mark.parametrize("report", [changed(spacing=0), changed(terrain_height=math.nan), lambda made: None])
def test_without_reports_it_climbs_back_to_the_take_off_height(report: Callable[[Any], Any]) -> None:
    slope = Slope(0.4)
    slope.fly(60)
    assert slope.above < -20
    slope.fly(45, report)
    assert slope.above == pytest.approx(3.0, abs=0.8)
    assert not slope.keeper.failed


@pytest.mark.parametrize("fall", [0.4, 0.8, -0.8])
def test_with_a_rangefinder_it_flies_no_faster_than_it_can_follow_the_ground(fall: float) -> None:
    slope = Slope(fall, reach_m=7.0)
    clear = slope.fly(80)
    assert min(clear) > 1.2  # of a slope that rises faster than it climbs
    assert max(clear) < 6.0
    assert abs(slope.north) > 30.0
    assert slope.height_sources()[-1] == "rangefinder"


def test_where_a_rangefinder_has_measured_the_database_is_not_followed() -> None:
    slope = Slope(0.4)
    slope.says(slope.now, distance(300))
    slope.step(lambda report: report)
    slope.fly(20)
    assert slope.above >= 2.9
    assert slope.height_sources() == ["estimate", "rangefinder", "highest ground"]


# -- sensors that lie ----------------------------------------------------------------------------------------


def disagreements(vehicle: Vehicle) -> list[tuple[str, str]]:
    return [(e.sensor, e.other) for e in vehicle.take_events() if isinstance(e, SensorsDisagree)]


def flown(vehicle: Vehicle, seconds: float, above: Callable[[float], float], *said: Callable[[float], Any]) -> Height:
    """The height after a hover of the reported altitude `above`, in which the sensors say something at each time."""
    vehicle.says(0.0, pressure(0.0), gps(1000)).arm()
    for n in range(round(5 * seconds)):
        vehicle.says(n * 0.2, *(say(n * 0.2) for say in said))
        height = vehicle.height(n * 0.2, above(n * 0.2))
    return height


def test_an_altitude_that_drifts_is_not_followed_down(vehicle: Vehicle) -> None:
    height = flown(vehicle, 100, lambda t: 3.0 + 0.05 * t, lambda t: pressure(3.0))
    assert height.metres == pytest.approx(3.0, abs=0.01)
    assert not height.still
    vehicle = Vehicle()
    height = flown(vehicle, 180, lambda t: 3.0 + 0.05 * t, lambda t: pressure(3.0))
    assert height.doubt
    assert disagreements(vehicle) == [("altitude", "barometer")]


@pytest.mark.parametrize("jump", [5.0, -5.0])
def test_an_altitude_that_jumps_moves_the_reference(vehicle: Vehicle, jump: float) -> None:
    height = flown(vehicle, 20, lambda t: 3.0 + jump * (t > 10), lambda t: pressure(3.0))
    assert height.metres == pytest.approx(3.0, abs=0.01)
    assert not height.still
    assert disagreements(vehicle) == [("altitude", "vertical speed")]


@pytest.mark.parametrize(("metres", "lowest"), [(-20.0, -17.0), (30.0, 3.0)])
def test_gps_is_compared_within_its_uncertainty(vehicle: Vehicle, metres: float, lowest: float) -> None:
    height = flown(vehicle, 17, lambda t: 3.0, lambda t: pressure(3.0), lambda t: gps(1000, metres))
    assert height.metres == pytest.approx(lowest, abs=0.01)
    assert height.doubt
    assert len(disagreements(vehicle)) == 2
    assert not flown(Vehicle(), 17, lambda t: 3.0, lambda t: gps(1000, 8.0)).still


def test_the_autopilots_clearance_may_doubt_a_rangefinder(vehicle: Vehicle) -> None:
    height = flown(vehicle, 17, lambda t: 3.0, lambda t: distance(300), lambda t: altitude(-1.0))
    assert not height.still
    vehicle = Vehicle()
    vehicle.says(0.0, pressure(0.0), distance(300), altitude(-1.0)).arm()
    assert vehicle.says(0.0, pressure(8.0), distance(800), altitude(2.0)).height(0.1, 8.0).metres == 2.0


def test_a_check_of_a_rangefinder_that_is_gone_does_not_hold_the_vehicle_for_ever(vehicle: Vehicle) -> None:
    def said(t: float) -> Any:
        return distance(round(300 + 30 * min(t, 10.0))) if t < 12 else pressure(3.0)

    assert flown(vehicle, 11.8, lambda t: 3.0, lambda t: pressure(3.0), said).still
    height = flown(Vehicle(), 20, lambda t: 3.0, lambda t: pressure(3.0), said)
    assert height.metres == pytest.approx(3.0, abs=0.01)
    assert not height.measured
    assert not height.still


def test_a_check_of_a_vehicle_that_never_rests_ends_the_search(vehicle: Vehicle) -> None:
    vehicle.says(0.0, pressure(0.0)).arm()
    for n in range(500):
        t = 0.2 * n
        vehicle.says(t, pressure(3.0), distance(round(300 + 4 * t)))
        place, velocity = np.array([0.5 * t, 0.0, -3.0]), np.array([0.5, 0.0, 0.0])
        height = vehicle.ground.height(t, VehicleState(t, place, velocity, (1.0, 0.0, 0.0, 0.0), 0.0))
    assert height.doubt
    assert disagreements(vehicle) == [("rangefinder", "vertical speed")]


def test_a_check_has_its_whole_time_again_after_a_gap_of_the_rangefinder(vehicle: Vehicle) -> None:
    """The ground falls, and the vehicle does not rest."""
    vehicle.says(0.0, pressure(0.0)).arm()
    for n in range(220):
        t = 0.2 * n
        said = [] if 7 < t < 40 else [distance(round(300 + 40 * min(t, 7.0)))]
        vehicle.says(t, pressure(3.0), *said)
        place, velocity = np.array([t, 0.0, -3.0]), np.array([1.0, 0.0, 0.0])
        height = vehicle.ground.height(t, VehicleState(t, place, velocity, (1.0, 0.0, 0.0, 0.0), 0.0))
    assert height.still
    assert disagreements(vehicle) == []


@pytest.mark.parametrize("off", [2.5, 5.0])
@pytest.mark.parametrize("words", [[], [status(0), gps(1000)]])
def test_a_rangefinder_that_is_off_from_the_start_is_known_by_the_altitude(
    vehicle: Vehicle, off: float, words: list[Any]
) -> None:
    """Without a barometer."""
    vehicle.says(0.0, *words).arm()
    for n in range(100):
        height = vehicle.says(0.2 * n, distance(round(300 + 100 * off)), *words).height(0.2 * n, 3.0)
        assert height.metres == pytest.approx(3.0, abs=0.01)
    assert height.doubt


@pytest.mark.parametrize("change", [4.0, -2.0])
def test_ground_that_changes_in_a_hover_is_doubted_until_it_is_as_before(vehicle: Vehicle, change: float) -> None:
    def said(t: float) -> Any:
        return distance(round(100 * (3.0 + change * (5 < t < 12))))

    during = flown(vehicle, 10, lambda t: 3.0, lambda t: pressure(3.0), said)
    assert during.metres == pytest.approx(min(3.0, 3.0 + change), abs=0.01)
    assert during.still
    assert disagreements(vehicle) == [("rangefinder", "vertical speed")]
    after = flown(Vehicle(), 18, lambda t: 3.0, lambda t: pressure(3.0), said)
    assert not after.still
    assert 2.4 < after.metres <= 3.0


@pytest.mark.parametrize(("seconds", "landed"), [(0.8, False), (1.2, True)])
def test_the_autopilots_own_report_of_a_landing_counts_after_a_second(
    vehicle: Vehicle, seconds: float, landed: bool
) -> None:
    for n in range(round(10 * seconds) + 1):
        vehicle.says(n * 0.1, dialect.MAVLink_extended_sys_state_message(0, dialect.MAV_LANDED_STATE_ON_GROUND))
    assert vehicle.height(seconds, 3.0).landed == landed
    assert not vehicle.height(seconds + 1.5, 3.0).landed  # the report is old


@pytest.mark.parametrize(
    ("ordered", "sinks", "landed"),
    [(0.3, 0.0, True), (0.3, 0.25, False), (-0.5, 0.0, False), (0.05, 0.05, False)],
)
def test_a_vehicle_at_rest_that_is_ordered_to_sink_stands(
    vehicle: Vehicle, ordered: float, sinks: float, landed: bool
) -> None:
    for n in range(50):
        state = VehicleState(0, np.array([0, 0, n * 0.2 * sinks - 3]), np.array([0, 0, sinks]), (1, 0, 0, 0), 0.0)
        height = vehicle.ground.height(n * 0.2, state, ordered)
    assert height.landed == landed


@pytest.mark.parametrize(("rests_s", "landed"), [(1.4, False), (1.8, True)])
def test_a_sink_may_begin_late(vehicle: Vehicle, rests_s: float, landed: bool) -> None:
    assert any(descent(vehicle, [(rests_s, 0.0), (1.0, 0.5)])) == landed


def test_a_stop_of_a_sink_that_has_begun_is_a_contact_at_once(vehicle: Vehicle) -> None:
    stands = descent(vehicle, [(1.4, 0.0), (1.0, 0.5), (1.0, 0.0)])
    assert not any(stands[:15])
    assert stands[-1]


def test_so_is_a_stop_of_a_slow_one_that_is_ordered_to_sink_faster_then(vehicle: Vehicle) -> None:
    assert descent(vehicle, [(1.0, 0.15), (1.0, 0.0)], 0.15) == [False] * 11
    assert any(descent(vehicle, [(1.0, 0.0)], begin=11))


def descent(vehicle: Vehicle, parts: list[tuple[float, float]], ordered: float = 0.5, begin: int = 0) -> list[bool]:
    """Order a hover to sink. `parts`: how long it sinks, and at which speed; returns when it stands."""
    above, stands = 10.0, []
    steps = [sinks for seconds, sinks in parts for _ in range(round(seconds / 0.2))]
    for n, sinks in enumerate(steps if begin else [0.0, *steps], begin):
        above -= 0.2 * sinks
        state = VehicleState(0, np.array([0.0, 0.0, -above]), np.array([0.0, 0.0, sinks]), (1.0, 0.0, 0.0, 0.0), 0.0)
        stands.append(vehicle.ground.height(n * 0.2, state, ordered if n else 0.0).landed)
    return stands


# -- a link that is silent -----------------------------------------------------------------------------------


def climb(t: float) -> tuple[float, float]:
    """Height [m] and climb [m/s]: from 1 m at 2 m/s to 5 m, and down again to 3 m."""
    if t < 2:
        return 1 + 2 * t, 2.0
    if t < 4:
        return 5.0, 0.0
    return (5 - 2 * (t - 4), -2.0) if t < 5 else (3.0, 0.0)


@pytest.mark.parametrize("silent_from", [1.1, 1.5, 1.9, 3.6, 4.2, 4.6])
@pytest.mark.parametrize("silent_s", [0.6, 0.8, 0.95])
def test_a_silence_in_a_climb_or_descent_is_no_error_of_a_sensor(
    vehicle: Vehicle, silent_from: float, silent_s: float
) -> None:
    """Until packets arrive again, the pose follows the last velocity, which the vehicle no longer has."""
    vehicle.says(0.0, pressure(0.0)).arm()
    known = 0.0
    for n in range(1, 200):
        t = n * 0.05
        if not silent_from < t < silent_from + silent_s:
            above, up = climb(t)
            vehicle.says(t, distance(round(100 * above)), pressure(above))
            known = t
        if n % 4 == 0:
            above, up = climb(known)
            place = np.array([0.0, 0.0, -above - up * (t - known)])
            pose = VehicleState(t, place, np.array([0.0, 0.0, -up]), (1.0, 0.0, 0.0, 0.0), t - known)
            height = vehicle.ground.height(t, pose)
    assert disagreements(vehicle) == []
    assert height.metres == pytest.approx(3.0, abs=0.1)
    assert not height.still


def test_poses_that_stay_old_do_not_hide_ground_that_rises(vehicle: Vehicle) -> None:
    vehicle.says(0.0, pressure(0.0)).arm()
    for n in range(50):
        t = n * 0.2
        vehicle.says(t, distance(300 if n < 10 else 240), pressure(3.0))
        pose = VehicleState(t, np.array([0.05 * n, 0.0, -3.0]), np.zeros(3), (1.0, 0.0, 0.0, 0.0), 0.5 if n else 0.0)
        height = vehicle.ground.height(t, pose)
    assert height.metres == pytest.approx(2.4, abs=0.05)


def test_between_two_samples_a_height_is_carried_down_with_the_vehicle(vehicle: Vehicle) -> None:
    """Truly 2.2 m; the motion in the first 0.3 s after a sample is not counted."""
    vehicle.says(0.0, pressure(0.0)).arm()
    for n in range(1, 19):
        t = n * 0.1
        sunk = max(0.0, t - 1.0)
        vehicle.says(t, pressure(5.0 - sunk), *([] if sunk else [distance(300)]))
        height = vehicle.height(t, 5.0 - sunk, sinks=1.0 if sunk else 0.0)
    assert 2.1 <= height.metres <= 2.45


# -- The height held, the least one, and the way down onto the place found --------------------------------


PLACE = (5.0, -3.0)


def ignored(event: Event) -> None: ...


def test_a_margin_is_flown_higher_and_has_time_to_be_climbed() -> None:
    keeper = HeightKeeper(3.0, ignored)
    assert keeper.velocity(0.0, Height(9.0, False, 6.0)) == 0.0
    assert keeper.wanted == 9.0
    assert keeper.velocity(1.0, Height(3.0, False, 6.0)) == -1.0
    assert keeper.too_low
    for time_s in (12.0, 16.9):
        keeper.velocity(time_s, Height(3.0, False, 6.0))
        assert not keeper.failed
    keeper.velocity(17.1, Height(3.0, False, 6.0))
    assert keeper.failed


def test_landing_is_left_to_the_autopilot_above_the_margin() -> None:
    descent = Descent((0.0, 0.0), 1.0, 0.0, 9.0)
    assert descent.velocity(0.0, (0.0, 0.0, -9.0), Height(9.0, False, 6.0))[2] > 0
    assert descent.velocity(1.0, (0.0, 0.0, -7.5), Height(7.5, False, 6.0)) == (0.0, 0.0, 0.0)
    assert descent.done


@given(st.floats(0.3, 100), st.floats(-100, 300), st.floats(0, 100))
def test_below_half_the_height_wanted_nothing_points_down(wanted: float, height: float, time_s: float) -> None:
    down = HeightKeeper(wanted, ignored).velocity(time_s, Height(height, False))
    assert -1.0 <= down <= 0.5
    if height < wanted / 2:
        assert down == -1.0


def test_a_height_that_is_no_number_is_climbed_from() -> None:
    assert HeightKeeper(3.0, ignored).velocity(0.0, Height(math.nan, False)) == -1.0


def test_too_low_is_said_once_and_holds_until_it_is_clear() -> None:
    events: list[Event] = []
    keeper = HeightKeeper(4.0, events.append)
    keeper.velocity(0.0, Height(4.0, False))
    assert not keeper.too_low
    assert keeper.velocity(1.0, Height(1.9, False)) == -1.0
    assert keeper.velocity(2.0, Height(2.5, False)) == -1.0
    assert keeper.too_low
    assert events == [TooLow(1.0, 1.9, 4.0)]
    keeper.velocity(3.0, Height(3.0, False))
    assert not keeper.too_low
    assert not keeper.failed


def test_on_the_way_up_from_the_take_off_there_is_nothing_to_say() -> None:
    events: list[Event] = []
    keeper = HeightKeeper(4.0, events.append)
    assert keeper.velocity(0.0, Height(1.0, False)) == -1.0
    assert keeper.too_low
    assert events == []


@every(
    "height, rises, seconds, failed",
    [(1.0, 0.0, 10.0, False), (1.0, 0.0, 10.5, True), (-30.0, 1.0, 40.0, False), (-1000.0, 1.0, 61.0, True)],
)
def test_what_does_not_get_up_has_failed(height: float, rises: float, seconds: float, failed: bool) -> None:
    """Far below it has time for the climb as long as it rises, but not for ever."""
    keeper = HeightKeeper(4.0 - rises, ignored)
    for time_s in np.arange(0.0, seconds + 0.05, 0.1).tolist():
        assert keeper.velocity(time_s, Height(height + rises * time_s, False)) <= 0.5
        assert failed or not keeper.failed
    assert keeper.failed == failed


# -- the way down ------------------------------------------------------------------------------------------


def sunk(start: tuple[float, float, float], *, measured: bool, drift: tuple[float, float] = (0.0, 0.0)) -> list[float]:
    """The way down of a point that follows velocities, and drifts; north, east, down and the time it took."""
    north, east, down = start
    descent = Descent(PLACE, 1.0, 100.0, -down)
    now = 100.0
    while not descent.done:
        v_n, v_e, v_d = descent.velocity(now, (north, east, down), Height(-down, measured))
        assert math.hypot(v_n, v_e) <= 1.0 + 1e-9
        assert -0.5 <= v_d <= 0.5
        if math.dist((north, east), PLACE) > 0.5:
            assert v_d <= 0
        north, east, down = north + (v_n + drift[0]) * 0.1, east + (v_e + drift[1]) * 0.1, down + v_d * 0.1
        now += 0.1
        assert now < 300
    return [north, east, down, now - 100.0]


@every("measured, lowest", [(True, 0.5), (False, 1.5)])
@every("drift", [(0.0, 0.0), (0.1, 0.05)])
def test_it_comes_down_on_the_place_and_leaves_the_rest_to_the_landing(
    measured: bool, lowest: float, drift: tuple[float, float]
) -> None:
    north, east, down, _ = sunk((0.0, 0.0, -4.0), measured=measured, drift=drift)
    assert math.dist((north, east), PLACE) < 0.2
    assert lowest < -down < lowest + 0.15


def test_what_is_low_beside_the_place_climbs_and_goes_there() -> None:
    north, east, down, _ = sunk((4.0, -3.0, -1.0), measured=False)
    assert math.dist((north, east), PLACE) < 0.5
    assert 1.0 < -down < 1.65


@every(
    "place, height",
    [
        (PLACE, Height(0.6, True)),
        (PLACE, Height(0.1, True)),
        (PLACE, Height(3.0, True, landed=True)),
        (PLACE, Height(3.0, True, doubt="the rangefinder says 8.0 m, and the vertical speed 3.0 m")),
        ((50.0, 0.0), Height(0.29, True)),
    ],
)
def test_low_on_the_ground_or_without_a_sure_height_the_autopilot_lands_at_once(
    place: tuple[float, float], height: Height
) -> None:
    descent = Descent(PLACE, 1.0, 0.0, 3.0)
    assert descent.velocity(1.0, (*place, -3.0), height) == (0.0, 0.0, 0.0)
    assert descent.done


def test_through_the_height_of_rest_it_comes_up_again() -> None:
    descent = Descent(PLACE, 1.0, 0.0, 3.0)
    *_, down = descent.velocity(1.0, (PLACE[0] + 0.3, PLACE[1], -0.8), Height(0.8, True))
    assert down == pytest.approx(-0.2)
    assert not descent.done


def test_it_flies_on_only_while_the_height_is_sure() -> None:
    keeper = HeightKeeper(3.0, ignored)
    keeper.velocity(0.0, Height(3.0, True, still=True))
    assert keeper.pace == 0.0
    keeper.velocity(0.2, Height(3.0, True))
    assert keeper.pace == 1.0


@pytest.mark.parametrize("noise_m", [0.0, 0.3])
@pytest.mark.parametrize("fall", [0.0, 0.3])
@pytest.mark.parametrize("rate", [0.02, 0.05, 0.3, 0.5])
def test_a_rangefinder_that_drifts_is_found_above_half_the_height(rate: float, fall: float, noise_m: float) -> None:
    """Level ground for 50 s, then ground that falls by `fall` m a metre; the lie begins at any time of that."""
    for from_s in (0.0, 30.0, 55.0, 70.0):
        check, keeper, noise = RangeCheck(0.9), HeightKeeper(3.0, ignored), random.Random(1)
        above = highest = 3.0
        flown, speed, found, pressed = 0.0, 0.5, False, 0.0
        for n in range(2500):
            time_s, ground = 0.1 * n, -fall * max(0.0, flown - 25.0)
            shown = above - ground + rate * max(0.0, time_s - from_s)
            pressed += (noise.gauss(0.0, noise_m) - pressed) * 0.1
            highest = max(highest, above + pressed - shown)
            motion = Odometry(time_s, above - 3.0, flown, speed, (flown, 0.0))
            lowest = check.height(motion, shown, shown, {"barometer": above + pressed - highest})
            assert lowest is not None
            assert above - ground > 1.5, f"lie from {from_s} s"
            found = found or bool(check.deviation(time_s))
            if found:
                break
            above -= 0.1 * keeper.velocity(time_s, Height(lowest, True, still=check.drift.still))
            speed = 0.5 * keeper.pace
            flown += 0.1 * speed
        assert found, f"lie from {from_s} s"


@pytest.mark.parametrize(
    "off",
    [
        pytest.param(lambda t: max(0.0, 0.02 * (t - 60)), id="rises with the rangefinder"),
        pytest.param(lambda t: max(0.0, 0.02 * (t - 60)) - min(2.5, t / 8), id="was too low before"),
    ],
)
@pytest.mark.parametrize("wrong", ["altitude", "barometer"])
def test_an_altitude_that_is_wrong_hides_no_drift(vehicle: Vehicle, wrong: str, off: Callable[[float], float]) -> None:
    """One altitude is right. The rangefinder drifts from 60 s on."""
    keeper, above, sinks = HeightKeeper(3.0, ignored), 3.0, 0.0
    vehicle.says(0.0, pressure(0.0)).arm()
    for n in range(1, 1000):
        t = 0.2 * n
        altitudes = {"altitude": above, "barometer": above, wrong: above + off(t)}
        vehicle.says(t, pressure(altitudes["barometer"]), distance(round(100 * (above + max(0.0, 0.02 * (t - 60))))))
        height = vehicle.height(t, altitudes["altitude"], sinks=sinks)
        sinks = keeper.velocity(t, height)
        above -= 0.2 * sinks
        assert above > 1.8
    assert height.doubt


@pytest.mark.parametrize("noise_cm", [1.0, 4.0])
@pytest.mark.parametrize("shown", [3.95, 4.1, 4.5, 5.5])
def test_a_rangefinder_that_is_stuck_is_not_followed_down(vehicle: Vehicle, shown: float, noise_cm: float) -> None:
    """Its values have noise. It seems to be above falling ground, which does not fall below a hover."""
    keeper, noise = HeightKeeper(3.0, ignored), random.Random(1)
    above, north, speed, sinks = shown, 0.0, 0.0, 0.0
    vehicle.says(0.0, pressure(0.0)).arm()
    for n in range(1, 400):
        t = 0.2 * n
        vehicle.says(t, pressure(above), distance(round(100 * shown + noise.gauss(0.0, noise_cm))))
        place, velocity = np.array([north, 0.0, -above]), np.array([speed, 0.0, sinks])
        height = vehicle.ground.height(t, VehicleState(t, place, velocity, (1.0, 0.0, 0.0, 0.0), 0.0))
        sinks += (keeper.velocity(t, height) - sinks) * 0.5
        speed += (keeper.pace - speed) * 0.4
        above, north = above - 0.2 * sinks, north + 0.2 * speed
        assert above > 1.8


def test_a_drift_that_was_not_checked_yet_orders_no_flight_aside_on_the_ground(vehicle: Vehicle) -> None:
    """It lands 0.2 m beside the place."""
    keeper, descent = HeightKeeper(3.0, ignored), Descent((0.2, 0.0), 1.0, 40.0, 3.0)
    above, aside, sinks, t = 3.0, 0.0, 0.0, 0.0
    vehicle.says(0.0, pressure(0.0)).arm()
    while not descent.done:
        t += 0.2
        vehicle.says(t, pressure(above), distance(round(100 * (above + min(0.02 * t, 0.8)))))
        height = vehicle.height(t, above, sinks=sinks)
        sinks = keeper.velocity(t, height)
        if t >= 40:
            aside, _, sinks = descent.velocity(t, (0.0, 0.0, -above), height)
        above = max(0.0, above - 0.2 * sinks)
        assert above > 0.3 or not aside
    assert t < 60


def test_a_check_that_failed_is_repeated_for_8_s() -> None:
    """A change that is too small for a short check."""
    check = RangeCheck(0.9)
    for n in range(480):
        time_s, flown = 0.1 * n, min(0.1 * n, 30.0)
        shown = 3.0 + 0.018 * time_s + 0.05 * (time_s > 33)
        motion = Odometry(time_s, 0.0, flown, float(time_s < 30), (flown, 0.0))
        check.height(motion, shown, shown, {"barometer": shown - 2.5 * (time_s > 30)})
    assert check.deviation(48.0)


@pytest.mark.parametrize("fall", [0.1, 0.3, 0.5])
def test_a_true_rangefinder_above_falling_ground_is_not_called_drifting(fall: float) -> None:
    check, keeper, noise = RangeCheck(0.9), HeightKeeper(3.0, ignored), random.Random(1)
    above, flown, speed = 3.0, 0.0, 0.0
    for n in range(3000):
        time_s, ground = 0.1 * n, -fall * flown
        shown = round(above - ground + noise.gauss(0.0, 0.01), 2)
        motion = Odometry(time_s, above - 3.0, flown, speed, (flown, 0.0))
        lowest = check.height(motion, shown, shown, {"barometer": above})
        assert lowest is not None
        assert check.deviation(time_s) is None
        assert above - ground < 6.0
        above -= 0.1 * keeper.velocity(time_s, Height(lowest, True, still=check.drift.still))
        speed += (keeper.pace - speed) * 0.2
        flown += 0.1 * speed
    assert flown > 100.0


@pytest.mark.parametrize(("gap_s", "height"), [(5.0, 9.0), (100.0, 3.0)])
def test_ground_that_is_lower_after_a_long_silence_is_not_believed(gap_s: float, height: float) -> None:
    """A rangefinder that says 6 m more may be wrong, or the ground may have fallen on the way of 16 m."""
    check = RangeCheck(0.9)
    check.height(Odometry(0.0, 0.0, 0.0, 0.0, (0.0, 0.0)), 3.0, 3.0, {"barometer": 3.0})
    there = Odometry(gap_s, 0.0, 16.0, 1.0, (16.0, 0.0))
    assert check.height(there, 9.0, 9.0, {"barometer": 9.0}) == pytest.approx(height)


def test_ground_that_slopes_below_a_descent_is_no_drift() -> None:
    check = RangeCheck(0.9)
    for n in range(200):
        time_s = 0.1 * n
        sunk, aside = 0.45 * max(0.0, time_s - 12.5), 0.2 * max(0.0, time_s - 12.5)
        metres = 5.0 - sunk + 0.4 * aside
        check.height(Odometry(time_s, -sunk, aside, 0.2, (aside, 0.0)), metres, metres, {"barometer": metres - 2.0})
    assert check.deviation(20.0) is None


@pytest.mark.parametrize(("climb", "stuck"), [(0.4, False), (1.5, True)])
def test_one_value_above_a_slope_that_is_followed_is_not_stuck(climb: float, stuck: bool) -> None:
    check = RangeCheck(0.9)
    motions = [Odometry(0.1 * n, 0.1 * n * climb, 0.1 * n, 1.0, (0.1 * n, 0.0)) for n in range(20)]
    heights = [check.height(motion, 2.69, 2.69, {"barometer": 2.69}) for motion in motions]
    assert (None in heights) is stuck


def test_a_place_that_is_not_reached_is_not_waited_for_for_ever() -> None:
    _, _, down, took = sunk((0.0, 0.0, -4.0), measured=True, drift=(-2.0, 0.0))
    assert took == pytest.approx(50, abs=1)
    assert down == -4.0
