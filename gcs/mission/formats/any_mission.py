"""Mission files of any format and any program, each with the fence and rally points from the files beside it.

The format is found from the first bytes (`registry`), because other programs use other suffixes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from gcs.autopilots.traits import Autopilot
from gcs.errors import FileFormatError, UsageError
from gcs.mavlink import FENCE_COMMANDS, FenceCommand
from gcs.mission.formats.mission_file import MissionFile
from gcs.mission.formats.qgc_wpl import HEADER, read_fence, read_rally, read_waypoints
from gcs.mission.formats.registry import FORMATS, Content, suffixes_of
from gcs.mission.geofence import Geofence, RallyPoint

_LARGEST_BYTES = 64 * 1024 * 1024


def load_missions(paths: Sequence[Path], firmware: Autopilot | None = None) -> tuple[MissionFile, ...]:
    """The missions in these files, one vehicle per file, for `firmware` or the autopilot that each file names.

    A file with a fence or rally points (`.fence`, `.rally`) belongs to the mission of the same name, or else to all.
    Raises `FileFormatError` with file, line and reason, and `UsageError` if no file holds a mission.
    """
    missions: list[MissionFile] = []
    extras: list[tuple[Path, Geofence | tuple[RallyPoint, ...]]] = []
    for path in paths:
        data = _read(path)
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
        missions = [_with(m, extra) if its else m for m, its in zip(missions, belongs, strict=True)]
    return tuple(missions)


def read_mission(data: bytes, source: str, firmware: Autopilot | None = None) -> MissionFile:
    """The mission in a file's bytes, in the format that they begin. Raises `FileFormatError` with its place."""
    start = _start(data)
    rows = [row for row in FORMATS if row.content is Content.MISSION and start.startswith(row.begins)]
    mission: MissionFile = max(rows, key=lambda row: len(row.begins)).read(data, source, firmware)
    return mission


def _with(mission: MissionFile, extra: Geofence | tuple[RallyPoint, ...]) -> MissionFile:
    if isinstance(extra, Geofence):
        return replace(mission, geofence=extra)
    return replace(mission, rally=extra)


def _extra(data: bytes, source: str) -> Geofence | tuple[RallyPoint, ...] | None:
    """The fence or the rally points in a table that holds nothing else; None for a mission file."""
    if not _is_table(data):
        return None
    commands = {item.command for item in read_waypoints(data, source, home_first=False).items}
    if commands & FENCE_COMMANDS:
        return read_fence(data, source)
    return read_rally(data, source) if FenceCommand.RALLY_POINT in commands else None


def _is_table(data: bytes) -> bool:
    return _start(data).startswith(HEADER.split()[0].encode())


def _start(data: bytes) -> bytes:
    """A file's bytes without byte order mark and leading blanks."""
    return data.removeprefix(b"\xef\xbb\xbf").lstrip()


def _read(path: Path) -> bytes:
    try:
        if path.stat().st_size > _LARGEST_BYTES:
            raise FileFormatError(f"{path}: larger than {_LARGEST_BYTES // 1024**2} MiB, too large for a mission.")
        return path.read_bytes()
    except OSError as error:
        raise FileFormatError(f"{path}: {error.strerror}.", hint="check the path and its rights") from None
