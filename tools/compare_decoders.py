"""Feed the same random and damaged streams, cut anywhere, to the Python and the C decoder, and compare their output.

    python tools/compare_decoders.py [COUNT] [--seed N]        default: 1000000 streams

Every call's frames are compared and, after each stream, the counters. Exit 1 and the stream at the first difference.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections import Counter
from functools import partial
from pathlib import Path

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parents[1]))

from firmware_proto import Decoder
from tools.codecs.c_frames import CDecoder, Codec
from tools.codecs.random_streams import SECONDS, Call, compare, streams

COUNTERS = ("good", "bad_crc", "dropped", "lost")


def difference(codec: Codec, totals: Counter[str], calls: list[Call], epoch_ms: int) -> str:
    """Return the disagreements of the decoders; empty without one."""
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
        differs = partial(difference, Codec(Path(folder)), totals)
        return compare(streams(options.seed, options.count), differs, totals, options.seed)


if __name__ == "__main__":
    sys.exit(main())
