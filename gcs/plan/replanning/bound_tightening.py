"""A program asked for a little more where its last solution broke something between the nodes.

Knows: which bounds stand beside an instant, and which of them a broken constraint means. Does not know: how a program
is solved. The program keeps its structure: only bounds change, which costs nothing but a few iterations.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gcs.physics.quadrotor import Array
from gcs.plan.nlp.transcription import Program
from gcs.plan.nlp.violations import Violation
from gcs.plan.trajectory.trajectory import Trajectory

_SPARE = 1.25  # times what was missing: the polynomial between two nodes moves less than they do
_STATES = {
    **{"north position": 0, "east position": 1, "height": 2},
    **{"north speed": 3, "east speed": 4, "vertical speed": 5},
    **{"roll": 6, "pitch": 7, "yaw": 8, "roll rate": 9, "pitch rate": 10, "yaw rate": 11},
}
_PATHS = {
    "clearance above ground": "clearance of",
    "turning load factor": "turning radius",
    "acceleration": "acceleration of",
}


def tightened(program: Program, trajectory: Trajectory, misses: tuple[Violation, ...]) -> Program:
    """The same program with bounds drawn in at the nodes and joints beside every miss."""
    y_low, y_high, g_low = program.y_low.copy(), program.y_high.copy(), program.g_low.copy()
    layout = program.layout
    points = layout.point_times_s()
    order = np.argsort(points)
    nodes = layout.node_times_s()
    rows = layout.nx * (layout.nodes + layout.mesh.intervals)
    per_node = (len(g_low) - rows) // len(nodes)
    for miss in misses:
        if miss.name in _STATES:
            component = _STATES[miss.name]
            above = bool(trajectory.state(miss.t_s)[component] > 0.0) if component != 2 else None
            for point in order[_beside(points[order], miss.t_s)]:
                at = layout.nx * int(point) + component
                by = min(_SPARE * miss.by_si / program.unit[at], 0.4 * (y_high[at] - y_low[at]))
                if above is not False:
                    y_high[at] -= by
                if above is not True:
                    y_low[at] += by
        else:
            wanted = _PATHS.get(miss.name, f"{miss.name} for")
            by = _SPARE * (miss.by_si if miss.name not in ("turning load factor", "acceleration") else 2 * miss.share)
            for node in _beside(nodes, miss.t_s):
                first = rows + per_node * int(node)
                for at in range(first, first + per_node):
                    name = program.g_names[at][0]
                    if name.startswith((wanted, f"{miss.name}, part")) and np.isfinite(g_low[at]):
                        g_low[at] += by
    return replace(program, y_low=y_low, y_high=y_high, g_low=g_low)


def _beside(times_s: Array, t_s: float) -> Array:
    """Indices of the last instant before and the first after."""
    after = int(np.clip(np.searchsorted(times_s, t_s), 1, len(times_s) - 1))
    return np.array([after - 1, after])
