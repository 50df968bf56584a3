"""The streams of frames, each with the expected output of a decoder."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from typing import Any

from tools.vectors import frames
from tools.vectors.frames import BYTES, DECODE_ONLY, FRAMES, seal


class Stream:
    """Steps with their output, then the final counters. `kind`: of the output; `units`: its bytes, by name."""

    def __init__(self, name: str, why: str, kind: str = "frames", units: Mapping[str, bytes] = frames.BYTES) -> None:
        self.value: dict[str, Any] = {"name": name, "why": why, "steps": []}
        self.kind = kind
        self.units = units
        self.fed = 0
        self.delivered: list[str] = []

    def step(self, t: float, data: bytes = b"", *names: str) -> Stream:
        self.value["steps"].append({"t": t, "hex": data.hex(), self.kind: list(names)})
        self.fed += len(data)
        self.delivered += names
        return self

    def end(self, bad_crc: int = 0, lost: int = 0, awaited: int = 0) -> dict[str, Any]:
        """`lost`: of frames alone; `awaited`: bytes that the decoder still holds."""
        dropped = self.fed - sum(len(self.units[name]) for name in self.delivered) - awaited
        counters = {"good": len(self.delivered), "bad_crc": bad_crc, "dropped": dropped}
        self.value["counters"] = counters | ({"lost": lost} if self.kind == "frames" else {})
        return self.value


JUNK = bytes(k for k in range(256) if k != 0xA4)


class Numbers:
    """The same random numbers in every Python, 0 … limit − 1."""

    def __init__(self, seed: int) -> None:
        self.state = seed

    def below(self, limit: int) -> int:
        self.state = (self.state * 6364136223846793005 + 1442695040888963407) % 2**64
        return (self.state >> 33) % limit

    def data(self, size: int) -> bytes:
        return bytes(self.below(256) for _ in range(size))


def damaged(raw: bytes, numbers: Numbers) -> bytes:
    """Return the bytes with 2 % of them dropped, changed, or with another one before them."""
    out = bytearray()
    for byte in raw:
        fate = numbers.below(150)
        if fate == 0:
            continue
        if fate == 1:
            out += numbers.data(1)
        out.append(byte ^ (1 + numbers.below(255)) if fate == 2 else byte)
    return bytes(out)


def missing(before: int, sequence: int) -> int:
    """Return the frames lost between two numbers, counted one at a time."""
    count, number = 0, (before + 1) % 256
    while sequence not in (before, number):
        count, number = count + 1, (number + 1) % 256
    return 0 if count > 16 and sequence < 16 else count


def at_once(name: str, why: str, pieces: list[tuple[bytes, str]]) -> dict[str, Any]:
    """Return a stream of pieces in one chunk: bytes, and the name of the complete frame in them or "".

    JUNK behind them settles every candidate. Each byte in no frame begins one, so those that are whole there are the
    failed CRCs, and nothing else is.
    """
    data, free, delivered = b"", [], []
    for raw, whole in [*pieces, (JUNK, "")]:
        at = raw.index(BYTES[whole]) if whole else len(raw)
        behind = at + len(BYTES[whole]) if whole else at
        free += [len(data) + k for k in range(len(raw)) if not at <= k < behind]
        data += raw
        delivered += [whole] if whole else []
    heads = [bytes([0xA4, 0x57, 1, 3 + 6 * n]) for n in range(1, 17)]
    failed = [k for k in free if data[k : k + 4] in heads and 6 * data[k + 6] + 3 == data[k + 3]]
    sequences = [FRAMES[name]["sequence"] for name in delivered]
    lost = sum(missing(a, b) for a, b in pairwise(sequences))
    return Stream(name, why).step(0, data, *delivered).end(bad_crc=len(failed), lost=lost)


def random_streams() -> list[dict[str, Any]]:
    numbers = Numbers(457)
    names = [name for name in FRAMES if name not in DECODE_ONLY]
    noise = [(numbers.data(numbers.below(60)) + BYTES[name], name) for name in names]
    made = [at_once("noise", "random bytes before each frame", noise)]
    for title, some in (("corrupt_1", ["one", "two", "three", "seven"] * 25), ("corrupt", names * 2)):
        pieces = []
        for name in some:
            raw = damaged(BYTES[name], numbers)
            pieces.append((raw, name if BYTES[name] in raw else ""))
        made.append(at_once(title, "2 % of the bytes dropped, inserted or changed: what is whole comes out", pieces))
    return made


# A frame inside the channels of another: head of 7, then 15 of the 24 payload bytes.
CARRIER = bytes([1, 27, 50, 1, 4]) + BYTES["one"] + bytes(9)
FALSE = bytes.fromhex("A4570163")  # the head of a 105-byte frame
FALSE_LONG = FALSE + bytes.fromhex("000010")  # and its n says so too


def misread(raw: bytes, sent: int, read: int) -> bytes:
    """Return the bytes that a UART reads from `raw` if bits last `sent` on the line and `read` for the UART."""
    line = []
    for byte in raw:
        line += [0] * sent + [byte >> bit & 1 for bit in range(8) for _ in range(sent)] + [1] * sent
    out, at, idle = bytearray(), 0, [1] * 10 * read
    line += idle
    while 0 in line[at:]:
        at = line.index(0, at)
        bits = [(line + idle)[at + read // 2 + read * (1 + bit)] for bit in range(8)]
        out.append(sum(bit << k for k, bit in enumerate(bits)))
        at += read * 9 + read // 2
    return bytes(out)


def streams() -> list[dict[str, Any]]:
    one, two, three, seven = (BYTES[name] for name in ("one", "two", "three", "seven"))
    n_4, n_16 = BYTES["n_4"], BYTES["n_16"]
    made = [
        Stream("whole", "a frame in one piece").step(0, one, "one").end(),
        Stream("glued", "frames without a byte between")
        .step(0, one + n_16 + two, "one", "n_16", "two")
        .end(lost=116 - 1 - 1),
        Stream("cut", "frames cut across calls")
        .step(0, one + two[:1], "one")
        .step(0.001, two[1:14])
        .step(0.002, two[14:] + three, "two", "three")
        .end(),
        Stream("far_apart", "silence between frames is not a fault").step(0, one, "one").step(100000, two, "two").end(),
        Stream("junk", "bytes before, between and after").step(0, JUNK + one + JUNK + two + JUNK, "one", "two").end(),
        Stream("sync_pieces", "each beginning of a head, and then not one")
        .step(0, b"\xa4" + one, "one")
        .step(1, b"\xa4\x57" + two, "two")
        .step(2, b"\xa4\x57\x01" + three, "three")
        .step(3, b"\xa4\xa4\xa4\x57\xa4" + seven, "seven")
        .end(lost=3),
        Stream("sync_cut", "the two sync bytes in two calls, a lone first one before")
        .step(0, b"\xa4")
        .step(0.01, b"\xa4")
        .step(0.02, one[1:], "one")
        .end(),
        Stream("sync_inside", "sync bytes and heads in the payload of a good frame")
        .step(0, BYTES["sync_inside"] + one, "sync_inside", "one")
        .end(),
        Stream("frame_inside_bad", "a whole frame inside one whose CRC fails: only one byte was dropped")
        .step(0, seal(CARRIER)[:-1] + bytes([seal(CARRIER)[-1] ^ 1]), "one")
        .end(bad_crc=1),
        Stream("false_head", "A4 57 01 63 before a frame: byte 6 is not 16").step(0, FALSE + one, "one").end(),
        Stream("false_head_1_hz", "the false head each second, alone; the frame 0.5 s later")
        .step(0, FALSE)
        .step(0.5, one, "one")
        .step(1.0, FALSE)
        .step(1.5, two, "two")
        .step(2.0, FALSE)
        .end(awaited=4),
        Stream("false_long_head", "a false head with a right n hides the frame behind it for 100 ms")
        .step(0, FALSE_LONG + one)
        .step(0.099)
        .step(0.101, b"", "one")
        .end(),
        Stream("false_long_head_then_frame", "the next call is told the time first, then the bytes")
        .step(0, FALSE_LONG + one)
        .step(1.0, two, "one", "two")
        .end(),
        Stream("false_long_head_fills", "98 bytes later it is whole, its CRC is wrong, and all in it comes out")
        .step(0, FALSE_LONG + one * 6 + n_16[:7])
        .step(0.01, n_16[7:8], *["one"] * 6)
        .step(0.02, n_16[8:], "n_16")
        .end(bad_crc=1, lost=114),
        Stream("two_false_long_heads", "one expires, the other is as old and goes with it")
        .step(0, FALSE_LONG + FALSE_LONG + one)
        .step(0.101, b"", "one")
        .end(),
        Stream("second_false_head_is_younger", "each candidate has the age of its own first byte")
        .step(0, FALSE_LONG)
        .step(0.06, FALSE_LONG + one)
        .step(0.11)
        .step(0.159)
        .step(0.161, b"", "one")
        .end(),
        Stream("pause_99_ms", "a frame that takes 99 ms is good").step(0, one[:8]).step(0.099, one[8:], "one").end(),
        Stream("pause_101_ms", "one that takes 101 ms is not, though all its bytes come")
        .step(0, one[:8])
        .step(0.101, one[8:])
        .end(),
        Stream("age_of_the_first_byte", "more bytes do not make a candidate younger")
        .step(0, one[:3])
        .step(0.06, one[3:9])
        .step(0.12, one[9:])
        .end(),
        Stream("behind_an_expired_head", "50 ms old when the false head goes, so it may still be completed")
        .step(0, FALSE_LONG)
        .step(0.06, one[:8])
        .step(0.11, one[8:], "one")
        .end(),
        Stream("no_second_life", "the false head's end does not make the candidate behind it younger")
        .step(0, FALSE_LONG)
        .step(0.06, one[:8])
        .step(0.11)
        .step(0.165, one[8:])
        .end(),
        Stream("torn", "the head of a frame, then a whole shorter one, then silence")
        .step(0, n_4[:10] + one)
        .step(0.101, b"", "one")
        .end(),
        Stream("torn_busy", "the same with more frames behind: no need to wait")
        .step(0, n_4[:10] + one + two + three, "one", "two", "three")
        .end(bad_crc=1),
        Stream("truncated", "a frame that never ends")
        .step(0, n_16[:-1])
        .step(0.05)
        .step(0.101)
        .step(1.0, one, "one")
        .end(),
        Stream("lost_byte", "one byte missing in the middle")
        .step(0, n_4[:20] + n_4[21:] + one + two, "one", "two")
        .end(bad_crc=1),
        Stream("over_long", "one byte too many in the middle")
        .step(0, n_4[:20] + b"\x00" + n_4[20:] + one, "one")
        .end(bad_crc=1),
        Stream("version", "versions 0 and 2 with a right CRC")
        .step(0, seal(b"\x00" + one[3:-2]) + seal(b"\x02" + two[3:-2]))
        .step(0.001, three, "three")
        .end(),
        Stream("n_0", "no channels, CRC right").step(0, seal(bytes([1, 3, 9, 1, 0])) + one, "one").end(),
        Stream("n_17", "17 channels, length 105, CRC right")
        .step(0, seal(bytes([1, 105, 9, 1, 17]) + bytes(102)) + one, "one")
        .end(),
        Stream("length", "a length that is not 3 + 6 n is refused with its own byte")
        .step(0, b"\xa4\x57\x01\x0a" + one[:8])
        .step(0.001, one[8:], "one")
        .end(),
        Stream("n_not_length", "n that is in range but not the length's, CRC right")
        .step(0, seal(bytes([1, 15, 9, 1, 1]) + bytes(12)) + one, "one")
        .end(),
        Stream("crc_swapped", "the CRC with its bytes the wrong way round")
        .step(0, n_4[:-2] + n_4[:-3:-1] + one, "one")
        .end(bad_crc=1),
        Stream("repeated", "the same frame twice is not a gap").step(0, one + one, "one", "one").end(),
        Stream("wrap", "255 is followed by 0; then 2, 4, 5 and 6 are missing")
        .step(0, BYTES["seq_254"] + BYTES["seq_255"], "seq_254", "seq_255")
        .step(1, BYTES["seq_0"] + one, "seq_0", "one")
        .step(2, three, "three")
        .step(3, seven, "seven")
        .end(lost=4),
        Stream("restart", "below 16 where more than 16 would be missing: a receiver that counts from 0 again")
        .step(0, seven + BYTES["sync_inside"], "seven", "sync_inside")
        .step(5, BYTES["seq_0"] + one, "seq_0", "one")
        .step(10, BYTES["n_16"], "n_16")
        .step(15, BYTES["status_all"], "status_all")
        .end(lost=(31 - 7 - 1) + (116 - 1 - 1)),
        Stream("no_restart", "16 missing before 15, and 17 or more before 16 and above, are lost frames")
        .step(0, BYTES["seq_254"] + BYTES["status_all"], "seq_254", "status_all")
        .step(1, BYTES["n_4"] + BYTES["zones"], "n_4", "zones")
        .end(lost=16 + (104 - 15 - 1) + (20 - 104) % 256 - 1),
        Stream("unknown_zone", "a zone that is not known is no reason to drop a good frame")
        .step(0, BYTES["zone_3"] + BYTES["zone_127_marked"], "zone_3", "zone_127_marked")
        .end(),
    ]
    heads = [b"\xa4\x57\x01" + bytes([value]) for value in range(256) if value % 6 != 3 or not 9 <= value <= 99]
    made += [
        Stream("versions", "every version that is not 1")
        .step(0, b"".join(b"\xa4\x57" + bytes([k]) for k in range(256) if k != 1) + one, "one")
        .end(),
        Stream("lengths", "every length that is not 3 + 6 n").step(0, b"".join(heads) + one, "one").end(),
        Stream("channels", "every n that is not the length's")
        .step(0, b"".join(one[:6] + bytes([k]) for k in range(256) if k != 1) + two, "two")
        .end(),
        Stream("sync_only", "nothing but sync bytes before a frame")
        .step(0, b"\xa4" * 300 + b"\x57" * 300 + b"\xa4\x57" * 150 + one, "one")
        .end(),
        Stream("false_long_heads", "fifteen; three fill up, the others expire together")
        .step(0, FALSE_LONG * 15 + one)
        .step(0.099)
        .step(0.101, b"", "one")
        .end(bad_crc=3),
        Stream("unplugged", "in the middle of a frame, and plugged in again in the middle of another")
        .step(0, n_16[:50])
        .step(5, n_16[70:])
        .step(6, one, "one")
        .end(),
        Stream("9600_read_at_115200", "the wrong speed, then the right one")
        .step(0, misread(one + n_4, 12, 1))
        .step(1, one, "one")
        .end(),
        Stream("115200_read_at_9600", "the wrong speed the other way round")
        .step(0, misread((one + n_4) * 5, 1, 12))
        .step(1, one, "one")
        .end(),
    ]
    made += random_streams()
    missing, inserted = Stream("missing_byte", "each in turn, a good frame behind"), Stream("inserted_byte", "likewise")
    for k in range(len(one)):
        missing.step(k, one[:k] + one[k + 1 :] + two, "two")
        inserted.step(k, one[:k] + b"\x00" + one[k:] + two, *["one", "two"] if k == 0 else ["two"])
    made.append(missing.end(bad_crc=len(one) - 4))  # sync, version and length are refused before
    made.append(inserted.end(bad_crc=len(one) - 5))  # one is whole; sync, length and n are refused before
    single = Stream("byte_by_byte", "one byte a call")
    for k, byte in enumerate(one):
        single.step(round(0.001 * k, 3), bytes([byte]), *(["one"] if k == 14 else []))
    made.append(single.end())

    flipped = Stream("flipped_bits", "every single bit of a frame, each followed by a good one")
    for k in range(8 * len(one)):
        bad = bytearray(one)
        bad[k // 8] ^= 1 << k % 8
        flipped.step(k, bytes(bad) + two, "two")
    made.append(flipped.end(bad_crc=8 * (len(one) - 5)))  # sync, version, length and n are refused before
    return made
