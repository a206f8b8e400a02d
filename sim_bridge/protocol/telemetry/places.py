"""Telemetry of identity, time, home, origin and mission progress."""

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


def _mission_current(sources: Sources) -> Message:
    progress = sources.autopilot.mode_actions.progress
    state, mode = progress.state(sources.autopilot.mode.intent, flying=sources.autopilot.flying)
    return Message(
        "MISSION_CURRENT",
        {"seq": progress.seq, "total": progress.counted, "mission_state": int(state), "mission_mode": mode},
    )


def _system_time(sources: Sources) -> Message:
    known = sources.reached(Milestone.FIXED)
    unix_us = sources.instruments.unix_us if known else 0
    return Message("SYSTEM_TIME", {"time_unix_usec": unix_us, "time_boot_ms": sources.instruments.boot_ms})


def _home_position(sources: Sources) -> Message | None:
    if not sources.reached(Milestone.PLACED):
        return None
    instruments, home_ned_m = sources.instruments, sources.autopilot.path_generator.home_ned_m
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
            "q": quaternion(0.0, 0.0, yaw_rad) if sources.personality.streams.home_has_attitude else [math.nan] * 4,
            "approach_x": 0.0,
            "approach_y": 0.0,
            "approach_z": 0.0,
            "time_usec": instruments.boot_ms * 1000,
        },
    )


def _global_origin(sources: Sources) -> Message | None:
    if not sources.reached(Milestone.PLACED):
        return None
    place = sources.instruments.place(sources.instruments.pad_ned_m)
    return Message(
        "GPS_GLOBAL_ORIGIN",
        {
            "latitude": to_degE7(place.lat_deg),
            "longitude": to_degE7(place.lon_deg),
            "altitude": round(place.alt_amsl_m * 1000.0),
            "time_usec": sources.instruments.boot_ms * 1000,
        },
    )


def _autopilot_version(sources: Sources) -> Message:
    identity, uid = sources.personality.identity, sources.instruments.uid
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
            "uid": zlib.crc32(uid) << 32 | zlib.crc32(uid[::-1]) if identity.sends_uid else 0,
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
