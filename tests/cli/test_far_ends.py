"""What the command line's tests stand on: a test that fails says why, and does not disturb another one."""

from __future__ import annotations

import os
import select
from pathlib import Path

import pytest

from arva_hil.links.pty import PtyLink
from tests.said import says

from . import far_ends, forked
from .conftest import pytest_runtest_makereport
from .far_ends import DEADLINE_S, Autopilot, Start, read_frames
from .forked import Forked


def report_of(item: pytest.Item) -> str:
    """What a report says behind the traceback if the test `item` fails now."""
    report = pytest.TestReport(item.nodeid, item.location, {}, "failed", "it failed", "call")
    hook = pytest_runtest_makereport(item)
    next(hook)
    with pytest.raises(StopIteration):
        hook.send(report)
    return "\n".join(f"{title}: {text}" for title, text in report.sections)


def test_the_report_of_a_failure_has_what_its_programs_have_said(
    start: Start, autopilot: Autopilot, request: pytest.FixtureRequest
) -> None:
    ended = start("--port", "/dev/ttyNONE7", "--autopilot", autopilot.address)
    ended.process.wait(far_ends.DEADLINE_S)  # and nobody has read its stderr
    runs = start("listen", autopilot.address).after("listening")
    told = report_of(request.node)
    says(
        told,
        f"Autopilot 1: built-in vehicle 1, which serves pty ({autopilot.address}); it has heard 0 bytes",
        f"Program 2: ['--port', '/dev/ttyNONE7', '--autopilot', '{autopilot.address}']",
        "has ended with 3; it has said:\n",
        "arva-hil: /dev/ttyNONE7: no such port",
        f"process {runs.process.pid} still runs; it has said:\nlistening at {autopilot.address}\n",
    )


def test_frames_of_a_program_that_has_ended_are_not_waited_for(
    start: Start, line: PtyLink, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(far_ends, "_LAST_BYTES_S", 0.1)
    start("--port", line.path, "--autopilot", "/dev/ttyNONE7")
    with pytest.raises(AssertionError, match="only 0 of 1 frames came"):
        read_frames(line, 1)


def test_a_terminal_without_a_symlink_is_not_closed_while_a_program_may_look_for_it(
    start: Start, line: PtyLink, tmp_path: Path
) -> None:
    named = PtyLink(str(tmp_path / "line"))
    start("listen", line.path).says("listening")
    named.close()
    with pytest.raises(AssertionError, match="give it a symlink"):
        line.close()


# -- the server that forks programs goes on, whatever becomes of one of them -----------------------------------


NULL = dict.fromkeys(("stdin", "stdout", "stderr"), forked._DEVNULL)


@pytest.mark.skipif(not forked.possible({}), reason="nothing is forked here")
def test_nobody_wants_to_know_how_a_program_ended() -> None:
    program = Forked(["vehicle", "--link", "pty"], env=None, **NULL)
    os.close(program._status)
    program._status, status = os.pipe()  # `kill` asks there
    program.kill()
    assert select.select([program._pidfd], [], [], DEADLINE_S)[0]
    for fd in (program._pidfd, program._status, status):
        os.close(fd)
    for _ in range(3):
        assert Forked(["--version"], env=None, **NULL).wait(DEADLINE_S) == 0
