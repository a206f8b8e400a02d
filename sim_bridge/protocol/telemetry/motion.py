"""Telemetry of motion and its setpoints."""

import math

import numpy as np

from gcs.frames import to_degE7
from gcs.mavlink import MessageId, SetpointMask, WireFrame
from gcs.types import Array
from sim_bridge.personality import Intent, Milestone
from sim_bridge.protocol.telemetry.instruments import Builder, Fields, Sources, on_earth

_FULL = int(SetpointMask.IGNORE_YAW_RATE)
_GROUND_LEVEL = 63  # mask of the setpoint of a vehicle on the ground
_PWM_OFF, _PWM_IDLE, _PWM_RANGE = 900, 1000, 1000


def quaternion(roll_rad: float, pitch_rad: float, yaw_rad: float) -> list[float]:
    """Return the rotation from body to NED, w first."""
    sr, cr = math.sin(0.5 * roll_rad), math.cos(0.5 * roll_rad)
    sp, cp = math.sin(0.5 * pitch_rad), math.cos(0.5 * pitch_rad)
    sy, cy = math.sin(0.5 * yaw_rad), math.cos(0.5 * yaw_rad)
    return [
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    ]


def _attitude(sources: Sources) -> Fields:
    roll, pitch, yaw, p, q, r = sources.instruments.estimate[6:].tolist()
    return {
        "time_boot_ms": sources.instruments.boot_ms,
        "roll": roll,
        "pitch": pitch,
        "yaw": math.remainder(yaw, math.tau),
        "rollspeed": p,
        "pitchspeed": q,
        "yawspeed": r,
    }


def _attitude_quaternion(sources: Sources) -> Fields:
    roll, pitch, yaw, p, q, r = sources.instruments.estimate[6:].tolist()
    q1, q2, q3, q4 = quaternion(roll, pitch, yaw)
    fields = {"time_boot_ms": sources.instruments.boot_ms, "q1": q1, "q2": q2, "q3": q3, "q4": q4}
    return {**fields, "rollspeed": p, "pitchspeed": q, "yawspeed": r}


def _local_position(sources: Sources) -> Fields | None:
    if not sources.reached(sources.personality.streams.local_from):
        return None
    instruments = sources.instruments
    state = instruments.estimate
    x, y, z = instruments.frame.own_m(state[:3]).tolist()
    vx, vy, vz = (state[3:6] * instruments.frame.counts).tolist()
    return {"time_boot_ms": instruments.boot_ms, "x": x, "y": y, "z": z, "vx": vx, "vy": vy, "vz": vz}


def _global_position(sources: Sources) -> Fields | None:
    if not sources.reached(sources.personality.streams.global_from):
        return None
    instruments = sources.instruments
    state = instruments.estimate
    names = ("lat", "lon", "alt")
    placed = sources.reached(Milestone.PLACED)
    return {
        "time_boot_ms": instruments.boot_ms,
        **(on_earth(instruments.here, *names) if placed else dict.fromkeys(names, 0)),
        "relative_alt": round((sources.autopilot.path_generator.home_ned_m[2] - state[2]) * 1000.0),
        **dict(zip(("vx", "vy", "vz"), map(round, (state[3:6] * 100.0).tolist()), strict=True)),
        "hdg": round(math.degrees(state[8]) * 100.0) % 36000,
    }


def _vfr_hud(sources: Sources) -> Fields:
    instruments = sources.instruments
    state = instruments.estimate
    speed = math.hypot(state[3], state[4])
    return {
        "airspeed": speed if sources.personality.streams.reports_airspeed else math.nan,
        "groundspeed": speed,
        "heading": round(math.degrees(state[8])) % 360,
        "throttle": round(100.0 * float(np.mean(_throttle(sources)))),
        "alt": instruments.origin.alt_amsl_m - float(state[2]),
        "climb": -float(state[5]),
    }


def _altitude(sources: Sources) -> Fields:
    instruments = sources.instruments
    down_m = float(instruments.estimate[2])
    amsl_m = instruments.origin.alt_amsl_m - down_m
    relative_m = float(sources.autopilot.path_generator.home_ned_m[2]) - down_m
    return {
        "time_usec": instruments.boot_ms * 1000,
        "altitude_monotonic": amsl_m,
        "altitude_amsl": amsl_m,
        "altitude_local": float(instruments.frame.begins_ned_m[2]) - down_m,
        "altitude_relative": relative_m,
        "altitude_terrain": math.nan,
        "bottom_clearance": math.nan,
    }


