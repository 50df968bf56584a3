"""A command that is ended at any moment leaves nothing behind, and the next start works."""

from __future__ import annotations

import signal
from collections.abc import Callable

import pytest

from arva_hil.clock import RealClock
from arva_hil.links.pty import PtyLink
from firmware_proto import Decoder, Frame
from tests.cli.far_ends import Autopilot, Program, read_frames, until
from tools.soak import kills as random_kills


def test_six_random_ends_leave_nothing(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(random_kills, "COMMANDS", ("run", "search", "campaign"))
    code = random_kills.main(["--kills", "6", "--seed", "4"])
    said = capsys.readouterr().out
    assert code == 0, said
    assert "-9" in said


def test_a_run_that_stood_still_skips_frames_and_goes_on(
    start: Callable[..., Program], autopilot: Autopilot, line: PtyLink
) -> None:
    program = start("--port", line.path, "--autopilot", autopilot.address, "--rate", 50)
    read_frames(line, 50)
    program.send(signal.SIGSTOP)
    clock, decoder, frames = RealClock(), Decoder(), list[Frame]()
    clock.wait(2.0)
    program.send(signal.SIGCONT)
    until(lambda: frames.extend(decoder.feed(line.read(), clock.now())) or len(frames) > 150)
    assert decoder.lost >= 20
    program.stops()
    assert "frames were skipped: the program was delayed by more than a second" in program.err
