"""How one make of autopilot transfers and keeps missions, fences and rally points, as tables.

Knows: what can differ. Does not know: any autopilot's values (they stand in `sim_bridge.personality`), how they are
used.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from gcs.mavlink import MissionResult, Severity
from gcs.mission.model import MissionItem


class MissionAnswer(NamedTuple):
    """What is said to something unwelcome: a MISSION_ACK, a STATUSTEXT, both, or (as it is here) nothing."""

    result: MissionResult | None = None
    text: str = ""
    severity: Severity = Severity.CRITICAL


SILENCE = MissionAnswer()


@dataclass(frozen=True)
class Keeping:
    """How items of one mission type are taken and kept.

    `frames` are those an item may have, by command: commands that are not in it are UNSUPPORTED, frames that no
    command has are UNSUPPORTED_FRAME. Frames are those of files (0, 2, 3, 10); `told_frames` are those that items
    are read back in.
    """

    capacity: int
    frames: Mapping[int, frozenset[int]]
    told_frames: Mapping[int, int]
    name: str  # in texts
    total: str = ""  # parameter that tells how many there are
    received: str = ""  # STATUSTEXT after a whole transfer
    received_severity: Severity = Severity.INFO
    cleared: str = ""  # STATUSTEXT after a clear, of the same severity
    item_by_item: bool = False  # kept as they come: a transfer that breaks off leaves some new and some old ones
    checks_numbers: bool = True  # refuses NaN and places that are not on Earth
    checks_shapes: bool = False  # refuses a fence whose polygons and circles make no sense, once it has all
    vertices_min: int = 0  # refuses a polygon that says it has fewer, at its first vertex
    only_param1: bool = False  # the other parameters are forgotten
    plain_frame: int | None = None  # what items without a position are kept in; None is what they came in
    land_param4: float | None = None
    whole_centimetres: bool = False
    autocontinue: bool | None = None  # None is what it came with


@dataclass(frozen=True)
class MissionTraits:
    """Transfers. Times in seconds."""

    keeping: Mapping[int, Keeping]  # by mission type
    ask_again_s: float  # for an item that does not come
    give_up_s: float  # without an item
    gave_up: MissionAnswer  # {name} is the mission type's
    int_requests: bool  # asks with MISSION_REQUEST_INT
    home_is_item_0: bool
    as_files: bool  # serves and takes them by MAVLink FTP too
    one_at_a_time: bool  # one transfer in all, downloads included; else one upload for each mission type
    restarts: bool  # a second MISSION_COUNT begins anew; else only the first request is repeated
    any_item_is_life: bool  # an item out of sequence counts as a sign that the station is there
    single_precision: bool  # the degrees of a MISSION_ITEM become integers in single precision
    follows_float: bool  # a MISSION_ITEM is followed by requests for MISSION_ITEM; else by a reproach
    stateless_reads: bool  # items are read without a MISSION_REQUEST_LIST before
    cancellable: bool  # a MISSION_ACK of the station may end the transfer
    clears_all: bool  # mission type 255 stands for all of them
    first_is_current: bool  # item 0 reads back as `current` before anything was flown
    second_station: MissionAnswer
    busy: MissionAnswer  # the same station, in the middle of a transfer
    no_space: MissionAnswer  # {capacity} is the number of items that fit
    wrong_sequence: MissionAnswer
    unasked_item: MissionAnswer
    unknown_item: MissionAnswer  # that is asked for and not there
    refused_item: MissionAnswer  # after a MISSION_ACK with the reason
    float_item: MissionAnswer
    read_while_busy: MissionAnswer
    unknown_type: MissionAnswer  # in a MISSION_COUNT
    unknown_type_read: MissionAnswer | None  # None is MISSION_COUNT 0
    bad_shape: MissionAnswer
    home_outside: MissionAnswer  # said some time after a fence was stored that home is not inside of, or that is none
    home_outside_after_s: float


@dataclass
class Upload:
    """A transfer to this vehicle that is under way."""

    peer_sysid: int
    peer_compid: int
    kind: int
    count: int
    int_requests: bool
    asked_s: float
    heard_s: float
    items: list[MissionItem] = field(default_factory=list)
    reproached: bool = False

    @property
    def seq(self) -> int:
        """The item that is awaited."""
        return len(self.items)


@dataclass
class Download:
    """A transfer from this vehicle that is under way, where the autopilot keeps track of that."""

    peer_sysid: int
    peer_compid: int
    kind: int
    heard_s: float
    seq: int = 0  # the next one expected
