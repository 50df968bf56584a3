"""Records: `--record DIR` of a run, also of one that is killed; those of a real receiver, and `compare`."""

from __future__ import annotations

import csv
import json
import os
import signal
import subprocess
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import pytest
from pymavlink import mavutil

from arva_hil.clock import RealClock
from arva_hil.links.pty import PtyLink
from arva_hil.links.tlog import TlogReader
from arva_hil.mavlink.codec import Encoder, dialect
from arva_hil.records.fitting import ReceiverFit, fit
from arva_hil.records.reading import load
from firmware_proto import Decoder, Frame
from firmware_proto.nmea import encode_nmea
from tests.files import rows, written
from tests.files import rows as table
from tests.rehearsed import rehearse
from tests.said import says
from tools.figures.rehearsal import Waypoint, drawn
from tools.soak import kills as random_kills

from ..records.test_comparing import FLIGHT, PLACE, POINTS, QUIET
from ..records.test_fitting import SHORT
from .far_ends import (
    ORDINARY,
    SPEED,
    Arva,
    Autopilot,
    Beacon,
    Keep,
    Program,
    Start,
    contents,
    frames_in,
    full_disk,
    hears,
    heartbeat,
    read_frames,
    until,
)

DATA = Path(__file__).parent.parent / "data"
COLUMNS = (
    "seq,time_s,boot_ms,north_m,east_m,down_m,roll_deg,pitch_deg,yaw_deg,pose_age_ms,"
    "slot,id,zone,d_cm,delta_deg,true_range_m,faults,reported_north_m,reported_east_m,reported_down_m,late_ms"
).split(",")


class Recorded(NamedTuple):
    folder: Path
    consumed: list[Frame]
    program: Program


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    """One run with everything on, in real time, ended by Ctrl-C."""
    folder = tmp_path_factory.mktemp("run") / "a" / "record"
    line, vehicle = PtyLink(), Autopilot(PtyLink(), speed=1.0)
    program = Program(
        "--port", line.path, "--autopilot", vehicle.address, "--rate", 50, "--seed", 7, "--record", folder, speed=1.0
    )
    try:
        frames = read_frames(line, 60)
        program.stops(signal.SIGINT)
        frames += frames_in(line.read())
        return Recorded(folder, frames, program)
    finally:
        for thing in (program, vehicle, line):
            thing.close()


def test_ctrl_c_leaves_whole_files_that_hold_every_frame(recorded: Recorded) -> None:
    assert frames_in((recorded.folder / "frames.bin").read_bytes()) == recorded.consumed
    assert hears(recorded.consumed[-1])


def test_readings_csv_has_the_pinned_columns_and_says_what_the_frames_say(recorded: Recorded) -> None:
    with open(recorded.folder / "readings.csv", newline="") as file:
        header, *rows = csv.reader(file)
    assert header == COLUMNS
    readings = [dict(zip(COLUMNS, row, strict=True)) for row in rows]
    channels = [(frame.sequence, slot, c) for frame in recorded.consumed for slot, c in enumerate(frame.channels, 1)]
    assert len(readings) == len(channels)
    for row, (sequence, slot, channel) in zip(readings, channels, strict=True):
        assert (int(row["seq"]), int(row["slot"])) == (sequence, slot)
        assert (int(row["d_cm"]), int(row["delta_deg"]), int(row["zone"])) == (channel.d, channel.delta, channel.zone)
        assert row["id"] == ("" if channel.id is None else str(channel.id))
    times = [float(row["time_s"]) for row in readings[::4]]
    assert times == pytest.approx([n / 50 for n in range(len(times))])
    first, last = readings[0], readings[-4]
    assert {first["north_m"], first["yaw_deg"], first["pose_age_ms"], first["true_range_m"]} == {""}  # no pose yet
    assert [float(last[name]) for name in ("north_m", "east_m", "down_m", "yaw_deg")] == pytest.approx([0] * 4, abs=0.1)
    assert float(last["true_range_m"]) == pytest.approx(20.616, abs=0.1)
    assert [last[f"reported_{axis}_m"] for axis in ("north", "east", "down")] == [
        last[name] for name in ("north_m", "east_m", "down_m")
    ]
    assert float(last["boot_ms"]) > 0
    (read,) = load(recorded.folder).receivers
    assert read.d_cm.tolist() == [channel.d for _, _, channel in channels]
    assert read.time_s.tolist() == times
    assert (read.late_ms >= 0).all()


