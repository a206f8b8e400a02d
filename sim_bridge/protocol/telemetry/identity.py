"""Telemetry of identity, time, home, origin and mission progress."""

import math
import zlib

from gcs.mavlink import MessageId
from sim_bridge.personality import Milestone
from sim_bridge.protocol.telemetry.instruments import Builder, Fields, Sources, on_earth
from sim_bridge.protocol.telemetry.motion import quaternion

_UID_BYTES = 18


def _mission_current(sources: Sources) -> Fields:
    progress = sources.autopilot.progress
    state, mode = progress.state(sources.autopilot.mode.intent, flying=sources.autopilot.flying)
    return {"seq": progress.seq, "total": progress.counted, "mission_state": int(state), "mission_mode": mode}


def _system_time(sources: Sources) -> Fields:
    known = sources.reached(Milestone.FIXED)
    unix_us = sources.instruments.unix_us if known else 0
    return {"time_unix_usec": unix_us, "time_boot_ms": sources.instruments.boot_ms}


def _home_position(sources: Sources) -> Fields | None:
    if not sources.reached(Milestone.PLACED):
        return None
    instruments, home_ned_m = sources.instruments, sources.autopilot.path_generator.home_ned_m
    yaw_rad = float(instruments.estimate[8])
    return {
        **on_earth(instruments.place(home_ned_m), "latitude", "longitude", "altitude"),
        **dict(zip("xyz", instruments.frame.own_m(home_ned_m).tolist(), strict=True)),
        "q": quaternion(0.0, 0.0, yaw_rad) if sources.personality.streams.home_has_attitude else [math.nan] * 4,
        **dict.fromkeys(("approach_x", "approach_y", "approach_z"), 0.0),
        "time_usec": instruments.boot_ms * 1000,
    }


def _global_origin(sources: Sources) -> Fields | None:
    if not sources.reached(Milestone.PLACED):
        return None
    instruments = sources.instruments
    place = on_earth(instruments.place(instruments.frame.begins_ned_m), "latitude", "longitude", "altitude")
    return {**place, "time_usec": instruments.boot_ms * 1000}


def _autopilot_version(sources: Sources) -> Fields:
    personality, uid = sources.personality, sources.instruments.uid
    return {
        "capabilities": int(personality.capabilities),
        "flight_sw_version": personality.version,
        **dict.fromkeys(("middleware_sw_version", "os_sw_version", "board_version", "vendor_id", "product_id"), 0),
        "flight_custom_version": list(b"skein\0\0\0"),
        "middleware_custom_version": [0] * 8,
        "os_custom_version": [0] * 8,
        "uid": zlib.crc32(uid) << 32 | zlib.crc32(uid[::-1]) if personality.sends_uid else 0,
        "uid2": list(uid.ljust(_UID_BYTES, b"\0")),
    }


BUILDERS: dict[MessageId, Builder] = {
    MessageId.SYSTEM_TIME: _system_time,
    MessageId.MISSION_CURRENT: _mission_current,
    MessageId.GPS_GLOBAL_ORIGIN: _global_origin,
    MessageId.AUTOPILOT_VERSION: _autopilot_version,
    MessageId.HOME_POSITION: _home_position,
}
