"""The end of a command: its exit code and message; signals and unexpected errors, which end it early."""

from __future__ import annotations

import contextlib
import errno
import signal
import threading
import traceback
from collections.abc import Iterator
from pathlib import Path
from types import FrameType
from typing import Any, Final

from arva_hil.clock import RealClock
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


class NotWritten(ArvaError):
    """An output cannot be written. `done`: the missing deed."""

    def __init__(self, place: object, error: OSError, done: str = "written") -> None:
        super().__init__(f"{place}: cannot be {done}: {error.strerror or error}")


_FULL: Final = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


def code_of(error: ArvaError) -> int:
    """Return the exit code of an error: its own, else USAGE, e.g. for a wrong name; FAILED for a full disk."""
    if isinstance(error, Failure):
        return error.code
    cause = error.__context__
    return FAILED if isinstance(cause, OSError) and cause.errno in _FULL else USAGE


_SIGNALS: Final = [getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]
_STUCK_S: Final = 1.0  # after this time since a signal, the program is stuck
_PACKAGE: Final = Path(__file__).parent.parent


@contextlib.contextmanager
def interrupting() -> Iterator[None]:
    """Raise KeyboardInterrupt at the first signal, as Ctrl-C does. For use outside the loop, where no data can be lost.

    A further signal is ignored, so that the cleanup completes, unless the cleanup is stuck.
    """
    before = _set(_Interrupting().note)
    try:
        yield
    finally:
        _restore(before)


class _FirstSignal:
    """Remembers the first signal, in `caught`. `note` is the handler."""

    def __init__(self) -> None:
        self.caught: signal.Signals | None = None
        self._clock = RealClock()
        self._caught_at = 0.0

    def note(self, number: int, frame: FrameType | None) -> None:
        if self.caught is None:
            self._caught_at = self._clock.now()
            self.caught = signal.Signals(number)
            self._first()
        elif self._clock.now() - self._caught_at > _STUCK_S:
            self._stuck()

    def _first(self) -> None:
        """Handle the first signal."""

    def _stuck(self) -> None:
        """Handle a signal that comes a while after the first one."""
        raise KeyboardInterrupt


class _Interrupting(_FirstSignal):
    def _first(self) -> None:
        raise KeyboardInterrupt


class SignalGuard(_FirstSignal):
    """Remembers the first signal in `caught` and the first error of a thread in `error`. The loop must check both.

    A further signal is ignored. If the loop is stuck, it raises KeyboardInterrupt there, unless `ending` is set. Inside
    `interrupting`, the code after a guard is cleanup: signals raise KeyboardInterrupt there only if it is stuck. A
    guard around this one gets the signals too.
    """

    def __init__(self) -> None:
        super().__init__()
        self.error: BaseException | None = None
        self.ending = False
        self._before: dict[int, Any] = {}
        self._hook = threading.excepthook

    def __enter__(self) -> SignalGuard:
        self._before = _set(self.note)
        around = _owner(self._before.get(signal.SIGINT))
        if isinstance(around, _FirstSignal):  # in a destructor Python drops a KeyboardInterrupt
            self.caught = around.caught
        threading.excepthook = self._fail
        return self

    def __exit__(self, *_: object) -> None:
        threading.excepthook = self._hook
        self.ending = False
        _restore({n: before for n, before in self._before.items() if not isinstance(_owner(before), _Interrupting)})

    def _first(self) -> None:
        around = _owner(self._before.get(signal.SIGINT))
        if self.caught and isinstance(around, SignalGuard):
            around.note(self.caught, None)

    def _stuck(self) -> None:
        if not self.ending:
            super()._stuck()

    def _fail(self, args: threading.ExceptHookArgs) -> None:
        if self.error is None:
            self.error = args.exc_value or args.exc_type()


def unexpected_error(error: BaseException) -> str:
    """Return an unexpected error in one line, with its place in this program."""
    ours = [f for f in traceback.extract_tb(error.__traceback__) if _PACKAGE in Path(f.filename).parents]
    where = f" ({Path(ours[-1].filename).relative_to(_PACKAGE)}:{ours[-1].lineno})" if ours else ""
    try:
        text = str(error)
    except Exception:  # that of a plug-in
        text = "its text is not available"
    return f"unexpected {type(error).__name__}: {text}{where}"


def traceback_lines(error: BaseException) -> list[str]:
    """Return the traceback of an error in lines.

    The error's message is one line, because its text may come from outside.
    """
    lines: list[str] = []
    for part in traceback.format_exception(error):
        lines += part.splitlines() if part.startswith("  File ") else [part.strip("\n")]
    return lines


def _set(handler: Any) -> dict[int, Any]:
    """Set the handlers of the signals; returns the earlier ones. Under `nohup`, SIGHUP stays ignored."""
    if threading.current_thread() is not threading.main_thread():
        return {}
    ours = [n for n in _SIGNALS if n == signal.SIGINT or signal.getsignal(n) is not signal.SIG_IGN]
    return {n: signal.signal(n, handler) for n in ours}


def _owner(handler: Any) -> object:
    """Return the object whose method a handler is."""
    return getattr(handler, "__self__", None)


def _restore(handlers: dict[int, Any]) -> None:
    for number, handler in handlers.items():
        signal.signal(number, handler)
