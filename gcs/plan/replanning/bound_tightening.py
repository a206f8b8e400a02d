"""Tighten the bounds where the last solution violated a limit between nodes.

Only bounds change. The structure of the program stays, so the next solve takes a few iterations.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gcs.physics.quadrotor import Array
from gcs.plan.nlp.program.transcription import Program
from gcs.plan.nlp.violations import Violation
from gcs.plan.trajectory.trajectory import Trajectory

_EXCESS = 1.25  # times the violation: the polynomial between two nodes changes less than the nodes do
_STATES = {
    **{"north position": 0, "east position": 1, "height": 2},
    **{"north speed": 3, "east speed": 4, "vertical speed": 5},
    **{"roll": 6, "pitch": 7, "yaw": 8, "roll rate": 9, "pitch rate": 10, "yaw rate": 11},
}
_PATHS = {
    "clearance above ground": "clearance of",
    "turning load factor": "turning radius",
    "acceleration": "acceleration of",
    "jerk": "jerk of",
}


def tightened(program: Program, trajectory: Trajectory, violations: tuple[Violation, ...]) -> Program:
    """The same program with tighter bounds at the nodes and joints beside each violation."""
    y_low, y_high, g_low = program.y_low.copy(), program.y_high.copy(), program.g_low.copy()
    layout = program.layout
    points = layout.point_times_s()
    order = np.argsort(points)
    nodes = layout.node_times_s()
    rows = layout.nx * (layout.nodes + layout.mesh.intervals)
    per_node = (len(g_low) - rows - program.step_rows) // len(nodes)
    for violation in violations:
        if violation.name in _STATES:
            component = _STATES[violation.name]
            above = bool(trajectory.state(violation.t_s)[component] > 0.0) if component != 2 else None
            for point in order[_beside(points[order], violation.t_s)]:
                at = layout.nx * int(point) + component
                by = min(_EXCESS * violation.by_si / program.unit[at], 0.4 * (y_high[at] - y_low[at]))
                if above is not False:
                    y_high[at] -= by
                if above is not True:
                    y_low[at] += by
        else:
            prefix = _PATHS.get(violation.name, f"{violation.name} for")
            by = _EXCESS * (
                violation.by_si
                if violation.name not in ("turning load factor", "acceleration", "jerk")
                else 2 * violation.share
            )
            for node in _beside(nodes, violation.t_s):
                first = rows + per_node * int(node)
                for at in range(first, first + per_node):
                    name = program.g_names[at][0]
                    if name.startswith((prefix, f"{violation.name}, part")) and np.isfinite(g_low[at]):
                        g_low[at] += by
    return replace(program, y_low=y_low, y_high=y_high, g_low=g_low)


def _beside(times_s: Array, t_s: float) -> Array:
    """Indices of the last instant before and the first after."""
    after = int(np.clip(np.searchsorted(times_s, t_s), 1, len(times_s) - 1))
    return np.array([after - 1, after])
