"""Output of a run: a live status on a terminal, plain lines elsewhere, JSON for programs."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Final, TextIO

from arva_hil.events import Event, FrameMade, HeartbeatMissing, StatusReport
from arva_hil.events.event_json import event_json
from arva_hil.events.reasons import NoVehicle
from arva_hil.events.words import text
from arva_hil.events.words.sentences import sentence
from arva_hil.events.words.text import BETWEEN, Notice, fit, status_line, status_lines, status_table
from arva_hil.links import Link, LinkError
from arva_hil.runtime.worker_thread import WorkerThread
from arva_hil.safe_text import columns_of, is_screen, one_line, wrapped

_PLAIN_S: Final = 5.0  # between status lines if the stream is no terminal
_CLEAR: Final = "\r\x1b[K"
_UP: Final = "\x1b[A"


class Printer:
    """Prints events and the status on `stream`, in its own thread: a stopped terminal does not stop the run.

    On a terminal the status is a small table that is overwritten; elsewhere it is a line every few seconds. `frames`:
    print a line for every frame too. `status`: print a status. `named`: print the names of vehicle and receiver.
    """

    def __init__(
        self, stream: TextIO, *, frames: bool = False, status: bool = True, live: bool = True, named: bool = False
    ) -> None:
        self._stream = stream
        self._live = live and is_screen(stream)
        self._colour = text.wants_colour(stream)
        self._signs = (stream.encoding or "").lower().startswith("utf")
        self._frames = frames
        self._status = status
        self._named = named
        self._shown: list[str] = []  # the status, as it is on the terminal now
        self._next_plain = _PLAIN_S
        self._missing: dict[
            NoVehicle, list[HeartbeatMissing]
        ] = {}  # not printed yet: many may be missing at the same time
        self._background = WorkerThread("console")

    def observe(self, event: Event) -> None:
        if isinstance(event, FrameMade):
            if self._frames:
                name = f"{event.vehicle}/{event.receiver} " if self._named else ""
                self.say(f"{name}{event.frame.sequence:3d} {_words(event)}")
        elif isinstance(event, HeartbeatMissing):
            self._missing.setdefault(event.heard, []).append(event)
        elif isinstance(event, StatusReport):
            self._say_missing()
            if self._status:
                self._show(event)
        elif (notice := sentence(event, named=self._named)) is not None:
            self._say_missing()
            self.notice(notice)

    def notice(self, notice: Notice) -> None:
        self._put(text.notice(notice, self._colour, columns_of(self._stream)))

    def say(self, *lines: str) -> None:
        """Print lines that stay; a terminal that is too narrow gets them in rows."""
        for line in lines:
            self._put(wrapped(one_line(line), columns_of(self._stream)))

    def settle(self, report: StatusReport | None = None) -> None:
        """Print the status for the last time, as it is or as in `report`. Later lines come below it."""
        self._say_missing()
        if report is not None and self._shown:
            self._show(report)
        if self._shown:
            self._write("\n")
        self._status, self._shown = False, []

    def close(self) -> None:
        self.settle()
        self._background.close()

    def show(self, time_s: float, parts: Sequence[str]) -> None:
        """Print a status in one line, the most important part first. `time_s`: when it was measured."""
        parts = [one_line(part) for part in parts]
        self._display(time_s, lambda columns, _: [fit(parts, columns)], lambda: BETWEEN.join(parts))

    def _say_missing(self) -> None:
        """Print the vehicles that have not appeared; one sentence for those with the same traffic."""
        for missing in self._missing.values():
            event = replace(missing[0], vehicle=", ".join(one.vehicle for one in missing))
            if (notice := sentence(event, named=self._named)) is not None:
                self.notice(notice)
        self._missing = {}

    def _show(self, report: StatusReport) -> None:
        table = partial(status_table, report, named=self._named)
        line = (lambda: "\n".join(status_lines(report))) if self._named else partial(status_line, report)
        self._display(report.time_s, table, line)

    def _display(self, time_s: float, table: Callable[[int, int], list[str]], line: Callable[[], str]) -> None:
        """Print a table on a terminal, or lines if they are due. `table`: makes it for (columns, lines)."""
        if self._live:
            columns, lines = _size(self._stream)
            over, self._shown = self._over(), table(columns - 1, max(1, lines - 2))
            self._write(over + self._drawn())
        elif time_s >= self._next_plain:
            self._next_plain = time_s + _PLAIN_S
            self._write(line() + "\n")

    def _put(self, line: str) -> None:
        self._write(f"{self._over()}{line}\n{self._drawn()}" if self._live else line + "\n")

    def _over(self) -> str:
        """Escape codes that erase the status, with lines that the terminal has wrapped after it became narrower."""
        columns, _ = _size(self._stream)
        rows = sum(max(1, -(-len(line) // columns)) for line in self._shown)
        return _CLEAR + (_UP + _CLEAR) * max(0, rows - 1)

    def _drawn(self) -> str:
        bold, plain = ("\x1b[1m", "\x1b[0m") if self._colour else ("", "")
        shown = [text.with_signs(line, self._colour) for line in self._shown] if self._signs else self._shown
        lines = (line.partition(BETWEEN) for line in shown)
        return "\n".join(f"{bold}{reading}{plain}{between}{rest}" for reading, between, rest in lines)

    def _write(self, what: str) -> None:
        def write() -> None:
            self._stream.write(what)
            self._stream.flush()

        self._background.put(write)


class LinePrinter:
    """Prints a line on `link` for each event for which `render` returns one.

    `patient`: wait for a slow reader, until `give_up()` is true; otherwise leave lines out.
    """

    def __init__(self, link: Link, render: Callable[[Event], str | None], *, patient: bool) -> None:
        self._link = link
        self._render = render
        self.give_up: Callable[[], bool] = lambda: not patient
        self._background = WorkerThread("lines", (OSError, LinkError))

    def observe(self, event: Event) -> None:
        if (text := self._render(event)) is not None:
            self._background.put(partial(self._link.write, f"{text}\n".encode()), self.give_up)

    @property
    def error(self) -> Exception | None:
        """The reason why nothing more is printed, e.g. the reader has ended; None without one."""
        return self._background.error

    def close(self) -> str:
        """Print the remaining lines. Returns why some were not printed, "" if all were."""
        finished = self._background.close()
        if self.error:
            return str(self.error)
        whole = finished and not self._background.refused
        return "" if whole else f"{self._link.name}: its reader did not take every line"


def plain(made: Event) -> str | None:
    """Return the line of a frame; None for other events."""
    if not isinstance(made, FrameMade):
        return None
    return one_line(f"{made.instant_s:9.3f} s  {made.frame.sequence:3d}  {_words(made)}")


def as_json(made: Event, *, named: bool = False) -> str | None:
    """Return an event as a JSON object; None for events that are not output.

    `named`: frames have vehicle and receiver.
    """
    if not isinstance(made, FrameMade):
        return event_json(made)
    return json.dumps(
        {
            **({"vehicle": made.vehicle, "receiver": made.receiver} if named else {}),
            "time_s": made.instant_s,
            "boot_ms": None if made.boot_s is None else made.boot_s * 1e3,
            "ned_m": None if made.pose is None else made.pose.position.tolist(),
            "pose_age_ms": None if made.age_s is None else made.age_s * 1e3,
            "sent": made.sent,
            "faults": list(made.faults),
            **text.frame_json(made.frame),
        }
    )


def _words(made: FrameMade) -> str:
    """Return the readings of a frame, and the faults that changed it."""
    met = f"  [{', '.join(made.faults)}]" if made.faults else ""
    return text.reading(made.frame.channels) + met


def _size(terminal: TextIO) -> tuple[int, int]:
    try:
        columns, lines = os.get_terminal_size(terminal.fileno())
    except OSError:  # it has hung up
        columns, lines = 0, 0
    return columns or 80, lines or 24
