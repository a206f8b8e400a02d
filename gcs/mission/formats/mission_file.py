"""One vehicle's mission as a file of any format holds it: what mission writers are given and mission readers return."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from gcs.autopilots.traits import Autopilot
from gcs.mission.formats.foreign.oddities import Oddity
from gcs.mission.formats.json_lines import line_of
from gcs.mission.geofence import NO_FENCE, Geofence, RallyPoint
from gcs.mission.model import Home, MissionItem


@dataclass(frozen=True)
class MissionFile:
    """The mission of one vehicle. `home` is None if the file has no home (PX4's `.waypoints`)."""

    source: str
    firmware: Autopilot
    home: Home | None
    items: tuple[MissionItem, ...]
    geofence: Geofence = NO_FENCE
    rally: tuple[RallyPoint, ...] = ()
    speed_mps: float | None = None  # until an item changes it
    lines: tuple[int, ...] = ()  # of every item, where the format has a line for each
    text: str = ""  # of a JSON file, in which `line` finds the lines
    items_path: tuple[str, ...] = ("mission", "items")  # of the items in it
    jumps_from: int = 1  # the number DO_JUMP gives the first item: 1 in a `.plan`, its seq on the wire
    parameters: Mapping[str, float] = field(default_factory=dict, compare=False)  # that the vehicle has, if known
    oddities: tuple[Oddity, ...] = ()  # what was read although it is not as the format has it

    def seq(self, index: int) -> int:
        """The number ground stations show for item `index`: home counts where the autopilot counts it."""
        return index + self.firmware.home_is_item_0

    def line(self, index: int) -> int | None:
        """The line of the file on which item `index` stands."""
        if self.lines:
            return self.lines[index]
        return line_of(self.text, (*self.items_path, index)) if self.text else None
