"""Packets of an attacker that wants a session with a vehicle to accept false values: see autopilot.py."""

from __future__ import annotations

import hashlib
import math
import random
import struct
from collections import Counter
from collections.abc import Callable, Sequence

from arva_hil.simulated import HOME
from tools.fuzz.packets import packet

OTHER_KEY = hashlib.sha256(b"theirs").digest()
POSITION, ATTITUDE, QUATERNION, BEAT, ACK = 33, 30, 31, 0, 77
LAYOUTS = {POSITION: "<IiiiihhhH", ATTITUDE: "<Iffffff", QUATERNION: "<Ifffffff", BEAT: "<IBBBBB", ACK: "<HB"}


def payload(msgid: int, *values: float) -> bytes:
    return struct.pack(LAYOUTS[msgid], *values)


def beat(kind: int, autopilot: int, mode: int) -> bytes:
    return packet(BEAT, payload(BEAT, 0, kind, autopilot, mode, 4, 3), (1, 1))


def position(ms: int, lat: int, lon: int, alt: int) -> bytes:
    return packet(POSITION, payload(POSITION, ms, lat, lon, alt, 0, 0, 0, 0, 0), (1, 1))


class Enemy:
    """One kind as likely as another. `past`: packets of the vehicle; `signing`: it signs.

    Each kind gets the vehicle's time [s].
    """

    def __init__(self, numbers: random.Random, past: Sequence[bytes], *, signing: bool) -> None:
        self.kinds: list[Callable[[float], bytes]] = [
            self.stranger, self.other_component, self.bad_checksum, self.short, self.long, self.later_version,
            self.unknown, self.signed, self.spoofed_heartbeat, self.no_values, self.no_place, self.odd_time, self.jump,
            self.replayed,
        ]  # fmt: skip
        if signing:
            self.kinds += [self.unsigned, self.forged]
        self._n = numbers
        self._pick = numbers.choice
        self._past = past
        self.made: Counter[str] = Counter()

    def __call__(self, boot: float) -> bytes:
        kind = self._pick(self.kinds)
        self.made[kind.__name__] += 1
        return kind(boot)

    def _any(self, boot: float) -> tuple[int, bytes]:
        """Return a message that the vehicle might send, with other values."""
        n, ms = self._n, round(boot * 1e3)
        msgid = self._pick((POSITION, ATTITUDE, QUATERNION, BEAT, ACK))
        if msgid == POSITION:
            return msgid, payload(msgid, ms, n.randrange(1, 9 * 10**8), 70_000_000, 10**6, 0, 0, 0, 0, 0)
        if msgid == ATTITUDE:
            return msgid, payload(msgid, ms, n.random(), 1, 2, 0, 0, 0)
        if msgid == QUATERNION:
            return msgid, payload(msgid, ms, 0, 1, 0, 0, 0, 0, 0)
        if msgid == BEAT:
            return msgid, payload(msgid, 0, 2, 3, 128, 4, 3)
        return msgid, payload(msgid, 511, 4)

    def stranger(self, boot: float) -> bytes:
        source = self._n.randrange(2, 256), self._n.randrange(256)
        return packet(*self._any(boot), source, version=self._pick((1, 2)))

    def other_component(self, boot: float) -> bytes:
        return packet(*self._any(boot), (1, self._n.randrange(2, 256)))

    def bad_checksum(self, boot: float) -> bytes:
        raw = packet(*self._any(boot), (1, 1))
        return raw[:-2] + bytes((raw[-2] ^ self._n.randrange(1, 256), raw[-1]))

    def short(self, boot: float) -> bytes:
        msgid, payload = self._pick((POSITION, ATTITUDE)), struct.pack("<Iii", round(boot * 1e3), 460_000_000, 7)
        return packet(msgid, payload[: self._n.randrange(12)], (1, 1), version=1)

    def long(self, boot: float) -> bytes:
        msgid, payload = self._any(boot)
        return packet(msgid, payload + self._n.randbytes(self._n.randrange(1, 200)), (2, 1))

    def later_version(self, boot: float) -> bytes:
        return packet(*self._any(boot), (1, 1), flags=self._n.randrange(2, 256, 2))

    def unknown(self, boot: float) -> bytes:
        return packet(self._n.randrange(60_000, 2**24), self._n.randbytes(self._n.randrange(256)), (1, 1))

    def signed(self, boot: float) -> bytes:
        return packet(*self._any(boot), (self._n.randrange(2, 256), 1), flags=1) + self._n.randbytes(13)

    def spoofed_heartbeat(self, boot: float) -> bytes:
        return beat(*self._pick(((6, 8), (2, 8), (2, 12), (26, 3), (18, 8))), 128)

    def no_values(self, boot: float) -> bytes:
        odd = self._pick((math.nan, math.inf, -math.inf, 1e30, 50.0))
        values = [odd if self._n.random() < 0.3 else 0.0 for _ in range(6)] + [odd]
        return packet(QUATERNION, payload(QUATERNION, round(boot * 1e3), *values), (1, 1))

    def no_place(self, boot: float) -> bytes:
        places = ((0, 0, 0), (910_000_000, 0, 0), (1, -(2**31), 0), (1, 1, 2**31 - 1), (460_000_000, 7, -(10**7)))
        return position(round(boot * 1e3), *self._pick(places))

    def odd_time(self, boot: float) -> bytes:
        ms = self._pick((0, 2**32 - 1, round(boot * 500), round(boot * 2e3), round(boot * 1e3) - 600))
        return packet(ATTITUDE, payload(ATTITUDE, ms, 1, 1, 1, 0, 0, 0), (1, 1))

    def jump(self, boot: float) -> bytes:
        far = round((HOME[0] + self._pick((-1, 1)) * self._n.uniform(0.01, 40)) * 1e7)
        return position(round(boot * 1e3), far, 77_456_000, 0)

    def replayed(self, boot: float) -> bytes:
        return self._pick(self._past)

    def unsigned(self, boot: float) -> bytes:
        return position(round(boot * 1e3) + 1, 460_123_100, 77_456_000, 1_650_500)

    def forged(self, boot: float) -> bytes:
        raw = packet(*self._any(boot + 0.001), (1, 1), flags=1) + bytes(1) + (2**47).to_bytes(6, "little")
        return raw + hashlib.sha256(OTHER_KEY + raw).digest()[:6]
