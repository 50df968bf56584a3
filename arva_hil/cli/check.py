"""Validate scenario files: every mistake at its line and column; of what is right, the transmitters and faults."""

from __future__ import annotations

import argparse

from arva_hil.cli.options import Parser
from arva_hil.cli.outcome import OK, USAGE
from arva_hil.cli.terminal import show, tell


def add_options(parser: Parser) -> None:
    parser.add_argument("files", nargs="+", metavar="FILE", help="scenario (YAML)")


def main(options: argparse.Namespace) -> int:
    from arva_hil.scenario import ScenarioError, load

    code = OK
    for name in options.files:
        try:
            chosen = load(name)
        except ScenarioError as error:
            for problem in error.problems:
                tell(problem)
            code = USAGE
        else:
            ids = ", ".join(str(t.id) for t in chosen.transmitters)
            show(f"{name}: ok: transmitters {ids}; {chosen.receiver.rate_hz:g} Hz, {chosen.output_format}")
            for fault in chosen.faults:
                show(f"  fault {fault}")
    return code
