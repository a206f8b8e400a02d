"""The shapes that automatic changes and the course may make of the scheduled one, and the nearest of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gcs.plan.formation.coordinates import target_ned_m
from gcs.scenario.schema.scenario import Scenario
from gcs.types import Array

_BEYOND = 0.05  # share of its range: an automatic change rests a little inside it
_SLACK = 1e-3  # share of its size, as for every limit
_TRIED, _ZOOMS = 21, 6


@dataclass(frozen=True)
class AllowedShapes:
    """How much automatic changes and the course may rotate, scale and blend the scheduled shape."""

    scale: tuple[float, float]
    turn_rad: float  # either way
    blend: tuple[float, float]
    target_ned_m: Array  # (V, 3)

    @classmethod
    def of(cls, scenario: Scenario) -> AllowedShapes | None:
        """The allowed ranges; None where the schedule alone defines the shape."""
        autos = {change.kind: change for change in scenario.formation.change if change.auto}
        if not autos and scenario.formation.frame == "inertial":
            return None
        least = getattr(autos.get("shrink"), "scale", 1.0)
        turn_rad = np.radians(getattr(autos.get("rotate"), "angle_deg", 0.0))
        return cls(
            scale=(least - _SLACK, 1.0 + _BEYOND * (1.0 - least) + _SLACK) if "shrink" in autos else (1.0, 1.0),
            turn_rad=np.pi if scenario.formation.frame == "course" else turn_rad * (1.0 + _SLACK),
            blend=(-_BEYOND - _SLACK, 1.0 + _SLACK) if "reshape" in autos else (0.0, 0.0),
            target_ned_m=target_ned_m(scenario),
        )

    @property
    def ranges(self) -> tuple[tuple[float, float], tuple[float, float], tuple[float, float]]:
        """Least and largest scale, rotation (rad) and blend; a full turn either way is no limit."""
        turn_rad = self.turn_rad if self.turn_rad < np.pi else np.inf
        return self.scale, (-turn_rad, turn_rad), self.blend

    def nearest(self, seen: Array, base: Array) -> tuple[Array, Array, Array]:
        """Scale, rotation (rad) and blend (N,) of the allowed shapes nearest to `seen` (V, N, 3), by least squares.

        `base` (V, N, 3) or (V, 1, 3) is the scheduled shape. For a given blend, the best rotation and scale have
        closed forms; the blend is searched by zooming.
        """
        shapes = (np.broadcast_to(base, seen.shape), np.broadcast_to(self.target_ned_m[:, None], seen.shape))
        flat = [np.sum((s[..., 0] - 1j * s[..., 1]) * (seen[..., 0] + 1j * seen[..., 1]), axis=0) for s in shapes]
        tall = [np.sum(s[..., 2] * seen[..., 2], axis=0) for s in shapes]
        sizes = [[np.einsum("vni,vni->n", s, t) for t in shapes] for s in shapes]

        def fitted(blend: Array) -> tuple[Array, Array, Array]:
            """The best scale and rotation for each blend (B, N), and by how much they lessen the squared distance."""
            shares = (1.0 - blend, blend)
            across = sum(share * part for share, part in zip(shares, flat, strict=True))
            up = sum(share * part for share, part in zip(shares, tall, strict=True))
            size = sum(shares[i] * shares[j] * sizes[i][j] for i in range(2) for j in range(2))
            turn = np.clip(np.angle(across), -self.turn_rad, self.turn_rad)
            alike = (across * np.exp(-1j * turn)).real + up
            scale = np.clip(alike / np.maximum(size, 1e-12), *self.scale)
            return scale, turn, 2.0 * scale * alike - scale**2 * size

        low, high = (np.full(seen.shape[1], end) for end in self.blend)
        for _ in range(_ZOOMS if self.blend[1] > self.blend[0] else 1):
            tried = np.linspace(low, high, _TRIED)  # (tried, N)
            best = np.take_along_axis(tried, fitted(tried)[2].argmax(axis=0)[None], axis=0)[0]
            step = (high - low) / (_TRIED - 1)
            low, high = np.maximum(best - step, self.blend[0]), np.minimum(best + step, self.blend[1])
        scale, turn, _ = (part[0] for part in fitted(best[None]))
        return scale, turn, best
