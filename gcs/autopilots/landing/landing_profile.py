"""The descent of an autopilot's own landing: a speed for every height, and the height at every time that follows."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from gcs.physics.quadrotor import Array

_STEP_M = 0.02


@dataclass(frozen=True)
class LandingProfile:
    """Speed of descent by height above home, linear between these heights and constant beyond them."""

    heights_m: tuple[float, ...]  # rising
    speeds_mps: tuple[float, ...]  # of the descent, positive
    delay_s: float = 0.0  # from the order until it would begin at full speed: half of the time that it speeds up

    def __post_init__(self) -> None:
        rises = all(low < high for low, high in pairwise(self.heights_m))
        if len(self.heights_m) != len(self.speeds_mps) or not rises or min(self.speeds_mps) <= 0.0:
            raise ValueError(f"a landing profile needs rising heights and positive speeds: {self}")

    def speed_mps(self, height_m: Array) -> Array:
        """Return the speed of descent at these heights above home."""
        return np.asarray(np.interp(height_m, self.heights_m, self.speeds_mps))

    def height_m(self, from_m: float, ground_m: float, since_s: Array) -> Array:
        """Return the heights at times after the order; `from_m` is the height then. All heights are above home."""
        if from_m <= ground_m:
            return np.full(np.shape(since_s), from_m)
        height_m, passed_s = self._table(from_m, ground_m)
        return np.asarray(np.interp(since_s - self.delay_s, passed_s, height_m))

    def duration_s(self, from_m: float, ground_m: float) -> float:
        """Return the time from the order to the ground."""
        return self.delay_s + float(self._table(from_m, ground_m)[1][-1]) if from_m > ground_m else 0.0

    def _table(self, from_m: float, ground_m: float) -> tuple[Array, Array]:
        """Heights (N,), falling, and the times (N,) at which they are passed."""
        height_m = np.linspace(from_m, ground_m, max(2, int(np.ceil((from_m - ground_m) / _STEP_M)) + 1))
        middle_m = (height_m[1:] + height_m[:-1]) / 2
        return height_m, np.concatenate([[0.0], np.cumsum(-np.diff(height_m) / self.speed_mps(middle_m))])


@dataclass(frozen=True)
class LandingBehaviour:
    """How an autopilot lands by itself: the parameters that set its descent, with defaults, and what follows."""

    parameters: Mapping[str, float]
    profile_of: Callable[[Mapping[str, float]], LandingProfile]

    def profile(self, known: Mapping[str, float] | None = None) -> LandingProfile:
        """Return the profile of a vehicle with these parameters; those that are not known have their defaults."""
        given = known or {}
        return self.profile_of({name: given.get(name, value) for name, value in self.parameters.items()})
