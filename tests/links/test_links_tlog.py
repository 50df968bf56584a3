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
        assert reader.first_us == (found[0].time_us if found else None)
        assert reader.last_us == (found[-1].time_us if found else None)
        return found, reader

    return go


Read = Callable[[bytes], tuple[list[Record], TlogReader]]


def test_a_whole_log(read: Read) -> None:
    wanted = records(2000)
    found, reader = read(encode(wanted))
    assert found == wanted
    assert reader.skipped == reader.torn == 0


def test_times_keep_their_microseconds(read: Read) -> None:
    (record,), _ = read(encode(records(1)))
    assert record.time_us == T0_US
    assert record.time_s == pytest.approx(1_700_000_000.123457, abs=1e-6)
    assert tlog_record(T0_US, b"raw") == bytes.fromhex("00060a2418202241") + b"raw"


@pytest.mark.parametrize("time_us", [-1, 1 << 64])
def test_a_time_that_does_not_fit(time_us: int) -> None:
    with pytest.raises(ValueError, match="time_us"):
        tlog_record(time_us, b"")


def test_an_empty_log(read: Read) -> None:
    found, reader = read(b"")
    assert found == []
    assert reader.skipped == reader.torn == 0


def test_garbage_in_the_middle(read: Read) -> None:
    wanted = records(20)
    garbage = random.Random(5).randbytes(100_000)
    found, reader = read(encode(wanted[:10], garbage, wanted[10:]))
    assert found == wanted
    assert reader.skipped == len(garbage)


def test_garbage_first(read: Read) -> None:
    wanted = records(5)
    found, reader = read(encode(b"plain text of a booting autopilot\r\n", wanted))
    assert found == wanted
    assert reader.skipped == 35


@pytest.mark.parametrize("keep", [1, 7, 8, 9, 12, 100])
def test_a_torn_tail(read: Read, keep: int) -> None:
    wanted = records(5)
    last = encode(Record(T0_US + 10_000, packet(2, 200)))
    found, reader = read(encode(wanted, last[:keep]))
    assert found == wanted
    assert (reader.torn, reader.skipped) == (keep, 0)


def test_garbage_behind_the_last_record_is_not_torn(read: Read) -> None:
    wanted = records(5)
    found, reader = read(encode(wanted, b"\xaa" * 50))
    assert found == wanted
    assert (reader.torn, reader.skipped) == (0, 50)


@pytest.mark.parametrize("keep", [9, 30, 150])
def test_a_record_cut_in_the_middle_costs_only_itself(read: Read, keep: int) -> None:
    wanted = records(30)
    cut = encode(Record(T0_US + 5_000, packet(2, 255)))[:keep]
    found, reader = read(encode(wanted[:10], cut, wanted[10:]))
    assert found == wanted
    assert reader.skipped == keep


def test_a_false_magic_in_garbage(read: Read) -> None:
    """Plausible time and magic, but no record where the length leads: no record, and it hides none."""
    wanted = records(20)
    false = T0_US.to_bytes(8, "big") + b"\xfd\xff\x00"
    found, reader = read(encode(wanted[:10], b"\xaa" * 5, false, b"\xaa" * 20, wanted[10:]))
    assert found == wanted
    assert reader.skipped == 5 + 11 + 20


def test_garbage_that_looks_like_the_time_it_runs_into(read: Read) -> None:
    wanted = [Record(0x00060A24FE202241 + i, packet(1, 9)) for i in range(3)]  # the fifth byte is a magic
    assert read(encode(wanted[:1], b"\x00\x06\x0a\x24", wanted[1:]))[0] == wanted


def test_a_false_magic_wherever_the_buffer_ends(read: Read, monkeypatch: pytest.MonkeyPatch) -> None:
    """Garbage is left behind in steps; where a step ends, a record is no likelier than elsewhere."""
    monkeypatch.setattr(tlog_module, "_CHUNK", 1)
    false = T0_US.to_bytes(8, "big") + b"\xfe\x00\x00"
    found, reader = read((b"\xaa" * 6 + false) * 1000)
    assert found == []
    assert reader.skipped == reader.size


