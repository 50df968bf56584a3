"""The built-in vehicle: a simulated multirotor that answers like ArduCopter, over any link.

It sends a HEARTBEAT once a second, and other messages only on request. It has a few parameters. It knows the commands
in `arducopter.py` and those that request messages; all others are UNSUPPORTED. A rate above 333 Hz or an unknown
message is DENIED, and the old rate stays.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple

from arva_hil.clock import Clock
from arva_hil.links import Link
from arva_hil.mavlink.codec import Encoder, Packet, Parser, decode, dialect
from arva_hil.mavlink.signing import Signing
from arva_hil.model.field.arrays import vector
from arva_hil.simulated import arducopter
from arva_hil.simulated.arducopter import ACCEPTED, DENIED, FAILED, UNSUPPORTED, Failsafe, Params, integer
from arva_hil.simulated.autopilot import Mode, SimulatedAutopilot
from arva_hil.simulated.messages import BUILDERS, SENSORS, VehicleReport, read_set_point
from arva_hil.simulated.multirotor import STEP_US, Vector
from arva_hil.simulated.position import Home, PositionError

_HEARTBEAT: Final = dialect.MAVLINK_MSG_ID_HEARTBEAT
_HEARTBEAT_US: Final = 1_000_000
_SHORTEST_US: Final = 3000
_LONGEST_US: Final = 2**31 - 1  # MESSAGE_INTERVAL has no longer one

# The messages of each stream of REQUEST_DATA_STREAM.
_GROUPS: Final[dict[int, tuple[int, ...]]] = {
    dialect.MAV_DATA_STREAM_EXTENDED_STATUS: (1, 24),
    dialect.MAV_DATA_STREAM_POSITION: (33, 32),
    dialect.MAV_DATA_STREAM_EXTRA1: (30,),
    dialect.MAV_DATA_STREAM_EXTRA3: (132,),
    dialect.MAV_DATA_STREAM_ALL: (1, 24, 33, 32, 30, 132),
}


class MessageRates:
    """Remembers the interval of each message that is sent, and when it is due.

    `defaults`: message id → Hz, from each boot on, besides the heartbeat. Raises ValueError for an unknown message.
    """

    def __init__(self, defaults: Mapping[int, float]) -> None:
        self._defaults = {_HEARTBEAT: _HEARTBEAT_US} | {msgid: round(1e6 / hz) for msgid, hz in defaults.items()}
        if not all(msgid in BUILDERS and us >= _SHORTEST_US for msgid, us in self._defaults.items()):
            raise ValueError(f"streams {dict(defaults)}: an id the vehicle does not send, or a rate above 333 Hz")
        self.boot(0)

    def boot(self, at: int) -> None:
        """Return to the defaults. The first heartbeat is due at once."""
        self._intervals = self._defaults.copy()
        self._due = {msgid: at + interval for msgid, interval in self._intervals.items()}
        self._due[_HEARTBEAT] = self.next_due = at

    def interval(self, msgid: int) -> int:
        """Return the interval of a message; -1: it is not sent."""
        return self._intervals.get(msgid, -1)

    def take_due(self) -> list[int]:
        """Return the message ids that are due at `next_due`. Changes `next_due` to the next instant."""
        now, due = self.next_due, self._due
        ids = [msgid for msgid, at in due.items() if at == now]
        for msgid in ids:
            due[msgid] = now + self._intervals[msgid]
        self.next_due = min(due.values())
        return ids

    def request(self, msgid: int, interval_us: int, now: int) -> bool:
        """Handle SET_MESSAGE_INTERVAL: 0 is the default, -1 is never. Returns False if it is denied."""
        if msgid not in BUILDERS or not (interval_us in (0, -1) or _SHORTEST_US <= interval_us <= _LONGEST_US):
            return False
        if interval_us == 0 or (msgid == _HEARTBEAT and interval_us == -1):
            self._set(msgid, self._defaults.get(msgid), now)
        else:
            self._set(msgid, None if interval_us == -1 else interval_us, now)
        return True

    def request_group(self, stream: int, rate_hz: int, now: int) -> None:
        """Handle REQUEST_DATA_STREAM: 0 Hz stops the stream."""
        for msgid in _GROUPS.get(stream, ()):
            self._set(msgid, max(1_000_000 // rate_hz, _SHORTEST_US) if rate_hz else None, now)

    def _set(self, msgid: int, interval: int | None, now: int) -> None:
        if interval is None:
            self._intervals.pop(msgid, None)
            self._due.pop(msgid, None)
        elif self._intervals.get(msgid) != interval:
            self._intervals[msgid] = interval
            self._due[msgid] = now + interval
        self.next_due = min(self._due.values())


Message = Any  # pymavlink's generated classes carry no types

_COMPONENT: Final = dialect.MAV_COMP_ID_AUTOPILOT1


class Truth(NamedTuple):
    """The true motion of the vehicle at one instant, without the estimator's error."""

    ned: Vector  # from home, m
    velocity: Vector  # NED, m/s
    quaternion: tuple[float, float, float, float]  # (w, x, y, z), body FRD to NED
    rates: Vector  # about the body axes, rad/s
    lla: Vector  # degrees, degrees, metres above mean sea level


