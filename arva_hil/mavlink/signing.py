"""MAVLink 2 signing with one key: checks signatures, and gives the time stamps of outgoing packets.

Protocol: https://mavlink.io/en/guide/message_signing.html
"""

from __future__ import annotations

import hashlib
import hmac
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

from arva_hil.mavlink.dialect import Packet, Verdict

Stream = tuple[int, int, int]  # link, system, component

_EPOCH_US: Final = 1_420_070_400_000_000  # the start of 2015, in µs since 1970
_TICK_US: Final = 10
_NEW_STREAM: Final = 6_000_000  # ticks, 1 minute: a new stream may be this far behind
LARGEST: Final = 2**48 - 1  # the largest time stamp


def key_of(text: str) -> bytes:
    """Return the 32 bytes of a key: of 64 hexadecimal digits, or the SHA-256 of a passphrase.

    MAVProxy, QGroundControl and Mission Planner do the same. Raises ValueError if `text` is not one line.
    """
    lines = text.splitlines()
    if len(lines) != 1 or not lines[0].strip():
        raise ValueError(f"{len(lines)} lines" if len(lines) > 1 else "empty")
    line = lines[0]
    if re.fullmatch("[0-9a-fA-F]{64}", line):
        return bytes.fromhex(line)
    return hashlib.sha256(line.encode()).digest()


@dataclass(frozen=True, slots=True)
class KeptTimeStamps:
    """Time stamps [10 µs since 2015] for the next process: the newest of all, and the newest of each stream."""

    newest: int = 0
    streams: Mapping[Stream, int] = field(default_factory=dict)

    def with_others(self, others: KeptTimeStamps) -> KeptTimeStamps:
        """Return the later time stamp of each stream."""
        streams = dict(others.streams)
        for stream, ticks in self.streams.items():
            streams[stream] = max(ticks, streams.get(stream, 0))
        return KeptTimeStamps(max(self.newest, others.newest), streams)

    def recent(self) -> KeptTimeStamps:
        """Return the streams that are at most a minute behind: others are treated like new ones."""
        since = self.newest - _NEW_STREAM
        return KeptTimeStamps(self.newest, {stream: ticks for stream, ticks in self.streams.items() if ticks >= since})


class Signing:
    """Remembers the newest time stamp of every stream that is signed with `key` (32 bytes), and of its own.

    `epoch_us`: microseconds since 1970 when the caller's clock was 0. If our clock is behind another sender's, or
    behind what was `kept` of an earlier process, it continues from there: packets that were recorded then are
    refused. `link`: the link id; two programs with the same component id need different ones, because the time stamps
    of each system, component and link must increase, and receivers remember only few (ArduPilot 16). `refused`: the
    number of packets by reason.
    """

    def __init__(self, key: bytes, epoch_us: int, link: int = 0, kept: KeptTimeStamps | None = None) -> None:
        self.key = key
        self.link = link
        self.refused: dict[str, int] = {"unsigned": 0, "forged": 0, "replayed": 0}
        self._ticks_at_0 = max(0, epoch_us - _EPOCH_US) // _TICK_US
        start = KeptTimeStamps(self._ticks_at_0).with_others(kept or KeptTimeStamps()).recent()
        self._newest = start.newest
        self._streams = dict(start.streams)

    def advance(self, now: float) -> None:
        """Set the time `now` [s]."""
        self._newest = max(self._newest, self._ticks_at_0 + int(now * 1e6) // _TICK_US)

    def kept(self) -> KeptTimeStamps:
        """Return the time stamps for the next process with this key."""
        return KeptTimeStamps(self._newest, self._streams).recent()

    def stamp(self) -> int:
        """Return the time stamp of the next outgoing packet, in 10 µs since 2015."""
        self._newest = min(self._newest + 1, LARGEST)
        return self._newest

    def judge(self, packet: Packet) -> Verdict:
        """Return the reason to refuse a packet; "" if it is new and signed with the key."""
        why = self._why_not(packet)
        if why:
            self.refused[why] += 1
        return why

    def _why_not(self, packet: Packet) -> Verdict:
        if not packet.signed:
            return "unsigned"
        if not hmac.compare_digest(hashlib.sha256(self.key + packet.raw[:-6]).digest()[:6], packet.raw[-6:]):
            return "forged"
        stream = packet.raw[-13], packet.system, packet.component
        ticks = int.from_bytes(packet.raw[-12:-6], "little")
        if ticks <= self._streams.get(stream, self._newest - _NEW_STREAM - 1):
            return "replayed"
        self._streams[stream] = ticks
        self._newest = max(self._newest, ticks)
        return ""
