"""Telemetry of state and health: HEARTBEAT, sensors, filter, battery, receiver, ground contact."""

import math

from gcs.mavlink import PREARM_CHECK, MavState, MavType, MessageId, ModeFlag
from sim_bridge.personality import Intent, Milestone
from sim_bridge.protocol.telemetry.instruments import Builder, Fields, Sources, on_earth

_UNKNOWN = 0xFFFF
_BATTERY = 0x2000000  # MAV_SYS_STATUS_SENSOR_BATTERY
_RTK_FIXED, _FIX_3D = 6, 3
_SATELLITES = 18
_DILUTION = {"rtk": (60, 100), "gnss": (121, 200)}  # of precision, in hundredths: horizontal, vertical
_LARGEST_INT16 = 0x7FFF
_CHANNELS, _NO_RSSI = 18, 255  # of RC_CHANNELS


def _heartbeat(sources: Sources) -> Fields:
    autopilot, personality = sources.autopilot, sources.personality
    flags = int(autopilot.mode.flags)
    if autopilot.mode.intent is Intent.GUIDED and autopilot.setpoints.ever:
        flags |= personality.modes.streamed
    if autopilot.armed:
        flags |= ModeFlag.ARMED
    return {
        "type": int(MavType.QUADROTOR),
        "autopilot": int(personality.autopilot),
        "base_mode": flags,
        "custom_mode": autopilot.mode.number,
        "system_status": int(_status(sources)),
        "mavlink_version": 3,
    }


def _status(sources: Sources) -> MavState:
    autopilot = sources.autopilot
    if not sources.reached(Milestone.RUNNING):
        return sources.personality.boot.starting
    if autopilot.failing or (sources.personality.failsafes.low_is_critical and sources.failsafe.charge_state > 1):
        return MavState.CRITICAL
    if not sources.personality.flight.status_shows_armable:
        return MavState.ACTIVE if autopilot.ground.aloft else MavState.STANDBY
    if autopilot.armed:
        return MavState.ACTIVE
    return MavState.STANDBY if autopilot.can_arm(sources.instruments.t_s) else MavState.UNINIT


def _sys_status(sources: Sources) -> Fields:
    health, instruments = sources.personality.health, sources.instruments
    present, enabled, healthy = health.present, health.enabled, health.healthy
    if not sources.reached(Milestone.FIXED):
        present, enabled = present & ~health.gnss, enabled & ~health.gnss
    if not (sources.reached(Milestone.FIXED) and instruments.has_fix):
        healthy &= ~health.gnss
    if sources.failsafe.charge_state > 1:
        healthy &= ~_BATTERY
    if sources.autopilot.can_arm(instruments.t_s):
        healthy |= PREARM_CHECK
    volt, ampere, share, _ = instruments.battery
    counts = ("drop_rate_comm", "errors_comm", "errors_count1", "errors_count2", "errors_count3", "errors_count4")
    return {
        "onboard_control_sensors_present": present,
        "onboard_control_sensors_enabled": enabled,
        "onboard_control_sensors_health": healthy,
        "load": 0,
        "voltage_battery": min(round(volt * 1000.0), _UNKNOWN),
        "current_battery": min(round(ampere * 100.0), _LARGEST_INT16),
        "battery_remaining": _percent(share),
        **dict.fromkeys(counts, 0),
    }


def _percent(share: float) -> int:
    """A share in whole percent, upwards; 18 % and the error of a sum are 18 %."""
    return math.ceil(round(share * 100.0, 6))


def _battery_status(sources: Sources) -> Fields:
    volt, ampere, share, used_Ah = sources.instruments.battery
    return {
        "id": 0,
        "battery_function": 1,  # all
        "type": 1,  # lithium polymer
        "temperature": _LARGEST_INT16,  # unknown
        "voltages": [min(round(volt * 1000.0), _UNKNOWN)] + [_UNKNOWN] * 9,
        "current_battery": min(round(ampere * 100.0), _LARGEST_INT16),
        "current_consumed": round(used_Ah * 1000.0),
        "energy_consumed": round(sources.instruments.used_J / 100.0),
        "battery_remaining": _percent(share),
        "charge_state": sources.failsafe.charge_state,
    }


def _ekf_status(sources: Sources) -> Fields:
    ratios, row = sources.instruments.airframes.estimator.ratios, sources.instruments.row
    return {
        "flags": _filter_flags(sources),
        "velocity_variance": float(ratios.velocity[row]),
        "pos_horiz_variance": float(ratios.position_horizontal[row]),
        "pos_vert_variance": float(ratios.position_vertical[row]),
        "compass_variance": float(ratios.compass[row]),
        "terrain_alt_variance": 0.0,
    }


