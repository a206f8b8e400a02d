"""Mission transfer and storage of ArduCopter 4.5.6, as recorded.

Each type is transferred by itself, in parallel with the others. Items of missions and rally points are stored one by
one: after an interrupted transfer the new items are followed by old ones. A fence is stored as a whole.
"""

from gcs.mavlink import FENCE_COMMANDS, FenceCommand, MavCommand, MissionResult, MissionType, Severity
from gcs.mission.model import Command, Frame
from sim_bridge.missions.transfer_traits import (
    MissionAnswer,
    MissionTraits,
    StorageTraits,
    ardupilot_params,
    fence_params,
)

_FLOWN = (*Command, MavCommand.NAV_RETURN_TO_LAUNCH)
_ANY_FRAME = frozenset(map(int, Frame))
_FILE_FRAMES = {int(frame): int(frame) for frame in Frame}

_STORAGE = {
    int(MissionType.MISSION): StorageTraits(
        capacity=650,
        frames={int(command): _ANY_FRAME for command in _FLOWN},
        read_back_frames=_FILE_FRAMES,
        name="Mission",
        total="MIS_TOTAL",
        received="Flight plan received",
        item_by_item=True,
        plain_frame=int(Frame.GLOBAL),
        params=ardupilot_params,
        altitude_per_m=100.0,
    ),
    int(MissionType.FENCE): StorageTraits(
        capacity=84,
        frames={int(command): _ANY_FRAME for command in FENCE_COMMANDS},
        read_back_frames=dict.fromkeys(_FILE_FRAMES, int(Frame.GLOBAL)),
        name="Fence",
        total="FENCE_TOTAL",
        received="Fence Indexed OK",
        received_severity=Severity.DEBUG,
        cleared="Fence Indexed OK",
        checks_shapes=True,
        params=fence_params,
        flat=True,
        autocontinue=False,
    ),
    int(MissionType.RALLY): StorageTraits(
        capacity=50,
        frames={int(FenceCommand.RALLY_POINT): _ANY_FRAME},
        read_back_frames=_FILE_FRAMES,
        name="Rally",
        total="RALLY_TOTAL",
        item_by_item=True,
        params=fence_params,
        altitude_per_m=1.0,
        autocontinue=False,
    ),
}

MISSIONS = MissionTraits(
    storage=_STORAGE,
    retry_s=1.0,
    timeout_s=8.0,
    timed_out=MissionAnswer(MissionResult.OPERATION_CANCELLED, "{name} upload timeout", Severity.WARNING),
    home_is_item_0=True,
    as_files=True,
    file_leftovers=True,
    restarts=True,
    single_precision=True,
    stateless_reads=True,
    partial_writes=True,
    second_station=MissionAnswer(MissionResult.DENIED),
    no_space=MissionAnswer(MissionResult.NO_SPACE, "Only {capacity} items are supported", Severity.WARNING),
    wrong_sequence=MissionAnswer(MissionResult.INVALID_SEQUENCE),
    unrequested_item=MissionAnswer(MissionResult.ERROR),
    unknown_item=MissionAnswer(MissionResult.ERROR),
    float_item=MissionAnswer(None, "got MISSION_ITEM; GCS should send MISSION_ITEM_INT", Severity.WARNING),
    read_while_busy=MissionAnswer(MissionResult.DENIED),
    unknown_type=MissionAnswer(MissionResult.UNSUPPORTED),
    unknown_type_read=MissionAnswer(MissionResult.UNSUPPORTED),
    bad_shape=MissionAnswer(MissionResult.ERROR, "Fence validation failed", Severity.WARNING),
    bad_range=MissionAnswer(MissionResult.ERROR, "Flight plan update rejected", Severity.WARNING),
)
