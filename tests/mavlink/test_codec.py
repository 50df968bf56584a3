"""MAVLink as a codec: finding packets in any bytes, reading them, writing them."""

from __future__ import annotations

from itertools import pairwise, takewhile
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from pymavlink.generator.mavcrc import x25crc

from arva_hil.mavlink.codec import Encoder, Packet, Parser, decode, dialect
from tests.every import every

HEARTBEAT = dialect.MAVLINK_MSG_ID_HEARTBEAT
UNKNOWN = 99_999
UNKNOWN_V1 = 8
KNOWN = sorted(dialect.mavlink_map)
KNOWN_V1 = [msgid for msgid in KNOWN if msgid < 256]
NAMED = ["ATTITUDE", "GLOBAL_POSITION_INT", "HEARTBEAT", "HOME_POSITION", "COMMAND_ACK", "STATUSTEXT", "TUNNEL"]
NAMED += ["NAMED_VALUE_INT"]
LONGEST = 280  # bytes of a packet, signed


def packet(
    msgid: int,
    payload: bytes,
    version: int = 2,
    *,
    source: tuple[int, int] = (1, 1),
    signed: bool = False,
    flags: int = 0,
) -> bytes:
    """By the book, https://mavlink.io/en/guide/serialization.html, and not by the code under test."""
    if version == 2:
        start, head = b"\xfd", bytes([len(payload), flags | signed, 0, 77, *source]) + msgid.to_bytes(3, "little")
    else:
        start, head = b"\xfe", bytes([len(payload), 77, *source, msgid])
    extra = dialect.mavlink_map[msgid].crc_extra if msgid in dialect.mavlink_map else 0
    crc = x25crc(head + payload + bytes([extra])).crc
    return start + head + payload + crc.to_bytes(2, "little") + (b"\x0b" * 13 if signed else b"")


@st.composite
def packets(draw: st.DrawFn) -> bytes:
    version = draw(st.sampled_from([1, 2]))
    msgid = draw(st.sampled_from(KNOWN if version == 2 else KNOWN_V1))
    signed = version == 2 and draw(st.booleans())
    source = draw(st.tuples(st.integers(0, 255), st.integers(0, 255)))
    return packet(msgid, draw(st.binary(max_size=255)), version, source=source, signed=signed)


clean_garbage = st.binary(max_size=40).map(lambda b: b.replace(b"\xfd", b"x").replace(b"\xfe", b"y"))
nasty = st.lists(st.sampled_from(b"\xfd\xfe\x00\x01\x02\x1e\xff"), max_size=60).map(bytes) | st.binary(max_size=60)


def cut(data: bytes, at: list[int]) -> list[bytes]:
    edges = [0, *sorted(a % (len(data) + 1) for a in at), len(data)]
    return [data[a:b] for a, b in pairwise(edges)]


def parse(*chunks: bytes) -> tuple[list[Packet], Parser]:
    parser = Parser()
    found = [p for chunk in chunks for p in parser.feed(chunk)]
    assert parser.packets == len(found)
    return found, parser


def good(count: int = 1) -> bytes:
    return packet(HEARTBEAT, bytes(9)) * count


# -- splitting ---------------------------------------------------------------------------------------------


@given(st.lists(packets(), max_size=8), st.lists(st.integers(0, 5000), max_size=20))
def test_packets_are_found_wherever_the_stream_is_cut(sent: list[bytes], at: list[int]) -> None:
    found, parser = parse(*cut(b"".join(sent), at))
    assert [p.raw for p in found] == sent
    assert (parser.bad_crc, parser.skipped) == (0, 0)


@given(st.lists(packets(), min_size=1, max_size=3))
def test_one_byte_at_a_time_a_packet_is_there_with_its_last_byte(sent: list[bytes]) -> None:
    parser = Parser()
    for raw in sent:
        *most, last = [bytes([b]) for b in raw]
        assert [p for b in most for p in parser.feed(b)] == []
        assert [p.raw for p in parser.feed(last)] == [raw]