def _estimator_status(sources: Sources) -> Fields:
    instruments = sources.instruments
    row, estimator = instruments.row, instruments.airframes.estimator
    ratios, accuracy = estimator.ratios, estimator.accuracy
    return {
        "time_usec": instruments.boot_ms * 1000,
        "flags": _filter_flags(sources),
        "vel_ratio": float(ratios.velocity[row]),
        "pos_horiz_ratio": float(ratios.position_horizontal[row]),
        "pos_vert_ratio": float(ratios.position_vertical[row]),
        "mag_ratio": float(ratios.compass[row]),
        "hagl_ratio": 0.0,
        "tas_ratio": math.nan,
        "pos_horiz_accuracy": float(accuracy.position_horizontal_m[row]),
        "pos_vert_accuracy": float(accuracy.position_vertical_m[row]),
    }


def _filter_flags(sources: Sources) -> int:
    health = sources.personality.health
    return health.ready if sources.autopilot.readiness.ready and sources.instruments.healthy else health.before_ready


def _gps_raw(sources: Sources) -> Fields:
    instruments = sources.instruments
    if not (sources.reached(Milestone.FIXED) and instruments.has_fix):
        zero = dict.fromkeys(("time_usec", "fix_type", "lat", "lon", "alt", "vel", "cog", "satellites_visible"), 0)
        return {**zero, "eph": _UNKNOWN, "epv": _UNKNOWN}
    v_north, v_east = instruments.gnss[3:5].tolist()
    grade = instruments.airframes.grade
    eph, epv = _DILUTION.get(grade.name, _DILUTION["gnss"])
    return {
        "time_usec": instruments.boot_ms * 1000,
        "fix_type": _RTK_FIXED if grade.name == "rtk" and sources.personality.streams.reports_rtk else _FIX_3D,
        **on_earth(instruments.fixed, "lat", "lon", "alt"),
        "eph": eph,
        "epv": epv,
        "vel": min(round(math.hypot(v_north, v_east) * 100.0), _UNKNOWN),
        "cog": round(math.degrees(math.atan2(v_east, v_north)) * 100.0) % 36000,
        "satellites_visible": _SATELLITES,
        "alt_ellipsoid": round(instruments.fixed.alt_amsl_m * 1000.0),
        "h_acc": round(1000.0 * (grade.gnss_horizontal_m + grade.gnss_horizontal_drift_m.sigma)),
        "v_acc": round(1000.0 * (grade.gnss_vertical_m + grade.gnss_vertical_drift_m.sigma)),
        "vel_acc": round(1000.0 * grade.gnss_horizontal_mps),
    }


def _extended_state(sources: Sources) -> Fields:
    state, kind = int(sources.autopilot.mode_actions.landed_state), sources.personality.vtol_state
    return {"vtol_state": kind, "landed_state": state}


def _fence_status(sources: Sources) -> Fields:
    failsafe = sources.failsafe
    return {
        "breach_status": int(failsafe.breach != 0),
        "breach_count": failsafe.breaches & _UNKNOWN,
        "breach_type": int(failsafe.breach),
        "breach_time": round(failsafe.breached_s * 1000.0),
    }


def _rc_channels(sources: Sources) -> Fields | None:
    channels_us = sources.autopilot.channels_us
    if not channels_us:
        return None
    padded = [*channels_us, *[_UNKNOWN] * _CHANNELS][:_CHANNELS]
    values = {f"chan{n}_raw": us for n, us in enumerate(padded, start=1)}
    boot_ms = sources.instruments.boot_ms
    return {"time_boot_ms": boot_ms, "chancount": len(channels_us), "rssi": _NO_RSSI, **values}


BUILDERS: dict[MessageId, Builder] = {
    MessageId.HEARTBEAT: _heartbeat,
    MessageId.SYS_STATUS: _sys_status,
    MessageId.GPS_RAW_INT: _gps_raw,
    MessageId.BATTERY_STATUS: _battery_status,
    MessageId.FENCE_STATUS: _fence_status,
    MessageId.EKF_STATUS_REPORT: _ekf_status,
    MessageId.ESTIMATOR_STATUS: _estimator_status,
    MessageId.EXTENDED_SYS_STATE: _extended_state,
    MessageId.RC_CHANNELS: _rc_channels,
}
