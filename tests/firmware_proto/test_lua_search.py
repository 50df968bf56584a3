"""The search inside ArduPilot: it finds, it steers only when asked to, and it gives the vehicle back."""

from __future__ import annotations

import math
import shutil
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import pytest

from arva_hil import config
from arva_hil.emulator.build import receiver, transmitters
from arva_hil.emulator.receivers import frame_of
from arva_hil.model.field import LocalFrame, Mount, Transmitters, rotation
from arva_hil.model.receiver import Antennas, Look, Pose
from arva_hil.model.receiver.maps import readings
from arva_hil.search.strategies.flux import Flux
from arva_hil.search.strategies.strategy import Observation
from firmware_proto import INNER, NOT_SEARCHING, SELF_TEST_FAULT, SYNTHETIC, Channel, Decoder, Frame, encode
from tests.every import every
from tests.firmware_proto.lua_stubs import FOLDER, GUIDED, LOITER, Autopilot

NAME = "arva_search"
CONFIGS = Path(__file__).parents[2] / "configs"
PREFIX = "ARVS: "
STABILIZE, RTL = 0, 6
NEAR = Channel(7, 1, 900, 20)


class Flight:
    """Remembers the vehicle, which follows velocities with a lag, and the frames it was sent."""

    def __init__(self, case=1, hertz=5, folder=FOLDER, **params):
        chosen = config.load(CONFIGS / f"paper_case_{case}.yaml")
        self.receiver = receiver(chosen)
        self.transmitters = transmitters(chosen, LocalFrame(47.0, 8.0, 488.0))
        self.autopilot = Autopilot(folder, **params)
        self.autopilot.start(NAME)
        self.hertz = hertz
        self.ground = None  # its down at a place north and east, for the rangefinder
        self.lowest = math.inf  # above it
        self.channels = None  # instead of what the receiver hears; its directions tremble
        self.stuck = None  # the channels of a receiver that says the same for ever
        self.status = SYNTHETIC
        self.repeats = False  # the same frame again and again, its number too
        self._velocity = [0.0] * 3
        self._frames = 0
        self._next_frame = self.autopilot.time_ms

    @property
    def transmitter(self):
        return self.transmitters.positions[0]

    def fly(self, seconds, until=lambda _: False):
        autopilot = self.autopilot
        attitude = rotation.from_euler(0, 0, autopilot.yaw)
        for _ in range(round(seconds * 50)):
            if self.hertz and autopilot.time_ms >= self._next_frame:
                self._next_frame = autopilot.time_ms + 1000 / self.hertz
                autopilot.receive(encode(self._frame(attitude)))
                self._frames += not self.repeats
            autopilot.run(autopilot.time_ms + 20)
            fresh = autopilot.velocity is not None and autopilot.time_ms - autopilot.velocity_ms < 3000
            wanted = autopilot.velocity if fresh and autopilot.mode == GUIDED else (0, 0, 0)
            self._velocity = [v + (w - v) * 0.05 for v, w in zip(self._velocity, wanted, strict=True)]
            autopilot.position = [x + v * 0.02 for x, v in zip(autopilot.position, self._velocity, strict=True)]
            self._measure()
            if until(autopilot):
                return True
        return False

    def after(self, seconds):
        """Fly on for so long."""
        self.fly(seconds)
        return self

    def hear(self, channels, seconds):
        """Fly while the receiver says this."""
        self.channels = channels
        self.fly(seconds)

    def _measure(self):
        if self.ground:
            north, east, down = self.autopilot.position
            self.autopilot.range = self.ground(north, east) - down
            self.lowest = min(self.lowest, self.autopilot.range)

    def _frame(self, attitude):
        if self.stuck is not None:
            return Frame(self._frames % 256, self.status, tuple(self.stuck))
        if self.channels is not None:
            trembling = (c._replace(delta=c.delta + self._frames % 2) for c in self.channels)
            return Frame(self._frames % 256, self.status, tuple(trembling))
        made = frame_of(self.reading(self.autopilot.position, attitude), self._frames % 256)
        return made._replace(status=made.status | self.status)

    def reading(self, position, attitude):
        pose = Pose(*Mount().pose(np.array(position), attitude))
        self.receiver.look(Look(0.0, pose, self.transmitters))
        return self.receiver.show(0.0)

    def said(self):
        return [text.removeprefix(PREFIX) for text in self.autopilot.said() if text.startswith(PREFIX)]

    @property
    def steered(self):
        """Whether it was in the last second."""
        autopilot = self.autopilot
        return autopilot.velocity is not None and autopilot.time_ms - autopilot.velocity_ms < 1000

    @property
    def moved(self):
        return self.steered and math.hypot(*self.autopilot.velocity[:2]) > 0.1


