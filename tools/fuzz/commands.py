"""Commands and answers: every output was sent, and comes out again if it is sent back."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from typing import Any, Final

from arva_hil import registry
from firmware_proto import Command, CommandAnswer
from firmware_proto.commands import NAMES, RESULTS
from firmware_proto.messages import StreamDecoder
from tools.fuzz.script import Script, fed, scripted

_HOSTS: Final = (registry.FORMATS["binary"].host, registry.FORMATS["nmea"].host)


def fuzz(data: bytes) -> None:
    """Which form and way, then chunks."""
    s = Script(data)
    kind = s.number() % 4
    host = _HOSTS[kind // 2]
    make, write = (host.commands, host.command) if kind % 2 == 0 else (host.answers, host.answer)
    whole: StreamDecoder[Any] = make()
    piecemeal: StreamDecoder[Any] = make()
    got: list[Any] = []
    total, now = 0, 0.0
    for now, chunk in s.chunks():
        total += len(chunk)
        got += fed(whole, piecemeal, chunk, now)
        assert whole.dropped <= total, "bytes counted twice"
    assert whole.feed(b"", now + 1000) == piecemeal.feed(b"", now + 1000)
    counts = [(one.good, one.bad_crc, one.dropped) for one in (whole, piecemeal)]
    assert counts[0] == counts[1], "chunking matters to the counters"
    for one in got:
        raw = write(one)
        assert make().feed(raw, 0.0) == [one], f"{one} does not come back"
        if kind < 2:
            assert raw[5] ^ raw[4] in (16, 17)
            assert 0xA4 not in raw[1:-2]


def seeds() -> Iterator[bytes]:
    asked = [Command(k, name, values) for k, name in enumerate(NAMES) for values in ((), (k,), (-(2**31), 0xA4, 1, 2))]
    answers = [CommandAnswer(k, name, RESULTS[k % 4], (k,), "a text" * (k % 3)) for k, name in enumerate(NAMES)]
    for kind in range(4):
        write: Callable[[Any], bytes] = _HOSTS[kind // 2].command if kind % 2 == 0 else _HOSTS[kind // 2].answer
        every: list[Any] = list(asked if kind % 2 == 0 else answers)
        for first, second in itertools.pairwise(every):
            data = write(first) + write(second)
            yield bytes([kind]) + scripted([data[:5], data[5:20], data[20:]], pause=3)
            yield bytes([kind, 0, 5]) + b"\xa4\x57\x02\x08\x00" + bytes([1, len(data)]) + data
