"""A caller that has closed standard input, output or error, and an environment that names what is no option."""

from __future__ import annotations

import contextlib
import os
import signal
from pathlib import Path
from typing import Any

import pytest

from arva_hil.cli import main
from arva_hil.cli.main import COMMANDS
from arva_hil.cli.options import CommandParser
from arva_hil.links.pty import PtyLink

from .far_ends import Arva, Autopilot, Start, frames_in, read_frames, until

ROOT = Path(__file__).parent.parent.parent
DEFAULT = ROOT / "configs" / "default.yaml"
LOG = ROOT / "tests" / "data" / "px4.tlog"


def shut(which: str) -> dict[str, list[str]]:
    """Start it as `arva-hil … WHICH`, e.g. `2>&-`, with an interpreter of its own."""
    return {"before": ["sh", "-c", f'exec "$@" {which}', "sh"]}


def test_with_stderr_closed_nothing_but_frames_is_on_stdout(start: Start, autopilot: Autopilot) -> None:
    program = start("--port", "-", "--autopilot", autopilot.address, "--rate", 20, **shut("2>&-"))
    until(lambda: len(program.out) > 200)
    program.send(signal.SIGINT)
    assert program.ends() == 130
    assert len(frames_in(program.out)) > 5


@pytest.mark.parametrize("which", ["2>&-", ">&-", ">&- 2>&-", "<&- >&- 2>&-"])
def test_whatever_is_closed_nothing_but_frames_is_on_the_port(
    start: Start, autopilot: Autopilot, line: PtyLink, which: str
) -> None:
    arguments = ("--port", line.path, "--autopilot", autopilot.address, "--rate", 20, "-v")
    program = start(*arguments, **shut(which))
    read_frames(line, 10)
    program.send(signal.SIGINT)
    assert program.ends() == 130
    assert bytes(autopilot.heard).count(b"arva-hil") == 0


CLOSED = {"<&-": [0], "2>&-": [2], ">&-": [1], ">&- 2>&-": [1, 2], "<&- >&- 2>&-": [0, 1, 2]}
OTHERS = {"2>/dev/full": ("/dev/full", "w"), "2</dev/null": (os.devnull, "r")}


@pytest.mark.parametrize("which", [*CLOSED, *OTHERS])
def test_no_command_crashes(start: Start, which: str) -> None:
    for arguments, code in ((["check", "none.yaml"], 2), (["replay", LOG], 0)):
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
        assert program.ends() == code, arguments
        assert "unexpected" not in program.err


@pytest.mark.parametrize(
    ("arguments", "what"),
    [
        (["--port", "-", "--autopilot", "pty"], "--port -: the frames go to stdout, which is closed"),
        (["replay", LOG, "--out", "-"], "--out -: the frames go to stdout, which is closed"),
        (["ports", "--json"], "--json: the data go to stdout, which is closed"),
    ],
)
def test_data_for_a_stdout_that_is_closed_are_refused(start: Start, arguments: list[Any], what: str) -> None:
    program = start(*arguments, **shut(">&-"))
    assert program.ends() == 2
    assert program.err == f"arva-hil: {what}\n"


def test_a_closed_stdin_is_at_its_end(start: Start) -> None:
    program = start("listen", "-", **shut("<&-"))
    assert program.ends() == 0
    assert program.err.startswith("0 frames, ")


# -- the environment ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("ARVA_HIL_PROT", "ARVA_HIL_PROT is not an option of any command; did you mean ARVA_HIL_PORT?"),
        ("ARVA_HIL_RECIEVER", "ARVA_HIL_RECIEVER is not an option of any command; did you mean ARVA_HIL_RECEIVER?"),
        ("ARVA_HIL_QQQQQQ", "ARVA_HIL_QQQQQQ is not an option of any command"),
        ("ARVA_HIL_\x1b[2J", "ARVA_HIL_\\x1b[2J is not an option of any command"),
    ],
)
def test_a_variable_that_is_no_option_is_named_and_no_error(
    arva: Arva, monkeypatch: pytest.MonkeyPatch, name: str, said: str
) -> None:
    monkeypatch.setenv(name, "1")
    code, _, err = arva("check", DEFAULT)
    assert code == 0
    assert err == f"warning: {said}\n"


@pytest.mark.parametrize("name", ["ARVA_HIL_RECEIVER", "ARVA_HIL_RATE", "ARVA_HIL_JOBS", "ARVA_HIL_PX4"])
def test_an_option_of_another_command_is_none_to_speak_of(
    arva: Arva, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    monkeypatch.setenv(name, "1")
    code, _, err = arva("check", DEFAULT)
    assert (code, err) == (0, "")


def test_a_variable_for_what_has_to_be_typed_is_named() -> None:
    parser = CommandParser(prog="x")
    parser.option("--yes", "", environment=False)
    assert main.unknown_variables({"ARVA_HIL_YES": "1"}, parser, ["check"]) == [
        "ARVA_HIL_YES is not read: type --yes each time"
    ]


def test_what_is_no_variable_of_ours_or_is_empty_is_not_looked_at() -> None:
    assert main.unknown_variables({"ARVA_HIL": "1", "HOME": "x", "ARVA_HIL_PROT": ""}, CommandParser(), COMMANDS) == []
