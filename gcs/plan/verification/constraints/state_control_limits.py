"""Speeds, attitude, rates, controls, rotor speeds and turns (Eqs. 1, 2, 17, 18, 25, 51) of every vehicle.

Where the shape is rigid and the wind is the same at every height, all vehicles have the leader's velocity, attitude and
control: one bound holds for all.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from gcs.physics.quadrotor import equations_of_motion, squared_rotor_speeds
from gcs.plan.formation.follower_equations import follower_state_and_control, jerk
from gcs.plan.formation.followers import rounded_thrust_polynomial
from gcs.plan.trajectory.constraint_id import CONTROLS, STATES, ConstraintId, Kind
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.proof.polynomials import distinct, enclosed
from gcs.plan.verification.proof.subdivision import SHORTEST_S, Cells, Mask, Rows, halved, joined
from gcs.plan.verification.proof.taylor import FUNCTIONS, Taylor, total
from gcs.plan.verification.proof.vehicle_tree import VehicleTree, enclosed_offsets
from gcs.plan.verification.proof.verdict import LIMIT_TOLERANCE, NamedConstraint
from gcs.scenario.values.si import torque_limits
from gcs.types import Array

ORDER = 2
_RESOLUTION = 2.5e-4
# Below this speed the direction of flight, and with it the turning radius of Eq. 18, loses its meaning.
REST_SPEED_MPS = 0.1
_GROUP_M_PER_S = 5.0  # a group is divided before time while its members are farther apart than a vehicle flies


@dataclass(frozen=True)
class StateControlLimits:
    """The family of the leader alone, or of all vehicles by groups of a tree (`tree`)."""

    plan: Plan
    tree: VehicleTree | None
    mission: int  # number of the mission's phase

    @cached_property
    def constraints(self) -> tuple[NamedConstraint, ...]:
        """In the order of the margins."""
        limits, formation = self.plan.scenario.limits, self.plan.scenario.formation
        sizes = (*limits.speed_ned_mps, *limits.roll_pitch_yaw_deg, *limits.rates_degps)
        units = ("m/s",) * 3 + ("deg",) * 3 + ("deg/s",) * 3
        found = [_limit(*named) for named in zip(STATES[3:], units, sizes, strict=True)]
        most_of_controls = (max(limits.thrust_N), *self._torques)
        found += [_limit(*named) for named in zip(CONTROLS, ("N", "N", "N", "N m"), most_of_controls, strict=True)]
        found += [
            _limit(Kind.ROTOR_SPEED, "of the squared maximum", 1.0),
            _limit(Kind.TURNING, "g", limits.load_factor_max),
        ]
        if limits.accel_max_mps2 is not None:
            found.append(_limit(Kind.ACCELERATION, "m/s2", limits.accel_max_mps2))
        if limits.jerk_max_mps3 is not None:
            found.append(_limit(Kind.JERK, "m/s3", limits.jerk_max_mps3))
        if self.tree is not None:
            found += [
                _limit(Kind.SHAPE_SPEED, "m/s", formation.change_speed_mps),
                _limit(Kind.SHAPE_ACCELERATION, "m/s2", formation.change_accel_mps2),
            ]
        return tuple(found)

    @cached_property
    def _torques(self) -> tuple[float, float, float]:
        return torque_limits(self.plan.scenario.limits, self.plan.scenario.vehicle.arm_m)

    def bounds(self, cells: Cells) -> tuple[Array, Array]:
        """See `Family`."""
        state, control = self._motion(cells)
        scenario, q = self.plan.scenario, self.plan.quadrotor
        limits = scenario.limits
        sizes = np.array([*limits.speed_ned_mps, *limits.roll_pitch_yaw_deg, *limits.rates_degps])
        margins = [
            _within(value if i < 3 else value * float(np.degrees(1.0)), size)
            for i, (value, size) in enumerate(zip(state[3:], sizes, strict=True))
        ]
        low_N, high_N = limits.thrust_N
        margins.append(_between(control[0], low_N, high_N))
        margins += [_within(u, size) for u, size in zip(control[1:], self._torques, strict=True)]
        rotors = [w * (1.0 / q.rotor_max_radps**2) for w in squared_rotor_speeds(control, q)]
        each = [_between(w, 0.0, 1.0) for w in rotors]
        margins.append((np.min([e[0] for e in each], axis=0), np.min([e[1] for e in each], axis=0)))
        moved = equations_of_motion(state, control, q, xp=FUNCTIONS)
        margins.append(_turning(state, moved, limits.load_factor_max, q.gravity_mps2))
        if limits.accel_max_mps2 is not None:
            margins.append(_shorter(moved[3:6], limits.accel_max_mps2))
        if limits.jerk_max_mps3 is not None:
            margins.append(_shorter(self._jerk(cells), limits.jerk_max_mps3))
        if self.tree is not None:
            formation = scenario.formation
            outside = cells.phase != self.mission
            for derivative, most in ((1, formation.change_speed_mps), (2, formation.change_accel_mps2)):
                offset = self._offsets(cells, derivative)
                low, seen = _shorter(offset, most)
                margins.append((np.where(outside, np.inf, low), np.where(outside, np.inf, seen)))
        return np.stack([m[0] for m in margins]), np.stack([m[1] for m in margins])

    def children(self, cells: Cells, chosen: Mask) -> tuple[Cells, Rows]:
        """See `Family`: first the group, then the time is divided."""
        return divided(cells, chosen, self.tree)

    def row(self, who: Rows) -> int:
        """See `Family`."""
        return self.plan.leader if self.tree is None else int(self.tree.row[who[0]])

    def _offsets(self, cells: Cells, derivative: int) -> list[Taylor]:
        assert self.tree is not None
        found = enclosed_offsets(
            self.plan.shape, self.tree, cells.who[:, 0], cells.start_s, cells.end_s, ORDER, derivative
        )
        return [found[axis] for axis in range(3)]

    def _jerk(self, cells: Cells) -> list[Taylor]:
        """The leader's jerk by Eq. 1, and for every vehicle that of its offset as well."""
        leader = self.plan.leader_trajectory
        start_s, end_s, which = distinct(cells.start_s, cells.end_s)
        x = enclosed(leader.state, start_s, end_s, ORDER)
        u = enclosed(leader.control, start_s, end_s, ORDER)
        rate = enclosed(leader.control, start_s, end_s, ORDER, 1)[0]
        moved = jerk([x[i] for i in range(12)], [u[i] for i in range(4)], rate, self.plan.quadrotor, FUNCTIONS)
        own = [part[which] for part in moved]
        if self.tree is None:
            return own
        return [part + offset for part, offset in zip(own, self._offsets(cells, 3), strict=True)]

    def _motion(self, cells: Cells) -> tuple[list[Taylor], list[Taylor]]:
        leader = self.plan.leader_trajectory
        x = enclosed(leader.state, cells.start_s, cells.end_s, ORDER)
        u = enclosed(leader.control, cells.start_s, cells.end_s, ORDER)
        state, control = [x[i] for i in range(12)], [u[i] for i in range(4)]
        if self.tree is None:
            return state, control
        rounded = rounded_thrust_polynomial(leader.control)
        thrust = tuple(enclosed(rounded, cells.start_s, cells.end_s, ORDER, n)[0] for n in range(3))
        offsets = [self._offsets(cells, n) for n in range(5)]
        q = self.plan.quadrotor
        moved = follower_state_and_control(state, control, thrust, offsets, q, FUNCTIONS)  # type: ignore[arg-type]
        return list(moved[0]), list(moved[1])


