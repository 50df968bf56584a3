"""What tools/fuzz_python.py runs: a body for each target, which takes any bytes and fails by an exception.

The bytes are cut into operations here, so that what is mutated is a story and not only its spelling.
"""

from __future__ import annotations

import itertools
import json
import math
import re
import struct
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Final

import fuzz_logs
import numpy as np
import yaml
from fastcrc import crc16

from arva_hil import registry
from arva_hil.config import ScenarioError, load, parse, parse_fault, to_dict
from arva_hil.emulator.formats import TUNNEL_TYPE, MavlinkDecoder
from arva_hil.field import LocalFrame
from arva_hil.links.tlog import TlogReader
from arva_hil.mavlink.codec import Encoder, Packet, Parser, dialect
from arva_hil.observers.console.reasons import no_pose, no_vehicle
from arva_hil.observers.console.sentences import sentence
from arva_hil.vehicle.session import Session
from firmware_proto import MAX_CHANNELS, MAX_FRAME_BYTES, Answer, Channel, Command, Frame, FrameDecoder, encode
from firmware_proto.commands import NAMES, RESULTS
from firmware_proto.messages import MAX_MESSAGE_BYTES, StreamDecoder

ROOT: Final = Path(__file__).parent.parent
FRAME: Final = LocalFrame(46.5, 11.35, 1800.0)
MESSAGES: Final = sorted(dialect.mavlink_map)
LONGEST_PACKET: Final = 280
STEPS_S: Final = (0.0, 0.001, 0.01, 0.05, 0.1, 0.3, 1.0, 1.1, 2.6, 5.1, 31.0, 3600.0)
PAUSES_S: Final = (0.0, 0.001, 0.02, 0.06, 0.099, 0.101, 1.0, 100.0)


