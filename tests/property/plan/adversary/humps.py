"""Plans with one short hump more: one polynomial of a plan becomes three, the middle one with a smooth bump on top."""

from __future__ import annotations

from dataclasses import replace
from math import factorial

import numpy as np
from scipy.interpolate import PPoly

from gcs.plan.formation.shape import Shape
from gcs.plan.trajectory.plan import Plan
from gcs.plan.trajectory.trajectory import Trajectory
from gcs.types import Array


def hump(start_s: float, width_s: float, smooth: int) -> PPoly:
    """(4 s (1 - s))^(smooth + 1) on its width: one at its top; `smooth` derivatives are zero at its ends."""
    power = np.poly1d([-4.0, 4.0, 0.0]) ** (smooth + 1)
    return PPoly((power.c / width_s ** np.arange(power.order, -1.0, -1.0))[:, None], [start_s, start_s + width_s])


def leader_state(plan: Plan, row: int, size: float, top: PPoly) -> Plan:
    """A hump in one component of the leader's state."""
    old = plan.leader_trajectory
    state = _added(old.state, top, row, size)
    return replace(plan, leader_trajectory=Trajectory(state, _cut(old.control, state.x)))


def leader_control(plan: Plan, row: int, size: float, top: PPoly) -> Plan:
    """A hump in one of the leader's controls."""
    old = plan.leader_trajectory
    control = _added(old.control, top, row, size)
    return replace(plan, leader_trajectory=Trajectory(_cut(old.state, control.x), control))


def offset(plan: Plan, vehicle: int, by_ned_m: Array, top: PPoly) -> Plan:
    """A hump in one vehicle's place within the shape."""
    every = np.zeros(plan.shape.basis_ned_m.shape[1:])
    every[vehicle] = by_ned_m
    return offsets(plan, every, top)


def offsets(plan: Plan, by_ned_m: Array, top: PPoly) -> Plan:
    """A hump in the places (V, 3) of all vehicles within the shape."""
    old = plan.shape
    tables = np.concatenate([old.basis_ned_m, by_ned_m[None]])
    wide = PPoly(np.pad(old.functions.c, ((0, 0), (0, 0), (0, 1))), old.functions.x)
    return replace(plan, shape=Shape(_added(wide, top, len(tables) - 1, 1.0), tables))


def _added(part: PPoly, top: PPoly, column: int, size: float) -> PPoly:
    """The same functions with `size` times the hump on one of them."""
    joints = np.union1d(part.x, top.x)
    cut = _cut(part, joints)
    rise = _cut(PPoly(top.c[..., None], top.x), joints[(joints >= top.x[0]) & (joints <= top.x[-1])])
    degree = max(len(cut.c), len(rise.c))
    c = np.pad(cut.c, ((degree - len(cut.c), 0), (0, 0), (0, 0)))
    first = int(np.searchsorted(joints, top.x[0]))
    c[degree - len(rise.c) :, first : first + rise.c.shape[1], column] += size * rise.c[..., 0]
    return PPoly(c, joints)


def _cut(part: PPoly, joints: Array) -> PPoly:
    """The same functions on more joints; a polynomial whose begin stays keeps its coefficients."""
    order = len(part.c) - 1
    c = np.stack([part(joints[:-1], nu=k) / factorial(k) for k in range(order, -1, -1)])
    kept = np.flatnonzero(np.isin(joints[:-1], part.x[:-1]))
    c[:, kept] = part.c[:, np.searchsorted(part.x[:-1], joints[kept])]
    return PPoly(c, joints)