def _local_target(sources: Sources) -> Fields | None:
    if sources.personality.streams.targets_in_guided_only and sources.autopilot.mode.intent is not Intent.GUIDED:
        return None
    mask, flat = _target(sources)
    x, y, z = sources.instruments.frame.own_m(flat[0, :3]).tolist()
    fields = {"time_boot_ms": sources.instruments.boot_ms, "coordinate_frame": int(WireFrame.LOCAL_NED)}
    return {**fields, "type_mask": mask, "x": x, "y": y, "z": z, **_rates(flat)}


def _global_target(sources: Sources) -> Fields | None:
    if not sources.autopilot.flying:
        return None
    mask, flat = _target(sources)
    place = sources.instruments.place(flat[0, :3])
    fields = {"time_boot_ms": sources.instruments.boot_ms, "coordinate_frame": int(WireFrame.GLOBAL_INT)}
    where = {"lat_int": to_degE7(place.lat_deg), "lon_int": to_degE7(place.lon_deg), "alt": place.alt_amsl_m}
    return {**fields, "type_mask": mask, **where, **_rates(flat)}


def _attitude_target(sources: Sources) -> Fields:
    """The attitude and thrust for the wanted acceleration in still air."""
    _, flat = _target(sources)
    yaw = float(flat[0, 3])
    north, east, down = flat[2, :3].tolist()
    ahead, right = north * math.cos(yaw) + east * math.sin(yaw), east * math.cos(yaw) - north * math.sin(yaw)
    pull = max(9.8 - down, 1.0)
    return {
        "time_boot_ms": sources.instruments.boot_ms,
        "type_mask": 0,
        "q": quaternion(math.atan2(right, pull), -math.atan2(ahead, pull), math.remainder(yaw, math.tau)),
        "body_roll_rate": 0.0,
        "body_pitch_rate": 0.0,
        "body_yaw_rate": float(flat[1, 3]),
        "thrust": float(np.mean(_throttle(sources))),
    }


def _nav_output(sources: Sources) -> Fields:
    _, flat = _target(sources)
    state = sources.instruments.estimate
    north, east = (flat[0, :2] - state[:2]).tolist()
    course = round(math.degrees(math.atan2(flat[1, 1], flat[1, 0])))
    return {
        "nav_roll": math.degrees(state[6]),
        "nav_pitch": math.degrees(state[7]),
        "nav_bearing": course,
        "target_bearing": round(math.degrees(math.atan2(east, north))),
        "wp_dist": min(round(math.hypot(north, east)), 0xFFFF),
        "alt_error": float(state[2] - flat[0, 2]),
        "aspd_error": 0.0,
        "xtrack_error": 0.0,
    }


def _servo_output(sources: Sources) -> Fields:
    off = not sources.autopilot.armed
    pwm = [_PWM_OFF] * 4 if off else [round(_PWM_IDLE + _PWM_RANGE * share) for share in _throttle(sources).tolist()]
    servos = {f"servo{n}_raw": value for n, value in enumerate(pwm + [_PWM_OFF] * 4, start=1)}
    return {"time_usec": sources.instruments.boot_ms * 1000 & 0xFFFFFFFF, "port": 0, **servos}


def _target(sources: Sources) -> tuple[int, Array]:
    """Return the mask of the present setpoint and its derivatives (DERIVATIVES, 4)."""
    autopilot = sources.autopilot
    return _FULL if autopilot.flying else _GROUND_LEVEL, autopilot.path.piece.at(sources.instruments.t_s)


def _rates(flat: Array) -> dict[str, float]:
    (vx, vy, vz, yaw_rate), (afx, afy, afz, _) = flat[1].tolist(), flat[2].tolist()
    motion = {"vx": vx, "vy": vy, "vz": vz, "afx": afx, "afy": afy, "afz": afz}
    return {**motion, "yaw": math.remainder(float(flat[0, 3]), math.tau), "yaw_rate": yaw_rate}


def _throttle(sources: Sources) -> Array:
    """Return the rotor speeds (4,) as shares of the maximum."""
    airframes = sources.instruments.airframes
    return np.asarray(airframes.rotors_radps[sources.instruments.row] / airframes.rotor_max_radps)


BUILDERS: dict[MessageId, Builder] = {
    MessageId.ATTITUDE: _attitude,
    MessageId.ATTITUDE_QUATERNION: _attitude_quaternion,
    MessageId.LOCAL_POSITION_NED: _local_position,
    MessageId.GLOBAL_POSITION_INT: _global_position,
    MessageId.SERVO_OUTPUT_RAW: _servo_output,
    MessageId.NAV_CONTROLLER_OUTPUT: _nav_output,
    MessageId.VFR_HUD: _vfr_hud,
    MessageId.ATTITUDE_TARGET: _attitude_target,
    MessageId.POSITION_TARGET_LOCAL_NED: _local_target,
    MessageId.POSITION_TARGET_GLOBAL_INT: _global_target,
    MessageId.ALTITUDE: _altitude,
}
