"""The descent of an autopilot's own landing: a speed for every height, and the height at every time that follows."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from gcs.physics.quadrotor import Array

_BENT_M = 0.01  # heights between two knots differ by less from the straight line


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
        import numpy as np  # noqa: PLC0415 (the rows of autopilots load without it)

        return np.asarray(np.interp(height_m, self.heights_m, self.speeds_mps))

    def height_m(self, from_m: float, ground_m: float, since_s: Array) -> Array:
        """Return the heights at times after the order; `from_m` is the height then. All heights are above home."""
        import numpy as np  # noqa: PLC0415 (the rows of autopilots load without it)

        passed_s, height_m = self.knots(from_m, ground_m)
        return np.asarray(np.interp(since_s, passed_s, height_m))

    def duration_s(self, from_m: float, ground_m: float) -> float:
        """Return the time from the order to the ground."""
        return float(self.knots(from_m, ground_m)[0][-1])

    def knots(self, from_m: float, ground_m: float) -> tuple[Array, Array]:
        """Return times (N,) after the order and the heights (N,) then; between two of them the speed is constant.

        The last one is on the ground. A vehicle that is not above the ground stays where it is.
        """
        import numpy as np  # noqa: PLC0415 (the rows of autopilots load without it)

        if from_m <= ground_m:
            return np.zeros(1), np.array([from_m])
        inner_m = [height for height in self.heights_m if ground_m < height < from_m]
        times, heights = [0.0, self.delay_s], [from_m, from_m]
        for high_m, low_m in pairwise([from_m, *reversed(inner_m), ground_m]):
            passed_s, height_m = self._piece(high_m, low_m)
            times += (times[-1] + passed_s).tolist()
            heights += height_m.tolist()
        skipped = 0 if self.delay_s > 0.0 else 1
        return np.array(times[skipped:]), np.array(heights[skipped:])

    def _piece(self, high_m: float, low_m: float) -> tuple[Array, Array]:
        """Knots of a descent in which the speed is linear in height; its begin is left out."""
        import numpy as np  # noqa: PLC0415 (the rows of autopilots load without it)

        fast_mps, slow_mps = self.speed_mps(np.array([high_m, low_m])).tolist()
        per_s = (fast_mps - slow_mps) / (high_m - low_m)
        if abs(per_s) * (high_m - low_m) < 1e-6 * slow_mps:
            return np.array([2.0 * (high_m - low_m) / (fast_mps + slow_mps)]), np.array([low_m])
        whole_s = float(np.log(fast_mps / slow_mps)) / per_s
        # A parabola through two knots that are dt apart is a dt^2 / 8 off their straight line.
        step_s = float(np.sqrt(8.0 * _BENT_M / (abs(per_s) * max(fast_mps, slow_mps))))
        count = int(np.ceil(whole_s / step_s))
        passed_s = whole_s * np.arange(1, count + 1) / count
        height_m = high_m - (fast_mps / per_s) * -np.expm1(-per_s * passed_s)
        height_m[-1] = low_m
        return passed_s, height_m


@dataclass(frozen=True)
class LandingBehaviour:
    """How an autopilot lands by itself: the parameters that set its descent, with defaults, and what follows."""

    parameters: Mapping[str, float]
    profile_of: Callable[[Mapping[str, float]], LandingProfile]

    def profile(self, known: Mapping[str, float] | None = None) -> LandingProfile:
        """Return the profile of a vehicle with these parameters; those that are not known have their defaults."""
        given = known or {}
        return self.profile_of({name: given.get(name, value) for name, value in self.parameters.items()})
