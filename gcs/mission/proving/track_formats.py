"""The formats of trajectories that `gcs prove` reads: one row for each. A new format is a reader and a row here."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from gcs.errors import FileFormatError, UsageError
from gcs.mission.formats.tables.setpoint_table import read_setpoints
from gcs.mission.proving.csv_rows import TrackText
from gcs.mission.proving.polynomial_pieces import are_pieces, read_pieces
from gcs.mission.proving.timed_samples import are_samples, read_samples, through
from gcs.mission.proving.track import PolynomialTrack
from gcs.util.bounded_file import TRACK_FILE, as_utf8, read_file

_TEXTS_ONLY = "give CSV or .setpoints files, saved as UTF-8; a plan is proved by `gcs verify`"


@dataclass(frozen=True)
class TrackFormat:
    """One format: what it holds, whether a file is of it, and its tracks with the names of what was left out."""

    name: str
    purpose: str
    is_it: Callable[[TrackText], bool]
    read: Callable[[TrackText], tuple[list[PolynomialTrack], list[str]]]


@dataclass(frozen=True)
class ReadTracks:
    """The tracks of files, and a line for each file with its format, its tracks and what was left out."""

    tracks: tuple[PolynomialTrack, ...]
    account: tuple[str, ...]


def _are_setpoints(file: TrackText) -> bool:
    return file.text.startswith("# Skein setpoints") or file.text.startswith("t_s,sysid,north_m,")


def _read_setpoints(file: TrackText) -> tuple[list[PolynomialTrack], list[str]]:
    stream = read_setpoints(file.text, file.source).stream
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


TRACK_FORMATS = (
    TrackFormat("setpoints", "Skein's setpoints; quintics through them", _are_setpoints, _read_setpoints),
    TrackFormat("pieces", "polynomial pieces of uav_trajectories and Crazyswarm (CSV)", are_pieces, read_pieces),
    TrackFormat("samples", "timed samples (CSV); lines, or cubics where velocities are", are_samples, read_samples),
)


def read_tracks(paths: Sequence[Path | str], *, frame: str | None = None) -> ReadTracks:
    """The tracks in files of any of the formats. `frame`, "ned" or "enu", is that of columns x, y and z.

    Raises `FileFormatError` with file and line, and `UsageError` for a frame that is not known.
    """
    tracks: list[PolynomialTrack] = []
    account = []
    if not paths:
        raise UsageError("no files are named", hint="give files with trajectories")
    for path in map(Path, paths):
        data = read_file(path, TRACK_FILE)
        try:
            text = as_utf8(data).decode("utf-8-sig")
        except ValueError:
            raise FileFormatError(f"{path}: not a text.", hint=_TEXTS_ONLY) from None
        file = TrackText(text, str(path), path.stem, frame)
        row = next(each for each in TRACK_FORMATS if each.is_it(file))
        found, left_out = row.read(file)
        known = {each.name for each in tracks}
        if twice := [each.name for each in found if each.name in known]:
            hint = "name each vehicle once: rename the file, or its vehicle column"
            raise FileFormatError(f"{path}: there is another track {twice[0]}.", hint=hint)
        tracks += found
        names = ", ".join(each.name for each in found[:5]) + (f" and {len(found) - 5} more" if len(found) > 5 else "")
        without = f"; left out: {', '.join(left_out)}" if left_out else ""
        account.append(f"{path}: {row.name}, {names}{without}")
    return ReadTracks(tuple(tracks), tuple(account))