@dataclass
class _Boot:
    """The state that ends with a reboot."""

    at: int
    """Its time, µs since the origin."""
    fix_at: int
    """The time of the first fix."""
    encoder: Encoder
    parsers: dict[int, Parser] = field(default_factory=dict)
    """By link: the streams of two links must not be mixed."""
    heard: bool = False
    """True after something was received: some messages are sent only then."""
    was_armed: bool = False


class SimulatedVehicle:
    """Remembers a flight and the requested messages. Times are seconds on the caller's clock and never go back.

    - `home`: degrees, degrees, metres AMSL. It stands there on flat ground, heading north.
    - `wind`: NED, m/s. `gps_noise_m`: sigma on each axis of the slow error of reported positions.
    - `boot_time`: of switching on. `fix_after`: seconds from boot to the first fix.
    - `streams`: message id → Hz, sent without a request. `version`: of MAVLink, 1 or 2.
    - `signing`: sign packets, and accept only signed ones.
    - `sensors`: bits of MAV_SYS_STATUS_SENSOR besides GPS: barometer, rangefinder.

    Raises ValueError for an unknown stream.
    """

    def __init__(
        self,
        home: tuple[float, float, float],
        system: int = 1,
        *,
        wind: Vector = (0.0, 0.0, 0.0),
        gps_noise_m: float = 0.0,
        seed: int = 0,
        boot_time: float = 0.0,
        fix_after: float = 0.0,
        streams: Mapping[int, float] | None = None,
        version: int = 2,
        signing: Signing | None = None,
        sensors: int = SENSORS,
    ) -> None:
        self.system = system
        self.version = version
        self._signing = signing
        self._sensors = sensors
        self._home = Home(*vector("home", home, 3).tolist())
        north, east, down = vector("wind", wind, 3).tolist()
        self._pilot = SimulatedAutopilot((north, east, down))
        self._error = PositionError(gps_noise_m, seed)
        self._origin = boot_time
        self._rates = MessageRates(streams or {})
        self._now = 0  # µs since the origin, like all times inside
        self._outbox = bytearray()
        self._start(0, round(fix_after * 1e6))

    def _start(self, at: int, fix_at: int) -> None:
        self._boot = _Boot(at, fix_at, Encoder(self.system, _COMPONENT, self.version, self._signing))
        self._pilot.disarm(force=True)
        self._pilot.set_mode(Mode.STABILIZE)
        self._pilot.ready = False
        self._rates.boot(at)

    def feed(self, chunk: bytes, now: float, link: int = 0) -> None:
        """Use bytes, cut anywhere, that arrived on a link until `now`."""
        self._advance(self._us(now))
        if self._signing:
            self._signing.advance(now)
        parser = self._boot.parsers.setdefault(link, Parser())
        for packet in parser.feed(chunk):
            if self._signing and self._signing.judge(packet):
                continue
            self._boot.heard = True
            if (handler := _HANDLERS.get(packet.msgid)) is None or (message := decode(packet)) is None:
                continue
            system, component = getattr(message, "target_system", 0), getattr(message, "target_component", 0)
            ours = system in (0, self.system) and component in (0, _COMPONENT)
            if ours:
                handler(self, message, packet)
                self._emit_events()

    def poll(self, now: float) -> bytes:
        """Return the messages to send until `now`, each with the values of the time at which it was due."""
        self._advance(self._us(now))
        said = bytes(self._outbox)
        self._outbox.clear()
        return said

    @property
    def next_due(self) -> float:
        """The time at which `poll` returns something."""
        due = self._now if self._outbox else self._rates.next_due
        return self._origin + due * 1e-6

    @property
    def flying(self) -> bool:
        """True if it is in the air."""
        return not self._pilot.landed

    @property
    def state(self) -> str:
        """Mode, and whether it is armed and in the air, for a person."""
        armed = "armed" if self._pilot.armed else "disarmed"
        return f"{self._pilot.mode.name}, {armed}, {'in the air' if self.flying else 'on the ground'}"

    def truth(self, now: float) -> Truth:
        """Return the exact motion at `now`, or up to 9 s back. Raises ValueError for a time before that."""
        us = self._us(now)
        self._advance(us)
        motion = self._pilot.motion.at(us)
        return Truth(*motion, self._home.lla(motion.position))

    def reboot(self, now: float) -> None:
        """Restart: disarmed (in the air it falls), STABILIZE, without a fix and streams, `time_boot_ms` 0."""
        self._advance(self._us(now))
        self._start(self._now, self._now + self._boot.fix_at - self._boot.at)

    def trigger(self, failsafe: Failsafe, now: float) -> None:
        """Trigger a failsafe now. On the ground it only sends the text."""
        self._advance(self._us(now))
        self._send(dialect.MAVLink_statustext_message(failsafe.severity, failsafe.text))
        self._pilot.empty |= failsafe.empty
        if self._pilot.armed:
            self._pilot.set_mode(failsafe.mode)

    def _us(self, now: float) -> int:
        return round((now - self._origin) * 1e6)

    def _advance(self, until: int) -> None:
        while (due := self._rates.next_due) <= until:
            self._fly(due)
            report = self._report(due)
            for msgid in self._rates.take_due():
                self._send(BUILDERS[msgid](report))
        if until > self._now:
            self._fly(until)

    def _fly(self, until: int) -> None:
        pilot, motion, last = self._pilot, self._pilot.motion, until // STEP_US
        while motion.steps <= last:
            pilot.step()
        if until > self._now:
            self._now = until
        self._emit_events()

    def _emit_events(self) -> None:
        pilot = self._pilot
        boot = self._boot
        if pilot.ready and boot.was_armed == pilot.armed:
            return
        armed, boot.was_armed = boot.was_armed != pilot.armed, pilot.armed
        fixed = not pilot.ready and self._now >= boot.fix_at
        pilot.ready |= fixed
        if not boot.heard:
            return
        if armed:
            text = b"Arming motors" if pilot.armed else b"Disarming motors"
            self._send(dialect.MAVLink_statustext_message(dialect.MAV_SEVERITY_INFO, text))
        if fixed or (armed and pilot.armed):
            at = boot.fix_at if fixed else self._now
            self._send(BUILDERS[dialect.MAVLINK_MSG_ID_HOME_POSITION](self._report(at)))

    def _report(self, at: int) -> VehicleReport:
        """Return the values for messages at an instant, rounded down to the milliseconds of its time stamp."""
        boot_ms = (at - self._boot.at) // 1000
        at = self._boot.at + boot_ms * 1000
        motion = self._pilot.motion.at(at)
        self._pilot.error = north, east, down = self._error.at(at)
        n, e, d = motion.position
        return VehicleReport(boot_ms, motion, (n + north, e + east, d + down), self._pilot, self._home, self._sensors)

    def _send(self, message: Message | None) -> None:
        if message is not None:
            self._outbox += self._boot.encoder.pack(message)

    def _on_command(self, message: Message, packet: Packet) -> None:
        command = message.command
        place = "x y z" if packet.msgid == dialect.MAVLINK_MSG_ID_COMMAND_INT else "param5 param6 param7"
        params = tuple(getattr(message, name) for name in f"param1 param2 param3 param4 {place}".split())
        frame = getattr(message, "frame", dialect.MAV_FRAME_GLOBAL_RELATIVE_ALT)
        result = self._carry_out(command, params, frame)
        self._acknowledge(command, result, packet)
        if result != ACCEPTED:
            return
        if command == dialect.MAV_CMD_REQUEST_MESSAGE:
            self._send(BUILDERS[integer(params[0])](self._report(self._now)))
        elif command == dialect.MAV_CMD_GET_MESSAGE_INTERVAL:
            msgid = integer(params[0])
            self._send(dialect.MAVLink_message_interval_message(msgid, self._rates.interval(msgid)))

    def _carry_out(self, command: int, params: Params, frame: int) -> int:
        if command in arducopter.ORDERS:
            return arducopter.ORDERS[command](self._pilot, params, frame)
        if command == dialect.MAV_CMD_SET_MESSAGE_INTERVAL:
            return ACCEPTED if self._rates.request(integer(params[0]), integer(params[1]), self._now) else DENIED
        if command in (dialect.MAV_CMD_REQUEST_MESSAGE, dialect.MAV_CMD_GET_MESSAGE_INTERVAL):
            return ACCEPTED if integer(params[0]) in BUILDERS else FAILED
        return UNSUPPORTED

    def _acknowledge(self, command: int, result: int, packet: Packet) -> None:
        to = packet.system, packet.component
        self._send(dialect.MAVLink_command_ack_message(command, result, 0, 0, *to))

    def _on_set_mode(self, message: Message, packet: Packet) -> None:
        result = arducopter.set_mode(self._pilot, (message.base_mode, message.custom_mode), 0)
        self._acknowledge(packet.msgid, result, packet)

    def _on_data_stream(self, message: Message, _: Packet) -> None:
        rate_hz = message.req_message_rate if message.start_stop else 0
        self._rates.request_group(message.req_stream_id, rate_hz, self._now)

    def _on_timesync(self, message: Message, _: Packet) -> None:
        if message.tc1 == 0:
            boot_ns = (self._now - self._boot.at) * 1000
            self._send(dialect.MAVLink_timesync_message(boot_ns, message.ts1))

    def _on_terrain_check(self, message: Message, _: Packet) -> None:
        """Answer that the terrain is flat."""
        alt_m = self._home.alt_m
        height = -self._pilot.motion.down
        self._send(dialect.MAVLink_terrain_report_message(message.lat, message.lon, 30, alt_m, height, 0, 1))

    def _on_parameter(self, message: Message, _: Packet) -> None:
        for value in arducopter.values_requested(message):
            self._send(value)

    def _on_mission_list(self, message: Message, packet: Packet) -> None:
        """Answer that there is no mission; ground stations request it."""
        kind = getattr(message, "mission_type", 0)
        self._send(dialect.MAVLink_mission_count_message(packet.system, packet.component, 0, kind))

    def _on_set_point(self, message: Message, _: Packet) -> None:
        set_point = read_set_point(message, self._pilot.motion)
        if set_point is not None and self._pilot.mode == Mode.GUIDED:
            self._pilot.steer(set_point)