class Script:
    """Numbers and bytes off the front of the input; zeros and nothing behind its end."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self._at = 0

    def __bool__(self) -> bool:
        return self._at < len(self._data)

    def bytes(self, count: int) -> bytes:
        self._at += count
        return self._data[self._at - count : self._at]

    def number(self, layout: str = "B") -> Any:
        size = struct.calcsize("<" + layout)
        return struct.unpack("<" + layout, self.bytes(size).ljust(size, b"\0"))[0]


# -- the scenario loader -----------------------------------------------------------------------------------

_FOLDER: Final = tempfile.TemporaryDirectory(prefix="arva-fuzz-")
_FILE: Final = Path(_FOLDER.name, "f.yaml")
_BREAK: Final = re.compile("\r\n|[\n\r\x85\u2028\u2029]")


def loader(data: bytes) -> None:
    """A scenario file, or, behind `--fault `, a fault on the command line."""
    if data.startswith(b"--fault "):
        _fault(data.removeprefix(b"--fault ").decode(errors="surrogateescape"))
        return
    _FILE.write_bytes(data)
    try:
        scenario = load(_FILE)
    except ScenarioError as error:
        _refused(error, data)
        return
    plain = to_dict(scenario)
    assert parse(json.dumps(plain), "") == scenario
    assert parse(yaml.safe_dump(plain), "") == scenario
    for fault in scenario.faults:
        parse_fault(str(fault))


def _fault(text: str) -> None:
    try:
        str(parse_fault(text))
    except ValueError as error:
        if not str(error).startswith(repr(text)):
            raise AssertionError("not said which") from error


def _refused(error: ScenarioError, data: bytes) -> None:
    problems = error.problems
    assert problems
    assert str(error) == "\n".join(map(str, problems))
    assert len(str(error).splitlines()) == len(problems), "a message of more than one line"
    places = [(p.line, p.column) for p in problems]
    assert places == sorted(places), "not sorted by place"
    lines = _BREAK.split(data.decode(errors="replace"))
    for line, column in places:
        assert 1 <= line <= len(lines), f"line {line} of {len(lines)}"
        assert 1 <= column <= len(lines[line - 1]) + 1, f"column {column} of line {line}"


# -- the MAVLink session -----------------------------------------------------------------------------------


def packet(source: tuple[int, int], msgid: int, payload: bytes, *, version: int, flags: int, sequence: int) -> bytes:
    """A whole packet, its checksum right if the dialect knows the message."""
    if version == 1:
        head = bytes([len(payload), sequence, *source, msgid & 0xFF])
        magic, tail = b"\xfe", b""
    else:
        head = bytes([len(payload), flags, 0, sequence, *source]) + msgid.to_bytes(3, "little")
        magic, tail = b"\xfd", bytes(13) if flags & 1 else b""
    extra = dialect.mavlink_map[msgid].crc_extra if msgid in dialect.mavlink_map else 0
    return magic + head + payload + crc16.mcrf4xx(head + payload + bytes([extra])).to_bytes(2, "little") + tail


class Bench:
    """A session, its link, and a twin that is told only what the vehicle sends: both have to know the same."""

    def __init__(self, s: Script) -> None:
        options = s.number()
        chosen: dict[str, Any] = {"target_system": 1} if options & 1 else {}
        chosen |= {"target_component": 2} if options & 2 else {}
        chosen |= {"passive": True} if options & 4 else {"rate_hz": 4.0} if options & 8 else {}
        self._s = s
        self._chosen = chosen
        self._sides = Session(**chosen), Session(**chosen)
        self._now = 1000.0
        self._boot_ms = 10_000
        self._sequence = 0
        self._wire = b""
        self._fed = self._in_packets = 0
        self._ids: tuple[int, int] | None = None

    def run(self) -> None:
        doings = (
            self._raw,
            self._advance,
            self._poll,
            self._interrupt,
            self._resume,
            self._any_message,
            self._unknown,
            self._heartbeat,
            self._position,
            self._attitude,
            self._quaternion,
            self._home,
            self._ack,
            self._hold,
            self._ask,
            self._damaged,
        )
        for count in itertools.count():
            if not self._s:
                break
            doings[self._s.number() % len(doings)]()
            self._check(thorough=count % 4 == 0)
        self._check(thorough=True)

    # what may happen

    def _raw(self) -> None:
        self._feed(self._s.bytes(self._s.number()))

    def _advance(self) -> None:
        self._now += STEPS_S[self._s.number() % len(STEPS_S)]

    def _poll(self) -> None:
        session, twin = self._sides
        out = session.poll(self._now)
        assert out == twin.poll(self._now)
        assert session.next_due == twin.next_due > self._now
        parser = Parser()
        packets = parser.feed(out)
        assert b"".join(p.raw for p in packets) == out
        for p in packets:
            assert p.known
            assert parser.decode(p) is not None
            assert (p.system, p.component) == (session.encoder.system, session.component)

    def _interrupt(self) -> None:
        self._wire = b""
        for side in self._sides:
            side.interrupt("unplugged")

    def _resume(self) -> None:
        for side in self._sides:
            side.resume(self._now)

    def _any_message(self) -> None:
        msgid = MESSAGES[self._s.number("H") % len(MESSAGES)]
        self._send(msgid, self._s.bytes(self._s.number()))

    def _unknown(self) -> None:
        self._send(self._s.number("I") % (1 << 24), self._s.bytes(self._s.number() % 32))

    def _heartbeat(self) -> None:
        kind, autopilot, mode = self._s.bytes(3).ljust(3, b"\2")
        self._say(dialect.MAVLink_heartbeat_message(kind, autopilot, mode, 0, 3, 3))

    def _position(self) -> None:
        lat, lon = 465_000_000 + self._s.number("h"), 113_500_000 + self._s.number("h")
        velocity = [self._s.number("h") for _ in range(3)]
        self._say(dialect.MAVLink_global_position_int_message(self._stamp(), lat, lon, 1_800_000, 0, *velocity, 0))

    def _attitude(self) -> None:
        self._say(dialect.MAVLink_attitude_message(self._stamp(), *(self._s.number("e") for _ in range(6))))

    def _quaternion(self) -> None:
        q = [self._s.number("b") / 64 for _ in range(4)]
        rates = [self._s.number("e") for _ in range(3)]
        self._say(dialect.MAVLink_attitude_quaternion_message(self._stamp(), *q, *rates))

    def _home(self) -> None:
        where = (self._s.number("i") for _ in range(3))
        self._say(dialect.MAVLink_home_position_message(*where, 0, 0, 0, [1, 0, 0, 0], 0, 0, 0))

    def _ack(self) -> None:
        kinds = (dialect.MAV_CMD_SET_MESSAGE_INTERVAL, dialect.MAV_CMD_REQUEST_MESSAGE, self._s.number("H"))
        target = ((0, 0), (1, 191), (self._s.number(), self._s.number()))[self._s.number() % 3]
        kind = kinds[self._s.number() % 3]
        self._say(dialect.MAVLink_command_ack_message(kind, self._s.number(), 0, 0, *target))

    def _hold(self) -> None:
        """The next packets come in one chunk with those behind it, which is cut where the input says."""
        self._wire += self._s.bytes(1) or b"\xfd"

    def _ask(self) -> None:
        session = self._sides[0]
        assert len(no_vehicle(session.heard())) < 10_000
        assert no_pose(session.why_no_pose())
        said = [sentence(event) for event in session.take_events()]
        assert all(notice and notice.text and "\n" not in notice.text for notice in said)
        self._sides[1].take_events()

    def _damaged(self) -> None:
        at, bit = self._s.number(), self._s.number() % 8
        raw = bytearray(Encoder(1, 1).pack(dialect.MAVLink_attitude_message(self._boot_ms, 1, 1, 1, 0, 0, 0)))
        raw[at % len(raw)] ^= 1 << bit
        self._feed(bytes(raw))

    # how it gets there

    def _stamp(self) -> int:
        """Boot time, usually going on as the host's does."""
        self._boot_ms = (self._boot_ms + self._s.number("h")) % (1 << 32)
        return self._boot_ms

    def _say(self, message: Any) -> None:
        message.pack(dialect.MAVLink(None))
        self._send(message.id, bytes(message.get_payload()))

    def _send(self, msgid: int, payload: bytes) -> None:
        """From whom, and as which packet, is told by one byte: mostly the vehicle's, MAVLink 2."""
        how = self._s.number()
        source = ((1, 1), (1, 1), (1, 1), (1, 2), (2, 1), (255, 190), (0, 0), (self._s.number(), 1))[how & 7]
        version = 1 if how & 8 and msgid < 256 else 2
        self._sequence = (self._sequence + 1) % 256
        flags = how >> 4 & 1
        raw = packet(source, msgid, payload, version=version, flags=flags, sequence=self._sequence)
        if how & 32:
            self._wire += raw
        elif how & 64:
            at = self._s.number() % (len(raw) + 1)
            self._feed(raw[:at])
            self._feed(raw[at:])
        else:
            self._feed(raw)

    def _feed(self, chunk: bytes) -> None:
        session, twin = self._sides
        chunk, self._wire = self._wire + chunk, b""
        packets = session.feed(chunk, self._now)
        self._fed += len(chunk)
        for p in packets:
            self._in_packets += len(p.raw)
            session.parser.decode(p)
            if session.vehicle and (p.system, p.component) == (session.vehicle.system, session.vehicle.component):
                assert self._alone(twin, p) == [p]

    def _alone(self, twin: Session, p: Packet) -> list[Packet]:
        twin.parser.cut()
        return twin.feed(p.raw, self._now)

    # what has to hold

    def _check(self, *, thorough: bool) -> None:
        session, twin = self._sides
        assert session.reader.bytes == self._fed
        held = self._fed - self._in_packets - session.parser.skipped
        assert 0 <= held < LONGEST_PACKET, f"{held} bytes held back"
        vehicle = session.vehicle
        if vehicle is None:
            assert self._ids is None, "the vehicle is forgotten"
            assert session.track.newest is session.home is session.state_at(self._now, FRAME) is None
            return
        ids = vehicle.system, vehicle.component
        assert self._ids in (None, ids), f"the vehicle was {self._ids}, is {ids}"
        self._ids = ids
        assert vehicle.system == self._chosen.get("target_system", vehicle.system)
        assert vehicle.component == self._chosen.get("target_component", 1)
        assert session.lost == twin.lost
        if not thorough:
            return
        ours, theirs = (self._knowledge(side) for side in self._sides)
        assert ours == theirs, f"another's packet told something: {ours} instead of {theirs}"

    def _knowledge(self, session: Session) -> tuple[object, ...]:
        now = self._now
        state = session.state_at(now, FRAME)
        pose = b""
        if state is not None:
            values = np.concatenate([state.position, state.velocity, state.attitude, [state.boot_s, state.age_s]])
            assert np.isfinite(values).all(), state
            assert abs(np.linalg.norm(state.attitude) - 1) < 0.1, state.attitude
            assert state.age_s >= 0, state
            pose = values.tobytes()
        rates = session.rates(now)
        assert all(math.isfinite(rate) and rate >= 0 for rate in rates.values()), rates
        if session.home:
            assert np.isfinite(session.home).all()
        told = session.navigation
        counts = told.reboots, told.refused, told.unpositioned, told.times.strays, told.places.strays
        known = session.vehicle, session.home, session.track.newest, session.track.first_position
        return pose, rates, counts, known, session.clock.boot(now)


