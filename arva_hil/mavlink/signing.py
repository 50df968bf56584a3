"""MAVLink 2 signing with one key: who is believed, and the time stamps of what goes out.

Protocol: https://mavlink.io/en/guide/message_signing.html
"""

from __future__ import annotations

import hashlib
import hmac
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final, Literal

if TYPE_CHECKING:
    from arva_hil.mavlink.codec import Packet

Verdict = Literal["", "unsigned", "forged", "replayed"]
Stream = tuple[int, int, int]  # link, system, component

_EPOCH_US: Final = 1_420_070_400_000_000  # 2015 began, in µs since 1970
_TICK_US: Final = 10
_NEW_STREAM: Final = 6_000_000  # ticks, a minute: a stream not heard before may be so far behind
LARGEST: Final = 2**48 - 1  # time stamp


def key_of(text: str) -> bytes:
    """The 32 bytes of a key written as 64 hexadecimal digits, else SHA-256 of a passphrase: what MAVProxy,
    QGroundControl and Mission Planner make of one. One line. Raises ValueError.
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
    """Time stamps [10 µs since 2015] that outlive a process: the newest of all, and the newest of each stream."""

    newest: int = 0
    streams: Mapping[Stream, int] = field(default_factory=dict)

    def with_others(self, others: KeptTimeStamps) -> KeptTimeStamps:
        """The later one of each."""
        streams = dict(others.streams)
        for stream, ticks in self.streams.items():
            streams[stream] = max(ticks, streams.get(stream, 0))
        return KeptTimeStamps(max(self.newest, others.newest), streams)

    def recent(self) -> KeptTimeStamps:
        """Without the streams that are more than a minute behind: they are as good as new ones."""
        since = self.newest - _NEW_STREAM
        return KeptTimeStamps(self.newest, {stream: ticks for stream, ticks in self.streams.items() if ticks >= since})


class Signing:
    """Remembers the newest time stamp of every stream that signed with `key` (32 bytes), and its own.

    `epoch_us`: microseconds since 1970 when the caller's clock read 0. A clock that is behind the others' takes
    theirs, and one that is behind what was `kept` of an earlier process goes on from there: what was recorded then is
    not believed. `link` tells two programs apart that speak as one component: a receiver wants the time stamps of each
    system, component and link to grow, and remembers few of them (ArduPilot 16). Counts what it `refused`, by why.
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
        """It is `now` [s]."""
        self._newest = max(self._newest, self._ticks_at_0 + int(now * 1e6) // _TICK_US)

    def kept(self) -> KeptTimeStamps:
        """What the next process with this key has to know."""
        return KeptTimeStamps(self._newest, self._streams).recent()

    def stamp(self) -> int:
        """The time stamp of the next packet to go out, in 10 µs since 2015."""
        self._newest = min(self._newest + 1, LARGEST)
        return self._newest

    def judge(self, packet: Packet) -> Verdict:
        """Why a packet is not believed; empty when it is new, and from somebody who has the key."""
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
