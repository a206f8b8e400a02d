"""Writes shows of Skybrush (.skyc): an archive of `show.json` and a chain of cubic Bézier curves for each vehicle.

x points north, y west and z up; Skybrush turns and places the show where it is flown. There are no light programs.
"""

import io
import json
import zipfile
from collections.abc import Mapping

import numpy as np

from gcs.mission.formats.vehicle_curve import ShowFile, VehicleCurve
from gcs.types import Array

_NWU = np.array([1.0, -1.0, -1.0])
_DECIMALS = 6  # micrometres


def write_show(file: ShowFile) -> bytes:
    """The bytes of a file; the same show gives the same bytes."""
    names = [f"uav{curve.sysid}" for curve in file.curves]
    drones = []
    for name, curve in zip(names, file.curves, strict=True):
        first, last = (_rounded(curve.position_ned_m[row]) for row in (0, -1))
        path = {"$ref": f"./drones/{name}/trajectory.json#"}
        settings = {"name": name, "home": first, "landAt": last, "trajectory": path}
        drones.append({"type": "generic", "settings": settings})
    show = {
        "version": 1,
        "settings": {},
        "swarm": {"drones": drones},
        "environment": {"type": "outdoor"},
        "meta": {"title": file.title, "plan": file.plan_hash},
        "media": {},
    }
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        _add(archive, "show.json", show)
        for name, curve in zip(names, file.curves, strict=True):
            _add(archive, f"drones/{name}/trajectory.json", _trajectory(curve))
    return buffer.getvalue()


def _add(archive: zipfile.ZipFile, path: str, value: Mapping[str, object]) -> None:
    info = zipfile.ZipInfo(path, (1980, 1, 1, 0, 0, 0))
    info.compress_type = zipfile.ZIP_DEFLATED
    archive.writestr(info, json.dumps(value, separators=(",", ":")))


def _trajectory(curve: VehicleCurve) -> dict[str, object]:
    """Each point with the two control points of the curve that ends there: a third of the way along both velocities."""
    t_s = np.round(curve.t_s, _DECIMALS)
    third = np.diff(t_s)[:, None] / 3.0
    place, velocity = curve.position_ned_m, curve.velocity_ned_mps
    leaves, arrives = place[:-1] + third * velocity[:-1], place[1:] - third * velocity[1:]
    points: list[list[object]] = [[float(t_s[0]), _rounded(place[0]), []]]
    for at_s, end, first, second in zip(t_s[1:].tolist(), place[1:], leaves, arrives, strict=True):
        points.append([at_s, _rounded(end), [_rounded(first), _rounded(second)]])
    return {"version": 1, "points": points, "takeoffTime": 0.0, "landingTime": float(t_s[-1])}


def _rounded(place_ned_m: Array) -> list[float]:
    values: list[float] = (np.round(place_ned_m * _NWU, _DECIMALS) + 0.0).tolist()
    return values