@pytest.fixture
def flight():
    """A search that is under way."""
    begun = Flight(ARVS_ENABLE=1)
    begun.fly(5)
    assert begun.moved
    assert begun.said()[0] == "search begins"
    return begun


@pytest.mark.parametrize(("case", "yaw"), [(2, 2.5), (3, 0.0)])
def test_it_stops_at_the_transmitter(case, yaw):
    flight = Flight(case, hertz=1, ARVS_ENABLE=1)
    flight.autopilot.yaw = yaw
    assert flight.fly(300, until=lambda autopilot: autopilot.place)
    assert math.dist(flight.autopilot.place[:2], flight.transmitter[:2]) < 1
    assert flight.autopilot.place[2] == pytest.approx(-2, abs=0.2)
    first, going, found = flight.said()
    assert (first, going[:25]) == ("search begins", "going for transmitter 1, ")
    north, east = flight.autopilot.place[:2]
    lat, lng = 473977420 + round(north * 89.8), 85455940 + round(east * 131.0)
    assert found == f"found 1 at {lat / 1e7:.7f} {lng / 1e7:.7f} +-{2 if case == 3 else 1}m"
    assert flight.autopilot.mode == GUIDED
    assert flight.autopilot.params["ARVS_ENABLE"] == 0
    place = flight.autopilot.place
    assert flight.after(5).autopilot.place == place  # nothing was ordered since


@pytest.mark.parametrize("seed", [1, 6])
def test_the_strategy_is_the_one_of_the_python_client(seed):
    """Side by side through readings that come and go, the same velocities are flown and the same place is found."""
    random = Random(seed)
    flight = Flight(1 + seed % 4)
    python, lua = Flux(1.0), flight.autopilot.require(NAME).Flux(1.0)
    attitude = rotation.from_euler(0, 0, random.uniform(-3, 3))
    place = [random.uniform(-10, 10), random.uniform(-10, 10), random.uniform(-3, -0.5)]
    for step in range(1500):
        time_ms = 203 * step
        if step % 5 == 0:
            _, matrix = Mount().pose(np.array(place), attitude)
            channel = flight.reading(place, attitude).channels[0]
            deaf = random.random() < 0.1 or 100 < step < 100 + 20 * seed
            seen = Observation(
                time_ms / 1000,
                tuple(place),
                matrix,
                -1 if deaf else channel.d_cm,
                channel.delta_deg,
                channel.zone == INNER,
            )
            python.observe(seen)
            lua.hear(time_ms, *place[:2], seen.bearing, None if deaf else seen.d_m, seen.inner)
        velocity = python.velocity(time_ms / 1000, tuple(place))
        assert lua.velocity(*place[:2]) == pytest.approx(velocity, abs=1e-6)
        if python.found:
            break
        place[:2] = [x + 0.203 * v for x, v in zip(place, velocity, strict=False)]
    assert lua.found() == pytest.approx(python.found[:2], abs=1e-6)


def test_at_50_hertz_too_and_nothing_costs_more_than_the_engine_allows():
    flight = Flight(4, hertz=50, ARVS_ENABLE=1)
    flight.autopilot.limit = 8000
    assert flight.fly(300, until=lambda autopilot: autopilot.place)
    assert math.dist(flight.autopilot.place[:2], flight.transmitter[:2]) < 1
    counters = [fields for name, fields in flight.autopilot.rows if name == "ARVC"][-1]
    assert (counters["Drop"], counters["Lost"]) == (0, 0)


def test_south_and_west_have_their_signs():
    flight = Flight(4, hertz=1, ARVS_ENABLE=1)
    flight.autopilot.origin = (-12, -700000001)
    assert flight.fly(300, until=lambda autopilot: autopilot.place)
    north, east = flight.autopilot.place[:2]
    assert flight.said()[-1] == (
        f"found 1 at {(-12 + round(north * 89.8)) / 1e7:.7f} {(-700000001 + round(east * 131.0)) / 1e7:.7f} +-1m"
    )


