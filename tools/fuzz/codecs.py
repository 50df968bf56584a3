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
from collections.abc import Callable, Iterator
from pathlib import Path
from random import Random
from typing import Any

from firmware_proto import INNER, MAX_CHANNELS, Channel, Command, CommandAnswer, Decoder, Frame, encode
from firmware_proto.commands import MAX_TEXT, MAX_VALUES, NAMES, RESULTS, encode_answer, encode_command
from firmware_proto.messages import seal
from tools.options import parser
from tools.vectors.c_codec import CDecoder, CMessageDecoder, CMessages, Codec, python_decoder

SECONDS = 1e-3 * (1 + 1e-9)  # a millisecond, so that 100 of them are not less than PAUSE_S by rounding
PAUSES_MS = (0, 0, 0, 1, 1, 3, 20, 40, 60, 99, 100, 101, 200, 256, 1000, 70_000)
HEADS = [bytes.fromhex(text) for text in ("A4", "A457", "A45701", "A4570163", "A4570163000010", "A4570109", "A457010F")]
MESSAGE_HEADS = [
    bytes.fromhex(text)
    for text in ("A4", "A457", "A45702", "A45702080010", "A45702350011", "A457020F0002", "A45702F90001")
]

Call = tuple[int, bytes]  # milliseconds, chunk


def frame(random: Random) -> bytes:
    n = random.choice((1, 1, 1, 2, 4, random.randint(1, MAX_CHANNELS)))
    slots = [
        Channel(
            random.choice((None, 0xA4, 0x57, random.randint(0, 254))),
            random.randint(0, INNER),
            random.choice((-1, 0x57A4, random.randint(-0x8000, 0x7FFF))),
            random.choice((-1, 0x0901, random.randint(-0x8000, 0x7FFF))),
            random.random() < 0.5,
        )
        for _ in range(n)
    ]
    return encode(Frame(random.getrandbits(8), random.getrandbits(8), tuple(slots)))


def message(random: Random) -> bytes:
    """Of any kind; one in ten makes no sense, though its CRC is right."""
    kind = random.choice((1, 2, 16, 16, 17, 17))
    number, name = random.getrandbits(8), random.choice((*NAMES, "command-0", "command-164", "command-255"))
    count = random.randint(0, MAX_VALUES)
    values = tuple(random.choice((0, -1, 0xA4, -0x5C, random.randint(-(2**31), 2**31 - 1))) for _ in range(count))
    if random.random() < 0.1:
        return seal(kind, random.randbytes(random.choice((2, 4, 6, 13, 22, random.randrange(248)))))
    if kind == 16:
        return encode_command(Command(number, name, values))
    if kind == 17:
        text = "".join(random.choice("aZ 0~._-") for _ in range(random.randint(0, MAX_TEXT)))
        return encode_answer(CommandAnswer(number, name, random.choice(RESULTS), values, text))
    n = random.choice((1, 1, 2, 4, random.randint(1, MAX_CHANNELS)))
    body = bytearray(random.randbytes(2) + bytes([n]) + random.randbytes(4))
    for _ in range(n):
        channel = bytearray(random.randbytes(15 if kind == 1 else 6))
        if kind == 1:
            channel[2] = random.randint(0, 16)
        body += channel
    return seal(kind, bytes(body))


def piece(random: Random, frames: list[bytes], heads: list[bytes]) -> bytes:
    """A frame, a part of one, the head of a false one, or noise."""
    kind = random.random()
    if kind < 0.55:
        return random.choice(frames)
    if kind < 0.7:
        raw = random.choice(frames)
        at = random.randrange(len(raw))
        return raw[:at] if kind < 0.63 else raw[at:]
    if kind < 0.85:
        return random.choice(heads)
    return random.randbytes(random.randrange(20))


def damage(random: Random, data: bytearray) -> None:
    for _ in range(random.choice((0, 0, 1, 2, 5))):
        at = random.randrange(len(data) + 1)
        kind = random.random()
        if kind < 0.3:
            data.insert(at, random.getrandbits(8))
        elif kind < 0.6:
            del data[at : at + 1]
        elif at < len(data):
            data[at] ^= 1 << random.getrandbits(3)


def cut(random: Random, data: bytes) -> list[Call]:
    calls, at, now = [], 0, 0
    longest, paused = random.choice((1, 5, 40, 150)), random.choice((0.0, 0.02, 0.1, 0.4))
    while at < len(data):
        now += random.choice(PAUSES_MS) if random.random() < paused else 0
        size = random.randint(0, longest) if longest > 1 else 1
        calls.append((now, data[at : at + size]))
        at += size
    return [*calls, (now + random.choice(PAUSES_MS), b""), (now + 100_000, b"")]


def streams(seed: int, count: int) -> Iterator[list[Call]]:
    """Calls of `feed`, one list a stream; the last two of each tell only the time, after which nothing is held."""
    return _streams(seed, count, HEADS, lambda random: [frame(random) for _ in range(20)])


def message_streams(seed: int, count: int) -> Iterator[list[Call]]:
    """The same of messages of all kinds, with frames of version 1 among them."""
    both = ((message, 30), (frame, 4))
    return _streams(
        seed, count, MESSAGE_HEADS, lambda random: [make(random) for make, many in both for _ in range(many)]
    )


def _streams(seed: int, count: int, heads: list[bytes], whole: Callable[[Random], list[bytes]]) -> Iterator[list[Call]]:
    """`whole` draws frames or messages, of which fifty streams are made."""
    random, some = Random(seed), list[bytes]()
    for k in range(count):
        if k % 50 == 0:
            some = whole(random)
        data = bytearray(b"".join(piece(random, some, heads) for _ in range(random.randint(1, 6))))
        damage(random, data)
        yield cut(random, bytes(data))


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
