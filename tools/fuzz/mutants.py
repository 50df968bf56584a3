# ruff: noqa: E501
"""Mistakes in the decoders of firmware_proto, each of which a clause of `conform` must find.

python -m tools fuzz mutants [NAME…]     all 63, or some; exit code 1 if one is not found
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Final, NamedTuple

from arva_hil.bench.clauses import clauses
from arva_hil.bench.judge import Verdict, judge

ROOT: Final = Path(__file__).parents[2]
WIRE: Final = ROOT / "firmware_proto"
EXAMPLES: Final = ROOT / "docs" / "examples" / "driver"
PATIENCE_S: Final = 3.0


class Mutant(NamedTuple):
    """One mistake. `clause`: the one that names it; `file`: in firmware_proto; `old` is replaced by `new`."""

    name: str
    clause: str
    file: str
    old: str
    new: str


def _of(file: str, *mistakes: tuple[str, str, str, str]) -> Iterator[Mutant]:
    language = {".py": "python", ".c": "c", ".lua": "lua"}[Path(file).suffix]
    for name, clause, old, new in mistakes:
        yield Mutant(f"{language}-{name}", clause, file, old, new)


MUTANTS: Final = [
    *_of(
        "binary.py",
        ("no-crc", "checksum", "if crc16.mcrf4xx(data[at + 2 : stop]) == data[stop] | data[stop + 1] << 8:", "if True:"),
        ("half-crc", "checksum", "== data[stop] | data[stop + 1] << 8:", "& 255 == data[stop]:"),
        ("crc-order", "whole", "data[stop] | data[stop + 1] << 8", "data[stop] << 8 | data[stop + 1]"),
        ("crc-with-sync", "whole", "crc16.mcrf4xx(data[at + 2 : stop]) ==", "crc16.mcrf4xx(data[at : stop]) =="),
        ("any-version", "version", r"\xa4(?:\Z|\x57(?:\Z|\x01(?:", r"\xa4(?:\Z|\x57(?:\Z|[\x00-\xff](?:"),
        ("15-channels", "channels", "range(1, MAX_CHANNELS + 1)", "range(1, MAX_CHANNELS)"),
        ("from-2-channels", "channels", "range(1, MAX_CHANNELS + 1)", "range(2, MAX_CHANNELS + 1)"),
        ("any-length", "length", "rb\"])))\")", "rb\"\\x00-\\xff])))\")"),
        ("any-count", "count", "if data[at + 6] * 6 + 9 == size:", "if True:"),
        ("drops-candidate", "resync", "            self.dropped += 1\n            at += 1", "            self.dropped += 1\n            at += size"),
        ("needs-a-byte-more", "false-head", "if end - at < size:", "if end - at <= size:"),
        ("unsigned", "delta", '"<BBhh"', '"<BBhH"'),
        ("unsigned-d", "no-signal", '"<BBhh"', '"<BBHh"'),
        ("big-endian", "distance", '"<BBhh"', '">BBhh"'),
        ("delta-sign", "delta", "d, delta, zone >= MARKED)", "d, -delta, zone >= MARKED)"),
        ("mark-in-zone", "zones", "zone & ~MARKED, d", "zone, d"),
        ("no-id-254", "ids", "None if id == _NO_ID", "None if id >= _NO_ID - 1"),
        ("sequence-of-status", "sequence", "return Frame(data[at + 4], data[at + 5]", "return Frame(data[at + 5], data[at + 5]"),
        ("seven-bits", "sequence", "return Frame(data[at + 4],", "return Frame(data[at + 4] & 127,"),
        ("last-channel-lost", "whole", "iter_unpack(data[at + _HEAD.size : stop])", "iter_unpack(data[at + _HEAD.size : stop - 6])"),
    ),
    *_of(
        "c/arva_frame.c",
        ("no-crc", "checksum", "if (arva_crc(head + 2, body - 2) == get_uint16(head + body)) {", "if (1) {"),
        ("half-crc", "checksum", "(head + 2, body - 2) == get_uint16(head + body)", "(head + 2, body - 2) % 256 == head[body]"),
        ("crc-start", "whole", "uint32_t crc = 0xFFFF;", "uint32_t crc = 0;"),
        ("crc-short", "whole", "arva_crc(head + 2, body - 2)", "arva_crc(head + 2, body - 3)"),
        ("crc-signed", "checksum-bytes", "== get_uint16(head + body)", "== (uint16_t)(head[body] + 256 * (int8_t)head[body + 1] - (head[body] == 0))"),
        ("any-version", "version", " || (size > 2 && bytes[2] != VERSION)", ""),
        ("newer-versions", "version", "bytes[2] != VERSION", "bytes[2] < VERSION"),
        ("17-channels", "length", "bytes[3] > LENGTH(ARVA_MAX_CHANNELS)", "bytes[3] > LENGTH(ARVA_MAX_CHANNELS + 1)"),
        ("15-channels", "channels", "bytes[3] > LENGTH(ARVA_MAX_CHANNELS)", "bytes[3] > LENGTH(ARVA_MAX_CHANNELS - 1)"),
        ("any-count", "count", "return bytes[3] == LENGTH(bytes[6]) ? BYTES(bytes[6]) : 0;", "return bytes[3] + 6u;"),
        ("drops-candidate", "resync", "        decoder->dropped++;\n        at++;", "        decoder->dropped++;\n        at += need ? need : 1;"),
        ("drops-head", "sync", "        at++;\n", "        at += need == 0 && size - at > 3 && head[1] == SYNC_1 && head[2] == VERSION ? 4 : 1;\n"),
        ("synthetic-only", "unknown", "if (decoder->on_frame == NULL) {", "if (decoder->on_frame == NULL || !(bytes[5] & ARVA_SYNTHETIC)) {"),
        ("short-pause", "split", ">= ARVA_PAUSE_MS)", ">= ARVA_PAUSE_MS / 10)"),
        ("no-time", "false-head", ">= ARVA_PAUSE_MS)", ">= 1000u * ARVA_PAUSE_MS)"),
        ("old-half", "pause", ">= ARVA_PAUSE_MS)", ">= 50u * ARVA_PAUSE_MS)"),
        ("d-of-delta", "distance", "channel->d_cm = get_int16(bytes + 2);", "channel->d_cm = get_int16(bytes + 4);"),
        ("big-endian", "distance", "from[0] | (unsigned)from[1] << 8", "from[1] | (unsigned)from[0] << 8"),
        ("unsigned-byte", "delta", "channel->delta_deg = get_int16(bytes + 4);", "channel->delta_deg = bytes[4];"),
        ("stale-value", "no-signal", "        channel->d_cm = get_int16(bytes + 2);", "        static int16_t kept;\n        if (get_int16(bytes + 2) > 0) { kept = get_int16(bytes + 2); }\n        channel->d_cm = kept;"),
        ("minus-one-is-none", "delta", "        channel->delta_deg = get_int16(bytes + 4);", "        channel->delta_deg = get_int16(bytes + 4);\n        if (channel->delta_deg == -1) { channel->d_cm = -1; }"),
        ("mark-in-zone", "zones", "(uint8_t)(bytes[1] & ~MARKED)", "bytes[1]"),
        ("repeats-are-dropped-at-0", "sequence", "    decoder->good++;", "    if (decoder->counting && bytes[4] < decoder->sequence) {\n        decoder->sequence = bytes[4];\n        return;\n    }\n    decoder->good++;"),
    ),
    *_of(
        "ardupilot/arva_receiver.lua",
        ("no-crc", "checksum", "if size > 0 and crc(size) == at(size - 2) | at(size - 1) << 8 then", "if size > 0 then"),
        ("half-crc", "checksum", "crc(size) == at(size - 2) | at(size - 1) << 8", "crc(size) & 0xFF == at(size - 2)"),
        ("crc-order", "whole", "at(size - 2) | at(size - 1) << 8 then\n            deliver", "at(size - 1) | at(size - 2) << 8 then\n            deliver"),
        ("crc-off-by-one", "whole", "for k = first + 2, first + size - 3 do", "for k = first + 2, first + size - 2 do"),
        ("any-version", "version", " or (count > 2 and at(2) ~= VERSION) then", " then"),
        ("any-length", "length", "if length < LENGTH_1 or length > LENGTH_16 or length % CHANNEL_BYTES ~= 3 then", "if length < 4 then"),
        ("15-channels", "channels", "local LENGTH_16 = 99", "local LENGTH_16 = 93"),
        ("from-2-channels", "channels", "local LENGTH_1 = 9 ", "local LENGTH_1 = 15 "),
        ("small-ring", "channels", "local RING = 127", "local RING = 63"),
        ("any-count", "count", "return length == 3 + CHANNEL_BYTES * at(6) and length + 6 or 0", "return length + 6"),
        ("drops-candidate", "resync", "            self.bad_crc = self.bad_crc + (size > 0 and 1 or 0)\n            refuse()", "            self.bad_crc = self.bad_crc + (size > 0 and 1 or 0)\n            drop(size > 0 and size or 1)"),
        ("no-time", "false-head", "local PAUSE_MS = 100 ", "local PAUSE_MS = 100000 "),
        ("old-half", "pause", "local PAUSE_MS = 100 ", "local PAUSE_MS = 2000 "),
        ("delta-sign", "delta", "frame.delta[k] = int16(", "frame.delta[k] = -int16("),
        ("unsigned", "delta", "return low + 256 * (high < 128 and high or high - 256)", "return low + 256 * high"),
        ("signed-bytes", "distance", "return low + 256 * (high < 128 and high or high - 256)", "return (low < 128 and low or low - 256) + 256 * (high < 128 and high or high - 256)"),
        ("stale-value", "no-signal", "         frame.d[k] = int16(held[p + 3 & 127], held[p + 4 & 127])", "         local d = int16(held[p + 3 & 127], held[p + 4 & 127])\n         frame.d[k] = d > 0 and d or frame.d[k] or d"),
        ("mark-in-zone", "zones", "zone & 127, zone > 127", "zone, zone > 127"),
        ("channel-off-by-one", "slots", "local p = first + CHANNEL_BYTES * k\n", "local p = first + CHANNEL_BYTES * (frame.n + 1 - k)\n"),
        ("last-channel-lost", "whole", "for k = 1, frame.n do\n         local p", "frame.n = frame.n - 1\n      for k = 1, frame.n do\n         local p"),
    ),
]  # fmt: skip


def command(mutant: Mutant | None, language: str, folder: Path) -> list[str]:
    """Build a decoder in `folder`, with a mistake or without one. Returns its command."""
    copy = folder / "firmware_proto"
    shutil.copytree(WIRE, copy, ignore=shutil.ignore_patterns("__pycache__", "px4", "stm32f405"))
    if mutant is not None:
        source = copy / mutant.file
        text = source.read_text(encoding="utf-8")
        assert text.count(mutant.old) == 1, f"{mutant.name}: {text.count(mutant.old)} places"
        source.write_text(text.replace(mutant.old, mutant.new), encoding="utf-8")
    if language == "python":
        return ["env", f"PYTHONPATH={folder}", sys.executable, str(EXAMPLES / "decoder.py")]
    if language == "c":
        sources = [str(EXAMPLES / "decoder.cpp"), str(copy / "c" / "arva_frame.c")]
        built = folder / "decoder"
        warnings = ["-w"] if mutant else ["-Wall", "-Wextra", "-Werror"]
        subprocess.run(["g++", *warnings, f"-I{copy / 'c'}", *sources, "-o", str(built)], check=True)
        return [str(built)]
    return ["env", f"PYTHONPATH={ROOT}", sys.executable, "-m", "tests.bench.lua_decoder", str(copy / "ardupilot")]


def verdict(mutant: Mutant) -> Verdict:
    """Judge a mutant by its clause alone."""
    clause = next(one for one in clauses() if one.name == mutant.clause)
    with tempfile.TemporaryDirectory() as folder:
        language = mutant.name.partition("-")[0]
        return judge(clause, command(mutant, language, Path(folder)), patience_s=PATIENCE_S)


def main() -> int:
    os.chdir(ROOT)
    chosen = [one for one in MUTANTS if not sys.argv[1:] or one.name in sys.argv[1:]]
    missed = 0
    for mutant in chosen:
        why = verdict(mutant).why
        missed += not why
        print(f"{'found' if why else 'MISSED':6} {mutant.name:30} {mutant.clause:15} {why}", flush=True)
    print(f"{len(chosen)} mutants, {missed} missed")
    return 1 if missed else 0
