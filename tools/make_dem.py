"""The synthetic elevation model of missions/ridge: ./tools/run python tools/make_dem.py

Rolling ground and a ridge 75 m high and 80 m wide across the way, with a pass; in pixels of 10 m of UTM zone 19 south.
"""

from pathlib import Path

import numpy as np
import rasterio
from rasterio.transform import from_origin
from rasterio.warp import transform

from gcs.scenario.schema.scenario import OriginTable
from gcs.types import Array

FILE = Path(__file__).resolve().parent.parent / "missions" / "ridge" / "ridge.tif"
ORIGIN = OriginTable(lat_deg=-33.42, lon_deg=-70.58, alt_amsl_m=740.0)
CRS, PIXEL_M = "EPSG:32719", 10.0
SOUTH_M, NORTH_M, WEST_M, EAST_M = -100.0, 800.0, -250.0, 250.0


def ground_m(north_m: Array, east_m: Array) -> Array:
    """Height (...) above the origin at places (...), m."""
    rolling = 3.0 * np.sin(east_m / 70.0) + 2.0 * np.cos(north_m / 50.0) - 2.0
    ridge = 75.0 * np.exp(-(((north_m - 350.0 - 0.2 * east_m) / 40.0) ** 2))
    the_pass = 1.0 - 0.8 * np.exp(-(((east_m - 60.0) / 45.0) ** 2))
    return np.asarray(rolling + ridge * the_pass)


def main() -> None:
    """Write the file."""
    east, north = (values[0] for values in transform("EPSG:4326", CRS, [ORIGIN.lon_deg], [ORIGIN.lat_deg]))
    rows, columns = int((NORTH_M - SOUTH_M) / PIXEL_M), int((EAST_M - WEST_M) / PIXEL_M)
    up, across = np.meshgrid(
        NORTH_M - PIXEL_M * (np.arange(rows) + 0.5), WEST_M + PIXEL_M * (np.arange(columns) + 0.5), indexing="ij"
    )
    layout = {"driver": "GTiff", "count": 1, "dtype": "float32", "height": rows, "width": columns}
    grid = from_origin(east + WEST_M, north + NORTH_M, PIXEL_M, PIXEL_M)
    with rasterio.open(FILE, "w", crs=CRS, transform=grid, compress="deflate", predictor=3, **layout) as raster:
        raster.write((ORIGIN.alt_amsl_m + ground_m(up, across)).astype(np.float32), 1)
        raster.units = ("metre",)
    print(f"{FILE}: {rows} x {columns} pixels, {FILE.stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    main()