@given(st.lists(st.tuples(clean_garbage, packets()), max_size=6), clean_garbage, st.lists(st.integers(0, 5000)))
def test_garbage_between_packets_is_skipped_and_counted(
    pairs: list[tuple[bytes, bytes]], tail: bytes, at: list[int]
) -> None:
    stream = b"".join(g + p for g, p in pairs) + tail
    found, parser = parse(*cut(stream, at))
    assert [p.raw for p in found] == [p for _, p in pairs]
    assert parser.skipped == sum(len(g) for g, _ in pairs) + len(tail)


def believable(stream: bytes, at: int) -> bool:
    """Whether a false packet starts here that nobody can tell from a true one."""
    if stream[at] == 0xFD:
        size = stream[at + 1] + 12 + 13 * (stream[at + 2] & 1)
        msgid = int.from_bytes(stream[at + 7 : at + 10], "little")
        return stream[at + 2] < 2 and (msgid not in dialect.mavlink_map or packet_is_good(stream[at : at + size]))
    msgid, size = stream[at + 5], stream[at + 1] + 8
    return msgid not in dialect.mavlink_map or packet_is_good(stream[at : at + size])


def packet_is_good(raw: bytes) -> bool:
    try:
        dialect.MAVLink(None).decode(bytearray(raw))
    except dialect.MAVError:
        return False
    return True


@given(st.lists(st.tuples(nasty, packets()), max_size=4), st.lists(st.integers(0, 5000), max_size=10))
def test_garbage_that_looks_like_the_start_of_a_packet_hides_none(
    pairs: list[tuple[bytes, bytes]], at: list[int]
) -> None:
    """All good packets are found behind any garbage, unless that makes a packet that could be true itself."""
    stream, places = b"", []
    for garbage, raw in pairs:
        places += [len(stream) + i for i, b in enumerate(garbage) if b in b"\xfd\xfe"]
        stream += garbage + raw
    stream += bytes(LONGEST)
    assume(not any(believable(stream, i) for i in places))
    found, _ = parse(*cut(stream, at))
    assert [p.raw for p in found] == [p for _, p in pairs]


@given(st.lists(packets() | nasty, max_size=8), st.lists(st.integers(0, 5000), max_size=10))
def test_every_byte_is_in_a_packet_or_skipped_or_waiting(parts: list[bytes], at: list[int]) -> None:
    stream = b"".join(parts)
    found, parser = parse(*cut(stream, at))
    waiting = len(stream) - sum(len(p.raw) for p in found) - parser.skipped
    assert 0 <= waiting < LONGEST
    found += parser.feed(bytes(2 * LONGEST))  # whatever waited is decided now
    assert sum(len(p.raw) for p in found) + parser.skipped == len(stream) + 2 * LONGEST


@given(st.lists(nasty | st.binary(max_size=600), max_size=10))
def test_no_bytes_make_it_raise(chunks: list[bytes]) -> None:
    found, parser = parse(*chunks)
    for p in found:
        decode(p)
    parser.feed(bytes(LONGEST))
    assert parser.feed(good())[-1].raw == good()


def test_what_a_packet_says_of_itself() -> None:
    v2, v1 = packet(30, b"\1", source=(7, 9), signed=True), packet(30, bytes(28), 1, source=(3, 4))
    unknown = packet(UNKNOWN, b"abc", source=(5, 6))
    found, _ = parse(v2 + v1 + unknown)
    assert found == [Packet(v2, 7, 9, 30), Packet(v1, 3, 4, 30), Packet(unknown, 5, 6, UNKNOWN)]
    assert [(p.version, p.signed, p.known) for p in found] == [(2, True, True), (1, False, True), (2, False, False)]


