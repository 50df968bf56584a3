"""Common parts of commands: load the scenario, open links, record, handle signals, print the summary."""

from __future__ import annotations

import argparse
import dataclasses
import functools
import gc
import itertools
import math
import os
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing, contextmanager, suppress
from pathlib import Path

from arva_hil.cli.outcome import (
    FAILED,
    INTERRUPTED,
    NO_LINK,
    NO_READER,
    OK,
    Failure,
    SignalGuard,
    UsageError,
    traceback_lines,
    unexpected_error,
)
from arva_hil.cli.summary import as_dict, known_at_start, summary_lines
from arva_hil.cli.terminal import tell
from arva_hil.cli.watchers import close_all, live_observers, page_of_run
from arva_hil.clock import Clock
from arva_hil.config import DEFAULT, Fault, Scenario, load, misfit, newer_keys
from arva_hil.config.tables import own_options
from arva_hil.emulator.engine import Emulator
from arva_hil.emulator.setup import receivers_of
from arva_hil.events import Event, StatusReport
from arva_hil.events.words.text import Notice
from arva_hil.links import Link, LinkEnded, LinkError, open_link, parse
from arva_hil.links.stdout import ReaderGone, open_stdout
from arva_hil.observers.console import LinePrinter, Printer, as_json, plain
from arva_hil.records.writing import Recorder, RecordError, RecordLayout
from arva_hil.registry import OBSERVERS
from arva_hil.runtime.audience import Audience, MissingVehicles, Observer
from arva_hil.runtime.loop import Task, run
from arva_hil.safe_text import shown


def scenario(options: argparse.Namespace) -> Scenario:
    """Return the scenario file or the default, with the changes of environment and command line."""
    base = load(options.scenario) if options.scenario else DEFAULT
    if base.vehicles:
        for option in ("rate", "format", "seed"):
            if getattr(options, option) is not None:
                raise UsageError(f"--{option}: each receiver in {base.source} has its own value: change it there")
    receiver = base.receiver
    if options.rate is not None:
        if receiver.jitter_s >= 0.5 / options.rate:
            raise UsageError(
                f"--rate {options.rate:g}: the scenario's jitter_s of {receiver.jitter_s:g} is not less than "
                "half the period"
            )
        receiver = dataclasses.replace(receiver, rate_hz=options.rate)
    seed = base.seed if options.seed is None else options.seed
    chosen = dataclasses.replace(base, receiver=receiver, output_format=options.format or base.output_format, seed=seed)
    return dataclasses.replace(chosen, faults=_faults(options, chosen))


def _faults(options: argparse.Namespace, chosen: Scenario) -> tuple[Fault, ...]:
    """Return the scenario's faults and those added by environment and command line."""
    faults = chosen.faults
    for fault in options.fault or ():
        faults = (*faults, fault) if fault else ()
    formats = {receiver.output_format for vehicle in chosen.vehicles for receiver in vehicle.receivers}
    for fault, of in itertools.product(faults, sorted(formats) or [chosen.output_format]):
        if wrong := misfit(fault, [t.id for t in chosen.transmitters], of):
            raise UsageError(f"fault {fault}: {wrong[0]}, expected {wrong[1]}")
    return faults


def describe(chosen: Scenario, *, hidden: bool = False) -> list[str]:
    """Return the scenario in a few lines, for a person. `hidden`: without the transmitters."""
    lines = [f"scenario {chosen.source}: {chosen.receiver.rate_hz:g} Hz, {chosen.output_format}, seed {chosen.seed}"]
    if chosen.vehicles:
        lines = [f"scenario {chosen.source}: vehicles {len(chosen.vehicles)}, receivers {len(receivers_of(chosen))}"]
    lines += [
        f"  receiver {vehicle.name}/{r.name}: {r.receiver.rate_hz:g} Hz, {r.output_format}, seed {r.seed}"
        for vehicle in chosen.vehicles
        for r in vehicle.receivers
    ]
    for t in () if hidden else chosen.transmitters:
        below = None if t.depth_m is None else f"{t.depth_m:g} m below the ground"
        if t.ned is not None:
            north, east, down = t.ned
            of = "home" if chosen.datum == "home" else "the datum"
            of = f"of {of}, {below}" if below else f"{down:g} m down of {of}"
            lines.append(f"  transmitter {t.id}: {north:g} m north, {east:g} m east{' ' if below else ', '}{of}")
        elif t.lla is not None:
            height = below or f"{t.lla.alt:g} m AMSL"
            lines.append(f"  transmitter {t.id}: {t.lla.lat:.7f}, {t.lla.lon:.7f}, {height}")
        elif t.path is not None:
            lines.append(f"  transmitter {t.id}: on a path of {len(t.path.points_ned)} points, then {t.path.end}")
        elif t.follows is not None:
            lines.append(f"  transmitter {t.id}: follows system {t.follows.system}")
    if newer_keys(chosen):
        from arva_hil.emulator.build import outside_norm  # slow to import

        lines += [f"  warning: {what}" for what in outside_norm(chosen)]
    return lines + [f"  fault {fault}" for fault in chosen.faults]


