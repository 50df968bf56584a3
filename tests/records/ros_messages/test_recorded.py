"""A record gives the messages that its run published."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import pytest

from arva_hil.config import DEFAULT, load
from arva_hil.events import DatumSet
from arva_hil.records.reading import load as load_record
from arva_hil.records.ros_messages.readings import RunMessages
from arva_hil.records.ros_messages.recorded import messages_of
from arva_hil.records.ros_messages.types import Publication
from tests import made_records

from .test_readings import by_topic


def numbers(value: Any) -> Any:
    """A message without its times, for pytest.approx: all its numbers and texts, in their order."""
    if isinstance(value, dict):
        return [one for name, part in value.items() if name != "stamp" for one in numbers(part)]
    if isinstance(value, list):
        return [one for part in value for one in numbers(part)]
    return [value]


def of(topic: str, publications: list[Publication]) -> list[Publication]:
    return [publication for publication in publications if publication.topic == topic]


def test_the_messages_are_those_of_the_live_run(tmp_path: Path) -> None:
    live = RunMessages(DEFAULT, made_records.EPOCH_US)
    live.of_event(DatumSet(made_records.START_S, "vehicle", *made_records.HOME, ()))
    published = [p for made in made_records.frames(DEFAULT, 30) for p in live.of_event(made)]
    replayed = list(messages_of(load_record(made_records.write(tmp_path / "run"))))
    for topic in ("/arva", "/arva/pose", "/arva/fix", "/arva/visualization"):
        before, after = of(topic, published), of(topic, replayed)
        assert len(before) == len(after) > 20
        for one, other in zip(before, after, strict=True):
            assert other.stamp_ns == pytest.approx(one.stamp_ns, abs=1_000_000)  # the table has milliseconds
            said, expected = numbers(list(by_topic([other]).values())), numbers(list(by_topic([one]).values()))
            assert [v for v in said if isinstance(v, str)] == [v for v in expected if isinstance(v, str)]
            floats = [[v for v in every if not isinstance(v, str)] for every in (said, expected)]
            assert floats[0] == pytest.approx(floats[1], rel=1e-9, abs=1e-9)


def test_the_messages_come_in_the_order_of_their_times_whatever_they_are_of(tmp_path: Path) -> None:
    every = list(messages_of(load_record(made_records.write(tmp_path / "run"))))
    stamps = [publication.stamp_ns for publication in every]
    assert stamps == sorted(stamps)
    assert {p.topic for p in every} >= {"/arva", "/diagnostics", "/search/arva", "/search/pose", "/search/found"}


def test_several_receivers_have_their_topics(tmp_path: Path) -> None:
    scenario = load("configs/two_vehicles.yaml")
    names = [("alpha", "front"), ("alpha", "rear"), ("bravo", "only")]
    every = list(
        messages_of(load_record(made_records.write(tmp_path / "run", 9, scenario, receivers=names, search=False)))
    )
    for vehicle, receiver in names:
        readings = of(f"/{vehicle}/{receiver}/arva", every)
        assert len(readings) == 9


def test_what_the_vehicle_reported_is_there_where_it_differs(tmp_path: Path) -> None:
    folder = made_records.write(tmp_path / "run", search=False)
    path = folder / "readings.csv"
    rows = list(csv.DictReader(path.open()))
    for row in rows:
        if row["reported_north_m"]:
            row["reported_north_m"] = repr(float(row["north_m"]) + 1.0)
    with path.open("w") as file:
        table = csv.DictWriter(file, rows[0])
        table.writeheader()
        table.writerows(rows)
    every = list(messages_of(load_record(folder)))
    poses, reported = of("/arva/pose", every), of("/arva/reported_pose", every)
    assert len(poses) == len(reported) == 27
    for true, other in zip(poses, reported, strict=True):
        (at,), (there,) = by_topic([true]).values(), by_topic([other]).values()
        assert there["pose"]["position"]["y"] == pytest.approx(at["pose"]["position"]["y"] + 1.0)


def test_a_run_without_a_frame_and_one_that_was_killed_and_a_search_alone_have_what_there_is(tmp_path: Path) -> None:
    assert of("/arva", list(messages_of(load_record(made_records.write(tmp_path / "none", 0, search=False))))) == []
    killed = made_records.write(tmp_path / "killed", 1, ended=False)
    assert len(of("/arva", list(messages_of(load_record(killed))))) == 1
    (tmp_path / "search").mkdir()
    alone = list(messages_of(load_record(made_records.write_search(tmp_path / "search"))))
    assert {p.topic for p in alone} == {"/tf", "/search/arva", "/search/pose", "/search/fix", "/search/found"} | {
        "/search/visualization"
    }
