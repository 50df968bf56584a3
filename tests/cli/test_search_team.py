"""`arva-hil search` with the vehicles of a scenario: what it refuses, and that each vehicle has its own search."""

from __future__ import annotations

import json
import socket
from pathlib import Path
from typing import Any

import pytest

from arva_hil.cli.search_plan import far_end
from arva_hil.cli.search_report import exit_code, found_by, result
from arva_hil.events.reasons import Why, because
from arva_hil.search.mission.choice import HeardTransmitter
from arva_hil.search.mission.outcome import Outcome
from tests.free_ports import free_port

from .far_ends import Arva, Beacon, Keep, Start

DATUM = "datum: {lat: 46.0123, lon: 7.7456, alt: 1650}\n"
FIELD = f"spec: 2\n{DATUM}transmitters: [{{id: 4, ned: [14, -10, 0.5]}}]\nvehicles:\n"
ONE = "  - {name: a, system: 1, receivers: [{name: r, port: 'pty:/tmp/none-a'}]}\n"
TWO = "  - {name: b, system: 2, receivers: [{name: r, port: 'pty:/tmp/none-b'}]}\n"


@pytest.fixture
def field(tmp_path: Path) -> Path:
    path = tmp_path / "field.yaml"
    path.write_text(FIELD + ONE + TWO)
    return path


@pytest.mark.parametrize(
    ("old", "new", "words", "what"),
    [
        (DATUM, "", "", "datum: home: several searches need one in common: datum: {lat, lon, alt}"),
        ("vehicles:\n" + ONE + TWO, "", "", "0 vehicles, expected 1 to 64 that search"),
        ("system: 2", "system: 1, autopilot: /dev/b", "", "system 1 twice: each vehicle that searches needs its own"),
        ("system: 2", "autopilot: /dev/b", "", "b: its system is missing"),
        ("pty:/tmp/none-b", "pty", "", "b: its port is a new pseudo-terminal each time: name it, e.g. pty:/tmp/NAME"),
        ("[{name: r, port: 'pty:/tmp/none-b'}]", "[{name: r, port: pty}, {name: s, port: pty}]", "", "b: 2 receivers"),
        ("none-b'", "none-b', format: text", "", "format text: several drones need binary or nmea"),
        ("", "", "--victims 2", "--victims: several drones share the transmitters"),
        ("", "", "--receiver /tmp/x", "--receiver: of one search: with --scenario, name its --vehicle"),
        ("", "", "--gcs udpout:127.0.0.1:1", "--gcs: of one search"),
        ("", "", "--foxglove on", "--foxglove: of one search"),
        ("", "", "--area=-20,-3,20,3", "2 drones would have 3.0 m each"),
        ("", "", "--vehicle c", "--vehicle c: "),
        ("pty:/tmp/none-b", "pty:/tmp/../tmp/none-a", "", "its port /tmp/../tmp/none-a is also the port of a: each"),
        (
            "pty:/tmp/none-b",
            "pty:/dev/none",
            "",
            "b: its port /dev/none is also the autopilot of b: each needs its own",
        ),
        ("pty:/tmp/none-b", "log.tlog", "", "b: its port log.tlog is a log"),
        ("pty:/tmp/none-b", "-", "", "b: its port is stdout, where no frames can be read: name a port"),
        ("", "", "--autopilot -", "a: its autopilot is stdout, which cannot be read"),
        (
            "pty:/tmp/none-b",
            "udpout:127.0.0.1:1",
            "--autopilot udpin:0.0.0.0:1",
            "udpin:127.0.0.1:1, the port of b, cannot",
        ),
    ],
)
def test_what_is_no_team_is_refused(arva: Arva, field: Path, old: str, new: str, words: str, what: str) -> None:
    field.write_text(field.read_text().replace(old, new))
    ended = arva("search", "--scenario", field, "--autopilot", "/dev/none", *words.split())
    assert (ended.code, what in ended.err) == (2, True), ended.err


def test_two_links_that_listen_at_one_port_are_refused(arva: Arva, field: Path) -> None:
    on = "system: {}, autopilot: 'udpin:{}:14990'"
    text = field.read_text().replace("system: 1", on.format(1, "127.0.0.1"))
    field.write_text(text.replace("system: 2", on.format(2, "0.0.0.0")))
    ended = arva("search", "--scenario", field)
    assert ended.code == 2
    assert "so udpin:127.0.0.1:14990, the autopilot of a, cannot listen there too: choose another port" in ended.err


def test_two_spellings_of_one_link_are_one_link(start: Start, field: Path, tmp_path: Path, keep: Keep) -> None:
    port = free_port(socket.SOCK_DGRAM)
    text = field.read_text().replace("/tmp/none-a", f"{tmp_path}/a").replace("/tmp/none-b", f"{tmp_path}/b")
    for system, host in ((1, "127.0.0.1"), (2, "localhost")):
        text = text.replace(f"system: {system}", f"system: {system}, autopilot: 'udpin:{host}:{port}'")
    field.write_text(text)
    for name in "ab":
        keep(Beacon(symlink=f"{tmp_path}/{name}"))
    start("vehicle", "--count", 2, "--link", f"udpout:127.0.0.1:{port}")
    search = start("search", "--scenario", field, "--dry-run")
    assert search.ends() == 0, search.err
    for name, system in (("a", 1), ("b", 2)):
        assert f"{name}: system {system}, autopilot: udpin:127.0.0.1:{port}" in search.err


