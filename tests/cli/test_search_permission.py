"""`arva-hil search` and a vehicle that is not known to be a simulator: --yes, a typed yes, or exit code 2."""

from __future__ import annotations

import os
import signal

import pytest

from arva_hil.cli.terminal import TerminalQuestion

from .far_ends import Autopilot, Beacon, Keep, Start
from .test_search import ARM, orders
from .test_terminal import Terminal

QUESTION = r"is not known to be a simulator: propellers will turn\. Type yes to let it fly"


def arguments(autopilot: Autopilot, beacon: Beacon) -> tuple[str, ...]:
    return "search", "--autopilot", autopilot.address, "--receiver", beacon.link.path


def test_a_simulator_needs_no_yes(start: Start, autopilot: Autopilot, beacon: Beacon) -> None:
    program = start(*arguments(autopilot, beacon))
    program.says("is a simulator: it answers with SIMSTATE")
    program.says("arming")
    program.send(signal.SIGINT)
    assert program.ends() == 130


@pytest.mark.parametrize("variable", [{}, {"ARVA_HIL_YES": "1"}])
def test_without_a_terminal_and_a_yes_it_is_refused(
    start: Start, real: Autopilot, beacon: Beacon, variable: dict[str, str]
) -> None:
    program = start(*arguments(real, beacon), "--json", env=os.environ | variable)
    assert program.ends() == 2
    assert "is not known to be a simulator: to let it fly, write --yes\n" in program.err
    assert ("warning: ARVA_HIL_YES is not read: type --yes each time" in program.err) == bool(variable)
    assert b'"outcome": "refused"' in program.out
    assert orders(real) == []


def test_yes_on_the_command_line(start: Start, real: Autopilot, beacon: Beacon) -> None:
    program = start(*arguments(real, beacon), "--yes")
    program.says("warning: .* is not known to be a simulator; --yes")
    program.says("arming")
    program.send(signal.SIGINT)
    assert program.ends() == 130


@pytest.mark.parametrize(
    ("typed", "armed"), [(b"yes\n", True), (b"no\n", False), (b"\x04", False), (b"ye\x7fs\n", False)]
)
def test_the_answer_is_typed_at_the_terminal(
    start: Start, real: Autopilot, beacon: Beacon, keep: Keep, typed: bytes, armed: bool
) -> None:
    terminal = keep(Terminal(160))
    terminal.types(b"yes\n")  # before the question: no answer
    program = start(*arguments(real, beacon), stdin=terminal.slave, stderr=terminal.slave)
    terminal.shows(QUESTION)
    assert ARM not in orders(real)
    terminal.types(typed)
    if armed:
        terminal.shows("arming")
        program.send(signal.SIGINT)
        assert program.ends() == 130
    else:
        terminal.shows("the answer was not yes: nothing was done")
        assert program.ends() == 2
        assert orders(real) == []


def test_ctrl_c_at_the_question_arms_nothing(start: Start, real: Autopilot, beacon: Beacon, keep: Keep) -> None:
    terminal = keep(Terminal(160))
    program = start(*arguments(real, beacon), stdin=terminal.slave, stderr=terminal.slave)
    terminal.shows(QUESTION)
    program.send(signal.SIGINT)
    assert program.ends() == 130
    assert orders(real) == []


def test_no_question_is_asked_that_nobody_sees(start: Start, real: Autopilot, beacon: Beacon, keep: Keep) -> None:
    terminal = keep(Terminal(160))
    program = start(*arguments(real, beacon), stdin=terminal.slave)
    assert program.ends() == 2
    assert "to let it fly, write --yes" in program.err


def test_in_the_background_nothing_is_read_for_that_would_stop_the_program(
    keep: Keep, monkeypatch: pytest.MonkeyPatch
) -> None:
    terminal = keep(Terminal(80))
    question = TerminalQuestion(lambda text: None, terminal.slave)
    terminal.types(b"yes\n")
    monkeypatch.setattr(os, "tcgetpgrp", lambda fd: os.getpgrp() + 1)
    assert question.answer() is None
    monkeypatch.setattr(os, "tcgetpgrp", lambda fd: os.getpgrp())
    assert question.answer() == "yes"
