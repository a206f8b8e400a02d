"""Reads an elevation model (GeoTIFF, SRTM .hgt, any raster of GDAL) as a relief in the scenario's local frame.

Heights are AMSL, as elevation models give them. Every pixel is converted to the local frame with the geodesy of the
missions: the ground of a lake is level.
"""

import os
import warnings
from pathlib import Path
from typing import Any, Literal

import numpy as np
import rasterio
from rasterio._err import CPLE_BaseError
from rasterio.errors import NotGeoreferencedWarning, RasterioError
from rasterio.io import DatasetReader
from rasterio.warp import transform
from rasterio.windows import Window

from gcs.errors import FileFormatError
from gcs.frames import Origin, geodetic_to_ned, ned_to_geodetic
from gcs.scenario.schema.heightmap import PIXEL_LEAST_M, PIXEL_MOST_M, PIXELS_MAX, Region, Relief, packed, terms_of
from gcs.types import Array
from gcs.util.bounded_file import MIB, in_mib, open_regular

HeightUnit = Literal["m", "ft"]
FOOT_M = 0.3048
_FEET = {"ft", "foot", "feet", "us survey foot", "us_survey_foot", "ftus", "us-ft", "international foot"}
_METRES = {"", "m", "metre", "meter", "metres", "meters"}
_BLOCK_BYTES_MAX = 256 * MIB  # GDAL unpacks whole blocks of a file
_SIDE_MAX = 2_000_000  # pixels
_FIT_TOLERANCE_PX = 1e-3
_FIT_POINTS = 41
_WORLD = "EPSG:4326"
_LOWEST_M, _HIGHEST_M = -500.0, 9000.0


class DemError(ValueError):
    """The reason why an elevation model cannot be used; it follows the file name in a sentence."""


def read_dem(file: Path, origin: Origin, region: Region, unit: HeightUnit | None = None) -> Relief:
    """The part of an elevation model that covers `region`. Raises DemError.

    `unit` is what the heights are in where the file does not say; where it does, both must agree.
    """
    try:
        os.close(open_regular(file))  # GDAL would wait at a pipe, and open addresses of the network
    except FileFormatError as problem:
        raise DemError(f"cannot be read as an elevation model: {problem.reason}") from None
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", NotGeoreferencedWarning)
            with rasterio.open(file) as raster:
                return _relief(raster, origin, region, unit)
    except (RasterioError, CPLE_BaseError) as problem:  # the latter: GDAL's own, of a projection far from its area
        raise DemError(f"cannot be read as an elevation model: {problem}") from None


def _relief(raster: DatasetReader, origin: Origin, region: Region, unit: HeightUnit | None) -> Relief:
    if raster.crs is None or raster.transform.is_identity:
        step = "add one, for example `gdal_translate -a_srs EPSG:… -a_ullr …`"
        raise DemError(f"does not say where on Earth it lies (no projection); {step}")
    if raster.count != 1:
        raise DemError(f"has {raster.count} bands, a picture perhaps; heights are one band")
    _refuse_large_blocks(raster)
    scale = _metres_per_unit(raster, unit)
    window = _window(raster, origin, region)
    table = raster.read(1, window=window, masked=True)
    _complete(table, raster, window, origin)
    heights_amsl_m = np.asarray(table.data, dtype=np.float64) * scale
    low, high = float(heights_amsl_m.min()), float(heights_amsl_m.max())
    if low < _LOWEST_M or high > _HIGHEST_M:
        raise DemError(f"has heights from {low:.0f} to {high:.0f} m, which are not heights on Earth; check its unit")
    rows, columns = np.mgrid[0 : table.shape[0], 0 : table.shape[1]].astype(np.float64)
    lat_deg, lon_deg = _on_earth(raster, rows + window.row_off, columns + window.col_off)
    ned = geodetic_to_ned(lat_deg, lon_deg, heights_amsl_m, origin)
    spacing = min(float(np.median(np.linalg.norm(np.diff(ned[..., :2], axis=axis), axis=-1))) for axis in (0, 1))
    if not PIXEL_LEAST_M <= spacing <= PIXEL_MOST_M:
        raise DemError(f"has pixels of {spacing:.3g} m; {PIXEL_LEAST_M:g} to {PIXEL_MOST_M:g} m are possible")
    centre = (float(np.mean(region.north_m)), float(np.mean(region.east_m)))
    reach = max(0.5 * float(np.ptp(region.north_m)), 0.5 * float(np.ptp(region.east_m)), spacing)
    row, column = _pixel_polynomials(raster, window, origin, region, centre, reach)
    return Relief(
        rows=table.shape[0],
        columns=table.shape[1],
        heights=packed(-ned[..., 2]),
        centre_m=centre,
        reach_m=reach,
        row=row,
        column=column,
        spacing_m=spacing,
        north_m=region.north_m,
        east_m=region.east_m,
    )


def _refuse_large_blocks(raster: DatasetReader) -> None:
    """Raises DemError for a raster whose pieces need more memory than the window that is read."""
    (rows, columns), kind = raster.block_shapes[0], np.dtype(raster.dtypes[0])
    if kind.kind not in "iuf":
        raise DemError(f"has heights of the type {kind}; integers and real numbers are known")
    if max(raster.height, raster.width) > _SIDE_MAX:
        raise DemError(f"has {raster.height:,} times {raster.width:,} pixels; the limit of a side is {_SIDE_MAX:,}")
    if rows * columns * kind.itemsize > _BLOCK_BYTES_MAX:
        size = in_mib(rows * columns * kind.itemsize)
        text = f"has blocks of {rows:,} times {columns:,} pixels, {size} each; the limit is {in_mib(_BLOCK_BYTES_MAX)}"
        raise DemError(f"{text}; write it in tiles, for example `gdal_translate -co TILED=YES`")


