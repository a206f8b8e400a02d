"""Who, when, where from and how far: identity, time, home, origin, mission progress.

Knows: fields and units of these messages. Does not know: when they are due.
"""

from __future__ import annotations

import math
import zlib

from gcs.frames import to_degE7
from gcs.link.wire.message import Message
from gcs.mavlink import MessageId
from sim_bridge.personality import Milestone
from sim_bridge.protocol.telemetry.motion import quaternion
from sim_bridge.protocol.telemetry.sources import Builder, Sources

_UID_BYTES = 18


def _mission_current(tell: Sources) -> Message:
    progress = tell.autopilot.helm.progress
    state, mode = progress.state(tell.autopilot.mode.intent, flying=tell.autopilot.flying)
    return Message(
        "MISSION_CURRENT",
        {"seq": progress.seq, "total": progress.counted, "mission_state": int(state), "mission_mode": mode},
    )


def _system_time(tell: Sources) -> Message:
    known = tell.reached(Milestone.FIXED)
    unix_us = tell.instruments.unix_us if known else 0
    return Message("SYSTEM_TIME", {"time_unix_usec": unix_us, "time_boot_ms": tell.instruments.boot_ms})


def _home_position(tell: Sources) -> Message | None:
    if not tell.reached(Milestone.PLACED):
        return None
    instruments, home_ned_m = tell.instruments, tell.autopilot.guide.home_ned_m
    place = instruments.place(home_ned_m)
    x, y, z = (home_ned_m - instruments.pad_ned_m).tolist()
    yaw_rad = float(instruments.estimate[8])
    return Message(
        "HOME_POSITION",
        {
            "latitude": to_degE7(place.lat_deg),
            "longitude": to_degE7(place.lon_deg),
            "altitude": round(place.alt_amsl_m * 1000.0),
            "x": x,
            "y": y,
            "z": z,
            "q": quaternion(0.0, 0.0, yaw_rad) if tell.personality.streams.home_has_attitude else [math.nan] * 4,
            "approach_x": 0.0,
            "approach_y": 0.0,
            "approach_z": 0.0,
            "time_usec": instruments.boot_ms * 1000,
        },
    )


def _global_origin(tell: Sources) -> Message | None:
    if not tell.reached(Milestone.PLACED):
        return None
    place = tell.instruments.place(tell.instruments.pad_ned_m)
    return Message(
        "GPS_GLOBAL_ORIGIN",
        {
            "latitude": to_degE7(place.lat_deg),
            "longitude": to_degE7(place.lon_deg),
            "altitude": round(place.alt_amsl_m * 1000.0),
            "time_usec": tell.instruments.boot_ms * 1000,
        },
    )


def _autopilot_version(tell: Sources) -> Message:
    identity, uid = tell.personality.identity, tell.instruments.uid
    return Message(
        "AUTOPILOT_VERSION",
        {
            "capabilities": int(identity.capabilities),
            "flight_sw_version": identity.version,
            "middleware_sw_version": 0,
            "os_sw_version": 0,
            "board_version": 0,
            "flight_custom_version": list(b"skein\0\0\0"),
            "middleware_custom_version": [0] * 8,
            "os_custom_version": [0] * 8,
            "vendor_id": 0,
            "product_id": 0,
            "uid": zlib.crc32(uid) << 32 | zlib.crc32(uid[::-1]) if identity.tells_uid else 0,
            "uid2": list(uid.ljust(_UID_BYTES, b"\0")),
        },
    )


BUILDERS: dict[int, Builder] = {
    MessageId.SYSTEM_TIME: _system_time,
    MessageId.MISSION_CURRENT: _mission_current,
    MessageId.GPS_GLOBAL_ORIGIN: _global_origin,
    MessageId.AUTOPILOT_VERSION: _autopilot_version,
    MessageId.HOME_POSITION: _home_position,
}
