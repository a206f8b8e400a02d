"""What a vehicle tells of itself, and how often.

Knows: how states become message fields; intervals in simulated time. Does not know: sockets, decisions.
Everything comes from the estimate: a vehicle does not know where it truly is.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from gcs.frames import Origin, ned_to_geodetic, to_degE7
from gcs.link.dialect import EkfFlag, MavState, MavType, MessageId, ModeFlag
from gcs.link.message import Message
from gcs.quadrotor import Array
from sim_bridge.airframes import Airframes
from sim_bridge.autopilot import Autopilot
from sim_bridge.personality import Intent, Milestone, Personality

_PREARM = 0x10000000  # MAV_SYS_STATUS_PREARM_CHECK
_SENSORS = 0x2000002F | 0x200000  # gyro, accelerometer, magnetometer, barometer, GNSS; AHRS
_BEFORE_READY = (
    EkfFlag.ATTITUDE | EkfFlag.VELOCITY_HORIZ | EkfFlag.VELOCITY_VERT | EkfFlag.POS_VERT_ABS | EkfFlag.CONST_POS_MODE
)
_READY = EkfFlag(0x33F)
_UID_BYTES = 18
_LONGEST_US = 2**31 - 1  # that MESSAGE_INTERVAL can tell
_MISSION_STATES = {"none": 1, "not started": 2, "active": 3}  # MISSION_STATE


class Whereabouts:
    """Where all vehicles think they are on Earth, worked out once for all of them when the first one asks."""

    def __init__(self, airframes: Airframes, origin: Origin) -> None:
        self._airframes = airframes
        self._origin = origin
        self._t_s = math.nan
        self._places: list[Origin] = []

    def of(self, row: int, t_s: float) -> Origin:
        """Estimated place of one vehicle at `t_s`, which is now."""
        if t_s != self._t_s:
            columns = ned_to_geodetic(self._airframes.estimate[:, :3], self._origin)
            self._places = [Origin(*place) for place in np.stack(columns, axis=-1).tolist()]
            self._t_s = t_s
        return self._places[row]


@dataclass
class Instruments:
    """One row of a fleet's airframes, its clock and its place on Earth."""

    airframes: Airframes
    whereabouts: Whereabouts
    row: int
    pad_ned_m: Array  # (3,): origin of the vehicle's LOCAL_NED
    origin: Origin
    boot_offset_ms: int
    epoch_unix_us: int
    uid: bytes
    t_s: float = 0.0

    @property
    def estimate(self) -> Array:
        """Estimated state (12,), common local NED."""
        return np.asarray(self.airframes.estimate[self.row])

    @property
    def healthy(self) -> bool:
        """Whether the estimate can be flown on."""
        return bool(self.airframes.healthy[self.row])

    @property
    def boot_ms(self) -> int:
        """The vehicle's own clock: milliseconds since its boot."""
        return round(self.t_s * 1000.0) + self.boot_offset_ms

    def simulated_s(self, boot_ms: int) -> float:
        """Simulated time of an instant of the vehicle's clock."""
        return (boot_ms - self.boot_offset_ms) / 1000.0

    @property
    def unix_us(self) -> int:
        """GNSS time: the same for all vehicles."""
        return self.epoch_unix_us + round(self.t_s * 1e6)

    @property
    def here(self) -> Origin:
        """Where the vehicle thinks it is."""
        return self.whereabouts.of(self.row, self.t_s)

    def place(self, ned_m: Array) -> Origin:
        """A point of common local NED on Earth."""
        lat, lon, alt = ned_to_geodetic(ned_m, self.origin)
        return Origin(float(lat), float(lon), float(alt))


Builder = Callable[["Telemetry"], Message | None]


class Telemetry:
    """Builds messages and says which are due."""

    def __init__(self, instruments: Instruments, autopilot: Autopilot, personality: Personality) -> None:
        self.instruments = instruments
        self.autopilot = autopilot
        self.personality = personality
        self._interval_s: dict[int, float] = dict(_DEFAULT_INTERVAL_S)
        self._due_s: dict[int, float] = dict.fromkeys(self._interval_s, 0.0)
        self._next_s = 0.0

    def due(self, t_s: float) -> list[Message]:
        """Messages whose time has come."""
        if t_s < self._next_s:
            return []
        messages = []
        for number, due_s in self._due_s.items():
            if due_s <= t_s:
                interval_s = self._interval_s[number]
                self._due_s[number] = max(due_s + interval_s, t_s)
                message = _BUILDERS[number](self)
                if message is not None:
                    messages.append(message)
        self._next_s = min(self._due_s.values(), default=math.inf)
        return messages

    def build(self, number: int) -> Message | None:
        """One message by number, now; None where there is no such message, or nothing to say yet."""
        builder = _BUILDERS.get(number)
        return builder(self) if builder is not None else None

    def knows(self, number: int) -> bool:
        """Whether the vehicle can send message `number` at all."""
        return number in _BUILDERS

    def interval_us(self, number: int) -> int:
        """MESSAGE_INTERVAL's value: microseconds, -1 when it is not sent by itself."""
        return round(self._interval_s[number] * 1e6) if number in self._interval_s else -1

    def set_interval(self, number: int, interval_us: float) -> None:
        """Send message `number` every so often from now on; 0 or less switches it off, as on ArduPilot."""
        self._interval_s.pop(number, None)
        self._due_s.pop(number, None)
        if interval_us > 0:
            self._interval_s[number] = min(interval_us, _LONGEST_US) / 1e6
            self._due_s[number] = self._next_s = self.instruments.t_s


