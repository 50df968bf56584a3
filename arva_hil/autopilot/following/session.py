"""The session with one vehicle: bytes in, bytes out."""

from __future__ import annotations

import math
from collections.abc import Callable, Container, Hashable, Iterator, Sequence
from dataclasses import replace
from typing import Any, Final, NamedTuple

from arva_hil.autopilot.following.discovery import Identity, Senders, Vehicle, VehicleDiscovery
from arva_hil.autopilot.following.navigation import HANDLED, Navigation
from arva_hil.autopilot.following.streams import Streams
from arva_hil.events import Event, vehicles
from arva_hil.events.reasons import NoPose, NoVehicle, NoVehicleReason, Reason, SilentStream, Why, because
from arva_hil.mavlink.codec import Encoder, Packet, decode, dialect
from arva_hil.mavlink.packet_reader import PacketReader
from arva_hil.mavlink.signing import Signing


class Received(NamedTuple):
    """The packets of one chunk, and their events.

    Each packet is in one of the first three lists. These are empty if the sender is not accepted.
    """

    own: Sequence[Packet] = ()
    """The vehicle's packets."""
    others: Sequence[Packet] = ()
    """Packets of other systems and components, and packets that only claim to be the vehicle's."""
    refused: Sequence[Packet] = ()
    """Packets without a valid signature, if the link has a key."""
    events: Sequence[Event] = ()
    """Events of the vehicle."""

    @property
    def accepted(self) -> Sequence[Packet]:
        """Packets of all systems, without the refused ones."""
        return [*self.own, *self.others]

    def messages(self, wanted: Container[int]) -> Iterator[tuple[int, Any]]:
        """Decode the vehicle's messages of these kinds: message id and message."""
        for packet in self.own:
            if packet.msgid in wanted and (message := decode(packet)) is not None:
                yield packet.msgid, message


COMPONENT: Final = dialect.MAV_COMP_ID_ONBOARD_COMPUTER  # 191

_HEARTBEAT_S: Final = 1.0
_LOST_S: Final = 5.0  # without a heartbeat
_GAP_S: Final = 2.5  # after this gap between heartbeats the vehicle may have forgotten the requests
_POLL_S: Final = 0.1  # how often requests and time-outs are checked

_ACK: Final = dialect.MAVLINK_MSG_ID_COMMAND_ACK
_HEARTBEAT: Final = dialect.MAVLINK_MSG_ID_HEARTBEAT
_HOME: Final = dialect.MAVLINK_MSG_ID_HOME_POSITION
_DECODED: Final = HANDLED | {_ACK}


def heartbeat() -> Any:
    """Return the heartbeat of an onboard computer.

    One of a ground station could mask the vehicle's link-loss failsafe.
    """
    kind, active = dialect.MAV_TYPE_ONBOARD_CONTROLLER, dialect.MAV_STATE_ACTIVE
    return dialect.MAVLink_heartbeat_message(kind, dialect.MAV_AUTOPILOT_INVALID, 0, 0, active, 3)


class Heartbeats:
    """Remembers the heartbeats of both ends. `passive`: this end never sends. Times are host seconds.

    `lost`: the vehicle's have stopped. `interrupted`: the reason why the link is lost, "" while it is not.
    """

    def __init__(self, *, passive: bool) -> None:
        self.passive = passive
        self.lost = False
        self.interrupted = ""
        self.last_s = -math.inf  # the vehicle's last one
        self.next_s = -math.inf  # when ours is due


