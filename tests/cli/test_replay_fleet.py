"""A recorded flight of several vehicles, replayed by commands and in Python."""

from __future__ import annotations

from pathlib import Path

import pytest

import arva_hil
from arva_hil.links.tlog import TlogReader, tlog_record
from arva_hil.mavlink.codec import Parser, dialect
from arva_hil.simulated.vehicle import SimulatedVehicle

from .far_ends import Arva, frames_in

HOMES = {1: (46.0123, 7.7456, 1650.0), 2: (46.1, 7.9, 2100.0)}
STREAMS = {dialect.MAVLINK_MSG_ID_ATTITUDE: 10.0, dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 10.0}
FLEET = """
spec: 2
transmitters: [{id: 7, ned: [20, 5, 0]}]
receiver: {rate_hz: 5}
vehicles:
  - {name: alpha, system: 1, receivers: [{name: front, port: pty}]}
  - {name: bravo, autopilot: 'udpin:127.0.0.1:14999', system: 2, receivers: [{name: only, port: pty, format: nmea}]}
"""


@pytest.fixture
def log(tmp_path: Path) -> Path:
    """12 s of two vehicles that stand at places of their own."""
    vehicles = [SimulatedVehicle(home, system, streams=STREAMS) for system, home in HOMES.items()]
    path = tmp_path / "two.tlog"
    with path.open("wb") as out:
        for tick in range(120):
            for vehicle in vehicles:
                for packet in Parser().feed(vehicle.poll(tick / 10)):
                    out.write(tlog_record(1_700_000_000_000_000 + tick * 100_000, packet.raw))
    return path


@pytest.fixture
def fleet(tmp_path: Path) -> Path:
    path = tmp_path / "fleet.yaml"
    path.write_text(FLEET)
    return path


def test_each_vehicle_of_a_log_has_a_record_as_in_the_run(arva: Arva, log: Path, fleet: Path, tmp_path: Path) -> None:
    ended = arva("replay", log, "--scenario", fleet, "--record", tmp_path / "record")
    assert ended.code == 0
    assert "all vehicles of" in ended.err
    assert ended.err.count(f"{log.stat().st_size - 8 * len(list(TlogReader(log)))} bytes, ") == 1
    assert "\nautopilot (2 vehicles): " in ended.err
    frames = frames_in((tmp_path / "record/alpha/front/frames.bin").read_bytes())
    assert frames[-1].channels[0].valid
    assert (tmp_path / "record/bravo/only/frames.bin").read_bytes().count(b"$") > 50
    for name, (lat, lon, _) in zip(("alpha", "bravo"), HOMES.values(), strict=True):
        assert f"{name}: datum: {lat:.7f}, {lon:.7f}" in ended.err


def test_python_returns_the_frames_of_all_vehicles(log: Path, fleet: Path) -> None:
    frames = arva_hil.replay(log, arva_hil.load_scenario(fleet))
    assert {made.vehicle for made in frames} == {"alpha", "bravo"}
    last = {made.vehicle: made for made in frames}
    assert all(made.pose is not None for made in last.values())
    again = arva_hil.replay(log, arva_hil.load_scenario(fleet))
    assert [made.frame for made in again] == [made.frame for made in frames]


def test_one_receiver_of_a_fleet_writes_to_out(arva: Arva, log: Path, tmp_path: Path) -> None:
    one = tmp_path / "one.yaml"
    one.write_text("".join(line for line in FLEET.splitlines(keepends=True) if "bravo" not in line))
    assert arva("replay", log, "--scenario", one, "--out", tmp_path / "frames").code == 0
    assert frames_in((tmp_path / "frames").read_bytes())[-1].channels[0].valid


@pytest.mark.parametrize(
    ("options", "what"),
    [
        (["--port", "pty"], "each receiver has its own port"),
        (["--out", "frames"], "has 2 receivers: --record DIR writes the frames of each"),
        (["--target-system", "1"], "each vehicle has its own system"),
        (["--rate", "5"], "--rate: each receiver"),
    ],
)
def test_what_cannot_be_for_several_is_refused(
    arva: Arva, log: Path, fleet: Path, options: list[str], what: str
) -> None:
    ended = arva("replay", log, "--scenario", fleet, *options)
    assert (ended.code, what in ended.err) == (2, True)


def test_vehicles_that_only_their_links_tell_apart_are_refused(arva: Arva, log: Path, fleet: Path) -> None:
    fleet.write_text(FLEET.replace("system: 2", "system: 1"))
    ended = arva("replay", log, "--scenario", fleet)
    assert ended.code == 2
    assert "alpha, bravo are all on" in ended.err
    assert "give each its own `system`" in ended.err
    with pytest.raises(ValueError, match="alpha, bravo are all on"):
        arva_hil.replay(log, arva_hil.load_scenario(fleet))
