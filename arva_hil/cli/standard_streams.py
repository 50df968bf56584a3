"""Standard input, output and error, of which a caller may have closed any (`>&-`, `2>&-`)."""

from __future__ import annotations

import argparse
import contextlib
import os
import sys

from arva_hil.cli.outcome import UsageError


def reserve() -> None:
    """Give the numbers of those that are closed to /dev/null, before anything is opened.

    What is opened next would get the number: what is said on stderr would go out on a port, and frames to a socket.
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
    """Raise UsageError when data are wanted on a stdout that is closed. Lines for a person get lost there."""
    if sys.__stdout__ is not None:
        return
    if getattr(options, "json", False):
        raise UsageError("--json: stdout is closed, and the data go there")
    for name in ("port", "out"):
        if getattr(options, name, None) == "-":
            raise UsageError(f"--{name} -: stdout is closed, and the frames go there")


def abandon(stream: object) -> None:
    """Nobody takes what is written to a standard stream any more: let the rest vanish, at exit too."""
    with contextlib.suppress(OSError, AttributeError, ValueError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, stream.fileno())  # type: ignore[attr-defined]
        os.close(nowhere)
