"""Feed the same random and damaged streams, cut anywhere, to the Python and the C decoder: the same must come out.

    python tools/compare_decoders.py [COUNT] [--seed N]        default: 1000000 streams

Every call's frames are compared and, after each stream, the counters. Exit 1 and the stream at the first difference.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections import Counter
from pathlib import Path

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parents[1]))

from firmware_proto import Decoder
from tools.c_codec import CDecoder, Codec
from tools.random_streams import SECONDS, Call, streams

COUNTERS = ("good", "bad_crc", "dropped", "lost")


def differs(codec: Codec, calls: list[Call], epoch_ms: int, totals: Counter[str]) -> str:
    """What the decoders disagree on; empty when on nothing."""
    ours, theirs = Decoder(), CDecoder(codec, epoch_ms)
    for now_ms, chunk in calls:
        one, other = ours.feed(chunk, now_ms * SECONDS), theirs.feed_ms(chunk, now_ms)
        if one != other:
            return f"at {now_ms} ms: Python {one}, C {other}"
    one, other = ([getattr(decoder, name) for name in COUNTERS] for decoder in (ours, theirs))
    totals.update(dict(zip(COUNTERS, one, strict=True)), calls=len(calls), bytes=sum(len(c) for _, c in calls))
    return "" if one == other else f"{COUNTERS}: Python {one}, C {other}"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("count", nargs="?", type=int, default=1_000_000, metavar="COUNT")
    parser.add_argument("--seed", type=int, default=457)
    options = parser.parse_args()
    totals: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as folder:
        codec = Codec(Path(folder))
        for k, calls in enumerate(streams(options.seed, options.count)):
            epoch_ms = (k * 0x9E3779B1 - 500) & 0xFFFFFFFF  # everywhere, and just before the clock wraps
            if difference := differs(codec, calls, epoch_ms, totals):
                print(f"stream {k}, seed {options.seed}: {difference}", file=sys.stderr)
                print(*(f"{now} {chunk.hex()}" for now, chunk in calls), sep="\n", file=sys.stderr)
                return 1
    print(f"{options.count} streams, no difference: " + ", ".join(f"{v} {k}" for k, v in sorted(totals.items())))
    return 0


if __name__ == "__main__":
    sys.exit(main())
