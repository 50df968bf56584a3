"""Telemetry logs: what is a record, what is garbage, and playing one back."""

from __future__ import annotations

import os
import random
import tracemalloc
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import HealthCheck, assume, example, given, settings
from hypothesis import strategies as st

from arva_hil.clock import StepClock
from arva_hil.links import Link, LinkEnded, LinkError
from arva_hil.links import tlog as tlog_module
from arva_hil.links.tlog import TlogLink, TlogReader, tlog_record
from arva_hil.links.tlog_timeline import Record
from tests.every import every

T0_US = 1_700_000_000_123_457  # an odd number of microseconds: a float of seconds does not hold it exactly
DAY_US = 86_400_000_000


def packet(version: int, payload: int, *, signed: bool = False, fill: int = 7) -> bytes:
    """Something as long as its header says."""
    if version == 1:
        return bytes([0xFE, payload]) + bytes([fill]) * (payload + 6)
    head = bytes([0xFD, payload, 1 if signed else 0])
    return head + bytes([fill]) * (payload + 9 + (13 if signed else 0))


def records(count: int, start_us: int = T0_US) -> list[Record]:
    numbers = random.Random(count)
    made = []
    for i in range(count):
        raw = packet(1 + i % 2, numbers.randrange(256), signed=i % 3 == 0, fill=i % 251)
        made.append(Record(start_us + 1_003 * i, raw))
    return made


def encode(*parts: bytes | Record | list[Record]) -> bytes:
    data = b""
    for part in parts:
        if isinstance(part, bytes):
            data += part
        elif isinstance(part, Record):
            data += tlog_record(*part)
        else:
            data += encode(*part)
    return data


@pytest.fixture
def read(tmp_path: Path) -> Callable[[bytes], tuple[list[Record], TlogReader]]:
    def go(data: bytes) -> tuple[list[Record], TlogReader]:
        (path := tmp_path / "x.tlog").write_bytes(data)
        reader = TlogReader(path)
        found = list(reader)
        assert reader.records == len(found)
        assert reader.consumed == reader.size == len(data)
        stamps = 8 * len(found) if reader.stamped else 0
        assert stamps + sum(len(r.raw) for r in found) + reader.skipped + reader.torn == len(data)
        assert reader.last_us == (found[-1].time_us if found else None)
        return found, reader

    return go


Read = Callable[[bytes], tuple[list[Record], TlogReader]]
Row = tuple[bytes, list[Record], int, int, str]


def low_byte_first(some: list[Record]) -> bytes:
    return b"".join(r.time_us.to_bytes(8, "little") + r.raw for r in some)


def without_times(some: list[Record]) -> bytes:
    return b"".join(r.raw for r in some)


FIVE, TWENTY, THIRTY, FORTY = records(5), records(20), records(30), records(40)
SHORT = packet(1, 9)
BLANK = b"\xaa" * 50
NOISE = random.Random(5).randbytes(100_000)
FALSE = T0_US.to_bytes(8, "big") + b"\xfd\xff\x00"  # plausible time and magic, but no record where the length leads
ON_MAGIC = [Record(0x00060A24FE202241 + i, SHORT) for i in range(3)]  # the fifth byte is a magic
OF_1971 = records(500, 31_536_000_000_000)
ABOUT = [Record(T0_US + t, SHORT) for t in (0, -5_000_000, DAY_US - 6_000_000, 0)]
ODD = [Record(T0_US + t, packet(1, 20)) for t in (-DAY_US - 10_000_000, DAY_US + 10_000_000, 30 * DAY_US, -T0_US)]
SET = [
    [*records(10), *records(10, T0_US + offset), *records(10, T0_US + 10_000_000)]
    for offset in (-3_600_000_000, 30 * DAY_US, -T0_US + 31_536_000_000_000, 78_000_000)
]
LATE = [[Record(us, SHORT)] * 2 for us in (4_102_444_800_000_000, (1 << 64) - 1)]
EARLY = [[Record(us, SHORT)] * 2 for us in (0, 978_307_199_999_999)]


def row(data: bytes, wanted: list[Record], skipped: int = 0, torn: int = 0, layout: str = "big-endian times") -> Row:
    """A log, the records in it, bytes between them, bytes of an incomplete last one, and its layout."""
    return data, wanted, skipped, torn, layout


