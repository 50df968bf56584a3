"""The common parts of all bytes on the wire, without a codec, and the frames."""

from __future__ import annotations

from typing import Any

Wire = dict[str, Any]


def crc(data: bytes) -> int:
    """CRC-16/MCRF4XX, one bit at a time."""
    register = 0xFFFF
    for byte in data:
        for bit in range(8):
            carry = (register ^ byte >> bit) & 1
            register = register >> 1 ^ 0x8408 * carry
    return register


def seal(body: bytes) -> bytes:
    """Return any bytes with sync and a right CRC, well formed or not."""
    return b"\xa4\x57" + body + crc(body).to_bytes(2, "little")


def sentence(*fields: object) -> str:
    """Return a line of NMEA."""
    text = ",".join(map(str, fields))
    checksum = 0
    for letter in text:
        checksum ^= ord(letter)
    return f"${text}*{checksum:02X}\r\n"


def number(value: int, size: int, *, signed: bool = True) -> bytes:
    return value.to_bytes(size, "little", signed=signed)


def slot(id: int | None = None, zone: int = 0, d: int = -1, delta: int = -1, marked: bool = False) -> Wire:
    return {"id": id, "zone": zone, "marked": marked, "d": d, "delta": delta}


def frame(sequence: int, status: int, *channels: Wire) -> Wire:
    return {"sequence": sequence, "status": status, "channels": list(channels)}


def binary(f: Wire) -> bytes:
    n = len(f["channels"])
    body = bytes([1, 3 + 6 * n, f["sequence"], f["status"], n])
    for c in f["channels"]:
        body += bytes([255 if c["id"] is None else c["id"], c["zone"] + 128 * c["marked"]])
        body += number(c["d"], 2) + number(c["delta"], 2)
    return seal(body)


def nmea(f: Wire) -> str:
    text = ""
    for k, c in enumerate(f["channels"]):
        id = "" if c["id"] is None else str(c["id"])
        fields = [f["sequence"], f["status"], len(f["channels"]), k + 1]
        fields += [id, c["zone"] + 128 * c["marked"], c["d"], c["delta"]]
        text += sentence("PARVA", *fields)
    return text


def line(f: Wire) -> str:
    c = min([c for c in f["channels"] if c["d"] > 0] or f["channels"][:1], key=lambda c: c["d"])
    return f"{c['d']},{c['delta']}\r\n"


def named(f: Wire) -> list[tuple[str, int]]:
    values = []
    for k, c in enumerate(f["channels"], 1):
        if k == 1 or c["d"] > 0:
            values += [(f"ARVA{k}_D", c["d"]), (f"ARVA{k}_DIR", c["delta"])]
            values += [(f"ARVA{k}_ID", 255 if c["id"] is None else c["id"])]
    return values


FRAMES: dict[str, Wire] = {
    "typical": frame(7, 1, slot(3, 2, 85, 0), slot(1, 1, 1250, -35), slot(2, 1, 4020, 17), slot()),
    "silence": frame(0, 1, slot()),
    "one": frame(1, 1, slot(1, 1, 1234, 17)),
    "two": frame(2, 1, slot(2, 1, 2200, -90)),
    "three": frame(3, 1, slot(3, 0, 5600, 179, True)),
    "seven": frame(7, 1, slot(7, 0, 7000, 0)),
    "seq_254": frame(254, 1, slot(1, 0, 100, 1)),
    "seq_255": frame(255, 1, slot(1, 0, 101, 2)),
    "seq_0": frame(0, 1, slot(1, 0, 102, 3)),
    "status_none": frame(10, 0, slot(1, 0, 1, 1)),
    "status_interference": frame(11, 3, slot(1, 0, 1, 1)),
    "status_more_transmitters": frame(12, 5, slot(1, 0, 1, 1)),
    "status_self_test_fault": frame(13, 9, slot(1, 0, 1, 1)),
    "status_unknown_bits": frame(14, 0xF1, slot(1, 0, 1, 1)),
    "status_all": frame(15, 255, slot(1, 0, 1, 1)),
    "zones": frame(20, 1, slot(1, 0, 1, 1), slot(2, 1, 2, 2), slot(3, 2, 3, 3)),
    "zones_marked": frame(21, 1, *(slot(k, k, k, k, True) for k in range(3))),
    "zone_3": frame(22, 1, slot(1, 3, 500, 0)),
    "zone_127_marked": frame(23, 1, slot(1, 127, 500, 0, True)),
    "ids": frame(24, 1, slot(0, 0, 1, 0), slot(254, 0, 2, 0), slot(None, 0, 3, 0)),
    "d_delta_low": frame(25, 1, slot(1, 0, -32768, -32768)),
    "d_delta_high": frame(26, 1, slot(1, 0, 32767, 32767)),
    "d_delta_near_zero": frame(27, 1, slot(1, 0, 0, 0), slot(2, 0, 1, -1), slot(3, 0, -1, 1), slot(4, 0, 255, 256)),
    "angles": frame(28, 1, slot(1, 0, 9, -180), slot(2, 0, 9, -179), slot(3, 0, 9, 180)),
    "equal_distance": frame(29, 1, slot(1, 0, 700, 10), slot(2, 0, 700, -10)),
    "no_signal_-1_0": frame(30, 1, slot(d=-1, delta=0), slot(2, 0, 700, 10)),
    "no_signal_0_0": frame(32, 1, slot(d=0, delta=0), slot(2, 0, 700, 10)),
    "lowest": frame(0, 0, slot(0, 0, -32768, -32768)),
    "d_low_delta_high": frame(33, 1, slot(1, 0, -32768, 32767)),
    "d_high_delta_low": frame(34, 1, slot(1, 0, 32767, -32768)),
    "lowest_16": frame(0, 0, *[slot(0, 0, -32768, -32768)] * 16),
    "silence_16": frame(35, 1, *[slot()] * 16),
    "highest": frame(255, 255, *[slot(254, 2, 32767, 32767, True)] * 16),
    "sync_inside": frame(31, 1, slot(0xA4, 0, 0x57A4, 0x0F01), slot(0x57, 1, 0x57A4, 0x6301)),
}
FRAMES |= {f"n_{n}": frame(100 + n, 1, *(slot(k, k % 3, 10 * k, -k) for k in range(n))) for n in range(1, 17)}
DECODE_ONLY = ("zone_3", "zone_127_marked")
BYTES = {name: binary(f) for name, f in FRAMES.items()}


def parts() -> list[Wire]:
    """Return the part of vectors.json about frames."""
    return [
        {"name": name, "hex": BYTES[name].hex(), "decode_only": name in DECODE_ONLY, **f}
        | ({} if name in DECODE_ONLY else {"nmea": nmea(f), "text": line(f), "named": named(f)})
        for name, f in FRAMES.items()
    ]
