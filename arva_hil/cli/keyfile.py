"""The file that --signing-key names."""

from __future__ import annotations

import os
import stat
from contextlib import ExitStack, closing
from typing import Final

from arva_hil.cli.outcome import UsageError
from arva_hil.cli.terminal import tell
from arva_hil.mavlink.signing import Signing, key_of
from arva_hil.runtime.signing_state import PersistentSigning, state_file

_LARGEST: Final = 4096  # bytes


def signing(path: str | None, epoch_us: int, stack: ExitStack, link: int = 0) -> Signing | None:
    """Signing with the key in a file. The clock reads 0 at `epoch_us` (µs since 1970). Raises UsageError.

    Its time stamps continue those of the last program with this key. They are saved when `stack` is closed.
    """
    if not path:
        return None
    key = _key(path)
    return stack.enter_context(closing(PersistentSigning(key, epoch_us, link, state_file(key, os.environ), tell)))


def _key(path: str) -> bytes:
    from arva_hil.config.reading import open_at_once  # slow to import

    wanted = "expected 64 hexadecimal digits (the key) or a passphrase, on one line"
    try:
        with open(path, "rb", opener=open_at_once) as file:
            mode = os.fstat(file.fileno()).st_mode
            if not stat.S_ISREG(mode):
                raise UsageError(f"--signing-key {path}: is not a file, {wanted}")
            if os.name == "posix" and mode & 0o077 and not _is_credential(path):
                raise UsageError(
                    f"--signing-key {path}: other users may read or write it ({mode & 0o777:o}): chmod 600 {path}"
                )
            data = file.read(_LARGEST + 1)
    except OSError as error:
        raise UsageError(f"--signing-key {path}: {error.strerror}, {wanted}") from None
    if len(data) > _LARGEST:
        raise UsageError(f"--signing-key {path}: more than {_LARGEST} bytes, {wanted}")
    try:
        return key_of(data.decode())
    except UnicodeDecodeError as error:
        raise UsageError(f"--signing-key {path}: byte {error.start + 1} is not text, {wanted}") from None
    except ValueError as error:
        raise UsageError(f"--signing-key {path}: {error}, {wanted}") from None


def _is_credential(path: str) -> bool:
    """Whether systemd keeps the file for this service. Its mode is 440 then, and an access list limits the readers."""
    folder = os.environ.get("CREDENTIALS_DIRECTORY")
    return bool(folder) and os.path.dirname(os.path.realpath(path)) == os.path.realpath(str(folder))
