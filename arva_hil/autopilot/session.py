"""The session with one vehicle: which one, what it streams, its clock and its pose. Bytes in, bytes out."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any, Final

from arva_hil.autopilot.clockmap import ClockMap
from arva_hil.autopilot.finder import Finder, Vehicle
from arva_hil.autopilot.mavlink import Encoder, Packet, Parser, dialect
from arva_hil.autopilot.pose import AttitudeSample, PoseTrack, PositionSample, VehicleState
from arva_hil.autopilot.streams import Streams
from arva_hil.model import LocalFrame
from arva_hil.notice import Notice

COMPONENT: Final = dialect.MAV_COMP_ID_ONBOARD_COMPUTER  # 191
_HEARTBEAT_S: Final = 1.0
_LOST_S: Final = 5.0  # without a heartbeat
_GAP_S: Final = 2.5  # between heartbeats: who was away for so long may have forgotten what was asked
_REORDER_S: Final = 0.5  # boot time further back than this is a reboot, not a late packet
_POLL_S: Final = 0.1  # how often requests and time-outs are looked at


def heartbeat() -> Any:
    """An onboard computer's; never a ground station's, which could mask the vehicle's link-loss failsafe."""
    kind, active = dialect.MAV_TYPE_ONBOARD_CONTROLLER, dialect.MAV_STATE_ACTIVE
    return dialect.MAVLink_heartbeat_message(kind, dialect.MAV_AUTOPILOT_INVALID, 0, 0, active, 3)


