"""The autopilot tells where the ground is: it is asked until it answers, and nobody else is believed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from arva_hil.autopilot.following.session import Session
from arva_hil.config import Scenario, parse
from arva_hil.config.terrain import parse_grid
from arva_hil.emulator.engine import Emulator
from arva_hil.emulator.setup import one_vehicle
from arva_hil.events import GroundFound, GroundMissing
from arva_hil.mavlink.codec import Encoder, Parser, decode, dialect
from arva_hil.simulated.vehicle import SimulatedVehicle
from tests.one_receiver import Diary, turn

HOME = (46.0, 7.0, 1650.0)
CHECK, REPORT = dialect.MAVLINK_MSG_ID_TERRAIN_CHECK, dialect.MAVLINK_MSG_ID_TERRAIN_REPORT
BURIED = "transmitters: [{id: 3, enu: [0, 20, 0], depth_m: 1.5}]"
TEXT = f"spec: 2\nterrain: autopilot\n{BURIED}\nreceiver: {{noise: {{kind: 'off'}}}}"


class Bench:
    """The built-in vehicle and an emulator, 50 times a second. `answer`: what becomes of its report, None: nothing."""

    def __init__(self, scenario: Scenario, answer: Any = lambda report: report) -> None:
        self.vehicle = SimulatedVehicle(HOME, streams={33: 20.0, 30: 20.0})
        self.emulator = Emulator([one_vehicle(scenario, Session())], start=0.0)
        self.diary = Diary()
        self.questions: list[Any] = []
        self._answer = answer
        self._asked, self._said, self._encoder = Parser(), Parser(), Encoder(1, 1)
        self.now = 0.0

    def run(self, seconds: float) -> None:
        until = self.now + seconds
        while self.now < until:
            self.now = round(self.now + 0.02, 6)
            for packet in self._said.feed(self.vehicle.poll(self.now)):
                data = packet.raw
                if packet.msgid == REPORT:
                    report = self._answer(decode(packet))
                    data = self._encoder.pack(report) if report else b""
                self.emulator.receive("autopilot", bytes(data), self.now)
            for output in turn(self.emulator, self.now, self.diary):
                if output.link == "autopilot":
                    self.vehicle.feed(output.data, self.now)
                    self.questions += [p for p in self._asked.feed(output.data) if p.msgid == CHECK]

    def told(self) -> list[Any]:
        return [event for event in self.diary.events if isinstance(event, GroundFound | GroundMissing)]

    def down(self) -> float | None:
        there = self.emulator.vehicles[0].units[0].receiver.seen.transmitters
        return None if there is None or there.unplaced else float(there.positions[0, 2])


def test_the_autopilot_is_asked_and_the_transmitter_lies_below_its_ground() -> None:
    bench = Bench(parse(TEXT, "s.yaml"))
    bench.run(8.0)
    assert bench.down() == pytest.approx(1.5, abs=0.01)
    assert len(bench.questions) <= 4
    assert [type(event) for event in bench.told()] == [GroundFound]


def test_on_level_ground_a_place_on_earth_is_as_high_as_home() -> None:
    bench = Bench(parse("spec: 2\ntransmitters: [{id: 3, lla: [46.0, 7.0, 0], depth_m: 1.5}]", "s.yaml"))
    bench.run(4.0)
    assert bench.down() == pytest.approx(1.5, abs=0.01)


def test_the_ground_counts_from_home_however_high_the_survey_has_that() -> None:
    def survey(report: Any) -> Any:
        report.terrain_height = 1600.0 + (7.0 if report.lat > 460001000 else 0.0)
        return report

    bench = Bench(parse(TEXT, "s.yaml"), survey)
    bench.run(8.0)
    assert bench.down() == pytest.approx(1.5 - 7.0, abs=0.01)


@pytest.mark.parametrize(
    "words",
    [
        {"spacing": 0},
        {"terrain_height": float("nan")},
        {"terrain_height": 12000.0},
        {"lat": 460000001},
    ],
)
def test_what_is_no_answer_leaves_it_silent_and_is_asked_again(words: dict[str, Any]) -> None:
    def spoilt(report: Any) -> Any:
        for name, value in words.items():
            setattr(report, name, value)
        return report

    bench = Bench(parse(TEXT, "s.yaml"), spoilt)
    bench.run(9.0)
    assert bench.told() == []
    bench.run(12.0)
    assert bench.down() is None
    (missing,) = bench.told()
    assert missing.ids == [3]
    assert 20 < len(bench.questions) < 110
    bench._answer = lambda report: report
    bench.run(1.0)
    assert bench.down() == pytest.approx(1.5, abs=0.01)
    assert [frame.reading.channels[0].id for frame in bench.diary.frames][-1] == 3
    assert {frame.reading.channels[0].id for frame in bench.diary.frames[:-2]} == {None}


def test_strangers_tell_nothing() -> None:
    bench = Bench(parse(TEXT, "s.yaml"), lambda report: None)
    stranger = Encoder(1, 99), Encoder(2, 1)
    for _ in range(8):
        bench.run(1.0)
        for of in stranger:
            for question in bench.questions:
                m = decode(question)
                answer = of.pack(dialect.MAVLink_terrain_report_message(m.lat, m.lon, 30, 1650.0, 0.0, 0, 1))
                bench.emulator.receive("autopilot", answer, bench.now)
    assert bench.down() is None


def test_a_grid_of_another_place_than_home_is_said_once(tmp_path: Path) -> None:
    grid = parse_grid("ncols 2\nnrows 2\nxllcorner 9\nyllcorner 47\ncellsize 0.001\n1 2\n3 4\n", "other.asc")
    scenario = Scenario(parse(TEXT, "s.yaml").transmitters, terrain=grid)
    bench = Bench(scenario)
    bench.run(9.0)
    (missing,) = bench.told()
    assert missing.terrain.endswith("other.asc")
    assert bench.questions == []
    assert bench.down() is None


def test_without_depths_nobody_is_asked() -> None:
    bench = Bench(parse("spec: 2\nterrain: autopilot\ntransmitters: [{id: 3, enu: [0, 20, 0]}]", "s.yaml"))
    bench.run(8.0)
    assert bench.questions == []
    assert bench.told() == []
