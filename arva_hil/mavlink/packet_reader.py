"""From bytes to packets: MAVLink 1 and 2.

The stream is split here, because the next complete packet must be found after any garbage.
Protocol: https://mavlink.io/en/guide/serialization.html
"""

from __future__ import annotations

import re
import struct
from collections.abc import Hashable
from typing import Final

from fastcrc import crc16

from arva_hil.mavlink.dialect import CRC_EXTRA, Packet, length_v1
from arva_hil.mavlink.signing import Signing

_MAGIC_V1: Final = 0xFE
_MAGIC_V2: Final = 0xFD
_MAGIC: Final = re.compile(b"[\xfd\xfe]")
_SIGNED: Final = 0x01  # the only known incompatibility flag; a packet with another one must be dropped
_SIGNATURE_BYTES: Final = 13
_HEAD_V2: Final = struct.Struct("<BBBxxBBI")  # magic, length, incompatibility flags, ids, message id and one more byte
_HEAD_V2_BYTES: Final = _HEAD_V2.size
_head, _extra, _checksum = _HEAD_V2.unpack_from, CRC_EXTRA.get, crc16.mcrf4xx  # looked up once, not for each packet
_MOST_RESTS: Final = 8  # senders of which a part of a packet is kept


def usual_packet(data: bytes, at: int) -> Packet | None:
    """Return the packet at `at`, if it is MAVLink 2, complete, known and correct, as nearly all are; else None."""
    if len(data) - at < _HEAD_V2_BYTES:
        return None
    magic, length, flags, system, component, msgid = _head(data, at)
    extra = _extra(msgid := msgid & 0xFFFFFF)
    if magic != _MAGIC_V2 or flags > _SIGNED or extra is None:
        return None
    crc_at = at + 10 + length
    stop = crc_at + (2 + _SIGNATURE_BYTES if flags else 2)
    if stop > len(data) or _checksum(data[at + 1 : crc_at] + extra) != data[crc_at] | data[crc_at + 1] << 8:
        return None
    return Packet(data[at:stop], system, component, msgid)


class Parser:
    """Splits a stream into MAVLink packets. Remembers the incomplete packet of each sender.

    Counters: `packets`; `bad_crc`: candidates with a wrong checksum; `skipped`: bytes that belong to no packet;
    `incompatible`: packets of a later MAVLink, which must be dropped; `malformed`: too short MAVLink 1 packets.
    """

    def __init__(self) -> None:
        self.packets = 0
        self.bad_crc = 0
        self.skipped = 0
        self.incompatible = 0
        self.malformed = 0
        self._rests: dict[Hashable, bytes] = {}  # by sender; the newest sender is at the end
        self._good_at = -1  # the position of a packet in the present data that was verified in advance

    def feed(self, chunk: bytes, sender: Hashable = None, *, whole: bool = False) -> list[Packet]:
        """Return the packets completed by `chunk`, which may be cut anywhere. Never raises.

        `sender`: one of several on the link; their bytes are never joined. `whole`: no packet continues in the next
        chunk, as in a record of a log; the header of a longer packet is then a false one.
        """
        data = self._rests.pop(sender, b"") + chunk if self._rests else chunk
        packets: list[Packet] = []
        at, end = 0, len(data)
        self._good_at = -1
        while at < end:
            if (packet := usual_packet(data, at)) is not None:
                packets.append(packet)
                at += len(packet.raw)
                continue
            size = _size(data, at)
            if at + size <= end:
                packet = self._candidate(data, at, size) if size else None
            elif whole or self._is_false_head(data, at):
                packet = None
            else:
                break
            if packet is not None:
                if packet.version == 2 and packet.raw[2] > _SIGNED:
                    self.incompatible += 1
                    self.skipped += size
                else:
                    packets.append(packet)
                at += size
                continue
            found = _MAGIC.search(data, at + 1)
            following = found.start() if found else end
            self.skipped += following - at
            at = following
        if at < end:
            self._keep(data[at:], sender)
        self.packets += len(packets)
        return packets

    def cut(self) -> None:
        """Handle an interruption of the stream: incomplete packets will never be completed."""
        self.skipped += sum(map(len, self._rests.values()))
        self._rests.clear()

    def _keep(self, rest: bytes, sender: Hashable) -> None:
        """Remember an incomplete packet. If there are too many senders, forget the one that was silent for longest."""
        if len(self._rests) >= _MOST_RESTS:
            self.skipped += len(self._rests.pop(next(iter(self._rests))))
        self._rests[sender] = rest

    def _candidate(self, data: bytes, at: int, size: int) -> Packet | None:
        """Return the candidate at `at` as a packet; None if it is none.

        The checksum of an unknown message id cannot be verified. Such a candidate is accepted only if the next byte, if
        any, starts a packet, if no verified packet starts inside it, and if its flags are known.
        """
        raw, msgid = data[at : at + size], _msgid(data, at)
        later = raw[0] == _MAGIC_V2
        system, component = raw[5:7] if later else raw[3:5]
        assert msgid is not None
        if msgid not in CRC_EXTRA:
            behind = data[at + size : at + size + 1]
            if behind not in (b"", b"\xfd", b"\xfe") or self._is_false_head(data, at):
                return None
        elif not _is_good(data, at, msgid):
            self.bad_crc += 1
            return None
        self.malformed += not later and msgid in CRC_EXTRA and raw[1] < length_v1(msgid)
        return Packet(raw, system, component, msgid)

    def _is_false_head(self, data: bytes, at: int) -> bool:
        """Return True if the header at `at` is certainly false.

        Its message id is unknown, and a verified packet starts before its own would end, or its flags are unknown too.
        """
        if (msgid := _msgid(data, at)) is None or msgid in CRC_EXTRA:
            return False
        if data[at] == _MAGIC_V2 and data[at + 2] > _SIGNED:
            return True
        stop = at + _size(data, at)
        if self._good_at <= at:  # no later packet was found yet
            self._good_at = _first_good(data, at + 1, stop)
        return at < self._good_at < stop


