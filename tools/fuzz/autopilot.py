"""Sends packets and noise to the session with an autopilot, and checks that the session accepts none of them.

    python -m tools fuzz autopilot [--packets 10000000] [--random-mb 200]

Half of the packets go to a session without a key, half to one that verifies signatures. Both follow a vehicle that
continues to send, and every pose must be that vehicle's. Among the packets: valid and invalid checksums, wrong lengths,
packets of later versions, 255 systems, signatures, the vehicle's own ids from others, its clock and position far off,
values that are no pose, its own packets once more; and to the session with a key, packets that only lack the signature.
Then come random bytes. The exit code is 1 after a failure.
"""

from __future__ import annotations

import hashlib
import math
import random
import struct
import sys
import time
from collections import Counter, deque
from collections.abc import Callable, Sequence
from statistics import median
from typing import Any

from arva_hil.autopilot.following.session import Session
from arva_hil.mavlink.codec import Encoder, dialect
from arva_hil.mavlink.signing import Signing
from arva_hil.model.field import LocalFrame
from arva_hil.simulated import HOME
from tools.fuzz.script import packet
from tools.options import memory_mb, parser

OTHER_KEY = hashlib.sha256(b"theirs").digest()
LAYOUTS = {"POSITION": (33, "<IiiiihhhH"), "ATTITUDE": (30, "<Iffffff"), "QUATERNION": (31, "<Ifffffff")}
LAYOUTS |= {"BEAT": (0, "<IBBBBB"), "ACK": (77, "<HB")}
NO_PLACES = ((0, 0, 0), (910_000_000, 0, 0), (1, -(2**31), 0), (1, 1, 2**31 - 1), (460_000_000, 7, -(10**7)))
OTHER_VEHICLES = ((6, 8), (2, 8), (2, 12), (26, 3), (18, 8))


def message(kind: str, *values: float) -> tuple[int, bytes]:
    """Return id and payload."""
    msgid, layout = LAYOUTS[kind]
    return msgid, struct.pack(layout, *values)


def position(ms: int, lat: int, lon: int, alt: int) -> bytes:
    return packet(*message("POSITION", ms, lat, lon, alt, 0, 0, 0, 0, 0), (1, 1))


def unsigned(boot: float) -> bytes:
    """A message that lacks only the signature."""
    return position(round(boot * 1e3) + 1, 460_123_100, 77_456_000, 1_650_500)