@pytest.mark.parametrize("there", ["b/search.csv", "b"])
def test_a_record_that_cannot_be_made_for_one_is_begun_for_none(
    arva: Arva, field: Path, tmp_path: Path, there: str
) -> None:
    record = tmp_path / "record"
    (record / there).parent.mkdir(parents=True)
    (record / there).touch()
    ended = arva("search", "--scenario", field, "--autopilot", "/dev/none", "--record", record)
    assert (ended.code, f"{record / 'b'}: " in ended.err) == (2, True), ended.err
    assert "waiting for" not in ended.err
    assert [path.name for path in record.iterdir()] == ["b"]


def test_a_record_is_not_written_through_a_folder_that_is_a_symlink(arva: Arva, field: Path, tmp_path: Path) -> None:
    record, elsewhere = tmp_path / "record", tmp_path / "elsewhere"
    record.mkdir()
    elsewhere.mkdir()
    (record / "b").symlink_to(elsewhere)
    ended = arva("search", "--scenario", field, "--autopilot", "/dev/none", "--record", record)
    assert (ended.code, f"{record / 'b'}: is no folder of its own; name another folder" in ended.err) == (2, True)
    assert not list(elsewhere.iterdir())


@pytest.mark.parametrize(
    ("port", "read"),
    [
        ("pty:/tmp/a", "/tmp/a"),
        ("/dev/ttyUSB0,115200", "/dev/ttyUSB0,115200"),
        ("udpout:[::1]:5", "udpin:[::1]:5"),
        ("tcpin:5", "tcp:127.0.0.1:5"),
    ],
)
def test_frames_are_read_where_they_come_out(port: str, read: str) -> None:
    assert far_end(port, "a") == read


def test_without_links_and_without_a_scenario_it_says_what_is_missing(arva: Arva, field: Path) -> None:
    assert "a: its autopilot is missing: name its link, or --autopilot" in arva("search", "--scenario", field).err
    ended = arva("search", "--vehicle", "a")
    assert (ended.code, "--vehicle a: one of the vehicles of --scenario FILE, which is missing" in ended.err) == (
        2,
        True,
    )


def test_two_searches_on_one_link_have_a_vehicle_each(start: Start, field: Path, keep: Keep, tmp_path: Path) -> None:
    ports = {name: f"{tmp_path}/{name}" for name in "ab"}
    for port in ports.values():
        keep(Beacon(symlink=port))
    field.write_text(field.read_text().replace("/tmp/none-a", ports["a"]).replace("/tmp/none-b", ports["b"]))
    port = free_port(socket.SOCK_DGRAM)
    start("vehicle", "--count", 2, "--link", f"udpout:127.0.0.1:{port}")
    words = ("--autopilot", f"udpin:127.0.0.1:{port}", "--dry-run", "--json")
    search = start("search", "--scenario", field, *words, "--record", tmp_path / "record")
    assert search.ends() == 0, search.err
    made = {one["vehicle"]: one for one in map(json.loads, search.out.decode().splitlines())}
    for name, system in (("a", 1), ("b", 2)):
        orders = [order["order"] for order in made[name]["would_order"]]
        assert orders[:3] == ["DO_SET_MODE", "COMPONENT_ARM_DISARM", "NAV_TAKEOFF"]
        assert f"{name}: vehicle ardupilotmega quadrotor {system}/1" in search.err
        assert '"vehicle_found"' in (tmp_path / "record" / name / "search.jsonl").read_text()
    alone = start("search", "--scenario", field, "--vehicle", "b", *words)
    assert alone.ends() == 0, alone.err
    assert "vehicle ardupilotmega quadrotor 2/1" in alone.err
    assert "quadrotor 1/1" not in alone.err.replace("ignored", "")


@pytest.mark.parametrize(
    ("kinds", "code"),
    [
        (["found", "not found"], 0),
        (["not found", "not found"], 1),
        (["not sure"], 1),
        (["found", "failed"], 1),
        (["found", "refused"], 2),
        (["no link", "found"], 3),
        (["would fly", "would fly"], 0),
    ],
)
def test_a_team_succeeds_if_something_was_found_and_nothing_failed(kinds: list[Any], code: int) -> None:
    assert exit_code([Outcome(kind, ()) for kind in kinds]) == code


def test_a_search_that_did_not_begin_reports_no_frames() -> None:
    assert len(result(Outcome("failed", (because(Why.INTERRUPTED),)))) == 1


def test_what_another_drone_has_found_is_not_said_to_be_lacking() -> None:
    heard = ((2, HeardTransmitter(18.0, (0.7, 0.8))), (3, HeardTransmitter(31.0, (4.0, 5.0))))
    found = Outcome("found", (because(Why.FOUND),), id=1, others=heard)
    outcomes = {
        "a": found,
        "b": Outcome("found", (because(Why.FOUND),), id=2),
        "c": Outcome("not sure", (because(Why.NOT_SURE),), id=3),
    }
    assert found_by(outcomes) == {1: "a", 2: "b"}
    *_, second, third = result(found, found_by(outcomes))
    assert second == "transmitter 2 was received, and found by b"
    assert third.startswith("transmitter 3 was received, but not found; nearest, 31.0 m away, at 4.0 m north")