def open_or_fail(address: str, clock: Clock, opener: Callable[..., Link] = open_link, **options: bool) -> Link:
    """Open a link. Prints a line if a `patient` link is not there yet. Raises AddressError and Failure."""
    try:
        link = opener(address, clock=clock, **options)
    except LinkError as error:
        raise Failure(NO_LINK, error) from None
    if link.away:
        tell(f"waiting for {link.why}")
    return link


def refuse_stdout(what: str, url: str) -> None:
    """Raise UsageError for stdout in place of a link that the command reads."""
    if url.strip() == "-":
        raise UsageError(f"{what} -: this is stdout, which cannot be read: name a link")


def open_reopened(address: str, clock: Clock, stack: ExitStack, *, answered: bool = False) -> Link:
    """Open a link that `stack` closes, and that is opened again whenever it is lost. Raises as `open_or_fail` does.

    A TCP server may come later; others must be there at the start.
    """
    from arva_hil.links.reconnecting import open_reconnecting  # with serial ports, which a replay does not need

    patient = parse(address).kind == "tcp"
    return stack.enter_context(
        closing(open_or_fail(address, clock, open_reconnecting, answered=answered, patient=patient))
    )


def attend(
    tasks: Sequence[Task], clock: Clock, *, until: float = math.inf, over: Callable[[], bool] = lambda: False
) -> bool:
    """Serve tasks until `over()` is true, or a signal comes; returns whether it was a signal. Raises Failure."""
    with SignalGuard() as guard:
        try:
            run(tasks, clock, until=until, stopped=lambda: guard.caught is not None or over())
        except LinkError as error:
            raise Failure(FAILED, error) from None
    return guard.caught is not None


