"""How a command ends before its time: signals at any moment, readers that stand still, errors nobody foresaw."""

from __future__ import annotations

import errno
import fcntl
import importlib
import json
import os
import re
import select
import signal
import socket
import tempfile
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from arva_hil.cli.arguments import arguments_of
from arva_hil.cli.options import CommandParser, module_name
from arva_hil.cli.outcome import SignalGuard, interrupting, unexpected_error
from arva_hil.clock import StepClock
from arva_hil.emulator.engine import Emulator
from arva_hil.links.pty import PtyLink
from arva_hil.links.tlog import TlogReader
from arva_hil.records.writing import growing_files

from .far_ends import Arva, Autopilot, Start, frames_in, read_frames, until

DATA = Path(__file__).parent.parent / "data"


# -- signals -----------------------------------------------------------------------------------------------


@pytest.fixture
def nobody_answers() -> Iterator[str]:
    """A TCP server that lets nobody in: connecting to it waits."""
    with socket.socket() as server:
        server.bind(("127.0.0.1", 0))
        server.listen(0)
        crowd = [socket.socket() for _ in range(3)]
        for sock in crowd:
            sock.setblocking(False)
            sock.connect_ex(server.getsockname())
        yield f"tcp:127.0.0.1:{server.getsockname()[1]}"
        for sock in crowd:
            sock.close()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_while_a_link_is_being_opened(
    start: Start, nobody_answers: str, tmp_path: Path, number: signal.Signals
) -> None:
    link = tmp_path / "fc"
    program = start("--autopilot", f"pty:{link}", "--port", nobody_answers)
    program.says("autopilot: ")
    until(link.is_symlink)
    program.send(number)
    assert program.ends() == 130
    assert not os.path.lexists(link)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_signals_one_after_the_other_leave_whole_files(
    start: Start, autopilot: Autopilot, line: PtyLink, tmp_path: Path, number: signal.Signals
) -> None:
    """As when a terminal and a wrapper both pass Ctrl-C on."""
    record, link = tmp_path / "record", tmp_path / "arva0"
    program = start("--port", f"pty:{link}", "--autopilot", autopilot.address, "--rate", 50, "--record", record)
    program.says("readings are real")
    for _ in range(3):
        program.send(number)
    assert program.ends() == 130
    run = json.loads((record / "run.json").read_bytes())
    assert (run["ended"], run["exit_code"]) == (number.name, 130)
    assert len(frames_in((record / "frames.bin").read_bytes())) == run["counters"]["frames"]
    assert len(list(TlogReader(record / "autopilot.tlog"))) == run["counters"]["packets_received"]
    assert (record / "readings.csv").read_text().count("\n") == 1 + 4 * run["counters"]["frames"]
    assert not os.path.lexists(link)


def test_under_nohup_a_closed_terminal_ends_nothing(start: Start, autopilot: Autopilot, line: PtyLink) -> None:
    program = start(
        *("--port", line.path, "--autopilot", autopilot.address, "--rate", 50),
        preexec_fn=lambda: signal.signal(signal.SIGHUP, signal.SIG_IGN),
    )
    program.says("readings are real")
    program.send(signal.SIGHUP)
    read_frames(line, 60)
    program.send(signal.SIGTERM)
    assert program.ends() == 130


@pytest.fixture
def stuck() -> Iterator[int]:
    """A pipe that nobody reads and that has no room; for a program's stdout."""
    reader, writer = os.pipe()
    os.set_blocking(writer, False)
    for size in (65536, 4096, 1):
        try:
            while True:
                os.write(writer, b"x" * size)
        except BlockingIOError:
            pass
    os.set_blocking(writer, True)
    yield writer
    os.close(writer)
    os.close(reader)


def test_ctrl_c_once_is_enough_when_stdout_is_not_read(
    start: Start, autopilot: Autopilot, stuck: int, tmp_path: Path
) -> None:
    record = tmp_path / "record"
    arguments = ("--port", "-", "--autopilot", autopilot.address, "--rate", 20, "--record", record)
    program = start(*arguments, stdout=stuck)
    program.says("no program takes the frames")
    program.send(signal.SIGINT)
    assert program.ends() == 130
    counters = json.loads((record / "run.json").read_bytes())["counters"]
    assert counters["dropped"] == counters["frames"] > 0


def test_ctrl_c_once_is_enough_for_a_replay_that_waits_for_its_reader(start: Start) -> None:
    reader, writer = os.pipe()
    fcntl.fcntl(writer, fcntl.F_SETPIPE_SZ, 32768)
    program = start("replay", DATA / "px4.tlog", "--rate", 50, "--out", "-", stdout=writer)
    program.says("datum")
    until(lambda: not select.select([], [writer], [], 0)[1])
    program.send(signal.SIGINT)
    assert program.ends() == 130
    os.close(writer)
    os.close(reader)


def test_a_loop_that_is_stuck_is_interrupted_by_a_later_signal_but_never_the_end(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    clock = StepClock()
    with SignalGuard() as guard:
        monkeypatch.setattr(guard, "_clock", clock)
        for _ in range(3):
            signal.raise_signal(signal.SIGTERM)
        assert guard.caught is signal.SIGTERM
        clock.wait(2.0)
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
        assert guard.caught is signal.SIGTERM
        guard.ending = True
        signal.raise_signal(signal.SIGTERM)


def test_handlers_are_what_they_were_before() -> None:
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    before = [signal.getsignal(number) for number in numbers]
    with interrupting():
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGTERM)
        with SignalGuard():
            assert [signal.getsignal(number) for number in numbers] != before
    assert [signal.getsignal(number) for number in numbers] == before


# -- errors nobody foresaw ---------------------------------------------------------------------------------