class PacketReader:
    """Remembers the parsers of one link and the number of bytes. Serves all sessions on the link.

    `signing`: packets are checked with it.
    """

    def __init__(self, signing: Signing | None = None) -> None:
        self.parser = Parser()
        self.signing = signing
        self.bytes = 0
        self._strangers = Parser()

    def feed(
        self, chunk: bytes, now: float, sender: Hashable = None, *, stranger: bool = False, whole: bool = False
    ) -> list[Packet]:
        """Return the packets completed by a chunk: see `Parser.feed`.

        `stranger`: the sender is none of those accepted. Its bytes are not counted and its signatures not checked.
        """
        if stranger:
            return self._strangers.feed(chunk, sender)
        self.bytes += len(chunk)
        packets = self.parser.feed(chunk, sender, whole=whole)
        if self.signing is None:
            return packets
        self.signing.advance(now)
        return [packet._replace(refused=self.signing.judge(packet)) for packet in packets]


def _size(data: bytes, at: int) -> int:
    """Return size [bytes] of the packet at `at`, 0 if there is none; of a header, if the header is incomplete."""
    magic = data[at]
    if magic == _MAGIC_V2:
        if at + 3 > len(data):
            return 12
        return data[at + 1] + (12 + _SIGNATURE_BYTES if data[at + 2] & _SIGNED else 12)
    if magic == _MAGIC_V1:
        return data[at + 1] + 8 if at + 2 <= len(data) else 8
    return 0


def _msgid(data: bytes, at: int) -> int | None:
    """Return the message id of the packet at `at`; None if its header is incomplete."""
    if data[at] == _MAGIC_V1:
        return data[at + 5] if at + 6 <= len(data) else None
    return data[at + 7] | data[at + 8] << 8 | data[at + 9] << 16 if at + 10 <= len(data) else None


def _first_good(data: bytes, start: int, stop: int) -> int:
    """Return the position of the first complete packet with a correct checksum in [start, stop), or -1."""
    for found in _MAGIC.finditer(data, start, stop):
        at = found.start()
        msgid = _msgid(data, at)
        if msgid in CRC_EXTRA and at + _size(data, at) <= len(data) and _is_good(data, at, msgid):
            return at
    return -1


def _is_good(data: bytes, at: int, msgid: int) -> bool:
    """Return True if the checksum of the complete candidate at `at`, a known message, is correct."""
    crc_at = at + data[at + 1] + (10 if data[at] == _MAGIC_V2 else 6)
    return bool(crc16.mcrf4xx(data[at + 1 : crc_at] + CRC_EXTRA[msgid]) == data[crc_at] | data[crc_at + 1] << 8)
