"""The formats of trajectories that `gcs prove` reads: one row for each. A new format is a reader and a row here."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.interpolate import PPoly

from gcs.errors import FileFormatError, UsageError
from gcs.frames import geodetic_to_ned
from gcs.mission.formats.tables.setpoint_table import read_setpoints
from gcs.mission.model import SetpointStream
from gcs.mission.proving.csv_rows import TrackFile
from gcs.mission.proving.mission_tracks import is_mission, read_missions
from gcs.mission.proving.polynomial_pieces import are_pieces, read_pieces
from gcs.mission.proving.skyc_show import is_show, read_show
from gcs.mission.proving.timed_samples import are_samples, read_samples, through
from gcs.mission.proving.track import PolynomialTrack
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.values.si import local_origin
from gcs.util.bounded_file import TRACK_FILE, read_file

_ORIGINS_M = 1e-3
_Read = tuple[list[PolynomialTrack], list[str]]  # the tracks of a file, and what was left out


@dataclass(frozen=True)
class TrackFormat:
    """One format: what it holds, whether a file is of it, and the tracks of its files with what was left out.

    Files of one format are read at once, with the scenario that says where they are, if there is one.
    """

    name: str
    purpose: str
    is_it: Callable[[TrackFile], bool]
    read: Callable[[Sequence[TrackFile], Scenario | None], list[_Read]]


@dataclass(frozen=True)
class ReadTracks:
    """The tracks of files, and a line for each file with its format, its tracks and what was left out."""

    tracks: tuple[PolynomialTrack, ...]
    account: tuple[str, ...]


def _one_by_one(read: Callable[[TrackFile], _Read]) -> Callable[[Sequence[TrackFile], Scenario | None], list[_Read]]:
    return lambda files, _: [read(file) for file in files]


def _are_setpoints(file: TrackFile) -> bool:
    return file.text.startswith("# Skein setpoints") or file.text.startswith("t_s,sysid,north_m,")


def _read_setpoints(files: Sequence[TrackFile], scenario: Scenario | None) -> list[_Read]:
    """The tracks of files, whose places count from one origin: that of the scenario, if there is one."""
    read = [(file, read_setpoints(file.text, file.source)) for file in files]
    origins = [(file.source, stream.origin) for file, stream in read if stream.origin is not None]
    if scenario is not None:
        origins.insert(0, ("the scenario", local_origin(scenario)))
    for source, origin in origins[1:]:
        apart_m = np.linalg.norm(geodetic_to_ned(origin.lat_deg, origin.lon_deg, origin.alt_amsl_m, origins[0][1]))
        if apart_m > _ORIGINS_M:
            text = f"{source}: its places count from an origin that is {apart_m:.2f} m from that of {origins[0][0]}."
            raise FileFormatError(text, hint="give setpoints and a scenario of one origin")
    return [_of_stream(file, stream.stream) for file, stream in read]


def _of_stream(file: TrackFile, stream: SetpointStream) -> _Read:
    if len(stream.t_s) < 2:
        raise FileFormatError(f"{file.source}: one instant only.", hint="give two or more")
    each = zip(
        stream.sysids,
        stream.position_ned_m,
        stream.velocity_ned_mps,
        stream.acceleration_ned_mps2,
        strict=True,
    )
    return [PolynomialTrack(str(sysid), through(stream.t_s, *motion)) for sysid, *motion in each], ["yaw"]


_MISSIONS = "waypoint missions (.plan, .waypoints), as the models of their autopilots fly them"
TRACK_FORMATS = (
    TrackFormat("skyc", "shows of Skybrush (.skyc)", is_show, _one_by_one(read_show)),
    TrackFormat("mission", _MISSIONS, is_mission, read_missions),
    TrackFormat("setpoints", "Skein's setpoints; quintics through them", _are_setpoints, _read_setpoints),
    TrackFormat(
        "pieces", "polynomial pieces of uav_trajectories and Crazyswarm (CSV)", are_pieces, _one_by_one(read_pieces)
    ),
    TrackFormat(
        "samples", "timed samples (CSV); lines, or cubics where velocities are", are_samples, _one_by_one(read_samples)
    ),
)


def read_tracks(
    paths: Sequence[Path | str], *, frame: str | None = None, scenario: Scenario | None = None, start_s: float = 0.0
) -> ReadTracks:
    """The tracks in files of any of the formats. `frame`, "ned", "enu" or "nwu", is that of columns x, y and z.

    Missions count from the origin of the scenario, else from the first home. `start_s` is the scenario's time at which
    the files' time is 0. Raises `FileFormatError` with file and
    line, and `UsageError` for a frame that is not known.
    """
    if not paths:
        raise UsageError("no files are named", hint="give files with trajectories")
    files = [
        TrackFile(read_file(path, TRACK_FILE), str(path), path.stem.removesuffix(".pieces"), frame)
        for path in map(Path, paths)
    ]
    rows = [next(row for row in TRACK_FORMATS if row.is_it(file)) for file in files]
    found: dict[int, _Read] = {}
    for row in TRACK_FORMATS:
        mine = [n for n, of in enumerate(rows) if of is row]
        with np.errstate(over="ignore", invalid="ignore"):  # what is not finite is refused
            found |= dict(zip(mine, row.read([files[n] for n in mine], scenario) if mine else [], strict=True))
    tracks: list[PolynomialTrack] = []
    account = []
    for number, (file, row) in enumerate(zip(files, rows, strict=True)):
        its, left_out = found[number]
        known = {each.name for each in tracks}
        if twice := [each.name for each in its if each.name in known]:
            hint = "name each vehicle once: rename the file, or its vehicle column"
            raise FileFormatError(f"{file.source}: there is another track {twice[0]}.", hint=hint)
        tracks += its
        names = ", ".join(each.name for each in its[:5]) + (f" and {len(its) - 5} more" if len(its) > 5 else "")
        without = f"; left out: {', '.join(left_out)}" if left_out else ""
        account.append(f"{file.source}: {row.name}, {names}{without}")
    if start_s:
        later = [PPoly(each.position_ned_m.c, each.position_ned_m.x + start_s) for each in tracks]
        tracks = [replace(each, position_ned_m=moved) for each, moved in zip(tracks, later, strict=True)]
    return ReadTracks(tuple(tracks), tuple(account))