def test_the_tlog_opens_in_mavutil_and_has_every_packet(recorded: Recorded) -> None:
    run = json.loads((recorded.folder / "run.json").read_bytes())
    log = mavutil.mavlink_connection(str(recorded.folder / "autopilot.tlog"))
    messages = []
    while (message := log.recv_msg()) is not None:
        messages.append(message)
    log.close()
    assert len(messages) == run["counters"]["packets_received"]
    assert {"HEARTBEAT", "GLOBAL_POSITION_INT", "ATTITUDE", "HOME_POSITION"} <= {m.get_type() for m in messages}
    stamps = [message._timestamp for message in messages]
    assert stamps == sorted(stamps)
    made = (recorded.folder / "run.json").stat().st_mtime
    assert made - 30 < stamps[0] <= stamps[-1] <= made + 1


def test_run_json_says_what_ran_and_how_it_ended(recorded: Recorded) -> None:
    run = json.loads((recorded.folder / "run.json").read_bytes())
    assert (run["ended"], run["exit_code"], run["seed"]) == ("SIGINT", 130, 7)
    assert run["scenario"]["transmitters"][0]["ned"] == [20, 5, 0]
    assert run["scenario"]["receiver"]["rate_hz"] == 50
    assert {"arva-hil", "python", "numpy", "pymavlink"} <= run["versions"].keys()
    assert (run["counters"]["frames"], run["counters"]["bad_checksums"]) == (len(recorded.consumed), 0)
    assert run["vehicle"]["system"] == 1
    assert run["datum"] == pytest.approx([46.0123, 7.7456, 1650.0])
    assert f"{len(recorded.consumed)} frames: {len(recorded.consumed)} sent, 0 dropped" in recorded.program.err


def test_a_run_that_fails_says_so_in_its_record(start: Start, line: PtyLink, tmp_path: Path) -> None:
    start("--port", line.path, "--autopilot", "pty", "--timeout", 0.2, "--record", tmp_path / "record").ends(3)
    run = json.loads((tmp_path / "record" / "run.json").read_bytes())
    assert run["exit_code"] == 3
    assert "no byte came" in run["ended"]
    assert (run["vehicle"], run["datum"]) == (None, None)


# -- where a record cannot be created -------------------------------------------------------------------------


def test_an_existing_record_is_never_overwritten(arva: Arva, tmp_path: Path) -> None:
    kept = written(tmp_path / "readings.csv", "of yesterday")
    err = arva.refused("replay", DATA / "px4.tlog", "--record", tmp_path)
    says(err, "holds a record already (readings.csv); name another folder", str(tmp_path))
    assert kept.read_text() == "of yesterday"
    assert os.listdir(tmp_path) == ["readings.csv"]


def test_a_file_is_no_folder_for_a_record(arva: Arva, tmp_path: Path) -> None:
    file = written(tmp_path / "file", "mine")
    assert f"{file}: is no folder; name another one" in arva.refused("replay", DATA / "px4.tlog", "--record", file)
    assert file.read_text() == "mine"