def session(data: bytes) -> None:
    """One life of a session."""
    Bench(Script(data)).run()


# -- the frame decoders ------------------------------------------------------------------------------------

DECODERS: Final = {
    name: registry.FORMATS[name].decoder for name in registry.FORMATS if name not in registry.MAVLINK_FORMATS
}
ENCODERS: Final = {name: registry.FORMATS[name].encode for name in DECODERS}
FORMATS: Final = tuple(registry.FORMATS)
_HELD: Final = {"binary": MAX_FRAME_BYTES, "nmea": 82 * (MAX_CHANNELS + 1), "text": 16}  # bytes, at most
_HELD |= dict.fromkeys(registry.MEASURED_FORMATS, 2 * MAX_MESSAGE_BYTES)  # a message waits for its frame
_HELD_IN_SILENCE: Final = {"binary": 0, "nmea": 82, "text": 16}
_HELD_IN_SILENCE |= dict.fromkeys(registry.MEASURED_FORMATS, MAX_MESSAGE_BYTES)
_COUNTERS: Final = ("good", "bad_crc", "dropped", "lost")


def decoder(data: bytes) -> None:
    """A format, then chunks: how long the pause before each is, how many bytes it has, and they."""
    s = Script(data)
    format = FORMATS[s.number() % len(FORMATS)]
    chunks: list[tuple[float, bytes]] = []
    now = 0.0
    while s:
        now += PAUSES_S[s.number() % len(PAUSES_S)]
        chunks.append((now, s.bytes(s.number())))
    if format in registry.MAVLINK_FORMATS:
        _through_the_autopilot(MavlinkDecoder(format), chunks)
        return
    chunks.append((now + 1000, b""))
    whole, piecemeal = DECODERS[format](), DECODERS[format]()
    frames: list[Frame] = []
    fed = in_frames = at_most = 0
    for at, chunk in chunks:
        got = whole.feed(chunk, at)
        parts = [chunk[k : k + 1] for k in range(len(chunk))] or [chunk]
        assert got == [frame for part in parts for frame in piecemeal.feed(part, at)], "chunking matters"
        frames += got
        fed += len(chunk)
        in_frames += sum(_sizes(format, frame)[0] for frame in got)
        at_most += sum(_sizes(format, frame)[1] for frame in got)
        assert fed - whole.dropped >= in_frames, "bytes counted twice"
        assert fed - whole.dropped - at_most <= _HELD[format], "too many bytes held back"
    assert fed - whole.dropped - at_most <= _HELD_IN_SILENCE[format], "too many bytes held for ever"
    counts = [getattr(whole, name) for name in _COUNTERS]
    assert counts == [getattr(piecemeal, name) for name in _COUNTERS], "chunking matters to the counters"
    assert whole.good == len(frames)
    assert whole.lost == _lost(frames)
    for frame in frames:
        _plausible(frame, zones=128)
    if format == "binary" or format in registry.MEASURED_FORMATS:
        _in_order(b"".join(chunk for _, chunk in chunks), frames)


