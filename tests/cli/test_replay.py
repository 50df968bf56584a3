"""`replay`: a recorded flight instead of a vehicle; the same log, scenario and seed give the same bytes."""

from __future__ import annotations

import json
import os
import re
import signal
from pathlib import Path

import pytest

import arva_hil
from arva_hil.clock import RealClock
from arva_hil.links.pty import PtyLink
from arva_hil.links.tlog import TlogReader, tlog_record
from arva_hil.mavlink.codec import Encoder, Parser, dialect
from arva_hil.simulated.vehicle import SimulatedVehicle
from firmware_proto import SYNTHETIC
from tests.files import written
from tests.said import says

from .far_ends import Arva, Consumer, Start, contents, frames_in, heartbeat

LOG = Path(__file__).parent.parent / "data" / "arducopter.tlog"


def frames_of(err: str) -> int:
    return int(re.search(r"^(\d+) frames: ", err, re.MULTILINE)[1])  # type: ignore[index]


def test_frames_go_to_a_file_or_to_stdout(arva: Arva, start: Start, tmp_path: Path) -> None:
    arva("replay", LOG, "--out", tmp_path / "frames.bin")
    program = start("replay", LOG, "--out", "-")
    program.ends()
    written = (tmp_path / "frames.bin").read_bytes()
    assert program.out == written
    frames = frames_in(written)
    assert len(frames) == 30
    assert all(frame.status & SYNTHETIC for frame in frames)


def test_without_a_place_to_go_frames_are_lines_on_stdout(arva: Arva) -> None:
    ended = arva("replay", LOG)
    assert len(ended.out.splitlines()) == frames_of(ended.err)
    assert re.search(r"^ +20\.000 s +20  #1 mid \d+ cm [+-]\d+°$", ended.out, re.MULTILINE)


def test_a_port_gets_the_frames_in_the_logs_rhythm_times_the_speed(start: Start, line: PtyLink) -> None:
    clock = RealClock()
    program = start("replay", LOG, "--port", line.path, "--speed", 20)
    consumer = Consumer(line)
    consumer.read(26)
    program.ends()
    assert clock.now() > 29 / 20  # the log's last frame is at 29 s
    consumer.read(frames_of(program.err) - len(consumer.frames))
    assert len(consumer.frames) == frames_of(program.err)
    assert consumer.frames[-1].channels[0].valid


def test_json_is_one_object_a_frame(arva: Arva) -> None:
    ended = arva("replay", LOG, "--json")
    every = [json.loads(line) for line in ended.out.splitlines()]
    objects = [said for said in every if "event" not in said]
    names = [said["event"] for said in every if "event" in said]
    assert names[:2] == ["vehicle_found", "datum_set"]
    assert "pose_found" in names
    assert [said["time_s"] for said in objects] == pytest.approx(range(frames_of(ended.err)))
    assert objects[-1]["channels"][0]["id"] == 1


def test_every_line_says_which_faults_its_frame_met(arva: Arva) -> None:
    faults = ("--fault", "drop=1@10-12", "--fault", "stuck@11-13")
    met = {10: ["drop"], 11: ["stuck", "drop"], 12: ["stuck"]}
    ended = arva("replay", LOG, "--json", "--out", os.devnull, *faults)
    objects = [said for line in ended.out.splitlines() if "event" not in (said := json.loads(line))]
    assert {(n, tuple(said["faults"])) for n, said in enumerate(objects)} == {
        (n, tuple(met.get(n, ()))) for n in range(frames_of(ended.err))
    }
    for said in (arva("replay", LOG, *faults).out, arva("replay", LOG, "--out", os.devnull, "-v", *faults).err):
        lines = re.findall(r"^(?: +[\d.]+ s )? *(\d+)  ?(?:#|no signal).*?(?:  \[(.*)\])?$", said, re.MULTILINE)
        assert {int(n): names.split(", ") for n, names in lines if names} == met
        assert len(lines) == frames_of(ended.err)


# -- logs that are not what they should be -----------------------------------------------------------------