def heartbeat(tm: Telemetry) -> Message:
    """HEARTBEAT."""
    pilot, habits = tm.autopilot, tm.personality
    flags = pilot.mode.flags
    if pilot.armed:
        flags |= ModeFlag.ARMED
    return Message(
        "HEARTBEAT",
        {
            "type": int(MavType.QUADROTOR),
            "autopilot": int(habits.identity.autopilot),
            "base_mode": int(flags),
            "custom_mode": pilot.mode.number,
            "system_status": int(MavState.ACTIVE if pilot.flying else MavState.STANDBY),
            "mavlink_version": 3,
        },
    )


def _attitude(tm: Telemetry) -> Message:
    roll, pitch, yaw, p, q, r = tm.instruments.estimate[6:].tolist()
    return Message(
        "ATTITUDE",
        {
            "time_boot_ms": tm.instruments.boot_ms,
            "roll": roll,
            "pitch": pitch,
            "yaw": math.remainder(yaw, math.tau),
            "rollspeed": p,
            "pitchspeed": q,
            "yawspeed": r,
        },
    )


def _local_position(tm: Telemetry) -> Message | None:
    if not _located(tm):
        return None
    instruments = tm.instruments
    state = instruments.estimate
    x, y, z = (state[:3] - instruments.pad_ned_m).tolist()
    vx, vy, vz = state[3:6].tolist()
    return Message(
        "LOCAL_POSITION_NED",
        {"time_boot_ms": instruments.boot_ms, "x": x, "y": y, "z": z, "vx": vx, "vy": vy, "vz": vz},
    )


def _global_position(tm: Telemetry) -> Message | None:
    if not _located(tm):
        return None
    instruments = tm.instruments
    state = instruments.estimate
    place = instruments.here
    vx, vy, vz = (state[3:6] * 100.0).tolist()
    return Message(
        "GLOBAL_POSITION_INT",
        {
            "time_boot_ms": instruments.boot_ms,
            "lat": to_degE7(place.lat_deg),
            "lon": to_degE7(place.lon_deg),
            "alt": round(place.alt_amsl_m * 1000.0),
            "relative_alt": round((tm.autopilot.guide.home_ned_m[2] - state[2]) * 1000.0),
            "vx": round(vx),
            "vy": round(vy),
            "vz": round(vz),
            "hdg": round(math.degrees(state[8]) * 100.0) % 36000,
        },
    )


def _gps_raw(tm: Telemetry) -> Message:
    fields = {"time_usec": tm.instruments.boot_ms * 1000, "fix_type": 0, "lat": 0, "lon": 0, "alt": 0}
    fields |= {"eph": 0xFFFF, "epv": 0xFFFF, "vel": 0, "cog": 0, "satellites_visible": 0}
    if _located(tm):
        state = tm.instruments.estimate
        place = tm.instruments.here
        fields |= {
            "fix_type": 6,  # RTK fixed
            "lat": to_degE7(place.lat_deg),
            "lon": to_degE7(place.lon_deg),
            "alt": round(place.alt_amsl_m * 1000.0),
            "eph": 60,
            "epv": 100,
            "vel": round(math.hypot(state[3], state[4]) * 100.0),
            "cog": round(math.degrees(math.atan2(state[4], state[3])) * 100.0) % 36000,
            "satellites_visible": 18,
        }
    return Message("GPS_RAW_INT", fields)


def _ekf_status(tm: Telemetry) -> Message:
    ratios, row = tm.instruments.airframes.innovation, tm.instruments.row
    return Message(
        "EKF_STATUS_REPORT",
        {
            "flags": int(_READY if tm.autopilot.ready else _BEFORE_READY),
            "velocity_variance": float(ratios.velocity[row]),
            "pos_horiz_variance": float(ratios.position_horizontal[row]),
            "pos_vert_variance": float(ratios.position_vertical[row]),
            "compass_variance": float(ratios.compass[row]),
            "terrain_alt_variance": 0.0,
        },
    )


def _sys_status(tm: Telemetry) -> Message:
    prearm = tm.autopilot.armed or tm.autopilot.readiness.reached(Milestone.CHECKED)
    return Message(
        "SYS_STATUS",
        {
            "onboard_control_sensors_present": _SENSORS | _PREARM,
            "onboard_control_sensors_enabled": _SENSORS | _PREARM,
            "onboard_control_sensors_health": _SENSORS | (_PREARM if prearm else 0),
            "load": 0,
            "voltage_battery": 12600,
            "current_battery": 0,
            "battery_remaining": 100,
            "drop_rate_comm": 0,
            "errors_comm": 0,
            "errors_count1": 0,
            "errors_count2": 0,
            "errors_count3": 0,
            "errors_count4": 0,
        },
    )


