"""Standard input, output and error. The caller may have closed any of them (`>&-`, `2>&-`)."""

from __future__ import annotations

import argparse
import contextlib
import os
import sys

from arva_hil.cli.outcome import UsageError


def reserve() -> None:
    """Open /dev/null for each closed stream, before anything else is opened.

    Otherwise the next port or socket gets the stream's number, and messages for stderr are sent there.
    """
    for fd in range(3):
        try:
            os.fstat(fd)
        except OSError:
            os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)  # the lowest number that is free: this one
    if sys.stdin is None:
        sys.stdin = open(0, closefd=False)  # noqa: SIM115 (for as long as the program runs)
    if sys.stdout is None:
        sys.stdout = open(1, "w", closefd=False)  # noqa: SIM115
    if sys.stderr is None:
        sys.stderr = open(2, "w", errors="backslashreplace", closefd=False)  # noqa: SIM115


def refuse_closed(options: argparse.Namespace) -> None:
    """Raise UsageError if the options send data to stdout and it is closed. Lines for a person are just lost."""
    if sys.__stdout__ is not None:
        return
    if getattr(options, "json", False):
        raise UsageError("--json: the data go to stdout, which is closed")
    for name in ("port", "out"):
        if getattr(options, name, None) == "-":
            raise UsageError(f"--{name} -: the frames go to stdout, which is closed")


def abandon(stream: object) -> None:
    """Discard all further output of a standard stream whose reader is gone, also at exit."""
    with contextlib.suppress(OSError, AttributeError, ValueError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, stream.fileno())  # type: ignore[attr-defined]
        os.close(nowhere)