READ: dict[str, list[Row]] = {
    "a whole log": [row(encode(records(2000)), records(2000))],
    "an empty log": [row(b"", [])],
    "garbage in the middle": [row(encode(TWENTY[:10], NOISE, TWENTY[10:]), TWENTY, len(NOISE))],
    "garbage first": [row(encode(b"plain text of a booting autopilot\r\n", FIVE), FIVE, 35)],
    "garbage behind the last record is not torn": [row(encode(FIVE, BLANK), FIVE, 50)],
    "a torn tail": [
        row(encode(FIVE, encode(Record(T0_US + 10_000, packet(2, 200)))[:keep]), FIVE, torn=keep)
        for keep in (1, 7, 8, 9, 12, 100)
    ],
    "a record cut in the middle costs only itself": [
        row(encode(THIRTY[:10], encode(Record(T0_US + 5_000, packet(2, 255)))[:keep], THIRTY[10:]), THIRTY, keep)
        for keep in (9, 30, 150)
    ],
    "a false magic in garbage is no record, and hides none": [
        row(encode(TWENTY[:10], b"\xaa" * 5, FALSE, b"\xaa" * 20, TWENTY[10:]), TWENTY, 5 + 11 + 20)
    ],
    "garbage that looks like the time it runs into": [
        row(encode(ON_MAGIC[:1], b"\x00\x06\x0a\x24", ON_MAGIC[1:]), ON_MAGIC, 4)
    ],
    "a record with a time of its own is one where nothing else is between": [
        row(encode(TWENTY[:10], odd, TWENTY[10:]), [*TWENTY[:10], odd, *TWENTY[10:]]) for odd in ODD
    ],
    "behind garbage it is none": [
        row(encode(TWENTY[:10], b"\xaa" * 7, odd, TWENTY[10:]), TWENTY, 7 + len(encode(odd))) for odd in ODD
    ],
    "a clock that was set costs no record": [
        row(encode(some[:10], garbage, some[10:]), some, len(garbage)) for some in SET for garbage in (b"", BLANK)
    ],
    "a whole log of 1971 is one": [row(encode(garbage, OF_1971), OF_1971, len(garbage)) for garbage in (b"", BLANK)],
    "times with the low byte first are read": [
        row(
            damage + low_byte_first(FORTY[:20]) + damage + low_byte_first(FORTY[20:]),
            *(FORTY, 2 * len(damage), 0, "little-endian times"),
        )
        for damage in (b"", BLANK, b"\xfd\xfe\x00" * 20)
    ],
    "packets without times are read": [
        row(
            damage + without_times(FORTY[:20]) + damage + without_times(FORTY[20:]),
            *([Record(0, r.raw) for r in FORTY], 2 * len(damage), 0, "no times"),
        )
        for damage in (b"", BLANK)
    ],
    "times may go back and jump within a day": [row(encode(ABOUT), ABOUT)],
    "no time is behind this century": [row(encode(two), [], 2 * 25) for two in LATE],
    "a first time before this century needs another that agrees": [row(encode(two), two) for two in EARLY],
    "alone it is none": [row(encode(two[0]), [], 25) for two in EARLY],
}


@every("promise, data, wanted, skipped, torn, layout", [(name, *one) for name, rows in READ.items() for one in rows])
def test_records_that_are_read(
    read: Read, promise: str, data: bytes, wanted: list[Record], skipped: int, torn: int, layout: str
) -> None:
    found, reader = read(data)
    assert found == wanted
    assert (reader.skipped, reader.torn) == (skipped, torn)
    assert (reader.layout, reader.stamped) == (layout, layout != "no times")


def test_times_keep_their_microseconds(read: Read) -> None:
    (record,), _ = read(encode(records(1)))
    assert record.time_us == T0_US
    assert record.time_s == pytest.approx(1_700_000_000.123457, abs=1e-6)
    assert tlog_record(T0_US, b"raw") == bytes.fromhex("00060a2418202241") + b"raw"


@pytest.mark.parametrize("time_us", [-1, 1 << 64])
def test_a_time_that_does_not_fit(time_us: int) -> None:
    with pytest.raises(ValueError, match="time_us"):
        tlog_record(time_us, b"")


def test_a_false_magic_wherever_the_buffer_ends(read: Read, monkeypatch: pytest.MonkeyPatch) -> None:
    """Garbage is left behind in steps; where a step ends, a record is no likelier than elsewhere."""
    monkeypatch.setattr(tlog_module, "_CHUNK", 1)
    false = T0_US.to_bytes(8, "big") + b"\xfe\x00\x00"
    found, reader = read((b"\xaa" * 6 + false) * 1000)
    assert found == []
    assert reader.skipped == reader.size


