"""Fuzz the C code under AddressSanitizer and UndefinedBehaviorSanitizer, from the streams of vectors.json.

    python -m tools fuzz c [frames|messages] [--seconds 600]    clang's libFuzzer, guided by coverage
    python -m tools fuzz c [frames|messages] --runs 20000       so many runs, the same each time; by gcc without clang

`frames` is frames.c, `messages` messages.c: commands, answers and what antennas measured.

Exit 0 when nothing was found.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import tempfile
from pathlib import Path

from tools.options import parser
from tools.vectors.c_codec import FOLDER, MESSAGES, SOURCE, compile_c, compiler

SANITIZE = ("-std=c99", "-g", "-O1", "-fno-sanitize-recover=all", "-fno-omit-frame-pointer")
VECTORS = FOLDER.parent / "vectors.json"
HERE = Path(__file__).parent
SOURCES = {
    "frames": (HERE / "frames.c", SOURCE),
    "messages": (HERE / "messages.c", MESSAGES, SOURCE),
}
LONGEST = 1024
LONGEST_CHUNK = 239


def write_corpus(folder: Path, target: str) -> list[Path]:
    """The streams as the harness reads them: four bytes of time, then size, pause and bytes of each chunk."""
    files = []
    kind = "streams" if target == "frames" else "message_streams"
    for stream in json.loads(VECTORS.read_text(encoding="utf-8"))[kind]:
        script, now_ms = bytearray(4), 0
        for step in stream["steps"]:
            data = bytes.fromhex(step["hex"])
            at_ms = round(1000 * step["t"])
            pause, now_ms = at_ms - now_ms, at_ms
            for at in range(0, len(data) or 1, LONGEST_CHUNK):
                chunk = data[at : at + LONGEST_CHUNK]
                script += bytes([len(chunk), 0 if at else min(2 * pause, 224) if pause <= 112 else 237]) + chunk
        files.append(folder / stream["name"])
        files[-1].write_bytes(script[:LONGEST])
    return files


def has_libfuzzer(folder: Path) -> bool:
    probe = folder / "probe.c"
    probe.write_text("int LLVMFuzzerTestOneInput(const char *data, unsigned long size) { return !data && size; }")
    command: list[str | Path] = ["clang", "-fsanitize=fuzzer,address,undefined", probe, "-o", folder / "probe"]
    return bool(shutil.which("clang")) and subprocess.run(command, capture_output=True).returncode == 0


def main() -> int:
    made = parser(
        __doc__,
        seconds=(600, "of fuzzing, unless runs are given"),
        runs=(int, "number of inputs"),
        seed=(457, "of the mutations"),
        without_clang=(False, "gcc and plain mutation, even if clang is there"),
    )
    made.add_argument("target", nargs="?", choices=SOURCES, default="frames")
    options = made.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        guided = not options.without_clang and has_libfuzzer(folder)
        if not guided and not options.runs:
            made.error("no clang with libFuzzer (on Debian: apt-get install clang); without it, give --runs")
        (folder / "corpus").mkdir()
        corpus = write_corpus(folder / "corpus", options.target)
        binary = folder / "fuzz_c"
        if guided:
            compile_c("clang", binary, *SANITIZE, "-fsanitize=fuzzer,address,undefined", *SOURCES[options.target])
            length = f"-runs={options.runs}" if options.runs else f"-max_total_time={options.seconds}"
            command: list[str | Path] = [binary, length, f"-seed={options.seed}", f"-max_len={LONGEST}"]
            command += ["-print_final_stats=1", f"-artifact_prefix={Path.cwd()}/", folder / "corpus"]
        else:
            flags = (*SANITIZE, "-fsanitize=address,undefined", "-DFUZZ_BY_ITSELF")
            compile_c(compiler(), binary, *flags, *SOURCES[options.target])
            command = [binary, str(options.runs), str(options.seed), *corpus]
        return subprocess.run(command).returncode
