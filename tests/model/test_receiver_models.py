"""A receiver in time: it looks when its model wants to, its frames show what the model holds then."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from arva_hil.autopilot.following.navigation import VehicleState
from arva_hil.autopilot.following.session import Session
from arva_hil.config import MountOptions, Noise, ReceiverOptions, Scenario, Transmitter, parse_fault
from arva_hil.emulator.build import moving_transmitters
from arva_hil.emulator.engine import Unit, make_unit
from arva_hil.emulator.setup import ReceiverSetup, VehicleSetup
from arva_hil.emulator.world import Snapshot
from arva_hil.events import FrameMade
from arva_hil.model.field import LocalFrame, MovingTransmitters
from arva_hil.model.receiver import Answer, Antennas, Look, PaperReceiver, Reading, ReceiverModel, ReceiverSettings
from arva_hil.registry import RECEIVERS

PLACE = (46.0, 8.0, 1650.0)
START = 12345.678  # of the run, on the driver's clock
ROUND = 1e-6


@dataclass
class StrongestOfThree:
    """A model with a memory: it looks ten times a second, and shows the nearest of its last three looks."""

    inside: PaperReceiver = field(default_factory=lambda: PaperReceiver(Antennas(noise="off")))
    looks: list[Look] = field(default_factory=list)
    commands: list[tuple[float, str]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._last: deque[Reading] = deque(maxlen=3)

    @classmethod
    def from_settings(cls, settings: ReceiverSettings, seed: int) -> StrongestOfThree:
        return cls()

    def next_look(self, after_s: float, frame_s: float) -> float:
        return (math.floor(after_s * 10 + ROUND) + 1) / 10 if after_s >= 0 else 0.0

    def look(self, look: Look) -> None:
        self.looks.append(look)
        self.inside.look(look)
        self._last.append(self.inside.show(look.time_s))

    def show(self, time_s: float) -> Reading:
        silent = self.inside.show(time_s)
        return min(self._last, key=lambda reading: reading.channels[0].d_cm % 10**6, default=silent)

    def command(self, time_s: float, name: str, values: Sequence[float]) -> Answer:
        self.commands.append((round(time_s, 6), name))
        return Answer.DONE


@dataclass
class Vehicle:
    """It flies north at 2 m/s from the datum, level and heading north."""

    motors: float = 0.0

    def state(self, t: float) -> VehicleState:
        at = np.array([2.0 * (t - START), 0.0, 0.0])
        return VehicleState(t - START, at, np.array([2.0, 0.0, 0.0]), (1.0, 0.0, 0.0, 0.0), 0.01)


@dataclass
class Driven:
    """A receiver and its port, on a vehicle among transmitters."""

    unit: Unit
    there: MovingTransmitters
    start: float
    vehicle: Vehicle

    def advance(self, until: float, *, live: bool = False) -> list[FrameMade]:
        """The frames made until an instant."""
        made, (receiver, port) = [], self.unit
        while (t := receiver.next_due) <= until:
            state = self.vehicle.state(t)
            there = self.there.at(t - self.start)
            seen = Snapshot(t, t - START, state, state, state.age_s, there, self.vehicle.motors, None)
            made += [one for one in receiver.advance(seen, until if live else t) if isinstance(one, FrameMade)]
        for frame in made:
            port.send(frame, until)
        return made


def source(scenario: Scenario, vehicle: Vehicle | None = None, *, start: float = START) -> Driven:
    setup = ReceiverSetup("receiver", "port", scenario)
    unit = make_unit(VehicleSetup("vehicle", "link", Session(), scenario, [setup]), setup, start)
    return Driven(unit, moving_transmitters(scenario, LocalFrame(*PLACE)), start, vehicle or Vehicle())


def frames(of: Driven, until: float, *, live: bool = False) -> list[FrameMade]:
    return of.advance(until, live=live)


@pytest.fixture
def toy(monkeypatch: pytest.MonkeyPatch) -> StrongestOfThree:
    """The model under the name `toy`."""
    model = StrongestOfThree()
    monkeypatch.setattr(StrongestOfThree, "from_settings", lambda settings, seed: model)
    monkeypatch.setitem(RECEIVERS.loaded, "toy", StrongestOfThree)
    return model


def scenario(model: str = "paper", **receiver: float) -> Scenario:
    """A transmitter 30 m north of the datum: the vehicle comes nearer all the time, then goes away."""
    chosen = ReceiverOptions(model=model, noise=Noise("off"), mount=MountOptions((0.5, 0.0, 0.0)), **receiver)  # type: ignore[arg-type]
    return Scenario((Transmitter(1, ned=(30.0, 0.0, 0.0)),), receiver=chosen)


def ranges(made: Sequence[FrameMade]) -> list[float | None]:
    return [frame.reading.channels[0].true_range_m for frame in made]


def test_the_papers_model_looks_when_a_frame_is_due_and_only_then(monkeypatch: pytest.MonkeyPatch) -> None:
    looks = []
    monkeypatch.setattr(PaperReceiver, "look", lambda self, look: looks.append(look.time_s))
    made = frames(source(scenario(rate_hz=10.0, jitter_s=0.04)), START + 5.0)
    assert looks == [frame.instant_s for frame in made]
    assert len(set(looks)) == 50


def test_frames_at_1_hz_show_what_a_model_that_looks_at_10_hz_remembers(toy: StrongestOfThree) -> None:
    made = frames(source(scenario("toy", rate_hz=1.0)), START + 20.0)
    assert [look.time_s for look in toy.looks] == pytest.approx([n / 10 for n in range(201)])
    assert [frame.number for frame in made] == list(range(21))
    distances = [abs(30.0 - 0.5 - 2.0 * n / 10) for n in range(201)]
    nearest = [min(distances[max(0, 10 * n - 2) : 10 * n + 1]) for n in range(21)]
    assert ranges(made) == pytest.approx(nearest)
    assert ranges(made)[16] == pytest.approx(distances[158])  # the oldest of the three, because it goes away


def test_a_look_and_a_frame_come_in_the_order_of_time_however_late_they_are_called(toy: StrongestOfThree) -> None:
    step, leap = source(scenario("toy", rate_hz=3.0)), source(scenario("toy", rate_hz=3.0))
    stepped = [frame for n in range(1, 101) for frame in frames(step, START + n / 20)]
    toy.__post_init__()
    assert ranges(stepped) == ranges(frames(leap, START + 5.0))
    assert step.unit.receiver.next_due <= START + 5.1


def test_after_a_stall_looks_and_frames_of_more_than_a_second_ago_are_left_out(toy: StrongestOfThree) -> None:
    late = source(scenario("toy", rate_hz=2.0))
    frames(late, START, live=True)
    toy.looks.clear()
    made = frames(late, START + 60.0, live=True)
    times = [look.time_s for look in toy.looks]
    assert times == sorted(times)
    assert [t for t in times if 0.55 < t < 58.9] == []
    assert [frame.instant_s for frame in made] == pytest.approx([0.5, 59.0, 59.5, 60.0])
    assert late.unit.port.counters.skipped == 116


def test_the_age_of_a_reading_grows_from_the_look_it_rests_on(toy: StrongestOfThree) -> None:
    made = frames(source(scenario("toy", rate_hz=4.0)), START + 1.0)
    assert [frame.age_s for frame in made] == pytest.approx([0.01, 0.06, 0.01, 0.06, 0.01])


def test_it_looks_from_where_it_is_mounted(toy: StrongestOfThree) -> None:
    frames(source(scenario("toy")), START + 1.0)
    places = [look.pose.position for look in toy.looks if look.pose]
    assert np.array(places) == pytest.approx(np.array([(0.5 + n / 5, 0, 0) for n in range(11)]))


def test_a_model_that_looks_back_is_an_error(toy: StrongestOfThree, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(toy, "next_look", lambda after_s, frame_s: after_s)
    with pytest.raises(ValueError, match="not later than"):
        source(scenario("toy"))


@pytest.mark.parametrize("fault", ["transmitter_off=1@2-3", "transmitter_moved=1,by_ned=[0,40,0]@2-3"])
def test_faults_of_hearing_strike_whatever_model_at_its_looks(toy: StrongestOfThree, fault: str) -> None:
    frames(source(replace(scenario("toy"), faults=(parse_fault(fault),))), START + 5.0)
    struck = [
        look.time_s for look in toy.looks if not look.transmitters.strengths[0] or look.transmitters.positions[0][1]
    ]
    assert struck == pytest.approx([n / 10 for n in range(20, 30)])


def test_a_stuck_receiver_shows_the_same_whatever_its_model_hears(toy: StrongestOfThree) -> None:
    chosen = replace(scenario("toy"), faults=(parse_fault("stuck@2-5"),))
    made = frames(source(chosen), START + 8.0)
    said = [frame.reading.channels[0].d_cm for frame in made]
    assert said[1:5] == [said[1]] * 4
    assert len(set(said)) == 6
    assert ranges(made)[4] == pytest.approx(29.5 - 8.0)  # true all the same


def test_interference_reaches_whatever_model_as_noise(toy: StrongestOfThree) -> None:
    chosen = replace(scenario("toy"), faults=(parse_fault("interference=20@1-2"), parse_fault("interference=30@1-2")))
    frames(source(chosen), START + 3.0)
    assert [look.time_s for look in toy.looks if look.noise is not None] == pytest.approx(
        [n / 10 for n in range(10, 20)]
    )


def test_a_host_s_command_reaches_the_model_through_faults_and_the_papers_takes_none(toy: StrongestOfThree) -> None:
    faulty = source(replace(scenario("toy"), faults=(parse_fault("stuck@2-5"),))).unit.receiver
    assert faulty.command(START + 1.0, "search", ()) is Answer.DONE
    assert toy.commands == [(1.0, "search")]  # in the time of the run
    paper: ReceiverModel = PaperReceiver(Antennas())
    assert paper.command(1.0, "search", ()) is Answer.UNKNOWN