@given(st.integers(10, 39), st.integers(1, 30))
def test_bytes_lost_behind_the_header_cost_one_packet(start: int, lost: int) -> None:
    whole = packet(30, bytes(range(1, 29)))
    found, _ = parse(good() + whole[:start] + whole[start + lost :] + good(20))
    assert [p.raw for p in found] == [good()] * 21


# -- heads that cannot be verified ---------------------------------------------------------------------------


def false_head(length: int = 255, magic: int = 0xFD, flags: int = 0) -> bytes:
    """Of a long packet with an id that nobody knows: a station's packet of MAVLink 1 that was damaged, for example."""
    return bytes([magic, length, flags, 0, 77, 1, 1]) + UNKNOWN.to_bytes(3, "little")


def damaged(version: int) -> bytes:
    """A packet with a bit of its checksum wrong."""
    raw = bytearray(packet(HEARTBEAT, bytes(9), version))
    raw[-3] ^= 0x10
    return bytes(raw)


SIGNED = packet(HEARTBEAT, bytes(9), signed=True)
KNOWN_TO_HIDE = b"\xfe\x04M\x1a\x92\xb3\xe4\xf8\xddZ\xfd\xd4"
LATER = packet(HEARTBEAT, bytes(9), flags=2)
FILLED = packet(30, bytes(range(1, 29)))
MAGIC = packet(30, b"\xfe" * 28)
LONG = packet(UNKNOWN, b"\xfd\xfe" * 127)
OTHER_MAGIC = bytes([28, 0xFD, 255, 0, 30])  # from 255/0: read from its number on it is 267 bytes long
HURT = b"\xfe" + OTHER_MAGIC + bytes(28) + (x25crc(OTHER_MAGIC + bytes(29)).crc ^ 1).to_bytes(2, "little")
KNOWS_NOBODY = [packet(UNKNOWN, b"hello"), packet(UNKNOWN_V1, b"hello", 1), packet(UNKNOWN_V1, b"hello")]
TAIL = bytes(LONGEST)


@every(
    "promise, chunks, found, counted",
    [
        ("a signature belongs to its packet", [SIGNED + good()], [SIGNED, good()], {}),
        (
            "a packet with a flag nobody knows is dropped",
            [LATER + good()],
            [good()],
            {"incompatible": 1, "skipped": len(LATER)},
        ),
        *(
            (
                "a bad checksum is counted and the next packet found",
                [good() + damaged(version) + good(2)],
                [good()] * 3,
                {"bad_crc": 1, "skipped": len(damaged(version))},
            )
            for version in (1, 2)
        ),
        *(
            (
                "an unknown message is a packet when another follows or nothing",
                [one + good() + one],
                [one, good(), one],
                {},
            )
            for one in KNOWS_NOBODY
        ),
        (
            "an unknown message with garbage behind it is garbage",
            [KNOWS_NOBODY[0] + b"\0" + good()],
            [good()],
            {"skipped": 12 + 5 + 1},
        ),
        ("unknown messages without a packet inside are given out however long", [LONG * 20], [LONG] * 20, {}),
        (  # with what follows its garbage would be a packet of a later MAVLink with an unknown message
            "flags and an id that nobody knows hide no packet",
            [b"\xfd\x01\xfe" + KNOWN_TO_HIDE + TAIL],
            [KNOWN_TO_HIDE],
            {"bad_crc": None, "skipped": 3 + len(TAIL)},
        ),
        (
            "flags and an id that nobody knows hold up nothing",
            [false_head(flags=2) + good()],
            [good()],
            {"skipped": 10},
        ),
        *(
            (
                "a damaged packet of MAVLink 1 with the other magic as its number costs only itself",
                chunks,
                [good()] + [FILLED] * 12,
                {"bad_crc": None, "skipped": len(HURT)},
            )
            for stream in [good() + HURT + FILLED * 12]
            for chunks in ([stream], [stream[k : k + 1] for k in range(len(stream))])
        ),
        *(  # also where its length leads to the start of a packet or the end of what there is
            (
                "an unknown head hides no packet that can be verified",
                [false_head(len(good(count)) + 30) + good(count) + bytes(32) + behind, TAIL],
                [good()] * count,
                {"bad_crc": None, "skipped": None},
            )
            for count in (1, 5)
            for behind in (b"", b"\xfe", b"\xfd")
        ),
        (
            "a packet behind an unknown head is there with its last byte",
            [false_head() + good()[:-1], good()[-1:]],
            [good()],
            {"skipped": 10},
        ),
        (  # the head's end is at one of the 0xFE
            "an unknown head hides no packet that ends behind its own end",
            [false_head(20) + bytes(8) + MAGIC + good()],
            [MAGIC, good()],
            {"skipped": 18},
        ),
    ],
)
def test_packets_that_are_found(promise: str, chunks: list[bytes], found: list[bytes], counted: dict[str, Any]) -> None:
    packets, parser = parse(*chunks)
    assert [p.raw for p in packets] == found
    assert all(p.known == (p.msgid in dialect.mavlink_map) for p in packets)
    assert all(decode(p) is None for p in packets if not p.known)
    assert all(p.signed == (p.raw == SIGNED) for p in packets)
    for name in ("bad_crc", "skipped", "incompatible"):
        assert counted.get(name, 0) in (None, getattr(parser, name)), name


