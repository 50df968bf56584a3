"""Conversions between the state of the simulated vehicle and MAVLink messages.

Fields: https://mavlink.io/en/messages/common.html
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Final, NamedTuple

from arva_hil.mavlink.codec import dialect
from arva_hil.simulated.autopilot import Mode, SetPoint, SimulatedAutopilot
from arva_hil.simulated.multirotor import Motion, Multirotor, Vector
from arva_hil.simulated.position import Home

Message = Any  # pymavlink's generated classes carry no types

_RANGE_CM: Final = 4000
_NOTHING: Final = (0.0, 0.0, 0.0)
SENSORS: Final = dialect.MAV_SYS_STATUS_SENSOR_ABSOLUTE_PRESSURE | dialect.MAV_SYS_STATUS_SENSOR_LASER_POSITION


class VehicleReport(NamedTuple):
    """The values for messages, at one instant."""

    boot_ms: int
    motion: Motion  # true
    position: Vector  # NED from home, estimated
    pilot: SimulatedAutopilot
    home: Home
    sensors: int  # of `SENSORS`


def read_set_point(m: Message, motion: Multirotor) -> SetPoint | None:
    """Return the set-point in a SET_POSITION_TARGET_LOCAL_NED for a vehicle with this motion; None if it is invalid.

    If one of three values is ignored, all three are; without position and velocity the vehicle stops. Body frames are
    turned by the present yaw. In all frames but LOCAL_NED a position is an offset from the present one.
    """
    frame, mask = m.coordinate_frame, m.type_mask
    position = None if mask & 0x007 else (m.x, m.y, m.z)
    velocity = (0.0, 0.0, 0.0) if mask & 0x038 else (m.vx, m.vy, m.vz)
    yaw = None if mask & dialect.POSITION_TARGET_TYPEMASK_YAW_IGNORE else m.yaw
    yaw_rate = 0.0 if mask & dialect.POSITION_TARGET_TYPEMASK_YAW_RATE_IGNORE else m.yaw_rate
    body = frame in (dialect.MAV_FRAME_BODY_NED, dialect.MAV_FRAME_BODY_OFFSET_NED)
    local = frame in (dialect.MAV_FRAME_LOCAL_NED, dialect.MAV_FRAME_LOCAL_OFFSET_NED)
    used = *(position or ()), *velocity, yaw or 0.0, yaw_rate
    if not (body or local) or not all(map(math.isfinite, used)):
        return None
    if body:
        velocity = _turned(velocity, motion.yaw)
        position = position and _turned(position, motion.yaw)
        yaw = None if yaw is None else yaw + motion.yaw
    if position and frame != dialect.MAV_FRAME_LOCAL_NED:
        position = position[0] + motion.north, position[1] + motion.east, position[2] + motion.down
    return SetPoint(position, velocity, yaw, yaw_rate)


def _turned(vector: Vector, yaw: float) -> Vector:
    x, y, z = vector
    return x * math.cos(yaw) - y * math.sin(yaw), x * math.sin(yaw) + y * math.cos(yaw), z


def _heartbeat(r: VehicleReport) -> Message:
    mode = dialect.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | dialect.MAV_MODE_FLAG_STABILIZE_ENABLED
    mode |= dialect.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED
    if r.pilot.mode in (Mode.GUIDED, Mode.LOITER, Mode.RTL):
        mode |= dialect.MAV_MODE_FLAG_GUIDED_ENABLED
    if r.pilot.armed:
        mode |= dialect.MAV_MODE_FLAG_SAFETY_ARMED
    state = dialect.MAV_STATE_STANDBY if r.pilot.landed else dialect.MAV_STATE_ACTIVE
    kind = dialect.MAV_TYPE_QUADROTOR, dialect.MAV_AUTOPILOT_ARDUPILOTMEGA
    return dialect.MAVLink_heartbeat_message(*kind, mode, r.pilot.mode, state, 3)


def _sys_status(r: VehicleReport) -> Message:
    battery = dialect.MAV_SYS_STATUS_SENSOR_BATTERY
    present = dialect.MAV_SYS_STATUS_SENSOR_GPS | dialect.MAV_SYS_STATUS_PREARM_CHECK | battery | r.sensors
    health = present if r.pilot.ready else battery | r.sensors
    health &= ~battery if r.pilot.empty else present  # as ArduPilot reports a triggered failsafe
    millivolts, percent = (14000, 10) if r.pilot.empty else (16000, -1)
    return dialect.MAVLink_sys_status_message(present, present, health, 100, millivolts, -1, percent, 0, 0, 0, 0, 0, 0)


def _gps_raw_int(r: VehicleReport) -> Message:
    if not r.pilot.ready:
        unknown = [0xFFFF] * 4
        fix = dialect.GPS_FIX_TYPE_NO_FIX
        return dialect.MAVLink_gps_raw_int_message(r.boot_ms * 1000, fix, 0, 0, 0, *unknown, 0)
    north, east, _ = r.motion.velocity
    speed, course = math.hypot(north, east), round(math.degrees(math.atan2(east, north)) * 100) % 36000
    fixed = dialect.GPS_FIX_TYPE_3D_FIX, *_place(r.home.lla_fast(r.position))
    return dialect.MAVLink_gps_raw_int_message(r.boot_ms * 1000, *fixed, 100, 150, round(speed * 100), course, 10)


def _local_position_ned(r: VehicleReport) -> Message | None:
    if not r.pilot.ready:
        return None
    return dialect.MAVLink_local_position_ned_message(r.boot_ms, *r.position, *r.motion.velocity)


def _global_position_int(r: VehicleReport) -> Message:
    if not r.pilot.ready:
        return dialect.MAVLink_global_position_int_message(r.boot_ms, 0, 0, 0, 0, 0, 0, 0, 0)
    lat, lon, alt = r.home.lla_fast(r.position)
    vn, ve, vd = r.motion.velocity
    place = round(lat * 1e7), round(lon * 1e7), round(alt * 1e3), round((alt - r.home.alt_m) * 1e3)
    heading = round(math.degrees(_yaw(r.motion)) * 100) % 36000
    return dialect.MAVLink_global_position_int_message(
        r.boot_ms, *place, round(vn * 100), round(ve * 100), round(vd * 100), heading
    )


def _scaled_pressure(r: VehicleReport) -> Message | None:
    """Return the pressure of the standard atmosphere at the true altitude."""
    if not r.sensors & dialect.MAV_SYS_STATUS_SENSOR_ABSOLUTE_PRESSURE:
        return None
    altitude = r.home.alt_m - r.motion.position[2]
    hpa = 1013.25 * max(1 - 2.25577e-5 * altitude, 1e-3) ** 5.25588
    return dialect.MAVLink_scaled_pressure_message(r.boot_ms, hpa, 0.0, 2000)


def _distance_sensor(r: VehicleReport) -> Message | None:
    """Return the height above the ground, without the effect of the tilt."""
    if not r.sensors & dialect.MAV_SYS_STATUS_SENSOR_LASER_POSITION:
        return None
    height = min(round(-r.motion.position[2] * 100), _RANGE_CM)
    down = dialect.MAV_SENSOR_ROTATION_PITCH_270
    return dialect.MAVLink_distance_sensor_message(r.boot_ms, 0, _RANGE_CM, height, 0, 0, down, 0)


def _home_position(r: VehicleReport) -> Message | None:
    if not r.pilot.ready:
        return None
    place, level = _place(r.home.lla((0.0, 0.0, 0.0))), [1.0, 0.0, 0.0, 0.0]
    return dialect.MAVLink_home_position_message(*place, *_NOTHING, level, *_NOTHING, r.boot_ms * 1000)


def _extended_sys_state(r: VehicleReport) -> Message:
    state = dialect.MAV_LANDED_STATE_LANDING if r.pilot.mode == Mode.LAND else dialect.MAV_LANDED_STATE_IN_AIR
    if r.pilot.taking_off:
        state = dialect.MAV_LANDED_STATE_TAKEOFF
    elif r.pilot.landed:
        state = dialect.MAV_LANDED_STATE_ON_GROUND
    return dialect.MAVLink_extended_sys_state_message(0, state)


def _position_target(r: VehicleReport) -> Message | None:
    """Return the target of a set-point with a position; ArduCopter sends none otherwise."""
    if (target := r.pilot.target) is None:
        return None
    lat, lon, alt = r.home.lla(target)
    frame, only_position = dialect.MAV_FRAME_GLOBAL, 0xDF8
    return dialect.MAVLink_position_target_global_int_message(
        r.boot_ms, frame, only_position, round(lat * 1e7), round(lon * 1e7), alt, *_NOTHING, *_NOTHING, 0.0, 0.0
    )


def _vfr_hud(r: VehicleReport) -> Message:
    """Return VFR_HUD: half throttle in a hover, more in a climb."""
    north, east, down = r.motion.velocity
    throttle = 0 if r.pilot.landed else max(0, min(100, round(50 - 10 * down)))
    heading, speed = round(math.degrees(_yaw(r.motion))) % 360, math.hypot(north, east)
    return dialect.MAVLink_vfr_hud_message(speed, speed, heading, throttle, r.home.alt_m - r.motion.position[2], -down)


def _autopilot_version(r: VehicleReport) -> Message:
    can = dialect.MAV_PROTOCOL_CAPABILITY_MAVLINK2 | dialect.MAV_PROTOCOL_CAPABILITY_COMMAND_INT
    can |= dialect.MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_LOCAL_NED
    version, none = 4 << 24 | 7 << 16, [0] * 8
    return dialect.MAVLink_autopilot_version_message(can, version, 0, 0, 0, none, none, none, 0, 0, 0)


def _simstate(r: VehicleReport) -> Message:
    """Return the true pose. Accelerations are 0."""
    pose, lat_lon = (*_roll_pitch(r.motion), _yaw(r.motion)), _place(r.home.lla_fast(r.motion.position))[:2]
    return dialect.MAVLink_simstate_message(*pose, *_NOTHING, *r.motion.rates, *lat_lon)


def _sim_state(r: VehicleReport) -> Message:
    """Return the true pose and velocity. Accelerations are 0."""
    motion, place = r.motion, r.home.lla_fast(r.motion.position)
    pose = *motion.quaternion, *_roll_pitch(motion), _yaw(motion)
    moving = *_NOTHING, *motion.rates, *place, 0.0, 0.0, *motion.velocity
    return dialect.MAVLink_sim_state_message(*pose, *moving, *_place(place)[:2])


def _place(lla: Vector) -> tuple[int, int, int]:
    """Return the place as in messages: degrees · 1e7, millimetres."""
    lat, lon, alt = lla
    return round(lat * 1e7), round(lon * 1e7), round(alt * 1e3)


def _roll_pitch(motion: Motion) -> tuple[float, float]:
    w, x, y, z = motion.quaternion
    roll = math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    return roll, math.asin(max(-1.0, min(2 * (w * y - z * x), 1.0)))


def _yaw(motion: Motion) -> float:
    w, x, y, z = motion.quaternion
    return math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))


# Message id → function that makes the message, or None while there is none.
BUILDERS: Final[dict[int, Callable[[VehicleReport], Message | None]]] = {
    dialect.MAVLINK_MSG_ID_HEARTBEAT: _heartbeat,
    dialect.MAVLINK_MSG_ID_SYS_STATUS: _sys_status,
    dialect.MAVLINK_MSG_ID_GPS_RAW_INT: _gps_raw_int,
    dialect.MAVLINK_MSG_ID_ATTITUDE: lambda r: dialect.MAVLink_attitude_message(
        r.boot_ms, *_roll_pitch(r.motion), _yaw(r.motion), *r.motion.rates
    ),
    dialect.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: lambda r: dialect.MAVLink_attitude_quaternion_message(
        r.boot_ms, *r.motion.quaternion, *r.motion.rates
    ),
    dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED: _local_position_ned,
    dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: _global_position_int,
    dialect.MAVLINK_MSG_ID_SCALED_PRESSURE: _scaled_pressure,
    dialect.MAVLINK_MSG_ID_DISTANCE_SENSOR: _distance_sensor,
    dialect.MAVLINK_MSG_ID_AUTOPILOT_VERSION: _autopilot_version,
    dialect.MAVLINK_MSG_ID_HOME_POSITION: _home_position,
    dialect.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: _extended_sys_state,
    dialect.MAVLINK_MSG_ID_SIM_STATE: _sim_state,
    dialect.MAVLINK_MSG_ID_SIMSTATE: _simstate,
    dialect.MAVLINK_MSG_ID_RC_CHANNELS: lambda r: dialect.MAVLink_rc_channels_message(
        r.boot_ms, 4, *r.pilot.sticks, *[0xFFFF] * 14, 255
    ),  # 14 channels are not used
    dialect.MAVLINK_MSG_ID_VFR_HUD: _vfr_hud,
    dialect.MAVLINK_MSG_ID_POSITION_TARGET_GLOBAL_INT: _position_target,
}
