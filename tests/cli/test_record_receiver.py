"""`arva-hil record` and `decode`: a real receiver is a pseudo-terminal here, the autopilot the built-in vehicle."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest

from arva_hil.links.pty import PtyLink
from firmware_proto.nmea import encode_nmea
from tests.every import every
from tests.rehearsed import rehearse

from ..records.test_received import PLACE, POINTS, QUIET
from .far_ends import Arva, Autopilot, Beacon, Keep


def rows(path: Path) -> list[dict[str, str]]:
    with open(path, newline="") as file:
        return list(csv.DictReader(file))


def test_a_receiver_is_recorded_beside_an_autopilot(
    arva: Arva, autopilot: Autopilot, beacon: Beacon, tmp_path: Path
) -> None:
    place = "4=46.0133,7.7456,1650"
    words = ("--autopilot", autopilot.address, "--receiver", beacon.link.path, "--transmitter", place)
    code, _, err = arva("record", *words, "--duration", 9, tmp_path / "r")
    assert code == 0, err
    said = json.loads((tmp_path / "r" / "run.json").read_text())
    assert (said["source"], said["ended"], said["format"]) == ("receiver", "finished", "binary")
    assert said["counters"]["frames"] > 50
    readings = [row for row in rows(tmp_path / "r" / "readings.csv") if row["north_m"]]
    first = readings[-2]
    assert (first["id"], first["d_cm"], first["delta_deg"]) == ("4", "2000", "10")
    assert 105 < float(first["true_range_m"]) < 117
    assert readings[-1]["id"] == "9"
    assert readings[-1]["true_range_m"] == ""
    assert (tmp_path / "r" / "autopilot.tlog").stat().st_size > 1000
    assert arva("record", *words, tmp_path / "r").code == 2


def test_another_format_is_named_and_its_bytes_are_kept_and_decoded_later(
    arva: Arva, autopilot: Autopilot, keep: Keep, tmp_path: Path
) -> None:
    beacon = keep(Beacon(encode_nmea))
    words = ("--autopilot", autopilot.address, "--receiver", beacon.link.path, "--duration", 4)
    code, _, err = arva("record", *words, tmp_path / "r")
    assert code == 1
    assert "poses without frames: no binary frame in" in err
    assert "the bytes are nmea: --format nmea" in err
    code, _, err = arva("decode", tmp_path / "r", "--format", "nmea", "--out", tmp_path / "again")
    assert code == 0, err
    assert len(rows(tmp_path / "again" / "readings.csv")) > 40
    assert (tmp_path / "again" / "frames.bin").read_bytes() == (tmp_path / "r" / "frames.bin").read_bytes()


def test_frames_without_an_autopilot_are_kept_and_end_with_3(
    arva: Arva, beacon: Beacon, line: PtyLink, tmp_path: Path
) -> None:
    words = ("--autopilot", line.path, "--receiver", beacon.link.path, "--timeout", 1.5)
    code, _, err = arva("record", *words, tmp_path / "r")
    assert code == 3
    assert "no poses: " in err
    assert len(rows(tmp_path / "r" / "readings.csv")) > 10


def test_poses_without_frames_are_said(arva: Arva, autopilot: Autopilot, line: PtyLink, tmp_path: Path) -> None:
    words = ("--autopilot", autopilot.address, "--receiver", line.path, "--duration", 2.5)
    code, _, err = arva("record", *words, tmp_path / "r")
    assert code == 1
    assert "poses without frames: the receiver has sent nothing" in err


def test_a_place_surveyed_later_gives_the_ranges(arva: Arva, tmp_path: Path) -> None:
    folder = rehearse(tmp_path / "r", QUIET, POINTS)
    place = f"1={PLACE.lat},{PLACE.lon},{PLACE.alt}"
    code, _, err = arva("decode", folder, "--transmitter", place, "--out", tmp_path / "again")
    assert code == 0, err
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
        assert arva(*words).code == 0, words
    assert "a real one at" in (tmp_path / "report.html").read_text()


@every(
    "arguments, what, cure",
    [
        ("record r", "--receiver is missing", "--receiver /dev/ttyUSB0"),
        ("record --autopilot /dev/ttyS9 --receiver /dev/ttyS9,9600 r", "are both /dev/ttyS9", "each side needs"),
        ("record --receiver pty --transmitter 1 r", "--transmitter: '1'", "1=46.0123,7.7456,1650"),
        ("record --receiver pty --transmitter 300=1,2,3 r", "--transmitter: '300'", "0…254"),
        ("record --receiver pty --transmitter 1=91,2,3 r", "latitude 91", "-90…90"),
        ("decode r", "--out is missing", "name the folder"),
        ("decode nowhere --out r", "no such folder", "--record"),
    ],
)
def test_wrong_words_are_refused(arva: Arva, arguments: str, what: str, cure: str) -> None:
    code, _, err = arva(*arguments.split())
    assert code == 2
    assert what in err
    assert cure in err


def test_a_record_of_the_emulator_cannot_be_decoded(arva: Arva, tmp_path: Path) -> None:
    folder = rehearse(tmp_path / "r", QUIET, POINTS)
    (folder / "chunks.csv").unlink()
    code, _, err = arva("decode", folder, "--out", tmp_path / "again")
    assert code == 2
    assert "only a record of `arva-hil record` has one" in err
