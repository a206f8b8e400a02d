"""The formation's degrees of freedom (scale, heading, blend) that the optimiser moves: ranges, rates, resulting shape.

    offset = scale * Rz(heading) * ((1 - blend) * base + blend * target)

Each ends a chain of four integrators, as a quadrotor's position does in Eq. 1. Every follower's attitude, rates and
moments are then as smooth as the leader's.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PPoly

from gcs.errors import Infeasible
from gcs.plan.formation.reshape import reshape
from gcs.plan.formation.shape import Shape
from gcs.plan.formation.time_scaling import Budget, budget, shared
from gcs.scenario.schema.scenario import ChangeTable, Scenario
from gcs.scenario.values.si import leader_index, offsets_ned_m, shape_offsets_ned_m
from gcs.types import Array


class CoordinateName(StrEnum):
    """What a coordinate does to the shape."""

    SCALE = "scale"
    HEADING = "heading"
    BLEND = "blend"


ORDER = 4  # integrators from the control (a snap) to the coordinate
COORDINATE_OF_CHANGE = {
    "shrink": CoordinateName.SCALE,
    "rotate": CoordinateName.HEADING,
    "reshape": CoordinateName.BLEND,
}
_DEFAULT_WEIGHT = 0.3
# An interior-point method never reaches a bound: rest lies this far inside, in units, so that it is reached exactly.
_BEYOND = 0.05
_FREE_RAD = 20.0  # heading with the course: turns add up
# Terms of the Taylor series, and greatest length of a piece, that represent products and cosines of the coordinates.
_PIECE_S, _TERMS = 2.0, 22


@dataclass(frozen=True)
class Coordinate:
    """One degree of freedom of the shape."""

    name: CoordinateName
    low: float
    high: float
    most: tuple[float, float, float, float]  # largest rate, acceleration, jerk and snap, either way
    unit: float  # departure from rest that costs `weight` when it lasts the whole flight
    weight: float  # in units of Eq. 35; 0 where another term drives the coordinate
    free_end: bool  # otherwise it ends at rest

    @property
    def rest(self) -> float:
        """The value that leaves the base shape unchanged."""
        return 1.0 if self.name is CoordinateName.SCALE else 0.0


def coordinates(scenario: Scenario) -> tuple[Coordinate, ...]:
    """The coordinates of a scenario: its automatic changes, and the heading with `frame = "course"`."""
    autos = [change for change in scenario.formation.change if change.auto]
    follows_course = scenario.formation.frame == "course"
    limit, size_m = budget_of_each(scenario), _extent_m(scenario)
    made = [_automatic(scenario, change, limit, size_m) for change in autos]
    if follows_course:
        most = _most(limit, size_m)
        made.append(Coordinate(CoordinateName.HEADING, -_FREE_RAD, _FREE_RAD, most, 1.0, 0.0, free_end=True))
    return tuple(made)


def budget_of_each(scenario: Scenario) -> Budget:
    """The budget of one change, shared with every other change that may happen at the same time."""
    autos = [change.kind for change in scenario.formation.change if change.auto]
    if scenario.formation.frame == "course":
        autos.append("rotate")
    parts = len(autos) + (not all(change.auto for change in scenario.formation.change))
    if not autos or (parts == 1 and "rotate" not in autos):
        return budget(scenario)
    return shared(budget(scenario), parts, _extent_m(scenario))


def target_ned_m(scenario: Scenario) -> Array:
    """The shape (V, 3) to which the blend leads, with assigned places; the base shape where nothing blends.

    Raises Infeasible where vehicles on the straight paths there would come too near each other.
    """
    base = offsets_ned_m(scenario)
    for change in scenario.formation.change:
        if change.auto and change.to is not None:
            made = reshape(
                base,
                shape_offsets_ned_m(scenario, change.to),
                leader_index(scenario),
                scenario.limits.separation_min_m,
                fixed=change.assignment == "fixed",
                sysids=scenario.formation.sysids,
            )
            if len(made.legs) > 1:
                raise Infeasible(
                    f'no straight path from the start to the shape "{change.to}" keeps '
                    f"{scenario.limits.separation_min_m:g} m; the only solution is {made.way}",
                    hint="trigger the change by a time or a gate instead of auto, or give the shapes more spacing",
                )
            return made.offsets_after_ned_m
    return base


def bent(
    values: Mapping[CoordinateName, Any], base: Sequence[Any], target: Sequence[Any], xp: Any = np
) -> tuple[Any, Any, Any]:
    """Offset (north, east, down) of one vehicle, on arrays or symbols; `values` holds the existing coordinates."""
    n, e, d = base
    if (blend := values.get(CoordinateName.BLEND)) is not None:
        n, e, d = (b + blend * (t - b) for b, t in zip(base, target, strict=True))
    if (heading := values.get(CoordinateName.HEADING)) is not None:
        c, s = xp.cos(heading), xp.sin(heading)
        n, e = c * n - s * e, s * n + c * e
    if (scale := values.get(CoordinateName.SCALE)) is not None:
        n, e, d = scale * n, scale * e, scale * d
    return n, e, d


def composed(base: Shape, target: Array, names: Sequence[CoordinateName], values: PPoly) -> Shape:
    """The shape over time (C3) from a base shape and coordinates `values` (coefficients (C+1, P, A)).

    Three tables for every table of the base: the cosine part, the sine part, and the vertical part.
    """
    blending = CoordinateName.BLEND in names
    joints = np.union1d(values.x, base.joints_s)
    counts = np.ceil(np.diff(joints) / _PIECE_S).astype(int)  # long pieces are cut into equal parts
    parts = [np.linspace(a, b, n, endpoint=False) for a, b, n in zip(joints[:-1], joints[1:], counts, strict=True)]
    joints = np.concatenate([*parts, joints[-1:]])
    flat = np.array([1.0, 1.0, 0.0])
    quarter = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])  # row vectors: (n, e) -> (-e, n)
    tables = np.concatenate([base.basis_ned_m, target[None]]) if blending else base.basis_ned_m
    series = _taylor(values, joints[:-1])
    q = {name: series[..., i] for i, name in enumerate(names)}
    own = _taylor(base.functions, joints[:-1])
    if blending:
        blend = q[CoordinateName.BLEND][..., None]
        own = np.concatenate([own - _product(blend, own), blend], axis=2)
    if CoordinateName.SCALE in q:
        own = _product(q[CoordinateName.SCALE][..., None], own)
    turn = _turn(q.get(CoordinateName.HEADING, np.zeros(own.shape[:2])))[..., None]
    turned = _product(turn, own)
    basis = np.concatenate([tables * flat, tables @ quarter, tables * (1.0 - flat)])
    functions = np.concatenate([turned.real, turned.imag, own], axis=2)
    return Shape(PPoly(np.ascontiguousarray(functions[::-1]), joints), basis)


def _automatic(scenario: Scenario, change: ChangeTable, limit: Budget, size_m: float) -> Coordinate:
    name = COORDINATE_OF_CHANGE[change.kind]
    weight = change.weight if change.weight is not None else _DEFAULT_WEIGHT
    if name is CoordinateName.SCALE:
        assert change.scale is not None
        unit = 1.0 - change.scale
        return Coordinate(name, change.scale, 1.0 + _BEYOND * unit, _most(limit, size_m), unit, weight, False)
    if name is CoordinateName.HEADING:
        assert change.angle_deg is not None
        angle = abs(float(np.radians(change.angle_deg)))
        return Coordinate(name, -angle, angle, _most(limit, size_m), angle, weight, False)
    target = target_ned_m(scenario)
    travel_m = float(np.linalg.norm(target - offsets_ned_m(scenario), axis=1).max())
    if not all(other.auto for other in scenario.formation.change):  # the blend may begin anywhere then
        travel_m = float(np.linalg.norm(target, axis=1).max()) + size_m
    return Coordinate(name, -_BEYOND, 1.0, _most(limit, travel_m), 1.0, weight, False)


def _most(limit: Budget, length_m: float) -> tuple[float, float, float, float]:
    length = max(length_m, 1e-6)
    return (limit.speed_mps / length, limit.accel_mps2 / length, limit.jerk_mps3 / length, limit.snap_mps4 / length)


def _extent_m(scenario: Scenario) -> float:
    """The greatest distance of any vehicle from the leader, in any shape and at any scale of the scenario."""
    shapes = [offsets_ned_m(scenario), *(shape_offsets_ned_m(scenario, s.name) for s in scenario.formation.shape)]
    grown = [c.scale for c in scenario.formation.change if c.scale is not None and c.scale > 1.0]
    return float(np.linalg.norm(np.stack(shapes), axis=2).max() * np.prod(grown))


def _taylor(functions: PPoly, t_s: Array) -> Array:
    """Taylor coefficients (_TERMS, N, K) to the right of instants (N,), lowest first."""
    return np.stack([functions(t_s, nu=n) / math.factorial(n) for n in range(_TERMS)])


def _product(a: Any, b: Any) -> Any:
    """Taylor coefficients of a product."""
    return np.stack([sum(a[k] * b[n - k] for k in range(n + 1)) for n in range(_TERMS)])


def _turn(angle: Array) -> NDArray[np.complex128]:
    """Taylor coefficients of exp(i angle): e' = i angle' e, term by term."""
    turn = np.zeros(angle.shape, dtype=np.complex128)
    turn[0] = np.exp(1j * angle[0])
    for n in range(1, _TERMS):
        turn[n] = sum(1j * k / n * angle[k] * turn[n - k] for k in range(1, n + 1))
    return turn
