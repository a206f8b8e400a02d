"""Scenarios in metres written with latitude and longitude wherever a file may give a place."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np

from gcs.frames import Origin, ned_to_geodetic

Data = dict[str, Any]
WIDER_M = 0.5  # limits in degrees hold those in metres


def in_degrees(data: Data) -> Data:
    """The same tables with every place in degrees; heights above the origin and above the sea by turns."""
    changed = copy.deepcopy(data)
    origin = Origin(**data["origin"])
    tables = [changed["start"], changed["end"], *changed.get("route", []), *changed["formation"].get("vehicle", [])]
    positions = [table for table in tables if isinstance(table, dict) and "position_m" in table]
    for row, table in enumerate(positions):
        north, east, height = table.pop("position_m")
        lat, lon, alt = ned_to_geodetic(np.array([north, east, -height]), origin)
        table["position_deg"] = [float(lat), float(lon)]
        table.update({"height_m": height} if row % 2 == 0 else {"alt_amsl_m": float(alt)})
    for change in changed["formation"].get("change", []):
        if "gate_m" in change:
            change["gate_deg"] = _points(change.pop("gate_m"), origin)
    survey = [changed["survey"]] if "survey" in changed else []
    for zone in [*changed.get("no_fly", []), *changed.get("keep_in", []), *survey]:
        if "polygon_deg" in zone:
            continue
        if "polygon_m" in zone:
            zone["polygon_deg"] = _points(zone.pop("polygon_m"), origin)
        else:
            (place,) = _points([[zone.pop("north_m"), zone.pop("east_m")]], origin)
            zone["lat_deg"], zone["lon_deg"] = place
    if "mountains" in changed.get("terrain", {}):
        mountains = changed["terrain"]["mountains"]
        summits = _points(list(zip(mountains.pop("north_m"), mountains.pop("east_m"), strict=True)), origin)
        mountains["lat_deg"], mountains["lon_deg"] = [p[0] for p in summits], [p[1] for p in summits]
    limits = changed["limits"]
    (south, north), (west, east) = limits.pop("north_m"), limits.pop("east_m")
    limits["lat_deg"] = [p[0] for p in _points([[south - WIDER_M, 0.0], [north + WIDER_M, 0.0]], origin)]
    limits["lon_deg"] = [p[1] for p in _points([[0.0, west - WIDER_M], [0.0, east + WIDER_M]], origin)]
    return changed


def _points(points: list[Any], origin: Origin) -> list[list[float]]:
    ned = np.column_stack([np.array(points, dtype=float), np.zeros(len(points))])
    lat, lon, _ = ned_to_geodetic(ned, origin)
    return np.column_stack([lat, lon]).tolist()
