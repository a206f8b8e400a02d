"""Conversions between geodetic coordinates (WGS 84), the formation's local NED frame, and MAVLink's degE7 integers.

A mission has one origin. Altitudes are AMSL and enter the ellipsoid formulas unchanged: this neglects the geoid
undulation (under 110 m) and stretches horizontal distances by less than 2e-5.
"""

from dataclasses import dataclass

import numpy as np
import pymap3d

from gcs.types import Array

_STEP_M = 1000.0
_TURN_DEG = 360.0


@dataclass(frozen=True)
class Origin:
    """The geodetic position of (0, 0, 0) of a local NED frame."""

    lat_deg: float
    lon_deg: float
    alt_amsl_m: float


def ned_to_geodetic(ned_m: Array, origin: Origin) -> tuple[Array, Array, Array]:
    """Return (lat_deg, lon_deg, alt_amsl_m), each (...), of local NED positions (..., 3) in metres.

    Raises ValueError when the last axis is not 3.
    """
    ned = np.asarray(ned_m, dtype=np.float64)
    if ned.ndim == 0 or ned.shape[-1] != 3:
        raise ValueError(f"a NED position has 3 components on its last axis, got shape {ned.shape}")
    north, east, down = np.moveaxis(ned, -1, 0)
    lat, lon, alt = pymap3d.ned2geodetic(north, east, down, origin.lat_deg, origin.lon_deg, origin.alt_amsl_m)
    return np.asarray(lat), np.asarray(lon), np.asarray(alt)


def geodetic_to_ned(lat_deg: Array | float, lon_deg: Array | float, alt_amsl_m: Array | float, origin: Origin) -> Array:
    """Return local NED positions (..., 3) in metres of geodetic coordinates, each (...)."""
    parts = pymap3d.geodetic2ned(lat_deg, lon_deg, alt_amsl_m, origin.lat_deg, origin.lon_deg, origin.alt_amsl_m)
    return np.stack(np.broadcast_arrays(*parts), axis=-1).astype(np.float64)


def place_up_m(lat_deg: Array | float, lon_deg: Array | float, height_m: Array | float, origin: Origin) -> Array:
    """Return local positions (..., 3), metres north, east and up, whose third coordinate is `height_m`.

    `ned_to_geodetic` gives the same latitude and longitude back. The place must be less than 1000 km from the origin.
    """
    # Straight up at a place, all three coordinates are linear in the altitude.
    low, high = (geodetic_to_ned(lat_deg, lon_deg, origin.alt_amsl_m + step_m, origin) for step_m in (0.0, _STEP_M))
    steps = (-np.asarray(height_m) - low[..., 2]) / (high[..., 2] - low[..., 2])
    return np.asarray((low + steps[..., None] * (high - low)) * [1.0, 1.0, -1.0])


def unwrapped_deg(lon_deg: Array) -> Array:
    """Return longitudes (..., N) without the jump at 180 degrees: each within half a turn of the first of its row.

    Areas, windings, means and differences are right for these; on Earth they may be beyond 180 degrees.
    """
    lon = np.asarray(lon_deg, dtype=np.float64)
    return np.asarray(lon - _TURN_DEG * np.round((lon - lon[..., :1]) / _TURN_DEG))


def wrapped_deg(lon_deg: Array | float) -> Array:
    """Return longitudes from -180 to 180 degrees; those that are already are not changed."""
    lon = np.asarray(lon_deg, dtype=np.float64)
    half_deg = _TURN_DEG / 2.0
    return np.where(np.abs(lon) <= half_deg, lon, (lon + half_deg) % _TURN_DEG - half_deg)


def to_degE7(angle_deg: float) -> int:
    """Return the nearest MAVLink integer of 1e-7 degrees. The error is at most 6 mm (11 mm if truncated instead)."""
    return round(float(angle_deg) * 1e7)


def from_degE7(angle_degE7: int) -> float:
    """Return degrees of a MAVLink integer of 1e-7 degrees."""
    return angle_degE7 / 1e7
