"""The tutorial, typed line by line: each command answers what the page says."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.cli.far_ends import UNDER_TEST

from .pages import ROOT, Typed, console, pattern

LESSONS = ["first-victim", "own-client", "own-search", "driver-in-ci"]
DEADLINE_S = 180.0  # of a command, on a machine that others use too


class Terminal:
    """Types commands in a folder, one after the other; the last one may still run."""

    def __init__(self, folder: Path, environment: dict[str, str]) -> None:
        self._folder = folder
        self._environment = environment
        self._running: subprocess.Popen[bytes] | None = None
        self._said = tempfile.TemporaryFile("a+b")  # noqa: SIM115 (closed in `close`); its writer appends, whoever reads

    def type(self, typed: Typed, *, stays: bool) -> None:
        """Type a command, and wait for its end, or until it has answered when it stays; compare what it said."""
        self._said.seek(0)
        self._said.truncate()
        self._running = subprocess.Popen(
            ["bash", "-c", typed.command],
            cwd=self._folder,
            env=self._environment,
            stdin=subprocess.DEVNULL,
            stdout=self._said,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )
        wanted = pattern(typed.answer)
        end = time.monotonic() + DEADLINE_S
        while time.monotonic() < end:
            ended = self._running.poll() is not None
            said = self.said()
            if stays and not ended and said.endswith("\n") and wanted.match(said):
                return
            if ended:
                assert not stays, f"{typed.place}: it has ended:\n{said}"
                break
            try:
                self._running.wait(0.1)
            except subprocess.TimeoutExpired:
                continue
        assert not stays, f"{typed.place}: {typed.command}: expected\n{typed.answer}\nit said\n{self.said()}"
        assert self._running.wait(0) == 0, f"{typed.place}: {self.said()}"
        assert wanted.fullmatch(self.said()), f"{typed.place}: expected\n{typed.answer}\nit said\n{self.said()}"

    def said(self) -> str:
        self._said.seek(0)
        return self._said.read().decode()

    def interrupt(self) -> None:
        """Type Ctrl-C."""
        assert self._running is not None
        os.killpg(self._running.pid, signal.SIGINT)
        self._running.wait(DEADLINE_S)
        assert "Traceback" not in self.said(), self.said()

    def close(self) -> None:
        if self._running is not None and self._running.poll() is None:
            os.killpg(self._running.pid, signal.SIGKILL)
            self._running.wait()
        self._said.close()


@pytest.fixture
def terminals(tmp_path: Path) -> Iterator[dict[str, Terminal]]:
    """Terminals, opened when they are first typed in, in a folder like this project's, of a user with an empty home."""
    folder, home = tmp_path / "arva-hil", tmp_path / "home"
    folder.mkdir()
    home.mkdir()
    for name in ("configs", "docs", "firmware_proto", "tests"):
        (folder / name).symlink_to(ROOT / name)
    programs = f"{Path(UNDER_TEST or sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    environment = {"HOME": str(home), "PATH": programs, "TMPDIR": str(tmp_path), "LANG": "C.UTF-8"}
    opened: dict[str, Terminal] = defaultdict(lambda: Terminal(folder, environment))
    yield opened
    for terminal in opened.values():
        terminal.close()


@pytest.mark.parametrize("lesson", LESSONS)
def test_a_lesson_answers_what_its_page_says(lesson: str, terminals: dict[str, Terminal], tmp_path: Path) -> None:
    lines = console(ROOT / f"docs/tutorial/{lesson}.md")
    assert lines
    for i, typed in enumerate(lines):
        if typed.command == "^C":
            terminals[typed.terminal].interrupt()
            continue
        after = next((later.command for later in lines[i + 1 :] if later.terminal == typed.terminal), "")
        here = typed._replace(command=typed.command.replace("/tmp/", f"{tmp_path}/"))
        terminals[typed.terminal].type(here, stays=after == "^C")
