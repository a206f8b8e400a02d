"""Rows of the program about the leader's state at the points of a route: distance to the point, and speed."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
from scipy import sparse

from gcs.plan.nlp.assembly import PointFunctions, dm
from gcs.plan.nlp.variables import VariableLayout
from gcs.plan.ocp.problem import Problem
from gcs.plan.trajectory.constraint_id import ConstraintId, Form, Kind
from gcs.types import Array

_MOTION = 6  # position and velocity


@dataclass(frozen=True)
class PointRows:
    """The functions of the rows, their bounds (R,), (R,), ids and times."""

    functions: PointFunctions
    low: Array
    high: Array
    ids: tuple[tuple[ConstraintId, float], ...]


def point_rows(problem: Problem, layout: VariableLayout, unit: Array, shift: Array) -> PointRows | None:
    """The rows of all points with a radius or a speed; None where there are none."""
    rows: list[ca.SX] = []
    ids: list[tuple[ConstraintId, float]] = []
    high: list[float] = []
    columns: list[int] = []
    symbols: list[ca.SX] = []
    for point, joint in zip(problem.points, layout.mesh.arrivals.tolist(), strict=True):
        if not point.radius_m and point.speed_mps is None:
            continue
        motion = ca.SX.sym(f"motion{point.name.number}", _MOTION)
        symbols.append(motion)
        columns += range(layout.joint(joint), layout.joint(joint) + _MOTION)
        t_s = float(layout.mesh.joints_s[joint])
        if point.radius_m:
            away = motion[:3] - ca.DM(point.place_ned_m)
            rows.append(1.0 - ca.dot(away, away) / point.radius_m**2)
            ids.append((ConstraintId(Kind.POINT_DISTANCE, Form.ROW, point.name), t_s))
            high.append(np.inf)
        if point.speed_mps is not None:
            rows.append(ca.dot(motion[3:], motion[3:]) / point.speed_mps**2 - 1.0)
            ids.append((ConstraintId(Kind.POINT_SPEED, Form.ROW, point.name), t_s))
            high.append(0.0)
    if not rows:
        return None
    every, values = ca.vertcat(*symbols), ca.vertcat(*rows)
    multipliers = ca.SX.sym("multipliers", len(rows))
    pick = sparse.csc_matrix((unit[columns], (np.arange(len(columns)), columns)), shape=(len(columns), layout.size))
    functions = PointFunctions(
        dm(pick),
        ca.DM(shift[columns]),
        ca.Function("points", [every], [values]),
        ca.Function("points_jacobian", [every], [ca.jacobian(values, every)]),
        ca.Function("points_hessian", [every, multipliers], [ca.hessian(ca.dot(multipliers, values), every)[0]]),
        len(rows),
    )
    return PointRows(functions, np.zeros(len(rows)), np.array(high), tuple(ids))
