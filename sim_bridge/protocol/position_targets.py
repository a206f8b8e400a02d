"""Converts SET_POSITION_TARGET_LOCAL_NED and _GLOBAL_INT to setpoints. Values that are NaN or too large are refused."""

import math

import numpy as np

from gcs.frames import from_degE7, geodetic_to_ned
from gcs.link.wire.message import Message
from gcs.mavlink import SetpointMask, WireFrame
from gcs.types import Array
from sim_bridge.autopilot.guidance.stream import StampedSetpoint
from sim_bridge.protocol.telemetry import Instruments

SETPOINTS = frozenset({"SET_POSITION_TARGET_LOCAL_NED", "SET_POSITION_TARGET_GLOBAL_INT"})
# A stamp further off comes from the ground station's own clock. Boot clocks begin at 5 s or more, so a ground station
# that started after the vehicles is always further behind.
_BEHIND_S, _AHEAD_S = 4.0, 10.0
_FAR = 1e6  # m, m/s, m/s²: larger values are invalid
_OFFSETS = frozenset({WireFrame.LOCAL_OFFSET_NED, WireFrame.BODY_NED, WireFrame.BODY_OFFSET_NED})
_TURNED = frozenset({WireFrame.BODY_NED, WireFrame.BODY_OFFSET_NED})
_ABOVE_SEA = frozenset({WireFrame.GLOBAL, WireFrame.GLOBAL_INT})
_ABOVE_HOME = frozenset({WireFrame.GLOBAL_RELATIVE_ALT, WireFrame.GLOBAL_RELATIVE_ALT_INT})
_NOTHING = SetpointMask.IGNORE_POSITION | SetpointMask.IGNORE_VELOCITY | SetpointMask.IGNORE_ACCELERATION


def setpoint_in(
    message: Message, instruments: Instruments, flat_now: Array, home_ned_m: Array
) -> tuple[StampedSetpoint, bool] | None:
    """Return the setpoint of a message, and whether it is a position to rest at; None if the message is invalid.

    `flat_now` (DERIVATIVES, 4) is what the vehicle flies now: components that the mask ignores stay as they are.
    """
    fields, mask, frame = message.fields, message.fields["type_mask"], message.fields["coordinate_frame"]
    flat = np.zeros((3, 4))
    flat[0] = flat_now[0]
    yaw_rad = float(flat_now[0, 3])
    turn = _turn(yaw_rad) if frame in _TURNED else np.eye(3)
    counts = instruments.frame.counts
    if not mask & SetpointMask.IGNORE_POSITION:
        place = _place(message, instruments, turn, flat_now, home_ned_m)
        if place is None:
            return None
        flat[0, :3] = place
    elif mask & _NOTHING == _NOTHING or not _known(message):
        return None
    if not mask & SetpointMask.IGNORE_VELOCITY:
        flat[1, :3] = _vector(turn, fields["vx"], fields["vy"], fields["vz"]) / counts
    if not mask & SetpointMask.IGNORE_ACCELERATION:
        flat[2, :3] = _vector(turn, fields["afx"], fields["afy"], fields["afz"]) / counts
    if not mask & SetpointMask.IGNORE_YAW:
        flat[0, 3] = fields["yaw"]
    if not mask & SetpointMask.IGNORE_YAW_RATE:
        flat[1, 3] = fields["yaw_rate"]
    if not np.abs(flat).max() < _FAR:  # also false for NaN
        return None
    t_s = instruments.t_s
    if mask & SetpointMask.IGNORE_VELOCITY and mask & SetpointMask.IGNORE_ACCELERATION:
        return StampedSetpoint(t_s, flat, stamped=False), True
    stamp_s = instruments.simulated_s(fields["time_boot_ms"])
    stamped = is_stamp(stamp_s, t_s)
    return StampedSetpoint(stamp_s if stamped else t_s, flat, stamped, t_s), False


def is_stamp(stamp_s: float, t_s: float) -> bool:
    """Whether a stamp on a setpoint that arrives at `t_s` is of the vehicle's own clock; both in simulated seconds."""
    return t_s - _BEHIND_S <= stamp_s <= t_s + _AHEAD_S


def _known(message: Message) -> bool:
    frame = message.fields["coordinate_frame"]
    if message.name == "SET_POSITION_TARGET_LOCAL_NED":
        return frame == WireFrame.LOCAL_NED or frame in _OFFSETS
    return frame in _ABOVE_SEA or frame in _ABOVE_HOME


def _place(message: Message, instruments: Instruments, turn: Array, flat_now: Array, home_ned_m: Array) -> Array | None:
    fields = message.fields
    if not _known(message):
        return None
    if message.name == "SET_POSITION_TARGET_LOCAL_NED":
        offset = _vector(turn, fields["x"], fields["y"], fields["z"]) / instruments.frame.counts
        begins = flat_now[0, :3] if fields["coordinate_frame"] in _OFFSETS else instruments.frame.begins_ned_m
        return np.asarray(begins + offset)
    amsl_m = fields["alt"]
    if fields["coordinate_frame"] in _ABOVE_HOME:
        amsl_m += instruments.origin.alt_amsl_m - float(home_ned_m[2])
    if not abs(amsl_m) < _FAR:
        return None
    lat_deg, lon_deg = from_degE7(fields["lat_int"]), from_degE7(fields["lon_int"])
    if abs(lat_deg) > 90.0 or abs(lon_deg) > 180.0:
        return None
    return geodetic_to_ned(lat_deg, lon_deg, amsl_m, instruments.origin)


def _vector(turn: Array, *values: float) -> Array:
    """Return three numbers turned to NED; NaN if they are invalid."""
    return turn @ np.array(values) if all(abs(value) < _FAR for value in values) else np.full(3, np.nan)


def _turn(yaw_rad: float) -> Array:
    """Return the rotation from body (heading only) to NED."""
    s, c = math.sin(yaw_rad), math.cos(yaw_rad)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
