"""The way of a formation back to its plan after a standstill of the ground station."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from gcs.flight.contingency.manoeuvres import RejoinReference
from gcs.flight.contingency.standstill.common_rejoin import FADE_S, Rejoin, Stranded, common_rejoin, quintic
from gcs.mission.failsafe.return_routes import ReturnRoutes
from gcs.physics.quadrotor import POSITION, VELOCITY, Array
from gcs.plan.trajectory.plan import Plan

AT_S = 60.0


@pytest.fixture(scope="module")
def field(plan_of: Callable[[str], Plan]) -> tuple[Plan, ReturnRoutes]:
    plan = plan_of("field")
    return plan, ReturnRoutes(plan)


def place(plan: Plan, t_s: float) -> tuple[Array, Array]:
    states = plan.states(np.array([t_s]))[:, 0]
    return states[:, POSITION], states[:, VELOCITY]


def standing(plan: Plan, t_s: float, *, moved_m: Array | float = 0.0) -> Stranded:
    where, speed = place(plan, t_s)
    return Stranded(tuple(range(len(where))), where + moved_m, np.zeros_like(speed))


def test_vehicles_near_the_plan_fade_to_it_and_keep_t0(field: tuple[Plan, ReturnRoutes]) -> None:
    plan, routes = field
    where, speed = place(plan, AT_S)
    found = common_rejoin(
        plan, routes, Stranded(tuple(range(6)), where + np.array([1.0, -1.5, 0.5]), speed), AT_S, AT_S - 2.0
    )
    assert isinstance(found, Rejoin)
    assert (found.t_s, found.fade_s) == (AT_S, FADE_S)
    assert found.separation_m > 4.9


@pytest.mark.parametrize("long_s", [6.0, 15.0, 60.0])
def test_the_plan_waits_for_vehicles_that_stand(field: tuple[Plan, ReturnRoutes], long_s: float) -> None:
    plan, routes = field
    stopped_s = AT_S + 2.0
    found = common_rejoin(plan, routes, standing(plan, stopped_s), AT_S + long_s, AT_S)
    assert isinstance(found, Rejoin)
    assert stopped_s - found.fade_s / 2 - 0.2 <= found.t_s <= stopped_s + 0.2
    where, speed = place(plan, found.t_s)
    s = np.linspace(0.0, 1.0, 81)
    states = plan.states(found.t_s + s * found.fade_s)
    moved, rate, _ = quintic(standing(plan, stopped_s).position_ned_m - where, -speed, s, found.fade_s)
    flown = states[..., POSITION] + moved
    assert np.abs(states[..., VELOCITY] + rate).max() < 5.5, "nobody catches up"
    gaps = np.linalg.norm(flown[:, None] - flown[None], axis=-1)[np.triu_indices(6, 1)]
    assert gaps.min() == pytest.approx(found.separation_m, abs=0.2)


def test_vehicles_short_of_their_landing_points_get_there_before_the_plan_lands(
    field: tuple[Plan, ReturnRoutes],
) -> None:
    plan, routes = field
    over_s = plan.phase("landing").start_s
    where, speed = place(plan, over_s)
    found = common_rejoin(
        plan, routes, Stranded(tuple(range(6)), where + np.array([2.0, 2.0, 0.0]), speed), over_s + 9.0, AT_S
    )
    assert isinstance(found, Rejoin)
    assert found.t_s + found.fade_s <= over_s


def test_vehicles_of_two_kinds_stop_at_different_places(field: tuple[Plan, ReturnRoutes]) -> None:
    """Those of PX4 stop 1 s earlier, and sink."""
    plan, routes = field
    late, early = standing(plan, AT_S + 3.0), standing(plan, AT_S + 2.0, moved_m=np.array([0.0, 0.0, 2.0]))
    mixed = np.where(np.arange(6)[:, None] % 2, early.position_ned_m, late.position_ned_m)
    found = common_rejoin(plan, routes, Stranded(late.rows, mixed, np.zeros((6, 3))), AT_S + 15.0, AT_S)
    assert isinstance(found, Rejoin)
    assert found.separation_m > 3.0, "they stand 3.6 m apart"


def test_vehicles_far_from_the_plan_have_no_way_back(field: tuple[Plan, ReturnRoutes]) -> None:
    plan, routes = field
    found = common_rejoin(plan, routes, standing(plan, AT_S, moved_m=np.array([0.0, 0.0, -20.0])), AT_S + 6.0, AT_S)
    assert found == "a vehicle is 20.0 m from the plan at its nearest instant (limit 15 m)"


def test_two_vehicles_that_would_meet_have_no_way_back(field: tuple[Plan, ReturnRoutes]) -> None:
    plan, routes = field
    here = standing(plan, AT_S)
    swapped = here.position_ned_m.copy()
    swapped[[1, 2]] = swapped[[2, 1]]
    found = common_rejoin(plan, routes, Stranded(here.rows, swapped, here.velocity_ned_mps), AT_S + 6.0, AT_S)
    assert isinstance(found, str)
    assert "separation" in found or "limit 15 m" in found


def test_the_checked_motion_is_the_one_that_is_streamed() -> None:
    class Still:
        def at(self, k: int, t_s: float) -> tuple[float, ...]:
            return (0.0,) * 10

    off, rate = np.array([3.0, -2.0, 1.0]), np.array([0.5, 1.0, -0.2])
    streamed = RejoinReference(Still(), off, rate, 100.0, 6.0)
    for s in (0.0, 0.2, 0.5, 0.9):
        parts = quintic(off[None], rate[None], np.array([s]), 6.0)
        assert np.concatenate([part[0, 0] for part in parts]) == pytest.approx(streamed.at(0, 100.0 + 6.0 * s)[:9])