def test_a_read_only_folder_is_no_place_for_a_record(start: Start, tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    try:
        program = start("replay", DATA / "px4.tlog", "--record", tmp_path / "record", before=ORDINARY)
        program.ends(2)
    finally:
        tmp_path.chmod(0o700)
    assert f"{tmp_path / 'record'}: cannot record: Permission denied" in program.err


def test_a_full_disk_ends_the_record_but_not_the_frames(
    start: Start, keep: Keep, line: PtyLink, tmp_path: Path
) -> None:
    autopilot = keep(Autopilot(keep(PtyLink()), speed=1.0))
    program = start(
        *("--port", line.path, "--autopilot", autopilot.address, "--rate", 50, "--duration", 3),
        *("--record", tmp_path / "record"),
        **full_disk(),
        stdout=subprocess.DEVNULL,
    ).after("frames go on")
    program.ends(1)
    frames = frames_in(line.read())
    assert program.err.count("frames go on") == 1
    assert f"error: {tmp_path / 'record'}: cannot record: File too large" in program.err.splitlines()[-1]
    assert 0 < len(frames_in((tmp_path / "record" / "frames.bin").read_bytes())) < len(frames)
    rows = (tmp_path / "record" / "readings.csv").read_text().splitlines()
    assert {row.count(",") for row in rows} == {len(COLUMNS) - 1}
    run = json.loads((tmp_path / "record" / "run.json").read_bytes())
    assert run["exit_code"] == 1
    assert "File too large" in run["ended"]
    assert run["counters"]["frames"] >= len(frames)


def test_a_full_disk_ends_a_replay_with_an_error(arva: Arva) -> None:
    err = arva("replay", DATA / "px4.tlog", "--out", "/dev/full", code=1).err
    assert "error: /dev/full: cannot be written: No space left on device" in err


def test_a_key_on_the_link_is_not_recorded(start: Start, keep: Keep, line: PtyLink, tmp_path: Path) -> None:
    """Somebody sets up signing on the link that is recorded."""
    autopilot = keep(PtyLink())
    program = start("--port", line.path, "--autopilot", autopilot.path, "--record", tmp_path, "--timeout", 30).after(
        "frames to"
    )
    key = list(b"0123456789abcdef" * 2)
    autopilot.write(
        Encoder(255, 190).pack(dialect.MAVLink_setup_signing_message(1, 1, key, 1)) + heartbeat(Encoder(1, 1))
    )
    program.says("vehicle ardupilotmega")
    program.stops(signal.SIGINT)
    assert len(list(TlogReader(tmp_path / "autopilot.tlog"))) == 1
    assert not any(bytes(key) in data for data in contents(tmp_path).values())
    assert json.loads((tmp_path / "run.json").read_text())["counters"]["packets_received"] == 2


# -- a program that is ended or killed at any moment leaves a record that says so, and the next start works ----


LOST_S = 1.0  # docs/howto/recordings.md


def test_a_frame_every_ten_seconds_and_killed_the_log_is_there_to_a_second_before(
    start: Start, keep: Keep, line: PtyLink, tmp_path: Path
) -> None:
    """In real time, which is that of the log."""
    folder, autopilot = tmp_path / "record", keep(Autopilot(keep(PtyLink()), speed=1.0))
    program = start(
        "--port", line.path, "--autopilot", autopilot.address, "--rate", 0.1, "--seed", 7, "--record", folder, speed=1.0
    ).after("datum: ")
    RealClock().wait(1.4)
    at = time.time_ns() // 1000
    program.send(signal.SIGKILL)
    program.ends(-signal.SIGKILL)
    run = json.loads((folder / "run.json").read_bytes())
    assert (run["ended"], run["exit_code"], run["seed"]) == (None, None, 7)
    assert run["scenario"]["receiver"]["rate_hz"] == 0.1
    assert {"arva-hil", "python"} <= run["versions"].keys()
    assert run["started"].endswith("Z")
    assert list(TlogReader(str(folder / "autopilot.tlog")))[-1].time_us > at - LOST_S * 1e6
    with (folder / "readings.csv").open(newline="") as file:
        header, *rows = csv.reader(file)
    assert header == COLUMNS
    assert [row[0] for row in rows] == ["0"] * 4
    assert [frame.sequence for frame in frames_in((folder / "frames.bin").read_bytes())] == [0]
    assert (folder / "frames.csv").read_text().count("\n") == 2


def test_what_a_killed_program_sent_is_recorded_to_a_second_before_and_not_written_over(
    start: Start, keep: Keep, line: PtyLink, tmp_path: Path
) -> None:
    folder, rate_hz, autopilot = tmp_path / "record", 20, keep(Autopilot(keep(PtyLink()), speed=1.0))
    program = start(
        "--port", line.path, "--autopilot", autopilot.address, "--rate", rate_hz, "--record", folder, speed=1.0
    )
    frames = read_frames(line, 47)
    program.send(signal.SIGKILL)
    program.ends(-signal.SIGKILL)
    frames += frames_in(line.read())
    assert json.loads((folder / "run.json").read_bytes())["ended"] is None
    recorded = frames_in((folder / "frames.bin").read_bytes())
    assert recorded == frames[: len(recorded)]
    assert len(recorded) >= len(frames) - LOST_S * rate_hz
    for name, each in (("readings.csv", 4), ("frames.csv", 1)):
        rows = table(folder / name)
        assert len(rows) >= each * (len(frames) - LOST_S * rate_hz)
        assert [int(row["seq"]) for row in rows] == [n // each for n in range(len(rows))]
        assert all(None not in row.values() and None not in row for row in rows)
    start("--port", "pty", "--autopilot", "pty", "--record", folder).ends(2)
    start("replay", folder / "autopilot.tlog", "--rate", 20, "--out", tmp_path / "again").ends()
    assert frames_in((tmp_path / "again").read_bytes())


# -- a command that is ended at any moment leaves nothing behind, and the next start works ---------------------


def test_two_random_ends_leave_nothing(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(random_kills, "COMMANDS", ("run", "search"))
    code = random_kills.main(["--kills", "2", "--seed", "49"])  # SIGKILL; SIGINT to all of a search
    said = capsys.readouterr().out
    assert code == 0, said
    assert "run: exit codes {-9: 1}" in said


def test_a_run_that_stood_still_skips_frames_and_goes_on(
    start: Callable[..., Program], autopilot: Autopilot, line: PtyLink
) -> None:
    program = start("--port", line.path, "--autopilot", autopilot.address, "--rate", 50)
    read_frames(line, 50)
    program.send(signal.SIGSTOP)
    clock, decoder, frames = RealClock(SPEED), Decoder(), list[Frame]()
    clock.wait(2.0)
    program.send(signal.SIGCONT)
    until(lambda: frames.extend(decoder.feed(line.read(), clock.now())) or len(frames) > 150)
    assert decoder.lost >= 20
    program.stops()
    assert "frames were skipped: the program was delayed by more than a second" in program.err


# -- a real receiver (a pseudo-terminal here): `record`, `decode` and `compare`, and what its page does with the--


def test_a_receiver_is_recorded_beside_an_autopilot(
    arva: Arva, autopilot: Autopilot, beacon: Beacon, tmp_path: Path
) -> None:
    words = ("--autopilot", autopilot.address, "--receiver", beacon.link.path, "--transmitter", "4=46.0133,7.7456,1650")
    arva("record", *words, "--duration", 9, tmp_path / "r")
    said = json.loads((tmp_path / "r" / "run.json").read_text())
    assert (said["source"], said["ended"], said["format"]) == ("receiver", "finished", "binary")
    assert said["counters"]["frames"] > 50
    readings = [row for row in rows(tmp_path / "r" / "readings.csv") if row["north_m"]]
    first = readings[-2]
    assert (first["id"], first["d_cm"], first["delta_deg"]) == ("4", "2000", "10")
    assert 105 < float(first["true_range_m"]) < 117
    assert (readings[-1]["id"], readings[-1]["true_range_m"]) == ("9", "")
    assert (tmp_path / "r" / "autopilot.tlog").stat().st_size > 1000
    arva("record", *words, tmp_path / "r", code=2)


def test_another_format_is_named_and_its_bytes_are_kept_and_decoded_later(
    arva: Arva, autopilot: Autopilot, keep: Keep, tmp_path: Path
) -> None:
    words = ("--autopilot", autopilot.address, "--receiver", keep(Beacon(encode_nmea)).link.path, "--duration", 4)
    err = arva("record", *words, tmp_path / "r", code=1).err
    says(err, "poses without frames: no binary frame in", "the bytes are nmea: --format nmea")
    arva("decode", tmp_path / "r", "--format", "nmea", "--out", tmp_path / "again")
    assert len(rows(tmp_path / "again" / "readings.csv")) > 40
    assert (tmp_path / "again" / "frames.bin").read_bytes() == (tmp_path / "r" / "frames.bin").read_bytes()


def test_frames_without_an_autopilot_are_kept_and_end_with_3(
    arva: Arva, beacon: Beacon, line: PtyLink, tmp_path: Path
) -> None:
    words = ("--autopilot", line.path, "--receiver", beacon.link.path, "--timeout", 1.5)
    assert "no poses: " in arva("record", *words, tmp_path / "r", code=3).err
    assert len(rows(tmp_path / "r" / "readings.csv")) > 10


def test_poses_without_frames_are_said(arva: Arva, autopilot: Autopilot, line: PtyLink, tmp_path: Path) -> None:
    words = ("--autopilot", autopilot.address, "--receiver", line.path, "--duration", 2.5)
    assert "poses without frames: the receiver has sent nothing" in arva("record", *words, tmp_path / "r", code=1).err


def test_a_place_surveyed_later_gives_the_ranges(arva: Arva, tmp_path: Path) -> None:
    folder = rehearse(tmp_path / "r", QUIET, POINTS)
    arva("decode", folder, "--transmitter", "1={},{},{}".format(*PLACE[1:]), "--out", tmp_path / "again")
    before, after = rows(folder / "readings.csv"), rows(tmp_path / "again" / "readings.csv")
    assert [row["d_cm"] for row in before] == [row["d_cm"] for row in after]
    assert {row["true_range_m"] for row in before} == {""}
    assert 20 < float(after[40]["true_range_m"]) < 40


@pytest.mark.undrawn
@pytest.mark.parametrize("surveyed", [(), (PLACE,)], ids=["no place", "surveyed"])
def test_every_tool_reads_such_a_record(arva: Arva, tmp_path: Path, surveyed: tuple[()]) -> None:
    folder = rehearse(tmp_path / "r", QUIET, POINTS, surveyed=surveyed)
    for words in (
        ("plot", folder, "--out", tmp_path / "sheet.png"),
        ("report", folder, "--out", tmp_path / "report.html"),
        *(("export", folder, "--out", tmp_path / f"flight.{kind}") for kind in ("kml", "gpx", "geojson", "csv")),
        ("listen", folder / "frames.bin"),
    ):
        arva(*words)
    assert "a real one at" in (tmp_path / "report.html").read_text()


def test_a_record_of_the_emulator_cannot_be_decoded(arva: Arva, tmp_path: Path) -> None:
    folder = rehearse(tmp_path / "r", QUIET, POINTS)
    (folder / "chunks.csv").unlink()
    assert "only a record of `arva-hil record` has one" in arva.refused("decode", folder, "--out", tmp_path / "again")


# -- the page on a real receiver: the emulator stands in for it over pseudo-terminals; then a flight, its fit, a--


def test_the_emulator_is_recorded_as_if_it_were_a_receiver(arva: Arva, start: Start, tmp_path: Path) -> None:
    one, two, receiver = tmp_path / "vehicle-1", tmp_path / "vehicle-2", tmp_path / "receiver"
    start("vehicle", "--link", f"pty:{one}", "--link", f"pty:{two}").says("on the ground")
    start("--autopilot", one, "--port", f"pty:{receiver}").says("readings are real")
    arva("record", "--autopilot", two, "--receiver", receiver, "--duration", 14, tmp_path / "r")
    said = json.loads(arva("compare", tmp_path / "r", "--scenario", "builtin:default", "--json").out)
    assert said["both"] >= 5
    assert abs(said["all"]["ratio"] - 1) < 0.05


def test_a_fit_of_one_flight_agrees_with_a_second_one(
    arva: Arva, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real, found = fit.fit, list[ReceiverFit]()
    monkeypatch.setattr(fit, "fit", lambda *how: (found or found.append(real(*how)) or found)[0])
    chosen, truth = drawn(7)
    chosen = replace(chosen, navigation_error=None)
    first = rehearse(tmp_path / "first", chosen, SHORT[:9], latency_s=truth["latency"])
    second = rehearse(tmp_path / "second", replace(chosen, seed=9), SHORT[4:13], latency_s=truth["latency"])
    (site := tmp_path / "sites" / "my_site.yaml").parent.mkdir()
    words = ("--out", tmp_path / "my_receiver.yaml", "--scenario-out", site, "--gps-sigma", 0.05)
    out = arva("fit", first, "--model", "paper", *words).out
    says(out, "kappa_eq", "95 % interval")
    arva("check", tmp_path / "my_receiver.yaml", site)
    ended = arva("fit", first, "--out", "-")
    assert (ended.out, out in ended.err) == ((tmp_path / "my_receiver.yaml").read_text(), True)
    says(arva.refused("fit", first, "--out", "-", "--json"), "--json and the file both go to stdout: choose one")
    says(arva.refused("fit", first, "--out", "-", "--scenario-out", site), "the scenario names the file of the profile")
    out = arva("compare", second, "--scenario", site, "--json").out
    said = json.loads(out)
    assert abs(said["all"]["ratio"] - 1) < 0.01
    assert abs(said["all"]["d_bias_m"]) < said["all"]["d_scatter_m"]


# -- `arva-hil compare`: a table, objects or a picture; what cannot be compared is said ------------------------


@pytest.fixture
def record(tmp_path: Path) -> Path:
    return rehearse(tmp_path / "r", QUIET, FLIGHT)


def test_a_table_objects_and_a_picture(arva: Arva, record: Path, tmp_path: Path) -> None:
    out = arva("compare", record, "--scenario", "builtin:default", "--out", tmp_path / "c.png").out
    says(out, "transmitter 1: 60 of 61 frames in both", "by zone")
    assert (tmp_path / "c.png").read_bytes().startswith(b"\x89PNG")
    out = arva("compare", record, "--scenario", "builtin:default", "--json").out
    assert json.loads(out)["both"] == 60


def test_two_records(arva: Arva, record: Path, tmp_path: Path) -> None:
    assert "frames in both" in arva("compare", record, rehearse(tmp_path / "other", replace(QUIET, seed=3), FLIGHT)).out


def test_what_cannot_be_compared_is_said(arva: Arva, record: Path, tmp_path: Path) -> None:
    def refused(*words: object) -> str:
        return arva("compare", *words, code=(1, 2)).err

    assert "name one to compare with" in refused(record)
    assert "name one to compare with" in refused(record, record, "--scenario", "builtin:default")
    assert "expected a file name" in refused(record, "--scenario", "builtin:default", "--out", "x.gif")
    assert "vehicles: name a scenario of one receiver" in refused(record, "--scenario", "builtin:two_vehicles")
    far = [Waypoint(point.time_s, point.north + 60, point.east, point.down, 45) for point in FLIGHT]
    assert "are of two flights, and only 0 frames are at common places" in refused(
        record, rehearse(tmp_path / "other", QUIET, far)
    )
    (record / "autopilot.tlog").unlink()
    assert "there are no poses in it" in refused(record, "--scenario", "builtin:default")


@pytest.mark.parametrize(("cell", "why"), [(3, "frames without poses"), (None, "poses without frames")])
def test_a_record_that_lacks_a_side_is_said(arva: Arva, record: Path, cell: int | None, why: str) -> None:
    head, *rows = (record / "readings.csv").read_text().splitlines()
    kept = []
    for row in rows if cell else ():
        cells = row.split(",")
        cells[3:9] = [""] * 6
        kept.append(",".join(cells))
    (record / "readings.csv").write_text("\n".join([head, *kept]) + "\n")
    assert why in arva("compare", record, "--scenario", "builtin:default", code=1).err
