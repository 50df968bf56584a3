"""`arva-hil conform`: judges a decoder by the clauses of PROTOCOL.md."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from contextlib import nullcontext
from typing import BinaryIO
from xml.etree import ElementTree

from arva_hil.bench.clauses import clauses
from arva_hil.bench.judge import Verdict, judge
from arva_hil.cli.outcome import FAILED, OK, UsageError
from arva_hil.cli.recorded import output
from arva_hil.cli.terminal import show, tell
from arva_hil.errors import nearest
from arva_hil.safe_text import one_line


def main(options: argparse.Namespace) -> int:
    every = {clause.name: clause for clause in clauses()}
    for name in options.only or ():
        if name not in every:
            near = nearest(name, every)
            hint = f"did you mean {near}?" if near else "see arva-hil conform --list"
            raise UsageError(f"--only: no clause {name!r}; {hint}")
    chosen = [clause for clause in every.values() if not options.only or clause.name in options.only]
    if options.list:
        if options.command or options.typed & {"junit", "pty"}:
            raise UsageError("--list: it judges nothing: leave out COMMAND, --junit and --pty")
        show(
            *(
                f"{clause.name:<15} {clause.text} ({clause.section}){'; with --pty' if clause.pty else ''}"
                for clause in chosen
            )
        )
        return OK
    if not options.command:
        raise UsageError("no command: write arva-hil conform -- ./my_decoder")
    if options.only and not options.pty and (needy := [clause.name for clause in chosen if clause.pty]):
        raise UsageError(f"--only {needy[0]}: this clause needs a port: add --pty")
    say = tell if options.junit == "-" else show
    with output(options.junit) if options.junit else nullcontext() as out:
        verdicts = []
        for clause in chosen:
            if clause.pty and not options.pty:
                continue
            try:
                verdict = judge(clause, options.command, pty=options.pty, patience_s=options.timeout)
            except OSError as error:
                raise UsageError(f"{options.command[0]}: cannot be started: {error.strerror}") from None
            verdicts.append(verdict)
            mark = "FAIL" if verdict.why else "ok"
            say(f"{mark:<4} {clause.name:<15} {verdict.why or clause.text} ({clause.section})")
        failed = sum(bool(verdict.why) for verdict in verdicts)
        say(f"{len(verdicts) - failed} of {len(verdicts)} clauses hold")
        if out:
            _write_junit(out, verdicts, failed)
    return FAILED if failed else OK


def _write_junit(out: BinaryIO, verdicts: Sequence[Verdict], failed: int) -> None:
    """Write the results as JUnit XML."""
    suite = ElementTree.Element("testsuite", name="arva-hil conform", tests=str(len(verdicts)), failures=str(failed))
    for clause, why in verdicts:
        case = ElementTree.SubElement(suite, "testcase", classname=f"PROTOCOL.md.{clause.section}", name=clause.name)
        if why:
            ElementTree.SubElement(case, "failure", message=one_line(why))
    ElementTree.ElementTree(suite).write(out, encoding="utf-8", xml_declaration=True)
