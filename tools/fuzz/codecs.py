"""Feed the same random and damaged streams, cut anywhere, to the decoders in Python, C and Lua, and compare them.

    python -m tools fuzz codecs [frames|messages] [COUNT] [--seed N] [--no-lua]        default: frames, 100000 streams

Frames are compared in Python and C, messages in Lua, too: the output of every call and, after each stream, the
counters. Each command and answer that came out is encoded again in C (commands in Lua, too): it must have Python's
bytes. Exit 1 and the stream at the first difference.
"""

from __future__ import annotations

import sys
import tempfile
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

from firmware_proto import Command, CommandAnswer, Decoder
from firmware_proto.commands import encode_answer, encode_command
from tools.options import parser
from tools.vectors.c_codec import CDecoder, CMessageDecoder, CMessages, Codec, python_decoder
from tools.vectors.random_streams import SECONDS, Call, message_streams, streams


class Comparison:
    """Remembers the compiled C code, the Lua script and the totals."""

    def __init__(self, kind: str, folder: Path, *, lua: bool) -> None:
        self.totals: Counter[str] = Counter()
        self._of_others: dict[str, Callable[[int], Any]] = {}
        self._counters = ["good", "bad_crc", "dropped"]
        if kind == "frames":
            frames = Codec(folder)
            self._ours: Callable[[], Any] = Decoder
            self._of_others["C"] = lambda epoch_ms: CDecoder(frames, epoch_ms)
            self._counters.append("lost")
            return
        self._c = CMessages(folder)
        self._ours = python_decoder
        self._of_others["C"] = lambda epoch_ms: CMessageDecoder(self._c, epoch_ms)
        if lua:
            from tests.firmware_proto.lua_stubs import Autopilot, LuaMessageDecoder

            autopilot = Autopilot()
            script = autopilot.require("arva_receiver")
            self._of_others["Lua"] = lambda epoch_ms: LuaMessageDecoder(autopilot, script)

    def difference(self, calls: list[Call], epoch_ms: int) -> str:
        """Return the disagreements of the decoders; empty without one. `epoch_ms`: at which their clocks begin."""
        ours = self._ours()
        others = {name: make(epoch_ms) for name, make in self._of_others.items()}
        for now_ms, chunk in calls:
            came = ours.feed(chunk, now_ms * SECONDS)
            for name, other in others.items():
                if came != (theirs := other.feed_ms(chunk, now_ms)):
                    return f"at {now_ms} ms: Python {came}, {name} {theirs}"
            for message in came:
                self.totals[type(message).__name__] += 1
                if wrong := self._encoded(message, others):
                    return wrong
        counts = {name: getattr(ours, name) for name in self._counters}
        self.totals.update(counts, calls=len(calls), bytes=sum(len(chunk) for _, chunk in calls))
        for name, other in others.items():
            if counts != (theirs := {counter: getattr(other, counter) for counter in self._counters}):
                return f"Python {counts}, {name} {theirs}"
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
    made = parser(__doc__, seed=(457, "of the streams"), no_lua=(False, "leave Lua out, which needs lupa and is slow"))
    made.add_argument("kind", nargs="?", choices=("frames", "messages"), default="frames")
    made.add_argument("count", nargs="?", type=int, default=100_000, metavar="COUNT")
    options = made.parse_args()
    every = (streams if options.kind == "frames" else message_streams)(options.seed, options.count)
    with tempfile.TemporaryDirectory() as folder:
        comparison = Comparison(options.kind, Path(folder), lua=not options.no_lua)
        for number, calls in enumerate(every):
            epoch_ms = (number * 0x9E3779B1 - 500) & 0xFFFFFFFF  # everywhere, and just before the clock wraps
            if difference := comparison.difference(calls, epoch_ms):
                print(f"stream {number}, seed {options.seed}: {difference}", file=sys.stderr)
                print(*(f"{now} {chunk.hex()}" for now, chunk in calls), sep="\n", file=sys.stderr)
                return 1
    totals = ", ".join(f"{count} {what}" for what, count in sorted(comparison.totals.items()))
    print(f"{options.count} streams, no difference: {totals}")
    return 0
