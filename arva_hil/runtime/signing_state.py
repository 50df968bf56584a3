"""Stores the time stamps of signatures, as MAVLink requires: otherwise recorded packets are accepted again.

There is one small file for each key, readable only by its owner. Several programs with the same key share it.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
from collections.abc import Callable, Mapping
from io import FileIO
from pathlib import Path
from typing import Any, Final

from arva_hil.links import files
from arva_hil.mavlink.signing import LARGEST, KeptTimeStamps, Signing
from arva_hil.runtime.worker_thread import WorkerThread

try:
    import fcntl
except ImportError:  # Windows: without a lock, the last program that writes wins
    fcntl = None  # type: ignore[assignment]

_KEEP_S: Final = 5.0  # interval of saving: a killed program loses this much
_MOST_STREAMS: Final = 1024
_LARGEST_FILE: Final = 1 << 20  # bytes
_OWNERS: Final = 0o600


def state_file(key: bytes, environment: Mapping[str, str]) -> Path | None:
    """Return the file of a key: in $XDG_STATE_HOME/arva-hil, else ~/.local/state/arva-hil.

    None: there is no home folder.
    """
    home = environment.get("XDG_STATE_HOME", "")
    if not os.path.isabs(home):  # the standard says to ignore a relative path
        home = os.path.join(os.path.expanduser("~"), ".local", "state")
    if not os.path.isabs(home):
        return None
    name = hashlib.sha256(b"arva-hil signing state " + key).hexdigest()[:32]
    return Path(home, "arva-hil", f"{name}.json")


class PersistentSigning(Signing):
    """`Signing` that continues from the last program with this key, and stores its time stamps in `file`.

    They are written at the start, every 5 s on a thread, and by `close`. If the file cannot be read or written, `say`
    is called once, and nothing else changes.
    """

    def __init__(self, key: bytes, epoch_us: int, link: int, file: Path | None, say: Callable[[str], None]) -> None:
        self._file = file
        self._say: Callable[[str], None] | None = say
        self._error: Exception | None = None  # of the last attempt to write
        super().__init__(key, epoch_us, link, self._load())
        self._background = WorkerThread("signing")
        self._next_keep: float | None = None
        self._keep(self.kept(), wait=False)
        self._complain(self._error)

    def advance(self, now: float) -> None:
        super().advance(now)
        if self._next_keep is None or now >= self._next_keep:
            self._next_keep = now + _KEEP_S
            kept = self.kept()
            self._background.put(lambda: self._keep(kept, wait=False))

    def close(self) -> None:
        """Store the time stamps. Takes 10 s at most, also with a blocked disk."""
        kept = self.kept()
        finished = self._background.close(lambda: self._keep(kept, wait=True))
        self._complain(self._error if finished else TimeoutError("another program or the disk blocks it"))

    def _load(self) -> KeptTimeStamps:
        try:
            return _read(self._file) if self._file else KeptTimeStamps()
        except (OSError, ValueError) as error:
            self._complain(error)
            return KeptTimeStamps()

    def _keep(self, kept: KeptTimeStamps, *, wait: bool) -> None:
        """Try to write time stamps, with those of other programs. `wait`: for another program that writes now."""
        self._error = None
        try:
            if self._file is None:
                raise FileNotFoundError("there is no home folder")
            self._file.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
            with files.grow(self._file.with_suffix(".lock"), _OWNERS) as lock:
                if not _locks(lock, wait=wait):
                    return
                with contextlib.suppress(ValueError):  # no state: it is replaced
                    kept = kept.with_others(_read(self._file)).recent()
                files.replace(self._file, _written(kept), _OWNERS)
        except OSError as error:
            self._error = error

    def _complain(self, error: Exception | None) -> None:
        """Report an error, once in a process."""
        if self._say is None or error is None:
            return
        say, self._say = self._say, None
        why = (error.strerror if isinstance(error, OSError) else None) or str(error)
        where = f"{self._file}: " if self._file else ""
        say(f"{where}time stamps of signatures are not stored ({why}): recorded packets may be accepted later")


def _locks(file: FileIO, *, wait: bool) -> bool:
    """Lock the file until it is closed. Returns False if another program has locked it."""
    if fcntl:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
        except BlockingIOError:
            return False
    return True


def _read(file: Path) -> KeptTimeStamps:
    """Return the time stamps in a file, none if it does not exist. Raises OSError; ValueError for other contents."""
    try:
        with open(file, "rb", buffering=0, opener=_open) as opened:
            data = opened.read(_LARGEST_FILE + 1) or b""
    except FileNotFoundError:
        return KeptTimeStamps()
    try:
        if len(data) > _LARGEST_FILE:
            raise ValueError
        state = json.loads(data)
        newest, streams = state["newest"], {(a, b, c): ticks for a, b, c, ticks in state["streams"]}
        numbers: list[Any] = [newest, *streams.values(), *(n for stream in streams for n in stream)]
        if not all(type(n) is int and 0 <= n <= LARGEST for n in numbers):
            raise ValueError
    except (ValueError, TypeError, KeyError, RecursionError):
        raise ValueError("it contains something else") from None
    return KeptTimeStamps(newest, streams)


def _open(name: str, flags: int) -> int:
    return os.open(name, flags | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0))


def _written(kept: KeptTimeStamps) -> bytes:
    newest_first = sorted(kept.streams.items(), key=lambda item: -item[1])[:_MOST_STREAMS]
    streams = [[*stream, ticks] for stream, ticks in newest_first]
    return json.dumps({"newest": kept.newest, "streams": streams}).encode() + b"\n"