class Enemy:
    """One kind as likely as another. `past`: packets of the vehicle; `signing`: it signs.

    Each kind gets the vehicle's time [s].
    """

    def __init__(self, n: random.Random, past: Sequence[bytes], *, signing: bool) -> None:
        self._n = n
        self.made: Counter[str] = Counter()
        self.kinds: dict[str, Callable[[float], bytes]] = {
            "stranger": lambda s: self._any(s, (n.randrange(2, 256), n.randrange(256)), version=n.choice((1, 2))),
            "other_component": lambda s: self._any(s, (1, n.randrange(2, 256))),
            "bad_checksum": self._bad_checksum,
            "short": self._short,
            "long": self._long,
            "later_version": lambda s: self._any(s, (1, 1), flags=n.randrange(2, 256, 2)),
            "unknown": lambda s: packet(n.randrange(60_000, 2**24), n.randbytes(n.randrange(256)), (1, 1)),
            "signed": lambda s: self._any(s, (n.randrange(2, 256), 1), flags=1) + n.randbytes(13),
            "spoofed_heartbeat": lambda s: packet(*message("BEAT", 0, *n.choice(OTHER_VEHICLES), 128, 4, 3), (1, 1)),
            "no_values": self._no_values,
            "no_place": lambda s: position(round(s * 1e3), *n.choice(NO_PLACES)),
            "odd_time": self._odd_time,
            "jump": lambda s: position(round(s * 1e3), self._far_lat(), 77_456_000, 0),
            "replayed": lambda s: n.choice(past),
        }
        if signing:
            self.kinds |= {"unsigned": unsigned, "forged": self._forged}
        self._names = list(self.kinds)

    def __call__(self, boot: float) -> bytes:
        kind = self._n.choice(self._names)
        self.made[kind] += 1
        return self.kinds[kind](boot)

    def _message(self, boot: float) -> tuple[int, bytes]:
        """Return a message that the vehicle might send, with other values."""
        n, ms = self._n, round(boot * 1e3)
        values = {
            "POSITION": (ms, n.randrange(1, 9 * 10**8), 70_000_000, 10**6, 0, 0, 0, 0, 0),
            "ATTITUDE": (ms, n.random(), 1, 2, 0, 0, 0),
            "QUATERNION": (ms, 0, 1, 0, 0, 0, 0, 0),
            "BEAT": (0, 2, 3, 128, 4, 3),
            "ACK": (511, 4),
        }
        kind = n.choice(list(values))
        return message(kind, *values[kind])

    def _any(self, boot: float, source: tuple[int, int], *, flags: int = 0, version: int = 2) -> bytes:
        return packet(*self._message(boot), source, flags=flags, version=version)

    def _bad_checksum(self, boot: float) -> bytes:
        raw = self._any(boot, (1, 1))
        return raw[:-2] + bytes((raw[-2] ^ self._n.randrange(1, 256), raw[-1]))

    def _short(self, boot: float) -> bytes:
        whole = struct.pack("<Iii", round(boot * 1e3), 460_000_000, 7)
        return packet(self._n.choice((33, 30)), whole[: self._n.randrange(12)], (1, 1), version=1)

    def _long(self, boot: float) -> bytes:
        msgid, payload = self._message(boot)
        return packet(msgid, payload + self._n.randbytes(self._n.randrange(1, 200)), (2, 1))

    def _no_values(self, boot: float) -> bytes:
        odd = self._n.choice((math.nan, math.inf, -math.inf, 1e30, 50.0))
        values = [odd if self._n.random() < 0.3 else 0.0 for _ in range(6)] + [odd]
        return packet(*message("QUATERNION", round(boot * 1e3), *values), (1, 1))

    def _odd_time(self, boot: float) -> bytes:
        ms = self._n.choice((0, 2**32 - 1, round(boot * 500), round(boot * 2e3), round(boot * 1e3) - 600))
        return packet(*message("ATTITUDE", ms, 1, 1, 1, 0, 0, 0), (1, 1))

    def _far_lat(self) -> int:
        return round((HOME[0] + self._n.choice((-1, 1)) * self._n.uniform(0.01, 40)) * 1e7)

    def _forged(self, boot: float) -> bytes:
        raw = self._any(boot + 0.001, (1, 1), flags=1) + bytes(1) + (2**47).to_bytes(6, "little")
        return raw + hashlib.sha256(OTHER_KEY + raw).digest()[:6]


FRAME = LocalFrame(*HOME)
KEY = hashlib.sha256(b"ours").digest()
STEP_S = 0.02  # between packets of the vehicle
BURST = 500  # packets of others in between
GROWTH_KB = 1024