class Session:
    """Follows one vehicle: found by its first heartbeat, then recognized by its system and component ids.

    - `target_system`, `target_component`: follow only these (default: the first autopilot, component 1).
    - `rate_hz`: of the pose streams. `passive`: never send, for a log. `component`: our own id.
    - `signing`: sign, and accept only packets signed with its key.
    - `reader`: of the link, if several sessions share it: each receives the packets that it has read.
    - `name`: the vehicle's, in its events.

    Times are host seconds from the caller's clock. Packets of other systems change nothing. After 3 s of silence of the
    vehicle's sender, another sender with the vehicle's ids may replace it.
    """

    def __init__(
        self,
        *,
        target_system: int | None = None,
        target_component: int | None = None,
        rate_hz: float = 50.0,
        passive: bool = False,
        component: int = COMPONENT,
        signing: Signing | None = None,
        reader: PacketReader | None = None,
        name: str = "vehicle",
    ) -> None:
        self.name = name
        self.reader = reader = reader or PacketReader(signing)
        self.senders = Senders()
        self.encoder = Encoder(target_system or 1, component, signing=reader.signing)
        self.vehicle: Vehicle | None = None
        self.next_due = -math.inf
        self._events: list[Event] = []  # since the last `receive` or `poll`
        self.navigation = Navigation(self._emit)
        self.streams = Streams(rate_hz, self._emit)
        self._finder = VehicleDiscovery(target_system, target_component)
        self._identity: Identity | None = None  # of the pinned vehicle
        self._heartbeats = Heartbeats(passive=passive)

    @property
    def target_system(self) -> int | None:
        """System id of the vehicle to follow; None: any."""
        return self._finder.system

    @property
    def lost(self) -> bool:
        """True if the vehicle's heartbeat has stopped."""
        return self._heartbeats.lost

    @property
    def usurped(self) -> Reason | None:
        """The reason why the sender is not the pinned vehicle any more; None while it is."""
        return self._identity.why if self._identity else None

    @property
    def doubtful(self) -> bool:
        """True if the last message may be from another vehicle than the pinned one."""
        return self._identity is not None and (self._identity.doubtful or self._identity.why is not None)

    @property
    def reachable(self) -> bool:
        """True if something can be sent to the vehicle."""
        beats = self._heartbeats
        return self.vehicle is not None and not (beats.lost or beats.passive or beats.interrupted)

    @property
    def ignored(self) -> int:
        """The number of packets that are not the vehicle's."""
        return self._finder.ignored

    def rates(self, now: float) -> dict[str, float]:
        """Return measured rates [Hz] of the pose streams; none before there is a vehicle."""
        return self.streams.rates(now) if self.vehicle else {}

    def feed(self, chunk: bytes, now: float, sender: Hashable = None, *, whole: bool = False) -> Received:
        """Use bytes that came at `now` on a link with only this vehicle's session. Never raises.

        `sender`: one of several on the link. `whole`: no packet continues in the next chunk, as in a record of a log.
        """
        stranger = not self.accepts(sender, now)
        return self.receive(self.reader.feed(chunk, now, sender, stranger=stranger, whole=whole), now, sender)

    def accepts(self, sender: Hashable, now: float) -> bool:
        """Return True if packets of a sender may be the vehicle's. The link is being read at `now`."""
        if sender is not None:
            self.senders.on_read(now)
        return self.vehicle is None or self.senders.accepts(sender, now)

    def follows(self, sender: Hashable) -> bool:
        """Return True if the vehicle uses this sender; also while there is no vehicle."""
        return self.vehicle is None or bool(sender == self.senders.vehicle)

    def receive(self, packets: Sequence[Packet], now: float, sender: Hashable = None) -> Received:
        """Use the packets of one chunk, which the link's `reader` has split and checked."""
        if sender != self.senders.vehicle and not self.accepts(sender, now):
            self._on_strangers(packets, now)
            return Received(events=self._emitted())
        own: list[Packet] = []
        others: list[Packet] = []
        refused: list[Packet] = []
        for packet in packets:
            vehicle, msgid = self.vehicle, packet.msgid
            if packet.refused:
                refused.append(packet)
                self._on_refused(packet, now)
            elif vehicle is None or msgid == _HEARTBEAT:
                (own if self._discover(packet, now, sender) else others).append(packet)
            elif (packet.system, packet.component, sender) == (vehicle.system, vehicle.component, self.senders.vehicle):
                own.append(packet)
                if msgid in _DECODED and (message := decode(packet)) is not None:
                    self._on_ack(message, now) if msgid == _ACK else self._navigate(message, now)
            else:
                self._finder.ignored += 1
                others.append(packet)
        if sender is not None and own:
            self.senders.on_packet(sender, now)
        if extras := self.streams.extra_ids:
            for packet in own:
                if packet.msgid in extras:
                    self.streams.on_message(packet.msgid, now)
        return Received(own, others, refused, self._emitted() if self._events else ())

    def pin(self) -> None:
        """Keep the vehicle from now on. Another one with its ids is ignored, and `usurped` says so."""
        self._identity = Identity(self.navigation.clock.rate)
        self.senders.pin()

    def poll(self, now: float) -> tuple[bytes, Sequence[Event]]:
        """Return the bytes to send now, our heartbeat and requests for streams; and the events. Sets `next_due`."""
        beats = self._heartbeats
        if now - beats.last_s > _LOST_S and self.vehicle and not (beats.lost or beats.interrupted):
            beats.lost = True
            self._emit(vehicles.VehicleLost, now, str(self.vehicle), _LOST_S)
        if self.reader.signing:
            self.reader.signing.advance(now)
        if beats.passive:
            self.next_due = math.inf
            return b"", self._emitted() if self._events else ()
        self.next_due = now + _POLL_S
        if self.senders.vehicle is not None:
            self.senders.on_read(now)
        if beats.interrupted:
            return b"", self._emitted()
        out = b""
        if now >= beats.next_s:
            due = beats.next_s + _HEARTBEAT_S
            beats.next_s = due if due > now else now + _HEARTBEAT_S
            out += self.encoder.pack(heartbeat())
        home = self.navigation.home is None
        if self.vehicle and not beats.lost and (home or now >= self.streams.next_check):
            to = self.vehicle.system, self.vehicle.component
            out += b"".join(map(self.encoder.pack, self.streams.poll(now, *to, home=home)))
        return out, self._emitted() if self._events else ()

    def interrupt(self, why: str) -> None:
        """Handle a lost link: until `resume` nothing can be sent, and silence does not count."""
        self._heartbeats.interrupted = why
        self.reader.parser.cut()
        self.senders.release()

    def resume(self, now: float) -> None:
        """Handle a link that is back: send a heartbeat and request all streams again, at once.

        If the vehicle's boot time continues, so does its pose track. If it has gone back, the vehicle has rebooted.
        """
        self._heartbeats.interrupted = ""
        self.next_due = self._heartbeats.next_s = self._heartbeats.last_s = now
        self._heartbeats.lost = False
        self.senders.resume(now)
        self.navigation.renew()
        self.streams.renew(now)

    def skip(self, now: float) -> None:
        """Handle a pause in reading: silence until `now` does not count."""
        self._heartbeats.last_s = max(self._heartbeats.last_s, now)

    def _emit(self, kind: Callable[..., Event], now: float, *values: Any) -> None:
        """Emit an event of the vehicle."""
        self._events.append(kind(now, self.name, *values))

    def _emitted(self) -> Sequence[Event]:
        """Return the events since the last call."""
        events, self._events = self._events, []
        return events

    def _on_refused(self, packet: Packet, now: float) -> None:
        """Report each reason for refused packets once, with the first sender."""
        if packet.refused not in self._finder.refusals:
            self._finder.refusals.add(packet.refused)
            about = packet.system, packet.component, packet.refused
            self._emit(vehicles.SignatureRefused, now, *about)

    def _discover(self, packet: Packet, now: float, sender: Hashable) -> bool:
        """Use a heartbeat, or any packet before the vehicle is known. Returns True if it is the vehicle's."""
        if packet.msgid != _HEARTBEAT:
            self._finder.count(packet, "packets")
            self.senders.meet(sender, candidate=True)
            return False
        if (message := decode(packet)) is None:
            return False
        known = self.vehicle
        if known and known.sent(packet) and known.is_like(message):
            self.senders.on_packet(sender, now)
            self._on_heartbeat(message, now)
            return True
        found = self._finder.vehicle(packet, message)
        if found and known and known.sent(packet) and self._identity:
            self._identity.why = because(Why.OTHER_IDS, vehicle=str(known), other=str(found))
        elif found and (known is None or (self._heartbeats.lost and known.sent(packet))):
            self.senders.on_packet(sender, now)
            self._follow(found, now, signed=packet.signed)
            return True
        elif known:
            self._finder.ignored += 1
            self._report_other(packet, found, now)
        else:
            self.senders.meet(sender, candidate=False)
        return False

    def _on_strangers(self, packets: Sequence[Packet], now: float) -> None:
        """Handle packets of other senders: they change nothing, but another autopilot is reported."""
        for packet in packets:
            if packet.msgid != _HEARTBEAT or self.reader.signing:
                continue
            message = decode(packet)
            if message is not None and (found := self._finder.vehicle(packet, message)):
                self._report_other(packet, found, now)

    def _report_other(self, packet: Packet, found: Vehicle | None, now: float) -> None:
        """Report each autopilot that is not the vehicle once."""
        assert self.vehicle is not None
        same = self.vehicle.sent(packet)
        if (found or same) and self._finder.count(packet, "other"):
            self._emit(vehicles.OtherAutopilotIgnored, now, packet.system, packet.component, same)

    def _follow(self, vehicle: Vehicle, now: float, *, signed: bool) -> None:
        if self.vehicle is not None:
            self.navigation.restart()
        self.vehicle = vehicle
        self._heartbeats.lost = False
        self.encoder.system = vehicle.system
        self.encoder.version = vehicle.version
        self.streams.restart(now)
        self.next_due = self._heartbeats.last_s = now
        self._emit(vehicles.VehicleFound, now, str(vehicle), vehicle.version, signed)
        if signed and not self.reader.signing and not self._heartbeats.passive:
            self._emit(vehicles.SignaturesUnchecked, now)

    def _on_heartbeat(self, message: Any, now: float) -> None:
        assert self.vehicle is not None
        if now - self._heartbeats.last_s > _GAP_S:
            self.streams.renew(now)
        self._heartbeats.last_s = now
        armed = bool(message.base_mode & dialect.MAV_MODE_FLAG_SAFETY_ARMED)
        if armed != self.vehicle.armed:
            self.vehicle = replace(self.vehicle, armed=armed)
        if self._heartbeats.lost:
            self._heartbeats.lost = False
            self.navigation.home = None  # it may have changed: request it again
            self._emit(vehicles.VehicleBack, now, str(self.vehicle))

    def _navigate(self, message: Any, now: float) -> None:
        if self._identity and not self._identity.owns(message, now):
            return
        judgement = self.navigation.on_message(message, now)
        if judgement == "anew":
            self.streams.restart(now)
            self._emit(vehicles.VehicleRebooted, now, str(self.vehicle))
        if judgement != "stray" and message.id != _HOME:
            self.streams.on_message(message.id, now)

    def _on_ack(self, message: Any, now: float) -> None:
        if self.answers_us(message):
            self.streams.acknowledged(message.command, message.result, now)
            self.next_due = now

    def answers_us(self, message: Any) -> bool:
        """Return True if a COMMAND_ACK is for us, or without an addressee, as older autopilots send it."""
        addressee = (message.target_system, message.target_component)
        return addressee in ((self.encoder.system, self.encoder.component), (0, 0))

    def counts(self) -> dict[str, int]:
        """Return counters of what was received and not used."""
        return {
            "bytes_received": self.reader.bytes,
            "packets_received": self.reader.parser.packets,
            "bad_checksums": self.reader.parser.bad_crc,
            "bytes_skipped": self.reader.parser.skipped,
            "packets_ignored": self._finder.ignored,
            **self.disbelieved(),
            "positions_before_fix": self.navigation.unpositioned,
            "reboots": self.navigation.reboots,
            "clock_leaps": self.navigation.leaps,
            "position_jumps": self.navigation.jumps,
        }

    def disbelieved(self) -> dict[str, int]:
        """Return counters of complete packets and values that were not used."""
        signatures = self.disbelieved_signatures() or {}
        return {
            "packets_incompatible": self.reader.parser.incompatible,
            "packets_malformed": self.reader.parser.malformed,
            **{f"packets_{why}": count for why, count in signatures.items()},
            "values_refused": self.navigation.refused,
            "stray_times": self.navigation.times.strays,
            "stray_positions": self.navigation.places.strays,
        }

    def disbelieved_signatures(self) -> dict[str, int] | None:
        """Return the number of packets refused for their signature, by reason; None without a key."""
        return dict(self.reader.signing.refused) if self.reader.signing else None

    def why_no_vehicle(self) -> NoVehicle:
        """Return the traffic received, in words, if no vehicle was found."""
        if self._heartbeats.interrupted:
            return NoVehicle("link lost", self._heartbeats.interrupted)
        packets, refused = self.reader.parser.packets, tuple((self.disbelieved_signatures() or {}).items())
        if not packets:
            return NoVehicle("no packets" if self.reader.bytes else "silence", bytes=self.reader.bytes)
        reason: NoVehicleReason = "no heartbeat"
        if self._finder.refusals or self._finder.refused_vehicle:
            reason = "no signature" if self._finder.refusals else "other vehicles"
        return NoVehicle(reason, "", self.reader.bytes, packets, refused, self._finder.sources)

    def why_no_pose(self) -> NoPose:
        """Return the reason why there is a vehicle but no pose."""
        if self.vehicle is None:
            return NoPose("no vehicle")
        nowhere = not self.navigation.track.positions
        zeros = nowhere and self.navigation.unpositioned > 0
        missing = []
        for stream in self.streams.wanted:
            is_position = dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT in stream.ids
            if not any(stream.seen.values()) and not (zeros and is_position):
                promised = is_position and stream.promised
                missing.append(SilentStream(stream.name, *stream.asked, self._heartbeats.passive, promised))
        if zeros:
            return NoPose("zero position", tuple(missing))
        if missing:
            return NoPose("streams missing", tuple(missing))
        return NoPose("impossible position" if nowhere else "streams stopped")
