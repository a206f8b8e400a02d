"""How ArduCopter 4.5.6 transfers and keeps missions, fences and rally points, as recorded.

Knows: numbers and habits. Does not know: how they are used.

Each type is transferred by itself, side by side with the others. Items of missions and rally points are kept as they
come: after a transfer that breaks off, new items are followed by the old ones behind them. A fence is kept as a whole.
"""

from __future__ import annotations

from gcs.mavlink import FenceCommand, MavCommand, MissionResult, MissionType, Severity
from gcs.mission.model import Command, Frame
from sim_bridge.protocol.missions.transfer_traits import SILENCE, Keeping, MissionAnswer, MissionTraits

_FLOWN = (*Command, MavCommand.NAV_RETURN_TO_LAUNCH)
_RALLY_POINT = 5100
_ANY_FRAME = frozenset(map(int, Frame))
_FILE_FRAMES = {int(frame): int(frame) for frame in Frame}

_KEEPING = {
    int(MissionType.MISSION): Keeping(
        capacity=650,
        frames={int(command): _ANY_FRAME for command in _FLOWN},
        told_frames=_FILE_FRAMES,
        name="Mission",
        total="MIS_TOTAL",
        received="Flight plan received",
        item_by_item=True,
        plain_frame=int(Frame.GLOBAL),
        land_param4=1.0,
        whole_centimetres=True,
    ),
    int(MissionType.FENCE): Keeping(
        capacity=84,
        frames={int(command): _ANY_FRAME for command in FenceCommand},
        told_frames=dict.fromkeys(_FILE_FRAMES, int(Frame.GLOBAL)),
        name="Fence",
        total="FENCE_TOTAL",
        received="Fence Indexed OK",
        received_severity=Severity.DEBUG,
        cleared="Fence Indexed OK",
        checks_shapes=True,
        only_param1=True,
        autocontinue=False,
    ),
    int(MissionType.RALLY): Keeping(
        capacity=50,
        frames={_RALLY_POINT: _ANY_FRAME},
        told_frames=_FILE_FRAMES,
        name="Rally",
        total="RALLY_TOTAL",
        item_by_item=True,
        autocontinue=False,
    ),
}

MISSIONS = MissionTraits(
    keeping=_KEEPING,
    ask_again_s=1.0,
    give_up_s=8.0,
    gave_up=MissionAnswer(MissionResult.OPERATION_CANCELLED, "{name} upload timeout", Severity.WARNING),
    int_requests=False,
    home_is_item_0=True,
    as_files=True,
    one_at_a_time=False,
    restarts=True,
    any_item_is_life=False,
    single_precision=True,
    follows_float=False,
    stateless_reads=True,
    cancellable=False,
    clears_all=False,
    first_is_current=False,
    second_station=MissionAnswer(MissionResult.DENIED),
    busy=SILENCE,
    no_space=MissionAnswer(MissionResult.NO_SPACE, "Only {capacity} items are supported", Severity.WARNING),
    wrong_sequence=MissionAnswer(MissionResult.INVALID_SEQUENCE),
    unasked_item=MissionAnswer(MissionResult.ERROR),
    unknown_item=MissionAnswer(MissionResult.ERROR),
    refused_item=SILENCE,
    float_item=MissionAnswer(None, "got MISSION_ITEM; GCS should send MISSION_ITEM_INT", Severity.WARNING),
    read_while_busy=MissionAnswer(MissionResult.DENIED),
    unknown_type=MissionAnswer(MissionResult.UNSUPPORTED),
    unknown_type_read=MissionAnswer(MissionResult.UNSUPPORTED),
    bad_shape=MissionAnswer(MissionResult.ERROR, "Fence validation failed", Severity.WARNING),
    home_outside=SILENCE,
    home_outside_after_s=0.0,
)
