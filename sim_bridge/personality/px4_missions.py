"""Mission transfer and storage of PX4 1.17, as recorded.

There is one transfer in total, downloads included. An upload replaces the old items only when it is complete. Most
numbers are accepted unchecked: NaN altitudes and impossible positions are stored, and read back.
"""

from gcs.mavlink import FENCE_COMMANDS, FenceCommand, MavCommand, MissionResult, MissionType, Severity, WireFrame
from gcs.mission.model import Command, Frame
from sim_bridge.missions.transfer_traits import MissionAnswer, MissionTraits, StorageTraits, fence_params, px4_params

_IN_PLACE = frozenset({int(Frame.GLOBAL), int(Frame.GLOBAL_RELATIVE_ALT)})
_WITHOUT_PLACE = frozenset({int(Frame.MISSION)})
_FLOWN = {
    **dict.fromkeys(map(int, (Command.NAV_WAYPOINT, Command.NAV_LAND, Command.NAV_TAKEOFF)), _IN_PLACE),
    **dict.fromkeys(
        map(int, (Command.NAV_DELAY, Command.DO_CHANGE_SPEED, MavCommand.NAV_RETURN_TO_LAUNCH)), _WITHOUT_PLACE
    ),
}
_WIRE_FRAMES = {
    int(Frame.GLOBAL): int(WireFrame.GLOBAL_INT),
    int(Frame.GLOBAL_RELATIVE_ALT): int(WireFrame.GLOBAL_RELATIVE_ALT_INT),
}

_STORAGE = {
    int(MissionType.MISSION): StorageTraits(
        capacity=10_000,
        frames=_FLOWN,
        read_back_frames=_WIRE_FRAMES,
        name="Mission",
        checks_numbers=False,
        params=px4_params,
    ),
    int(MissionType.FENCE): StorageTraits(
        capacity=250,
        frames=_FLOWN | dict.fromkeys(map(int, FENCE_COMMANDS), _IN_PLACE),  # a waypoint is accepted in a fence
        read_back_frames=dict.fromkeys(_WIRE_FRAMES, int(WireFrame.GLOBAL_INT)),
        name="Fence",
        checks_numbers=False,
        vertices_min=3,
        params=fence_params,
        autocontinue=False,
    ),
    int(MissionType.RALLY): StorageTraits(
        capacity=250,
        frames={int(FenceCommand.RALLY_POINT): _IN_PLACE},
        read_back_frames=_WIRE_FRAMES,
        name="Rally",
        checks_numbers=False,
        params=fence_params,
        wire_frame=True,
    ),
}

# Texts that are also sent as an event end in a tab.
MISSIONS = MissionTraits(
    storage=_STORAGE,
    retry_s=0.25,
    timeout_s=5.0,
    timed_out=MissionAnswer(None, "Operation timeout\t"),
    int_requests=True,
    one_at_a_time=True,
    any_item_resets_timeout=True,
    follows_float=True,
    cancellable=True,
    clears_all=True,
    first_is_current=True,
    second_station=MissionAnswer(MissionResult.ERROR),
    busy=MissionAnswer(MissionResult.ERROR, "WPM: REJ. CMD: Busy\t"),
    no_space=MissionAnswer(MissionResult.NO_SPACE),
    unrequested_item=MissionAnswer(MissionResult.ERROR, "IGN MISSION_ITEM: No transfer\t"),
    unknown_item=MissionAnswer(MissionResult.ERROR),
    refused_item=MissionAnswer(None, "IGN MISSION_ITEM: Invalid item\t"),
    read_while_busy=MissionAnswer(None, "Mission download request ignored, already active\t", Severity.INFO),
    unknown_type=MissionAnswer(MissionResult.NO_SPACE),
    bad_shape=MissionAnswer(MissionResult.ERROR),
    home_outside=MissionAnswer(None, "Geofence invalid, doesn't contain Home position\t"),
    home_outside_after_s=0.5,
    rally_frames=_IN_PLACE,
    rally_refused=MissionAnswer(None, "RTL: unsupported MAV_FRAME\t"),
    rally_from_home_m=10.0,
)