def test_garbage_and_a_torn_tail_are_passed_over_and_counted(arva: Arva, tmp_path: Path) -> None:
    records = [tlog_record(*record) for record in TlogReader(LOG)]
    middle = len(records) // 2
    log = written(tmp_path / "torn.tlog", b"".join(records[:middle]) + b"\x55" * 100 + b"".join(records[middle:])[:-5])
    whole, hurt = arva("replay", LOG, "--out", os.devnull), arva("replay", log, "--out", os.devnull)
    assert frames_of(hurt.err) == frames_of(whole.err)
    assert f"{log}: 100 bytes of garbage, {len(records[-1]) - 5} of an incomplete last record" in hurt.err
    assert "garbage" not in whole.err


def test_a_log_without_an_autopilot_has_no_vehicle(arva: Arva, tmp_path: Path) -> None:
    station = Encoder(255, 190)
    hello = (heartbeat(station, dialect.MAV_TYPE_GCS, dialect.MAV_AUTOPILOT_INVALID) for _ in range(5))
    log = written(
        tmp_path / "station.tlog",
        b"".join(tlog_record((1_700_000_000 + n) * 1_000_000, raw) for n, raw in enumerate(hello)),
    )
    ended = arva("replay", log, "--out", os.devnull, code=3)
    assert "no autopilot's heartbeat: heartbeats of gcs from 255/190 ×5" in ended.err


def test_another_vehicle_than_the_logs_can_be_asked_for(arva: Arva) -> None:
    ended = arva("replay", LOG, "--out", os.devnull, "--target-system", 9, code=3)
    says(ended.err, "packets came, but none of the wanted vehicle: packets from 1/1 ×", "; is its system id right?")


def test_the_log_itself_is_never_written_to(arva: Arva, tmp_path: Path) -> None:
    log = written(tmp_path / "flight.tlog", LOG.read_bytes())
    assert "this is the log itself: name another file" in arva.refused("replay", log, "--out", log)
    assert log.read_bytes() == LOG.read_bytes()


def test_ctrl_c_ends_it_with_whole_files(start: Start, line: PtyLink, tmp_path: Path) -> None:
    program = start("replay", LOG, "--port", line.path, "--rate", 20, "--record", tmp_path)
    consumer = Consumer(line)
    consumer.read(5)
    program.stops(signal.SIGINT)
    recorded = contents(tmp_path)
    sent = frames_in(recorded["frames.bin"])
    consumer.read(len(sent) - len(consumer.frames))
    assert consumer.frames == sent
    assert json.loads(recorded["run.json"])["ended"] == "SIGINT"


# -- a recorded flight of several vehicles, replayed by commands and in Python ---------------------------------


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
    return written(tmp_path / "fleet.yaml", FLEET)


def test_each_vehicle_of_a_log_has_a_record_as_in_the_run(arva: Arva, log: Path, fleet: Path, tmp_path: Path) -> None:
    ended = arva("replay", log, "--scenario", fleet, "--record", tmp_path / "record")
    assert "all vehicles of" in ended.err
    assert ended.err.count(f"{log.stat().st_size - 8 * len(list(TlogReader(log)))} bytes, ") == 1
    assert "\nautopilot (2 vehicles): " in ended.err
    assert frames_in((tmp_path / "record/alpha/front/frames.bin").read_bytes())[-1].channels[0].valid
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
    one = written(
        tmp_path / "one.yaml", "".join(line for line in FLEET.splitlines(keepends=True) if "bravo" not in line)
    )
    arva("replay", log, "--scenario", one, "--out", tmp_path / "frames")
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
    assert what in arva.refused("replay", log, "--scenario", fleet, *options)


def test_vehicles_that_only_their_links_tell_apart_are_refused(arva: Arva, log: Path, fleet: Path) -> None:
    fleet.write_text(FLEET.replace("system: 2", "system: 1"))
    says(arva.refused("replay", log, "--scenario", fleet), "alpha, bravo are all on", "give each its own `system`")
    with pytest.raises(ValueError, match="alpha, bravo are all on"):
        arva_hil.replay(log, arva_hil.load_scenario(fleet))
