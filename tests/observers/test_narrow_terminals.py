"""Long sentences on a terminal: rows that end between words. Elsewhere a line stays one."""

from __future__ import annotations

import fcntl
import io
import os
import re
import struct
import termios
from collections.abc import Iterator
from typing import TextIO

import pytest
from hypothesis import given
from hypothesis import strategies as st

from arva_hil.cli.terminal import show_marked, tell
from arva_hil.events.words.text import Notice
from arva_hil.observers.console import Printer
from arva_hil.safe_text import columns_of, wrapped

LONG = "no rangefinder sends values: the height is held above the take-off point; over a slope the height is different"
PATH = "/tmp/a-folder-whose-name-is-longer-than-the-terminal-is-wide/search.csv"


@pytest.fixture
def terminal(monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[TextIO, int]]:
    """The program's end, 40 columns wide, and the other end's descriptor."""
    monkeypatch.setenv("TERM", "xterm-256color")
    monkeypatch.delenv("NO_COLOR", raising=False)
    master, slave = os.openpty()
    fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 40, 0, 0))
    with open(slave, "w") as stream:
        yield stream, master
    os.close(master)


def shown(master: int) -> list[str]:
    """The rows on a terminal, without colours and what erases a status."""
    text = os.read(master, 65536).decode()
    return re.sub(r"\x1b\[[0-9;]*[A-Za-z]", "", text).replace("\r", "").splitlines()


def test_a_notice_is_broken_between_words_and_further_rows_are_indented(terminal: tuple[TextIO, int]) -> None:
    stream, master = terminal
    printer = Printer(stream)
    printer.notice(Notice("warning", LONG))
    printer.close()
    rows = shown(master)
    assert max(map(len, rows)) <= 40
    assert [row[:2] == "  " for row in rows] == [False, *[True] * (len(rows) - 1)]
    assert " ".join(row.strip() for row in rows) == f"warning: {LONG}"


def test_a_path_stays_whole(terminal: tuple[TextIO, int]) -> None:
    stream, master = terminal
    printer = Printer(stream)
    printer.say(f"record: {PATH}, kept for 7 days")
    printer.close()
    assert shown(master) == ["record:", f"  {PATH},", "  kept for 7 days"]


def test_an_error_before_anything_runs_is_broken_too(
    terminal: tuple[TextIO, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    stream, master = terminal
    monkeypatch.setattr("sys.stderr", stream)
    tell(LONG)
    stream.flush()
    rows = shown(master)
    assert len(rows) > 1
    assert max(map(len, rows)) <= 40


def test_a_finding_has_its_colour_on_its_mark_alone_and_its_rows_below_each_other(
    terminal: tuple[TextIO, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    stream, master = terminal
    monkeypatch.setattr("sys.stdout", stream)
    show_marked("FAIL", f"  port  {LONG}", paint=lambda mark: f"\x1b[1m{mark}\x1b[0m", further=12)
    raw = os.read(master, 65536).decode()
    assert raw.startswith("\x1b[1mFAIL\x1b[0m  port  no rangefinder")
    rows = raw.replace("\x1b[1m", "").replace("\x1b[0m", "").replace("\r", "").splitlines()
    assert max(map(len, rows)) <= 40
    assert all(row.startswith(" " * 12) for row in rows[1:])


def test_what_is_no_terminal_gets_one_line() -> None:
    stream = io.StringIO()
    printer = Printer(stream)
    printer.notice(Notice("warning", LONG))
    printer.close()
    assert stream.getvalue() == f"warning: {LONG}\n"
    assert columns_of(None) is None


@given(st.text(st.characters(codec="ascii", categories=["L", "P", "Zs"])), st.integers(1, 100))
def test_no_word_is_lost_or_cut_and_only_a_single_word_is_too_long(line: str, columns: int) -> None:
    rows = wrapped(line, columns).split("\n")
    assert " ".join(rows).split() == line.split()
    assert all(len(row) <= columns or len(row.split()) <= 1 for row in rows)