def test_the_speed_is_not_exceeded_and_the_height_is_held(flight):
    flight.fly(15)
    rows = [fields for name, fields in flight.autopilot.rows if name == "ARVS"]
    assert max(math.hypot(row["VN"], row["VE"]) for row in rows) <= 1
    assert [row["Hgt"] for row in rows[-10:]] == pytest.approx([2] * 10, abs=0.05)


@pytest.mark.parametrize("speed", [0.3, 0, -1])
def test_a_lower_speed_holds_at_once(flight, speed):
    flight.autopilot.params["ARVS_SPEED"] = float(speed)
    flight.fly(0.2)
    assert math.hypot(*flight.autopilot.velocity[:2]) == pytest.approx(max(0, speed), abs=1e-6)


def test_nothing_is_flown_unless_it_is_asked_for():
    flight = Flight()
    assert flight.after(5).autopilot.velocity is None
    assert flight.said() == []


@pytest.mark.parametrize("state", [{"mode": LOITER}, {"armed": False}, {"flying": False}, {"taking_off": True}])
def test_it_waits_until_the_vehicle_flies_in_guided(state):
    flight = Flight(ARVS_ENABLE=1)
    for name, value in state.items():
        setattr(flight.autopilot, name, value)
    assert flight.after(5).autopilot.velocity is None
    assert flight.said() == ["search begins when flying in GUIDED"]
    for name, value in {"mode": GUIDED, "armed": True, "flying": True, "taking_off": False}.items():
        setattr(flight.autopilot, name, value)
    assert flight.after(2).moved


@every(
    "state, text",
    [
        ({"failsafed": True}, "low battery"),
        ({"breaches": 2}, "fence breached"),
        ({"has_position": False}, "no position"),
        ({"sticks": {"ROLL": 0.3, "PITCH": 0.0, "YAW": 0.0, "THROTTLE": 0.0}}, "pilot input"),
    ],
)
def test_it_does_not_begin_what_it_would_have_to_end(state, text):
    flight = Flight(ARVS_ENABLE=1)
    for name, value in state.items():
        setattr(flight.autopilot, name, value)
    assert flight.after(5).autopilot.velocity is None
    assert flight.said()[-1] == f"cannot search: {text}"


def test_without_a_receiver_it_does_not_begin():
    flight = Flight(hertz=0, ARVS_ENABLE=1)
    assert flight.after(5).autopilot.velocity is None
    assert flight.said() == ["cannot search: no receiver"]
    flight.hertz = 5
    assert flight.after(3).moved


def push(stick, value):
    def act(flight):
        flight.autopilot.sticks[stick] = value

    return act


def set_(**state):
    def act(flight):
        for name, value in state.items():
            setattr(flight.autopilot, name, value)

    return act


def unplug(flight):
    flight.hertz = 0


def switch_off(flight):
    flight.autopilot.params["ARVS_ENABLE"] = 0.0


@pytest.mark.parametrize(
    ("act", "text"),
    [
        (push("ROLL", 0.2), "pilot input"),
        (push("PITCH", -0.2), "pilot input"),
        (push("YAW", 0.2), "pilot input"),
        (push("THROTTLE", 0.18), "pilot input"),
        (set_(failsafed=True), "low battery"),
        (set_(breaches=1), "fence breached"),
        (set_(has_position=False), "no position"),
        (unplug, "receiver lost"),
        (switch_off, "switched off"),
    ],
)
def test_it_hands_back_to_loiter(flight, act, text):
    act(flight)
    assert flight.fly(4, until=lambda autopilot: autopilot.mode == LOITER)
    assert flight.said()[-1] == f"{text}: search ends"
    assert flight.autopilot.velocity == (0, 0, 0)
    assert flight.autopilot.params["ARVS_ENABLE"] == 0
    stopped = flight.autopilot.velocity_ms
    assert flight.after(5).autopilot.velocity_ms == stopped


def test_it_hovers_until_loiter_would_hold_the_height(flight):
    """With the throttle stick at the bottom LOITER sinks to the ground."""
    flight.autopilot.sticks["THROTTLE"] = -1.0
    assert flight.after(10).autopilot.mode == GUIDED
    assert flight.autopilot.velocity == (0, 0, 0)
    assert flight.said() == ["pilot input: search ends", "throttle to the middle for LOITER"]
    flight.autopilot.sticks["THROTTLE"] = -0.1
    assert flight.after(1).autopilot.mode == LOITER


