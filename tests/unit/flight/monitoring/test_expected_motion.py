"""The expected motion is the plan's own, to the last bit, wherever no autopilot lands by itself."""

from __future__ import annotations

import numpy as np

from gcs.flight.monitoring.expected_motion import ExpectedMotion
from gcs.plan.trajectory.plan import Plan


def test_places_and_velocities_are_those_of_the_plan(simulation1_plan: Plan) -> None:
    plan = simulation1_plan
    inside_s = np.arange(plan.t_start_s, plan.t_end_s - 0.1, 0.7)  # the shape changes over the ground
    planned = plan.states(inside_s)[..., :6]
    assert np.ptp(planned[..., 3:], axis=0).max() > 0.0
    np.testing.assert_array_equal(ExpectedMotion(plan).states(inside_s), planned)
    outside_s = np.array([plan.t_start_s - 5.0, plan.t_end_s + 5.0])
    ends_s = np.array([plan.t_start_s, np.nextafter(plan.t_end_s, -np.inf)])
    np.testing.assert_array_equal(ExpectedMotion(plan).states(outside_s), plan.states(ends_s)[..., :6])
