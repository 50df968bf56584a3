"""`arva-hil listen` of bytes in another format than it was told, and of the end of a file."""

from __future__ import annotations

from pathlib import Path

import pytest

from arva_hil.autopilot.following.session import Session
from arva_hil.emulator.ports import encoder
from arva_hil.links.pty import PtyLink
from arva_hil.mavlink.codec import Encoder
from arva_hil.registry import FORMATS
from arva_hil.simulated.vehicle import SimulatedVehicle
from firmware_proto import Channel, Frame

from .far_ends import HOME, Arva, Start, heartbeat

FRAMES = [Frame(n, 1, (Channel(7, 1, 1234 + n, -15), Channel())) for n in range(5)]


def sent_as(format: str) -> bytes:
    session = Session()
    session.feed(SimulatedVehicle(HOME).poll(0.0), 0.0)
    encode = encoder(format, session)
    return b"".join(encode(frame, 5) for frame in FRAMES)


@pytest.mark.parametrize("format", list(FORMATS))
def test_a_file_has_all_its_frames_the_last_one_too(arva: Arva, tmp_path: Path, format: str) -> None:
    (tmp_path / "frames").write_bytes(sent_as(format))
    code, out, err = arva("listen", tmp_path / "frames", "--format", format)
    assert code == 0
    shown = [1200] * 5 if format == "handheld" else [1234 + n for n in range(5)]
    assert [f"{d_cm} cm" in line for d_cm, line in zip(shown, out.splitlines(), strict=True)] == [True] * 5
    assert err.startswith("5 frames, 0 lost")


@pytest.mark.parametrize(
    ("format", "asked"),
    [("nmea", "binary"), ("text", "nmea"), ("binary", "text"), ("named", "binary"), ("tunnel", "named")],
)
def test_a_file_of_another_format_is_named_and_an_error(arva: Arva, tmp_path: Path, format: str, asked: str) -> None:
    (tmp_path / "frames").write_bytes(data := sent_as(format))
    code, out, err = arva("listen", tmp_path / "frames", "--format", asked)
    assert (code, out) == (1, "")
    said = err.splitlines()[-1]
    assert said == f"arva-hil: no {asked} frame in {len(data)} bytes: the bytes are {format}: --format {format}"


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (heartbeat(Encoder(1, 1)) * 3, "the bytes are MAVLink (3 packets) without frames of a receiver in it"),
        (b"\x00\x80\xf8" * 50, "the bytes are of no other known format"),
    ],
    ids=["MAVLink without frames", "noise of a wrong baud rate"],
)
def test_what_is_no_format_at_all_is_an_error_too(arva: Arva, tmp_path: Path, data: bytes, said: str) -> None:
    (tmp_path / "frames").write_bytes(data)
    code, _, err = arva("listen", tmp_path / "frames")
    assert code == 1
    assert said in err


def test_an_empty_file_holds_no_frames_and_is_no_error(arva: Arva, tmp_path: Path) -> None:
    (tmp_path / "frames").write_bytes(b"")
    assert arva("listen", tmp_path / "frames").code == 0


def test_a_port_of_another_format_is_said_while_it_listens_and_at_the_end(start: Start, line: PtyLink) -> None:
    program = start("listen", line.path, "--duration", 3)
    program.says("listening at")
    line.write(sent_as("nmea"))
    program.says(r"no frame for 2 s: no binary frame in \d+ bytes: the bytes are nmea: --format nmea\n")
    assert program.ends() == 1


def test_stdin_of_another_format_is_an_error(start: Start, tmp_path: Path) -> None:
    (tmp_path / "frames").write_bytes(sent_as("binary"))
    with (tmp_path / "frames").open("rb") as stdin:
        program = start("listen", "-", "--format", "text", stdin=stdin)
    assert program.ends() == 1
    assert "the bytes are binary: --format binary" in program.err