@pytest.mark.parametrize("offset", [-DAY_US - 10_000_000, DAY_US + 10_000_000, 30 * DAY_US, -T0_US])
def test_a_record_with_a_time_of_its_own_is_one_where_nothing_else_is_between(read: Read, offset: int) -> None:
    wanted = records(20)
    odd = Record(T0_US + offset, packet(1, 20))
    assert read(encode(wanted[:10], odd, wanted[10:]))[0] == [*wanted[:10], odd, *wanted[10:]]
    found, reader = read(encode(wanted[:10], b"\xaa" * 7, odd, wanted[10:]))
    assert found == wanted
    assert reader.skipped == 7 + len(encode(odd))


@pytest.mark.parametrize("offset", [-3_600_000_000, 30 * DAY_US, -T0_US + 31_536_000_000_000, 78_000_000])
def test_a_clock_that_was_set_costs_no_record(read: Read, offset: int) -> None:
    wanted = [*records(10), *records(10, T0_US + offset), *records(10, T0_US + 10_000_000)]
    found, reader = read(encode(wanted))
    assert found == wanted
    found, reader = read(encode(wanted[:10], b"\xaa" * 50, wanted[10:]))
    assert found == wanted
    assert reader.skipped == 50


def test_a_whole_log_of_1971_is_one(read: Read) -> None:
    wanted = records(500, 31_536_000_000_000)
    assert read(encode(wanted))[0] == wanted
    found, reader = read(encode(b"\xaa" * 50, wanted))
    assert found == wanted
    assert reader.skipped == 50


@pytest.mark.parametrize("damage", [b"", b"\xaa" * 50, b"\xfd\xfe\x00" * 20])
def test_times_with_the_low_byte_first_are_read(read: Read, damage: bytes) -> None:
    wanted = records(40)
    data = [r.time_us.to_bytes(8, "little") + r.raw for r in wanted]
    found, reader = read(damage + b"".join(data[:20]) + damage + b"".join(data[20:]))
    assert found == wanted
    assert (reader.layout, reader.stamped) == ("little-endian times", True)
    assert reader.skipped == 2 * len(damage)


@pytest.mark.parametrize("damage", [b"", b"\xaa" * 50])
def test_packets_without_times_are_read(read: Read, damage: bytes) -> None:
    wanted = records(40)
    found, reader = read(damage + b"".join(r.raw for r in wanted[:20]) + damage + b"".join(r.raw for r in wanted[20:]))
    assert found == [Record(0, r.raw) for r in wanted]
    assert (reader.layout, reader.stamped) == ("no times", False)
    assert reader.skipped == 2 * len(damage)


def test_noise_is_no_log_of_any_kind(read: Read) -> None:
    numbers = random.Random(7)
    for _ in range(30):
        _, reader = read(numbers.randbytes(70_000))
        assert reader.layout == "big-endian times"
        assert reader.records <= 1


def test_times_may_go_back_and_jump_within_a_day(read: Read) -> None:
    wanted = [Record(T0_US + t, packet(1, 9)) for t in (0, -5_000_000, DAY_US - 6_000_000, 0)]
    assert read(encode(wanted))[0] == wanted


@pytest.mark.parametrize("first_us", [4_102_444_800_000_000, (1 << 64) - 1])
def test_no_time_is_behind_this_century(read: Read, first_us: int) -> None:
    found, reader = read(encode(Record(first_us, packet(1, 9)), Record(first_us, packet(1, 9))))
    assert found == []
    assert reader.skipped == 2 * 25


@pytest.mark.parametrize("first_us", [0, 978_307_199_999_999])
def test_a_first_time_before_this_century_needs_another_that_agrees(read: Read, first_us: int) -> None:
    wanted = [Record(first_us, packet(1, 9))] * 2
    assert read(encode(wanted))[0] == wanted
    assert read(encode(wanted[0]))[0] == []


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
