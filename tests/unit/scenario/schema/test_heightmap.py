"""Ground from elevation models: heights as measured, wherever on Earth, and a smooth surface that is above them."""

from __future__ import annotations

from pathlib import Path

import casadi as ca
import numpy as np
import pytest
import rasterio
from hypothesis import example, given, settings
from hypothesis import strategies as st
from rasterio.transform import from_origin
from rasterio.warp import transform

from gcs.frames import Origin, ned_to_geodetic
from gcs.plan.ocp.stage_functions import spline
from gcs.scenario.environment.dem import FOOT_M, DemError, read_dem
from gcs.scenario.schema.heightmap import ENVELOPE_RESERVE_M, Region, Relief, packed
from gcs.types import Array

REGION = Region((-150.0, 250.0), (-120.0, 180.0))
PIXEL_M = 10.0


def slope_amsl_m(lat_deg: Array, lon_deg: Array, origin: Origin) -> Array:
    """A slope that falls to the north and rises to the east: bilinear in degrees and, nearly, in metres."""
    return 300.0 + 2e3 * (np.asarray(lon_deg) - origin.lon_deg) - 3e3 * (np.asarray(lat_deg) - origin.lat_deg)


def write_dem(path: Path, origin: Origin, crs: str, *, half_m: float = 600.0, step: float = PIXEL_M) -> Path:
    """A GeoTIFF of the slope around an origin; `step` in units of the projection."""
    x, y = (values[0] for values in transform("EPSG:4326", crs, [origin.lon_deg], [origin.lat_deg]))
    count = int(2.0 * half_m / PIXEL_M)
    grid = from_origin(x - 0.5 * count * step, y + 0.5 * count * step, step, step)
    columns, rows = np.meshgrid(np.arange(count) + 0.5, np.arange(count) + 0.5)
    east, north = grid @ (columns.ravel(), rows.ravel())
    lon, lat = transform(crs, "EPSG:4326", east, north)
    heights = slope_amsl_m(lat, lon, origin).reshape(count, count).astype("float32")
    layout = {"driver": "GTiff", "count": 1, "dtype": "float32", "height": count, "width": count}
    with rasterio.open(path, "w", crs=crs, transform=grid, **layout) as raster:
        raster.write(heights, 1)
    return path


@pytest.mark.parametrize(
    ("where", "crs", "step"),
    [
        (Origin(47.0, 8.0, 300.0), "EPSG:32632", 10.0),
        (Origin(-35.363262, 149.165237, 300.0), "EPSG:32755", 10.0),  # southern half
        (Origin(37.6, -122.4, 250.0), "EPSG:32610", 10.0),  # western half
        (Origin(-33.0, -70.6, 300.0), "EPSG:4326", 1e-4),  # both, in degrees
        (Origin(47.0, 6.0, 300.0), "EPSG:32631", 10.0),  # on the border of two UTM zones
        (Origin(47.0, 6.0, 300.0), "EPSG:32632", 10.0),
        (Origin(0.0, 12.0, 300.0), "EPSG:4326", 1e-4),  # on the equator
    ],
)
def test_heights_are_where_they_are_on_earth(tmp_path: Path, where: Origin, crs: str, step: float) -> None:
    relief = read_dem(write_dem(tmp_path / "slope.tif", where, crs, step=step), where, REGION)
    rng = np.random.default_rng(1)
    north, east = rng.uniform(*REGION.north_m, 500), rng.uniform(*REGION.east_m, 500)
    up = relief.height_m(north, east)
    lat, lon, alt = ned_to_geodetic(np.column_stack([north, east, -up]), where)
    assert np.abs(alt - slope_amsl_m(lat, lon, where)).max() < 2e-3


def test_a_tile_of_srtm_is_read_by_its_name(tmp_path: Path) -> None:
    count = 1201
    metres = np.add.outer(np.arange(count), 2 * np.arange(count)).astype(">i2")  # row by row from the north-west corner
    path = tmp_path / "S36E149.hgt"
    path.write_bytes(metres.tobytes())
    where = Origin(-35.5, 149.25, 0.0)  # row 600, column 300 exactly
    relief = read_dem(path, where, REGION)
    height = relief.height_m(np.array([0.0]), np.array([0.0]))
    assert height == pytest.approx(600 + 2 * 300, abs=0.02)


def test_the_ground_of_a_lake_is_level(tmp_path: Path) -> None:
    """Level ground is lower, in a plane that touches the Earth at the origin, by d^2 / 2R."""
    where = Origin(47.0, 8.0, 300.0)
    path = write_dem(tmp_path / "flat.tif", where, "EPSG:32632", half_m=2500.0)
    with rasterio.open(path, "r+") as raster:
        raster.write(np.full((raster.height, raster.width), 300.0, dtype="float32"), 1)
    relief = read_dem(path, where, Region((-50.0, 2000.0), (-50.0, 50.0)))
    assert relief.height_m(np.array([2000.0]), np.array([0.0])) == pytest.approx(0.0, abs=1e-6)