def test_without_a_radio_it_hovers_in_guided(flight):
    flight.autopilot.rc = False
    flight.autopilot.sticks["ROLL"] = 1.0
    assert flight.after(1).moved
    unplug(flight)
    assert flight.after(60).autopilot.mode == GUIDED
    assert flight.autopilot.velocity == (0, 0, 0)
    assert flight.said() == ["receiver lost: search ends"]


@pytest.mark.parametrize("mode", [LOITER, RTL, STABILIZE])
def test_a_mode_that_is_not_guided_is_left_alone(flight, mode):
    flight.autopilot.mode = mode
    ordered = flight.autopilot.velocity_ms
    assert flight.after(10).autopilot.mode == mode
    assert flight.autopilot.velocity_ms == ordered
    assert flight.said() == ["not in GUIDED any more: search ends"]
    flight.autopilot.mode = GUIDED
    assert flight.after(5).autopilot.velocity_ms == ordered


def test_the_pilot_gets_loiter_after_the_transmitter_is_found_too():
    flight = Flight(4, hertz=1, ARVS_ENABLE=1)
    assert flight.fly(300, until=lambda autopilot: autopilot.place)
    assert flight.after(20).autopilot.mode == GUIDED
    flight.autopilot.sticks["PITCH"] = 0.5
    assert flight.after(1).autopilot.mode == LOITER


def test_one_search_for_each_enabling(flight):
    unplug(flight)
    flight.fly(5)
    flight.hertz = 5
    flight.autopilot.mode = GUIDED
    assert not flight.after(5).steered
    flight.autopilot.params["ARVS_ENABLE"] = 1.0
    assert flight.after(2).moved


def test_the_switch_begins_and_ends():
    flight = Flight(ARVS_ENABLE=2, ARVS_SWITCH=302)
    switches = flight.autopilot.switches
    for position in (None, 0, 1):
        switches[302] = position
        assert flight.after(2).autopilot.velocity is None
    switches[302] = 2
    assert flight.after(5).moved
    switches[302] = 1
    assert flight.after(1).autopilot.mode == LOITER
    assert flight.said()[-1] == "switched off: search ends"
    flight.autopilot.mode = GUIDED
    assert not flight.after(2).moved
    switches[302] = 2
    assert flight.after(2).moved
    assert flight.autopilot.params["ARVS_ENABLE"] == 2
    flight.autopilot.mode = LOITER
    flight.fly(1)
    flight.autopilot.mode = GUIDED
    assert not flight.after(2).steered  # the switch has to go down first


def test_a_receiver_that_is_silent_for_two_seconds_is_waited_for(flight):
    unplug(flight)
    assert flight.after(2.6).steered
    assert flight.autopilot.velocity[:2] == (0, 0)
    flight.hertz = 5
    assert flight.after(2).moved
    assert "search ends" not in " ".join(flight.said())


def test_a_search_without_a_signal_hovers_and_ends():
    flight = Flight(ARVS_ENABLE=1)
    flight.hear([Channel()], 59)
    assert flight.steered
    assert not flight.moved
    assert flight.after(3).said() == ["search begins", "no signal for 60 s: search ends"]


@pytest.mark.parametrize(
    ("params", "text"),
    [({"ARVS_TIME": 30}, "not found in 30 s"), ({"ARVS_RADIUS": 10, "ARVS_TIME": 60}, "10 m away")],
)
def test_limits(params, text):
    flight = Flight(3, ARVS_ENABLE=1, **params)
    flight.hear([Channel(1, 1, 3000, 30)], 50)
    assert flight.said()[-1] == f"{text}: search ends"


@every(
    "above_ground, above_terrain, params, sinks",
    [
        (2.5, 4.0, {}, 0.5),
        (1.5, 30.0, {}, -1.0),
        (30.0, 1.0, {}, 1.0),
        (None, None, {}, 0.0),  # 3 m above home
        (None, None, {"ARVS_ALT": 3.4}, -0.8),
        (None, 1.2, {}, -1.0),
        (None, 1.2, {"ARVS_TERRAIN": 0}, 0.0),
        (None, 30.0, {}, 0.0),
    ],
)
def test_only_the_rangefinder_lets_it_sink_terrain_and_home_let_it_climb(above_ground, above_terrain, params, sinks):
    flight = Flight(ARVS_ENABLE=1, **params)
    autopilot = flight.autopilot
    autopilot.range, autopilot.terrain = above_ground, above_terrain
    autopilot.position, autopilot.home_down = [0.0, 0.0, 5.0], 8.0
    flight.fly(5, until=lambda autopilot: autopilot.velocity)
    assert autopilot.velocity[2] == pytest.approx(sinks, abs=0.1)


