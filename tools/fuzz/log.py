"""Telemetry logs whose clocks step, that are cut, torn and of other layouts."""

from __future__ import annotations

import struct
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

from arva_hil.links.tlog import TlogReader
from arva_hil.links.tlog_timeline import Record, Timeline
from arva_hil.mavlink.codec import Encoder, Parser, dialect
from tools.fuzz.script import ROOT

_FOLDER: Final = tempfile.TemporaryDirectory(prefix="arva-fuzz-")
_FILE: Final = Path(_FOLDER.name, "f.tlog")
_START_US: Final = 1_700_000_000_000_000
_DAY_US: Final = 86_400_000_000
_BACK_US: Final = 1_000_000  # a time line goes back no further
_LAYOUTS: Final = (">Q", "<Q", "")
_STEPS_US: Final = (
    20_000, 0, -500, 1_000_000, -1_500_000, 4_000_000, -78_000_000, 3_500_000_000, -3_600_000_000, 23 * 3_600_000_000,
    30 * _DAY_US, -30 * _DAY_US, -_START_US, _START_US,
)  # fmt: skip


def fuzz(data: bytes) -> None:
    """Check that all of a log is read, in order, and that its time line is continuous."""
    written = _written(data)
    _FILE.write_bytes(written)
    reader = TlogReader(_FILE)
    records = list(reader)
    heads = {True: 8, False: 0}[reader.stamped]
    assert sum(heads + len(record.raw) for record in records) + reader.skipped + reader.torn == len(written)
    assert (reader.records, reader.consumed) == (len(records), len(written))
    at = 0
    for record in records:
        at = written.find(record.raw, at)
        assert at >= 0, "not in the file, or not in its order"
        at += len(record.raw)
    line = Timeline(iter(records), stamped=reader.stamped)
    placed = list(line)
    assert [record.raw for record in placed] == [record.raw for record in records], "the time line lost a record"
    _goes_on(placed)
    again = TlogReader(_FILE)
    assert list(Timeline(again, stamped=again.stamped)) == placed, "another time line at the second reading"
    parser = Parser()
    for record in placed:
        parser.feed(record.raw)


def _goes_on(placed: list[Record]) -> None:
    """Never back by more than a second, never on by more than a day."""
    latest = placed[0].time_us if placed else 0
    for record in placed:
        assert record.time_us >= latest - _BACK_US, f"back by {(latest - record.time_us) / 1e6} s"
        assert record.time_us <= latest + _DAY_US + _BACK_US, f"on by {(record.time_us - latest) / 1e6} s"
        latest = max(latest, record.time_us)


def _written(data: bytes) -> bytes:
    """A log by the story in `data`: a byte says what comes next. One that begins with 0xFF is the file itself."""
    if data[:1] == b"\xff":
        return data[1:]
    layout = _LAYOUTS[data[0] % 3] if data else ">Q"
    vehicles = [Encoder(1, 1), Encoder(2, 1)]
    boot_ms, time_us, out = [60_000, 5_000], _START_US, bytearray()
    for at, byte in enumerate(data[1:], 1):
        kind, value = byte % 8, byte // 8
        who = value % 2
        if kind < 4:  # the vehicle goes on
            time_us += 20_000 * kind
            boot_ms[who] = (boot_ms[who] + 20 * kind) % 2**32
            out += struct.pack(layout, time_us) if layout else b""
            out += vehicles[who].pack(_message(value, boot_ms[who]))
        elif kind == 4:  # the log's clock is set
            time_us = (time_us + _STEPS_US[value % len(_STEPS_US)]) % 2**63
        elif kind == 5:  # the vehicle reboots, or its clock leaps
            boot_ms[who] = (0, 100, boot_ms[who] + 41_000, boot_ms[who] + 3_600_000)[value % 4] % 2**32
        elif kind == 6:  # garbage
            out += data[at : at + value]
        else:  # cut
            del out[len(out) - value :]
    return bytes(out)


def _message(value: int, boot_ms: int) -> Any:
    if value % 3 == 0:
        return dialect.MAVLink_heartbeat_message(2, 3, 0, 0, 4, 3)
    if value % 3 == 1:
        return dialect.MAVLink_attitude_message(boot_ms, 0.1, 0.2, 0.3, 0, 0, 0)
    return dialect.MAVLink_global_position_int_message(boot_ms, 460_000_000, 70_000_000, 10**6, 0, 0, 0, 0, 0)


def seeds() -> Iterator[bytes]:
    for path in sorted(ROOT.glob("tests/data/*.tlog")):
        yield b"\xff" + path.read_bytes()[:3000]
        yield b"\xff" + path.read_bytes()[100:2000]
    going = bytes([1, 9, 17, 25] * 12)
    for layout in range(3):
        yield bytes([layout]) + going
        for step in range(len(_STEPS_US)):
            yield bytes([layout]) + going + bytes([4 + 8 * step]) + going
        for leap in range(4):
            yield bytes([layout]) + going + bytes([5 + 16 * leap]) + going
        yield bytes([layout]) + going + bytes([6 + 8 * 20]) + going + bytes([7 + 8 * 9]) + going
