"""The smaller commands: listen, check, ports, help."""

from __future__ import annotations

import errno
import json
import os
import re
import shlex
import signal
import subprocess
from pathlib import Path

import pytest

from arva_hil.cli.main import COMMANDS
from arva_hil.links.pty import PtyLink
from arva_hil.links.serial_ports import list_ports
from firmware_proto import Channel, Frame, encode

from .far_ends import PROGRAM, Arva, Start, frames_in, until

ROOT = Path(__file__).parent.parent.parent
DEFAULT = ROOT / "configs" / "default.yaml"
LOG = ROOT / "tests" / "data" / "px4.tlog"
FRAMES = [Frame(n, 1, (Channel(7, 1, 1234 + n, -15), Channel())) for n in range(5)]


# -- listen ------------------------------------------------------------------------------------------------


def test_listen_prints_what_a_file_of_frames_says(arva: Arva, tmp_path: Path) -> None:
    file = tmp_path / "frames.bin"
    file.write_bytes(b"".join(map(encode, FRAMES)) + b"tail")
    code, out, err = arva("listen", file)
    assert code == 0
    assert out.splitlines() == [f"{n:3d}  #7 mid {1234 + n} cm -15°" for n in range(5)]
    assert "5 frames, 0 lost, 0 bad checksums, 4 bytes dropped" in err


def test_listen_hears_a_port_until_it_has_heard_enough(start: Start, line: PtyLink) -> None:
    program = start("listen", line.path, "--count", 3, "--json")
    program.says(f"listening at {line.path}")
    line.write(b"".join(map(encode, FRAMES)))
    assert program.ends() == 0
    objects = [json.loads(text) for text in program.out.splitlines()]
    assert [said["seq"] for said in objects] == [0, 1, 2]
    assert objects[0]["channels"][0] == {"id": 7, "zone": "mid", "d_cm": 1234, "delta_deg": -15, "marked": False}


def test_listen_says_once_that_nothing_comes_and_ends_in_time(start: Start, line: PtyLink) -> None:
    program = start("listen", line.path, "--duration", 2.5)
    assert program.ends() == 0
    assert program.err.count("no frame for 2 s") == 1


def test_listen_fails_when_the_port_goes(start: Start, tmp_path: Path) -> None:
    line = PtyLink(path := str(tmp_path / "line"))
    program = start("listen", path)
    program.says("listening")
    line.close()
    assert program.ends() == 1
    assert f"arva-hil: {path}: lost" in program.err


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_listen_can_be_interrupted(start: Start, line: PtyLink, number: signal.Signals) -> None:
    program = start("listen", line.path)
    program.says("listening")
    line.write(b"".join(map(encode, FRAMES)))
    until(lambda: program.out.count(b"\n") == 5)
    program.send(number)
    assert program.ends() == 130
    assert "5 frames, 0 lost" in program.err


# -- check, ports, help ------------------------------------------------------------------------------------


def test_check_accepts_every_scenario_that_comes_along(arva: Arva) -> None:
    files = sorted((ROOT / "configs").glob("*.yaml"))
    code, out, err = arva("check", *files)
    assert (code, err) == (0, "")
    firsts = [line for line in out.splitlines() if not line.startswith("  ")]
    assert [line.split(": ok: ")[0] for line in firsts] == list(map(str, files))


def test_check_shows_the_faults_as_the_command_line_writes_them(arva: Arva, tmp_path: Path) -> None:
    file = tmp_path / "faults.yaml"
    faults = "[{drop: 0.02, from_s: 10, until_s: 60}, {interference: 20, every_s: 30, for_s: 2}]"
    file.write_text(f"transmitters: [{{id: 3, ned: [1, 2, 3]}}]\nfaults: {faults}\n")
    code, out, err = arva("check", file, DEFAULT)
    assert (code, err) == (0, "")
    assert out.splitlines()[:3] == [
        f"{file}: ok: transmitters 3; 1 Hz, binary",
        "  fault drop=0.02@10-60",
        "  fault interference=20,every_s=30,for_s=2",
    ]
    assert out.splitlines()[3].startswith(f"{DEFAULT}: ok: ")


def test_check_lists_every_mistake_of_every_file_at_its_place(arva: Arva, tmp_path: Path) -> None:
    bad = tmp_path / "bad.yaml"
    bad.write_text("transmitters:\n  - {id: 300, enu: [0, 0, 0]}\nreciever: {}\n")
    code, out, err = arva("check", bad, DEFAULT, tmp_path / "none.yaml")
    assert code == 2
    assert f"{DEFAULT}: ok" in out
    first, second, third = err.splitlines()
    assert first.startswith(f"{bad}:2:10: ")
    assert "300" in first
    assert second.startswith(f"{bad}:3:1: ")
    assert second.endswith("did you mean 'receiver'?")
    assert third.startswith(f"{tmp_path / 'none.yaml'}:1:1: No such file")


