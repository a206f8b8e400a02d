"""Conversions between geodetic coordinates (WGS 84), the formation's local NED frame, and MAVLink's degE7 integers.

A mission has one origin. Its local frame follows the Earth: down counts from the level surface through the origin, as
autopilots count heights, and north and east are distances along that surface at any height. Level flight is level, a
vertical column vertical. On Earth, distances at a height of 100 m are longer by 1.6e-5 than in the frame.

Altitudes are AMSL and enter the ellipsoid formulas unchanged: this neglects the geoid undulation (under 110 m) and
stretches horizontal distances by less than 2e-5.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pymap3d

from gcs.types import Array

_EARTH_M = 6_371_008.8  # mean radius
_STEPS = 2  # towards the level surface: the first errs by 0.2 µm at 20 km, the second by nothing at 1000 km
_TURN_DEG = 360.0
_NEAR_M = 1000.0  # scales of local frames are taken over this distance


@dataclass(frozen=True)
class Origin:
    """The geodetic position of (0, 0, 0) of a local NED frame."""

    lat_deg: float
    lon_deg: float
    alt_amsl_m: float


@dataclass(frozen=True, eq=False)
class LocalFrame:
    """The local NED frame of one autopilot: where it begins in the common frame, and what it counts for a metre.

    Autopilots make metres of degrees on a sphere. To the north at 35 degrees of latitude ArduPilot counts 1.0034 for a
    metre: 2.4 m in 700 m. Without the bend of its axes, which is 0.06 m at 1 km north and east.
    """

    begins_ned_m: Array = field(default_factory=lambda: np.zeros(3))  # (3,)
    counts: Array = field(default_factory=lambda: np.ones(3))  # (3,)

    @classmethod
    def on_sphere(cls, begins_ned_m: Array, origin: Origin, radius_m: float) -> LocalFrame:
        """The frame of an autopilot that takes the Earth for a sphere of this radius, near the common origin."""
        lat_deg, lon_deg, _ = ned_to_geodetic(np.eye(3)[:2] * _NEAR_M, origin)
        north = np.radians(lat_deg[0] - origin.lat_deg)
        east = np.radians(wrapped_deg(lon_deg[1] - origin.lon_deg)) * np.cos(np.radians(origin.lat_deg))
        return cls(begins_ned_m, np.array([north * radius_m / _NEAR_M, east * radius_m / _NEAR_M, 1.0]))

    def common_ned_m(self, place_m: Array) -> Array:
        """Return positions (..., 3) of the common frame for those of this one."""
        return np.asarray(self.begins_ned_m + place_m / self.counts)

    def own_m(self, ned_m: Array) -> Array:
        """Return positions (..., 3) of this frame for those of the common one."""
        return np.asarray((ned_m - self.begins_ned_m) * self.counts)


def ned_to_geodetic(ned_m: Array, origin: Origin) -> tuple[Array, Array, Array]:
    """Return (lat_deg, lon_deg, alt_amsl_m), each (...), of local NED positions (..., 3) in metres.

    Raises ValueError when the last axis is not 3.
    """
    ned = np.asarray(ned_m, dtype=np.float64)
    if ned.ndim == 0 or ned.shape[-1] != 3:
        raise ValueError(f"a NED position has 3 components on its last axis, got shape {ned.shape}")
    north, east, down = np.moveaxis(ned, -1, 0)
    centre_m = _EARTH_M + origin.alt_amsl_m  # below the origin
    angle_rad = np.hypot(north, east) / centre_m
    share = np.sinc(angle_rad / np.pi) / centre_m
    distance_m = np.full_like(north, centre_m)  # from the centre; that of the level surface is found by iteration
    for _ in range(_STEPS):
        enu = east * share * distance_m, north * share * distance_m, np.cos(angle_rad) * distance_m - centre_m
        lat, lon, alt = pymap3d.enu2geodetic(*enu, origin.lat_deg, origin.lon_deg, origin.alt_amsl_m)
        distance_m = distance_m - (alt - origin.alt_amsl_m)
    return np.asarray(lat), np.asarray(lon), np.asarray(origin.alt_amsl_m - down)


def geodetic_to_ned(lat_deg: Array | float, lon_deg: Array | float, alt_amsl_m: Array | float, origin: Origin) -> Array:
    """Return local NED positions (..., 3) in metres of geodetic coordinates, each (...)."""
    return place_up_m(lat_deg, lon_deg, np.asarray(alt_amsl_m) - origin.alt_amsl_m, origin) * [1.0, 1.0, -1.0]


def place_up_m(lat_deg: Array | float, lon_deg: Array | float, height_m: Array | float, origin: Origin) -> Array:
    """Return local positions (..., 3), metres north, east and up, of places `height_m` above the origin's altitude."""
    east, north, up = pymap3d.geodetic2enu(
        lat_deg, lon_deg, origin.alt_amsl_m, origin.lat_deg, origin.lon_deg, origin.alt_amsl_m
    )
    centre_m = _EARTH_M + origin.alt_amsl_m
    aside_m = np.hypot(north, east)
    angle_rad = np.arctan2(aside_m, centre_m + up)
    share = centre_m / (np.hypot(aside_m, centre_m + up) * np.sinc(angle_rad / np.pi))
    return np.stack(np.broadcast_arrays(north * share, east * share, height_m), axis=-1).astype(np.float64)


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