def _metres_per_unit(raster: DatasetReader, unit: HeightUnit | None) -> float:
    stated = (raster.units[0] or "").strip().lower()
    if stated in _FEET:
        if unit != "ft":
            raise DemError(f'has heights in feet (its unit is "{raster.units[0]}"); say so with unit = "ft"')
        return FOOT_M
    if stated not in _METRES:
        raise DemError(f'has heights in "{raster.units[0]}"; metres and feet are known')
    if stated and unit == "ft":
        raise DemError(f'has heights in metres (its unit is "{raster.units[0]}"), but unit = "ft"')
    return FOOT_M if unit == "ft" else 1.0


def _window(raster: DatasetReader, origin: Origin, region: Region) -> Window:
    """Pixels that hold the region and one more on every side where there are such."""
    edge_n, edge_e = _outline(region)
    row, column = _pixels(raster, edge_n, edge_e, origin)
    needed = (row.min(), row.max(), column.min(), column.max())
    if needed[0] < 0 or needed[2] < 0 or needed[1] > raster.height - 1 or needed[3] > raster.width - 1:
        # What the whole raster covers, roughly: [low, high] north and east, m
        rows, columns = np.meshgrid(np.linspace(0, raster.height - 1, 5), np.linspace(0, raster.width - 1, 5))
        lat_deg, lon_deg = _on_earth(raster, rows, columns)
        ned = geodetic_to_ned(lat_deg, lon_deg, np.full_like(lat_deg, origin.alt_amsl_m), origin)
        north, east = tuple(np.array([ned[..., axis].min(), ned[..., axis].max()]) for axis in (0, 1))
        raise DemError(
            f"is too small: it covers {north[0]:.0f} to {north[1]:.0f} m north and {east[0]:.0f} to {east[1]:.0f} m "
            f"east of the origin, the scenario needs {region.north_m[0]:.0f} to {region.north_m[1]:.0f} m north and "
            f"{region.east_m[0]:.0f} to {region.east_m[1]:.0f} m east"
        )
    top, left = max(int(needed[0]) - 1, 0), max(int(needed[2]) - 1, 0)
    bottom, right = min(int(needed[1]) + 3, raster.height), min(int(needed[3]) + 3, raster.width)
    if (bottom - top) * (right - left) > PIXELS_MAX:
        text = f"has {(bottom - top) * (right - left):,} pixels where the scenario is, {PIXELS_MAX:,} are the most"
        raise DemError(f"{text}; make them larger, for example `gdalwarp -tr … -r max`")
    return Window(left, top, right - left, bottom - top)


def _complete(table: Any, raster: DatasetReader, window: Window, origin: Origin) -> None:
    """Raises DemError where a pixel has no height."""
    holes = np.ma.getmaskarray(table) | ~np.isfinite(np.asarray(table.data, dtype=np.float64))
    if not holes.any():
        return
    row, column = np.argwhere(holes)[0]
    lat_deg, lon_deg = _on_earth(raster, np.array([row + window.row_off]), np.array([column + window.col_off]))
    north, east, _ = geodetic_to_ned(lat_deg, lon_deg, np.array([origin.alt_amsl_m]), origin)[0]
    raise DemError(
        f"has holes: {int(holes.sum()):,} of {holes.size:,} pixels have no height, the first {north:.0f} m north, "
        f"{east:.0f} m east of the origin; fill them, for example with `gdal_fillnodata`"
    )


def _outline(region: Region) -> tuple[Array, Array]:
    north, east = (np.linspace(*bounds, _FIT_POINTS) for bounds in (region.north_m, region.east_m))
    grid = np.meshgrid(north, east, indexing="ij")
    return grid[0].ravel(), grid[1].ravel()


def _on_earth(raster: DatasetReader, row: Array, column: Array) -> tuple[Array, Array]:
    """Latitude and longitude of pixel centres, each of the shape of `row`."""
    x, y = raster.transform @ (column.ravel() + 0.5, row.ravel() + 0.5)
    lon_deg, lat_deg = transform(raster.crs, _WORLD, np.asarray(x), np.asarray(y))
    return np.reshape(lat_deg, row.shape), np.reshape(lon_deg, row.shape)


def _pixels(raster: DatasetReader, north_m: Array, east_m: Array, origin: Origin) -> tuple[Array, Array]:
    """Row and column (N,) of places at height 0, counted from 0 at the first pixel's centre."""
    lat_deg, lon_deg, _ = ned_to_geodetic(np.column_stack([north_m, east_m, np.zeros_like(north_m)]), origin)
    x, y = transform(_WORLD, raster.crs, lon_deg, lat_deg)
    column, row = ~raster.transform @ (np.asarray(x), np.asarray(y))
    return np.asarray(row) - 0.5, np.asarray(column) - 0.5


def _pixel_polynomials(
    raster: DatasetReader, window: Window, origin: Origin, region: Region, centre: tuple[float, float], reach: float
) -> tuple[Any, Any]:
    """Row and column in the window as cubic polynomials of north and east."""
    north, east = _outline(region)
    row, column = _pixels(raster, north, east, origin)
    terms = terms_of((north - centre[0]) / reach, (east - centre[1]) / reach).T
    found = []
    for wanted in (row - window.row_off, column - window.col_off):
        coefficients, *_ = np.linalg.lstsq(terms, wanted, rcond=None)
        if np.abs(terms @ coefficients - wanted).max() > _FIT_TOLERANCE_PX:
            raise DemError("is bent too much by its projection in the area of the scenario; project it to UTM")
        found.append(tuple(coefficients.tolist()))
    return found[0], found[1]
