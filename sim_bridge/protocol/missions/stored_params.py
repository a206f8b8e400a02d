"""Which parameters of an item each autopilot stores, and as what: recorded, the rest from their published sources."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from gcs.mavlink import FenceCommand, MavCommand
from gcs.mission.model import MissionItem
from sim_bridge.protocol.missions.transfer_traits import Params

_FIRST_ONLY = frozenset(FenceCommand) - {FenceCommand.RETURN_POINT, FenceCommand.RALLY_POINT}


def ardupilot_params(item: MissionItem) -> Params:
    """Return the parameters that ArduPilot reports: whole numbers, and no heading of a position."""
    stored = _ARDUPILOT.get(item.command)
    return item.params if stored is None else stored(*item.params)


def px4_params(item: MissionItem) -> Params:
    """Return the parameters that PX4 reports: those that a command with a position uses, headings rounded."""
    stored = _PX4.get(item.command)
    return item.params if stored is None else stored(*item.params)


def fence_params(item: MissionItem) -> Params:
    """Return the parameters of fences and rally points: vertices, or a radius."""
    return (item.params[0] if item.command in _FIRST_ONLY else 0.0), 0.0, 0.0, 0.0


def _whole(value: float) -> float:
    return float(math.trunc(value)) if math.isfinite(value) else 0.0


def _sign(value: float) -> float:
    return -1.0 if value < 0.0 else 1.0


def _turned(heading_deg: float) -> float:
    """The heading after its way to radians and back, in single precision."""
    half, full = np.float32(math.pi), np.float32(2.0 * math.pi)
    with np.errstate(over="ignore"):
        rad = np.float32(heading_deg) * (half / np.float32(180.0))
        if not 0.0 <= rad < full and math.isfinite(rad):
            rad = np.float32(rad - full * np.floor(rad / full))
        return float(rad * (np.float32(180.0) / half))


_Stored = dict[int, Callable[[float, float, float, float], Params]]
_ARDUPILOT: _Stored = {
    **dict.fromkeys(
        map(int, (MavCommand.NAV_TAKEOFF, MavCommand.NAV_WAYPOINT, MavCommand.NAV_SPLINE_WAYPOINT)),
        lambda p1, p2, p3, p4: (_whole(p1), 0.0, 0.0, 0.0),
    ),
    int(MavCommand.NAV_LAND): lambda p1, p2, p3, p4: (_whole(p1), 0.0, 0.0, _sign(p4)),
    int(MavCommand.NAV_LOITER_UNLIM): lambda p1, p2, p3, p4: (0.0, 0.0, _whole(p3), 0.0),
    int(MavCommand.NAV_LOITER_TIME): lambda p1, p2, p3, p4: (_whole(p1), 0.0, _sign(p3), float(p4 > 0.0)),
    int(MavCommand.NAV_RETURN_TO_LAUNCH): lambda p1, p2, p3, p4: (0.0, 0.0, 0.0, 0.0),
    int(MavCommand.NAV_DELAY): lambda p1, p2, p3, p4: (p1, _whole(p2), _whole(p3), _whole(p4)),
    int(MavCommand.DO_CHANGE_SPEED): lambda p1, p2, p3, p4: (_whole(p1), p2, p3, 0.0),
}
_PX4: _Stored = {
    int(MavCommand.NAV_WAYPOINT): lambda p1, p2, p3, p4: (p1, p2, 0.0, _turned(p4)),
    int(MavCommand.NAV_LAND): lambda p1, p2, p3, p4: (0.0, _whole(p2), 0.0, _turned(p4)),
    int(MavCommand.NAV_TAKEOFF): lambda p1, p2, p3, p4: (0.0, 0.0, 0.0, _turned(p4)),
    int(MavCommand.NAV_LOITER_UNLIM): lambda p1, p2, p3, p4: (0.0, 0.0, p3, _turned(p4)),
}
