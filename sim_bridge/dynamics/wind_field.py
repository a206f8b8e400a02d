"""The wind over the fleet: a constant mean and Dryden gusts, with the low-altitude spectra of MIL-F-8785C.

There is one field for the whole fleet. Gusts are tens of metres long, so the vehicles of a formation are pushed
together, which helps their separation. Every position has the same spectrum. The gusts at two positions d apart are
correlated by exp(-d / L), with the gust length L. Positions are those of the pads: a formation keeps its distances
closely enough. The field drifts past at the mean wind, at least at PASSING_MPS, because vehicles fly through it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_discrete_lyapunov
from scipy.signal import bilinear, lfilter
from scipy.spatial.distance import cdist

from gcs.errors import UsageError
from gcs.physics.wind import GUSTS_MPS, STILL, SteadyWind
from gcs.types import Array

GUST_PERIOD_S = 0.04
PASSING_MPS = 3.0
HEIGHT_M = 10.0  # for which the lengths and the ratio of the spectra hold
STRONGEST_MPS = 30.0

_FOOT_M = 0.3048
_SHEAR = 0.177 + 0.000823 * HEIGHT_M / _FOOT_M
LENGTHS_M = (HEIGHT_M / _SHEAR**1.2, HEIGHT_M / _SHEAR**1.2, HEIGHT_M)  # along the wind, across, vertical
VERTICAL_SHARE = _SHEAR**0.4
_BLOCK = 200


@dataclass(frozen=True, slots=True)
class Wind:
    """The mean wind (direction it blows to, common local NED) and the horizontal standard deviation of its gusts.

    Without a mean it is the wind of the scenario, which may grow with height.
    """

    mean_ned_mps: tuple[float, float, float] | None = None
    gust_mps: float = 0.0
    by_height: SteadyWind = STILL

    def over(self, planned: SteadyWind) -> Wind:
        """Return this wind, with the planned wind as mean if it has none."""
        if self.mean_ned_mps is not None:
            return self
        return Wind((planned.north_mps, planned.east_mps, 0.0), self.gust_mps, planned)


CALM = Wind()


def parse_wind(wind: str = "", gusts: str = "") -> Wind:
    """Return the wind of `3@270` (3 m/s from the west) with gusts `light`, `moderate`, `severe` or in m/s.

    Raises `UsageError`.
    """
    mean_ned_mps = None
    if wind:
        speed, at, direction = wind.partition("@")
        speed_mps, from_deg = _number(speed), _number(direction)
        if not at or not 0.0 <= speed_mps <= STRONGEST_MPS or not -360.0 <= from_deg <= 360.0:
            raise UsageError(
                f"--wind {wind!r} must be SPEED@FROM: 0 to {STRONGEST_MPS:g} m/s, and degrees the wind comes from.",
                hint="write e.g. --wind 3@270 for 3 m/s from the west",
            )
        to_rad = math.radians(from_deg) + math.pi
        mean_ned_mps = (speed_mps * math.cos(to_rad), speed_mps * math.sin(to_rad), 0.0)
    gust_mps = GUSTS_MPS.get(gusts, math.nan) if gusts else 0.0
    if math.isnan(gust_mps):
        gust_mps = _number(gusts)
    if not 0.0 <= gust_mps <= STRONGEST_MPS:
        raise UsageError(
            f"--gusts {gusts!r} must be {', '.join(GUSTS_MPS)}, or a deviation of 0 to {STRONGEST_MPS:g} m/s.",
            hint="write e.g. --gusts light, or --gusts 0.8",
        )
    return Wind(mean_ned_mps, gust_mps)


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan


class WindField:
    """The wind at V positions, sample by sample. The same seed gives the same wind."""

    def __init__(self, wind: Wind, places_ned_m: Array, seed: int) -> None:
        """The positions (V, 3) are in common local NED."""
        vehicles = len(places_ned_m)
        self._generators = [np.random.default_rng(child) for child in np.random.SeedSequence([seed, 2]).spawn(vehicles)]
        mean = wind.mean_ned_mps or (0.0, 0.0, 0.0)
        self._mean = np.array(mean)[:, None] * np.ones(vehicles)
        self._by_height = wind.by_height
        north, east, _ = mean
        speed = math.hypot(north, east)
        along = np.array([north, east]) / speed if speed else np.array([1.0, 0.0])
        self._to_ned = np.array([[along[0], -along[1], 0.0], [along[1], along[0], 0.0], [0.0, 0.0, 1.0]])
        passing_mps = max(speed, PASSING_MPS)
        distances = cdist(places_ned_m[:, :2], places_ned_m[:, :2])
        self._axes: list[_Axis] = []
        if wind.gust_mps > 0.0:
            sigmas = (wind.gust_mps, wind.gust_mps, wind.gust_mps * VERTICAL_SHARE)
            for k, (sigma, length) in enumerate(zip(sigmas, LENGTHS_M, strict=True)):
                like = np.linalg.cholesky(np.exp(-distances / length) + 1e-9 * np.eye(vehicles))
                self._axes.append(_Axis(*dryden(sigma, length / passing_mps, transverse=k > 0), like))
            start = np.stack([g.standard_normal((3, 2)) for g in self._generators], axis=-1)
            for axis, normals in zip(self._axes, start, strict=True):
                axis.begin(normals)
        self._block = np.empty((0, 3, vehicles))
        self._next = 0

    def draw(self, height_m: Array | float = 0.0) -> Array:
        """Return the wind (3, V) for the next GUST_PERIOD_S, constant, for vehicles (V,) at these heights."""
        drawn = self._drawn()
        if not self._by_height.has_shear:
            return drawn
        return np.asarray(drawn + (self._by_height.share(height_m) - 1.0) * self._mean)

    def _drawn(self) -> Array:
        if not self._axes:
            return self._mean
        if self._next == len(self._block):
            normals = np.stack([g.standard_normal((_BLOCK, 3)) for g in self._generators], axis=-1)
            gusts = np.stack([axis.shape(normals[:, k]) for k, axis in enumerate(self._axes)], axis=1)
            self._block = self._mean + np.einsum("ij,njv->niv", self._to_ned, gusts)
            self._next = 0
        self._next += 1
        return np.asarray(self._block[self._next - 1])


def dryden(sigma_mps: float, time_s: float, *, transverse: bool) -> tuple[Array, Array]:
    """Return the digital filter (b, a) that turns normal numbers GUST_PERIOD_S apart into gusts of this deviation.

    Along the wind σ √(2T) / (1 + T s), else σ √T (1 + √3 T s) / (1 + T s)², T = length over speed. The gain is
    scaled to correct the effect of sampling on the variance.
    """
    if transverse:
        b, a = bilinear([math.sqrt(3.0) * time_s, 1.0], [time_s**2, 2.0 * time_s, 1.0], 1.0 / GUST_PERIOD_S)
    else:
        b, a = bilinear([1.0], [time_s, 1.0], 1.0 / GUST_PERIOD_S)
    step, drive = _companion(b, a)
    variance = solve_discrete_lyapunov(step, np.outer(drive, drive))[0, 0] + b[0] ** 2
    return np.asarray(b * (sigma_mps / math.sqrt(variance))), np.asarray(a)


def _companion(b: Array, a: Array) -> tuple[Array, Array]:
    """Return the state update of lfilter: z' = step z + drive x, output z_0 + b_0 x."""
    step = np.eye(len(a) - 1, k=1)
    step[:, 0] -= a[1:]
    return step, b[1:] - a[1:] * b[0]


class _Axis:
    """One component of the gusts at all positions."""

    def __init__(self, b: Array, a: Array, like: Array) -> None:
        self._b, self._a, self._like = b, a, like
        step, drive = _companion(b, a)
        self._start = np.linalg.cholesky(
            solve_discrete_lyapunov(step, np.outer(drive, drive)) + 1e-15 * np.eye(len(drive))
        )
        self._memory = np.zeros((len(drive), len(like)))

    def begin(self, normals: Array) -> None:
        """Start in the stationary state, from normals (2, V)."""
        self._memory = self._start @ (normals[: len(self._start)] @ self._like.T)

    def shape(self, normals: Array) -> Array:
        """Return gusts (N, V) from normal numbers (N, V)."""
        gusts, self._memory = lfilter(self._b, self._a, normals @ self._like.T, axis=0, zi=self._memory)
        return np.asarray(gusts)
