"""Renames the rows of multipliers to the new node times."""

from dataclasses import replace

import numpy as np

from gcs.plan.nlp.ipopt import Solution
from gcs.plan.nlp.mesh import Mesh


def moved(solution: Solution, before: Mesh, after: Mesh) -> Solution:
    """The solution with each multiplier at the time to which its row moved with the joints of the mesh."""
    times = np.interp([t_s for _, t_s in solution.g_multipliers], before.joints_s, after.joints_s).tolist()
    rows = zip(solution.g_multipliers.items(), times, strict=True)
    return replace(solution, g_multipliers={(one, t_s): price for ((one, _), price), t_s in rows})
