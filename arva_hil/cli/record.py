"""`arva-hil record`: records a real receiver beside a real autopilot."""

from __future__ import annotations

import argparse
import sys
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

from arva_hil.autopilot.following.session import Session
from arva_hil.cli import common
from arva_hil.cli.listen import guess_format
from arva_hil.cli.outcome import FAILED, INTERRUPTED, NO_LINK, OK, Failure, UsageError
from arva_hil.cli.recorded import loaded, write
from arva_hil.cli.run_links import choose_autopilot, session, signing
from arva_hil.cli.summary import known_at_start, vehicle_entries
from arva_hil.cli.terminal import tell
from arva_hil.clock import Clock, RealClock
from arva_hil.config import Scenario
from arva_hil.events.words.reasons import no_vehicle
from arva_hil.links import Link, parse
from arva_hil.links.url import Address, place
from arva_hil.observers.console import Printer
from arva_hil.records.fitting import FitError
from arva_hil.records.fitting.noise_levels import LISTENS_TO_MOTORS, noise_levels, noise_profile
from arva_hil.records.received import AUTOPILOT, RECEIVER, ReceivedFrames, ReceiverLog, surveyed_scenario
from arva_hil.records.writing import Recorder, RecordError, RecordLayout
from arva_hil.registry import FORMATS
from arva_hil.runtime.audience import Audience
from arva_hil.runtime.drivers import Live

_SILENT_S: Final = 2.0  # warn after this time without a first frame
_LOOK_S: Final = 0.5


def main(options: argparse.Namespace) -> int:
    if not options.receiver:
        raise UsageError("--receiver is missing: name the receiver's port, e.g. --receiver /dev/ttyUSB0")
    autopilot = options.autopilot or choose_autopilot(options.receiver)
    common.refuse_stdout("--autopilot", autopilot)
    common.refuse_stdout("--receiver", options.receiver)
    if parse(options.receiver) != Address("pty") and place(autopilot) == place(options.receiver):
        raise UsageError(f"the autopilot and --receiver are both {options.receiver}: each side needs its own")
    scenario = surveyed(options)
    clock = RealClock()
    with ExitStack() as stack:
        log = receiver_log(
            options,
            scenario,
            session(options, signing=signing(options.signing_key, clock.epoch_us, stack)),
            start=clock.now(),
            timeout=options.timeout,
        )
        links = {}
        for name, address in ((AUTOPILOT, autopilot), (RECEIVER, options.receiver)):
            links[name] = common.open_reopened(address, clock, stack, answered=name == AUTOPILOT)
            tell(f"{name}: {links[name].name}")
        known = about(options, scenario)
        recorder = recorded_in(options.folder, clock.epoch_us, known)
        printer = Printer(sys.stderr)
        stack.callback(printer.close)
        live = Live(log, links, {}, Audience([printer, recorder]))
        watch = _Watch(log, options.format, printer, clock.now())
        end = Ending(log, recorder, known, options.format)
        try:
            interrupted = common.attend(
                [live, watch],
                clock,
                until=clock.now() + options.duration,
                over=lambda: log.missing or bool(recorder.error),
            )
            log.advance(clock.now(), final=True)
            live.finish(clock)
        except Failure as error:
            end.close(error.code, str(error), live.counts())
            raise
        printer.settle()
        code = end.finish(INTERRUPTED if interrupted else OK, live.counts())
    if options.noise:
        write_noise(Path(options.folder))
    return code


def write_noise(folder: Path) -> None:
    """Write the profile of the motors' noise into a record. Raises Failure."""
    record = loaded(str(folder))
    try:
        levels = noise_levels(record)
    except FitError as error:
        raise Failure(FAILED, error) from None
    write(folder / "noise.yaml", noise_profile(record, levels).encode())
    for load, sigma in levels:
        tell(f"load {100 * load:.0f} %: {sigma:.2g} nA/m")


def surveyed(options: argparse.Namespace) -> Scenario:
    """Return the scenario of the surveyed transmitters. Raises UsageError."""
    try:
        scenario = surveyed_scenario(options.transmitter or ())
    except ValueError as error:
        raise UsageError(f"--transmitter: {error}") from None
    return replace(scenario, receiver=LISTENS_TO_MOTORS) if getattr(options, "noise", False) else scenario


