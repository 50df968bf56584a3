"""The status of a run on terminals of any width, and its colours."""

from __future__ import annotations

import io
import itertools
import re
from collections.abc import Sequence

import numpy as np
import pytest

from arva_hil.emulator.receivers import frame_of
from arva_hil.events import FrameMade, ReceiverStatus, StatusReport, VehicleStatus
from arva_hil.events.words import text
from arva_hil.events.words.text import status_line, status_table
from arva_hil.model.receiver import ChannelReading, Pose, Reading, Zone
from arva_hil.observers.console.printer import Printer
from arva_hil.records.pictures.style import LOOKS, SHAPES

POSE = Pose(np.zeros(3), np.eye(3))
NEAR = ChannelReading(2, Zone.INNER, 90, 0, 0.9)
FAR = ChannelReading(17, Zone.MID, 3046, -112, 30.0)
NOTHING = ChannelReading(None, Zone.OUTER, -1, -1, None)
RATES = {"GLOBAL_POSITION_INT": 49.6, "ATTITUDE": 50.2, "HOME_POSITION": 0.1}


def made(*channels: ChannelReading) -> FrameMade:
    reading = Reading(channels, False, False)
    return FrameMade(1.0, "v", "r", 0, 1.0, None, POSE, 0.015, reading, frame_of(reading, 0), True, 0.0)


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


@pytest.mark.parametrize(
    ("columns", "line"),
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


@pytest.mark.parametrize("columns", [20, 39, 79, 199])
@pytest.mark.parametrize("most", [1, 2, 20])
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
    monkeypatch.setattr("arva_hil.observers.console.printer._size", lambda _: (columns, 24))
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

# What eyes without one kind of cones make of linear RGB: Machado, Oliveira, Fernandes 2009, severity 1.
EYES = {
    "all cones": np.eye(3),
    "no red": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
    "no green": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]],
    "no blue": [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]],
}
LAB = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])


def linear(colour: int) -> np.ndarray:
    """Linear RGB of one of xterm's 6 × 6 × 6 colours."""
    levels, n = (0, 95, 135, 175, 215, 255), colour - 16
    srgb = np.array([levels[n // 36], levels[n // 6 % 6], levels[n % 6]]) / 255
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)


def lab(rgb: np.ndarray) -> np.ndarray:
    x = np.clip(LAB @ rgb / [0.9505, 1.0, 1.089], 0, None)
    f = np.where(x > 0.008856, np.cbrt(x), 7.787 * x + 16 / 116)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


@pytest.mark.parametrize("eyes", EYES)
def test_the_colours_differ_to_all_eyes(eyes: str) -> None:
    seen = [lab(np.array(EYES[eyes]) @ linear(colour)) for colour in (text.GOOD, text.DOUBTFUL, text.BAD)]
    assert min(float(np.linalg.norm(a - b)) for a, b in itertools.combinations(seen, 2)) > 60


@pytest.mark.parametrize("background", [0.0, 1.0], ids=["black", "white"])
def test_the_colours_stand_out_from_dark_and_light_terminals(background: float) -> None:
    for colour in (text.GOOD, text.DOUBTFUL, text.BAD, *text.SIGN_COLOURS):
        light, dark = sorted([float(LAB[1] @ linear(colour)), background], reverse=True)
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
