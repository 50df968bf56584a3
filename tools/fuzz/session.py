"""The session with an autopilot: packets of others do not change its state."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from typing import Any, Final

import numpy as np

from arva_hil.autopilot.following.session import Session
from arva_hil.events import Event
from arva_hil.events.words.reasons import no_pose, no_vehicle
from arva_hil.events.words.sentences import sentence
from arva_hil.links.tlog import TlogReader
from arva_hil.mavlink.codec import Encoder, Packet, Parser, decode, dialect
from arva_hil.model.field import LocalFrame
from tools.fuzz.script import ROOT, Script, packet

FRAME: Final = LocalFrame(46.5, 11.35, 1800.0)
MESSAGES: Final = sorted(dialect.mavlink_map)
LONGEST_PACKET: Final = 280
STEPS_S: Final = (0.0, 0.001, 0.01, 0.05, 0.1, 0.3, 1.0, 1.1, 2.6, 5.1, 31.0, 3600.0)


def fuzz(data: bytes) -> None:
    """One life of a session."""
    Bench(Script(data)).run()


class Bench:
    """A session, its link, and a twin that gets only the vehicle's packets: both must have the same state."""

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
            self._raw, self._advance, self._poll, self._interrupt, self._resume, self._any_message, self._unknown,
            self._heartbeat, self._position, self._attitude, self._quaternion, self._home, self._ack, self._hold,
            self._ask, self._damaged,
        )  # fmt: skip
        for count in itertools.count():
            if not self._s:
                break
            doings[self._s.number() % len(doings)]()
            self._check(thorough=count % 4 == 0)
        self._check(thorough=True)

    # what may happen

    def _raw(self) -> None:
        self._feed(self._s.take(self._s.number()))

    def _advance(self) -> None:
        self._now += STEPS_S[self._s.number() % len(STEPS_S)]

    def _poll(self) -> None:
        session, twin = self._sides
        out, events = session.poll(self._now)
        assert (out, events) == twin.poll(self._now)
        self._emitted(events)
        assert session.next_due == twin.next_due > self._now
        parser = Parser()
        packets = parser.feed(out)
        assert b"".join(p.raw for p in packets) == out
        for p in packets:
            assert p.known
            assert decode(p) is not None
            assert (p.system, p.component) == (session.encoder.system, session.encoder.component)

    def _interrupt(self) -> None:
        self._wire = b""
        for side in self._sides:
            side.interrupt("unplugged")

    def _resume(self) -> None:
        for side in self._sides:
            side.resume(self._now)

    def _any_message(self) -> None:
        msgid = MESSAGES[self._s.number("H") % len(MESSAGES)]
        self._send(msgid, self._s.take(self._s.number()))

    def _unknown(self) -> None:
        self._send(self._s.number("I") % (1 << 24), self._s.take(self._s.number() % 32))

    def _heartbeat(self) -> None:
        kind, autopilot, mode = self._s.take(3).ljust(3, b"\2")
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
        self._wire += self._s.take(1) or b"\xfd"

    def _ask(self) -> None:
        session = self._sides[0]
        assert len(no_vehicle(session.why_no_vehicle())) < 10_000
        assert no_pose(session.why_no_pose())

    def _emitted(self, events: Sequence[Event]) -> None:
        said = [sentence(event) for event in events]
        assert all(notice and notice.text and "\n" not in notice.text for notice in said)

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
        signed = how >> 4 & 1
        raw = packet(msgid, payload, source, flags=signed, version=version, sequence=self._sequence)
        raw += bytes(13) if signed and version == 2 else b""
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
        packets = session.reader.feed(chunk, self._now)
        self._emitted(session.receive(packets, self._now).events)
        self._fed += len(chunk)
        for p in packets:
            self._in_packets += len(p.raw)
            decode(p)
            if session.vehicle and (p.system, p.component) == (session.vehicle.system, session.vehicle.component):
                assert self._alone(twin, p) == [p]

    def _alone(self, twin: Session, p: Packet) -> Sequence[Packet]:
        twin.reader.parser.cut()
        packets = twin.reader.feed(p.raw, self._now)
        twin.receive(packets, self._now)
        return packets

    # what has to hold

    def _check(self, *, thorough: bool) -> None:
        session, twin = self._sides
        assert session.reader.bytes == self._fed
        held = self._fed - self._in_packets - session.reader.parser.skipped
        assert 0 <= held < LONGEST_PACKET, f"{held} bytes held back"
        vehicle = session.vehicle
        if vehicle is None:
            assert self._ids is None, "the vehicle is forgotten"
            known = session.navigation
            assert (known.track.newest, known.home, known.state_at(self._now, FRAME)) == (None, None, None)
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
        state = session.navigation.state_at(now, FRAME)
        pose = b""
        if state is not None:
            values = np.concatenate([state.position, state.velocity, state.attitude, [state.boot_s, state.age_s]])
            assert np.isfinite(values).all(), state
            assert abs(np.linalg.norm(state.attitude) - 1) < 0.1, state.attitude
            assert state.age_s >= 0, state
            pose = values.tobytes()
        rates = session.rates(now)
        assert all(math.isfinite(rate) and rate >= 0 for rate in rates.values()), rates
        if session.navigation.home:
            assert np.isfinite(session.navigation.home).all()
        told = session.navigation
        counts = told.reboots, told.refused, told.unpositioned, told.times.strays, told.places.strays
        known = session.vehicle, told.home, told.track.newest, list(told.track.positions)[:1]
        return pose, rates, counts, known, told.clock.boot(now)


def seeds() -> Iterator[bytes]:
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
