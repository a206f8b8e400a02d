"""Traits of mission transfer and storage that differ between autopilots.

Which parameters of an item are stored, and as what, is recorded; the rest is from the published sources.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from gcs.mavlink import FenceCommand, MavCommand, MissionResult, Severity
from gcs.mission.model import MissionItem

Params = tuple[float, float, float, float]
_FIRST_ONLY = frozenset(FenceCommand) - {FenceCommand.RETURN_POINT, FenceCommand.RALLY_POINT}


class MissionAnswer(NamedTuple):
    """The answer to an irregular message: a MISSION_ACK, a STATUSTEXT, both, or (by default) none."""

    result: MissionResult | None = None
    text: str = ""
    severity: Severity = Severity.CRITICAL


SILENCE = MissionAnswer()


@dataclass(frozen=True)
class StorageTraits:
    """How items of one mission type are accepted and stored.

    `frames` are the permitted frames by command. A command that is not in it is UNSUPPORTED; a frame that no command
    has is UNSUPPORTED_FRAME. Frames are those of files (0, 2, 3, 10). `read_back_frames` are those of downloads.
    """

    capacity: int
    frames: Mapping[int, frozenset[int]]
    read_back_frames: Mapping[int, int]
    name: str  # in STATUSTEXTs
    total: str = ""  # parameter with the number of items
    received: str = ""  # STATUSTEXT after a complete transfer
    received_severity: Severity = Severity.INFO
    cleared: str = ""  # STATUSTEXT after a clear, of the same severity
    item_by_item: bool = False  # stored as they arrive: an interrupted transfer leaves some new and some old ones
    checks_numbers: bool = True  # refuses NaN and positions that are not on Earth
    checks_shapes: bool = False  # refuses an invalid fence, when it is complete
    vertices_min: int = 0  # refuses a polygon with fewer, at its first vertex
    params: Callable[[MissionItem], Params] | None = None  # parameters as stored; None: as uploaded
    plain_frame: int | None = None  # frame of stored items without a position; None: as uploaded
    wire_frame: bool = False  # the frame of the message is stored: 3 is not 6
    altitude_per_m: float | None = None  # altitudes are cut to whole multiples of 1 / this; None: single precision
    flat: bool = False  # no altitude is stored
    autocontinue: bool | None = None  # None: as uploaded


@dataclass(frozen=True, kw_only=True)
class MissionTraits:
    """Mission transfers. Times in seconds."""

    storage: Mapping[int, StorageTraits]  # by mission type
    retry_s: float  # until a missing item is requested again
    timeout_s: float  # without any item
    timed_out: MissionAnswer  # {name} is that of the mission type
    int_requests: bool = False  # requests with MISSION_REQUEST_INT
    home_is_item_0: bool = False
    as_files: bool = False  # also transfers them by MAVLink FTP
    file_leftovers: bool = False  # a file's items without a position have that of the item before them
    one_at_a_time: bool = False  # one transfer in total, downloads included; else one upload per mission type
    restarts: bool = False  # a second MISSION_COUNT restarts the upload; else only the first request is repeated
    any_item_resets_timeout: bool = False  # an item out of sequence restarts the timeout too
    single_precision: bool = False  # the degrees of a MISSION_ITEM become integers in single precision
    follows_float: bool = False  # after a MISSION_ITEM it requests MISSION_ITEM; else it sends a warning
    stateless_reads: bool = False  # items can be read without a MISSION_REQUEST_LIST first
    cancellable: bool = False  # a MISSION_ACK of the ground station can end the transfer
    clears_all: bool = False  # mission type 255 clears all types
    partial_writes: bool = False  # MISSION_WRITE_PARTIAL_LIST replaces single items; else it gets no answer
    first_is_current: bool = False  # item 0 reads back as `current` before the first flight
    second_station: MissionAnswer
    busy: MissionAnswer = SILENCE  # to the same ground station, during a transfer
    no_space: MissionAnswer  # {capacity} is the number of items that fit
    wrong_sequence: MissionAnswer = SILENCE
    unrequested_item: MissionAnswer
    unknown_item: MissionAnswer  # a requested item that does not exist
    refused_item: MissionAnswer = SILENCE  # after a MISSION_ACK with the reason
    float_item: MissionAnswer = SILENCE
    read_while_busy: MissionAnswer
    unknown_type: MissionAnswer  # in a MISSION_COUNT
    unknown_type_read: MissionAnswer | None = None  # None: MISSION_COUNT 0
    bad_shape: MissionAnswer
    bad_range: MissionAnswer = SILENCE  # of a partial write
    home_outside: MissionAnswer = SILENCE  # some time after a fence that is invalid or does not contain home
    home_outside_after_s: float = 0.0
    rally_frames: frozenset[int] | None = None  # of points that it returns to; None: of any
    rally_refused: MissionAnswer = SILENCE  # sent again and again while there are points of other frames
    rally_refused_every_s: float = 2.0
    rally_from_home_m: float = 0.0  # nearer points are not looked at


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
