"""Prints how fast the C and the Python decoder are, and how big the C one is.

    python tools/measure_decoders.py [--megabytes 8]

Back-to-back frames of n channels, in chunks; per second of processor time, the best of five runs. The C is compiled
with -O2, its frames go to a function that looks at every channel. Sizes need arm-none-eabi-gcc (on Debian:
gcc-arm-none-eabi).
"""

from __future__ import annotations

import argparse
import ctypes
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parents[1]))

from firmware_proto import Channel, Decoder, Frame, encode
from tools.codecs.c_code import SOURCE, compile_c, compiler

RUNNER = """
#include "arva_frame.h"
static void on_frame(void *context, const arva_frame *frame)
{
    for (int k = 0; k < frame->n; k++) {
        *(long *)context += frame->channels[k].d_cm;
    }
}
uint32_t run(const uint8_t *data, size_t size, size_t chunk);
uint32_t run(const uint8_t *data, size_t size, size_t chunk)
{
    static long sum;
    arva_decoder decoder;
    arva_decoder_init(&decoder, on_frame, &sum);
    for (size_t at = 0; at < size; at += chunk) {
        if (chunk == 1) {
            arva_decoder_push(&decoder, data[at], 0);
        } else {
            arva_decoder_feed(&decoder, data + at, size - at < chunk ? size - at : chunk, 0);
        }
    }
    return decoder.good;
}
"""
CHUNKS = (1, 64, 4096)


def stream(n: int, size: int) -> bytes:
    frames = [
        encode(Frame(k, 1, tuple(Channel(j, k % 3, 97 * k + j, k - 128) for j in range(1, n + 1)))) for k in range(256)
    ]
    block = b"".join(frames)
    return block * (size // len(block) + 1)


def best(run: Callable[[], int], data: bytes, frames: int) -> float:
    """MB/s, the best of five."""
    seconds = []
    for _ in range(5):
        start = time.process_time()
        good = run()
        seconds.append(time.process_time() - start)
        if good != frames:
            raise SystemExit(f"{good} frames came out of {frames}")
    return len(data) / min(seconds) / 1e6


def run_python(data: bytes, chunk: int) -> int:
    decoder = Decoder()
    for at in range(0, len(data), chunk):
        decoder.feed(data[at : at + chunk], 0.0)
    return decoder.good


def measure_speed(name: str, run: Callable[[bytes, int], int], size: int) -> None:
    for n in (1, 4, 16):
        data = stream(n, size)
        frames = len(data) // (9 + 6 * n)
        speeds = [f"{best(lambda: run(data, chunk), data, frames):.3g}" for chunk in CHUNKS]  # noqa: B023
        print(f"{name}, n = {n}, chunks of {', '.join(map(str, CHUNKS))} bytes: {', '.join(speeds)} MB/s")


def measure_c(folder: Path, size: int) -> None:
    source = folder / "run.c"
    source.write_text(RUNNER)
    for command in ("gcc", "clang"):
        if not shutil.which(command):
            print(f"{command}: not installed")
            continue
        target = folder / f"{command}.so"
        compile_c(command, target, "-std=c99", "-O2", "-shared", "-fPIC", source, SOURCE)
        function = ctypes.CDLL(str(target)).run
        function.argtypes, function.restype = (ctypes.c_char_p, ctypes.c_size_t, ctypes.c_size_t), ctypes.c_uint32
        measure_speed(f"C by {command} -O2", lambda data, chunk: function(data, len(data), chunk), size)  # noqa: B023


def measure_size(folder: Path) -> None:
    state = folder / "state.c"
    state.write_text('#include "arva_frame.h"\narva_decoder decoder;\n')
    cores = [("arm-none-eabi-", f"cortex-{core}", f"-mcpu=cortex-{core}", "-mthumb") for core in ("m0", "m4", "m7")]
    for prefix, core, *flags in [*cores, ("", "this machine")]:
        command = prefix + "gcc" if prefix else compiler()
        if not shutil.which(command):
            print(f"{core}: {command} is not installed")
            continue
        sizes = []
        for source in (SOURCE, state):
            target = compile_c(command, folder / "size.o", "-std=c99", "-Os", "-c", *flags, source)
            listed = subprocess.run([f"{prefix}size", target], check=True, capture_output=True, text=True).stdout
            sizes.append([int(field) for field in listed.splitlines()[1].split()[:3]])
        (text, data, bss), (_, _, held) = sizes
        print(
            f"{core}, -Os: {text} bytes of code and constants, {data + bss} of static data; a decoder is {held} bytes"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--megabytes", type=int, default=8, help="of stream a run in C, an eighth of it in Python")
    size = 1_000_000 * parser.parse_args().megabytes
    with tempfile.TemporaryDirectory() as name:
        measure_c(Path(name), size)
        measure_speed("Python", run_python, size // 8)
        measure_size(Path(name))


if __name__ == "__main__":
    main()
