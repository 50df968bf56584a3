"""What a person sees while it runs: a live line on a terminal, plain lines elsewhere, JSON for programs."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from typing import Final, TextIO

from arva_hil.events import Event, FrameMade, StatusReport, VehicleStatus
from arva_hil.links import Link, LinkError
from arva_hil.observers.console import text
from arva_hil.observers.console.event_json import event_json
from arva_hil.observers.console.notice import Notice
from arva_hil.observers.console.sentences import sentence
from arva_hil.runtime.worker_thread import Background
from arva_hil.safe_text import one_line

_PLAIN_S: Final = 5.0  # between the status lines of a pipe
_CLEAR: Final = "\r\x1b[K"
_SHORT: Final = {"GLOBAL_POSITION_INT": "pos", "ATTITUDE": "att"}


class Printer:
    """Prints what events say and the status on `stream`, from a thread of its own: a stopped terminal stops nothing.

    On a terminal the status is one line that is written over; elsewhere it is a line now and then. `frames`:
    print a line for every frame too. `status`: whether there is one. `named`: say of which vehicle and receiver.
    """

    def __init__(
        self, stream: TextIO, *, frames: bool = False, status: bool = True, live: bool = True, named: bool = False
    ) -> None:
        self._stream = stream
        self._live = live and stream.isatty()
        self._colour = text.wants_colour(stream)
        self._frames = frames
        self._status = status
        self._named = named
        self._shown = ""
        self._next_plain = _PLAIN_S
        self._background = Background("console")

    def observe(self, event: Event) -> None:
        if isinstance(event, FrameMade):
            if self._frames:
                self.say(f"{_name(event) if self._named else ''}{event.frame.sequence:3d} {_words(event)}")
        elif isinstance(event, StatusReport):
            if self._status:
                self.show(event.time_s, status_line(event, named=self._named))
        elif (notice := sentence(event, named=self._named)) is not None:
            self.notice(notice)

    def notice(self, notice: Notice) -> None:
        self._put(text.notice(notice, self._colour))

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


class Lines:
    """Prints a line for each event on `link` of which `render` makes one.

    `patient`: rather wait than leave one out, until `give_up` says so.
    """

    def __init__(self, link: Link, render: Callable[[Event], str | None], *, patient: bool) -> None:
        self._link = link
        self._render = render
        self.give_up: Callable[[], bool] = lambda: not patient
        self._background = Background("lines", (OSError, LinkError))

    def observe(self, event: Event) -> None:
        if (text := self._render(event)) is not None:
            line = (text + "\n").encode()
            self._background.put(lambda: self._link.write(line), self.give_up)

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


def plain(made: Event) -> str | None:
    """One frame in words; None for what is no frame."""
    if not isinstance(made, FrameMade):
        return None
    return one_line(f"{made.instant_s:9.3f} s  {made.frame.sequence:3d}  {_words(made)}")


def as_json(made: Event, *, named: bool = False) -> str | None:
    """A frame or another event as a JSON object; `named`: frames with their receiver. None for what is neither."""
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


def status_line(report: StatusReport, *, named: bool = False) -> str:
    """Of each vehicle: what it is, stream rates, pose age, the channels, frames sent and dropped: one line."""
    return " || ".join(_status(vehicle, named) for vehicle in report.vehicles)


def _status(vehicle: VehicleStatus, named: bool) -> str:
    parts = [(f"{vehicle.name}: " if named else "") + (one_line(vehicle.label) or "no vehicle yet")]
    parts += [" ".join(f"{_SHORT[name]} {rate:.0f} Hz" for name, rate in vehicle.rates.items() if name in _SHORT)]
    for receiver in vehicle.receivers:
        made = receiver.last
        if named:
            parts.append(f"{receiver.name}:")
        if made:
            age = made.age_s
            parts.append("no pose" if made.pose is None or age is None else f"pose {age * 1e3:.0f} ms")
        parts.append(f"{receiver.frames - receiver.dropped} sent, {receiver.dropped} dropped")
        if made:  # the longest comes last, to be cut on a narrow terminal
            parts.append(text.reading(made.frame.channels))
    return " | ".join(part for part in parts if part)


def _name(made: FrameMade) -> str:
    return f"{made.vehicle}/{made.receiver} "


def _words(made: FrameMade) -> str:
    """What a frame says, and the faults that it met."""
    met = f"  [{', '.join(made.faults)}]" if made.faults else ""
    return text.reading(made.frame.channels) + met


def _columns(terminal: TextIO) -> int:
    try:
        return os.get_terminal_size(terminal.fileno()).columns or 80
    except OSError:  # it has hung up
        return 80