def test_ports_lists_what_there_is(arva: Arva) -> None:
    devices = [port.device for port in list_ports()]
    code, out, _ = arva("ports", "--json")
    assert code == 0
    assert [json.loads(line)["device"] for line in out.splitlines()] == devices
    code, out, _ = arva("ports")
    assert code == 0
    assert all(device in out for device in devices) if devices else "no serial ports" in out


@pytest.mark.parametrize("arguments", [["--help"], ["-h"], ["help"], ["-help"]])
def test_help_names_every_command(arva: Arva, arguments: list[str]) -> None:
    code, out, err = arva(*arguments)
    assert (code, err) == (0, "")
    for command in ("run", "replay", "demo", "search", "campaign", "listen", "check", "ports", "doctor"):
        assert re.search(rf"^  {command} ", out, re.MULTILINE)


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_has_help(arva: Arva, command: str) -> None:
    code, out, err = arva(command, "--help")
    assert (code, err) == (0, "")
    assert out.startswith(f"usage: arva-hil {command} ")


def test_run_is_the_default_command(arva: Arva) -> None:
    assert arva("--port", "pty", "--help").out == arva("run", "--help").out


def test_help_with_one_dash_is_understood_behind_a_command_too(arva: Arva) -> None:
    assert arva("replay", "-help") == arva("replay", "--help")


def test_version_is_that_of_the_package() -> None:
    done = subprocess.run([*PROGRAM, "--version"], capture_output=True, text=True, timeout=20)
    assert (done.returncode, done.stderr) == (0, "")
    assert re.fullmatch(r"arva-hil \d+\.\d+\.\d+\n", done.stdout)


def test_a_terminal_that_knows_only_ascii_is_no_reason_to_fail(start: Start) -> None:
    program = start("run", "--help", env={**os.environ, "PYTHONIOENCODING": "ascii"})
    assert program.ends() == 0
    assert program.out.isascii()


# -- stdout that nobody takes ------------------------------------------------------------------------------


def into_nothing(why: str) -> int:
    """A descriptor that takes nothing."""
    if why == "No space left on device":
        return os.open("/dev/full", os.O_WRONLY)
    reader, writer = os.pipe()
    os.close(reader)
    return writer


@pytest.mark.parametrize(
    ("why", "code", "said"),
    [("No space left on device", 1, r"stdout: .*No space left on device\n$"), ("Broken pipe", 141, r"^$")],
)
@pytest.mark.parametrize("command", ["--help", "run --help", "listen", "check --schema"])
def test_stdout_that_takes_nothing_is_an_error_with_a_message_and_a_reader_that_has_gone_is_none(
    start: Start, tmp_path: Path, command: str, why: str, code: int, said: str
) -> None:
    arguments = command.split()
    if command == "listen":
        arguments.append(str(tmp_path / "frames.bin"))
        (tmp_path / "frames.bin").write_bytes(b"".join(map(encode, FRAMES)))
    stdout = into_nothing(why)
    program = start(*arguments, stdout=stdout)
    os.close(stdout)
    assert program.ends() == code
    assert re.search(said, program.err)


@pytest.mark.parametrize(
    ("why", "code", "message"),
    [
        ("No space left on device", 1, "-: cannot be written: No space left on device"),
        ("Broken pipe", 141, "-: the reader of this pipe went away"),
    ],
)
@pytest.mark.parametrize("option", ["--out=-", "--json"])
def test_frames_that_stdout_does_not_take_end_a_replay_and_its_record_says_why(
    start: Start, option: str, why: str, code: int, message: str, tmp_path: Path
) -> None:
    stdout = into_nothing(why)
    program = start("replay", LOG, option, "--record", tmp_path / "record", stdout=stdout)
    os.close(stdout)
    assert program.ends() == code
    assert (f"error: {message}" in program.err) is (code == 1)
    run = json.loads((tmp_path / "record" / "run.json").read_bytes())
    assert (run["ended"], run["exit_code"]) == (message, code)


def test_listen_into_head_prints_one_line_and_no_traceback(tmp_path: Path) -> None:
    file = tmp_path / "frames.bin"
    file.write_bytes(b"".join(encode(Frame(n % 256, 1, (Channel(),))) for n in range(10_000)))
    done = subprocess.run(
        f"{shlex.join(PROGRAM)} listen {file} | head -n 1", shell=True, capture_output=True, text=True, timeout=20
    )
    assert done.stdout == "  0  no signal\n"
    assert done.stderr == ""


def test_frames_of_a_record_are_what_listen_reads(arva: Arva, tmp_path: Path) -> None:
    assert arva("replay", LOG, "--record", tmp_path).code == 0
    frames = frames_in((tmp_path / "frames.bin").read_bytes())
    assert len(arva("listen", tmp_path / "frames.bin").out.splitlines()) == len(frames)


def test_the_demo_without_pseudo_terminals_says_what_else_there_is(arva: Arva, monkeypatch: pytest.MonkeyPatch) -> None:
    def none() -> tuple[int, int]:
        raise OSError(errno.ENOSPC, "out of pty devices")

    monkeypatch.setattr("os.openpty", none)
    done = arva("demo")
    assert done.code == 3
    assert "no pseudo-terminal" in done.err
    assert "--speed max" in done.err