def test_noise_is_no_log_of_any_kind(read: Read) -> None:
    numbers = random.Random(7)
    for _ in range(30):
        _, reader = read(numbers.randbytes(70_000))
        assert reader.layout == "big-endian times"
        assert reader.records <= 1


@pytest.mark.parametrize("chunk", [1, 7, 1153, 65536])
def test_how_the_file_is_cut_does_not_matter(read: Read, monkeypatch: pytest.MonkeyPatch, chunk: int) -> None:
    wanted = records(40)
    data = encode(wanted[:13], b"\xfd\xfe\x00" * 300, wanted[13:], b"\x00\x06")
    monkeypatch.setattr(tlog_module, "_CHUNK", chunk)
    found, reader = read(data)
    assert found == wanted
    assert (reader.skipped, reader.torn) == (900, 2)


a_record = st.builds(
    lambda v, n, s, f: packet(v, n, signed=s, fill=f),
    st.sampled_from([1, 2]),
    st.integers(0, 255),
    st.booleans(),
    st.sampled_from([0, 6, 0xFD, 0xFE, 0xAA]),
)
some_garbage = st.binary(min_size=1, max_size=400)
false_magic = st.builds(
    lambda before, magic, length, after: (
        b"\xaa" * before + T0_US.to_bytes(8, "big") + bytes([magic, length, 0]) + b"\xaa" * after
    ),
    st.integers(1, 20),
    st.sampled_from([0xFD, 0xFE]),
    st.integers(0, 255),
    st.integers(0, 300),
)


def ends_at_a_record(garbage: bytes, behind: bytes) -> bool:
    """Chance made the false record's length lead to a true one: then nobody can tell them apart."""
    at = garbage.find(T0_US.to_bytes(8, "big"))
    if at < 0:
        return False
    end = at + garbage[at + 9] + (20 if garbage[at + 8] == 0xFD else 16)
    data = garbage + behind
    return end == len(data) or (end >= len(garbage) and data[end : end + 1] == b"\0")


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(st.lists(a_record | some_garbage.map(bytearray) | false_magic.map(bytearray), max_size=12))
@example([packet(1, 9), bytearray(b"\xaa" * 30), packet(2, 0), packet(2, 0)])
def test_records_survive_garbage(read: Read, parts: list[bytes | bytearray]) -> None:
    """A bytearray is garbage. Each record must be found that has another one, or an end of the file, before
    or behind it; nothing else may be found."""
    true, must = [], []
    encoded = [bytes(p) if isinstance(p, bytearray) else tlog_record(T0_US, p) for p in parts]
    for i, part in enumerate(parts):
        if isinstance(part, bytearray):
            assume(not ends_at_a_record(bytes(part), b"".join(encoded[i + 1 :])))
            continue
        record = Record(T0_US, bytes(part))
        true.append(record)
        around = [i == 0 or parts[i - 1], i + 1 == len(parts) or parts[i + 1]]
        if not all(isinstance(neighbour, bytearray) for neighbour in around):
            must.append(record)
    found, _ = read(b"".join(encoded))
    assert is_within(found, true)
    assert is_within(must, found)


def is_within(few: list[Record], many: list[Record]) -> bool:
    """`few` is `many` with some left out."""
    rest = iter(many)
    return all(record in rest for record in few)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(
    st.lists(st.binary(max_size=300) | a_record.map(lambda raw: tlog_record(T0_US, raw)), max_size=10),
    st.data(),
)
def test_no_content_raises(read: Read, parts: list[bytes], data: st.DataObject) -> None:
    content = bytearray(b"".join(parts))
    for _ in range(data.draw(st.integers(0, 3)) if content else 0):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    end = data.draw(st.integers(0, len(content)))
    read(bytes(content[:end]))  # asserts that every byte is accounted for


def test_memory_stays_flat_and_progress_is_told(tmp_path: Path) -> None:
    path = tmp_path / "long.tlog"
    one = encode(records(500))
    path.write_bytes(one * 40 + b"\xaa" * 1_000_000)
    tracemalloc.start()
    reader = TlogReader(path)
    assert (reader.consumed, reader.size) == (0, len(one) * 40 + 1_000_000)
    before = 0
    for _ in reader:
        assert reader.consumed > before
        before = reader.consumed
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert reader.records == 20_000
    assert peak < 1_000_000 < reader.size / 4