def _mission_current(tm: Telemetry) -> Message:
    pilot = tm.autopilot
    state = "active" if pilot.helm.progress.running else "not started" if pilot.mission else "none"
    return Message(
        "MISSION_CURRENT",
        {
            "seq": pilot.current_seq,
            "total": max(len(pilot.mission) - 1, 0),  # ArduPilot does not count home
            "mission_state": _MISSION_STATES[state],
            "mission_mode": int(pilot.mode.intent is Intent.MISSION),
        },
    )


def _system_time(tm: Telemetry) -> Message:
    return Message("SYSTEM_TIME", {"time_unix_usec": tm.instruments.unix_us, "time_boot_ms": tm.instruments.boot_ms})


def _landed_state(tm: Telemetry) -> Message:
    return Message("EXTENDED_SYS_STATE", {"vtol_state": 0, "landed_state": int(tm.autopilot.landed_state)})


def _home_position(tm: Telemetry) -> Message | None:
    if not tm.autopilot.ready:
        return None
    instruments, home_ned_m = tm.instruments, tm.autopilot.guide.home_ned_m
    place = instruments.place(home_ned_m)
    x, y, z = (home_ned_m - instruments.pad_ned_m).tolist()
    return Message(
        "HOME_POSITION",
        {
            "latitude": to_degE7(place.lat_deg),
            "longitude": to_degE7(place.lon_deg),
            "altitude": round(place.alt_amsl_m * 1000.0),
            "x": x,
            "y": y,
            "z": z,
            "q": [math.nan] * 4,
            "approach_x": 0.0,
            "approach_y": 0.0,
            "approach_z": 0.0,
            "time_usec": instruments.boot_ms * 1000,
        },
    )


def _global_origin(tm: Telemetry) -> Message | None:
    if not tm.autopilot.ready:
        return None
    place = tm.instruments.place(tm.instruments.pad_ned_m)
    return Message(
        "GPS_GLOBAL_ORIGIN",
        {
            "latitude": to_degE7(place.lat_deg),
            "longitude": to_degE7(place.lon_deg),
            "altitude": round(place.alt_amsl_m * 1000.0),
            "time_usec": tm.instruments.boot_ms * 1000,
        },
    )


def _autopilot_version(tm: Telemetry) -> Message:
    uid = tm.instruments.uid
    return Message(
        "AUTOPILOT_VERSION",
        {
            "capabilities": int(tm.personality.identity.capabilities),
            "flight_sw_version": tm.personality.identity.version,
            "middleware_sw_version": 0,
            "os_sw_version": 0,
            "board_version": 0,
            "flight_custom_version": list(b"skein\0\0\0"),
            "middleware_custom_version": [0] * 8,
            "os_custom_version": [0] * 8,
            "vendor_id": 0,
            "product_id": 0,
            "uid": 0,  # ArduPilot leaves it empty
            "uid2": list(uid.ljust(_UID_BYTES, b"\0")),
        },
    )


def _located(tm: Telemetry) -> bool:
    """Whether there is a position to tell; before that ArduPilot sends none."""
    return tm.autopilot.readiness.reached(Milestone.CHECKED)


_BUILDERS: dict[int, Builder] = {
    MessageId.HEARTBEAT: heartbeat,
    MessageId.SYS_STATUS: _sys_status,
    MessageId.SYSTEM_TIME: _system_time,
    MessageId.GPS_RAW_INT: _gps_raw,
    MessageId.ATTITUDE: _attitude,
    MessageId.LOCAL_POSITION_NED: _local_position,
    MessageId.GLOBAL_POSITION_INT: _global_position,
    MessageId.MISSION_CURRENT: _mission_current,
    MessageId.GPS_GLOBAL_ORIGIN: _global_origin,
    MessageId.AUTOPILOT_VERSION: _autopilot_version,
    MessageId.EKF_STATUS_REPORT: _ekf_status,
    MessageId.HOME_POSITION: _home_position,
    MessageId.EXTENDED_SYS_STATE: _landed_state,
}

_DEFAULT_INTERVAL_S: dict[int, float] = {
    MessageId.HEARTBEAT: 1.0,
    MessageId.ATTITUDE: 0.1,
    MessageId.LOCAL_POSITION_NED: 0.1,
    MessageId.GLOBAL_POSITION_INT: 0.25,
    MessageId.EXTENDED_SYS_STATE: 0.25,
    MessageId.MISSION_CURRENT: 0.25,
    MessageId.SYSTEM_TIME: 0.5,
    MessageId.SYS_STATUS: 0.5,
    MessageId.EKF_STATUS_REPORT: 0.5,
    MessageId.GPS_RAW_INT: 0.5,
}
