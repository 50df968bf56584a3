"""How a command starts and how it ends before its time: signals, closed streams, errors nobody foresaw."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import importlib
import json
import os
import re
import select
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from arva_hil.cli import common, main, outcome, run, summary
from arva_hil.cli.arguments import arguments_of
from arva_hil.cli.main import COMMANDS
from arva_hil.cli.options import CommandParser, module_name
from arva_hil.cli.outcome import SignalGuard, interrupting, unexpected_error
from arva_hil.clock import StepClock
from arva_hil.emulator.engine import Emulator
from arva_hil.links import pty
from arva_hil.links.pty import PtyLink
from arva_hil.links.tlog import TlogReader, tlog_record
from arva_hil.mavlink.codec import Encoder, dialect
from arva_hil.records.writing import growing_files
from arva_hil.runtime import drivers
from tests.campaign.fakes import PLAN
from tests.files import written
from tests.free_ports import free_port
from tests.made_records import write
from tests.signal_at import signalled

from .far_ends import Arva, Autopilot, Keep, Start, frames_in, read_frames, until

DATA = Path(__file__).parent.parent / "data"


# -- an output that cannot be written ------------------------------------------------------------------------


OUTPUTS = [
    "export {run} --format kml --out {place}",
    "view {run} --out {place}",
    "compare {run} --scenario builtin:default --out {place}.png",
    "replay {log} --out {place}",
    "replay {log} --record {place}",
    "range-test --walks 1 --out {place}",
    "conform --only no-signal --junit {place} -- cat",
    "fit {run} --out {place}",
    "fit {run} --out {run}.yaml --scenario-out {place}",
    "campaign {plan} --out {place}",
]


@pytest.mark.undrawn
@pytest.mark.parametrize("words", OUTPUTS, ids=lambda words: words.split()[0])
def test_a_place_that_cannot_be_written_is_a_wrong_command_line(arva: Arva, tmp_path: Path, words: str) -> None:
    run, place = write(tmp_path / "flight", 5), tmp_path / "flight" / "run.json" / "none"
    plan = written(tmp_path / "plan.yaml", PLAN)
    ended = arva(*words.format(run=run, log=DATA / "px4.tlog", plan=plan, place=place).split(), code=2)
    assert re.search(rf"^arva-hil: {place}.*: Not a directory$", ended.err, re.MULTILINE)
    assert not ended.out, "it was found before the work"


def test_view_opens_its_file_before_it_makes_the_page(
    arva: Arva, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("arva_hil.cli.view.offline_page", lambda state: pytest.fail("the page was made"))
    arva("view", write(tmp_path / "flight", 5), "--out", tmp_path / "none" / "page.html", code=2)


@pytest.mark.undrawn
@pytest.mark.parametrize(
    "words",
    [
        "view {place}",
        "plot {place}",
        "report {place}",
        "export {run} --format kml --out {place}",
        "view {run} --out {place}",
    ],
)
def test_a_name_that_is_too_long_for_the_system_is_a_wrong_name(arva: Arva, tmp_path: Path, words: str) -> None:
    run, place = write(tmp_path / "flight", 5), tmp_path / ("x" * 300)
    err = arva(*words.format(run=run, place=place).split(), code=2).err
    assert re.search(rf"^arva-hil: {place}: cannot be (read|written): File name too long$", err, re.MULTILINE)


def test_view_of_an_empty_name_is_not_that_of_the_folder_here(arva: Arva) -> None:
    assert "the record's name is empty" in arva.refused("view", "")


@pytest.mark.undrawn
@pytest.mark.parametrize("words", OUTPUTS[:1] + OUTPUTS[4:6], ids=lambda words: words.split()[0])
def test_a_disk_that_is_full_is_a_failure_while_running(
    arva: Arva, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: str
) -> None:
    run, place = write(tmp_path / "flight", 5), tmp_path / "none"

    def full(fd: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    monkeypatch.setattr("arva_hil.cli.range_test._PASSES", 2)
    err = arva(*words.format(run=run, log=DATA / "px4.tlog", place=place).split(), code=1).err
    assert re.search(rf"^arva-hil: {place}.*: No space left on device$", err, re.MULTILINE)


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
    program = start("--autopilot", f"pty:{link}", "--port", nobody_answers).after("autopilot: ")
    until(link.is_symlink)
    program.stops(number)
    assert not os.path.lexists(link)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_signals_one_after_the_other_leave_whole_files(
    start: Start, autopilot: Autopilot, line: PtyLink, tmp_path: Path, number: signal.Signals
) -> None:
    """As when a terminal and a wrapper both pass Ctrl-C on."""
    record, link = tmp_path / "record", tmp_path / "arva0"
    program = start("--port", f"pty:{link}", "--autopilot", autopilot.address, "--rate", 50, "--record", record).after(
        "readings are real"
    )
    for _ in range(3):
        program.send(number)
    program.ends(130)
    run = json.loads((record / "run.json").read_bytes())
    assert (run["ended"], run["exit_code"]) == (number.name, 130)
    assert len(frames_in((record / "frames.bin").read_bytes())) == run["counters"]["frames"]
    assert len(list(TlogReader(record / "autopilot.tlog"))) == run["counters"]["packets_received"]
    assert (record / "readings.csv").read_text().count("\n") == 1 + 4 * run["counters"]["frames"]
    assert not os.path.lexists(link)


def test_under_nohup_a_closed_terminal_ends_nothing(start: Start, keep: Keep, line: PtyLink) -> None:
    autopilot = keep(Autopilot(keep(PtyLink()), speed=1.0))
    program = start(
        *("--port", line.path, "--autopilot", autopilot.address, "--rate", 50),
        preexec_fn=lambda: signal.signal(signal.SIGHUP, signal.SIG_IGN),
    ).after("readings are real")
    program.send(signal.SIGHUP)
    read_frames(line, 60)
    program.stops()


@pytest.fixture
def stuck() -> Iterator[int]:
    """A pipe that nobody reads and that has no room; for a program's stdout."""
    reader, writer = os.pipe()
    fcntl.fcntl(writer, fcntl.F_SETPIPE_SZ, 4096)
    os.write(writer, bytes(4096))
    yield writer
    os.close(writer)
    os.close(reader)


