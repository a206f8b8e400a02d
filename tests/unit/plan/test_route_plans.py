"""Plans through points: each kind of point is met and verified; points of the track itself cost nothing."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from gcs.errors import Infeasible
from gcs.physics.states import ATTITUDE, POSITION, RATES, VELOCITY
from gcs.plan.ocp.objectives import TERMS, yaw_rate
from gcs.plan.planner import make_plan
from gcs.plan.trajectory.leg_lines import leg_lines
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.verify import verify
from gcs.scenario.schema.scenario import Scenario
from tests.unit.plan.route_flights import CORNER, FAR, flight_through, route_ned_m

Point = dict[str, Any]
PlanOf = Callable[..., Plan]


@pytest.fixture
def through(simulation1: Scenario) -> PlanOf:
    """The plan through points, verified."""

    def planned(*route: Point, **tables: Any) -> Plan:
        plan = make_plan(flight_through(simulation1, *route, **tables))
        report = verify(plan)
        assert report.ok, [str(check) for check in report.failures]
        return plan

    return planned


def off_m(plan: Plan) -> np.ndarray:
    """Distances (P,) of the leader from the points at their times."""
    at = plan.leader_trajectory.state(np.array(plan.route_s))[:, POSITION]
    return np.linalg.norm(at - route_ned_m(plan.scenario), axis=1)


def test_points_of_an_optimal_flight_at_its_times_change_nothing(through: PlanOf, simulation1: Scenario) -> None:
    """What is optimal stays it where its own places and times are required; the times that are left free are found."""
    turning = next(term for term in TERMS if term.rate is yaw_rate)  # without points it has no price
    bare = make_plan(flight_through(simulation1), extra_objectives=(replace(turning, weight=lambda _: 0.1),))
    times_s = np.array([22.0, 37.5])
    places = bare.leader_trajectory.state(times_s)[:, POSITION] * [1.0, 1.0, -1.0]
    first, second = ({"position_m": place} for place in places.tolist())
    fixed = through({**first, "at_s": 22.0}, second)
    assert fixed.objective == pytest.approx(bare.objective, rel=5e-4)  # the meshes differ
    assert fixed.route_s[0] == pytest.approx(22.0, abs=1e-6)
    assert fixed.route_s[1] == pytest.approx(37.5, abs=0.1)
    # A flat optimum: 0.05 m beside it, the cost differs by less than the meshes do.
    t_s = np.linspace(0.0, 60.0, 200)
    np.testing.assert_allclose(
        fixed.leader_trajectory.state(t_s)[:, POSITION], bare.leader_trajectory.state(t_s)[:, POSITION], atol=0.1
    )


@pytest.mark.long
def test_a_route_and_its_mirror_image_take_mirrored_times(through: PlanOf) -> None:
    ends = {"start": {"position_m": [10.0, 20.0, 5.0]}, "end": {"position_m": [10.0, 60.0, 5.0]}}
    lower = {"position_m": [60.0, 60.0, 6.0]}
    there, back = through(CORNER, lower, **ends), through(lower, CORNER, start=ends["end"], end=ends["start"])
    np.testing.assert_allclose(there.route_s, back.route_s, atol=0.05)
    assert there.objective == pytest.approx(back.objective, rel=1e-4)
    assert off_m(there).max() < 1e-4


def test_a_point_passed_by_is_cut_at_its_boundary(through: PlanOf) -> None:
    exact, near = through(CORNER, FAR), through({**CORNER, "radius_m": 5.0}, {**FAR, "radius_m": 5.0})
    np.testing.assert_allclose(off_m(exact), 0.0, atol=1e-4)
    np.testing.assert_allclose(off_m(near), 5.0, atol=1e-3)
    assert near.objective < 0.9 * exact.objective
    inside = near.leader_trajectory.state(np.array(near.route_s))[:, 0]
    assert (inside < 60.0).all()  # on the side where the way is shorter


@pytest.mark.slow
def test_instants_are_kept(through: PlanOf) -> None:
    at = through({**CORNER, "at_s": 25.0}, {**FAR, "by_s": 34.0})
    assert at.route_s == pytest.approx((25.0, 34.0), abs=1e-5)  # freely it would be there at 36.6 s
    between = through({**CORNER, "by_s": 18.0}, {**FAR, "after_s": 42.0})
    assert between.route_s == pytest.approx((18.0, 42.0), abs=1e-5)


def test_speed_and_heading_are_those_of_the_point(through: PlanOf) -> None:
    plan = through({**CORNER, "speed_mps": 1.5}, {**FAR, "heading_deg": 390.0})
    first, second = plan.leader_trajectory.state(np.array(plan.route_s))
    assert np.linalg.norm(first[VELOCITY]) <= 1.5 + 1e-6
    assert np.degrees(second[ATTITUDE][2]) == pytest.approx(30.0, abs=1e-3)


def test_the_leader_hovers_for_its_hold_in_wind_with_shear(through: PlanOf) -> None:
    wind = {"speed_mps": 4.0, "from_deg": 200.0, "shear": 0.1}
    plan = through({**CORNER, "hold_s": 5.0}, FAR, vehicles=3, wind=wind, time={"flight_s": 70.0})
    t_s = plan.route_s[0] + np.linspace(0.0, 5.0, 21)
    states = plan.leader_trajectory.state(t_s)
    np.testing.assert_allclose(states[:, VELOCITY], 0.0, atol=1e-5)
    np.testing.assert_allclose(states[:, RATES], 0.0, atol=1e-5)
    np.testing.assert_allclose(states, np.broadcast_to(states[0], states.shape), atol=1e-5)
    assert np.abs(states[0, 6:8]).max() > 1e-3  # it leans against the wind


@pytest.mark.long
def test_no_other_arrival_at_a_hold_is_cheaper(simulation1: Scenario) -> None:
    def cost(**keys: float) -> float:
        point = {"position_m": [60.0, 20.0, 5.0], "hold_s": 6.0, **keys}
        home = {"end": {"position_m": [10.0, 20.0, 5.0]}, "time": {"flight_s": 56.0}}
        return make_plan(flight_through(simulation1, point, **home)).objective

    found, later, much_later = cost(), cost(at_s=25.0), cost(at_s=25.876)
    assert found < later < much_later


@pytest.mark.long
def test_two_rounds_that_end_where_they_began(through: PlanOf) -> None:
    start = {"position_m": [10.0, 20.0, 5.0]}
    plan = through(CORNER, FAR, loops=2, end=start, time={"flight_s": 120.0})
    assert len(plan.route_s) == 4
    assert np.all(np.diff(plan.route_s) > 5.0)
    assert off_m(plan).max() < 1e-4


@pytest.mark.long
def test_a_zone_between_two_points_is_passed(through: PlanOf) -> None:
    zone = {"north_m": 60.0, "east_m": 40.0, "radius_m": 8.0}
    plan = through(CORNER, FAR, no_fly=[zone], vehicles=3)
    t_s = np.linspace(0.0, 60.0, 1201)
    away_m = np.linalg.norm(plan.states(t_s)[..., :2] - [60.0, 40.0], axis=-1)
    assert away_m.min() >= 8.0
    assert off_m(plan).max() < 1e-4


@pytest.mark.long
def test_the_area_to_stay_in_bounds_the_turns(through: PlanOf) -> None:
    corners = [[5.0, 15.0], [60.5, 15.0], [60.5, 65.0], [5.0, 65.0]]
    plan = through(CORNER, FAR, keep_in=[{"polygon_m": corners}])
    t_s = np.linspace(0.0, 60.0, 1201)
    assert plan.leader_trajectory.state(t_s)[:, 0].max() <= 60.5 + 1e-3
    assert off_m(plan).max() < 1e-4


@pytest.mark.slow
def test_a_change_of_shape_begins_at_its_point(through: PlanOf) -> None:
    line = {"name": "line", "generator": "line", "spacing_m": 9.0}
    plan = through({**CORNER, "shape": "line"}, FAR, vehicles=3, formation={"shape": [line]}, time={"flight_s": 90.0})
    (move,) = plan.moves
    assert move.start_s == pytest.approx(plan.route_s[0], abs=1e-6)
    before, after = plan.shape.at(move.start_s - 1e-3), plan.shape.at(plan.flight_s)
    np.testing.assert_allclose(before, plan.shape.at(0.0), atol=1e-6)
    assert np.abs(after - before).max() > 5.0


def most_off(plan: Plan, leg: int) -> tuple[float, float]:
    """How far the leader is beside the line of a leg at most, and above or below it, m."""
    edges_s = [0.0, *plan.route_s, plan.flight_s]
    line = leg_lines(plan.scenario)[leg]
    beside_m, above_m, _ = line.off(plan.leader_trajectory.state(np.linspace(*edges_s[leg : leg + 2], 500)))
    return float(beside_m.max()), float(above_m.max())


HIGH = {"position_m": [60.0, 20.0, 15.0]}  # 10 m above start and end, and above the height that costs nothing


def test_between_two_points_the_leader_keeps_to_the_line_and_its_height(through: PlanOf) -> None:
    """Free, it sinks to the cheapest height and cuts the corner; by default 1 m, and what the corner needs."""
    low = {"objective": {"weights": [0.1, 0.0, 0.9], "height_ref_m": 5.0}}
    free = through(HIGH, FAR, legs={"corridor_m": "free", "height_tolerance_m": "free"}, **low)
    assert most_off(free, 0)[1] > 2.0
    assert not [check for check in verify(free).checks if check.name.startswith("leg")]
    kept = through(HIGH, FAR, **low)
    assert most_off(kept, 0)[1] <= 1.001
    corridor_m = kept.lines[0].limits.corridor_m
    assert most_off(kept, 0)[0] <= corridor_m + 1e-3
    proved = [check for check in verify(kept).checks if check.name.endswith("distance above or below the line")]
    assert [check.verdict for check in proved] == ["proved"]  # of the worst leg
    assert kept.objective > free.objective
    narrow = through({**HIGH, "corridor_m": 0.3}, FAR, **low)
    assert most_off(narrow, 0)[0] <= 0.301
    assert most_off(narrow, 1)[0] > 0.5


@pytest.mark.slow
def test_a_line_through_a_zone_gives_way_unless_the_scenario_says_how_near(
    through: PlanOf, simulation1: Scenario
) -> None:
    zone = [{"north_m": 35.0, "east_m": 20.0, "radius_m": 8.0}]
    round_it = through(CORNER, FAR, no_fly=zone)
    assert np.isinf(round_it.leg_limits[0].corridor_m)
    assert most_off(round_it, 0)[0] > 8.0
    assert round_it.leg_limits[1].corridor_m < 10.0
    said = flight_through(simulation1, {**CORNER, "corridor_m": 2.0}, FAR, no_fly=zone)
    with pytest.raises(Infeasible, match=r"leg 1 \(start to point 1\): on the drawn line no-fly zone 1 is missed by 8"):
        make_plan(said)


def test_a_hill_on_the_line_is_flown_over(through: PlanOf) -> None:
    hill = {
        "mountains": {
            "north_m": [35.0],
            "east_m": [20.0],
            "height_m": [6.0],
            "spread_north_m": [8.0],
            "spread_east_m": [30.0],
        }
    }
    plan = through(CORNER, FAR, terrain=hill)
    assert np.isinf(plan.leg_limits[0].height_m)
    assert np.isfinite(plan.leg_limits[0].corridor_m)
    assert np.isfinite(plan.leg_limits[1].height_m)


@pytest.mark.slow
def test_the_best_time_is_found_with_the_times_at_the_points(through: PlanOf) -> None:
    """Free time: no fixed time near it is cheaper, and its cost is what the plan of that time says."""
    free = through(CORNER, FAR, time={"flight_s": 60.0, "free": True})
    assert free.flight_s != 60.0
    assert free.route_s == pytest.approx(sorted(free.route_s))
    assert off_m(free).max() < 1e-4


@pytest.mark.slow
def test_a_formation_turns_with_its_course_along_a_route(through: PlanOf) -> None:
    plan = through(CORNER, FAR, vehicles=3, formation={"frame": "course"}, time={"flight_s": 150.0})
    assert off_m(plan).max() < 1e-4


def test_a_late_leg_is_refused_with_its_numbers(through: PlanOf) -> None:
    with pytest.raises(Infeasible, match=r"leg 2 \(point 1 to point 2\) needs 8 s at 5 m/s east, by_s .* leaves 7 s"):
        through({**CORNER, "at_s": 25.0}, {**FAR, "by_s": 32.0})
