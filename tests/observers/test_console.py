"""The status of a run on terminals of any width, its colours, and long sentences."""

from __future__ import annotations

import fcntl
import io
import itertools
import os
import re
import struct
import termios
from collections.abc import Iterator, Sequence
from typing import TextIO

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from arva_hil.cli.terminal import show_marked, tell
from arva_hil.events import FrameMade, ReceiverStatus, StatusReport, VehicleStatus
from arva_hil.events.words import text
from arva_hil.events.words.text import Notice, status_line, status_table
from arva_hil.model.receiver import ChannelReading, Pose, Zone
from arva_hil.observers.console import Printer
from arva_hil.records.pictures.style import LOOKS, SHAPES
from arva_hil.safe_text import columns_of, wrapped
from tests.every import every
from tests.made_frames import frame_made
from tests.records.test_pictures import SIMULATED, XYZ, lab, linear

POSE = Pose(np.zeros(3), np.eye(3))
NEAR = ChannelReading(2, Zone.INNER, 90, 0, 0.9)
FAR = ChannelReading(17, Zone.MID, 3046, -112, 30.0)
NOTHING = ChannelReading(None, Zone.OUTER, -1, -1, None)
RATES = {"GLOBAL_POSITION_INT": 49.6, "ATTITUDE": 50.2, "HOME_POSITION": 0.1}


def made(*channels: ChannelReading) -> FrameMade:
    return frame_made(0, *channels, instant_s=1.0, pose=POSE, of=("v", "r"), age_s=0.015)


def vehicle(name: str, receivers: dict[str, FrameMade | None]) -> VehicleStatus:
    each = [ReceiverStatus(receiver, last, 42, 2) for receiver, last in receivers.items()]
    return VehicleStatus(name, "quadrotor 1/1", RATES, each)


ONE = StatusReport(1.0, [vehicle("vehicle", {"receiver": made(FAR, NOTHING)})])
TWO_HEARD = StatusReport(1.0, [vehicle("vehicle", {"receiver": made(FAR, NEAR, NOTHING)})])
FLEET = StatusReport(
    1.0,
    [
        vehicle("alpha", {"front": made(FAR, NEAR), "rear": made(NOTHING)}),
        VehicleStatus("bravo", "", {}, [ReceiverStatus("receiver", None, 0, 0)]),
    ],
)


@every(
    "columns, line",
    [
        (200, "#17  mid    3046 cm -112° | pose 15 ms | 40 sent, 2 dropped | pos 50 Hz att 50 Hz | quadrotor 1/1"),
        (79, "#17  mid    3046 cm -112° | pose 15 ms | 40 sent, 2 dropped"),
        (39, "#17  mid    3046 cm -112° | pose 15 ms"),
        (30, "#17  mid    3046 cm -112°"),
        (10, "#17  mid  "),
    ],
)
def test_the_reading_comes_first_and_what_does_not_fit_is_left_out_whole(columns: int, line: str) -> None:
    assert status_table(ONE, columns, 20) == [line.rstrip()]


def test_each_channel_that_hears_has_a_line_the_nearest_first_and_no_direction_in_the_inner_zone() -> None:
    assert status_table(TWO_HEARD, 39, 20) == [
        "#2   inner    90 cm       | pose 15 ms",
        "#17  mid    3046 cm -112°",
    ]


def test_several_receivers_are_a_table() -> None:
    assert status_table(FLEET, 79, 20, named=True) == [
        "alpha/front     #2   inner    90 cm       | pose 15 ms | 40 sent, 2 dropped",
        "                #17  mid    3046 cm -112°",
        "alpha/rear      no signal                 | pose 15 ms | 40 sent, 2 dropped",
        "bravo/receiver  no frame yet              | 0 sent, 0 dropped | no vehicle yet",
    ]


@every("columns", [20, 39, 79, 199])
@every("most", [1, 2, 20])
def test_a_table_never_leaves_the_terminal(columns: int, most: int) -> None:
    table = status_table(FLEET, columns, most, named=True)
    assert len(table) <= most
    assert max(map(len, table)) <= columns


def test_a_table_that_is_too_long_says_how_much_is_missing() -> None:
    assert status_table(FLEET, 79, 2, named=True)[1] == "… and 3 lines more"


def test_in_a_pipe_it_is_one_line_with_everything() -> None:
    assert status_line(TWO_HEARD) == (
        "#2 inner 90 cm, #17 mid 3046 cm -112° | pose 15 ms | 40 sent, 2 dropped | pos 50 Hz att 50 Hz | quadrotor 1/1"
    )
    assert status_line(FLEET, named=True).count(" || ") == 2


def test_in_a_pipe_a_fleet_is_a_table_of_one_line_for_each_receiver() -> None:
    eight = StatusReport(9.0, [vehicle(f"drone-{n}", {"receiver": made(FAR, NEAR, NOTHING)}) for n in range(8)])
    stream = io.StringIO()
    printer = Printer(stream, named=True)
    printer.observe(eight)
    printer.close()
    lines = stream.getvalue().splitlines()
    assert len(lines) == 8
    assert lines[0] == "drone-0/receiver  #2   inner    90 cm       +1 | pose 15 ms | 40 sent, 2 dropped"
    assert max(map(len, lines)) <= 100
    assert {line.index("|") for line in lines} == {lines[0].index("|")}


# -- what is written over --------------------------------------------------------------------------------------


class Screen(io.StringIO):
    def isatty(self) -> bool:
        return True


