"""The session with one vehicle: bytes in, bytes out. `followed.py` has its state."""

from __future__ import annotations

import math
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import replace
from typing import Any, Final

from arva_hil.autopilot.following.discovery import Identity, Vehicle
from arva_hil.autopilot.following.followed import FollowedVehicle
from arva_hil.autopilot.following.navigation import HANDLED
from arva_hil.autopilot.following.received import Received
from arva_hil.autopilot.following.streams import Streams
from arva_hil.events import Event, vehicles
from arva_hil.events.reasons import Why, because
from arva_hil.mavlink.codec import Packet, decode, dialect

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


class Session(FollowedVehicle):
    """Follows one vehicle: found by its first heartbeat, then recognized by its system and component ids.

    `target_system`, `target_component`: follow only these (default: the first autopilot, component 1). `rate_hz`: of
    the pose streams. `passive`: never send, for a log. `component`: our own id. `signing`: accept only packets signed
    with its key, and sign. `reader`: of the link, with its signing, if several sessions share a link: each `receive`s
    the packets that it has read. `name`: the vehicle's, in its events. Times are host seconds from the caller's clock.

    Packets of other systems change nothing. Of several senders on the link only `senders.vehicle` is accepted. After it
    has been silent for 3 s, another sender with the vehicle's ids may take its place.
    """

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
        return self.vehicle is None or sender == self.senders.vehicle or self.senders.accepts(sender, now)

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
                self.ignored += 1
                others.append(packet)
        if sender is not None and own:
            self.senders.on_packet(sender, now)
        if self._extras and (streams := self._streams):
            for packet in own:
                if packet.msgid in streams.extra_ids:
                    streams.on_message(packet.msgid, now)
        return Received(own, others, refused, self._emitted() if self._events else ())

    def want(self, streams: Mapping[int, float]) -> None:
        """Request these optional streams too: message id → Hz."""
        self._extras.update(streams)
        if self._streams:
            self._streams.want(streams)

    def pin(self) -> None:
        """Keep the vehicle from now on. Another one with its ids is ignored, and `usurped` says so."""
        self._identity = Identity(self.clock.rate)
        self.senders.pin()

    def poll(self, now: float) -> tuple[bytes, Sequence[Event]]:
        """Return the bytes to send now, our heartbeat and requests for streams; and the events. Sets `next_due`."""
        if now - self._last_heartbeat > _LOST_S and self.vehicle and not self.lost and not self._interrupted:
            self.lost = True
            self._events.append(vehicles.VehicleLost(now, self.name, str(self.vehicle), _LOST_S))
        if self.reader.signing:
            self.reader.signing.advance(now)
        if self._passive:
            self.next_due = math.inf
            return b"", self._emitted() if self._events else ()
        self.next_due = now + _POLL_S
        self.senders.on_read(now)
        if self._interrupted:
            return b"", self._emitted()
        out = b""
        if now >= self._next_heartbeat:
            due = self._next_heartbeat + _HEARTBEAT_S
            self._next_heartbeat = due if due > now else now + _HEARTBEAT_S
            out += self.encoder.pack(heartbeat())
        if self.vehicle and self._streams and not self.lost:
            self._streams.home_wanted = self.home is None
            for message in self._streams.poll(now, self.vehicle.system, self.vehicle.component):
                out += self.encoder.pack(message)
        return out, self._emitted()

    def interrupt(self, why: str) -> None:
        """Handle a lost link: until `resume` nothing can be sent, and silence does not count."""
        self._interrupted = why
        self.reader.parser.cut()
        self.senders.release()

    def resume(self, now: float) -> None:
        """Handle a link that is back: send a heartbeat and request all streams again, at once.

        If the vehicle's boot time continues, so does its pose track. If it has gone back, the vehicle has rebooted.
        """
        self._interrupted = ""
        self.next_due = self._next_heartbeat = now
        self._last_heartbeat = now
        self.lost = False
        self.senders.resume(now)
        self.navigation.renew()
        if self._streams:
            self._streams.renew(now)

    def skip(self, now: float) -> None:
        """Handle a pause in reading: silence until `now` does not count."""
        self._last_heartbeat = max(self._last_heartbeat, now)

    def _emitted(self) -> Sequence[Event]:
        """Return the events since the last call."""
        events = self._events[:]
        self._events.clear()
        return events

    def _on_refused(self, packet: Packet, now: float) -> None:
        """Report each reason for refused packets once, with the first sender."""
        if packet.refused not in self._disbelieved:
            self._disbelieved.add(packet.refused)
            about = packet.system, packet.component, packet.refused
            self._events.append(vehicles.SignatureRefused(now, self.name, *about))

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
        elif found and (known is None or (self.lost and known.sent(packet))):
            self.senders.on_packet(sender, now)
            self._follow(found, now, signed=packet.signed)
            return True
        elif known:
            self.ignored += 1
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
            self._events.append(vehicles.OtherAutopilotIgnored(now, self.name, packet.system, packet.component, same))

    def _follow(self, vehicle: Vehicle, now: float, *, signed: bool) -> None:
        self.vehicle = vehicle
        self.lost = False
        self.encoder.system = vehicle.system
        self.encoder.version = vehicle.version
        self._streams = Streams(self.rate_hz, now, self._extras, self.name, self._events.append)
        self.next_due = self._last_heartbeat = now
        self._events.append(vehicles.VehicleFound(now, self.name, str(vehicle), vehicle.version, signed))
        if signed and not self.reader.signing and not self._passive:
            self._events.append(vehicles.SignaturesUnchecked(now, self.name))

    def _on_heartbeat(self, message: Any, now: float) -> None:
        assert self.vehicle is not None
        if now - self._last_heartbeat > _GAP_S and self._streams:
            self._streams.renew(now)
        self._last_heartbeat = now
        armed = bool(message.base_mode & dialect.MAV_MODE_FLAG_SAFETY_ARMED)
        if armed != self.vehicle.armed:
            self.vehicle = replace(self.vehicle, armed=armed)
        if self.lost:
            self.lost = False
            self.navigation.home = None  # it may have changed: request it again
            self._events.append(vehicles.VehicleBack(now, self.name, str(self.vehicle)))

    def _navigate(self, message: Any, now: float) -> None:
        assert self._streams is not None
        if self._identity and not self._identity.owns(message, now):
            return
        judgement = self.navigation.on_message(message, now)
        if judgement == "anew":
            self._streams = Streams(self.rate_hz, now, self._extras, self.name, self._events.append)
            self._events.append(vehicles.VehicleRebooted(now, self.name, str(self.vehicle)))
        if judgement != "stray" and message.id != _HOME:
            self._streams.on_message(message.id, now)

    def _on_ack(self, message: Any, now: float) -> None:
        if self._streams and self.answers_us(message):
            self._streams.acknowledged(message.command, message.result, now)
            self.next_due = now
