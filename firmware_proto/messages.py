"""Version 2 of the protocol: messages between the frames of version 1, with the same framing. See PROTOCOL.md."""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from typing import Final, Generic, NamedTuple, TypeVar

from fastcrc import crc16

from firmware_proto.frame import Pending

T = TypeVar("T")

VERSION: Final = 2
MAX_MESSAGE_BYTES: Final = 255

_SYNC: Final = b"\xa4\x57"
_BEGIN: Final = _SYNC[0]  # it occurs only as the first byte of a message and in its CRC
_HEAD_BYTES: Final = 6  # including the kind
_CANDIDATE: Final = re.compile(rb"\xa4(?:\Z|\x57)")


class Kind(NamedTuple, Generic[T]):
    """One kind of message. `lengths`: of its body; `parse`: the message in a body, None if the body is invalid."""

    lengths: frozenset[int]
    parse: Callable[[bytes], T | None]


def seal(kind: int, body: bytes) -> bytes:
    """Return a message: A4 57, version, length, mask, then kind and body, each byte XORed with the mask, and the CRC.

    The mask is the lowest that makes no byte A4, so decoders of version 1 find no head in a message. Raises ValueError
    if the body is too long.
    """
    plain = bytes([kind]) + body
    if len(plain) + 7 > MAX_MESSAGE_BYTES:
        raise ValueError(f"a body of {len(body)} bytes, expected {MAX_MESSAGE_BYTES - 8} at most")
    present = set(plain)
    mask = next(mask for mask in range(256) if mask ^ _BEGIN not in present and mask != _BEGIN)
    sealed = bytes([VERSION, len(plain) + 1, mask]) + bytes([byte ^ mask for byte in plain])
    return _SYNC + sealed + crc16.mcrf4xx(sealed).to_bytes(2, "little")


class StreamDecoder(ABC, Generic[T]):
    """The base of decoders of messages: `feed` takes bytes and returns messages. Wrong bytes are counted, not raised.

    Counters: `good` (messages delivered), `bad_crc` (candidates whose checksum failed) and `dropped` (bytes in no
    message that this decoder delivers).
    """

    def __init__(self) -> None:
        self.good = 0
        self.bad_crc = 0
        self.dropped = 0

    @abstractmethod
    def feed(self, chunk: bytes, now: float) -> list[T]:
        """Return the messages completed by `chunk`, which may be empty or cut anywhere.

        `now`: arrival of the chunk, in seconds of any clock that never goes back.
        """


class MessageDecoder(StreamDecoder[T]):
    """Incremental decoder of messages of some `kinds`. Other messages and frames of version 1 count as dropped bytes.

    As in the decoder of frames, only the first byte of a false candidate is dropped, and a candidate that is incomplete
    100 ms after its first byte is false.
    """

    def __init__(self, kinds: Mapping[int, Kind[T]]) -> None:
        super().__init__()
        self._kinds = kinds
        self._pending = Pending()

    def feed(self, chunk: bytes, now: float) -> list[T]:
        """Return the messages completed by `chunk`, or by the end of a false candidate's 100 ms. See StreamDecoder."""
        found: list[T] = []
        if not chunk and not self._pending:
            return found
        given_up = self._pending.feed(chunk, now, lambda data, at: self._scan(data, at, found))
        self.dropped += given_up  # after the scan, which counts too
        return found

    def _scan(self, data: bytes, at: int, found: list[T]) -> int:
        """Append the messages in `data[at:]`. Returns the start of the incomplete candidate, or the end of the data."""
        end = len(data)
        while candidate := _CANDIDATE.search(data, at):
            self.dropped += candidate.start() - at
            at = candidate.start()
            size = self._size(data, at)
            if size > end - at:
                return at
            if size:
                stop = at + size - 2
                if crc16.mcrf4xx(data[at + 2 : stop]) == data[stop] | data[stop + 1] << 8:
                    if (message := self._content(data, at, stop)) is not None:
                        found.append(message)
                        self.good += 1
                        at += size
                        continue
                else:
                    self.bad_crc += 1
            self.dropped += 1
            at += 1
        self.dropped += end - at
        return end

    def _size(self, data: bytes, at: int) -> int:
        """Return the size of the candidate at `at` by its head; 0 for a false one. It may exceed the data."""
        there = len(data) - at
        if there > 2 and data[at + 2] != VERSION:
            return 0
        if there < _HEAD_BYTES:
            return _HEAD_BYTES
        kind = self._kinds.get(data[at + 5] ^ data[at + 4])
        return data[at + 3] + 6 if kind and data[at + 3] - 2 in kind.lengths else 0

    def _content(self, data: bytes, at: int, stop: int) -> T | None:
        """Return the content of the complete candidate at `at`, whose CRC is at `stop`; None if it is invalid."""
        mask = data[at + 4]
        body = bytes([byte ^ mask for byte in data[at + _HEAD_BYTES : stop]])
        return self._kinds[data[at + 5] ^ mask].parse(body)
