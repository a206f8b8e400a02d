"""What PX4 keeps of each item: 1.14 to 1.17.

Items without a position come back as they were sent, all seven numbers. Of items with a position it keeps what the
command uses; headings are stored as radians in single precision. Frames come back as 5 for 0 and 6 for 3.
"""

from __future__ import annotations

from dataclasses import replace

from gcs.autopilots.storage.stored_fields import ItemStorage, StoredAs, StoredItem, published, recorded
from gcs.mavlink import FenceCommand, MavCommand

_ABSENT = published(StoredAs.ZERO)
_EXACT = published(StoredAs.EXACT)
_KEPT = recorded(StoredAs.EXACT)
_HEADING = published(StoredAs.HEADING)
_FLAG = published(StoredAs.FLAG)

_AT_PLACE = StoredItem(
    param1=_ABSENT,
    param2=_ABSENT,
    param3=_ABSENT,
    param4=_ABSENT,
    x=_KEPT,
    y=_KEPT,
    z=_KEPT,
    frame=_KEPT,
    autocontinue=_KEPT,
)
_AS_SENT = StoredItem(_EXACT, _EXACT, _EXACT, _EXACT, _EXACT, _EXACT, _EXACT, _EXACT, _EXACT)
_RECORDED_AS_SENT = replace(_AS_SENT, param1=_KEPT, param2=_KEPT, param3=_KEPT, param4=_KEPT, x=_KEPT, y=_KEPT, z=_KEPT)
_FENCE = replace(_AT_PLACE, param1=_KEPT)

PX4_ITEMS = ItemStorage(
    {
        MavCommand.NAV_TAKEOFF: replace(_AT_PLACE, param4=_HEADING),
        MavCommand.NAV_WAYPOINT: replace(_AT_PLACE, param1=_KEPT, param2=_EXACT, param4=recorded(StoredAs.HEADING)),
        MavCommand.NAV_LAND: replace(_AT_PLACE, param2=published(StoredAs.WHOLE), param4=recorded(StoredAs.HEADING)),
        MavCommand.NAV_LOITER_UNLIM: replace(_AT_PLACE, param3=_EXACT, param4=_HEADING),
        MavCommand.NAV_LOITER_TIME: replace(_AT_PLACE, param1=_EXACT, param2=_FLAG, param3=_EXACT, param4=_FLAG),
        MavCommand.NAV_LOITER_TO_ALT: replace(_AT_PLACE, param1=_FLAG, param2=_EXACT, param4=_FLAG),
        MavCommand.NAV_VTOL_TAKEOFF: replace(_AT_PLACE, param4=_HEADING),
        MavCommand.NAV_RETURN_TO_LAUNCH: _AS_SENT,
        MavCommand.NAV_DELAY: _RECORDED_AS_SENT,
        MavCommand.CONDITION_DELAY: _AS_SENT,
        MavCommand.CONDITION_DISTANCE: _AS_SENT,
        MavCommand.DO_JUMP: replace(_AS_SENT, param1=published(StoredAs.WHOLE), param2=published(StoredAs.WHOLE)),
        MavCommand.DO_CHANGE_SPEED: _RECORDED_AS_SENT,
        MavCommand.DO_SET_HOME: _AS_SENT,
        FenceCommand.RETURN_POINT: replace(_FENCE, param1=_ABSENT),
        FenceCommand.POLYGON_INCLUSION: _FENCE,
        FenceCommand.POLYGON_EXCLUSION: _FENCE,
        FenceCommand.CIRCLE_INCLUSION: _FENCE,
        FenceCommand.CIRCLE_EXCLUSION: _FENCE,
        FenceCommand.RALLY_POINT: _AT_PLACE,
    }
)
