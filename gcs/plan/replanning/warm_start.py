"""Multipliers as functions of time: those of one mesh, interpolated to another, for a warm start.

A row of collocation weights the costate at its node (covector mapping of the Gauss method); other multipliers are
densities over time.
"""

from dataclasses import dataclass

import numpy as np

from gcs.plan.nlp.gauss import gauss_rule
from gcs.plan.nlp.ipopt import Solution
from gcs.plan.nlp.transcription import Program
from gcs.plan.trajectory.constraint_id import ConstraintId
from gcs.types import Array


@dataclass(frozen=True)
class Multipliers:
    """Multipliers over time: of Eq. 1, of each row of the path, of the limits of state and control."""

    t_s: Array  # (N + M,) nodes and joints after the first
    costate: Array  # (N + M, nx)
    node_s: Array  # (N,)
    path: dict[ConstraintId, Array]  # (N,) of each row of the path, per second
    point_s: Array  # (S,) state points in order of time
    state: Array  # (S, nx), per second
    control_s: Array  # (C,)
    control: Array  # (C, nu), per second

    def on(self, program: Program) -> tuple[Array, Array]:
        """Multipliers of the unknowns and of the rows of a program on another mesh."""
        layout = program.layout
        mesh = layout.mesh
        costate = _at(layout.collocation_times_s(), self.t_s, self.costate)
        rows = []
        first = 0
        for degree in mesh.degrees:
            end = costate[first + degree]
            rows += [gauss_rule(degree).weights[:, None] * (costate[first : first + degree] - end), end[None]]
            first += degree + 1
        times, ids = layout.node_times_s(), path_ids(program)
        known = {one: np.interp(times, self.node_s, price) for one, price in self.path.items()}
        nothing = np.zeros(len(times))
        path = np.array([[known.get(one, nothing)[t] for one in row] for t, row in enumerate(ids)])
        path *= layout.quadrature()[:, None]
        state = _at(layout.point_times_s(), self.point_s, self.state) * _spans(layout.point_times_s())[:, None]
        control = _at(layout.control_times_s(), self.control_s, self.control)
        control *= _spans(layout.control_times_s())[:, None]
        state[[0, mesh.intervals]] = 0.0
        steps = np.zeros(program.step_rows)
        return (
            np.concatenate([state.ravel(), control.ravel()]),
            np.concatenate([*map(np.ravel, rows), path.ravel(), steps]),
        )


def multipliers(program: Program, solution: Solution) -> Multipliers:
    """The multipliers of a solution on a mesh without extra instants."""
    layout = program.layout
    nx, nu, mesh = layout.nx, layout.nu, layout.mesh
    g = np.array(list(solution.g_multipliers.values()))
    count = nx * (layout.nodes + mesh.intervals)
    path = g[count : len(g) - program.step_rows].reshape(layout.nodes, -1) / layout.quadrature()[:, None]
    rows = g[:count].reshape(-1, nx)
    prices: dict[ConstraintId, Array] = {}
    for t, ids in enumerate(path_ids(program)):
        for one, price in zip(ids, path[t].tolist(), strict=True):
            prices.setdefault(one, np.zeros(layout.nodes))[t] = price
    costate = rows.copy()
    first = 0
    for degree in mesh.degrees:
        costate[first : first + degree] = (
            rows[first : first + degree] / gauss_rule(degree).weights[:, None] + rows[first + degree]
        )
        first += degree + 1
    points, controls = layout.point_times_s(), layout.control_times_s()
    state = solution.y_multipliers[: nx * len(points)].reshape(-1, nx) / _spans(points)[:, None]
    state[[0, mesh.intervals]] = state[[layout.mesh.intervals + 1, -1]]
    order = np.argsort(points)
    control = solution.y_multipliers[nx * len(points) :].reshape(-1, nu) / _spans(controls)[:, None]
    return Multipliers(
        layout.collocation_times_s(),
        costate,
        layout.node_times_s(),
        prices,
        points[order],
        state[order],
        controls,
        control,
    )


def path_ids(program: Program) -> list[list[ConstraintId]]:
    """The constraints (N, P) of the path's rows, without their times."""
    layout = program.layout
    first_row = layout.nx * (layout.nodes + layout.mesh.intervals)
    ids = [one for one, _ in program.g_ids[first_row : len(program.g_ids) - program.step_rows]]
    width = len(ids) // layout.nodes
    return [ids[first : first + width] for first in range(0, len(ids), width)]


def _at(times_s: Array, known_s: Array, values: Array) -> Array:
    return np.column_stack([np.interp(times_s, known_s, column) for column in values.T])


def _spans(times_s: Array) -> Array:
    """The time (N,) that each of the instants (N,) represents."""
    order = np.argsort(times_s)
    edges = np.concatenate([times_s[order][:1], 0.5 * (times_s[order][1:] + times_s[order][:-1]), times_s[order][-1:]])
    spans = np.empty(len(times_s))
    spans[order] = np.diff(edges)
    return spans
