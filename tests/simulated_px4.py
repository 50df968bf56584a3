"""A vehicle that is told and tells as PX4 does: the built-in one behind PX4's modes, acknowledgements and refusals.

As measured on PX4 1.16: two acknowledgements of DO_SET_MODE, the first always 0; OFFBOARD is refused until set-points
flow and left 1.2 s after the last one; a take-off to less than the ground's height above sea level is acknowledged
and ignored, numbers for its place are flown to; a take-off ends 0.8 m below its height, in hold. CURRENT_MODE comes
with each change of the mode and twice a second when it was asked for; the heartbeat's rate cannot be changed; an
integer parameter's bytes are copied into the float. When it has landed and disarms it goes back to OFFBOARD. Without a
remote control that it uses, SYS_STATUS calls the radio not healthy, also when RC_CHANNELS comes; MANUAL_CONTROL comes
once when it is asked for, and as often as asked for while there are sticks.
"""

from __future__ import annotations

import math
import struct
from typing import Any

from arva_hil.mavlink.codec import Encoder, Packet, Parser, decode, dialect
from arva_hil.mavlink.dialect import MAVLINK_MSG_ID_CURRENT_MODE, CurrentMode
from arva_hil.simulated.autopilot import Mode
from arva_hil.simulated.vehicle import SimulatedVehicle, Truth

POSITION, TAKE_OFF, HOLD, RETURN, LAND, OFFBOARD = 3 << 16, *(4 << 16 | n << 24 for n in (2, 3, 5, 6)), 6 << 16
PARAMETERS: dict[str, float] = {
    "COM_OBL_RC_ACT": 4,
    "COM_OF_LOSS_T": 1.0,
    "NAV_RCL_ACT": 2,
    "NAV_DLL_ACT": 0,
    "COM_RC_OVERRIDE": 1,
    "RC_RSSI_PWM_CHAN": 0,
    "GF_ACTION": 2,
    "GF_MAX_HOR_DIST": 0.0,
    "GF_MAX_VER_DIST": 0.0,
}
STREAMS = {dialect.MAVLINK_MSG_ID_ATTITUDE: 10, dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 10}

_INNER = {TAKE_OFF: Mode.GUIDED, OFFBOARD: Mode.GUIDED, LAND: Mode.LAND}  # any other: LOITER
_GYRO, _RC = dialect.MAV_SYS_STATUS_SENSOR_3D_GYRO, dialect.MAV_SYS_STATUS_SENSOR_RC_RECEIVER
_OURS = 99  # component of what is told to the vehicle behind; what it answers is not passed on


