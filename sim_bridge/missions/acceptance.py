"""Acceptance and storage of mission items."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gcs.autopilots.mission_commands import has_position
from gcs.link.wire.message import Message
from gcs.mavlink import MissionResult
from gcs.mission.model import Command, Frame, MissionItem
from sim_bridge.missions.fence import POLYGONS
from sim_bridge.missions.transfer_traits import StorageTraits

_HALF_CIRCLE_degE7 = 1_800_000_000
_PARAMS = (
    MissionResult.INVALID_PARAM1,
    MissionResult.INVALID_PARAM2,
    MissionResult.INVALID_PARAM3,
    MissionResult.INVALID_PARAM4,
)
# Parameter 4, a heading, may be NaN. ArduPilot's `sanity_check_params` has this list.
_FREE_HEADING = frozenset(
    map(
        int,
        (
            *(Command.NAV_WAYPOINT, Command.NAV_TAKEOFF, Command.NAV_LAND),
            *(Command.NAV_VTOL_TAKEOFF, Command.NAV_VTOL_LAND),
        ),
    )
)


def item_result(item: MissionItem, storage: StorageTraits) -> MissionResult:
    """Return ACCEPTED, or why the vehicle refuses the item."""
    frames = storage.frames.get(item.command)
    if frames is None:
        return MissionResult.UNSUPPORTED
    if item.frame not in frames:
        known = any(item.frame in others for others in storage.frames.values())
        return MissionResult.UNSUPPORTED if known else MissionResult.UNSUPPORTED_FRAME
    return _numbers(item) if storage.checks_numbers else MissionResult.ACCEPTED


def too_few_vertices(item: MissionItem, storage: StorageTraits) -> bool:
    """Whether the item belongs to a polygon with fewer vertices than this autopilot accepts."""
    return item.command in POLYGONS and not item.params[0] >= storage.vertices_min


def as_stored(item: MissionItem, storage: StorageTraits, wire_frame: int | None = None) -> MissionItem:
    """Return the item as the vehicle stores it. `wire_frame` is the frame of its message."""
    params, frame, alt_m = item.params, item.frame, item.alt_m
    if storage.params is not None:
        params = storage.params(item)
    if storage.wire_frame and wire_frame is not None:
        frame = wire_frame
    if storage.plain_frame is not None and not has_position(item.command):
        frame = storage.plain_frame
    elif storage.flat:
        alt_m = 0.0
    elif storage.altitude_per_m is not None:
        alt_m = _cut(alt_m, storage.altitude_per_m)
    autocontinue = item.autocontinue if storage.autocontinue is None else storage.autocontinue
    return replace(item, params=params, frame=frame, alt_m=alt_m, autocontinue=autocontinue)


def as_reported_m(alt_m: float, per_m: float) -> float:
    """Return an altitude that is stored as a whole number of 1 / `per_m` m, as it is reported: in single precision."""
    return float(np.float32(round(alt_m * per_m)) * np.float32(1.0 / per_m))


def flyable(items: Sequence[MissionItem]) -> bool:
    """Whether all numbers of a mission are finite and all positions are on Earth; not every autopilot checks this.

    A heading (parameter 4) may be NaN, which means any.
    """
    return all(
        all(map(math.isfinite, (*item.params[:3], item.alt_m)))
        and not math.isinf(item.params[3])
        and _place(item) == MissionResult.ACCEPTED
        for item in items
    )


def in_single_precision(message: Message) -> Message:
    """Return a MISSION_ITEM with its degrees rounded to single precision; other messages unchanged."""
    f = message.fields
    if message.name != "MISSION_ITEM" or not (math.isfinite(f["x"]) and math.isfinite(f["y"])):
        return message
    with np.errstate(over="ignore"):
        scaled = {key: float(np.float32(f[key]) * np.float32(1e7)) / 1e7 for key in ("x", "y")}
    return Message(message.name, {**f, **scaled}, *message.source)


def _numbers(item: MissionItem) -> MissionResult:
    for number, (value, result) in enumerate(zip(item.params, _PARAMS, strict=True), start=1):
        if math.isnan(value) and not (number == len(_PARAMS) and item.command in _FREE_HEADING):
            return result
    return _place(item)


def _place(item: MissionItem) -> MissionResult:
    if not has_position(item.command) or item.frame == Frame.MISSION:
        return MissionResult.ACCEPTED
    if not math.isfinite(item.alt_m):
        return MissionResult.INVALID_PARAM7
    if abs(item.lat_degE7) > _HALF_CIRCLE_degE7 // 2:
        return MissionResult.INVALID_PARAM5_X
    if abs(item.lon_degE7) > _HALF_CIRCLE_degE7:
        return MissionResult.INVALID_PARAM6_Y
    return MissionResult.ACCEPTED


def _cut(alt_m: float, per_m: float) -> float:
    """Return a multiple of 1 / `per_m` m, towards zero, computed in single precision as the originals do."""
    with np.errstate(over="ignore"):
        return float(np.trunc(np.float32(alt_m) * np.float32(per_m))) / per_m