def _sizes(format: str, frame: Frame) -> tuple[int, int]:
    """The fewest and the most bytes that can have brought a frame."""
    count = len(frame.channels)
    if format == "binary" or format in registry.MEASURED_FORMATS:
        measured = 0 if frame.measured is None else 15 + (15 if format == "vector" else 6) * count
        return 9 + 6 * count + measured, 9 + 6 * count + measured
    return (25 * count, 82 * count) if format == "nmea" else (4, 16)


def _in_order(data: bytes, frames: list[Frame]) -> None:
    at = 0
    for frame in frames:
        known = tuple(c._replace(zone=min(c.zone, 2)) for c in frame.channels)
        raw = bytearray(encode(frame._replace(channels=known)))  # without what was measured
        for k, c in enumerate(frame.channels):
            raw[8 + 6 * k] = c.zone | (0x80 if c.marked else 0)
        raw[-2:] = crc16.mcrf4xx(bytes(raw[2:-2])).to_bytes(2, "little")
        found = data.find(raw, at)
        assert found >= 0, f"{frame} was never sent"
        at = found + len(raw)


def _through_the_autopilot(decoder: FrameDecoder, chunks: list[tuple[float, bytes]]) -> None:
    """MAVLink's own framing is right here, so that what is inside it is what is mutated."""
    ids = (dialect.MAVLINK_MSG_ID_TUNNEL, dialect.MAVLINK_MSG_ID_NAMED_VALUE_INT, dialect.MAVLINK_MSG_ID_DEBUG_VECT)
    ids += (dialect.MAVLINK_MSG_ID_NAMED_VALUE_FLOAT,)
    got: list[Frame] = []
    for k, (at, chunk) in enumerate(chunks):
        if chunk[:1] in (b"\xfe", b"\xfd"):
            raw = chunk
        else:
            kind = ids[(chunk or b"\0")[0] % len(ids)]
            raw = packet((1, 1), kind, chunk[1:255], version=2, flags=0, sequence=k % 256)
        got += decoder.feed(raw, at)
    assert decoder.good == len(got)
    assert decoder.lost == _lost(got)
    for frame in got:
        _plausible(frame, zones=128)