class Px4:
    """Remembers PX4's own mode. `healthy`: may arm; if not it says so in SYS_STATUS and nowhere else.

    `manual`: x, y, z and r of the sticks that it uses; None: it has no remote control.
    """

    def __init__(self, home: tuple[float, float, float], *, healthy: bool = True, **options: Any) -> None:
        self.mode = POSITION
        self.healthy = healthy
        self.manual: tuple[int, int, int, int] | None = None
        self.parameters = dict(PARAMETERS)
        self._manual_due = math.inf
        self._manual_every = 0.0
        self._manual_said = False
        self._vehicle = SimulatedVehicle(home, streams=STREAMS, **options)
        self._ground_amsl = home[2]
        self._top = math.inf
        self._set_points: list[float] = []  # when the last two came
        self._from = Parser()
        self._to = Parser()
        self._told = Encoder(1, _OURS)
        self._encoder = Encoder(1, 1)
        self._outbox = bytearray()
        self._current_mode_due = math.inf
        self._said_mode = -1

    @property
    def next_due(self) -> float:
        return self._vehicle.next_due

    def truth(self, now: float) -> Truth:
        return self._vehicle.truth(now)

    def reboot(self, now: float) -> None:
        self.mode = POSITION
        self._vehicle.reboot(now)

    def feed(self, chunk: bytes, now: float, link: int = 0) -> None:
        for packet in self._to.feed(chunk):
            message = decode(packet)
            if packet.msgid == dialect.MAVLINK_MSG_ID_COMMAND_LONG and message.command in _COMMANDS:
                results = _COMMANDS[message.command](self, message, now)
                for result in results:
                    ack = dialect.MAVLink_command_ack_message(
                        message.command, result, 0, 0, packet.system, packet.component
                    )
                    self._outbox += self._encoder.pack(ack)
            elif packet.msgid == dialect.MAVLINK_MSG_ID_PARAM_REQUEST_READ:
                self._outbox += self._parameter(message.param_id)
            elif packet.msgid == dialect.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED:
                self._set_points = [*self._set_points[-1:], now]
                if self.mode == OFFBOARD:
                    self._vehicle.feed(packet.raw, now)
            else:
                self._vehicle.feed(packet.raw, now)

    def poll(self, now: float) -> bytes:
        said = self._vehicle.poll(now)
        self._watch(now)
        if self._current_mode_due < math.inf and (self.mode != self._said_mode or now >= self._current_mode_due):
            self._outbox += self._encoder.pack(CurrentMode(0, self.mode, 6 << 16))
            self._current_mode_due = now + 0.5
            self._said_mode = self.mode
        if now >= self._manual_due:
            self._manual_due = now + self._manual_every
            if self.manual or not self._manual_said:
                sticks = self.manual or (0, 0, 500, 0)
                self._outbox += self._encoder.pack(dialect.MAVLink_manual_control_message(1, *sticks, 0))
            self._manual_said = True
        out, self._outbox = self._outbox, bytearray()
        for packet in self._from.feed(said):
            out += self._as_px4(packet)
        return bytes(out)

    def _as_px4(self, packet: Packet) -> bytes:
        if packet.msgid == dialect.MAVLINK_MSG_ID_HEARTBEAT:
            message: Any = decode(packet)
            message.autopilot, message.custom_mode = dialect.MAV_AUTOPILOT_PX4, self.mode
            remote = _RC if self.manual else 0
            enabled, health = _GYRO | _RC, (_GYRO if self.healthy else 0) | remote
            status = dialect.MAVLink_sys_status_message(remote, enabled, health, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0)
            return self._encoder.pack(message) + self._encoder.pack(status)
        if packet.msgid == dialect.MAVLINK_MSG_ID_STATUSTEXT:  # is for ground stations
            return b""
        ours = packet.msgid == dialect.MAVLINK_MSG_ID_COMMAND_ACK and decode(packet).target_component == _OURS
        return b"" if ours else packet.raw

    def _watch(self, now: float) -> None:
        if self.mode == TAKE_OFF and -self.truth(now).ned[2] > self._top - 0.8:
            self.mode = HOLD  # the vehicle behind climbs on to the top
        elif self.mode == LAND and not self._vehicle._pilot.armed:
            self.mode = OFFBOARD
        elif self.mode == OFFBOARD and self._vehicle._pilot.armed and now - self._set_points[-1] > 1.2:
            self._enter(POSITION, now)

    def _enter(self, mode: int, now: float) -> None:
        self.mode = mode
        self._tell(dialect.MAV_CMD_DO_SET_MODE, 1, _INNER.get(mode, Mode.LOITER), now=now)

    def _tell(self, command: int, *params: float, now: float) -> None:
        padded = [*params, *[0.0] * (7 - len(params))]
        self._vehicle.feed(self._told.pack(dialect.MAVLink_command_long_message(1, 1, command, 0, *padded)), now)

    def _set_mode(self, message: Any, now: float) -> tuple[int, ...]:
        mode = int(message.param2) << 16 | int(message.param3) << 24
        flowing = len(self._set_points) == 2 and now - self._set_points[0] < 1.0
        if mode == OFFBOARD and not flowing:
            return dialect.MAV_RESULT_ACCEPTED, dialect.MAV_RESULT_TEMPORARILY_REJECTED
        if mode != self.mode:
            self._enter(mode, now)
        return dialect.MAV_RESULT_ACCEPTED, dialect.MAV_RESULT_ACCEPTED

    def _arm(self, message: Any, now: float) -> tuple[int, ...]:
        if message.param1 and not self.healthy:
            return (dialect.MAV_RESULT_TEMPORARILY_REJECTED,)
        self._tell(message.command, message.param1, now=now)
        return (dialect.MAV_RESULT_ACCEPTED,)

    def _take_off(self, message: Any, now: float) -> tuple[int, ...]:
        height = message.param7 - self._ground_amsl
        nowhere = all(map(math.isnan, (message.param4, message.param5, message.param6)))
        if height > 0 and nowhere:
            self._top = height
            self._enter(TAKE_OFF, now)
            self._tell(message.command, 0, 0, 0, 0, 0, 0, height, now=now)
        return (dialect.MAV_RESULT_ACCEPTED,)

    def _request(self, message: Any, now: float) -> tuple[int, ...]:
        if message.param1 != dialect.MAVLINK_MSG_ID_HIL_STATE_QUATERNION:
            self._tell(message.command, message.param1, now=now)
            return (dialect.MAV_RESULT_ACCEPTED,)
        truth = self.truth(now)
        lat, lon, alt = (round(v * scale) for v, scale in zip(truth.lla, (1e7, 1e7, 1e3), strict=True))
        attitude = [-v for v in truth.quaternion]
        self._outbox += self._encoder.pack(
            dialect.MAVLink_hil_state_quaternion_message(
                0, attitude, *truth.rates, lat, lon, alt, *(round(v * 100) for v in truth.velocity), 0, 0, 0, 0, 0
            )
        )
        return (dialect.MAV_RESULT_ACCEPTED,)

    def _set_interval(self, message: Any, now: float) -> tuple[int, ...]:
        if message.param1 == MAVLINK_MSG_ID_CURRENT_MODE:
            self._current_mode_due = now
        elif message.param1 == dialect.MAVLINK_MSG_ID_MANUAL_CONTROL:
            self._manual_due, self._manual_every = now, message.param2 / 1e6
        elif message.param1 == dialect.MAVLINK_MSG_ID_HEARTBEAT:
            return (dialect.MAV_RESULT_FAILED,)
        else:
            self._tell(message.command, message.param1, message.param2, now=now)
        return (dialect.MAV_RESULT_ACCEPTED,)

    def _parameter(self, name: str) -> bytes:
        if name not in self.parameters:
            return b""
        value, kind = self.parameters[name], dialect.MAV_PARAM_TYPE_REAL32
        if isinstance(value, int):
            (value,), kind = struct.unpack("<f", struct.pack("<i", value)), dialect.MAV_PARAM_TYPE_INT32
        return self._encoder.pack(dialect.MAVLink_param_value_message(name.encode(), value, kind, 0, 0xFFFF))

    def _land(self, _: Any, now: float) -> tuple[int, ...]:
        self._enter(LAND, now)
        return (dialect.MAV_RESULT_ACCEPTED,)


_COMMANDS = {
    dialect.MAV_CMD_DO_SET_MODE: Px4._set_mode,
    dialect.MAV_CMD_COMPONENT_ARM_DISARM: Px4._arm,
    dialect.MAV_CMD_NAV_TAKEOFF: Px4._take_off,
    dialect.MAV_CMD_NAV_LAND: Px4._land,
    dialect.MAV_CMD_REQUEST_MESSAGE: Px4._request,
    dialect.MAV_CMD_SET_MESSAGE_INTERVAL: Px4._set_interval,
}
