"""Recorded flights through the whole chain, against oracles written by others, and against themselves."""

from __future__ import annotations

import csv
import functools
import json
import math
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from arva_hil.cli.main import main
from arva_hil.links.tlog import TlogReader, tlog_record
from arva_hil.mavlink.codec import Encoder
from arva_hil.records.writing import COLUMNS

KAPPA = 1.542
FILES = ("frames.bin", "frames.csv", "readings.csv", "autopilot.tlog")
SCENARIO = """\
datum: {lat: %.9f, lon: %.9f, alt: %.3f}
transmitters:
  - {id: 4, ned: [20.0, 5.0, 1.0], attitude: {roll: 10, pitch: -20, yaw: 30}}
  - {id: 9, enu: [1.0, 2.0, 0.5], attitude: {yaw: 100}, strength: 0.7}
receiver:
  rate_hz: 7.0
  noise: {kind: off}
  mount: {position: [0.1, -0.2, 0.3], attitude: {roll: 3, pitch: 5, yaw: -40}}
"""


@functools.cache
def messages(log: Path) -> dict[str, list[Any]]:
    """The autopilot's messages by name, read by pymavlink alone."""
    data, at, found = log.read_bytes(), 0, {}  # type: ignore[var-annotated]
    codec = dialect.MAVLink(None)
    while at < len(data):
        size = data[at + 9] + (8 if data[at + 8] == 0xFE else 12)
        message = codec.decode(bytearray(data[at + 8 : at + 8 + size]))
        if (message.get_srcSystem(), message.get_srcComponent()) == (1, 1):
            found.setdefault(message.get_type(), []).append(message)
        at += 8 + size
    return found


def rows(folder: Path) -> list[dict[str, str]]:
    with (folder / "readings.csv").open(newline="") as file:
        reader = csv.DictReader(file)
        assert reader.fieldnames == COLUMNS
        return list(reader)


def replay(flight: Path, folder: Path, *options: str) -> None:
    assert main(["replay", str(flight), "--record", str(folder), *options]) == 0


@pytest.fixture
def recorded(
    flight: Path, tmp_path: Path, replayed: dict[Path, list[dict[str, str]]]
) -> tuple[Path, list[dict[str, str]], tuple[float, float, float]]:
    """A flight replayed, noise off, a turned mount and two turned transmitters: log, readings, datum."""
    home = messages(flight)["HOME_POSITION"][-1]
    datum = (home.latitude / 1e7, home.longitude / 1e7, home.altitude / 1e3)
    if flight not in replayed:
        (scenario := tmp_path / "scenario.yaml").write_text(SCENARIO % datum)
        replay(flight, tmp_path / "record", "--scenario", str(scenario))
        replayed[flight] = rows(tmp_path / "record")
    return flight, replayed[flight], datum


@pytest.fixture(scope="module")
def replayed() -> dict[Path, list[dict[str, str]]]:
    """The readings of each flight, once."""
    return {}


def test_every_pose_is_the_logs_own_interpolated_at_its_instant(
    recorded: tuple[Path, list[dict[str, str]], tuple[float, float, float]],
) -> None:
    import pymap3d  # here, as below: they take a second, in every worker that only collects these tests
    from scipy.interpolate import CubicHermiteSpline
    from scipy.spatial.transform import Rotation, Slerp

    flight, read, datum = recorded
    said = messages(flight)
    where = {m.time_boot_ms: m for m in said["GLOBAL_POSITION_INT"]}
    times = np.array(list(where)) / 1e3
    ned = np.array([pymap3d.geodetic2ned(m.lat / 1e7, m.lon / 1e7, m.alt / 1e3, *datum) for m in where.values()])
    velocity = np.array([(m.vx, m.vy, m.vz) for m in where.values()]) / 100
    position = CubicHermiteSpline(times, ned, velocity)
    turned = {m.time_boot_ms: [m.yaw, m.pitch, m.roll] for m in said["ATTITUDE"]}
    attitude = Slerp(np.array(list(turned)) / 1e3, Rotation.from_euler("ZYX", list(turned.values())))
    mount = Rotation.from_euler("ZYX", [-40, 5, 3], degrees=True)
    last = min(times[-1], attitude.times[-1])
    posed = [row for row in read if row["north_m"] and row["slot"] == "1" and float(row["boot_ms"]) / 1e3 <= last]
    assert len(posed) > 120
    for row in posed:
        t = float(row["boot_ms"]) / 1e3
        body = attitude(t)
        wanted = position(t) + body.apply([0.1, -0.2, 0.3])
        assert np.allclose([float(row[k]) for k in ("north_m", "east_m", "down_m")], wanted, atol=2e-4)
        euler = [float(row[k]) for k in ("yaw_deg", "pitch_deg", "roll_deg")]
        turn = Rotation.from_euler("ZYX", euler, degrees=True).inv() * (body * mount)
        assert np.degrees(turn.magnitude()) < 0.05  # ATTITUDE and ATTITUDE_QUATERNION do not quite agree