def test_feet_are_metres_where_they_are_said(tmp_path: Path) -> None:
    where = Origin(47.0, 8.0, 0.0)
    path = write_dem(tmp_path / "feet.tif", where, "EPSG:32632")
    plain = read_dem(path, where, REGION).pixels_m
    asked = read_dem(path, where, REGION, "ft").pixels_m
    assert np.allclose(asked, plain * FOOT_M, atol=0.01)
    with rasterio.open(path, "r+") as raster:
        raster.units = ("US survey foot",)
    with pytest.raises(DemError, match=r'in feet .*unit = "ft"'):
        read_dem(path, where, REGION)
    with rasterio.open(path, "r+") as raster:
        raster.units = ("metre",)
    with pytest.raises(DemError, match=r'in metres .*but unit = "ft"'):
        read_dem(path, where, REGION, "ft")


def test_a_file_that_cannot_be_used_says_why(tmp_path: Path) -> None:
    where = Origin(47.0, 8.0, 300.0)
    good = write_dem(tmp_path / "good.tif", where, "EPSG:32632")
    with pytest.raises(DemError, match=r"too small: it covers -60\d to 60\d m north .* needs -150 to 900 m north"):
        read_dem(good, where, Region((-150.0, 900.0), REGION.east_m))
    with rasterio.open(good, "r+") as raster:
        raster.nodata = -9999.0
        heights = raster.read(1)
        row, column = raster.index(*(v[0] for v in transform("EPSG:4326", raster.crs, [8.0], [47.0])))
        heights[row, column] = -9999.0
        raster.write(heights, 1)
    with pytest.raises(DemError, match=r"has holes: 1 of .* the first -?\d m north, -?\d m east .*gdal_fillnodata"):
        read_dem(good, where, REGION)
    layout = {"driver": "GTiff", "count": 1, "dtype": "float32", "height": 9, "width": 9}
    with rasterio.open(tmp_path / "bare.tif", "w", **layout) as raster:
        raster.write(np.zeros((9, 9), dtype="float32"), 1)
    with pytest.raises(DemError, match="where on Earth it lies"):
        read_dem(tmp_path / "bare.tif", where, REGION)
    (tmp_path / "text.tif").write_text("no picture")
    for name in ("text.tif", "missing.tif"):
        with pytest.raises(DemError, match="cannot be read"):
            read_dem(tmp_path / name, where, REGION)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10_000), st.floats(0.1, 80.0), st.floats(-0.5, 0.5))
@example(1154, 23.0, 0.015625)  # two edges of pixels cross between two samples
def test_the_smooth_ground_is_nowhere_below_the_relief(seed: int, rough_m: float, turned: float) -> None:
    relief = rough_relief(seed, rough_m, turned)
    rng = np.random.default_rng(seed)
    north, east = rng.uniform(0.0, 100.0, 4000), rng.uniform(0.0, 80.0, 4000)
    above = relief.envelope.height_m(north, east) - relief.height_m(north, east)
    assert above.min() > 0.0


def test_the_smooth_ground_of_a_plane_is_the_plane() -> None:
    relief = rough_relief(0, 0.0, 0.3)
    north, east = np.meshgrid(np.linspace(0.0, 100.0, 40), np.linspace(0.0, 80.0, 40))
    above = relief.envelope.height_m(north, east) - relief.height_m(north, east)
    assert relief.height_m(np.float64(50.0), np.float64(40.0)).shape == ()
    assert above == pytest.approx(2.0 * ENVELOPE_RESERVE_M, abs=1.1 * ENVELOPE_RESERVE_M)


def test_the_optimiser_sees_the_same_surface() -> None:
    relief = rough_relief(3, 20.0, 0.2)
    rng = np.random.default_rng(3)
    places = rng.uniform(-400.0, 500.0, (2, 300))  # some outside: it goes on level there
    seen = np.asarray(spline(relief.envelope)(places)).ravel()
    assert np.abs(seen - relief.envelope.height_m(*places)).max() < 1e-9
    z = ca.MX.sym("z", 2)
    curvature = ca.Function("curvature", [z], [ca.hessian(spline(relief.envelope)(z), z)[0]])
    assert np.all(np.isfinite(np.asarray(curvature([50.0, 40.0]))))


def rough_relief(seed: int, rough_m: float, turned: float) -> Relief:
    """Random heights on a grid of 10 m, turned against north, on a slope."""
    rng = np.random.default_rng(seed)
    rows, columns = np.mgrid[0:30, 0:30] * 1.0
    heights = rng.uniform(0.0, rough_m, (30, 30)) + rows - 0.5 * columns
    c, s = np.cos(turned) / 10.0, np.sin(turned) / 10.0
    rest = (0.0,) * 7
    return Relief(
        rows=30,
        columns=30,
        heights=packed(heights),
        centre_m=(50.0, 40.0),
        reach_m=1.0,
        row=(14.5, c, s, *rest),
        column=(14.5, -s, c, *rest),
        spacing_m=10.0,
        north_m=(0.0, 100.0),
        east_m=(0.0, 80.0),
    )