def test_what_cannot_be_opened(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    os.mkfifo(tmp_path / "pipe")
    for path, what in (
        (tmp_path / "none.tlog", "no such file"),
        (tmp_path, "is a directory"),
        (tmp_path / "pipe", "is not a regular file"),
        ("\0", "cannot be opened"),
    ):
        with pytest.raises(LinkError, match=what) as caught:
            TlogReader(path)
        assert caught.value.link == str(path)

    def forbidden(*args: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("builtins.open", forbidden)
    (tmp_path / "a.tlog").touch()
    with pytest.raises(LinkError, match="permission denied; ls -l"):
        TlogReader(tmp_path / "a.tlog")


def test_a_disk_that_fails_while_reading(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "a.tlog").write_bytes(encode(records(3)))
    reader = TlogReader(tmp_path / "a.tlog")

    class Failing:
        def read(self, size: int) -> bytes:
            raise OSError(5, "Input/output error")

    reader._file.close()
    monkeypatch.setattr(reader, "_file", Failing())
    with pytest.raises(LinkError, match="cannot be read: Input/output error"):
        next(iter(reader))


def test_closing_a_reader_early(tmp_path: Path) -> None:
    (tmp_path / "a.tlog").write_bytes(encode(records(3)))
    for started in (False, True):
        reader = TlogReader(tmp_path / "a.tlog")
        if started:
            next(iter(reader))
        reader.close()
        reader.close()
        assert reader._file.closed
        assert list(reader) == []


# A log as a link


def log_link(path: Path, times_s: list[float], clock: StepClock, keep: Callable[[Link], Link]) -> Link:
    made = [Record(T0_US + round(t * 1e6), packet(1, 0, fill=i)) for i, t in enumerate(times_s)]
    path.write_bytes(encode(made))
    return keep(TlogLink(path, clock))


def test_a_log_plays_at_its_own_pace(tmp_path: Path, keep: Callable[[Link], Link]) -> None:
    clock = StepClock(100.0)
    link = log_link(tmp_path / "a.tlog", [0.0, 0.5, 0.25, 1.0], clock, keep)
    one = [packet(1, 0, fill=i) for i in range(4)]
    assert link.name == str(tmp_path / "a.tlog")
    assert link.fileno() is None
    assert link.ready()
    assert link.read() == one[0]
    assert link.read() == b""
    clock.wait(100.499)
    assert not link.ready()
    assert link.read() == b""
    clock.wait(100.5)
    assert link.ready()
    assert link.read() == one[1] + one[2]  # the file's order, though the third is stamped earlier
    assert link.write(b"ignored")
    assert link.dropped == 0
    clock.wait(200.0)
    assert link.read() == one[3]
    assert link.ready()
    with pytest.raises(LinkEnded, match=r"a\.tlog: end of log$"):
        link.read()
    link.close()
    link.close()


def test_a_log_without_a_packet_says_so(tmp_path: Path, keep: Callable[[Link], Link]) -> None:
    (tmp_path / "a.tlog").write_bytes(b"something else entirely")
    link = keep(TlogLink(tmp_path / "a.tlog", StepClock()))
    with pytest.raises(LinkError, match="there is no packet in it; is it a MAVLink"):
        link.read()


def test_a_log_whose_clock_was_set_plays_on(tmp_path: Path, keep: Callable[[Link], Link]) -> None:
    clock = StepClock(100.0)
    raws = [b"\xfe\x04" + bytes([i, 1, 1, 30]) + (1000 + 100 * i).to_bytes(4, "little") + bytes(2) for i in range(20)]
    made = [Record(T0_US + 100_000 * i - (3_600_000_000 if i >= 10 else 0), raw) for i, raw in enumerate(raws)]
    (tmp_path / "a.tlog").write_bytes(encode(made))
    (tmp_path / "bare.tlog").write_bytes(b"".join(raws))
    for name in ("a.tlog", "bare.tlog"):
        link, start = keep(TlogLink(tmp_path / name, clock)), clock.now()
        assert link.read() == raws[0]
        for i, raw in enumerate(raws[1:], 1):
            clock.wait(start + 0.1 * i - 0.01)
            assert link.read() == b""
            clock.wait(start + 0.1 * i + 0.01)
            assert link.read() == raw
