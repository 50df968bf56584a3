"""A question to the person at the terminal. The program does not wait for the answer."""

from __future__ import annotations

import contextlib
import os
import select
import sys
from collections.abc import Callable

_MOST: int = 256  # bytes of an answer


class TerminalQuestion:
    """Reads a line typed at a terminal, without waiting for it. `say` shows the question.

    A program in the background does not read, because the terminal would stop it.
    """

    def __init__(self, say: Callable[[str], None], fd: int = 0) -> None:
        self._say = say
        self._fd = fd
        self._typed = b""

    def ask(self, text: str) -> None:
        """Show the question. Text that was typed before is discarded."""
        import termios

        with contextlib.suppress(termios.error):
            termios.tcflush(self._fd, termios.TCIFLUSH)
        self._typed = b""
        self._say(f"{text}: ")

    def answer(self) -> str | None:
        """The line that was typed since then; None if there is none yet, "" if the terminal is closed."""
        try:
            while self._in_foreground() and select.select([self._fd], [], [], 0)[0]:
                chunk = os.read(self._fd, _MOST)
                self._typed += chunk
                line, end, _ = self._typed.replace(b"\r", b"\n").partition(b"\n")
                if end or not chunk or len(line) > _MOST:
                    return line.decode(errors="replace")
        except OSError:
            return ""
        return None

    def _in_foreground(self) -> bool:
        try:
            return os.tcgetpgrp(self._fd) == os.getpgrp()
        except OSError:  # it is not the controlling terminal, and stops no program
            return True


def somebody_is_there() -> bool:
    """Whether a question can be seen and answered: stdin and stderr are terminals."""
    try:
        return os.name == "posix" and sys.stdin.isatty() and sys.stderr.isatty() and sys.stdin.fileno() == 0
    except (AttributeError, OSError, ValueError):
        return False