def test_from_50_metres_it_does_not_sink_to_where_a_slope_would_be():
    flight = Flight(4, hertz=5, ARVS_ENABLE=1)
    flight.autopilot.position, flight.autopilot.home_down = [0.0, 0.0, -53.0], 0.0
    flight.hear([Channel(1, 1, 3000, 30)], 40)
    assert flight.said()[:2] == ["search begins", "no rangefinder: stays at 53 m"]
    assert flight.moved
    assert flight.autopilot.position[2] == pytest.approx(-53, abs=0.1)


def test_the_terrain_database_is_followed_at_the_height_of_the_beginning():
    flight = Flight(ARVS_ENABLE=1)
    flight.autopilot.terrain = 20.0
    flight.fly(5)
    flight.autopilot.terrain = 18.5  # the slope rises
    assert flight.after(1).autopilot.velocity[2] == pytest.approx(-1)
    assert flight.moved
    flight.autopilot.terrain = 21.0
    assert flight.after(1).autopilot.velocity[2] == pytest.approx(1)
    flight.autopilot.terrain = None  # the database ends here
    assert flight.after(1).autopilot.velocity == (0, 0, 0)


@pytest.mark.parametrize(("grade", "speed"), [(-1.0, 3), (1.0, 1), (2.0, 3)])
def test_with_a_rangefinder_no_slope_comes_nearer_than_a_third_of_the_height(grade, speed):
    flight = Flight(3, ARVS_ENABLE=1, ARVS_SPEED=speed, ARVS_ALT=3)
    flight.autopilot.position = [0.0, 0.0, -3.0]
    flight.ground = lambda north, east: -grade * north
    flight.channels = [Channel(1, 1, 3000, 0)]  # to the north
    assert flight.after(25).autopilot.position[0] > 3
    assert flight.lowest > 1
    assert "search ends" not in " ".join(flight.said())


@pytest.mark.parametrize(("grade", "bearing", "depth"), [(0.58, 2.0, 1.5), (1.0, 2.0, 1.5)])  # 30° and 45°
def test_on_a_slope_it_finds_the_transmitter_and_holds_most_of_the_height(grade, bearing, depth):
    """d is least where the transmitter is at a right angle to the slope, and not where it is below."""
    flight = Flight(4, hertz=1, ARVS_ENABLE=1)
    north, east, down = flight.transmitter
    rise_n, rise_e = grade * math.cos(bearing), grade * math.sin(bearing)
    flight.ground = lambda n, e: down - depth - rise_n * (n - north) - rise_e * (e - east)
    flight.autopilot.range = 2.0
    flight.autopilot.position[2] = flight.ground(0, 0) - 2.0
    assert flight.fly(300, until=lambda autopilot: autopilot.place)
    assert math.dist(flight.autopilot.place[:2], flight.transmitter[:2]) < 1
    assert flight.said()[-1][-5:] in (" +-1m", " +-2m")
    assert (
        flight.ground(*flight.autopilot.place[:2]) - flight.autopilot.place[2] > 1.5
    )  # an order without the rangefinder
    assert flight.lowest > 1.5


def test_the_beam_of_a_vehicle_that_leans_is_longer_than_the_height(flight):
    autopilot = flight.autopilot
    autopilot.range, autopilot.roll, autopilot.pitch = 2.1, 0.3, -0.4
    flight.fly(1)
    (row,) = {fields["Hgt"] for name, fields in autopilot.rows[-5:] if name == "ARVS"}
    assert row == pytest.approx(2.1 * math.cos(0.3) * math.cos(0.4))
    assert autopilot.velocity[2] == pytest.approx(2 * (row - 2), abs=1e-6)


