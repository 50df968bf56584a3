"""--signing-key: which files are taken, and a run with a vehicle that has the same key."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

from arva_hil.links.pty import PtyLink
from arva_hil.links.tlog import TlogReader

from .far_ends import Arva, Autopilot, Keep, Start, hears, read_frames, read_until_heard

KEY = "0123456789abcdef" * 4


def key_file(folder: Path, content: bytes, mode: int = 0o600) -> Path:
    file = folder / "key"
    file.write_bytes(content)
    file.chmod(mode)
    return file


@pytest.mark.parametrize("mode", [0o640, 0o604, 0o620, 0o644, 0o660, 0o777, 0o601])
def test_a_key_that_others_may_read_is_refused(arva: Arva, tmp_path: Path, mode: int) -> None:
    file = key_file(tmp_path, KEY.encode(), mode)
    code, _, err = arva("--port", "pty", "--signing-key", file)
    assert code == 2
    assert f"{file}: other users may read or write it ({mode:o}): chmod 600 {file}" in err


def test_a_key_that_a_service_manager_keeps_is_taken(
    arva: Arva, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = key_file(tmp_path, KEY.encode(), 0o440)
    monkeypatch.setenv("CREDENTIALS_DIRECTORY", str(tmp_path))
    options = ["--port", "pty", "--autopilot", "pty", "--duration", "0.1", "--timeout", "0.1"]
    assert arva(*options, "--signing-key", file).code == 3
    monkeypatch.setenv("CREDENTIALS_DIRECTORY", str(tmp_path / "elsewhere"))
    assert arva(*options, "--signing-key", file).code == 2


@pytest.mark.parametrize(
    ("content", "what"),
    [
        (b"", "empty"),
        (b"\n", "empty"),
        (b"one\ntwo\n", "2 lines"),
        (b"pass\xffphrase", "byte 5 is not text"),
        (b"x" * 5000, "more than 4096 bytes"),
    ],
)
@pytest.mark.parametrize("command", [["--port", "pty"], ["search", "--autopilot", "pty", "--receiver", "pty"]])
def test_a_file_without_a_key_is_refused(
    arva: Arva, tmp_path: Path, command: list[str], content: bytes, what: str
) -> None:
    file = key_file(tmp_path, content)
    code, _, err = arva(*command, "--signing-key", file)
    assert code == 2
    assert f"--signing-key {file}: {what}, expected 64 hexadecimal digits" in err
    assert KEY not in err


def test_what_is_no_file_is_refused(arva: Arva, tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe, 0o600)
    for path, what in ((tmp_path / "none", "No such file"), (tmp_path, "Is a directory"), (pipe, "is not a file")):
        code, _, err = arva("--port", "pty", "--signing-key", path)
        assert code == 2
        assert f"--signing-key {path}: {what}" in err


def test_with_the_vehicles_key_all_is_as_without(start: Start, keep: Keep, line: PtyLink, tmp_path: Path) -> None:
    vehicle = keep(Autopilot(keep(PtyLink()), key=bytes.fromhex(KEY)))
    options = ["--signing-key", key_file(tmp_path, KEY.encode()), "--record", tmp_path / "record", "--rate", 20]
    program = start("--port", line.path, "--autopilot", vehicle.address, *options)
    read_until_heard(line)
    program.stops()
    assert "MAVLink 2, signed" in program.err
    counters = json.loads((tmp_path / "record" / "run.json").read_text())["counters"]
    assert {name: counters[f"packets_{name}"] for name in ("unsigned", "forged", "replayed")} == {
        "unsigned": 0,
        "forged": 0,
        "replayed": 0,
    }
    assert not any(KEY.encode() in file.read_bytes() for file in (tmp_path / "record").iterdir())


def test_what_one_run_has_heard_the_next_one_does_not_believe(
    start: Start, keep: Keep, line: PtyLink, tmp_path: Path
) -> None:
    key = key_file(tmp_path, KEY.encode())
    vehicle = keep(Autopilot(keep(PtyLink()), key=bytes.fromhex(KEY)))
    first = start(
        *("--port", line.path, "--autopilot", vehicle.address, "--signing-key", key),
        *("--record", tmp_path / "record"),
    )
    first.says("there is a pose")
    first.stops()
    heard = [record.raw for record in TlogReader(str(tmp_path / "record" / "autopilot.tlog"))]
    replayer = keep(PtyLink())
    second = start("--port", line.path, "--autopilot", replayer.path, "--signing-key", key, "--timeout", 1)
    second.says("frames to")
    replayer.write(b"".join(heard))
    assert second.ends() == 3
    assert f"0 unsigned, 0 forged, {len(heard)} replayed" in second.err


def test_a_home_that_cannot_be_written_is_one_line_and_the_run_goes_on(
    arva: Arva, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(key := key_file(tmp_path, KEY.encode())))
    options = ["--port", "pty", "--autopilot", "pty", "--duration", "0.1", "--timeout", "0.1"]
    code, _, err = arva(*options, "--signing-key", key)
    assert code == 3
    assert err.count("time stamps of signatures are not stored (Not a directory)") == 1


def test_with_another_key_no_autopilot_is_heard(start: Start, keep: Keep, line: PtyLink, tmp_path: Path) -> None:
    vehicle = keep(Autopilot(keep(PtyLink()), key=bytes(32)))
    options = ["--signing-key", key_file(tmp_path, KEY.encode()), "--timeout", 1.5]
    program = start("--port", line.path, "--autopilot", vehicle.address, *options)
    assert program.ends() == 3
    assert "packets signed with another key are ignored, the first from 1/1" in program.err
    assert "no autopilot's with the key: 0 unsigned, " in program.err
    assert not hears(read_frames(line, 1)[-1])


def test_without_a_key_a_vehicle_that_signs_takes_no_request(start: Start, keep: Keep, line: PtyLink) -> None:
    vehicle = keep(Autopilot(keep(PtyLink()), key=bytes(32)))
    program = start("--port", line.path, "--autopilot", vehicle.address)
    program.says("its packets are signed. They are not checked")
    program.stops()
    assert "--signing-key FILE" in program.err
    assert not hears(read_frames(line, 1)[-1])
