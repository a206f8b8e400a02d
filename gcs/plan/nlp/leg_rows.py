"""The durations of legs as unknowns: their bounds, and the rows that bound the times at points and end."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gcs.plan.nlp.mesh import Mesh
from gcs.plan.ocp.problem import Problem
from gcs.plan.trajectory.constraint_id import ConstraintId, Form, Kind
from gcs.types import Array

_SHORTER, _LONGER = 0.05, 20.0  # a leg's duration over that of its guess


@dataclass(frozen=True)
class LegTimes:
    """Bounds (K,), (K,) and ids of the legs' stretches, and rows (R, K) with bounds (R,), (R,), ids and times."""

    low: Array
    high: Array
    ids: tuple[ConstraintId, ...]
    rows: Array
    rows_low: Array
    rows_high: Array
    row_ids: tuple[tuple[ConstraintId, float], ...]


def leg_times(problem: Problem, mesh: Mesh) -> LegTimes | None:
    """The unknown durations of a flight; None where its time is given and it has one leg."""
    time = problem.free_time
    if not problem.points:
        if time is None:
            return None
        low, high = (np.array([t_s / problem.duration_s]) for t_s in (time.earliest_s, time.latest_s))
        return LegTimes(low, high, (ConstraintId(Kind.FLIGHT_TIME, Form.BOUND),), *_NO_ROWS)
    # Rows are the time in the air until a point, over the duration: of the legs before it, without the holds.
    lengths = mesh.leg_lengths_s / problem.duration_s
    count = len(lengths)
    held_s = np.cumsum([0.0, *(point.hold_s for point in problem.points)])
    low_s = [point.earliest_s - problem.start_s for point in problem.points]
    high_s = [point.latest_s - problem.start_s for point in problem.points]
    low_s.append(problem.duration_s if time is None else time.earliest_s)
    high_s.append(problem.duration_s if time is None else time.latest_s)
    ids = [ConstraintId(Kind.POINT_TIME, Form.ROW, point.name) for point in problem.points]
    ids.append(ConstraintId(Kind.FLIGHT_TIME, Form.ROW))
    low, high = ((np.array(t_s) - held_s) / problem.duration_s for t_s in (low_s, high_s))
    bounded = np.isfinite(low) | np.isfinite(high)
    before = np.tril(np.ones((count, count))) * lengths
    times_s = [*problem.point_s, problem.end_s]
    return LegTimes(
        np.full(count, _SHORTER),
        np.full(count, _LONGER),
        tuple(ConstraintId(Kind.LEG_DURATION, Form.BOUND, leg) for leg in range(1, count + 1)),
        before[bounded],
        low[bounded],
        high[bounded],
        tuple((ids[row], times_s[row]) for row in np.flatnonzero(bounded)),
    )


_NO_ROWS = np.zeros((0, 1)), np.zeros(0), np.zeros(0), ()
