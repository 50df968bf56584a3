"""How a command ends: its exit code, and the message if it failed."""

from __future__ import annotations

from typing import Final

from arva_hil.errors import ArvaError
from arva_hil.safe_text import one_line

OK: Final = 0
FAILED: Final = 1  # while running
USAGE: Final = 2  # or configuration
NO_LINK: Final = 3  # or no heartbeat in time
INTERRUPTED: Final = 130
NO_READER: Final = 141  # the reader of stdout has ended, as with `| head`: the exit code of a program ended by SIGPIPE


class Failure(ArvaError):
    """Ends a command. `lines` say what is wrong, where, and what to do; `str()` joins them."""

    def __init__(self, code: int, *lines: object) -> None:
        self.code = code
        self.lines = tuple(map(one_line, lines))
        super().__init__("\n".join(self.lines))


class UsageError(Failure):
    """The command line, the environment or a file named there is wrong."""

    def __init__(self, *lines: object) -> None:
        super().__init__(USAGE, *lines)