def divided(cells: Cells, wanted: Mask, tree: VehicleTree | None) -> tuple[Cells, Rows]:
    """The parts of cells of single groups: of the group where its members are far apart, else of the time."""
    length_s = cells.end_s - cells.start_s
    split = np.zeros(len(cells), dtype=bool)
    if tree is not None:
        group = cells.who[:, 0]
        whole = tree.parts[group, 0] >= 0
        split = whole & ((tree.reach_m[group] > _GROUP_M_PER_S * length_s) | (length_s <= SHORTEST_S))
    split &= wanted
    longer = wanted & ~split & (length_s > SHORTEST_S)
    by_time = halved(cells[longer])
    origin = [np.flatnonzero(longer)] * 2
    parts = [by_time]
    if tree is not None and split.any():
        chosen = cells[split]
        for side in (0, 1):
            who = tree.parts[chosen.who[:, 0], side][:, None]
            parts.append(replace(chosen, who=who))
            origin.append(np.flatnonzero(split))
    return joined(parts), np.concatenate(origin)


def _limit(kind: Kind, unit: str, size: float) -> NamedConstraint:
    return NamedConstraint(LIMIT_TOLERANCE * size, _RESOLUTION * size, ConstraintId(kind), unit)


def _within(value: Taylor, size: float) -> tuple[Array, Array]:
    return size - value.size(), size - np.abs(value.middle)


def _between(value: Taylor, low: float, high: float) -> tuple[Array, Array]:
    least, most = value.range()
    return np.minimum(least - low, high - most), np.minimum(value.middle - low, high - value.middle)


def _shorter(vector: list[Taylor] | tuple[Taylor, ...], most: float) -> tuple[Array, Array]:
    """The margin of a vector's length."""
    squared = total([part.square() for part in vector])
    length = np.sqrt(np.maximum(squared.range()[1], 0.0))
    return most - length, most - np.sqrt(sum(part.middle**2 for part in vector))


def _turning(state: list[Taylor], moved: tuple[Taylor, ...], most: float, gravity: float) -> tuple[Array, Array]:
    """The margin of the load factor |v x a| / |v| in the horizontal plane, in g; |v| counts as 0.1 m/s at least."""
    cross = state[3] * moved[4] - state[4] * moved[3]
    squared = state[3].square() + state[4].square()
    bound = (most * gravity) ** 2
    slow = REST_SPEED_MPS**2
    least, largest = squared.range()
    spare = (squared * bound - cross.square()).low()  # bound |v|^2 - (v x a)^2
    steady = (bound * slow - cross.square()).low() / slow
    moving = least > 0.0
    slowest, fastest = np.where(moving, least, 1.0), np.maximum(largest, slow)
    flown = np.where(spare >= 0.0, spare / fastest, np.where(moving, spare / slowest, -np.inf))
    highest = np.sqrt(np.maximum(bound - np.maximum(flown, steady), 0.0))
    speed = np.maximum(np.sqrt(state[3].middle ** 2 + state[4].middle ** 2), REST_SPEED_MPS)
    return most - highest / gravity, most - np.abs(cross.middle) / speed / gravity