def _plausible(frame: Frame, zones: int) -> None:
    assert 0 <= frame.sequence <= 255
    assert 0 <= frame.status <= 255
    assert 1 <= len(frame.channels) <= MAX_CHANNELS, frame
    for c in frame.channels:
        assert c.id is None or 0 <= c.id <= 254, c
        assert 0 <= c.zone < zones, c


def _lost(frames: list[Frame]) -> int:
    numbers = [frame.sequence for frame in frames]
    gaps = [(b, max((b - a) % 256 - 1, 0)) for a, b in itertools.pairwise(numbers)]
    return sum(gap for number, gap in gaps if number > 15 or gap < 17)


# -- commands and answers ----------------------------------------------------------------------------------

_HOSTS: Final = (registry.FORMATS["binary"].host, registry.FORMATS["nmea"].host)


def commands(data: bytes) -> None:
    """Which form and way, then chunks as above. What comes out was sent, and what is sent back comes out again."""
    s = Script(data)
    kind = s.number() % 4
    host = _HOSTS[kind // 2]
    make, write = (host.commands, host.command) if kind % 2 == 0 else (host.answers, host.answer)
    whole: StreamDecoder[Any] = make()
    piecemeal: StreamDecoder[Any] = make()
    got: list[Any] = []
    fed, now = bytearray(), 0.0
    while s:
        now += PAUSES_S[s.number() % len(PAUSES_S)]
        chunk = s.bytes(s.number())
        fed += chunk
        came = whole.feed(chunk, now)
        parts = [chunk[k : k + 1] for k in range(len(chunk))] or [chunk]
        assert came == [one for part in parts for one in piecemeal.feed(part, now)], "chunking matters"
        got += came
        assert whole.dropped <= len(fed), "bytes counted twice"
    assert whole.feed(b"", now + 1000) == piecemeal.feed(b"", now + 1000)
    counts = [(one.good, one.bad_crc, one.dropped) for one in (whole, piecemeal)]
    assert counts[0] == counts[1], "chunking matters to the counters"
    for one in got:
        raw = write(one)
        assert make().feed(raw, 0.0) == [one], f"{one} does not come back"
        if kind < 2:
            assert raw[5] ^ raw[4] in (16, 17)
            assert 0xA4 not in raw[1:-2]


# -- what to begin with ------------------------------------------------------------------------------------


def _loader_seeds() -> Iterator[bytes]:
    for path in sorted(ROOT.glob("configs/*.yaml")):
        yield path.read_bytes()
    for path in sorted(ROOT.glob("tests/broken/files/*.yaml")):
        yield path.read_bytes()
    for path in sorted(ROOT.glob("tests/broken/scenarios/*.txt")):
        yield from re.split(rb"(?m)^=== .*\n(?:#> .*\n)*", path.read_bytes())[1:]
    yield b"--fault drop=0.02@10-60"
    yield b"--fault transmitter_moved=1,by_ned=[5,0,0],every_s=3,for_s=1@10"


def _session_seeds() -> Iterator[bytes]:
    for path in sorted(ROOT.glob("tests/data/*.tlog")):
        script = bytearray(1)
        for record, _ in zip(TlogReader(path), range(60), strict=False):
            if len(record.raw) < 256:
                script += bytes([1, 3, 0, len(record.raw)]) + record.raw + b"\2"
        yield bytes(script)
    beat, pose = bytes([7, 2, 3, 128, 0]), bytes([8, 100, 0, *bytes(10), 0, 9, 10, 0, *bytes(12), 0, 1, 6, 2])
    yield bytes(1) + beat + 4 * pose + bytes([14])
    yield bytes(1) + 3 * (beat + pose) + b"\3\1\6\4" + beat + pose
    yield bytes(1) + beat + bytes([2, 12, 0, 0, 0, 0, 0, 0, 4, 0, 2, 1, 10, 2, 14]) + beat + 3 * pose


def _decoder_seeds() -> Iterator[bytes]:
    vectors = json.loads((ROOT / "firmware_proto/vectors.json").read_text(encoding="utf-8"))
    frames = [Frame(v["sequence"], v["status"], tuple(Channel(**c) for c in v["channels"])) for v in vectors["frames"]]
    for stream in vectors["streams"]:
        script, now = bytearray([list(DECODERS).index(stream.get("format", "binary"))]), 0.0
        for step in stream["steps"]:
            pause = max(k for k, s in enumerate(PAUSES_S) if s <= step["t"] - now + 1e-9)
            data, now = bytes.fromhex(step["hex"]), step["t"]
            for at in range(0, len(data) or 1, 255):
                script += bytes([0 if at else pause, len(data[at : at + 255])]) + data[at : at + 255]
        yield bytes(script)
    for vector in vectors["frames"]:
        for number, form in enumerate(DECODERS):
            data = bytes.fromhex(vector["hex"]) if form == "binary" else vector.get(form, "").encode()
            yield bytes([number]) + b"".join(
                b"\0" + bytes([len(data[k : k + 255])]) + data[k : k + 255] for k in range(0, len(data), 255)
            )
    for number, form in enumerate(DECODERS):
        for first, second in itertools.pairwise(frames[:12]):
            data = ENCODERS[form](first) + ENCODERS[form](second)
            cuts = [0, len(data) // 3, len(data) // 2, len(data) * 2 // 3, len(data)]
            parts = [data[a:b][:255] for a, b in itertools.pairwise(cuts)]
            yield bytes([number]) + b"".join(b"\3" + bytes([len(part)]) + part for part in parts)
    for frame in frames[:6]:
        raw = encode(frame)
        inside = b"\0" + struct.pack("<HBBB", TUNNEL_TYPE, 1, 1, len(raw)) + raw
        yield bytes([FORMATS.index("tunnel")]) + 2 * (b"\0" + bytes([len(inside)]) + inside)
    named = [(b"ARVA1_D", 1234), (b"ARVA1_DIR", 17), (b"ARVA1_ID", 1), (b"ARVA2_D", 99), (b"ARVA1_D", 1)]
    parts = [b"\1" + struct.pack("<Ii10s", 1, value, name) for name, value in named]
    yield bytes([FORMATS.index("named")]) + b"".join(b"\0" + bytes([len(part)]) + part for part in parts)
    parts = [b"\3" + struct.pack("<If10s", 1, value, name) for name, value in named]
    yield bytes([FORMATS.index("named_float")]) + b"".join(b"\0" + bytes([len(part)]) + part for part in parts)
    parts = [b"\2" + struct.pack("<Qfff10s", 1234, 17.0, 99.0, 3.0, name) for name in (b"a", b"b", b"a", b"b")]
    yield bytes([FORMATS.index("debug_vect")]) + b"".join(b"\0" + bytes([len(part)]) + part for part in parts)


def _command_seeds() -> Iterator[bytes]:
    asked = [Command(k, name, values) for k, name in enumerate(NAMES) for values in ((), (k,), (-(2**31), 0xA4, 1, 2))]
    answers = [Answer(k, name, RESULTS[k % 4], (k,), "a text" * (k % 3)) for k, name in enumerate(NAMES)]
    for kind in range(4):
        write: Callable[[Any], bytes] = _HOSTS[kind // 2].command if kind % 2 == 0 else _HOSTS[kind // 2].answer
        every: list[Any] = list(asked if kind % 2 == 0 else answers)
        for first, second in itertools.pairwise(every):
            data = write(first) + write(second)
            parts = [data[:5], data[5:20], data[20:]]
            yield bytes([kind]) + b"".join(b"\3" + bytes([len(part)]) + part for part in parts)
            yield bytes([kind, 0, 5]) + b"\xa4\x57\x02\x08\x00" + bytes([1, len(data)]) + data


TARGETS: Final[dict[str, tuple[Callable[[bytes], None], Callable[[], Iterator[bytes]]]]] = {
    "loader": (loader, _loader_seeds),
    "session": (session, _session_seeds),
    "decoder": (decoder, _decoder_seeds),
    "commands": (commands, _command_seeds),
    "log": (fuzz_logs.log, fuzz_logs.seeds),
}