def test_a_search_ends_when_the_rangefinder_it_began_with_measures_no_more(flight):
    flight.ground = lambda north, east: 0.0
    assert flight.after(2).moved
    flight.ground = flight.autopilot.range = None
    assert flight.after(1).autopilot.velocity == (0, 0, 0)
    flight.ground = lambda north, east: 0.0
    assert flight.after(1).moved
    flight.ground = flight.autopilot.range = None
    assert flight.after(3).said()[-1] == "rangefinder lost: search ends"
    assert flight.autopilot.mode == LOITER


@pytest.mark.parametrize(("above", "noise"), [(0.3, 0.1), (0.5, 0.0), (3.0, 0.03)])
def test_a_rangefinder_that_is_stuck_above_the_height_does_not_lead_to_the_ground(above, noise):
    random = Random(457)
    flight = Flight(ARVS_ENABLE=1)
    flight.autopilot.position[2] = -2.0 - above
    flight.ground = lambda north, east: 0.0
    assert flight.fly(20, until=lambda autopilot: math.hypot(*autopilot.position[:2]) > 2)
    flight.ground = None
    for _ in range(500):
        flight.autopilot.range = random.gauss(2 + above, noise)
        flight.fly(0.1)
        assert flight.autopilot.position[2] < -0.5
    assert flight.said()[-1] == "rangefinder lost: search ends"


def test_a_rangefinder_that_jumps_is_waited_for_at_the_same_height(flight):
    flight.ground = lambda north, east: 0.0
    assert flight.after(1).moved
    flight.ground = lambda north, east: 8.0
    assert flight.after(1.5).autopilot.velocity == (0, 0, 0)
    assert flight.autopilot.position[2] == pytest.approx(-2, abs=0.1)
    flight.ground = lambda north, east: 0.0
    assert flight.after(1).moved
    flight.ground = lambda north, east: 8.0
    assert flight.after(3).said()[-1] == "rangefinder lost: search ends"


@pytest.mark.parametrize("terrain", [None, 3.0])
def test_a_home_that_moves_in_flight_does_not_lead_to_the_ground(terrain):
    flight = Flight(ARVS_ENABLE=1)
    flight.autopilot.terrain = terrain
    assert flight.after(3).moved
    flight.autopilot.home_down = 50.0  # set by the ground station; ArduPilot's height above terrain moves with it
    assert flight.after(2).said()[-1] == "home moved: search ends"
    assert flight.autopilot.position[2] == pytest.approx(-2, abs=0.1)
    assert flight.autopilot.mode == LOITER


def test_without_a_position_it_stops_at_once(flight):
    """The last velocity may lead down, and to the ground within the 2 s after which the search ends."""
    flight.ground = lambda north, east: 0.0
    flight.autopilot.position[2] = -4.0
    assert flight.after(0.5).autopilot.velocity[2] > 0.9
    flight.autopilot.has_position = False
    assert flight.after(0.2).autopilot.velocity == (0, 0, 0)
    flight.autopilot.has_position = True
    assert flight.after(5).moved


@pytest.mark.parametrize("height", [0, -3])
def test_a_height_below_its_range_does_not_lead_to_the_ground(height):
    flight = Flight(3, ARVS_ENABLE=1, ARVS_ALT=height)
    flight.ground = lambda north, east: 0.0
    flight.autopilot.range = 2.0
    assert flight.after(20).moved
    assert flight.lowest > 0.4


@pytest.mark.parametrize("bit", [SELF_TEST_FAULT, NOT_SEARCHING])
def test_a_receiver_that_cannot_search_leads_nowhere(flight, bit):
    flight.status |= bit
    assert flight.after(2).said()[-1] == "receiver cannot search: search ends"
    assert flight.autopilot.mode == LOITER
    flight.autopilot.mode = GUIDED
    flight.autopilot.params["ARVS_ENABLE"] = 1.0
    assert not flight.after(3).steered
    assert flight.said() == ["cannot search: receiver cannot search"]
    flight.status = SYNTHETIC
    assert flight.after(2).moved


def test_a_receiver_that_repeats_one_frame_is_not_believed(flight):
    flight.repeats = True
    flight.fly(1)  # what is under way
    before = list(flight.autopilot.position)
    flight.fly(4)
    assert math.dist(before, flight.autopilot.position) < 2
    assert flight.said()[-1] == "receiver repeats itself: search ends"
    assert flight.autopilot.mode == LOITER


