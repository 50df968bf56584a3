"""How a command ends: its exit code, and the message when it did not go well."""

from __future__ import annotations

from typing import Final

from arva_hil.errors import ArvaError
from arva_hil.safe_text import one_line

OK: Final = 0
FAILED: Final = 1  # while running
USAGE: Final = 2  # or configuration
NO_LINK: Final = 3  # or no heartbeat in time
INTERRUPTED: Final = 130
NO_READER: Final = 141  # any more at the pipe that stdout is, as `| head`: as of a program that SIGPIPE has ended


class Failure(ArvaError):
    """The end of a command: `str()` says what was wrong, where, and what to do, a line for each of `lines`."""

    def __init__(self, code: int, *lines: object) -> None:
        self.code = code
        self.lines = tuple(map(one_line, lines))
        super().__init__("\n".join(self.lines))


class UsageError(Failure):
    """The command line, the environment or a file it names is wrong."""

    def __init__(self, *lines: object) -> None:
        super().__init__(USAGE, *lines)