def shown(events: Sequence[StatusReport | str], monkeypatch: pytest.MonkeyPatch, columns: int = 40) -> list[str]:
    """The lines on a screen that knows carriage return, line feed, cursor up and erase to the end of the line."""
    monkeypatch.setenv("NO_COLOR", "1")
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr("arva_hil.observers.console._size", lambda _: (columns, 24))
    stream = Screen()
    printer = Printer(stream, named=False)
    for event in events:
        if isinstance(event, str):
            printer.say(event)
        else:
            printer.observe(event)
    printer.settle()
    printer.say("sum")
    printer.close()
    lines, row, column = [""], 0, 0
    rest = stream.getvalue()
    while rest:
        for code in ("\x1b[K", "\x1b[A", "\r", "\n", rest[0]):
            if rest.startswith(code):
                break
        rest = rest[len(code) :]
        if code == "\x1b[K":
            lines[row] = lines[row][:column]
        elif code == "\x1b[A":
            row -= 1
        elif code == "\r":
            column = 0
        elif code == "\n":
            row, column = row + 1, 0
            lines += [""] * (row + 1 - len(lines))
        else:
            lines[row], column = lines[row][:column].ljust(column) + code + lines[row][column + 1 :], column + 1
    return [line.rstrip() for line in lines]


def test_a_table_that_grows_and_shrinks_is_written_over_and_news_come_above_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert shown([ONE, TWO_HEARD, "news", TWO_HEARD, "more news", ONE], monkeypatch) == [
        "news",
        "more news",
        "#17  mid    3046 cm -112° | pose 15 ms",
        "sum",
        "",
    ]


def test_the_last_status_stays_above_what_is_said_at_the_end(monkeypatch: pytest.MonkeyPatch) -> None:
    lines = shown([ONE, "news", TWO_HEARD], monkeypatch)
    assert lines == ["news", *status_table(TWO_HEARD, 39, 20), "sum", ""]


# -- colours ---------------------------------------------------------------------------------------------------


def shade(colour: int) -> str:
    """One of xterm's 6 × 6 × 6 colours as #rrggbb."""
    levels, n = (0, 95, 135, 175, 215, 255), colour - 16
    return "#" + "".join(f"{levels[step]:02x}" for step in (n // 36, n // 6 % 6, n % 6))


@every("eyes", SIMULATED)
def test_the_colours_differ_to_all_eyes(eyes: str) -> None:
    seen = [lab(np.array(SIMULATED[eyes]) @ linear(shade(colour))) for colour in (text.GOOD, text.DOUBTFUL, text.BAD)]
    assert min(float(np.linalg.norm(a - b)) for a, b in itertools.combinations(seen, 2)) > 60


@pytest.mark.parametrize("background", [0.0, 1.0], ids=["black", "white"])
def test_the_colours_stand_out_from_dark_and_light_terminals(background: float) -> None:
    for colour in (text.GOOD, text.DOUBTFUL, text.BAD, *text.SIGN_COLOURS):
        light, dark = sorted([float(XYZ[1] @ linear(shade(colour))), background], reverse=True)
        assert (light + 0.05) / (dark + 0.05) >= 3.0  # WCAG's least contrast of what is not small text


def test_a_transmitter_has_the_sign_and_the_colour_of_its_id_in_every_width() -> None:
    line = "#2 inner 90 cm, #17 mid 3046 cm | alpha#3, #?"
    assert text.with_signs(line, False) == "▲2 inner 90 cm, ◆17 mid 3046 cm | alpha#3, #?"
    assert text.with_signs("#3", True) == "\x1b[38;5;198m◆\x1b[39m3"
    looks = {(text.SIGNS[i % len(text.SIGNS)], text.SIGN_COLOURS[i % len(text.SIGN_COLOURS)]) for i in range(42)}
    assert len(looks) == 42
    assert (len(text.SIGNS), len(text.SIGN_COLOURS)) == (len(SHAPES), len(LOOKS))


def test_a_terminal_has_the_signs_only_if_it_can_print_them(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TERM", "xterm")
    for encoding, sign in (("utf-8", "◆17"), ("ascii", "#17")):
        monkeypatch.setattr(Screen, "encoding", encoding, raising=False)
        stream = Screen()
        printer = Printer(stream)
        printer.observe(ONE)
        printer.close()
        assert sign in re.sub(r"\x1b\[[0-9;]*m", "", stream.getvalue())


def test_a_terminal_that_knows_nothing_gets_plain_lines(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TERM", "dumb")
    stream = Screen()
    printer = Printer(stream)
    printer.observe(ONE)
    printer.say("news")
    printer.close()
    assert stream.getvalue() == "news\n"


# -- long sentences on a terminal: rows that end between words. Elsewhere a line stays one ---------------------


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


def rows_on(master: int) -> list[str]:
    """The rows on a terminal, without colours and what erases a status."""
    text = os.read(master, 65536).decode()
    return re.sub(r"\x1b\[[0-9;]*[A-Za-z]", "", text).replace("\r", "").splitlines()


def test_a_notice_is_broken_between_words_and_further_rows_are_indented(terminal: tuple[TextIO, int]) -> None:
    stream, master = terminal
    printer = Printer(stream)
    printer.notice(Notice("warning", LONG))
    printer.close()
    rows = rows_on(master)
    assert max(map(len, rows)) <= 40
    assert [row[:2] == "  " for row in rows] == [False, *[True] * (len(rows) - 1)]
    assert " ".join(row.strip() for row in rows) == f"warning: {LONG}"


def test_a_path_stays_whole(terminal: tuple[TextIO, int]) -> None:
    stream, master = terminal
    printer = Printer(stream)
    printer.say(f"record: {PATH}, kept for 7 days")
    printer.close()
    assert rows_on(master) == ["record:", f"  {PATH},", "  kept for 7 days"]


def test_an_error_before_anything_runs_is_broken_too(
    terminal: tuple[TextIO, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    stream, master = terminal
    monkeypatch.setattr("sys.stderr", stream)
    tell(LONG)
    stream.flush()
    rows = rows_on(master)
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
