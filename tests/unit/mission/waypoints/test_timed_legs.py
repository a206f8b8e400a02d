"""Who flies legs of its own, and when vehicles leave."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import PPoly

from gcs.mission.waypoints.placement import Deviation
from gcs.mission.waypoints.timed_legs import TimedLegs, rows_with_own_legs
from gcs.plan.formation.shape import Shape
from gcs.plan.trajectory.plan import Plan
from tests.unit.mission.waypoints.small_flights import FLIGHT_S


def test_vehicles_leave_at_the_first_time_unless_another_is_given() -> None:
    legs = TimedLegs(np.array([3.0, 9.0]), Deviation(0.0, 0.0))
    assert legs.left_s == 3.0
    assert replace(legs, leaves_s=1.5).left_s == 1.5


@pytest.mark.parametrize(
    ("span_s", "own"),
    [((-6.0, 0.0), False), ((-6.0, 0.1), True), ((20.0, 30.0), True), ((47.9, 49.0), True), ((48.0, 49.5), False)],
)
def test_each_flies_legs_of_its_own_where_the_shape_moves_in_flight(
    small: Plan, span_s: tuple[float, float], own: bool
) -> None:
    """Not where it moves before the leader sets off, or after it has arrived."""
    joints = np.array([small.t_start_s, *span_s, small.t_end_s])
    functions = np.ones((2, 3, 1))
    functions[0, :, 0] = 0.0, 0.5, 0.0
    moving = replace(small, shape=Shape(PPoly(functions, joints), small.shape.basis_ned_m))
    assert (moving.flight_s, small.leader) == (FLIGHT_S, 0)
    assert rows_with_own_legs(moving) == (slice(None) if own else slice(0, 1))