def test_an_error_in_the_loop_ends_the_run_with_its_cause(
    arva: Arva, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def advance(self: Emulator, now: float) -> None:
        raise ZeroDivisionError("a mistake")

    monkeypatch.setattr(Emulator, "advance", advance)
    link = tmp_path / "arva0"
    code, _, err = arva("--port", f"pty:{link}", "--autopilot", "pty", "--record", tmp_path / "record")
    assert code == 1
    assert "error: unexpected ZeroDivisionError: a mistake (runtime/drivers.py:" in err
    assert "Traceback" not in err
    run = json.loads((tmp_path / "record" / "run.json").read_bytes())
    assert run["exit_code"] == 1
    assert "ZeroDivisionError: a mistake" in run["ended"]
    assert not os.path.lexists(link)


def test_the_whole_story_of_an_error_is_for_who_wants_it(arva: Arva, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Emulator, "advance", lambda self, now: 1 / 0)
    code, _, err = arva("--port", "pty", "--autopilot", "pty", "-v")
    assert code == 1
    assert "Traceback (most recent call last)" in err
    assert err.splitlines()[-1].startswith("error: unexpected ZeroDivisionError: division by zero")


@pytest.mark.parametrize("command", ["listen", "ports", "check", "search"])
@pytest.mark.parametrize("verbose", [False, True])
def test_whatever_command_it_is_an_error_that_nobody_foresaw_is_one_line(
    arva: Arva, monkeypatch: pytest.MonkeyPatch, command: str, verbose: bool
) -> None:
    def break_down(options: object) -> int:
        raise ZeroDivisionError("a mistake")

    monkeypatch.setattr(f"arva_hil.cli.{module_name(command)}.main", break_down)
    monkeypatch.setattr("arva_hil.cli.options.CommandParser.parse", lambda *_: None)
    code, out, err = arva(command, *["-v"] * verbose)
    assert (code, out) == (1, "")
    assert "arva-hil: unexpected ZeroDivisionError: a mistake" in err
    assert ("Traceback" in err) == verbose


@pytest.mark.parametrize("command", ["run", "replay"])
def test_an_error_on_a_thread_ends_the_command_with_its_cause(
    arva: Arva, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, command: str
) -> None:
    def write(file: Any, data: bytes) -> None:
        raise ZeroDivisionError("a mistake")

    monkeypatch.setattr(growing_files, "_write", write)
    what = ("replay", DATA / "px4.tlog") if command == "replay" else ("--port", "pty", "--autopilot", "pty")
    code, _, err = arva(*what, "--record", tmp_path)
    assert code == 1
    assert "unexpected ZeroDivisionError: a mistake (" in err


def test_an_error_is_placed_in_this_program() -> None:
    with pytest.raises(TypeError) as caught:
        TlogReader(None)  # type: ignore[arg-type]
    assert unexpected_error(caught.value).startswith("unexpected TypeError: ")
    assert "(links/tlog.py:" in unexpected_error(caught.value)
    assert unexpected_error(ValueError("of nowhere")) == "unexpected ValueError: of nowhere"


def test_a_broken_pipe_of_frames_ends_the_run_and_its_record_is_whole(
    start: Start, autopilot: Autopilot, tmp_path: Path
) -> None:
    reader, writer = os.pipe()
    record = tmp_path / "record"
    arguments = ("--port", "-", "--autopilot", autopilot.address, "--rate", 50, "--record", record)
    program = start(*arguments, stdout=writer)
    os.close(writer)
    program.says("readings are real")
    read = os.read(reader, 65536)
    os.close(reader)
    assert program.ends() == 141
    assert "went away" not in program.err  # who ended it knows
    run = json.loads((record / "run.json").read_bytes())
    assert (run["exit_code"], run["ended"]) == (141, "-: the reader of this pipe went away")
    written, counters = (record / "frames.bin").read_bytes(), run["counters"]
    assert read
    assert written.startswith(read)
    assert len(frames_in(written)) == counters["delivered"] == counters["frames"] - counters["dropped"]
    assert counters["dropped"] > 0  # at least the one that found the reader gone


# -- what is left behind ------------------------------------------------------------------------------------


@pytest.mark.parametrize("command", ["run", "replay", "demo"])
def test_whatever_raises_between_start_and_loop_handlers_of_signals_and_threads_are_as_before(
    command: str, tmp_path: Path, keep: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise ZeroDivisionError("in the middle")

    module = importlib.import_module(f"arva_hil.cli.{command}")
    monkeypatch.setattr(module, "ClosedLoop" if command == "demo" else "Emulator", fail)
    arguments = {
        "run": ["--autopilot", keep(PtyLink()).path, "--port", "pty"],
        "replay": [str(DATA / "px4.tlog")],
        "demo": ["--speed", "max", "--record", str(tmp_path / "record")],
    }[command]
    parser = CommandParser(prog=command)
    arguments_of(command)(parser)
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    before = [*map(signal.getsignal, numbers), threading.excepthook]
    with pytest.raises(ZeroDivisionError):
        module.main(parser.parse(arguments))
    assert [*map(signal.getsignal, numbers), threading.excepthook] == before


def test_an_error_of_the_system_that_nobody_foresaw_is_not_laid_to_stdout(
    arva: Arva, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(**_: object) -> str:
        raise OSError(errno.ENOSPC, "No space left on device", "/tmp/arva-demo-x")

    monkeypatch.setattr(tempfile, "mkdtemp", full)
    code, _, err = arva("demo", "--speed", "max")
    assert code == 1
    assert "stdout" not in err
    assert re.search(r"unexpected OSError: .*No space left on device: '/tmp/arva-demo-x' \(cli/demo.py:\d+\)", err)
