"""One folder with everything a plan turns into: missions for ground stations, setpoints, and an index.

Knows: which files there are, and how to replace a folder whole. Does not know: the formats' contents, planning.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import shutil
import tempfile
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from gcs.errors import FileFormatError, UsageError
from gcs.mission.build import build_missions, timed_legs
from gcs.mission.firmware import Firmware
from gcs.mission.model import Command, VehicleMission
from gcs.mission.planfile import PlanFile, write_plan_file
from gcs.mission.setpoints import build_stream, write_setpoints
from gcs.mission.simplify import Deviation
from gcs.mission.smooth import SmoothPath, smoothed
from gcs.mission.waypoints import WaypointFile, write_waypoints

if TYPE_CHECKING:
    from gcs.plan.trajectory import Plan

INDEX = "index.json"
SETPOINTS = "setpoints.csv"
_FORMAT = "skein-export"
_VERSION = 1


@dataclass(frozen=True)
class Smoothing:
    """How the setpoints differ from the plan, where they were smoothed."""

    knots_every_s: float
    deviation_m: float
    yaw_deviation_deg: float
    clearance_min_m: float


@dataclass(frozen=True)
class ExportIndex:
    """What an export holds, and how faithfully."""

    scenario: str
    plan_hash: str
    firmware: Firmware
    setpoint_rate_hz: float
    waypoints: int  # positions with a planned time, per vehicle
    items: int  # mission items of the longest mission, home not counted
    deviation: Deviation
    sha256: dict[str, str]  # by file name
    smoothing: Smoothing | None = None  # of the setpoints; waypoints are always the plan's


def export(
    plan: Plan, folder: Path | str, *, setpoint_rate_hz: float | None = None, smooth_m: float | None = None
) -> ExportIndex:
    """Write `.waypoints` and `.plan` per vehicle, setpoints.csv and index.json into `folder`.

    All is written beside and swapped in at the end: the folder holds the old export or the new one. The rate is the
    scenario's unless given; `smooth_m` smooths the setpoints within so many metres of the plan. Raises `UsageError`
    when the folder holds anything that no export made, `VerificationError` when the smoothed path would break a limit,
    and OSError as the file system does.
    """
    folder = Path(folder).resolve()
    _refuse_foreign(folder)
    rate_hz = setpoint_rate_hz or plan.scenario.mission.setpoint_rate_hz
    firmware = Firmware.named(plan.scenario.mission.autopilot)
    legs = timed_legs(plan)
    missions = build_missions(plan, legs)
    path = None if smooth_m is None else smoothed(plan, smooth_m)
    files = {SETPOINTS: write_setpoints(build_stream(plan, rate_hz, path))}
    for mission in missions:
        files |= _mission_files(mission, firmware)
    index = ExportIndex(
        plan.scenario.name,
        plan.hash,
        firmware,
        rate_hz,
        len(legs.t_s),
        max(len(m.items) for m in missions),
        legs.error,
        {name: hashlib.sha256(text.encode()).hexdigest() for name, text in sorted(files.items())},
        None if path is None else _smoothing(path),
    )
    document = {"format": _FORMAT, "version": _VERSION} | asdict(index) | {"firmware": firmware.name.lower()}
    if index.smoothing is None:
        del document["smoothing"]
    _swap_in(folder, files | {INDEX: json.dumps(document, indent=2) + "\n"})
    return index


def _smoothing(path: SmoothPath) -> Smoothing:
    yaw_deg = math.degrees(path.yaw_deviation_rad)
    return Smoothing(path.knots_every_s, path.deviation_m, yaw_deg, path.clearance_min_m)


def mission_name(sysid: int) -> str:
    """File name, without suffix, of one vehicle's mission."""
    return f"uav{sysid}"


def _mission_files(mission: VehicleMission, firmware: Firmware) -> dict[str, str]:
    name = mission_name(mission.sysid)
    speeds = [i.params[1] for i in mission.items if i.command == Command.DO_CHANGE_SPEED]
    speed_mps = round(sum(speeds) / len(speeds), 1)
    home = mission.home if firmware.home_is_item_0 else None
    return {
        f"{name}.waypoints": write_waypoints(WaypointFile(home, mission.items)),
        f"{name}.plan": write_plan_file(PlanFile(firmware, mission.home, mission.items, speed_mps, speed_mps)),
    }


def _refuse_foreign(folder: Path) -> None:
    """Only what an export made may be replaced."""
    if not folder.exists():
        return
    if not folder.is_dir():
        raise UsageError(f"{folder} is a file; an export needs a folder.")
    names = {p.name for p in folder.iterdir()}
    if not names:
        return
    known: set[str] = set()
    if INDEX in names:
        known = {INDEX, *_listed(folder / INDEX)}
    if foreign := sorted(names - known):
        raise UsageError(
            f"{folder} holds files that no export made: {', '.join(foreign[:5])}.",
            hint="choose another folder, or move them away",
        )


def _listed(path: Path) -> list[str]:
    try:
        document = json.loads(path.read_bytes())
        if document["format"] != _FORMAT:
            raise ValueError(f"format is {document['format']!r}")
        return list(document["sha256"])
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise FileFormatError(f"{path}: not the index of an export.", hint="choose another folder") from error


def _swap_in(folder: Path, files: dict[str, str]) -> None:
    folder.parent.mkdir(parents=True, exist_ok=True)
    beside = Path(tempfile.mkdtemp(prefix=f".{folder.name}.", suffix=".part", dir=folder.parent))
    try:
        new, old = beside / "new", beside / "old"
        new.mkdir()
        for name, text in files.items():
            with (new / name).open("wb") as file:
                file.write(text.encode())
                file.flush()
                os.fsync(file.fileno())
        if folder.exists():
            folder.rename(old)
        try:
            new.rename(folder)
        except OSError:
            if old.exists():
                old.rename(folder)
            raise
    finally:
        shutil.rmtree(beside, ignore_errors=True)
