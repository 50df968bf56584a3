"""`arva-hil decode`: decodes the bytes of a record of a real receiver once more, into another folder."""

from __future__ import annotations

import argparse
import math
from itertools import chain
from pathlib import Path

from arva_hil.autopilot.following.session import Session
from arva_hil.cli.outcome import OK, UsageError
from arva_hil.cli.record import Ending, about, receiver_log, recorded_in, surveyed
from arva_hil.cli.recorded import loaded
from arva_hil.records.received import KeptBytes, play
from arva_hil.runtime.audience import Audience


def main(options: argparse.Namespace) -> int:
    if not options.out:
        raise UsageError("--out is missing: name the folder to make")
    loaded(options.run)
    kept = KeptBytes.of(Path(options.run))
    if (first := next(kept, None)) is None:
        raise UsageError(f"{options.run}: there are no bytes in it")
    scenario = surveyed(options)
    log = receiver_log(
        options,
        scenario,
        Session(target_system=options.target_system, target_component=options.target_component, passive=True),
        start=0.0,
        timeout=math.inf,
    )
    known = about(options, scenario) | {"decoded_from": options.run}
    recorder = recorded_in(options.out, first.time_us, known, patient=True)
    play(chain([first], kept), log, Audience([recorder]), first.time_us)
    return Ending(log, recorder, known, options.format).finish(OK, {})