_HANDLERS: Final = {
    dialect.MAVLINK_MSG_ID_COMMAND_LONG: SimulatedVehicle._on_command,
    dialect.MAVLINK_MSG_ID_COMMAND_INT: SimulatedVehicle._on_command,
    dialect.MAVLINK_MSG_ID_SET_MODE: SimulatedVehicle._on_set_mode,
    dialect.MAVLINK_MSG_ID_REQUEST_DATA_STREAM: SimulatedVehicle._on_data_stream,
    dialect.MAVLINK_MSG_ID_TIMESYNC: SimulatedVehicle._on_timesync,
    dialect.MAVLINK_MSG_ID_TERRAIN_CHECK: SimulatedVehicle._on_terrain_check,
    dialect.MAVLINK_MSG_ID_PARAM_REQUEST_READ: SimulatedVehicle._on_parameter,
    dialect.MAVLINK_MSG_ID_PARAM_REQUEST_LIST: SimulatedVehicle._on_parameter,
    dialect.MAVLINK_MSG_ID_MISSION_REQUEST_LIST: SimulatedVehicle._on_mission_list,
    dialect.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED: SimulatedVehicle._on_set_point,
}


class Simulator:
    """Simulated vehicles that all use all `links`. A task of the loop.

    `relays`: TUNNEL messages are forwarded to all other links, as by autopilots that are in contact.
    """

    def __init__(self, vehicles: Sequence[SimulatedVehicle], links: Sequence[Link], *, relays: bool = False) -> None:
        self.vehicles = vehicles
        self.links = links
        self._parsers = [Parser() for _ in links] if relays else []

    def service(self, clock: Clock) -> float:
        now = clock.now()
        for number, link in enumerate(self.links):
            if chunk := link.read():
                for vehicle in self.vehicles:
                    vehicle.feed(chunk, now, number)
                if self._parsers:
                    self._relay(number, chunk)
        for vehicle in self.vehicles:
            if said := vehicle.poll(now):
                for link in self.links:
                    link.write(said)
        return min([vehicle.next_due for vehicle in self.vehicles])

    def _relay(self, number: int, chunk: bytes) -> None:
        for packet in self._parsers[number].feed(chunk):
            if packet.msgid == dialect.MAVLINK_MSG_ID_TUNNEL:
                for other, link in enumerate(self.links):
                    if other != number:
                        link.write(packet.raw)