def main() -> None:
    options = parser(
        __doc__, packets=(10_000_000, "of others"), random_mb=(200, "megabytes"), seed=(1, "of all numbers")
    ).parse_args()
    numbers = random.Random(options.seed)
    well = [throw_packets(Bench(numbers, key), options.packets // 2) for key in (None, KEY)]
    well += [throw_noise(Bench(numbers, key), options.random_mb * 500_000) for key in (None, KEY)]
    sys.exit(0 if all(well) else 1)


class Bench:
    """A session and its vehicle, which flies east at 1 m/s. Remembers the failures."""

    def __init__(self, numbers: random.Random, key: bytes | None) -> None:
        self.numbers = numbers
        self.key = key
        self.now = 1000.0
        self.wrong: Counter[str] = Counter()
        self.poses = 0
        self.past: deque[bytes] = deque(maxlen=1000)  # packets of the vehicle
        self.session = Session(target_system=1, signing=Signing(key, 1_700_000_000_000_000) if key else None)
        self._vehicle = Encoder(1, 1, signing=Signing(key, 1_700_000_000_000_000) if key else None)
        self._steps = 0
        self._tell(dialect.MAVLink_heartbeat_message(2, 3, 0, 0, 4, 3))
        self._tell(dialect.MAVLink_home_position_message(*self._place(0), 0, 0, 0, [1, 0, 0, 0], 0, 0, 0))
        assert self.session.vehicle
        for _ in range(2):
            self.fly()
        self.wrong.clear()  # of the very first position nothing is interpolated

    @property
    def boot(self) -> float:
        """The vehicle's time [s]."""
        return self.now - 900

    def fly(self) -> None:
        """Send the vehicle's position; the session must then have it."""
        self.now += STEP_S
        self._steps += 1
        ms = round(self.boot * 1e3)
        if self._steps % 50 == 0:
            self._tell(dialect.MAVLink_heartbeat_message(2, 3, 0, 0, 4, 3))
        yaw = math.remainder(self._steps * 1e-3, math.tau)
        self._tell(dialect.MAVLink_attitude_message(ms, 0.1, 0.2, yaw, 0, 0, 1e-3 / STEP_S))
        self._tell(dialect.MAVLink_global_position_int_message(ms, *self._place(self._steps), 0, 0, 100, 0, 0))
        self.session.poll(self.now)
        self._check("lost its pose")

    def hear(self, data: bytes) -> None:
        """Send packets of others; they must change nothing.

        Zeros follow, so that a false start of a packet does not delay the vehicle's next packet.
        """
        before = self.session.navigation.track.last_position, self.session.vehicle, self.session.navigation.home
        self.session.feed(data + bytes(300), self.now)
        if before != (self.session.navigation.track.last_position, self.session.vehicle, self.session.navigation.home):
            self.wrong["believed others"] += 1
        self._check("took another's pose")

    def _check(self, what: str) -> None:
        lat, lon, alt = self._place(self._steps)
        state = self.session.navigation.state_at(self.now, FRAME)
        self.poses += 1
        truth = FRAME.ned(lat / 1e7, lon / 1e7, alt / 1e3)
        if state is None or state.age_s > 2 * STEP_S or max(abs(state.position - truth)) > 0.1:
            self.wrong[what] += 1

    def _place(self, steps: int) -> tuple[int, int, int]:
        lat, lon, alt = HOME
        east = steps * STEP_S
        return round(lat * 1e7), round((lon + east / 77_300) * 1e7), round(alt * 1e3)

    def _tell(self, message: Any) -> None:
        if self.key:
            self._vehicle._signing.advance(self.now)  # type: ignore[union-attr]
        self.past.append(self._vehicle.pack(message))
        self.session.feed(self.past[-1], self.now)


def throw_packets(bench: Bench, count: int) -> bool:
    enemy = Enemy(bench.numbers, bench.past, signing=bench.key is not None)
    cost, memory = list[float](), list[int]()
    for burst in range(max(1, count // BURST)):
        data = b"".join(enemy(bench.boot) for _ in range(BURST))
        before = time.process_time()
        bench.hear(data)
        cost.append((time.process_time() - before) / len(data))
        bench.fly()
        if burst % 100 == 0:
            memory.append(round(1e3 * memory_mb()))
    print(f"{sum(enemy.made.values())} packets, {'verified' if bench.key else 'without a key'}: {dict(enemy.made)}")
    return report(bench, cost, memory)


def throw_noise(bench: Bench, size: int) -> bool:
    cost, memory, sent = list[float](), list[int](), 0
    while sent < size or not cost:
        data = bench.numbers.randbytes(bench.numbers.choice((1, 100, 10_000, 1_000_000)))
        sent += len(data)
        before = time.process_time()
        bench.hear(data)
        if len(data) > 100:
            cost.append((time.process_time() - before) / len(data))
            bench.fly()
            memory.append(round(1e3 * memory_mb()))
    print(f"{sent / 1e6:.0f} MB of random bytes, {'verified' if bench.key else 'without a key'}")
    return report(bench, cost, memory)


def report(bench: Bench, cost: list[float], memory: list[int]) -> bool:
    tenth = max(1, len(cost) // 10)
    first, last = 1e9 * median(cost[:tenth]), 1e9 * median(cost[-tenth:])
    warm = memory[len(memory) // 10 :]
    print(f"  {bench.poses} poses looked at, wrong: {dict(bench.wrong) or 0}")
    print(f"  {bench.session.counts()}")
    print(f"  per byte {first:.0f} ns in the first tenth, {last:.0f} ns in the last: {last / first:.2f} ×")
    print(f"  memory {warm[0]} kB after a tenth, {warm[-1]} kB in the end, at most {max(warm) - warm[0]:+d} kB")
    return not bench.wrong and max(warm) - warm[0] < GROWTH_KB
