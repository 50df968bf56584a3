"""firmware_proto/c: compiled, and called from Python."""

from __future__ import annotations

import ctypes
import os
import shutil
import subprocess
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).parents[2] / "firmware_proto" / "c"
SOURCE = FOLDER / "arva_frame.c"
MESSAGES = FOLDER / "arva_message.c"  # needs SOURCE
STRICT = ("-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Werror")
NEVER = 2**32 - 1
U8, U16, U32, I16, I32 = ctypes.c_uint8, ctypes.c_uint16, ctypes.c_uint32, ctypes.c_int16, ctypes.c_int32


def compiler(*names: str) -> str:
    """The first of `names` that is installed; by default $CC or the system's."""
    names = names or (os.environ.get("CC", "cc"), "gcc", "clang")
    for name in names:
        if shutil.which(name):
            return name
    raise FileNotFoundError(f"no C compiler: none of {', '.join(names)} is installed; on Debian: apt-get install gcc")


def compile_c(command: str, target: Path, *options: str | Path) -> Path:
    """Run a compiler, `options` being flags and sources. Raises CalledProcessError; the errors go to stderr."""
    subprocess.run([command, *STRICT, f"-I{FOLDER}", *options, "-o", target], check=True)
    return target


def library(folder: Path, name: str, *options: str | Path) -> ctypes.CDLL:
    """Flags and sources as a library, built in `folder` if it is not there."""
    target = folder / f"lib{name}.so"
    if not target.exists():
        compile_c(compiler(), target, "-std=c99", "-O2", "-shared", "-fPIC", *options)
    return ctypes.CDLL(str(target))


def fields(**types: Any) -> list[tuple[str, Any]]:
    """Of a ctypes.Structure, in their order."""
    return list(types.items())


def written(function: Any, raw: ctypes.Structure, capacity: int) -> bytes:
    """Return the output of an encoder; empty if it refuses. Raises AssertionError for a wrong number of bytes."""
    out = ctypes.create_string_buffer(b"\xee" * (capacity + 8))
    size: int = function(ctypes.byref(raw), out, ctypes.c_size_t(capacity))
    assert out.raw[size:-1] == b"\xee" * (capacity + 8 - size)
    return out.raw[:size]


class Decoding:
    """A C decoder with the methods of those in Python: `now` in seconds is rounded to milliseconds after `epoch_ms`."""

    def __init__(self, library: ctypes.CDLL, state: Any, epoch_ms: int) -> None:
        self._library = library
        self._state = state
        self._at = ctypes.byref(state)
        self._epoch_ms = epoch_ms
        self._came: list[Any] = []

    def feed(self, chunk: bytes, now: float) -> list[Any]:
        return self.feed_ms(chunk, round(1000 * now))

    def feed_ms(self, chunk: bytes, now_ms: int) -> list[Any]:
        self._came = []
        count = self._push(bytes(chunk), (now_ms + self._epoch_ms) & NEVER)
        assert count == len(self._came)
        return self._came

    def _push(self, chunk: bytes, now_ms: int) -> int:
        raise NotImplementedError

    good = property(lambda self: self._state.good)
    bad_crc = property(lambda self: self._state.bad_crc)
    dropped = property(lambda self: self._state.dropped)