class Session:
    """Remembers one vehicle: chosen by its first heartbeat, followed by its system and component ids.

    `target_system`, `target_component`: follow only these (default: the first autopilot, component 1).
    `rate_hz`: of the pose streams wanted. `passive`: never sends, for a log. `component`: our own id.
    Times are host seconds from the caller's clock. What other systems send changes nothing.
    """

    def __init__(
        self,
        *,
        target_system: int | None = None,
        target_component: int | None = None,
        rate_hz: float = 50.0,
        passive: bool = False,
        component: int = COMPONENT,
    ) -> None:
        self.parser = Parser()
        self.encoder = Encoder(target_system or 1, component)
        self.component = component
        self.vehicle: Vehicle | None = None
        self.track = PoseTrack()
        self.clock = ClockMap()
        self.home: tuple[float, float, float] | None = None  # degrees, degrees, metres AMSL
        self.reboots = 0
        self.refused = 0  # messages of the vehicle whose values are no pose
        self.ignored = 0  # packets of other systems and components
        self.unpositioned = 0  # position messages that came before the first fix
        self.bytes = 0
        self.next_due = -math.inf
        self._finder = Finder(target_system, target_component)
        self._rate_hz = rate_hz
        self._passive = passive
        self._streams: Streams | None = None
        self._notices: list[Notice] = []
        self._last_heartbeat = -math.inf
        self._lost = False
        self._interrupted = ""  # why the link is lost
        self._next_heartbeat = -math.inf
        self._last_boot: float | None = None
        self._reorder_s = _REORDER_S
        self._handlers: dict[int, Callable[[Any, float], None]] = {
            dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: self._on_position,
            dialect.MAVLINK_MSG_ID_ATTITUDE: self._on_attitude,
            dialect.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: self._on_quaternion,
            dialect.MAVLINK_MSG_ID_HOME_POSITION: self._on_home,
            dialect.MAVLINK_MSG_ID_COMMAND_ACK: self._on_ack,
        }

    # -- bytes in ------------------------------------------------------------------------------------------

    def feed(self, chunk: bytes, now: float) -> list[Packet]:
        """Take what came at `now`; gives back every packet in it, whoever sent it. Never raises."""
        self.bytes += len(chunk)
        packets = self.parser.feed(chunk)
        for packet in packets:
            vehicle = self.vehicle
            if vehicle is None or packet.msgid == dialect.MAVLINK_MSG_ID_HEARTBEAT:
                self._look_around(packet, now)
            elif packet.system != vehicle.system or packet.component != vehicle.component:
                self.ignored += 1
            elif handler := self._handlers.get(packet.msgid):
                message = self.parser.decode(packet)
                if message is not None:
                    handler(message, now)
        return packets

    @property
    def lost(self) -> bool:
        """There is a vehicle, and its heartbeat has stopped."""
        return self._lost

    def state_at(self, now: float, frame: LocalFrame) -> VehicleState | None:
        """The vehicle's pose at host time `now` in the NED frame `frame`, None when it is unknown."""
        boot = self.clock.boot(now)
        return None if boot is None else self.track.at(boot, frame)

    def rates(self, now: float) -> dict[str, float]:
        """Measured rates [Hz] of the pose streams."""
        return self._streams.rates(now) if self._streams else {}

    def answers_us(self, message: Any) -> bool:
        """Whether a COMMAND_ACK is for us, or, from an older autopilot, for nobody by name."""
        addressee = (message.target_system, message.target_component)
        return addressee in ((self.encoder.system, self.component), (0, 0))

    def take_notices(self) -> list[Notice]:
        """What there is to say since the last call."""
        if self._streams:
            self._notices += self._streams.take_notices()
        notices = self._notices
        if notices:
            self._notices = []
        return notices

    # -- bytes out -----------------------------------------------------------------------------------------

    def poll(self, now: float) -> bytes:
        """What is due to be sent: the onboard computer's heartbeat, requests for streams. Sets `next_due`."""
        self._watch_vehicle(now)
        if self._passive:
            self.next_due = math.inf
            return b""
        if self._interrupted:
            self.next_due = now + _POLL_S
            return b""
        out = b""
        if now >= self._next_heartbeat:
            due = self._next_heartbeat + _HEARTBEAT_S
            self._next_heartbeat = due if due > now else now + _HEARTBEAT_S
            out += self.encoder.pack(heartbeat())
        if self.vehicle and self._streams and not self._lost:
            self._streams.home_wanted = self.home is None
            for message in self._streams.poll(now, self.vehicle.system, self.vehicle.component):
                out += self.encoder.pack(message)
        self.next_due = now + _POLL_S
        return out

    def interrupt(self, why: str) -> None:
        """The link is lost: nothing can be sent, and silence is no vehicle's fault, until `resume`."""
        self._interrupted = why
        self.parser.cut()

    def resume(self, now: float) -> None:
        """The link is a new one: say hello and ask for everything again, at once.

        Whose boot time goes on is the same vehicle, and its pose track goes on; whose goes back has rebooted.
        """
        self._interrupted = ""
        self._next_heartbeat = now
        self._last_heartbeat = now
        self._lost = False
        self._reorder_s = 0.0  # nothing of the old link comes late on the new one
        self.home = None
        if self._streams:
            self._streams.renew(now)

    # -- for a person --------------------------------------------------------------------------------------

    def heard(self) -> str:
        """What was heard, when no vehicle was found, with the likely cure."""
        if self._interrupted:
            return f"no autopilot was heard before {self._interrupted}"
        if not self.bytes:
            return "nothing was heard at all: is the autopilot powered, and sending MAVLink on this link?"
        if not self.parser.packets:
            return (
                f"{self.bytes} bytes were heard but no MAVLink packet in them: is the baud rate right, "
                "and the port's protocol MAVLink?"
            )
        return f"{self.parser.packets} packets were heard, but no autopilot's heartbeat: {self._finder}"

    def why_no_pose(self) -> str:
        """Why there is no pose though there is a vehicle."""
        if self._streams is None:
            return "no vehicle yet"
        lacking = []
        for stream in self._streams.wanted:
            if not any(stream.seen.values()):
                lacking.append(f"no {stream.name} ({stream.said or 'not asked for yet'})")
        if not lacking and self.track.first_position is None:
            return "the position is all zeros or out of range: no GPS fix yet"
        return ", ".join(lacking) or "the streams have stopped"

    # -- the vehicle ---------------------------------------------------------------------------------------

    def _look_around(self, packet: Packet, now: float) -> None:
        """A heartbeat, or any packet before the vehicle is known."""
        if packet.msgid != dialect.MAVLINK_MSG_ID_HEARTBEAT:
            self._finder.note(packet, "packets")
        elif (message := self.parser.decode(packet)) is None:
            return
        elif self.vehicle and self.vehicle.sent(packet):
            self._on_heartbeat(message, now)
        elif vehicle := self._finder.vehicle(packet, message):
            if self.vehicle is None:
                self._follow(vehicle, now)
            elif self._finder.note(packet, "autopilot"):
                text = f"another autopilot {packet.system}/{packet.component} on this link is ignored"
                self._notices.append(Notice("info", f"{text}; --target-system chooses"))
        if self.vehicle and not self.vehicle.sent(packet):
            self.ignored += 1

    def _follow(self, vehicle: Vehicle, now: float) -> None:
        self.vehicle = vehicle
        self.encoder.system = vehicle.system
        self.encoder.version = vehicle.version
        self._streams = Streams(self._rate_hz, now)
        self._last_heartbeat = now
        self._notices.append(Notice("info", f"vehicle {vehicle}, MAVLink {vehicle.version}"))

    def _on_heartbeat(self, message: Any, now: float) -> None:
        assert self.vehicle is not None
        if now - self._last_heartbeat > _GAP_S and self._streams:
            self._streams.renew(now)
        self._last_heartbeat = now
        armed = bool(message.base_mode & dialect.MAV_MODE_FLAG_SAFETY_ARMED)
        if armed != self.vehicle.armed:
            self.vehicle = replace(self.vehicle, armed=armed)
        if self._lost:
            self._lost = False
            self._notices.append(Notice("info", f"vehicle {self.vehicle} is back"))

    def _watch_vehicle(self, now: float) -> None:
        if self.vehicle and not self._lost and not self._interrupted and now - self._last_heartbeat > _LOST_S:
            self._lost = True
            self._notices.append(Notice("warning", f"no heartbeat from vehicle {self.vehicle} for {_LOST_S:g} s"))

    # -- the pose ------------------------------------------------------------------------------------------

    def _on_position(self, message: Any, now: float) -> None:
        boot = self._stamp(message, now)
        lat, lon, alt = message.lat / 1e7, message.lon / 1e7, message.alt / 1e3
        if message.lat == 0 and message.lon == 0:
            self.unpositioned += 1
        elif abs(lat) > 90 or abs(lon) > 180:
            self.refused += 1
        else:
            velocity = (message.vx / 100, message.vy / 100, message.vz / 100)
            self.track.add_position(PositionSample(boot, lat, lon, alt, velocity))

    def _on_attitude(self, message: Any, now: float) -> None:
        self._add_attitude(message, (message.roll, message.pitch, message.yaw), now)

    def _on_quaternion(self, message: Any, now: float) -> None:
        quaternion = (message.q1, message.q2, message.q3, message.q4)
        if 0.9 < sum(q * q for q in quaternion) < 1.1:
            self._add_attitude(message, quaternion, now)
        else:  # NaN included
            self.refused += 1

    def _add_attitude(self, message: Any, angles: tuple[float, ...], now: float) -> None:
        boot = self._stamp(message, now)
        rates = (message.rollspeed, message.pitchspeed, message.yawspeed)
        if math.isfinite(sum(angles) + sum(rates)):
            self.track.add_attitude(AttitudeSample(boot, angles, rates))
        else:
            self.refused += 1

    def _stamp(self, message: Any, now: float) -> float:
        """The message's boot time [s], entered into the clock map; notices a reboot."""
        boot: float = message.time_boot_ms / 1e3
        if self._last_boot is not None and boot < self._last_boot - self._reorder_s:
            self._on_reboot(now)
        self._reorder_s = _REORDER_S
        self._last_boot = boot if self._last_boot is None else max(boot, self._last_boot)
        self.clock.add(now, boot)
        assert self._streams is not None
        self._streams.note(message.id, now)
        return boot

    def _on_reboot(self, now: float) -> None:
        self.reboots += 1
        self.track = PoseTrack()
        self.clock = ClockMap()
        self.home = None
        self._last_boot = None
        self._streams = Streams(self._rate_hz, now)
        self._notices.append(Notice("warning", f"vehicle {self.vehicle} has rebooted: a new session"))

    def _on_home(self, message: Any, now: float) -> None:
        lat, lon = message.latitude / 1e7, message.longitude / 1e7
        if (message.latitude, message.longitude) == (0, 0) or abs(lat) > 90 or abs(lon) > 180:
            self.refused += 1
            return
        self.home = (lat, lon, message.altitude / 1e3)

    def _on_ack(self, message: Any, now: float) -> None:
        if self._streams and self.answers_us(message):
            self._streams.acknowledged(message.command, message.result)