@pytest.mark.parametrize(("flags", "found"), [(0, 1), (2, 0)])
def test_a_packet_inside_a_known_message_is_a_part_of_it_wherever_that_is_cut(flags: int, found: int) -> None:
    outer = packet(dialect.MAVLINK_MSG_ID_TUNNEL, bytes(5) + good() + bytes(range(1, 100)), flags=flags)
    for at in range(1, len(outer)):
        packets, parser = parse(outer[:at], outer[at:] + good())
        assert [p.raw for p in packets] == [outer] * found + [good()]
        assert parser.incompatible == 1 - found


def test_the_end_of_a_record_is_the_end_of_its_packets() -> None:
    parser = Parser()
    assert [p.raw for p in parser.feed(false_head(magic=0xFE) + good(), whole=True)] == [good()]
    known = good()[:1] + b"\xff" + good()[2:]
    assert parser.feed(known, whole=True) == []
    assert [p.raw for p in parser.feed(good(), whole=True)] == [good()]
    assert parser.skipped == 10 + len(known)


@given(st.lists(packets() | nasty, max_size=6))
def test_records_are_read_one_by_one_whatever_was_in_the_one_before(parts: list[bytes]) -> None:
    parser = Parser()
    each = [parser.feed(part, whole=True) for part in parts]
    for part, found in zip(parts, each, strict=True):
        assert Parser().feed(part, whole=True) == found
    assert sum(len(p.raw) for found in each for p in found) + parser.skipped == sum(map(len, parts))


# -- reading -----------------------------------------------------------------------------------------------


def decoded(raw: bytes) -> dict[str, Any]:
    (found,), _ = parse(raw)
    return dict(decode(found).to_dict())


