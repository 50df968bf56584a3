"""Coverage-guided fuzzing of readers: scenario files, MAVLink, frames, commands, logs, news of a team.

    python -m tools fuzz python loader|session|decoder|commands|log|team [--seconds 600] [--seed N] [--corpus DIR]
    python -m tools fuzz python TARGET --runs 10000            damaged seeds, the same each time, without atheris
    python -m tools fuzz python TARGET --reproduce FILE        one input, without atheris

Coverage needs atheris: pip install 'arva-hil[fuzz]'. The target's module has the inputs and the conditions. It begins
with configs/, tests/data, tests/broken and vectors.json, in the folder `--corpus`, which grows; default build/fuzz. The
first finding ends the run and leaves its input in the current folder. Exit 0 without a finding.
"""

from __future__ import annotations

import argparse
import importlib
import importlib.util
import itertools
import random
import re
import sys
import tempfile
import traceback
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

from tools.fuzz.script import ROOT
from tools.options import parser

TARGETS = {  # modules of this folder: the longest input, in bytes, and the packages whose coverage guides it
    "loader": (4096, ["arva_hil", "yaml"]),
    "session": (1024, ["arva_hil"]),
    "decoder": (2048, ["arva_hil", "firmware_proto"]),
    "commands": (1024, ["firmware_proto"]),
    "log": (4096, ["arva_hil.links"]),
    "team": (1024, ["arva_hil.search", "arva_hil.mavlink"]),
}
SLOWEST_S = 20  # of one input
LARGEST_MB = 2048


def main() -> int:
    made = parser(
        __doc__,
        seconds=(600, "of fuzzing with atheris"),
        runs=(int, "damaged seeds, without atheris"),
        seed=(457, "of the damage"),
        corpus=(Path, "folder of the inputs"),
        reproduce=(Path, "one input"),
    )
    made.add_argument("target", choices=TARGETS)
    options = made.parse_args()
    if options.reproduce:
        return reproduce(options.target, options.reproduce)
    if options.runs:
        return run_damaged(options.target, options.runs, options.seed)
    if importlib.util.find_spec("atheris") is None:
        print("atheris is not installed: pip install 'arva-hil[fuzz]' (or pip install atheris)", file=sys.stderr)
        return 2
    fuzz(options)
    return 0


def module(target: str) -> ModuleType:
    """Imported when it is wanted, for its imports are what may be instrumented."""
    return importlib.import_module(f"tools.fuzz.{target}")


def reproduce(target: str, path: Path) -> int:
    try:
        module(target).fuzz(path.read_bytes())
    except Exception:
        traceback.print_exc()
        print(f"{path}: fails", file=sys.stderr)
        return 1
    print(f"{path}: passes")
    return 0


def run_damaged(target: str, runs: int, seed: int) -> int:
    """Try the seeds, then damaged ones. The first finding is written to the current folder."""
    every = list(module(target).seeds())
    for number, data in enumerate(itertools.chain(every, damaged(every, runs, seed))):
        try:
            module(target).fuzz(data)
        except Exception:
            path = Path(f"crash-{target}-{seed}-{number}")
            path.write_bytes(data)
            return reproduce(target, path)
    print(f"{target}: {len(every) + runs} runs, seed {seed}, 0 findings")
    return 0


def damaged(seeds: list[bytes], count: int, seed: int) -> Iterator[bytes]:
    """Yield seeds with a few bytes changed, and with words exchanged; the same ones each time."""
    r = random.Random(seed)
    words = [word.encode() for word in dictionary()]
    for _ in range(count):
        data = bytearray(r.choice(seeds))
        for _ in range(r.randint(1, 8)):
            at = r.randrange(len(data) + 1)
            data[at : at + r.randrange(2)] = r.choice((b"", r.randbytes(1), r.randbytes(4), bytes(data[at : at + 20])))
        yield reworded(bytes(data), words, r) if r.random() < 0.3 else bytes(data)


def fuzz(options: argparse.Namespace) -> None:
    """Fuzz until the time is over, or something is found: libFuzzer ends the process, with 0 or another code."""
    import atheris

    import arva_hil.model.receiver  # noqa: F401 - before it could be instrumented: atheris keeps every array that is compared

    longest, packages = TARGETS[options.target]
    corpus: Path = options.corpus or ROOT / "build" / "fuzz" / options.target
    corpus.mkdir(parents=True, exist_ok=True)
    tempfile.tempdir = str(corpus.parent)  # the target's files stay behind
    with atheris.instrument_imports(include=packages):
        target = module(options.target)
    for number, seed in enumerate(target.seeds()):
        (corpus / f"{number:04}").write_bytes(seed)
    words = [word.encode() for word in dictionary()]

    def rearranged(data: bytes, largest: int, seed: int) -> bytes:
        """Now as libFuzzer mutates bytes, now word by word, as people get YAML wrong."""
        r = random.Random(seed)
        return (atheris.Mutate(data, largest) if r.random() < 0.5 else reworded(data, words, r))[:largest]

    mutator = {"custom_mutator": rearranged} if options.target == "loader" else {}
    limits = [f"-max_len={longest}", f"-timeout={SLOWEST_S}", f"-rss_limit_mb={LARGEST_MB}", "-print_final_stats=1"]
    until = [f"-max_total_time={options.seconds}", f"-seed={options.seed}"]
    atheris.Setup([sys.argv[0], *until, *limits, str(corpus)], target.fuzz, **mutator)
    atheris.Fuzz()


def dictionary() -> list[str]:
    """Every word of the scenarios that come with the program, and what YAML makes of punctuation."""
    text = "\n".join(path.read_text(encoding="utf-8") for path in sorted((ROOT / "configs").glob("*.yaml")))
    words = dict.fromkeys(re.findall(r"[a-z_]{2,}|-?[0-9.]+", re.sub("#.*", "", text)))
    signs = ": |- |{|}|[|]|, |# |&a |*a|!!int |<<: |---|...|%YAML 1.1|'|? |>|.nan|.inf|-0|1e9|0x1|010|1_0|null|~|true"
    return [*words, *signs.split("|"), "|"]


def reworded(data: bytes, words: list[bytes], r: random.Random) -> bytes:
    """A few words replaced, left out, said twice, exchanged or put in; lines too."""
    parts = re.findall(rb"\n *|[\w.-]+| +|[^\w\s]|\s", data) or [b""]
    for _ in range(r.randint(1, 4)):
        at, other = r.randrange(len(parts)), r.randrange(len(parts))
        kind = r.randrange(6)
        if kind == 0:
            parts[at] = r.choice(words)
        elif kind == 1 and len(parts) > 1:
            del parts[at]
        elif kind == 2:
            parts.insert(at, parts[other])
        elif kind == 3:
            parts[at], parts[other] = parts[other], parts[at]
        elif kind == 4:
            parts.insert(at, r.choice(words))
        else:
            low, high = sorted((at, other))
            parts[low:low] = parts[low:high][:40]
    return b"".join(parts)
