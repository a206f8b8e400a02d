"""The rest of a plan at another pace: the same places one after another, slower, up to a stop, or from one.

A pace is plan time of the old plan over that of the new one. Places, shape and heading at each instant are those of the
old plan, so distances to ground, zones and other vehicles are too; speeds, tilt and thrust follow from the pace.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.interpolate import PPoly

from gcs.physics.quadrotor import Quadrotor, equations_of_motion
from gcs.plan.formation.follower_equations import leader_jets
from gcs.plan.formation.followers import rounded_thrust_polynomial
from gcs.plan.formation.shape import Rows, Shape
from gcs.plan.trajectory.flown_motion import MotionJets, fitted, flown, nodes, values_at
from gcs.plan.trajectory.trajectory import Trajectory
from gcs.types import Array

# From one rate to another, highest power first: a step without slope, bend and jerk at its ends, which moments follow;
# and its integral.
_STEP = np.array([-20.0, 70.0, -84.0, 35.0, 0.0, 0.0, 0.0, 0.0])
_PASSED = np.append(_STEP / np.arange(8.0, 0.0, -1.0), 0.0)
STEEPEST = 35.0 / 16.0  # slope of the step
# The longest polynomials: of the leader and of the shape while the pace changes, and while it does not.
_LEADER_S, _SHAPE_S, _STEADY_S = 1.0, 0.4, 6.0
_SAME_S = 1e-9


@dataclass(frozen=True)
class PlanPace:
    """Times of an old plan (PPoly of one component) over those of the new one. It never runs back."""

    old_s: PPoly

    @property
    def start_s(self) -> float:
        """First instant of the new plan."""
        return float(self.old_s.x[0])

    @property
    def end_s(self) -> float:
        """Last instant of the new plan."""
        return float(self.old_s.x[-1])

    def new_s(self, old_s: Array) -> Array:
        """When (N,) the new plan is where the old one was at instants (N,) within the pace: the first time."""
        low, high = np.full(len(old_s), self.start_s), np.full(len(old_s), self.end_s)
        for _ in range(60):
            middle = 0.5 * (low + high)
            is_before = self.old_s(middle)[:, 0] < old_s
            low, high = np.where(is_before, middle, low), np.where(is_before, high, middle)
        return np.asarray(0.5 * (low + high))


def pace(start_s: float, old_s: float, parts: Sequence[tuple[float, float, float]]) -> PlanPace:
    """The pace that begins at `old_s` of the old plan. Each part has its seconds, and its rates at begin and end."""
    joints, coefficients = [start_s], []
    for seconds, before, after in parts:
        piece = (after - before) * seconds * _PASSED / seconds ** np.arange(8.0, -1.0, -1.0)
        piece[-2] += before
        piece[-1] += old_s
        coefficients.append(piece)
        joints.append(joints[-1] + seconds)
        old_s += 0.5 * (before + after) * seconds
    return PlanPace(PPoly(np.array(coefficients).T[..., None], np.array(joints)))


def paced(leader: Trajectory, kept: PlanPace, q: Quadrotor) -> Trajectory:
    """The leader's trajectory at a pace."""
    thrust = rounded_thrust_polynomial(leader.control)
    joints = _joints(kept, leader.joints_s, _LEADER_S)
    number = _pieces(leader.joints_s, kept, joints)

    def motion(t_s: Array) -> MotionJets:
        flat = np.clip(t_s, joints[0], joints[-1]).ravel()
        old_s, r, r1, r2, r3 = (kept.old_s(flat, nu=order).reshape(t_s.shape) for order in range(5))
        left_s = old_s - leader.joints_s[number][:, None]
        x, u = (
            tuple(np.moveaxis(values_at(part.c[:, number], left_s), -1, 0)) for part in (leader.state, leader.control)
        )
        bent = thrust(old_s)[..., 0], thrust(old_s, nu=1)[..., 0], thrust(old_s, nu=2)[..., 0]
        a, j, s, turn = leader_jets(x, u, bent, q)
        v, fall = np.stack(x[3:6]), equations_of_motion(x, u, q)[5]
        jets = (
            np.stack(x[:3]),
            v * r,
            a * r**2 + v * r1,
            j * r**3 + 3.0 * a * r * r1 + v * r2,
            s * r**4 + 6.0 * j * r**2 * r1 + a * (4.0 * r * r2 + 3.0 * r1**2) + v * r3,
        )
        return MotionJets(jets, fall * r**2 + v[2] * r1, (x[8], x[11] * r, turn * r**2 + x[11] * r1))

    return flown(joints, motion, q)


def paced_shape(shape: Shape, kept: PlanPace) -> Shape:
    """The shape at a pace. Where it was rigid, it is rigid to the last bit."""
    joints = _joints(kept, shape.joints_s, _SHAPE_S)
    number = _pieces(shape.joints_s, kept, joints)
    t_s = nodes(joints)
    old_s = kept.old_s(np.clip(t_s, joints[0], joints[-1]).ravel()).reshape(t_s.shape)
    values = values_at(shape.functions.c[:, number], old_s - shape.joints_s[number][:, None])
    coefficients = fitted(joints, values)
    stays = ~np.any(shape.functions.c[:-1, number], axis=(0, 2))
    coefficients[:-1, stays] = 0.0
    coefficients[-1, stays] = shape.functions.c[-1, number[stays]]
    return Shape(PPoly(coefficients, joints), shape.basis_ned_m)


def _joints(kept: PlanPace, old_joints_s: Array, longest_s: float) -> Array:
    """Joints of the new polynomials: of the old ones, where the pace changes, and often enough while it does."""
    first, last = (float(kept.old_s(t_s)[0]) for t_s in (kept.start_s, kept.end_s))
    within = old_joints_s[(old_joints_s > first + _SAME_S) & (old_joints_s < last - _SAME_S)]
    edges = np.unique(np.concatenate([kept.new_s(within), kept.old_s.x]))
    edges = edges[np.append(np.diff(edges) > _SAME_S, True)]
    edges[0] = kept.start_s
    changes = np.any(kept.old_s.c[:-2], axis=(0, 2))
    parts = []
    for a, b in pairwise(edges.tolist()):
        piece = np.searchsorted(kept.old_s.x, 0.5 * (a + b), side="right") - 1
        longest = longest_s if changes[piece] else _STEADY_S
        parts.append(np.linspace(a, b, max(int(np.ceil((b - a) / longest)), 1), endpoint=False))
    return np.concatenate([*parts, edges[-1:]])


def _pieces(old_joints_s: Array, kept: PlanPace, joints_s: Array) -> Rows:
    """The old polynomial (P,) of each new one."""
    middle = kept.old_s(0.5 * (joints_s[:-1] + joints_s[1:]))[:, 0]
    return np.asarray(np.clip(np.searchsorted(old_joints_s, middle, side="right") - 1, 0, len(old_joints_s) - 2))