def test_every_reading_is_what_the_papers_equations_give_at_the_rows_pose(
    recorded: tuple[Path, list[dict[str, str]], tuple[float, float, float]],
) -> None:
    from magpylib import mu_0
    from magpylib.misc import Dipole
    from scipy.spatial.transform import Rotation

    _, read, _ = recorded
    beacons = {  # id: position, attitude, strength
        4: ([20.0, 5.0, 1.0], [30, -20, 10], 1.0),
        9: ([2.0, 1.0, -0.5], [100, 0, 0], 0.7),
    }
    heard = {4: 0, 9: 0}
    zones = set()
    for row in read:
        if row["north_m"] == "" or row["id"] == "":
            continue
        at = [float(row[k]) for k in ("north_m", "east_m", "down_m")]
        euler = [float(row[k]) for k in ("yaw_deg", "pitch_deg", "roll_deg")]
        place, turned, strength = beacons[int(row["id"])]
        moment = Rotation.from_euler("ZYX", turned, degrees=True).apply([strength, 0, 0])
        field = Dipole(moment=moment, position=place).getB(at) / mu_0
        x, y, z = Rotation.from_euler("ZYX", euler, degrees=True).inv().apply(field)
        full = (KAPPA / (4 * math.pi * math.hypot(x, y, z))) ** (1 / 3)
        flat = (KAPPA / (4 * math.pi * math.hypot(x, y))) ** (1 / 3)
        if full <= 3:
            wanted = (2, 100 * full, 0.0)
        else:
            assert flat <= 50
            wanted = (1, 100 * flat, math.degrees(math.atan(y / x)))
        zones.add(wanted[0])
        assert int(row["zone"]) == wanted[0]
        assert abs(int(row["d_cm"]) - wanted[1]) <= 0.5 + 1e-6
        assert abs(int(row["delta_deg"]) - wanted[2]) <= 0.5 + 1e-6 or abs(wanted[2]) > 89.5 - 1e-6
        assert float(row["true_range_m"]) == pytest.approx(math.dist(at, place), rel=1e-12)
        heard[int(row["id"])] += 1
    assert min(heard.values()) > 100
    assert zones == {1, 2}


def test_slots_are_the_nearest_first_and_every_frame_has_all_of_them(
    recorded: tuple[Path, list[dict[str, str]], tuple[float, float, float]],
) -> None:
    _, read, _ = recorded
    frames = [read[at : at + 4] for at in range(0, len(read), 4)]
    for n, frame in enumerate(frames):
        assert [row["slot"] for row in frame] == ["1", "2", "3", "4"]
        assert {row["seq"] for row in frame} == {str(n % 256)}
        assert {row["time_s"] for row in frame} == {repr(n / 7.0)}
        near = [int(row["d_cm"]) for row in frame if row["id"]]
        assert near == sorted(near)
        assert all((row["zone"], row["d_cm"], row["delta_deg"]) == ("0", "-1", "-1") for row in frame if not row["id"])


@pytest.mark.parametrize("flight", ["arducopter"], indirect=True)
def test_the_same_log_scenario_and_seed_give_the_same_bytes(flight: Path, tmp_path: Path) -> None:
    for name, seed in (("a", "3"), ("b", "3"), ("c", "4")):
        replay(flight, tmp_path / name, "--seed", seed, "--rate", "10")
    read = {name: [(tmp_path / name / file).read_bytes() for file in FILES] for name in "abc"}
    assert read["a"] == read["b"]
    assert read["a"][0] != read["c"][0]
    assert read["a"][-1] == flight.read_bytes()


