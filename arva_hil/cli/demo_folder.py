"""The record of a demo without --record: a new folder in the temporary folder, kept for some days."""

from __future__ import annotations

import contextlib
import os
import re
import stat
import tempfile
from pathlib import Path
from typing import Final

from arva_hil.cli.search_report import PICTURE
from arva_hil.observers.record.layout import FILES
from arva_hil.observers.record.search_log import SEARCH_FILES
from arva_hil.runtime.clock import RealClock, utc

KEPT_DAYS: Final = 7
_PREFIX: Final = "arva-demo-"
_DAY_S: Final = 86400
_OURS: Final = {*FILES, *SEARCH_FILES, PICTURE}


def new_folder() -> Path:
    """Make a folder, named by the time. Removes folders of earlier demos that were not changed for some days."""
    now_us = RealClock().epoch_us
    for name in _old(now_us / 1e6 - KEPT_DAYS * _DAY_S):
        with contextlib.suppress(OSError):
            _remove(name)
    stamp = re.sub(r"\.\d+|[^0-9T]", "", utc(now_us))
    return Path(tempfile.mkdtemp(prefix=f"{_PREFIX}{stamp}-"))


def _old(before_s: float) -> list[str]:
    """Folders of demos that were last changed before `before_s`, seconds since 1970."""
    found = []
    with contextlib.suppress(OSError), os.scandir(tempfile.gettempdir()) as entries:
        for entry in entries:
            with contextlib.suppress(OSError):
                if entry.name.startswith(_PREFIX) and entry.stat(follow_symlinks=False).st_mtime < before_s:
                    found.append(entry.path)
    return found


def _remove(path: str) -> None:
    """Remove a demo's folder and the files in it. Keeps all of it if the folder contains anything else.

    The folder is open meanwhile, so that nothing is removed through a symlink that another user puts in its place.
    """
    if os.unlink not in os.supports_dir_fd:
        return
    folder = os.open(path, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
    try:
        status = os.fstat(folder)
        names = set(os.listdir(folder))
        if not stat.S_ISDIR(status.st_mode) or status.st_uid != os.geteuid() or not names <= _OURS:
            return
        for name in names:
            os.unlink(name, dir_fd=folder)
    finally:
        os.close(folder)
    os.rmdir(path)
