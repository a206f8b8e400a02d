"""Watches that vehicles stay inside the volumes of ASTM F3548 that a service supplier has for their flight.

A volume holds every vehicle with its navigation error, so one that reports itself outside may truly be there.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import shapely

from gcs.errors import FileFormatError
from gcs.flight.monitoring.monitor import VehicleView
from gcs.frames import Origin, geodetic_to_ned
from gcs.mission.export.flight_volumes import VolumeOrder, containment
from gcs.mission.formats.flight_volume import FlightVolume, OperationalIntent
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.values.si import local_origin
from gcs.types import Array
from gcs.util.atomic_write import atomic_write
from gcs.util.bounded_file import PLAN_FILE, read_file, read_json

VOLUMES = "volumes.json"  # in a flight's folder, for `gcs attach`
CONFIRMED_S = 0.5  # of reports outside: an estimate may jump
_OTHER_PLAN_M = 0.05  # so far outside a vehicle is of another plan; instants of a file are rounded


@dataclass(frozen=True)
class _LocalVolume:
    outline: shapely.Polygon  # north, east
    low_m: float  # above the origin
    high_m: float
    start_unix_s: float
    end_unix_s: float

    @classmethod
    def of(cls, volume: FlightVolume, origin: Origin, geoid_m: float) -> _LocalVolume:
        lat, lon = np.array(volume.corners_deg).T
        corners = geodetic_to_ned(lat, lon, origin.alt_amsl_m, origin)[:, :2]
        height_m = origin.alt_amsl_m + geoid_m
        ends_s = volume.start.timestamp(), volume.end.timestamp()
        return cls(shapely.Polygon(corners), volume.lower_w84_m - height_m, volume.upper_w84_m - height_m, *ends_s)

    def beyond_m(self, ned_m: Array) -> tuple[float, float]:
        """How far a place is beside the volume, and above it, below it if negative; zeros inside."""
        north, east, up = float(ned_m[0]), float(ned_m[1]), -float(ned_m[2])
        beside_m = float(self.outline.distance(shapely.Point(north, east)))
        return beside_m, max(up - self.high_m, 0.0) + min(up - self.low_m, 0.0)


@dataclass(frozen=True)
class FlownVolumes:
    """The volumes of one flight, in the frame of its plan."""

    volumes: tuple[_LocalVolume, ...]
    data: bytes  # of the file
    geoid_m: float

    @classmethod
    def read(cls, file: Path, plan: Plan, geoid_m: float) -> FlownVolumes:
        """Those of a file that `gcs export --format f3548` wrote of this plan. Raises FileFormatError for others."""
        hint = "name a file that `gcs export --format f3548` wrote of this plan, with the same --geoid"
        found, intent = cls._of(read_file(file, PLAN_FILE, hint=hint), file.name, plan, geoid_m)
        if not intent.volumes:
            raise FileFormatError(f"{file} has no volumes.", hint=hint)
        start = min(volume.start for volume in intent.volumes)
        margin_m, t_s = containment(plan, VolumeOrder(start, geoid_m), intent)
        if margin_m < -_OTHER_PLAN_M:
            where = "there is no volume" if np.isinf(margin_m) else f"a vehicle is {-margin_m:.2f} m outside them"
            text = f"{file} has volumes of another flight: with a take-off at their begin, {where} at t = {t_s:.1f} s."
            raise FileFormatError(text, hint=hint)
        return found

    @classmethod
    def _of(cls, data: bytes, source: str, plan: Plan, geoid_m: float) -> tuple[FlownVolumes, OperationalIntent]:
        from gcs.mission.formats.f3548 import read_operational_intent  # noqa: PLC0415 (few flights need its types)

        intent, origin = read_operational_intent(data, source), local_origin(plan.scenario)
        return cls(tuple(_LocalVolume.of(each, origin, geoid_m) for each in intent.volumes), data, geoid_m), intent

    def save(self, path: Path) -> None:
        """Write the file and its geoid, for `load`."""
        intent = json.loads(self.data)
        atomic_write(path, json.dumps({"geoid_m": self.geoid_m, "operational_intent": intent}) + "\n")

    @classmethod
    def load(cls, path: Path, plan: Plan) -> FlownVolumes:
        """Those that a flight of this plan, or of what became of it, was begun with. Raises FileFormatError."""
        try:
            kept = read_json(read_file(path, PLAN_FILE))
            geoid_m, intent = float(kept["geoid_m"]), json.dumps(kept["operational_intent"]).encode()
            if not np.isfinite(geoid_m):
                raise ValueError("geoid_m is not finite")
        except (ValueError, TypeError, KeyError) as problem:
            raise FileFormatError(f"{path} are not the volumes of a flight ({problem}).") from problem
        return cls._of(intent, path.name, plan, geoid_m)[0]

    def outside(self, unix_s: float, ned_m: Array) -> str:
        """How far a place (3,) is outside all volumes in force, in words; empty inside one."""
        nearest: tuple[float, str] | None = None
        for number, volume in enumerate(self.volumes, 1):
            if not volume.start_unix_s <= unix_s <= volume.end_unix_s:
                continue
            beside_m, above_m = volume.beyond_m(ned_m)
            if not beside_m and not above_m:
                return ""
            far = [f"{beside_m:.1f} m beside"] * bool(beside_m)
            far += [f"{abs(above_m):.1f} m {'above' if above_m > 0.0 else 'below'}"] * bool(above_m)
            away_m = float(np.hypot(beside_m, above_m))
            if nearest is None or away_m < nearest[0]:
                nearest = away_m, f"{' and '.join(far)} volume {number} of {len(self.volumes)}"
        if nearest is not None:
            return nearest[1]
        return f"no volume is in force at {datetime.fromtimestamp(unix_s, UTC):%H:%M:%S} UTC"


class VolumeWatch:
    """Tells each vehicle that leaves the volumes of its flight, once until it is inside again."""

    def __init__(self, volumes: FlownVolumes) -> None:
        self._volumes = volumes
        self._since_s: dict[int, float] = {}
        self._told: set[int] = set()

    def look(self, views: Mapping[int, VehicleView], flying: Collection[int]) -> list[tuple[int, str]]:
        """The vehicles whose reports are outside for `CONFIRMED_S`, and how far."""
        found = []
        for sysid in flying:
            view = views[sysid]
            if not np.isfinite(view.position_ned_m).all():
                continue
            words = self._volumes.outside(view.unix_s, view.position_ned_m)
            if not words:
                self._since_s.pop(sysid, None)
                self._told.discard(sysid)
            elif view.unix_s - self._since_s.setdefault(sysid, view.unix_s) >= CONFIRMED_S and sysid not in self._told:
                self._told.add(sysid)
                found.append((sysid, words))
        return found
