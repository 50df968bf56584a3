"""Feed the same random and damaged streams of messages to the decoders in Python, C and Lua, and compare them.

    python tools/compare_messages.py [COUNT] [--seed N] [--no-lua]        default: 100000 streams

Every call's messages are compared and, after each stream, the counters. Each command and answer that came out is
encoded again in C (commands in Lua, too): it must have Python's bytes. Exit 1 and the stream at the first difference.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections import Counter
from pathlib import Path
from typing import Any

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parents[1]))

from firmware_proto import Command, CommandAnswer
from firmware_proto.commands import encode_answer, encode_command
from tools.codecs.c_messages import CMessageDecoder, CMessages, python_decoder
from tools.codecs.random_streams import SECONDS, Call, compare, message_streams

COUNTERS = ("good", "bad_crc", "dropped")


class Comparison:
    """Remembers the compiled C code, the Lua script and the totals."""

    def __init__(self, folder: Path, *, lua: bool) -> None:
        self.totals: Counter[str] = Counter()
        self._c = CMessages(folder)
        self._lua: Any = None
        if lua:
            from tests.firmware_proto.lua_stubs import Autopilot, LuaMessageDecoder

            self._autopilot = Autopilot()
            self._script = self._autopilot.require("arva_receiver")
            self._lua = LuaMessageDecoder

    def difference(self, calls: list[Call], epoch_ms: int) -> str:
        """Return the disagreements of the decoders; empty without one."""
        ours = python_decoder()
        others: dict[str, Any] = {"C": CMessageDecoder(self._c, epoch_ms)}
        if self._lua:
            others["Lua"] = self._lua(self._autopilot, self._script)
        for now_ms, chunk in calls:
            came = ours.feed(chunk, now_ms * SECONDS)
            for name, other in others.items():
                if came != (theirs := other.feed_ms(chunk, now_ms)):
                    return f"at {now_ms} ms: Python {came}, {name} {theirs}"
            for message in came:
                self.totals[type(message).__name__] += 1
                if wrong := self._encoded(message, others):
                    return wrong
        counts = [getattr(ours, name) for name in COUNTERS]
        self.totals.update(
            dict(zip(COUNTERS, counts, strict=True)), calls=len(calls), bytes=sum(len(c) for _, c in calls)
        )
        for name, other in others.items():
            if counts != (theirs := [getattr(other, counter) for counter in COUNTERS]):
                return f"{COUNTERS}: Python {counts}, {name} {theirs}"
        return ""

    def _encoded(self, message: Any, others: dict[str, Any]) -> str:
        """Python's bytes of a command or an answer against the others'."""
        if not isinstance(message, Command | CommandAnswer):
            return ""
        raw = encode_answer(message) if isinstance(message, CommandAnswer) else encode_command(message)
        if raw != (theirs := self._c.encode(message)):
            return f"{message}: Python {raw.hex()}, C {theirs.hex()}"
        if "Lua" in others and isinstance(message, Command) and raw != (theirs := others["Lua"].encode(message)):
            return f"{message}: Python {raw.hex()}, Lua {theirs.hex()}"
        return ""


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("count", nargs="?", type=int, default=100_000, metavar="COUNT")
    parser.add_argument("--seed", type=int, default=457)
    parser.add_argument("--no-lua", action="store_true", help="leave Lua out, which needs lupa and is slow")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        comparison = Comparison(Path(folder), lua=not options.no_lua)
        return compare(
            message_streams(options.seed, options.count), comparison.difference, comparison.totals, options.seed
        )


if __name__ == "__main__":
    sys.exit(main())
