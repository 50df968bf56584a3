"""Writes files in a folder: new ones, ones that grow, and ones that are replaced as a whole.

The folder may be a symlink. A file in it may not: this program does not write through symlinks.
"""

from __future__ import annotations

import contextlib
import errno
import os
import stat
from collections.abc import Iterator
from io import FileIO
from pathlib import Path
from typing import BinaryIO, Final

_MODE: Final = 0o666  # without the bits of the umask
_SYMLINK: Final = "is a symlink, and this program does not write through symlinks"
_NO_FILE: Final = "is not a regular file"


def refuse_special(path: Path) -> None:
    """Check a file before a library opens it. Raises OSError if it is a symlink, or not a regular file."""
    with contextlib.suppress(FileNotFoundError):
        mode = path.lstat().st_mode
        if not stat.S_ISREG(mode):
            raise OSError(errno.EINVAL, _SYMLINK if stat.S_ISLNK(mode) else _NO_FILE, str(path))


def create(path: Path) -> FileIO:
    """Make a new file for writing, unbuffered. Raises FileExistsError if anything has this name, also a symlink."""
    return path.open("xb", buffering=0)


def grow(path: Path, mode: int = _MODE) -> FileIO:
    """Open a file for reading and for writing at its end, unbuffered. Makes it if there is none.

    Raises OSError if it is a symlink, or not a regular file.
    """

    def opener(name: str, flags: int) -> int:
        flags |= getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)  # does not wait for the reader of a pipe
        try:
            return os.open(name, flags, mode)
        except OSError as error:
            if error.errno == errno.ELOOP:
                raise OSError(errno.ELOOP, _SYMLINK, name) from None
            raise

    file = open(path, "ab+", buffering=0, opener=opener)  # noqa: SIM115 (the caller closes it)
    if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
        file.close()
        raise OSError(errno.EINVAL, _NO_FILE, str(path))
    return file


@contextlib.contextmanager
def replacing(path: Path, mode: int = _MODE) -> Iterator[BinaryIO]:
    """Open a file that replaces `path` atomically at the end of the block. It is on the disk then.

    A reader gets either the old or the new file. A symlink of this name is replaced, not followed. Raises OSError, also
    for a pipe or a folder; after that or any other error the old file is still there.
    """
    if path.exists() and not path.is_file():
        raise OSError(errno.EINVAL, _NO_FILE, str(path))
    new = path.with_name(path.name + ".new")
    with contextlib.suppress(FileNotFoundError):
        new.unlink()  # left by a run that was killed
    try:
        with open(new, "xb", opener=lambda name, flags: os.open(name, flags, mode)) as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        new.replace(path)
    except BaseException as error:
        with contextlib.suppress(OSError):
            new.unlink()
        if isinstance(error, OSError) and error.filename in (None, str(new)):
            raise OSError(error.errno, error.strerror, str(path)) from None
        raise
    _sync_folder(path.parent)


def replace(path: Path, data: bytes, mode: int = _MODE) -> None:
    """Replace a file atomically by `data`: see `replacing`."""
    with replacing(path, mode) as file:
        file.write(data)


def _sync_folder(folder: Path) -> None:
    """Write the folder's names to the disk too, if the system can."""
    with contextlib.suppress(OSError):
        fd = os.open(folder, os.O_RDONLY | getattr(os, "O_DIRECTORY", 0))
        try:
            os.fsync(fd)
        finally:
            os.close(fd)
