"""What commands do alike: load the scenario, open links, record, watch for signals, sum up."""

from __future__ import annotations

import argparse
import dataclasses
import gc
import platform
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import Any, Final

import fastcrc
import numpy
import pymavlink
import serial
import yaml

from arva_hil import __version__
from arva_hil.cli.outcome import FAILED, INTERRUPTED, NO_LINK, OK, Failure, UsageError
from arva_hil.clock import Clock
from arva_hil.console import Lines, Printer, as_json, plain
from arva_hil.emulator import Emulator, NoHeartbeatError
from arva_hil.links import AddressError, Link, LinkEnded, LinkError, open_link
from arva_hil.links.stdout import open_stdout
from arva_hil.notice import Notice
from arva_hil.observer import Observer
from arva_hil.record import Recorder, RecordError
from arva_hil.scenario import DEFAULT, Scenario, ScenarioError, load, to_dict

_SIGNALS: Final = [getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]


def scenario(options: argparse.Namespace) -> Scenario:
    """The scenario file or the default, with what environment and command line say instead."""
    try:
        base = load(options.scenario) if options.scenario else DEFAULT
    except ScenarioError as error:
        raise UsageError(error) from None
    receiver = base.receiver
    if options.rate is not None:
        receiver = dataclasses.replace(receiver, rate_hz=options.rate)
        if receiver.jitter_s >= 0.5 / receiver.rate_hz:
            raise UsageError(
                f"--rate {options.rate:g}: the scenario's jitter_s of {receiver.jitter_s:g} is not less than "
                "half the period"
            )
    return dataclasses.replace(
        base,
        receiver=receiver,
        output_format=options.format or base.output_format,
        seed=base.seed if options.seed is None else options.seed,
    )


def describe(chosen: Scenario) -> list[str]:
    """The scenario in a few lines, for a person."""
    lines = [f"scenario {chosen.source}: {chosen.receiver.rate_hz:g} Hz, {chosen.output_format}, seed {chosen.seed}"]
    for t in chosen.transmitters:
        if t.ned is not None:
            north, east, down = t.ned
            of = "home" if chosen.datum == "home" else "the datum"
            lines.append(f"  transmitter {t.id}: {north:g} m north, {east:g} m east, {down:g} m down of {of}")
        elif t.lla is not None:
            lines.append(f"  transmitter {t.id}: {t.lla.lat:.7f}, {t.lla.lon:.7f}, {t.lla.alt:g} m AMSL")
    return lines


def open_or_fail(address: str, clock: Clock) -> Link:
    """A link, or the end of the command."""
    try:
        return open_link(address, clock=clock)
    except AddressError as error:
        raise UsageError(error) from None
    except LinkError as error:
        raise Failure(NO_LINK, error) from None


class Signals:
    """SIGINT, SIGTERM and SIGHUP: the first one is noted in `caught`, a second one ends the program."""

    def __init__(self) -> None:
        self.caught: signal.Signals | None = None
        self._before: dict[int, Any] = {}

    def __enter__(self) -> Signals:
        self._before = {number: signal.signal(number, self._note) for number in _SIGNALS}
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _note(self, number: int, frame: FrameType | None) -> None:
        self.caught = signal.Signals(number)
        signal.signal(number, signal.default_int_handler)


