"""Files that this program writes into a folder: new ones, ones that grow, ones replaced as a whole.

The folder that a user names may be a symlink. A file in it never is: nothing is written through one.
"""

from __future__ import annotations

import contextlib
import errno
import os
import stat
from io import FileIO
from pathlib import Path
from typing import Final

_MODE: Final = 0o666  # less what the umask takes
_SYMLINK: Final = "is a symlink, and nothing is written through one"
_NO_FILE: Final = "is no regular file"


def there(path: Path) -> bool:
    """Whether anything has this name: a file, a folder, or a symlink wherever it leads."""
    return os.path.lexists(path)


def refuse_special(path: Path) -> None:
    """For a file that somebody else opens. Raises OSError: it is a symlink, or no regular file."""
    with contextlib.suppress(FileNotFoundError):
        mode = path.lstat().st_mode
        if not stat.S_ISREG(mode):
            raise OSError(errno.EINVAL, _SYMLINK if stat.S_ISLNK(mode) else _NO_FILE, str(path))


def create(path: Path) -> FileIO:
    """A new file to write to, unbuffered. Raises FileExistsError when anything has this name, a symlink too."""
    return path.open("xb", buffering=0)


def grow(path: Path, mode: int = _MODE) -> FileIO:
    """A file to read and to write at its end, unbuffered, made when there is none.

    Raises OSError: it is a symlink, or no regular file.
    """

    def opener(name: str, flags: int) -> int:
        flags |= getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)  # a pipe is not waited for
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


def replace(path: Path, data: bytes, mode: int = _MODE) -> None:
    """Write a file as a whole or not at all, and have it on the disk when this returns.

    Who reads it meanwhile gets the old one or the new one. A symlink of this name is replaced, not followed. Raises
    OSError, and what was there before is still there.
    """
    new = path.with_name(path.name + ".new")
    with contextlib.suppress(FileNotFoundError):
        new.unlink()  # of a run that was killed
    try:
        with open(new, "xb", opener=lambda name, flags: os.open(name, flags, mode)) as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        new.replace(path)
    except OSError as error:
        with contextlib.suppress(OSError):
            new.unlink()
        raise OSError(error.errno, error.strerror, str(path)) from None
    _sync_folder(path.parent)


def _sync_folder(folder: Path) -> None:
    """Have the names in it on the disk too, where the system can."""
    with contextlib.suppress(OSError):
        fd = os.open(folder, os.O_RDONLY | getattr(os, "O_DIRECTORY", 0))
        try:
            os.fsync(fd)
        finally:
            os.close(fd)
