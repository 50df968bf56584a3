"""Who else reads a terminal, which is asked before anything is armed."""

from __future__ import annotations

import os
import select
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from arva_hil.links.processes import other_readers
from arva_hil.links.pty import PtyLink

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="/proc")

OPENS = "import os, sys; fd = os.open(sys.argv[1], {}); print(1, flush=True); sys.stdin.read()"
SERVES = "import os, sys; m, s = os.openpty(); print(os.ttyname(s), flush=True); sys.stdin.read()"


@contextmanager
def program(code: str, *arguments: str) -> Iterator[tuple[int, str]]:
    """A program that holds something open; its process id, and the line it has printed."""
    with subprocess.Popen(
        [sys.executable, "-c", code, *arguments], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as process:
        assert select.select([process.stdout], [], [], 20)[0]
        yield process.pid, process.stdout.readline().decode().strip()
        process.kill()


@pytest.fixture
def line() -> Iterator[PtyLink]:
    link = PtyLink()
    yield link
    link.close()


def test_who_serves_a_pseudo_terminal_is_no_reader() -> None:
    with program(SERVES) as (_, path):
        assert other_readers(path) == []


def test_we_ourselves_are_no_other(line: PtyLink) -> None:
    assert other_readers(line.path) == []


@pytest.mark.parametrize("how", ["os.O_RDONLY", "os.O_RDWR"])
def test_a_reader_is_named_by_whatever_name_the_terminal_is_asked_for(line: PtyLink, tmp_path: Path, how: str) -> None:
    name = tmp_path / "arva0"
    name.symlink_to(line.path)
    with program(OPENS.format(how), str(name)) as (pid, _):
        for path in (line.path, str(name)):
            (found,) = other_readers(path)
            assert found.startswith(f"{pid} ({sys.executable} -c import os")
    assert other_readers(line.path) == []


def test_who_only_writes_takes_nothing_away(line: PtyLink) -> None:
    with program(OPENS.format("os.O_WRONLY"), line.path):
        assert other_readers(line.path) == []


@pytest.mark.parametrize("name", ["", "tcp:127.0.0.1:5760", "memory:a", "/nowhere", os.devnull + "\0", "."])
def test_what_is_no_device_has_no_readers(name: str) -> None:
    assert other_readers(name) == []