@pytest.mark.parametrize(("distance", "at_s"), [(100, 25), (3000, 0)])
def test_a_reading_that_does_not_change_on_the_way_is_not_believed(distance, at_s):
    flight = Flight(3, ARVS_ENABLE=1)
    flight.fly(at_s)
    flight.stuck = [Channel(1, 1, distance, 30)]
    assert flight.after(60).said()[-1] == "the reading does not change: search ends"
    assert flight.autopilot.mode == LOITER


def test_flying_on_without_a_signal_is_no_reading_that_does_not_change():
    flight = Flight(3, ARVS_ENABLE=1, ARVS_SPEED=2)
    flight.fly(10)
    before = list(flight.autopilot.position)
    flight.hear([Channel()], 2.9)
    assert math.dist(before, flight.autopilot.position) > 4.2
    assert flight.said()[-1] != "the reading does not change: search ends"


def test_it_goes_for_the_nearest_and_changes_for_one_that_is_much_nearer(flight):
    flight.said()
    for distances, text in [
        ({7: 900, 8: 1100}, "going for transmitter 7, 9.0 m away"),
        ({7: 900, 8: 650}, None),
        ({8: 640, 9: 660}, None),
        ({7: 900, 8: 620}, "going for transmitter 8, 6.2 m away"),
        ({8: 650, 7: 640}, None),
    ]:
        flight.hear([Channel(id_, 1, d, 0) for id_, d in distances.items()], 1)
        assert flight.said() == ([text] if text else [])


def test_a_marked_transmitter_is_found_already(flight):
    flight.said()
    flight.hear([Channel(7, 1, 300, 0, marked=True), Channel(8, 1, 900, 0)], 1)
    assert flight.said() == ["going for transmitter 8, 9.0 m away"]


def test_the_nearest_counts_where_an_id_comes_twice(flight):
    flight.hear([Channel(7, 1, 900, 0), Channel(7, 1, 400, 0)], 1)
    assert flight.said()[-1] == "going for transmitter 7, 4.0 m away"


def test_a_receiver_that_knows_no_numbers(flight):
    flight.hear([Channel(None, 1, 400, 0)], 1)
    assert flight.said() == ["going for transmitter ?, 4.0 m away"]
    assert flight.after(1).said() == []


def test_the_driver_goes_on_beside_it(flight):
    names = {name for name, _ in flight.autopilot.floats}
    assert names == {"ARVA1_D", "ARVA1_DIR", "ARVA1_ID", "ARVA1_ZONE"}
    assert {name for name, _ in flight.autopilot.rows} == {"ARVA", "ARVC", "ARVS"}


def test_a_long_arm_of_the_cross_costs_no_more_than_the_engine_allows():
    """d falls and falls; what would be too long an arm ends after 400 readings, at the middle of what was heard."""
    autopilot = Autopilot()
    cross = autopilot.require(NAME).Cross(0.0, 0.0, 0.0)

    def cost(step):
        return autopilot.count(lambda: cross.hear(400 * step, step / 10, 0.0, 100 * math.exp(-step / 100)))

    hear = max(cost(step) for step in range(399))
    assert cross.target(39.8, 0.0) == pytest.approx((41.8, 0))
    hear = max(hear, cost(399))
    count = autopilot.count(lambda: cross.target(39.9, 0.0))
    assert 1000 < hear < 8000
    assert 2000 < count < 8000
    assert cross.target(39.9, 0.0) == pytest.approx((38.2, 0), abs=0.1)  # the centroid of exp(0.6 n)


def test_a_fault_ends_the_search(flight):
    flight.autopilot.no_room_for = "ARVS"
    flight.fly(3)
    assert "internal error" in flight.said()[0]
    assert flight.autopilot.mode == LOITER
    flight.autopilot.no_room_for = ""
    assert not flight.after(3).steered
    assert flight.autopilot.running


def test_it_says_that_the_driver_is_missing(tmp_path):
    shutil.copy(FOLDER / f"{NAME}.lua", tmp_path)
    flight = Flight(folder=tmp_path)
    assert flight.said() == ["arva_receiver.lua is missing"]
    assert not flight.autopilot.running


def test_without_a_port_it_does_not_run():
    autopilot = Autopilot(port=None).start(NAME)
    assert autopilot.said() == ["ARVA: no port 1 with SERIALn_PROTOCOL 28"]
    assert not autopilot.running


# The virtual victim on ArduPilot: its readings are those of the emulator's receiver, reading for reading


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