def xml_lengths() -> dict[int, int]:
    """Bytes of every message's payload without its extension fields, as the definitions have it."""
    sizes = {"char": 1, "float": 4, "double": 8, "uint8_t_mavlink_version": 1}
    sizes |= {f"{sign}int{n}_t": n // 8 for sign in ("", "u") for n in (8, 16, 32, 64)}
    lengths: dict[int, int] = {}
    for file in Path(dialect.__file__).parent.glob("*.xml"):
        for message in ElementTree.parse(file).iter("message"):
            name, number = message.attrib["name"], int(message.attrib["id"])
            if number not in dialect.mavlink_map or dialect.mavlink_map[number].msgname != name:
                continue
            fields = [
                f.attrib["type"].rstrip("]")
                for f in takewhile(lambda f: f.tag != "extensions", message)
                if f.tag == "field"
            ]
            parts = [kind.partition("[") for kind in fields]
            lengths[number] = sum(sizes[kind] * int(count or 1) for kind, _, count in parts)
    return lengths


V1_LENGTHS = xml_lengths()
BASE = {name: V1_LENGTHS[getattr(dialect, f"MAVLINK_MSG_ID_{name}")] for name in NAMED}


@every("msgid", KNOWN_V1)
def test_mavlink_1_has_no_extension_fields_and_nothing_is_missing(msgid: int) -> None:
    whole, short = (packet(msgid, bytes([1]) * n, 1) for n in (V1_LENGTHS[msgid], V1_LENGTHS[msgid] - 1))
    (found, cut), parser = parse(whole + short)
    message = decode(found)
    assert message is not None
    assert decode(cut) is None
    assert parser.malformed == 1
    sent = Encoder(1, 1, version=1).pack(message)
    assert sent[6:-2] == whole[6:-2]
    assert [p.raw for p in parse(sent)[0]] == [sent]


@pytest.mark.parametrize("name", NAMED)
@given(data=st.data())
def test_fields_are_what_pymavlink_reads(name: str, data: st.DataObject) -> None:
    """Any payload: every value a field can have, NaN among them, zeros cut off, fields of a later dialect."""
    msgid = getattr(dialect, f"MAVLINK_MSG_ID_{name}")
    size = dialect.mavlink_map[msgid].unpacker.size
    payload = data.draw(st.binary(max_size=min(size + 5, 255)) | st.binary(min_size=size, max_size=size))
    version = data.draw(st.sampled_from([1, 2] if msgid < 256 and len(payload) >= BASE[name] else [2]))
    raw = packet(msgid, payload, version, signed=version == 2 and data.draw(st.booleans()))
    theirs = dialect.MAVLink(None).decode(bytearray(raw)).to_dict()
    assert repr(decoded(raw)) == repr(theirs)  # repr, for NaN is not equal to NaN


@every("msgid", KNOWN)
def test_every_message_there_is_is_read_as_pymavlink_does(msgid: int) -> None:
    size = dialect.mavlink_map[msgid].unpacker.size
    raw = packet(msgid, bytes((7 * i + 1) % 120 for i in range(size)))
    assert repr(decoded(raw)) == repr(dialect.MAVLink(None).decode(bytearray(raw)).to_dict())


@given(st.sampled_from(KNOWN), st.binary(max_size=255))
def test_no_payload_makes_reading_raise(msgid: int, payload: bytes) -> None:
    (found,), _ = parse(packet(msgid, payload))
    decode(found)


def test_zeros_cut_off_the_end_are_read_as_zeros() -> None:
    position = dialect.MAVLink_global_position_int_message(1234, 465_000_000, 0, 0, 0, 0, 0, 0, 0)
    raw = Encoder(1, 1).pack(position)
    assert len(raw) == 12 + 8
    assert decoded(raw) == position.to_dict()


# -- writing -----------------------------------------------------------------------------------------------

i32, u32 = st.integers(-(2**31), 2**31 - 1), st.integers(0, 2**32 - 1)
i16, u16, u8 = st.integers(-(2**15), 2**15 - 1), st.integers(0, 65535), st.integers(0, 255)
f32 = st.floats(width=32, allow_nan=False)
MESSAGES = st.one_of(
    st.builds(dialect.MAVLink_attitude_message, u32, f32, f32, f32, f32, f32, f32),
    st.builds(dialect.MAVLink_global_position_int_message, u32, i32, i32, i32, i32, i16, i16, i16, u16),
    st.builds(dialect.MAVLink_heartbeat_message, u8, u8, u8, u32, u8, u8),
    st.builds(dialect.MAVLink_command_ack_message, u16, u8),
    st.builds(dialect.MAVLink_named_value_int_message, u32, st.sampled_from([b"arva", b"ten chars!"]), i32),
)


@given(MESSAGES, u8, u8, st.sampled_from([1, 2]))
def test_what_is_packed_is_read_back(message: Any, system: int, component: int, version: int) -> None:
    (found,), _ = parse(Encoder(system, component, version).pack(message))
    assert (found.version, found.system, found.component) == (version, system, component)
    assert decode(found).to_dict() == message.to_dict()


@every("msgid", KNOWN)
def test_every_message_there_is_is_written_as_pymavlink_does(msgid: int) -> None:
    """Whole, with zeros at the end, and of zeros alone."""
    size = dialect.mavlink_map[msgid].unpacker.size
    theirs, ours = dialect.MAVLink(None, 42, 191), Encoder(42, 191)
    for said in (size, size // 2, 0):
        (found,), _ = parse(packet(msgid, bytes((7 * i + 1) % 120 for i in range(said)).ljust(size, b"\0")))
        message = decode(found)
        assert ours.pack(message) == message.pack(theirs)
        theirs.seq += 1


def test_of_an_array_that_is_too_long_the_rest_is_left_out() -> None:
    home = (1, 2, 3, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 7)
    right, long = (dialect.MAVLink_home_position_message(*home[0], q, *home[1]) for q in ([1.0] * 4, [1.0] * 5))
    assert Encoder(1, 1).pack(long) == Encoder(1, 1).pack(right)


def test_a_message_of_mavlink_2_goes_out_as_such() -> None:
    encoder = Encoder(1, 191, version=1)
    tunnel = dialect.MAVLink_tunnel_message(1, 1, 0, 3, list(range(128)))
    heartbeat = dialect.MAVLink_heartbeat_message(2, 3, 0, 0, 3, 3)
    assert [encoder.pack(m)[0] for m in (heartbeat, tunnel)] == [0xFE, 0xFD]


@pytest.mark.parametrize(("version", "at"), [(1, 2), (2, 4)])
def test_the_sequence_counts_packets_and_wraps(version: int, at: int) -> None:
    encoder = Encoder(1, 191, version)
    heartbeat = dialect.MAVLink_heartbeat_message(2, 3, 0, 0, 3, 3)
    assert [encoder.pack(heartbeat)[at] for _ in range(258)] == [*range(256), 0, 1]


def test_the_system_can_be_changed_and_the_sequence_goes_on() -> None:
    encoder = Encoder(1, 191)
    heartbeat = dialect.MAVLink_heartbeat_message(2, 3, 0, 0, 3, 3)
    encoder.pack(heartbeat)
    encoder.system = 42
    raw = encoder.pack(heartbeat)
    assert (encoder.system, raw[4], raw[5], raw[6]) == (42, 1, 42, 191)


@every(
    "message",
    [
        dialect.MAVLink_attitude_message(-1, 0, 0, 0, 0, 0, 0),
        dialect.MAVLink_attitude_message(2**32, 0, 0, 0, 0, 0, 0),
        dialect.MAVLink_attitude_message(1.5, 0, 0, 0, 0, 0, 0),
        dialect.MAVLink_attitude_message(0, 1e39, 0, 0, 0, 0, 0),
        dialect.MAVLink_attitude_message(0, None, 0, 0, 0, 0, 0),
        dialect.MAVLink_heartbeat_message(256, 0, 0, 0, 0, 0),
        dialect.MAVLink_tunnel_message(1, 1, 0, 5, [300] * 128),
        dialect.MAVLink_tunnel_message(1, 1, 0, 5, [0] * 127),
    ],
)
def test_a_value_that_does_not_fit_is_refused(message: Any) -> None:
    encoder = Encoder(1, 191)
    with pytest.raises(ValueError, match=message.get_type()):
        encoder.pack(message)
    assert encoder.pack(dialect.MAVLink_heartbeat_message(2, 3, 0, 0, 3, 3))[4] == 0  # it used up no number
