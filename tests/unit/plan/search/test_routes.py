"""Routes: around obstacles on either side, or the number that would open one."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from gcs.errors import Infeasible, PlanningError
from gcs.plan.nlp.mesh_refinement import optimise
from gcs.plan.ocp.problem import Problem, flight_problem
from gcs.plan.search.homotopy_classes import best_class, least_objective
from gcs.plan.search.infeasibility import check_time, explain_infeasible, with_duration
from gcs.plan.search.initial_guess import along, straight_route
from gcs.plan.search.routes import find_routes, survey
from gcs.plan.trajectory.trajectory import Trajectory
from gcs.scenario.schema.scenario import Scenario
from tests.unit.plan.problems import meadow

DISK = {"north_m": 100.0, "east_m": 50.0, "radius_m": 25.0}


def beyond(scenario: Scenario, **tables: Any) -> Scenario:
    """From (2, 50) to (200, 50) in 90 s over flat ground; `tables` put something between."""
    ends: dict[str, Any] = {
        "limits": {"north_m": [0.0, 205.0], "east_m": [0.0, 100.0]} | tables.pop("limits", {}),
        "start": {"position_m": [2.0, 50.0, 3.0]},
        "end": {"position_m": [200.0, 50.0, 3.0]},
        "time": {"flight_s": 90.0},
    }
    leader = {"vehicle": [{"sysid": 1, "position_m": [2.0, 50.0, 3.0]}]}
    return meadow(scenario, formation=leader, **{**ends, **tables})


def wall(height_m: float) -> dict[str, Any]:
    """A ridge across the whole map at north 100, lowest at its gap around east 80."""
    east = np.array([-20.0, 0.0, 20.0, 40.0, 120.0])
    count = len(east)
    return {
        "ripple": None,
        "mountains": {
            "north_m": [100.0] * count,
            "east_m": east.tolist(),
            "height_m": [height_m] * count,
            "spread_north_m": [8.0] * count,
            "spread_east_m": [40.0] * count,
        },
    }


def test_nothing_in_the_way_is_one_straight_route(simulation1: Scenario) -> None:
    problem = flight_problem(beyond(simulation1))
    (route,) = find_routes(problem, survey(problem))
    assert route.length_m == pytest.approx(198.0)
    assert len(route.points_m) == 2


def test_a_disk_is_passed_on_both_sides(simulation1: Scenario) -> None:
    problem = flight_problem(beyond(simulation1, no_fly=[DISK]))
    routes = find_routes(problem, survey(problem))
    assert len(routes) >= 2
    assert len({r.sides for r in routes}) == len(routes)
    passed = {float(np.sign(r.place(np.array([0.5]))[0, 1] - DISK["east_m"])) for r in routes[:2]}
    assert passed == {-1.0, 1.0}
    # Two tangents and the arc between them is the shortest way round a circle.
    half, radius = 99.0, DISK["radius_m"]
    shortest = 2 * (np.sqrt(half**2 - radius**2) + radius * np.arcsin(radius / half))
    assert shortest * 0.995 < routes[0].length_m < shortest * 1.03


@pytest.mark.parametrize("north_m", [98.0, 99.1, 100.2, 101.3])
def test_a_wall_thinner_than_a_cell_is_passed_beside(simulation1: Scenario, north_m: float) -> None:
    """Cells are 1.7 m wide; the wall is 1 m thick and open at its eastern end."""
    corners = [[north_m, 0.0], [north_m + 1.0, 0.0], [north_m + 1.0, 70.0], [north_m, 70.0]]
    problem = flight_problem(beyond(simulation1, no_fly=[{"polygon_m": corners}]))
    (route, *_) = find_routes(problem, survey(problem))
    east_m = np.interp(north_m + 0.5, *route.place(np.linspace(0.0, 1.0, 5001)).T)
    assert 70.0 <= east_m < 74.0
    guess = along(problem, route).state(np.linspace(0.0, 90.0, 2001))
    beside = np.abs(guess[:, 0] - north_m - 0.5) < 0.5
    assert guess[beside, 1].min() > 69.5  # its corners are not rounded off through the wall


def test_every_vehicle_is_folded_into_the_map(simulation1: Scenario) -> None:
    """A follower 10 m east makes a disk reach 10 m further west for the leader."""
    two = [
        {"sysid": 1, "position_m": [2.0, 50.0, 3.0]},
        {"sysid": 2, "position_m": [2.0, 60.0, 3.0]},
    ]
    scenario = beyond(simulation1, no_fly=[DISK])
    data = scenario.model_dump()
    data["formation"]["vehicle"] = two
    area = survey(flight_problem(Scenario.model_validate(data)))
    assert not np.isfinite(area.floor_m[area.cell(np.array([100.0, 50.0 - 34.0]))])
    assert np.isfinite(area.floor_m[area.cell(np.array([100.0, 50.0 - 37.0]))])


def test_no_route_says_which_ceiling_would_open_one(simulation1: Scenario) -> None:
    problem = flight_problem(beyond(simulation1, terrain=wall(30.0), limits={"height_m": [0.0, 12.0]}))
    with pytest.raises(Infeasible) as caught:
        find_routes(problem, survey(problem))
    needed_m = float(caught.value.message.split("lowest pass needs ")[1].split(" m")[0])
    opened = flight_problem(beyond(simulation1, terrain=wall(30.0), limits={"height_m": [0.0, needed_m + 0.1]}))
    assert find_routes(opened, survey(opened))
    shut = flight_problem(beyond(simulation1, terrain=wall(30.0), limits={"height_m": [0.0, needed_m - 0.5]}))
    with pytest.raises(Infeasible):
        find_routes(shut, survey(shut))


def test_disks_can_close_all_routes(simulation1: Scenario) -> None:
    row = [{"north_m": 100.0, "east_m": e, "radius_m": 15.0} for e in np.arange(0.0, 101.0, 20.0).tolist()]
    problem = flight_problem(beyond(simulation1, no_fly=row))
    with pytest.raises(Infeasible, match="zones block all routes"):
        find_routes(problem, survey(problem))


def test_the_best_of_both_sides_wins_and_the_other_is_accounted_for(simulation1: Scenario) -> None:
    off_centre = {**DISK, "east_m": 44.0}
    problem = flight_problem(beyond(simulation1, no_fly=[off_centre]))
    best, tried = best_class(problem, lambda _: None, all_routes=True)
    costs = [w.objective for w in tried if w.objective is not None]
    assert len(costs) >= 2
    assert best.objective == min(costs)
    track = best.trajectory.state(np.linspace(0.0, 90.0, 181))
    beside = track[np.argmin(np.abs(track[:, 0] - DISK["north_m"]))]
    assert off_centre["east_m"] + off_centre["radius_m"] - 1e-3 < beside[1] < 75.0


def test_no_flight_costs_less_than_its_bound(simulation1: Scenario) -> None:
    problem = flight_problem(beyond(simulation1, no_fly=[DISK]))
    for route in find_routes(problem, survey(problem))[:2]:
        assert optimise(problem, along(problem, route)).objective >= least_objective(problem, route)


def test_too_little_time_for_the_speed_limit_names_the_time(simulation1: Scenario) -> None:
    problem = flight_problem(beyond(simulation1, time={"flight_s": 30.0}))
    with pytest.raises(Infeasible, match="north alone needs t_f ≥ 40 s"):
        check_time(problem)


@pytest.mark.slow
def test_a_time_that_is_too_short_for_the_detour_says_how_long_it_takes(simulation1: Scenario) -> None:
    problem = flight_problem(beyond(simulation1, no_fly=[DISK], time={"flight_s": 44.0}))
    route = find_routes(problem, survey(problem))[0]
    with pytest.raises(PlanningError) as failed:
        optimise(problem, along(problem, route))
    with pytest.raises(PlanningError) as plain:
        best_class(problem, lambda _: None, explained=False)
    assert "t_f" not in plain.value.message
    answer = explain_infeasible(problem, route, [failed.value])
    assert isinstance(answer, Infeasible)
    needed_s = float(answer.message.split("t_f ≥ ")[1].split(" s")[0])
    assert needed_s > 44.0
    enough = with_duration(problem, needed_s)
    assert isinstance(best_class(enough, lambda _: None)[0].trajectory, Trajectory)


def test_the_straight_route_is_straight(simulation1: Scenario) -> None:
    problem: Problem = flight_problem(beyond(simulation1))
    guess = along(problem, straight_route(problem))
    states = guess.state(np.linspace(0.0, 90.0, 50))
    np.testing.assert_allclose(states[:, 1], 50.0, atol=1e-9)
    assert (-states[:, 2] >= 3.0 - 1e-9).all()
