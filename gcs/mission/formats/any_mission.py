"""Mission files of any format and any program, each with the fence and rally points from the files beside it.

The format is found from the first line that counts (`registry`), because other programs use other suffixes. MAVProxy's
lists of points and QGroundControl's `.mission` files are read too, and never written.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from gcs.autopilots.traits import Autopilot
from gcs.errors import FileFormatError, UsageError
from gcs.mavlink import FENCE_COMMANDS, FenceCommand
from gcs.mission.formats.mission_file import MissionFile
from gcs.mission.formats.point_lists import begins_fence, begins_rally, read_fence_list, read_rally_list
from gcs.mission.formats.qgc_plan import is_mission_json, read_mission_json
from gcs.mission.formats.qgc_wpl import fence_in, rally_in, read_waypoints
from gcs.mission.formats.registry import FORMATS, Content, suffixes_of
from gcs.mission.formats.table_rows import HEADER
from gcs.mission.formats.vendor_quirks import Quirk, first_line
from gcs.mission.geofence import NO_FENCE, Geofence
from gcs.util.bounded_file import MISSION_FILE, SHEETS, as_utf8, read_file

_BEGINNINGS = tuple(row.begins for row in FORMATS if row.content is Content.MISSION and row.begins)
_Extra = tuple[dict[str, Any], tuple[Quirk, ...]]  # a fence or rally points, as fields of a mission, and quirks


def load_missions(paths: Sequence[Path], firmware: Autopilot | None = None) -> tuple[MissionFile, ...]:
    """The missions in these files, one vehicle per file, for `firmware` or the autopilot that each file names.

    A file with a fence or rally points (`.fence`, `.rally`) belongs to the mission of the same name, or else to all.
    Raises `FileFormatError` with file, line and reason, and `UsageError` if no file holds a mission.
    """
    missions: list[MissionFile] = []
    extras: list[tuple[Path, _Extra]] = []
    for path in paths:
        data = _utf8(read_file(path, MISSION_FILE, hint="check the path and its rights"), str(path))
        extra = _extra(data, str(path))
        if extra is not None:
            extras.append((path, extra))
        else:
            missions.append(read_mission(data, str(path), firmware))
    if not missions:
        known = suffixes_of(Content.MISSION)
        raise UsageError("no file holds a mission", hint=f"give files with missions ({known})")
    for path, extra in extras:
        same = [Path(m.source).with_suffix("") == path.with_suffix("") for m in missions]
        belongs = same if any(same) else [True] * len(missions)
        missions = [replace(m, **extra[0]) if its else m for m, its in zip(missions, belongs, strict=True)]
        first = belongs.index(True)  # one warning for a file, not one for each mission
        missions[first] = replace(missions[first], quirks=missions[first].quirks + extra[1])
    return tuple(missions)


def read_mission(data: bytes, source: str, firmware: Autopilot | None = None) -> MissionFile:
    """The mission in a file's bytes, in the format that they begin. Raises `FileFormatError` with its place."""
    if is_mission_json(data):
        return read_mission_json(data, source, firmware)
    start = first_line(data).encode()
    if Path(source).suffix.lower() in SHEETS and not start.startswith((b"{", *_BEGINNINGS)):
        raise FileFormatError(
            f"{source}: is a sheet, not a mission; missions are {suffixes_of(Content.MISSION)} files",
            hint="`gcs new NAME --positions FILE.csv` makes a scenario of a sheet, and `gcs export` its missions",
        )
    if Path(source).suffix.lower() == ".toml":
        text = f"{source}: is a scenario, not a mission; missions are {suffixes_of(Content.MISSION)} files"
        raise FileFormatError(text, hint="`gcs plan` checks a scenario, and `gcs export` writes its missions")
    rows = [row for row in FORMATS if row.content is Content.MISSION and start.startswith(row.begins)]
    mission: MissionFile = max(rows, key=lambda row: len(row.begins)).read(data, source, firmware)
    return mission


def load_fence(path: Path) -> Geofence:
    """The fence in a file of fences, or in a mission. Raises `FileFormatError` for one without a fence."""
    data = _utf8(read_file(path, MISSION_FILE, hint="check the path and its rights"), str(path))
    extra = _extra(data, str(path))
    fence: Geofence = NO_FENCE
    if extra is None:
        fence = read_mission(data, str(path)).geofence
    elif "geofence" in extra[0]:
        fence = extra[0]["geofence"]
    if not (fence.polygons or fence.circles):
        raise FileFormatError(f"{path}: holds no fence.", hint="give a .fence, a .plan, or MAVProxy's list of points")
    return fence


def _utf8(data: bytes, source: str) -> bytes:
    try:
        return as_utf8(data)
    except ValueError as error:
        raise FileFormatError(f"{source}: {error}.") from error


def _extra(data: bytes, source: str) -> _Extra | None:
    """The fence or the rally points in a file that holds nothing else; None for a mission file."""
    start = first_line(data)
    if begins_fence(start):
        fence, quirks = read_fence_list(data, source)
        return {"geofence": fence}, quirks
    if begins_rally(start):
        rally, quirks = read_rally_list(data, source)
        return {"rally": rally}, quirks
    if not start.startswith(HEADER.split()[0]):
        return None
    table = read_waypoints(data, source, home_first=False)
    commands = {item.command for item in table.items}
    if commands & FENCE_COMMANDS:
        return {"geofence": fence_in(table, source)}, table.quirks
    return ({"rally": rally_in(table, source)}, table.quirks) if FenceCommand.RALLY_POINT in commands else None