class Run:
    """One run's surroundings: printer, lines on stdout, recorder and signals, around the loop and gone after it.

    `patient`: a replay, which may wait for a slow disk or terminal, and shows a progress bar for a status.
    `lines`: print a line a frame on stdout, unless JSON is wanted there. `live`: a live status line, on a terminal.
    `stopped()` is what a loop asks.
    """

    def __init__(
        self,
        options: argparse.Namespace,
        chosen: Scenario,
        epoch_us: int,
        *,
        patient: bool = False,
        lines: bool = False,
        live: bool = True,
    ) -> None:
        self._scenario = chosen
        self._signals = Signals()
        self._recorder: Recorder | None = None
        self._record_failed = False
        if options.record:
            try:
                self._recorder = Recorder(Path(options.record), epoch_us, patient=patient)
            except RecordError as error:
                raise UsageError(error) from None
        self.printer = Printer(sys.stderr, frames=options.verbose > 0, status=not patient, live=live)
        render = as_json if options.json else plain if lines else None
        self._lines = Lines(open_stdout(), render, patient=patient) if render else None
        every = (self.printer, self._lines, self._recorder)
        self.observers: list[Observer] = [observer for observer in every if observer is not None]
        for line in describe(chosen):
            self.printer.say(line)

    def stopped(self) -> bool:
        """True once there is no more use in going on: a signal, or nobody reads stdout any more."""
        if self._recorder and self._recorder.error and not self._record_failed:
            self._record_failed = True
            self.printer.notice(Notice("error", f"{self._recorder.error}; frames go on"))
        return self._signals.caught is not None or bool(self._lines and self._lines.error)

    def drive(self, emulator: Emulator, loop: Callable[[], None]) -> int:
        """Run `loop` until it ends, fails or a signal comes; write the record, print the sum; the exit code."""
        failure = None
        gc.freeze()  # or the collector walks all that start-up made, 20 ms long, in the middle of a deadline
        try:
            with self._signals:
                loop()
        except LinkEnded as error:
            self.printer.say(str(error))
        except NoHeartbeatError as error:
            failure = Failure(NO_LINK, error)
        except LinkError as error:
            failure = Failure(FAILED, error)
        return self._finish(emulator, failure)

    def _finish(self, emulator: Emulator, failure: Failure | None) -> int:
        if self._lines and (why := self._lines.close()) and not failure and not self._signals.caught:
            failure = Failure(FAILED, why)
        code = failure.code if failure else INTERRUPTED if self._signals.caught else OK
        how = str(failure) if failure else self._signals.caught.name if self._signals.caught else "finished"
        said = [Notice("error", how)] if failure else []
        if self._recorder:
            try:
                self._recorder.close(self._as_dict(emulator, how, code))
            except RecordError as error:
                code = code or FAILED
                said.append(Notice("error", str(error)))
        for line in sums(emulator):
            self.printer.say(line)
        for notice in said:
            self.printer.notice(notice)
        self.printer.close()
        return code

    def _as_dict(self, emulator: Emulator, how: str, code: int) -> dict[str, Any]:
        session = emulator.session
        return {
            "ended": how,
            "exit_code": code,
            "command": sys.argv,
            "scenario": to_dict(self._scenario),
            "scenario_source": self._scenario.source,
            "seed": self._scenario.seed,
            "vehicle": dataclasses.asdict(session.vehicle) if session.vehicle else None,
            "datum": emulator.datum.lla,
            "counters": counters(emulator),
            "versions": {
                "arva-hil": __version__,
                "python": platform.python_version(),
                **{library.__name__: library.__version__ for library in (fastcrc, numpy, pymavlink, serial, yaml)},
                "platform": platform.platform(),
            },
        }


def counters(emulator: Emulator) -> dict[str, Any]:
    """Every counter of a run."""
    session = emulator.session
    return {
        **dataclasses.asdict(emulator.counters),
        "bytes_received": session.bytes,
        "packets_received": session.parser.packets,
        "bad_checksums": session.parser.bad_crc,
        "bytes_skipped": session.parser.skipped,
        "packets_ignored": session.ignored,
        "values_refused": session.refused,
        "positions_before_fix": session.unpositioned,
        "reboots": session.reboots,
    }


def sums(emulator: Emulator) -> list[str]:
    """The summary at the end."""
    c, session = emulator.counters, emulator.session
    lines = [
        f"{c.frames} frames: {c.frames - c.dropped} sent, {c.dropped} dropped, {c.no_pose} without a pose; "
        f"worst lateness {c.latest_s * 1e3:.1f} ms",
        f"autopilot: {session.bytes} bytes, {session.parser.packets} packets, {session.parser.bad_crc} bad checksums, "
        f"{session.parser.skipped} bytes skipped, {session.ignored} packets of others ignored",
    ]
    if c.skipped:
        lines.append(f"{c.skipped} frames were skipped: the program was held up for more than a second")
    return lines
