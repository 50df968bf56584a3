"""What a person sees while it runs: a live line on a terminal, plain lines elsewhere, JSON for programs."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from typing import Final, TextIO

from arva_hil.background import Background
from arva_hil.console import text
from arva_hil.links import Link, LinkError
from arva_hil.notice import Notice
from arva_hil.observer import Observer, Snapshot, Status
from arva_hil.safe_text import one_line

_PLAIN_S: Final = 5.0  # between the status lines of a pipe
_CLEAR: Final = "\r\x1b[K"
_SHORT: Final = {"GLOBAL_POSITION_INT": "pos", "ATTITUDE": "att"}


class Printer(Observer):
    """Prints notices and the status on `stream`, from a thread of its own: a stopped terminal stops nothing.

    On a terminal the status is one line that is written over; elsewhere it is a line now and then. `frames`:
    print a line for every frame too. `status`: whether there is one.
    """

    def __init__(self, stream: TextIO, *, frames: bool = False, status: bool = True, live: bool = True) -> None:
        self._stream = stream
        self._live = live and stream.isatty()
        self._colour = text.wants_colour(stream)
        self._frames = frames
        self._status = status
        self._shown = ""
        self._next_plain = _PLAIN_S
        self._background = Background("console")

    def notice(self, notice: Notice) -> None:
        self._put(text.notice(notice, self._colour))

    def frame(self, snapshot: Snapshot) -> None:
        if self._frames:
            self.say(f"{snapshot.frame.sequence:3d} {_words(snapshot)}")

    def status(self, status: Status) -> None:
        if self._status:
            self.show(status.time_s, status_line(status))

    def show(self, time_s: float, line: str) -> None:
        """The status as it is at `time_s`."""
        line = one_line(line)
        if self._live:
            self._shown = line[: _columns(self._stream) - 1]
            self._write(_CLEAR + self._shown)
        elif time_s >= self._next_plain:
            self._next_plain = time_s + _PLAIN_S
            self._write(line + "\n")

    def say(self, line: str) -> None:
        """One line that stays."""
        self._put(one_line(line))

    def _put(self, line: str) -> None:
        self._write(f"{_CLEAR}{line}\n{self._shown}" if self._live else line + "\n")

    def close(self) -> None:
        if self._shown:
            self._write("\n")
        self._background.close()

    def _write(self, what: str) -> None:
        def write() -> None:
            self._stream.write(what)
            self._stream.flush()

        self._background.put(write)


class Lines(Observer):
    """Prints one line a frame on `link`: `render` makes it. `patient`: rather wait than leave one out."""

    def __init__(self, link: Link, render: Callable[[Snapshot], str], *, patient: bool) -> None:
        self._link = link
        self._render = render
        self._patient = patient
        self._background = Background("lines", (OSError, LinkError))

    def frame(self, snapshot: Snapshot) -> None:
        line = (self._render(snapshot) + "\n").encode()
        self._background.put(lambda: self._link.write(line), wait=self._patient)

    @property
    def error(self) -> Exception | None:
        """Why nothing more is printed: the reader has gone."""
        return self._background.error

    def close(self) -> str:
        """Print what is left; gives back why not every line was printed, "" when all were."""
        finished = self._background.close()
        if self.error:
            return str(self.error)
        whole = finished and not self._background.refused
        return "" if whole else f"{self._link.name}: its reader did not take every line"


def plain(snapshot: Snapshot) -> str:
    """One frame in words."""
    return one_line(f"{snapshot.time_s:9.3f} s  {snapshot.frame.sequence:3d}  {_words(snapshot)}")


def as_json(snapshot: Snapshot) -> str:
    """One frame as a JSON object."""
    return json.dumps(
        {
            "time_s": snapshot.time_s,
            "boot_ms": None if snapshot.boot_s is None else snapshot.boot_s * 1e3,
            "ned_m": None if snapshot.pose is None else snapshot.pose.position.tolist(),
            "pose_age_ms": None if snapshot.age_s is None else snapshot.age_s * 1e3,
            "sent": snapshot.sent,
            "faults": list(snapshot.faults),
            **text.frame_json(snapshot.frame),
        }
    )


def status_line(status: Status) -> str:
    """Vehicle, stream rates, pose age, the channels, frames sent and dropped: one line."""
    parts = [status.vehicle or "no vehicle yet"]
    parts += [" ".join(f"{_SHORT[name]} {rate:.0f} Hz" for name, rate in status.rates.items() if name in _SHORT)]
    if status.last:
        age = status.last.age_s
        parts.append("no pose" if status.last.pose is None or age is None else f"pose {age * 1e3:.0f} ms")
    parts.append(f"{status.frames - status.dropped} sent, {status.dropped} dropped")
    if status.last:  # the longest comes last, to be cut on a narrow terminal
        parts.append(text.reading(status.last.frame.channels))
    return one_line(" | ".join(part for part in parts if part))


def _words(snapshot: Snapshot) -> str:
    """What a frame says, and the faults that it met."""
    met = f"  [{', '.join(snapshot.faults)}]" if snapshot.faults else ""
    return text.reading(snapshot.frame.channels) + met


def _columns(terminal: TextIO) -> int:
    try:
        return os.get_terminal_size(terminal.fileno()).columns or 80
    except OSError:  # it has hung up
        return 80