def test_ctrl_c_once_is_enough_when_stdout_is_not_read(
    start: Start, autopilot: Autopilot, stuck: int, tmp_path: Path
) -> None:
    record = tmp_path / "record"
    program = start(
        "--port", "-", "--autopilot", autopilot.address, "--rate", 20, "--record", record, stdout=stuck
    ).after("no program takes the frames")
    program.stops(signal.SIGINT)
    counters = json.loads((record / "run.json").read_bytes())["counters"]
    assert counters["dropped"] == counters["frames"] > 0


def test_ctrl_c_once_is_enough_for_a_replay_that_waits_for_its_reader(start: Start) -> None:
    reader, writer = os.pipe()
    fcntl.fcntl(writer, fcntl.F_SETPIPE_SZ, 32768)
    program = start("replay", DATA / "px4.tlog", "--rate", 50, "--out", "-", stdout=writer).after("datum")
    until(lambda: not select.select([], [writer], [], 0)[1])
    program.stops(signal.SIGINT)
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


# -- errors nobody foresaw ---------------------------------------------------------------------------------


def test_an_error_in_the_loop_ends_the_run_with_its_cause(
    arva: Arva, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def advance(self: Emulator, now: float) -> None:
        raise ZeroDivisionError("a mistake")

    monkeypatch.setattr(Emulator, "advance", advance)
    link = tmp_path / "arva0"
    err = arva("--port", f"pty:{link}", "--autopilot", "pty", "--record", tmp_path / "record", code=1).err
    assert "error: unexpected ZeroDivisionError: a mistake (runtime/drivers.py:" in err
    assert "Traceback" not in err
    run = json.loads((tmp_path / "record" / "run.json").read_bytes())
    assert run["exit_code"] == 1
    assert "ZeroDivisionError: a mistake" in run["ended"]
    assert not os.path.lexists(link)


def test_the_whole_story_of_an_error_is_for_who_wants_it(arva: Arva, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Emulator, "advance", lambda self, now: 1 / 0)
    err = arva("--port", "pty", "--autopilot", "pty", "-v", code=1).err
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
    _, out, err = arva(command, *["-v"] * verbose, code=1)
    assert out == ""
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
    assert "unexpected ZeroDivisionError: a mistake (" in arva(*what, "--record", tmp_path, code=1).err


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
    program = start("--port", "-", "--autopilot", autopilot.address, "--rate", 50, "--record", record, stdout=writer)
    os.close(writer)
    program.says("readings are real")
    read = os.read(reader, 65536)
    os.close(reader)
    assert "went away" not in program.ends(141)  # who ended it knows
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
    err = arva("demo", "--speed", "max", code=1).err
    assert "stdout" not in err
    assert re.search(r"unexpected OSError: .*No space left on device: '/tmp/arva-demo-x' \(cli/demo.py:\d+\)", err)


# -- a signal at any line of a command: what was begun is put away, and the exit code says how it ended --------


SAMPLES = 8  # lines, spread over all that are run


@pytest.fixture
def log(tmp_path: Path) -> Path:
    """The first seconds of a flight."""
    return written(tmp_path / "short.tlog", (DATA / "arducopter.tlog").read_bytes()[:8000])


def test_a_run_closes_what_it_has_begun(arva: Arva, tmp_path: Path) -> None:
    link, record = tmp_path / "arva0", tmp_path / "record"
    autopilot = f"udpin:127.0.0.1:{free_port(socket.SOCK_DGRAM)}"
    words = ["--port", f"pty:{link}", "--autopilot", autopilot, "--record", record, "--duration", 0.01]
    modules = (common, run, pty, growing_files)

    def ended(line: int) -> tuple[Any, int]:
        shutil.rmtree(record, ignore_errors=True)
        return signalled(line, modules, lambda: arva(*words, code=(3, 130)), signal.SIGTERM)

    (whole, *_), lines = ended(0)
    assert lines > 200
    for line in range(lines // SAMPLES, lines, lines // SAMPLES):
        (code, _, err), _ = ended(line)
        assert not {"Traceback", "unexpected"} & set(err.split()), f"line {line}"
        assert not os.path.lexists(link), f"line {line}"
        if record.exists():
            said = json.loads((record / "run.json").read_bytes())
            assert said["exit_code"] == code, f"line {line}"
            assert (said["ended"] == "SIGTERM") == (code == 130), f"line {line}"
        assert code == 130 or (code == whole and record.exists()), f"line {line}"


def test_a_replay_for_the_page_is_interrupted_as_any_other(arva: Arva, log: Path) -> None:
    ended, _ = signalled(
        20, [drivers], lambda: arva("view", log, "--web", 0, "--duration", 0.01, code=130), signal.SIGTERM
    )
    assert "cannot be replayed" not in ended.err


def test_a_signal_at_the_end_of_the_replay_ends_the_page_too(arva: Arva, log: Path) -> None:
    signalled(1, [summary], lambda: arva("view", log, "--web", 0, code=130), signal.SIGTERM)


def test_what_a_signal_has_interrupted_is_put_away_whatever_follows_within_a_second(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    clock = StepClock()
    monkeypatch.setattr(outcome, "RealClock", lambda: clock)
    with interrupting():
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGHUP)
        clock.wait(0.9)
        signal.raise_signal(signal.SIGTERM)
        clock.wait(1.1)
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_a_signal_whose_interrupt_was_lost_in_a_destructor_ends_the_next_loop() -> None:
    class Ending:
        def __del__(self) -> None:
            signal.raise_signal(signal.SIGINT)

    with interrupting():
        del (one := [Ending()])[:]
        with SignalGuard() as guard:
            assert guard.caught == signal.SIGINT
        assert one == []


def test_after_the_loop_a_signal_interrupts_nothing_any_more(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = StepClock()
    monkeypatch.setattr(outcome, "RealClock", lambda: clock)
    with interrupting():
        with SignalGuard():
            pass
        signal.raise_signal(signal.SIGTERM)
        clock.wait(1.1)
        with pytest.raises(KeyboardInterrupt):  # it is stuck
            signal.raise_signal(signal.SIGTERM)


# -- set-points do not wait for a processor where the system lets a program run before others ------------------


def test_the_calling_thread_alone_runs_first_until_the_end_and_a_refusal_is_no_error(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    ran: list[int] = []

    def refuse(*_: object) -> None:
        raise PermissionError

    def policy() -> int:
        return os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK

    def search() -> None:
        with common.run_first():
            ran.append(policy())
            thread = threading.Thread(target=lambda: ran.append(os.sched_getscheduler(0)))
            thread.start()
            thread.join(10)
        ran.append(policy())

    main = threading.Thread(target=search)
    main.start()
    main.join(20)
    assert ran[0] in (os.SCHED_RR, os.SCHED_OTHER)  # by what is permitted here
    assert ran[1:] == [os.SCHED_OTHER, os.SCHED_OTHER]
    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    with common.run_first():
        assert policy() == os.SCHED_OTHER


# -- options are read before anything slow is imported ---------------------------------------------------------


SLOW = ["dask", "importlib.metadata", "jinja2", "matplotlib", "numpy", "pymavlink", "yaml"]
PROGRAM = """
import json, sys
from arva_hil.cli.main import main
codes = [main(arguments) for arguments in json.loads(sys.argv[1])]
print("imported:", json.dumps([codes, sorted(set(sys.modules) & set(json.loads(sys.argv[2])))]))
"""


def start(calls: list[list[str]], environment: dict[str, str]) -> tuple[list[int], list[str]]:
    """The exit codes of some calls of the program, one after the other in one process, and what slow it imported."""
    command = [sys.executable, "-c", PROGRAM, json.dumps(calls), json.dumps(SLOW)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True, timeout=60)
    codes, imported = json.loads(done.stdout.rpartition("imported: ")[2])
    return codes, imported


def test_the_help_of_a_command_imports_nothing_slow() -> None:
    assert start([[command, "--help"] for command in COMMANDS], {}) == ([0] * len(COMMANDS), [])


def test_the_help_names_commands_of_other_packages_and_imports_nothing_else() -> None:
    assert start([["--help"]], {}) == ([0], ["importlib.metadata"])


def test_a_mistake_in_an_option_is_found_before_anything_slow_is_imported() -> None:
    calls = [
        ["run", "--rate", "99"],
        ["replay", "--seed", "-1", "flight.tlog"],
        ["search", "--mount", "1,2"],
        ["listen", "--count", "0"],
        ["doctor", "--autopilot", "udpin:nowhere"],
        ["campaign", "--jobs", "0"],
    ]
    assert start(calls, {"ARVA_HIL_TYPO": "1"}) == ([2] * len(calls), [])


def test_a_name_that_is_not_built_in_is_looked_for_in_other_packages_and_imports_nothing_else() -> None:
    calls = [["demo", "--format", "morse"], ["search", "--strategy", "luck"], ["flight.tlog"]]
    assert start(calls, {}) == ([2] * len(calls), ["importlib.metadata"])


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_has_its_arguments_and_what_it_does(command: str) -> None:
    assert arguments_of(command).__doc__
    assert callable(importlib.import_module(f"arva_hil.cli.{module_name(command)}").main)


def test_a_scenario_that_is_no_file_needs_no_yaml(tmp_path: Path) -> None:
    log = written(
        tmp_path / "one.tlog",
        tlog_record(1_700_000_000_000_000, Encoder(1, 1).pack(dialect.MAVLink_heartbeat_message(2, 3, 0x81, 4, 4, 3))),
    )
    codes, imported = start([["replay", str(log), "--out", str(tmp_path / "out"), "--rate", "5", "--seed", "7"]], {})
    assert codes == [0]
    assert "yaml" not in imported


# -- ctrl-C, or another signal, before the program has got anywhere: exit code 130 and no traceback ------------


HOOK = '''
import os, _signal, sys, importlib.abc

class Interrupts(importlib.abc.MetaPathFinder):
    """A signal comes while a certain module is imported."""

    def find_spec(self, name, path, target=None):
        if name == os.environ["INTERRUPT_AT"]:
            sys.meta_path.remove(self)
            os.kill(os.getpid(), getattr(_signal, os.environ["INTERRUPT_BY"]))

sys.meta_path.insert(0, Interrupts())
'''


WAYS = {
    "python -m arva_hil": ["-m", "arva_hil"],
    "arva-hil": ["-c", "import sys; from arva_hil.__main__ import main; sys.exit(main())"],
}
MODULES = {
    "signal": "SIGINT",
    "argparse": "SIGTERM",
    "arva_hil.cli.main": "SIGINT",
    "arva_hil.search.mission.mission": "SIGHUP",
    "arva_hil.cli.arguments.searches": "SIGTERM",
    "numpy": "SIGINT",
}


@pytest.mark.parametrize(("module", "how"), [*zip(MODULES, [*WAYS] * 3, strict=True)])
def test_a_signal_while_a_module_is_imported_ends_it_quietly(tmp_path: Path, module: str, how: str) -> None:
    (tmp_path / "sitecustomize.py").write_text(HOOK)
    command = [sys.executable, *WAYS[how], "demo", "--speed", "max"]
    environment = {**os.environ, "PYTHONPATH": str(tmp_path), "INTERRUPT_AT": module, "INTERRUPT_BY": MODULES[module]}
    done = subprocess.run(command, env=environment, cwd=tmp_path, capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout) == (130, "")
    assert "Traceback" not in done.stderr


# -- a caller that has closed standard input, output or error, and an environment that names what is no option --


ROOT = Path(__file__).parent.parent.parent
DEFAULT = ROOT / "configs" / "default.yaml"
LOG = ROOT / "tests" / "data" / "px4.tlog"


def shut(which: str) -> dict[str, list[str]]:
    """Start it as `arva-hil … WHICH`, e.g. `2>&-`, with an interpreter of its own."""
    return {"before": ["sh", "-c", f'exec "$@" {which}', "sh"]}


def test_with_stderr_closed_nothing_but_frames_is_on_stdout(start: Start, keep: Keep) -> None:
    program = start(
        "--port", "-", "--autopilot", keep(Autopilot(keep(PtyLink()), speed=1.0)).address, "--rate", 20, **shut("2>&-")
    )
    until(lambda: len(program.out) > 200)
    program.stops(signal.SIGINT)
    assert len(frames_in(program.out)) > 5


@pytest.mark.parametrize("which", [">&-", "<&- >&- 2>&-"])
def test_whatever_is_closed_nothing_but_frames_is_on_the_port(
    start: Start, keep: Keep, line: PtyLink, which: str
) -> None:
    autopilot = keep(Autopilot(keep(PtyLink()), speed=1.0))
    program = start("--port", line.path, "--autopilot", autopilot.address, "--rate", 20, "-v", **shut(which))
    read_frames(line, 10)
    program.stops(signal.SIGINT)
    assert bytes(autopilot.heard).count(b"arva-hil") == 0


CLOSED = {"<&-": [0], "2>&-": [2], ">&-": [1], ">&- 2>&-": [1, 2], "<&- >&- 2>&-": [0, 1, 2]}
OTHERS = {"2>/dev/full": ("/dev/full", "w"), "2</dev/null": (os.devnull, "r")}


@pytest.mark.parametrize("which", [*CLOSED, *OTHERS])
def test_no_command_crashes(start: Start, log: Path, which: str) -> None:
    for arguments, code in ((["check", "none.yaml"], 2), (["replay", log], 0)):
        ends_quietly(start, which, arguments, code)


@pytest.mark.parametrize("which", [">&-", "<&- >&- 2>&-", "2>/dev/full"])
def test_nor_does_one_that_only_prints(start: Start, which: str) -> None:
    for arguments in (["check", DEFAULT], ["--help"], ["ports"]):
        ends_quietly(start, which, arguments, 0)


def ends_quietly(start: Start, which: str, arguments: list[Any], code: int) -> None:
    with contextlib.ExitStack() as stack:
        if which in CLOSED:
            program = start(*arguments, closed=CLOSED[which])
        else:
            program = start(*arguments, stderr=stack.enter_context(open(*OTHERS[which])))
        assert "unexpected" not in program.ends(code)


@pytest.mark.parametrize(
    ("arguments", "what"),
    [
        (["--port", "-", "--autopilot", "pty"], "--port -: the data go to stdout, which is closed"),
        (["replay", LOG, "--out", "-"], "--out -: the data go to stdout, which is closed"),
        (["conform", "--junit", "-", "--", "true"], "--junit -: the data go to stdout, which is closed"),
        (["ports", "--json"], "--json: the data go to stdout, which is closed"),
    ],
)
def test_data_for_a_stdout_that_is_closed_are_refused(start: Start, arguments: list[Any], what: str) -> None:
    assert start(*arguments, closed=[1]).ends(2) == f"arva-hil: {what}\n"


def test_a_closed_stdin_is_at_its_end(start: Start) -> None:
    assert start("listen", "-", closed=[0]).ends().startswith("0 frames, ")


# -- the environment ---------------------------------------------------------------------------------------


def test_a_variable_is_never_an_option_without_an_effect(
    arva: Arva, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    for name, value in {"FORMAT": "nmea", "SEED": "3", "JUNIT": "f.xml", "PTY": "1"}.items():
        monkeypatch.setenv(f"ARVA_HIL_{name}", value)
    assert arva("conform", "--list").out
    assert "--seed" not in arva.refused("compare", tmp_path, tmp_path)
    assert "its autopilot is missing" in arva.refused("search", "--scenario", "builtin:eight_drones")


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("ARVA_HIL_PROT", "ARVA_HIL_PROT is not an option of any command; did you mean ARVA_HIL_PORT?"),
        ("ARVA_HIL_RECIEVER", "ARVA_HIL_RECIEVER is not an option of any command; did you mean ARVA_HIL_RECEIVER?"),
        ("ARVA_HIL_QQQQQQ", "ARVA_HIL_QQQQQQ is not an option of any command"),
        ("ARVA_HIL_\x1b[2J", "ARVA_HIL_\\x1b[2J is not an option of any command"),
        *((f"ARVA_HIL_{of_another}", None) for of_another in ("RECEIVER", "RATE", "JOBS", "PX4")),
    ],
)
def test_a_variable_that_is_an_option_of_no_command_is_named_and_no_error(
    arva: Arva, monkeypatch: pytest.MonkeyPatch, name: str, said: str | None
) -> None:
    monkeypatch.setenv(name, "1")
    assert arva("check", DEFAULT).err == (f"warning: {said}\n" if said else "")


def test_the_variables_of_the_tests_are_known_not_to_be_options() -> None:
    """Whoever has set one for the tests is not warned by the program, nor by a program that they start."""
    lines = [line for file in DATA.parent.rglob("*.py") for line in file.read_text().splitlines()]
    ours = {name for line in lines if "os.environ.get(" in line for name in re.findall(r'"(ARVA_HIL_\w+)"', line)}
    assert ours >= {"ARVA_HIL_PX4", "ARVA_HIL_FLIGHTS"}
    assert main.unknown_variables(dict.fromkeys(ours, "1"), CommandParser(), COMMANDS) == []


def test_a_variable_for_what_has_to_be_typed_is_named() -> None:
    parser = CommandParser(prog="x")
    parser.option("--yes", "", environment=False)
    assert main.unknown_variables({"ARVA_HIL_YES": "1"}, parser, ["check"]) == [
        "ARVA_HIL_YES is not read: type --yes each time"
    ]


def test_what_is_no_variable_of_ours_or_is_empty_is_not_looked_at() -> None:
    assert main.unknown_variables({"ARVA_HIL": "1", "HOME": "x", "ARVA_HIL_PROT": ""}, CommandParser(), COMMANDS) == []
