"""What one make of autopilot does its own way, as one table.

Knows: numbers and habits, from recordings of the real thing. Does not know: how they are used.
Another autopilot is another instance, not an `if`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from gcs.link.dialect import Autopilot, Capability, CopterMode
from gcs.link.mission import ARDUPILOT_TIMERS, Timers


class Param(NamedTuple):
    """One parameter; outside `low` to `high` it is stored as it is and used as the nearer bound."""

    name: str
    value: float
    kind: int  # MAV_PARAM_TYPE
    low: float = -math.inf
    high: float = math.inf


@dataclass(frozen=True)
class Personality:
    """Habits of one autopilot."""

    autopilot: Autopilot
    version: int  # AUTOPILOT_VERSION.flight_sw_version: major, minor, patch, type
    capabilities: int
    modes: frozenset[int]  # those that can be set
    not_armable: frozenset[int]
    guided_modes: frozenset[int]  # shown with the GUIDED flag in HEARTBEAT.base_mode
    prearm_after_s: float  # when SYS_STATUS calls the vehicle ready ...
    ready_after_s: float  # ... and when it can arm in fact
    idle_disarm_s: float
    landed_after_s: float  # contact with the ground before it counts as landed
    mission_capacity: int
    mission_timers: Timers
    int_requests: bool  # asks for items with MISSION_REQUEST_INT
    tells_file_frames: bool  # reads items back in frames 0, 3, 10 rather than 5, 6, 11
    params: tuple[Param, ...]


_INT8, _INT16, _INT32, _REAL32 = 2, 4, 6, 9

# ArduCopter 4.5.6 as recorded, except that it is ready after 4 s, not 40: what takes the real one so long is its
# GNSS receiver's start, and no ground station learns anything from waiting for that.
ARDUPILOT = Personality(
    autopilot=Autopilot.ARDUPILOT,
    version=(4 << 24) | (5 << 16) | (6 << 8) | 255,
    capabilities=Capability.MISSION_FLOAT
    | Capability.MISSION_INT
    | Capability.COMMAND_INT
    | Capability.SET_POSITION_TARGET_LOCAL_NED
    | Capability.MAVLINK2,
    modes=frozenset(CopterMode),
    not_armable=frozenset({CopterMode.AUTO, CopterMode.RTL, CopterMode.LAND}),
    guided_modes=frozenset({CopterMode.AUTO, CopterMode.GUIDED, CopterMode.LOITER, CopterMode.RTL}),
    prearm_after_s=2.5,
    ready_after_s=4.0,
    idle_disarm_s=10.0,
    landed_after_s=0.5,
    mission_capacity=650,
    mission_timers=ARDUPILOT_TIMERS,
    int_requests=False,
    tells_file_frames=True,
    params=(
        Param("SYSID_THISMAV", 1.0, _INT16),
        Param("SYSID_MYGCS", 255.0, _INT16),
        Param("FRAME_CLASS", 1.0, _INT8),
        Param("FRAME_TYPE", 1.0, _INT8),
        Param("FS_GCS_ENABLE", 0.0, _INT8),
        Param("GUID_TIMEOUT", 3.0, _REAL32, 0.1, 5.0),
        Param("LAND_SPEED", 50.0, _INT16, 30.0, 200.0),
        Param("MIS_TOTAL", 0.0, _INT16),
        Param("RTL_ALT", 1500.0, _INT32, 30.0, 300_000.0),
        Param("WPNAV_SPEED", 500.0, _REAL32, 20.0, 2000.0),
        Param("WPNAV_SPEED_DN", 150.0, _REAL32, 10.0, 500.0),
        Param("WPNAV_SPEED_UP", 250.0, _REAL32, 10.0, 1000.0),
        Param("WP_YAW_BEHAVIOR", 0.0, _INT8),
    ),
)
