"""A port that a running arva-hil command has open. `doctor` names that command instead of the system's error."""

from __future__ import annotations

import re
from typing import Final

from arva_hil.doctor.values import Finding

_OURS: Final = re.compile(
    r"(?:(?P<pid>\d+) \()?[^,()]*?(?:-m arva_hil|\barva-hil) (?P<command>run|demo|search|replay|vehicle|campaign|-)"
)


def held(check: str, link: str, what: str) -> Finding | None:
    """The finding if `what`, an error or a command line, names a running arva-hil command; else None."""
    if (found := _OURS.search(what)) is None:
        return None
    command = "run" if found["command"] == "-" else found["command"]
    process = f" (process {found['pid']})" if found["pid"] else ""
    end = f"Ctrl-C, or kill -INT {found['pid']}" if found["pid"] else "Ctrl-C"
    return Finding(
        check,
        "fail",
        f"{link}: a running arva-hil {command}{process} has it open",
        f"that command shows its own status; to examine this port, end it first ({end})",
    )
