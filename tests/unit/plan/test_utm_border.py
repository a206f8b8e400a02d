"""One flight over the border of two UTM zones, its ground from a raster of either: the same plan, the same places."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pymap3d
import pytest
import rasterio
from rasterio.transform import from_origin
from rasterio.warp import transform

from gcs.mission.model import Command
from gcs.mission.waypoints.mission_items import build_missions
from gcs.plan.planner import make_plan
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.verify import verify
from gcs.scenario.schema.scenario import Scenario, Terrain
from gcs.scenario.sources.load import load_scenario
from gcs.types import Array
from tests.unit.plan.problems import changed, meadow

WEST, EAST = "EPSG:32631", "EPSG:32632"  # UTM 31 and 32 north; between them the meridian 6 degrees east
LAT_DEG, ALT_M = 47.0, 400.0
LON_DEG = 6.0 - 7.0 / (111_320.0 * np.cos(np.radians(LAT_DEG)))  # 7 m west of it
HILL_M = (21.0, 7.5)
PIXEL_M, HALF_M = 2.0, 150.0


def ground_amsl_m(lat_deg: Array, lon_deg: Array) -> Array:
    """A hill on the way, 3 m high."""
    north, east, _ = pymap3d.geodetic2ned(lat_deg, lon_deg, ALT_M, LAT_DEG, LON_DEG, ALT_M)
    return np.asarray(ALT_M + 3.0 * np.exp(-((north - HILL_M[0]) ** 2 + (east - HILL_M[1]) ** 2) / 72.0))


def write_ground(path: Path, crs: str) -> None:
    x, y = (values[0] for values in transform("EPSG:4326", crs, [LON_DEG], [LAT_DEG]))
    count = int(2.0 * HALF_M / PIXEL_M)
    grid = from_origin(x - HALF_M, y + HALF_M, PIXEL_M, PIXEL_M)
    columns, rows = np.meshgrid(np.arange(count) + 0.5, np.arange(count) + 0.5)
    lon, lat = transform(crs, "EPSG:4326", *(grid @ (columns.ravel(), rows.ravel())))
    heights = ground_amsl_m(np.array(lat), np.array(lon)).reshape(count, count).astype("float32")
    layout = {"driver": "GTiff", "count": 1, "dtype": "float32", "height": count, "width": count}
    with rasterio.open(path, "w", crs=crs, transform=grid, **layout) as raster:
        raster.write(heights, 1)
        raster.units = ("metre",)


def planned(folder: Path, scenario: Scenario, crs: str) -> Plan:
    """The flight over the ground of one raster, as it is read from files."""
    folder.mkdir()
    write_ground(folder / "ground.tif", crs)
    there = changed(
        scenario,
        origin={"lat_deg": LAT_DEG, "lon_deg": LON_DEG, "alt_amsl_m": ALT_M},
        terrain={"dem": {"file": "ground.tif"}},
    )
    (folder / "scenario.json").write_text(there.model_dump_json())
    return make_plan(load_scenario(folder / "scenario.json"))


@pytest.mark.slow
def test_a_flight_across_the_border_is_the_same_from_either_raster(simulation1: Scenario, tmp_path: Path) -> None:
    scenario = meadow(simulation1, limits={"north_m": [-10.0, 60.0], "east_m": [-20.0, 30.0]})
    plans = [planned(tmp_path / name, scenario, crs) for name, crs in (("west", WEST), ("east", EAST))]
    times = np.linspace(0.0, plans[0].flight_s, 100)
    tracks = [plan.states(times)[..., :3] for plan in plans]
    assert np.abs(tracks[0] - tracks[1]).max() < 0.1
    for plan in plans:
        assert verify(plan).ok
    level = make_plan(plans[0].scenario.model_copy(update={"terrain": Terrain()}))
    failures = verify(replace(level, scenario=plans[0].scenario)).failures
    assert "height above ground" in {check.name for check in failures}


@pytest.mark.long
def test_its_waypoints_are_on_both_sides_of_the_border(simulation1: Scenario, tmp_path: Path) -> None:
    scenario = meadow(simulation1, limits={"north_m": [-10.0, 60.0], "east_m": [-20.0, 30.0]})
    plan = planned(tmp_path / "both", scenario, WEST)
    mission = build_missions(plan)[plan.leader]
    timed = [
        (item, t)
        for item, t in zip(mission.items, mission.arrival_s, strict=True)
        if item.command == Command.NAV_WAYPOINT and t is not None and 0.0 <= t <= plan.flight_s
    ]
    lat, lon = np.array([(item.lat_degE7 / 1e7, item.lon_degE7 / 1e7) for item, _ in timed]).T
    assert lon.min() < 6.0 < lon.max()
    north, east, _ = pymap3d.geodetic2ned(lat, lon, ALT_M, LAT_DEG, LON_DEG, ALT_M)
    planned_ned_m = plan.states(np.array([t for _, t in timed]))[plan.leader, :, :3]
    assert north == pytest.approx(planned_ned_m[:, 0], abs=0.3)
    assert east == pytest.approx(planned_ned_m[:, 1], abs=0.3)
