"""Positions of vehicles at the start of a return, bounded over an interval of start times.

Plans are piecewise polynomials of time. So their Taylor coefficients about the middle of an interval bound how far each
vehicle is from its middle place, and how much two vehicles move against each other.
"""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import PPoly

from gcs.physics.states import POSITION
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.proof.polynomials import scaled_coefficients
from gcs.plan.verification.proof.subdivision import Rows
from gcs.types import Array

_ROUNDING_M = 1e-9


@dataclass(frozen=True)
class Starts:
    """Where M returns may begin: the place in the middle of their interval, and how far others are from it."""

    place_ned_m: Array  # (M, 3)
    level_m: Array  # (M,) horizontal distance, at most
    vertical_m: Array  # (M,)


@dataclass(frozen=True)
class StartCells:
    """N intervals of start times, and how the fleet moves in them, by powers of the scaled time."""

    begin_s: Array  # (N,)
    end_s: Array
    leader_m: Array  # (C, N, 3)
    functions: Array  # (C, N, K) of the shape
    tables_m: Array  # (K, V, 3)

    @property
    def middle_s(self) -> Array:
        """The middle (N,) of each interval."""
        return 0.5 * (self.begin_s + self.end_s)

    @property
    def fleet(self) -> tuple[Array, Array]:
        """Of all vehicles in all intervals: the middle places (V, N, 3), and horizontal distances (V, N) from them."""
        shape = self.tables_m.shape[1], len(self.begin_s)
        found = self.starts(*(index.ravel() for index in np.indices(shape)))
        return found.place_ned_m.reshape(*shape, 3), found.level_m.reshape(shape)

    def starts(self, vehicle: Rows, cell: Rows) -> Starts:
        """The starts of vehicles (M,) in cells (M,)."""
        powers = self.leader_m[:, cell] + np.einsum("cmk,kma->cma", self.functions[:, cell], self.tables_m[:, vehicle])
        away = powers[1:]
        level_m = np.hypot(away[..., 0], away[..., 1]).sum(axis=0) + _ROUNDING_M
        return Starts(powers[0], level_m, np.abs(away[..., 2]).sum(axis=0) + _ROUNDING_M)

    def against(self, first: Rows, second: Rows, cell: Rows) -> tuple[Array, Array]:
        """How far, level and vertically (M,), two vehicles move against each other within cells (M,)."""
        apart = self.tables_m[:, second] - self.tables_m[:, first]  # (K, M, 3)
        moved = np.abs(np.einsum("cmk,kma->cma", self.functions[1:, cell], apart))
        return np.hypot(moved[..., 0], moved[..., 1]).sum(axis=0), moved[..., 2].sum(axis=0)


def start_cells(plan: Plan, begin_s: Array, end_s: Array) -> StartCells:
    """The cells of intervals (N,), none of which reaches over a joint of the plan."""
    state = plan.leader_trajectory.state
    leader = PPoly(np.ascontiguousarray(state.c[:, :, POSITION]), state.x)
    leader_m = scaled_coefficients(leader, begin_s, end_s)
    functions = scaled_coefficients(plan.shape.functions, begin_s, end_s)
    more = len(leader_m) - len(functions)
    leader_m = np.pad(leader_m, ((0, max(-more, 0)), (0, 0), (0, 0)))
    functions = np.pad(functions, ((0, max(more, 0)), (0, 0), (0, 0)))
    return StartCells(begin_s, end_s, leader_m, functions, plan.shape.basis_ned_m)


def plan_intervals(plan: Plan, longest_s: float) -> tuple[Array, Array]:
    """Begins and ends (N,) of intervals between the joints of a plan, none longer than `longest_s`."""
    joints_s = np.union1d(plan.leader_trajectory.joints_s, plan.shape.joints_s)
    joints_s = joints_s[(joints_s >= plan.t_start_s) & (joints_s <= plan.t_end_s)]
    counts = np.ceil(np.diff(joints_s) / longest_s).astype(int)
    edges = [
        np.linspace(a, b, n, endpoint=False) for a, b, n in zip(joints_s[:-1], joints_s[1:], counts, strict=True) if n
    ]
    marks = np.concatenate([*edges, joints_s[-1:]])
    return marks[:-1], marks[1:]