class Run:
    """One run without its loop: signal handlers, printer, lines on stdout and recorder.

    A context manager. Signals go to the loop from its creation on, so that `drive` can close what was begun.
    `patient`: a replay, which waits for a slow disk or terminal, and prints a progress bar instead of a status.
    `lines`: print a line for each frame on stdout, if there is no --json. `live`: print a live status on a terminal.
    `record_links`: the engine's names of the autopilots' links, if there are several. `kind`: of the run, for the page.
    The loop ends when `stopped()` is true.
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
        record_links: Sequence[str] = (),
        kind: str = "run",
    ) -> None:
        self._guard = SignalGuard()
        self._plug_ins = [_observer(name) for name in options.observer or ()]
        self._missing = MissingVehicles(len(chosen.vehicles) or 1)
        self._verbose = options.verbose > 0
        self._end = ("interrupted", False)  # how the run has ended, and True if it failed
        self._record: _RunRecord | None = None
        self._now = 0.0  # when the newest event was
        several = len(receivers_of(chosen)) > 1
        of_frames = plain if lines else None
        render = functools.partial(as_json, named=several) if options.json else of_frames
        with ExitStack() as stack:
            stack.enter_context(self._guard)
            self.printer = Printer(sys.stderr, frames=self._verbose, status=not patient, live=live, named=several)
            stack.callback(lambda: close_all(self._plug_ins, self.printer.notice))
            self._plug_ins += live_observers(options, chosen, epoch_us)
            self._lines = LinePrinter(open_stdout(), render, patient=patient) if render else None
            self.page = page_of_run(kind, options, chosen, self.printer.say, named=several)
            if self.page:
                stack.callback(self._close_page)
            if options.record:  # last: a run that cannot begin leaves no record
                self._record = _RunRecord(Path(options.record), chosen, epoch_us, record_links, patient=patient)
            stack.pop_all()  # from here on `drive` and `__exit__` close them
        recorder = self._record.recorder if self._record else None
        every: tuple[Observer | None, ...] = (self._missing, self.printer, self._lines, recorder, self.page)
        self.observers: list[Observer] = [self, *filter(None, every), *self._plug_ins]
        self.printer.say(*describe(chosen, hidden=getattr(options, "hide_truth", False)))
        if recorder:
            recorder.broken_off = self._is_broken_off
        if patient and self._lines:
            self._lines.give_up = self._is_broken_off

    def __enter__(self) -> Run:
        return self

    def __exit__(self, *_: object) -> None:
        self._guard.__exit__()
        self._close_page()

    def _close_page(self) -> None:
        if self.page:
            how, failed = self._end
            self.page.close(how, failed=failed)

    @functools.cached_property
    def audience(self) -> Audience:
        """The observers. None can be added after the first use."""
        return Audience(self.observers)

    def observe(self, event: Event) -> None:
        self._now = event.time_s

    def stopped(self) -> bool:
        """Return True if the loop should end: after a signal, if a thread failed, or if stdout has no reader."""
        if self._record and (error := self._record.new_error()):
            self.printer.notice(Notice("error", f"{error}; frames go on"))
        return bool(self._is_broken_off() or (self._lines and self._lines.error) or self._missing.all)

    def _is_broken_off(self) -> bool:
        return self._guard.caught is not None or self._guard.error is not None

    def drive(
        self,
        emulator: Emulator,
        loop: Callable[[], None],
        counts: Callable[[], Mapping[str, int]] = dict,
        lines: Callable[[], list[str]] = list,
    ) -> int:
        """Run `loop` until it ends, fails or a signal comes. Writes record and summary; returns the exit code.

        `counts`, `lines`: the results of the links at the end, for run.json and for a person.
        """
        failure = None
        gc.freeze()  # the garbage collector would visit all objects of the start-up, which takes 20 ms
        try:
            loop()
            if self._guard.error:
                raise self._guard.error
            if self._missing.all:
                failure = Failure(NO_LINK, self._missing)
        except LinkEnded as error:
            self.printer.say(str(error))
        except LinkError as error:
            failure = Failure(NO_READER if isinstance(error, ReaderGone) else FAILED, error)
        except KeyboardInterrupt:  # a loop that was stuck
            pass
        except BaseException as error:  # also SystemExit, of a plug-in
            failure = Failure(FAILED, unexpected_error(error))
            if self._verbose:
                self.printer.say(*traceback_lines(error))
        self._guard.ending = True
        return self._finish(emulator, failure, counts(), lines())

    def _finish(self, emulator: Emulator, failure: Failure | None, counts: Mapping[str, int], lines: list[str]) -> int:
        caught = self._guard.caught
        self.printer.settle(StatusReport(self._now, [vehicle.status(self._now) for vehicle in emulator.vehicles]))
        if self._lines and (why := self._lines.close()) and not failure and not caught:
            failure = Failure(NO_READER if isinstance(self._lines.error, ReaderGone) else FAILED, why)
        code, how = (INTERRUPTED, caught.name) if caught else (OK, "finished")
        if failure:
            code, how = failure.code, str(failure)
        self._end = how, code not in (OK, INTERRUPTED)
        said = [Notice("error", how)] if failure and code != NO_READER else []
        if self._record:
            try:
                self._record.close({"ended": how, "exit_code": code}, emulator, counts)
            except RecordError as error:
                code = code or FAILED
                said.append(Notice("error", str(error)))
        self.printer.say(*summary_lines(emulator), *lines)
        for notice in said:
            self.printer.notice(notice)
        close_all(self._plug_ins, self.printer.notice)
        self.printer.close()
        return code


class _RunRecord:
    """The record of a run, with the entries of run.json that are known at the start."""

    def __init__(self, folder: Path, chosen: Scenario, epoch_us: int, links: Sequence[str], *, patient: bool) -> None:
        self._layout = RecordLayout(tuple(receivers_of(chosen)), tuple(links))
        self._known = known_at_start(chosen)
        self._error = ""
        self.recorder = Recorder(folder, epoch_us, self._known, patient=patient, layout=self._layout)

    def new_error(self) -> str:
        """Return the error that ended the record, once; "" if there is none."""
        before, self._error = self._error, self.recorder.error or ""
        return "" if before else self._error

    def close(self, end: Mapping[str, object], emulator: Emulator, counts: Mapping[str, int]) -> None:
        """Close the record, with run.json. Raises RecordError."""
        self.recorder.close({**end, **self._known, **as_dict(emulator, counts, self._layout)})


def _observer(given: tuple[str, Mapping[str, str]]) -> Observer:
    """Make an observer that the command line names with its options. Raises UsageError."""
    name, values = given
    cls = OBSERVERS[name]
    try:
        options = own_options(getattr(cls, "Options", None), values or None, f"the observer {name}")
    except ValueError as error:
        raise UsageError(f"--observer {name}: {' '.join(str(error).split())}") from None
    try:
        observer: Observer = cls() if options is None else cls(options)
    except (Exception, SystemExit) as error:
        raise UsageError(f"observer {name!r} cannot be created ({shown(error)})") from error
    return observer


@contextmanager
def run_first() -> Iterator[None]:
    """Let this thread run before other programs, if the system permits it, so that set-points come in time.

    Threads and processes that it starts do not inherit this. At the end the thread is scheduled as before.
    """
    with ExitStack() as stack:
        with suppress(AttributeError, OSError):  # not Linux, or not permitted
            policy, parameter = os.sched_getscheduler(0), os.sched_getparam(0)
            os.sched_setscheduler(0, os.SCHED_RR | os.SCHED_RESET_ON_FORK, os.sched_param(1))
            # only the superuser may remove the flag, which changes nothing for an ordinary thread
            stack.callback(os.sched_setscheduler, 0, policy | os.SCHED_RESET_ON_FORK, parameter)
        yield
