"""What ArduPilot keeps of each item: ArduCopter 4.5 to 4.7.

It stores an item of a mission in 15 bytes: the command, one whole number, and a position or numbers of the command's
own. `autocontinue` is not stored and reads back as true: false would be lost, so it counts as a difference. The item of
a waypoint or a landing does not turn the vehicle, WP_YAW_BEHAVIOR does.
"""

from __future__ import annotations

from dataclasses import replace

from gcs.autopilots.storage.stored_fields import ItemStorage, StoredAs, StoredItem, published, recorded
from gcs.mavlink import FenceCommand, MavCommand

_ABSENT = published(StoredAs.ZERO)
_EXACT = published(StoredAs.EXACT)
_WHOLE = published(StoredAs.WHOLE)

# In a position: x, y and the frame are kept (3 for 6, 0 for 5 and 2), the altitude is cut towards zero.
_AT_PLACE = StoredItem(
    param1=_ABSENT,
    param2=_ABSENT,
    param3=_ABSENT,
    param4=_ABSENT,
    x=recorded(StoredAs.EXACT),
    y=recorded(StoredAs.EXACT),
    z=recorded(StoredAs.CENTIMETRES),
    frame=recorded(StoredAs.EXACT),
    autocontinue=_EXACT,
)
_WITHOUT_PLACE = replace(_AT_PLACE, x=_ABSENT, y=_ABSENT, z=_ABSENT)
_WAYPOINT = replace(_AT_PLACE, param1=recorded(StoredAs.WHOLE), param4=recorded(StoredAs.ZERO))
# Fences are areas: no altitude, and frame 0 whatever was sent.
_FENCE = replace(_AT_PLACE, param1=recorded(StoredAs.EXACT), z=_ABSENT, frame=_ABSENT)

ARDUPILOT_ITEMS = ItemStorage(
    {
        MavCommand.NAV_TAKEOFF: replace(_AT_PLACE, param1=_WHOLE, param4=recorded(StoredAs.ZERO)),  # pitch of planes
        MavCommand.NAV_WAYPOINT: _WAYPOINT,  # the hold in whole seconds
        MavCommand.NAV_SPLINE_WAYPOINT: replace(_AT_PLACE, param1=_WHOLE),
        MavCommand.NAV_LAND: replace(_AT_PLACE, param1=_WHOLE, param4=recorded(StoredAs.SIGN)),
        MavCommand.NAV_LOITER_UNLIM: replace(_AT_PLACE, param3=_WHOLE),
        MavCommand.NAV_LOITER_TIME: replace(
            _AT_PLACE, param1=_WHOLE, param3=published(StoredAs.SIGN), param4=published(StoredAs.FLAG)
        ),
        # Turns below 1 in steps of 1/256, radii above 255 m in steps of 10 m: others have to be whole.
        MavCommand.NAV_LOITER_TURNS: replace(_AT_PLACE, param1=_WHOLE, param3=_WHOLE, param4=published(StoredAs.FLAG)),
        MavCommand.NAV_LOITER_TO_ALT: replace(_AT_PLACE, param2=_WHOLE, param4=published(StoredAs.FLAG)),
        MavCommand.NAV_RETURN_TO_LAUNCH: _WITHOUT_PLACE,
        MavCommand.NAV_DELAY: replace(
            _WITHOUT_PLACE, param1=recorded(StoredAs.EXACT), param2=_WHOLE, param3=_WHOLE, param4=_WHOLE
        ),
        MavCommand.CONDITION_DELAY: replace(_WITHOUT_PLACE, param1=_EXACT),
        MavCommand.CONDITION_DISTANCE: replace(_WITHOUT_PLACE, param1=_EXACT),
        MavCommand.CONDITION_YAW: replace(_WITHOUT_PLACE, param1=_EXACT, param2=_EXACT, param3=_WHOLE, param4=_WHOLE),
        MavCommand.DO_JUMP: replace(_WITHOUT_PLACE, param1=_WHOLE, param2=_WHOLE),
        MavCommand.DO_CHANGE_SPEED: replace(
            _WITHOUT_PLACE, param1=_WHOLE, param2=recorded(StoredAs.EXACT), param3=recorded(StoredAs.EXACT)
        ),
        MavCommand.DO_SET_HOME: replace(_AT_PLACE, param1=_WHOLE),
        MavCommand.DO_SET_ROI: replace(_AT_PLACE, param1=_WHOLE),
        FenceCommand.RETURN_POINT: replace(_FENCE, param1=_ABSENT),
        FenceCommand.POLYGON_INCLUSION: replace(_FENCE, param1=_WHOLE),
        FenceCommand.POLYGON_EXCLUSION: replace(_FENCE, param1=_WHOLE),
        FenceCommand.CIRCLE_INCLUSION: _FENCE,
        FenceCommand.CIRCLE_EXCLUSION: _FENCE,
        FenceCommand.RALLY_POINT: replace(_AT_PLACE, z=recorded(StoredAs.WHOLE)),  # altitudes in whole metres
    }
)