def receiver_log(
    options: argparse.Namespace, scenario: Scenario, session: Session, *, start: float, timeout: float
) -> ReceiverLog:
    """Return the log with the options' format."""
    form = FORMATS[options.format]
    return ReceiverLog(
        scenario,
        session,
        ReceivedFrames(form.decoder(), numbered=form.numbered),
        start=start,
        timeout_s=timeout,
        max_age_s=options.max_age,
    )


def about(options: argparse.Namespace, scenario: Scenario) -> dict[str, Any]:
    """Return the entries of run.json that are known at the start."""
    known = {"source": "receiver", "format": options.format, **known_at_start(scenario)}
    known["receiver"] = getattr(options, "receiver", None)
    known |= {"scenario_source": None, "seed": None}
    return known if scenario.transmitters else known | {"scenario": None}


def recorded_in(folder: str, epoch_us: int, known: dict[str, Any], *, patient: bool = False) -> Recorder:
    """Return the recorder. Raises RecordError for a folder that has a record already."""
    return Recorder(Path(folder), epoch_us, known, layout=RecordLayout(real=True), patient=patient)


@dataclass(frozen=True)
class Ending:
    """The end of a record: its gaps, and run.json."""

    log: ReceiverLog
    recorder: Recorder
    known: dict[str, Any]
    format: str

    def finish(self, code: int, counts: dict[str, int]) -> int:
        """Close the record and print its content. Returns the exit code; raises Failure if something is missing."""
        log, made, d = self.log, self.log.made, self.log.received.decoder
        lacks = self._lacks()
        if lacks and code == OK:
            code = NO_LINK if log.missing else FAILED
        self.close(code, "; ".join(lacks) or "finished", counts)
        tell(
            f"{made.frames} frames, {made.no_pose} without a pose, {d.lost} lost, {d.bad_crc} bad checksums, "
            f"{d.dropped} bytes dropped, {log.received.restarts} restarts"
        )
        if lacks:
            raise Failure(code, *lacks)
        return code

    def close(self, code: int, how: str, counts: dict[str, int]) -> None:
        """Close the record. Raises Failure if it is not whole."""
        log = self.log
        try:
            self.recorder.close(
                {
                    "ended": how,
                    "exit_code": code,
                    **self.known,
                    **vehicle_entries(log.session, log.world.datum),
                    "counters": {**log.counts(), **counts},
                }
            )
        except RecordError as error:
            raise Failure(FAILED, error) from None

    def _lacks(self) -> list[str]:
        log = self.log
        lacks = []
        if log.session.vehicle is None:
            lacks.append(f"no poses: {no_vehicle(log.session.why_no_vehicle())}")
        elif log.made.frames and log.made.no_pose == log.made.frames:
            lacks.append("frames without poses: the autopilot has sent no position and attitude with home")
        if not log.made.frames:
            lacks.append(f"poses without frames: {doubt(log, self.format)}" if not lacks else doubt(log, self.format))
        return lacks


def doubt(log: ReceiverLog, format: str) -> str:
    """Return the likely reason for missing frames."""
    if not log.received.first_bytes:
        return "the receiver has sent nothing: is it the right port, and is the receiver on?"
    return (
        f"no {format} frame in {len(log.received.first_bytes)} bytes, which are kept for `arva-hil decode`: "
        f"{guess_format(log.received.first_bytes, format)}"
    )


class _Watch:
    """Warns once if no frame comes. A task for the loop."""

    links: tuple[Link, ...] = ()

    def __init__(self, log: ReceiverLog, format: str, printer: Printer, start: float) -> None:
        self._log = log
        self._format = format
        self._printer = printer
        self._until = start + _SILENT_S

    def service(self, clock: Clock) -> float:
        now = clock.now()
        if now >= self._until:
            self._until = float("inf")
            if not self._log.received.decoder.good:
                self._printer.say(f"warning: no frame for {_SILENT_S:g} s: {doubt(self._log, self._format)}")
        return now + _LOOK_S
