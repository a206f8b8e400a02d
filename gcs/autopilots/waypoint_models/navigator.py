"""The interface of a waypoint navigator: orders in, one state per time step out. It names no autopilot."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple, Protocol

if TYPE_CHECKING:
    from gcs.types import Array

Vector = tuple[float, float, float]
_STILL = (0.0, 0.0, 0.0)


class NavigatorState(NamedTuple):
    """A vehicle's motion at time `t_s` after the start, and the waypoint completed in this step, if any.

    With that comes how fast the leg to it ended its cruise, over the speed set for the leg: 1 if that was obeyed. A
    flight is doubtful from where the autopilot may react otherwise: until then all `Navigator.reactions` fly alike.
    """

    t_s: float
    position_ned_m: Vector
    velocity_ned_mps: Vector
    acceleration_ned_mps2: Vector
    completed: int | None = None
    obeyed: float = 1.0
    doubtful: bool = False


@dataclass(frozen=True)
class NavigatorOrders:
    """Waypoints in the order of flight, from `start_ned_m`.

    The speed of a leg is set before it begins (DO_CHANGE_SPEED). The vehicle stops at waypoints with a hold, and at
    the last one.
    """

    start_ned_m: Vector
    waypoints_ned_m: tuple[Vector, ...]
    speeds_mps: tuple[float, ...]  # of the leg to each waypoint
    holds_s: tuple[float, ...]
    airborne_s: float = math.inf  # time since take-off at which the first leg begins
    vehicle: NavigatorState | None = None  # its motion at that time; default: at rest at the start

    def __post_init__(self) -> None:
        if not len(self.waypoints_ned_m) == len(self.speeds_mps) == len(self.holds_s) >= 1:
            raise ValueError("orders need at least one waypoint, with one speed and one hold for each")
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
        """Return orders from the first of points (N + 1, 3) through the others, each leg at its speed (N,).

        Raises ValueError if the lengths disagree or a speed is not positive and finite.
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
        """The number of waypoints."""
        return len(self.waypoints_ned_m)

    def stops_at(self, index: int) -> bool:
        """Return whether the vehicle stops at waypoint `index`."""
        return index + 1 >= self.count or self.holds_s[index] > 0.0


@dataclass(frozen=True)
class Ability:
    """The largest motion that a vehicle is capable of, whatever the parameters of its autopilot."""

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
        """The time between two states."""

    @property
    def delay_begins_m(self) -> float:
        """The distance from a waypoint at which its delay begins; 0 where it begins in rest at the waypoint."""

    @property
    def reactions(self) -> tuple[Navigator, ...]:
        """The same navigator at both ends of what the autopilot may do where its reaction is open; empty if nowhere."""

    @property
    def least_obedient(self) -> Navigator:
        """The same navigator where a slow-down is least obeyed."""

    @property
    def parameters(self) -> dict[str, float]:
        """The parameters on board that arrival times rest on, each in its own unit.

        Cruising speed is none of them: a mission sets it for every leg.
        """

    def within(self, ability: Ability) -> Navigator:
        """Return the same navigator for a vehicle with this ability."""

    def disturbance_gain_s2(self, drag_ps: float) -> float:
        """Return the position error over the acceleration that disturbs a vehicle with this drag over mass."""

    def sustained_mps(self, length_m: float) -> float:
        """Return the speed that it sustains over straight legs of this length."""

    def fly(self, orders: NavigatorOrders) -> Iterator[NavigatorState]:
        """Yield every state from the start, without end: after the last waypoint the vehicle stays there."""


def vector(north: float, east: float, down: float) -> Vector:
    """Return three plain floats."""
    return float(north), float(east), float(down)
