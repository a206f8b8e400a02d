"""What a navigator is asked to fly, and what it answers, moment by moment.

Knows: places, speeds and instants as plain numbers. Does not know: any autopilot.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple, Protocol

if TYPE_CHECKING:
    from gcs.physics.quadrotor import Array

Vector = tuple[float, float, float]
_STILL = (0.0, 0.0, 0.0)


class NavigatorState(NamedTuple):
    """A vehicle's motion at an instant after the start, and the waypoint that was completed just then, if any."""

    t_s: float
    position_ned_m: Vector
    velocity_ned_mps: Vector
    acceleration_ned_mps2: Vector
    completed: int | None = None


@dataclass(frozen=True)
class NavigatorOrders:
    """Waypoints to fly to one after the other, from `start_ned_m`.

    Before each leg its speed is asked for (DO_CHANGE_SPEED). At a waypoint with a hold, and at the last, it stops.
    """

    start_ned_m: Vector
    waypoints_ned_m: tuple[Vector, ...]
    speeds_mps: tuple[float, ...]  # of the leg to each waypoint
    holds_s: tuple[float, ...]
    airborne_s: float = math.inf  # since take-off, when the first leg begins
    vehicle: NavigatorState | None = None  # how it moves then; default: it stands at the start

    def __post_init__(self) -> None:
        if not len(self.waypoints_ned_m) == len(self.speeds_mps) == len(self.holds_s) >= 1:
            raise ValueError("every waypoint needs one speed and one hold, and there must be one waypoint")
        if not all(0.0 < speed < math.inf for speed in self.speeds_mps):
            raise ValueError(f"speeds must be positive and finite, not {self.speeds_mps}")

    @classmethod
    def through(
        cls,
        points_ned_m: Array,
        speeds_mps: Sequence[float],
        holds_s: Sequence[float] | None = None,
        *,
        airborne_s: float = math.inf,
    ) -> NavigatorOrders:
        """From the first of points (N + 1, 3) through the others, each leg at its speed (N,), without holds.

        Raises ValueError where the lengths disagree or a speed is not positive.
        """
        start, *waypoints = (vector(*row) for row in points_ned_m.tolist())
        holds = tuple(holds_s) if holds_s is not None else (0.0,) * len(waypoints)
        return cls(start, tuple(waypoints), tuple(map(float, speeds_mps)), holds, airborne_s)

    @property
    def begins(self) -> NavigatorState:
        """The vehicle's motion when the first leg begins."""
        return self.vehicle or NavigatorState(0.0, self.start_ned_m, _STILL, _STILL)

    @property
    def count(self) -> int:
        """Number of waypoints."""
        return len(self.waypoints_ned_m)

    def stops_at(self, index: int) -> bool:
        """Whether waypoint `index` is the end of a leg that the next does not join."""
        return index + 1 >= self.count or self.holds_s[index] > 0.0


@dataclass(frozen=True)
class Ability:
    """What a vehicle can do at most, whatever its autopilot is set to."""

    horizontal_mps: float = math.inf
    vertical_mps: float = math.inf
    horizontal_mps2: float = math.inf
    vertical_mps2: float = math.inf
    horizontal_mps3: float = math.inf
    horizontal_mps4: float = math.inf


UNLIMITED = Ability()


class Navigator(Protocol):
    """The waypoint navigator of one autopilot, with its parameters."""

    @property
    def step_s(self) -> float:
        """From one moment to the next."""

    def within(self, ability: Ability) -> Navigator:
        """The same navigator of a vehicle that can do no more than this."""

    def sustained_mps(self, length_m: float) -> float:
        """The speed it keeps up over straight legs of this length."""

    def fly(self, orders: NavigatorOrders) -> Iterator[NavigatorState]:
        """Every moment from the start on, without end: after the last waypoint the vehicle stays there."""


def vector(north: float, east: float, down: float) -> Vector:
    """Three plain floats."""
    return float(north), float(east), float(down)
