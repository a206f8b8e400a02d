"""Any mission file as one vehicle's mission: `.plan` or `.waypoints`, ours or anybody's, with the fence beside it.

Knows: telling the formats apart, where in the file an item stands, whose home is missing. Does not know: the formats
themselves, what makes a mission good (`check`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from gcs.autopilots.traits import Autopilot
from gcs.errors import FileFormatError, UsageError
from gcs.mavlink import FenceCommand
from gcs.mission.formats.json_lines import line_of
from gcs.mission.formats.qgc_plan import read_plan_file
from gcs.mission.formats.qgc_wpl import HEADER, read_fence, read_rally, read_waypoints
from gcs.mission.geofence import NO_FENCE, Geofence, RallyPoint
from gcs.mission.model import Command, Frame, Home, MissionItem

_FENCE = frozenset(int(c) for c in FenceCommand if c is not FenceCommand.RALLY_POINT)
_LARGEST_BYTES = 64 * 1024 * 1024


@dataclass(frozen=True)
class LoadedMission:
    """One vehicle's mission. `home` is None where the file does not say it (PX4's `.waypoints`)."""

    source: str
    firmware: Autopilot
    home: Home | None
    items: tuple[MissionItem, ...]
    geofence: Geofence = NO_FENCE
    rally: tuple[RallyPoint, ...] = ()
    speed_mps: float | None = None  # where nothing asks for another
    lines: tuple[int, ...] = ()  # of every item, where the format has a line for each
    text: str = ""  # of a `.plan`, to find lines in when somebody asks
    jumps_from: int = 1  # what DO_JUMP calls the first item: in a `.plan` 1, on the wire its seq

    def seq(self, index: int) -> int:
        """The number ground stations show for item `index`: home counts where the autopilot counts it."""
        return index + self.firmware.home_is_item_0

    def line(self, index: int) -> int | None:
        """Where item `index` stands in the file."""
        if self.lines:
            return self.lines[index]
        return line_of(self.text, ("mission", "items", index)) if self.text else None


def load_missions(paths: Sequence[Path], firmware: Autopilot | None = None) -> tuple[LoadedMission, ...]:
    """The missions in these files, one vehicle per file, for `firmware` or what each file says.

    Files that hold a fence or rally points (`.fence`, `.rally`) belong to the mission of the same name, else to all.
    Raises `FileFormatError` with file, line and reason, and `UsageError` where there is no mission.
    """
    missions: list[LoadedMission] = []
    extras: list[tuple[Path, Geofence | tuple[RallyPoint, ...]]] = []
    for path in paths:
        data = _read(path)
        extra = _extra(data, str(path))
        if extra is not None:
            extras.append((path, extra))
        else:
            missions.append(read_mission(data, str(path), firmware))
    if not missions:
        raise UsageError("there is no mission among these files", hint="give .plan or .waypoints files")
    for path, extra in extras:
        same = [Path(m.source).with_suffix("") == path.with_suffix("") for m in missions]
        belongs = same if any(same) else [True] * len(missions)
        missions = [_with(m, extra) if its else m for m, its in zip(missions, belongs, strict=True)]
    return tuple(missions)


def read_mission(data: bytes, source: str, firmware: Autopilot | None = None) -> LoadedMission:
    """The mission in a file's bytes. Raises `FileFormatError` with file, line and reason."""
    if not _is_table(data):
        file = read_plan_file(data, source)
        text = data.decode("utf-8", errors="replace")
        speed = file.hover_speed_mps if file.hover_speed_mps > 0 else None
        return LoadedMission(
            source, firmware or file.firmware, file.home, file.items, file.geofence, file.rally, speed, text=text
        )
    # Without a word from the user, a first row that could be home is home.
    home_first = _begins_with_home(data) if firmware is None else firmware.home_is_item_0
    table = read_waypoints(data, source, home_first=home_first)
    guessed = Autopilot.ARDUPILOT if home_first else Autopilot.PX4
    return LoadedMission(
        source, firmware or guessed, table.home, table.items, lines=table.lines, jumps_from=int(home_first)
    )


def _with(mission: LoadedMission, extra: Geofence | tuple[RallyPoint, ...]) -> LoadedMission:
    if isinstance(extra, Geofence):
        return replace(mission, geofence=extra)
    return replace(mission, rally=extra)


def _extra(data: bytes, source: str) -> Geofence | tuple[RallyPoint, ...] | None:
    """The fence or the rally points in a table that holds nothing else; None for a mission."""
    if not _is_table(data):
        return None
    commands = {item.command for item in read_waypoints(data, source, home_first=False).items}
    if commands & _FENCE:
        return read_fence(data, source)
    return read_rally(data, source) if FenceCommand.RALLY_POINT in commands else None


def _begins_with_home(table: bytes) -> bool:
    """Whether the first row could be home: a waypoint in the absolute frame."""
    rows = (line.split() for line in table.splitlines()[1:] if line.strip() and not line.lstrip().startswith(b"#"))
    first = next(rows, [])
    return first[2:4] in ([b"%d" % Frame.GLOBAL, b"%d" % Command.NAV_WAYPOINT], [b"%d" % Frame.GLOBAL, b"0"])


def _is_table(data: bytes) -> bool:
    return data.removeprefix(b"\xef\xbb\xbf").lstrip().startswith(HEADER.split()[0].encode())


def _read(path: Path) -> bytes:
    try:
        if path.stat().st_size > _LARGEST_BYTES:
            raise FileFormatError(f"{path}: too large for a mission.")
        return path.read_bytes()
    except OSError as error:
        raise FileFormatError(f"{path}: {error.strerror}.", hint="check the path and its rights") from None
