"""`arva-hil decode`: decodes the bytes of a record of a real receiver once more, into another folder."""

from __future__ import annotations

import argparse
import math
from itertools import chain
from pathlib import Path

from arva_hil.cli.arguments.shared import add_format, add_max_age, add_surveyed, add_target
from arva_hil.cli.options import CommandParser
from arva_hil.cli.outcome import OK, UsageError


def options(parser: CommandParser) -> None:
    """Decode the bytes of a record of `arva-hil record` once more, into another folder.

    For another format, another vehicle in the same packets, or places that were surveyed later.
    """
    parser.add_argument("run", metavar="RECORD", help="folder of a record of `arva-hil record`")
    parser.option("--out DIR", "folder to make", environment=False)
    add_format(parser, default="binary")
    add_surveyed(parser)
    add_target(parser)
    add_max_age(parser)


def main(options: argparse.Namespace) -> int:
    from arva_hil.autopilot.following.session import Session  # slow, as those below
    from arva_hil.cli.record import Ending, about, receiver_log, recorded_in, surveyed
    from arva_hil.cli.recorded import loaded
    from arva_hil.records.received import KeptBytes, play
    from arva_hil.runtime.audience import Audience

    if not options.out:
        raise UsageError("--out is missing: name the folder to make")
    loaded(options.run)
    kept = KeptBytes.of(Path(options.run))
    if (first := next(kept, None)) is None:
        raise UsageError(f"{options.run}: there are no bytes in it")
    scenario = surveyed(options)
    session = Session(target_system=options.target_system, target_component=options.target_component, passive=True)
    log = receiver_log(options, scenario, session, start=0.0, timeout=math.inf)
    known = about(options, scenario) | {"decoded_from": options.run}
    recorder = recorded_in(options.out, first.time_us, known, patient=True)
    play(chain([first], kept), log, Audience([recorder]), first.time_us)
    return Ending(log, recorder, known, options.format).finish(OK, {})