@pytest.mark.parametrize("flight", ["arducopter"], indirect=True)
def test_a_record_replays_to_the_frames_it_holds(flight: Path, tmp_path: Path) -> None:
    replay(flight, tmp_path / "first")
    replay(tmp_path / "first" / "autopilot.tlog", tmp_path / "second")
    assert (tmp_path / "first" / "frames.bin").read_bytes() == (tmp_path / "second" / "frames.bin").read_bytes()


def test_the_record_says_how_it_went(flight: Path, tmp_path: Path) -> None:
    replay(flight, tmp_path / "record")
    run = json.loads((tmp_path / "record" / "run.json").read_text())
    assert (run["ended"], run["exit_code"], run["seed"]) == ("finished", 0, 1)
    assert run["vehicle"]["system"] == run["vehicle"]["component"] == 1
    homes = messages(flight)["HOME_POSITION"]
    assert any(run["datum"] == [m.latitude / 1e7, m.longitude / 1e7, m.altitude / 1e3] for m in homes)
    assert run["counters"]["frames"] == len(rows(tmp_path / "record")) / 4
    assert run["counters"]["bad_checksums"] == run["counters"]["bytes_skipped"] == 0
    assert {"arva-hil", "numpy", "pymavlink"} <= run["versions"].keys()


def test_a_flight_reads_as_it_did_when_it_was_last_looked_at(flight: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """Golden: the default scenario at 1 Hz, noise and all. `arva-hil replay tests/data/NAME.tlog` prints it anew."""
    assert main(["replay", str(flight)]) == 0
    assert capfd.readouterr().out == flight.with_suffix(".golden").read_text()


@pytest.mark.parametrize("flight", ["arducopter"], indirect=True)
def test_a_log_may_stand_for_the_autopilot_and_its_end_is_no_failure(flight: Path, tmp_path: Path) -> None:
    """In real time: the piece is cut to its first 1.5 seconds."""
    with closing(TlogReader(flight)) as log, (tmp_path / "short.tlog").open("wb") as short:
        records = list(log)
        short.writelines(tlog_record(*one) for one in records if one.time_us < records[0].time_us + 1_500_000)
    record_to = str(tmp_path / "record")
    assert main(["run", "--autopilot", short.name, "--port", "pty", "--rate", "10", "--record", record_to]) == 0
    assert (tmp_path / "record" / "autopilot.tlog").stat().st_size == (tmp_path / "short.tlog").stat().st_size
    assert len(rows(tmp_path / "record")) / 4 > 10


def test_positions_from_before_the_estimators_origin_do_not_put_the_transmitters_out_of_reach(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A log without HOME_POSITION whose altitude is 1.25 m for 8 s, then 588 m."""
    encoder, log = Encoder(1, 1), b""
    for tick in range(400):
        boot_ms, alt_mm = 100 * tick, 1_250 if tick < 80 else 588_000
        said = [
            dialect.MAVLink_heartbeat_message(2, 3, 0, 0, 3, 3),
            dialect.MAVLink_attitude_message(boot_ms, 0, 0, 0, 0, 0, 0),
            dialect.MAVLink_global_position_int_message(boot_ms, 465000000, 113500000, alt_mm, 0, 0, 0, 0, 0),
        ]
        log += b"".join(tlog_record(1_700_000_000_000_000 + 1000 * boot_ms, encoder.pack(one)) for one in said)
    (tmp_path / "flight.tlog").write_bytes(log)
    replay(tmp_path / "flight.tlog", tmp_path / "record")
    assert capsys.readouterr().err.count("588.00 m AMSL (its position has jumped)") == 1
    read = [row for row in rows(tmp_path / "record") if row["slot"] == "1" and float(row["time_s"]) >= 10]
    assert len(read) == 30
    assert all(row["id"] == "1" for row in read)
    run = json.loads((tmp_path / "record" / "run.json").read_bytes())
    assert [change["why"] for change in run["datums"]] == ["", "its position has jumped"]
    assert run["datum"] == run["datums"][-1]["lat_lon_alt"] == pytest.approx([46.5, 11.35, 588.0])
