"""Changes that cannot be flown as asked: refused in a sentence that names them and what to do."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from gcs.errors import Infeasible, PlanningError
from gcs.plan.formation.timeline import in_turn, lay, stops_ned_m
from gcs.plan.ocp.problem import flight_problem
from gcs.plan.planner import make_plan
from gcs.plan.search import shape_schedule
from gcs.plan.search.initial_guess import along, straight_route
from gcs.plan.search.routes import find_routes, survey
from gcs.plan.search.shape_schedule import optimise_on_schedule
from gcs.plan.verification.verify import verify
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.values.si import offsets_ned_m
from tests.unit.plan.formations import GATE, SHRINK, SWAPPED, TO_ROW, TURN, at, auto, fleet, gap

SWAP = {"kind": "reshape", "to": "b", "assignment": "fixed"}
LITTLE = {"kind": "shrink", "scale": 0.8}


def refusal(scenario: Scenario) -> PlanningError:
    with pytest.raises(PlanningError) as caught:
        make_plan(scenario)
    message, hint = caught.value.message, caught.value.hint
    assert message
    assert hint
    assert "\n" not in message + hint
    return caught.value


def test_a_gate_that_nobody_crosses_is_named(simulation1: Scenario) -> None:
    beside = [[15.0, 60.0], [15.0, 90.0]]
    error = refusal(fleet(simulation1, changes=({**TURN, "gate_m": beside},)))
    assert isinstance(error, Infeasible)
    assert "never crosses the gate from (15, 60) to (15, 90) that begins the change of kind rotate" in error.message
    assert "move or widen the gate (gate_m), or trigger the change by a time (at_s)" in error.hint


def test_changes_that_overlap_are_named_with_the_time_that_would_do(simulation1: Scenario) -> None:
    changes = (at(TURN, 2.0), at(SHRINK, 6.0))
    error = refusal(fleet(simulation1, changes=changes))
    assert "the change shrink to 0.5 (at 6 s)" in error.message
    assert "before the change rotate 90 deg has ended" in error.message
    earliest = float(error.hint.split("formation.change[1].at_s to ")[1].split()[0])
    assert verify(make_plan(fleet(simulation1, changes=(at(TURN, 2.0), at(SHRINK, earliest))))).ok


def test_a_change_that_outlasts_the_flight_is_named_with_the_time_of_flight_that_would_do(
    simulation1: Scenario,
) -> None:
    error = refusal(fleet(simulation1, changes=(at(TURN, 25.0),)))
    assert "the change rotate 90 deg (at 25 s) begins at 25.00 s and takes 11.12 s" in error.message
    needed_s = float(error.hint.split("time.flight_s to ")[1].split()[0])
    assert verify(make_plan(fleet(simulation1, changes=(at(TURN, 25.0),), time={"flight_s": needed_s}))).ok


def test_a_change_may_end_with_the_flight_to_the_last_bit(simulation1: Scenario) -> None:
    """In the sum of its beginning and its length a bit may be lost either way."""
    made = lay(fleet(simulation1, changes=(at(SHRINK, 2.0),)), (2.0,), 0.0, 30.0).moves[0]
    length = made.end_s - made.start_s
    for flight_s in np.random.default_rng(0).uniform(20.0, 300.0, 200).round(3).tolist():
        shape = lay(fleet(simulation1, changes=(at(SHRINK, 2.0),)), (flight_s - length,), 0.0, flight_s).shape
        assert shape.end_s == flight_s
        np.testing.assert_allclose(shape.at(flight_s), 0.5 * offsets_ned_m(fleet(simulation1)), atol=1e-12)
    plan = make_plan(fleet(simulation1, changes=(at(SHRINK, 20.0 - length),), time={"flight_s": 20.0}))
    assert plan.moves[0].end_s == 20.0
    assert verify(plan).ok


def test_a_change_that_brings_vehicles_too_near_is_refused_at_once(simulation1: Scenario) -> None:
    error = refusal(fleet(simulation1, changes=(at({**SHRINK, "scale": 0.2}, 2.0),)))
    assert isinstance(error, Infeasible)
    assert "vehicles 1 and 2 would be 0.60 m apart; separation_min_m is 1 m" in error.message
    assert "set scale to 0.334 or more" in error.hint


def test_lanes_that_do_not_fit_under_the_ceiling_are_a_matter_of_height(simulation1: Scenario) -> None:
    """Two lanes need 2 m, and there is half a metre."""
    low: dict[str, Any] = {"limits": {"height_m": [4.5, 5.0]}, "start": {"position_m": [2.0, 1.0, 5.0]}}
    error = refusal(fleet(simulation1, 3, "a", (at(SWAP, 2.0),), SWAPPED, time={"flight_s": 60.0}, **low))
    assert isinstance(error, Infeasible)
    assert "the formation is larger than the limit of height allows, by " in error.message
    assert "[limits] height_m" in error.hint
    when_s = float(error.message.split("at t = ")[1].split(" s")[0])
    assert 2.0 < when_s < 60.0


@pytest.mark.long
def test_lanes_between_ceiling_and_ground_are_a_matter_of_height_and_clearance(simulation1: Scenario) -> None:
    low: dict[str, Any] = {"limits": {"height_m": [0.0, 5.0], "clearance_min_m": 3.5}}
    begin = {"position_m": [2.0, 1.0, 4.0]}
    scenario = fleet(simulation1, 3, "a", (at(SWAP, 2.0),), SWAPPED, time={"flight_s": 45.0}, start=begin, **low)
    problem = flight_problem(scenario)
    with pytest.raises(Infeasible) as caught:
        optimise_on_schedule(problem, along(problem, straight_route(problem)))
    assert "limit of height and the clearance of vehicle" in caught.value.message
    assert "a higher ceiling ([limits] height_m)" in caught.value.hint


def test_a_change_that_tilts_more_than_a_vehicle_may_is_a_matter_of_its_speed(simulation1: Scenario) -> None:
    fast = {"change_speed_mps": 5.0, "change_accel_mps2": 10.0}
    flat = {"accel_max_mps2": None, "roll_pitch_yaw_deg": [10.0, 10.0, 180.0]}
    grow = at({"kind": "shrink", "scale": 10.0}, 2.0)
    error = refusal(fleet(simulation1, changes=(grow,), time={"flight_s": 40.0}, formation=fast, limits=flat))
    assert isinstance(error, Infeasible)
    assert "changes faster than the limit of roll allows, by " in error.message
    assert "change_speed_mps or change_accel_mps2 smaller" in error.hint


def test_a_change_that_lifts_more_than_a_vehicle_can_is_a_matter_of_its_speed(simulation1: Scenario) -> None:
    """Lanes flown so fast that gravity does not pull a vehicle down again."""
    fast = {"change_speed_mps": 40.0, "change_accel_mps2": 30.0}
    wild = {
        "accel_max_mps2": None,
        "rates_degps": [4e3, 4e3, 30.0],
        "roll_pitch_force_N": [90.0, 90.0],
        "yaw_moment_Nm": 0.08,
        "speed_ned_mps": [50.0, 50.0, 50.0],
    }
    error = refusal(fleet(simulation1, 3, "a", (at(SWAP, 2.0),), SWAPPED, formation=fast, limits=wild))
    assert "changes faster than the limit of" in error.message


HIGH: dict[str, Any] = {
    "start": {"position_m": [2.0, 1.0, 12.0]},
    "end": {"position_m": [40.0, 14.0, 12.0]},
    "ground_phases": {"takeoff_s": 30.0, "landing_s": 30.0, "hover_s": 2.0},
    "time": {"flight_s": 60.0},
}
UPRIGHT = {"kind": "rotate", "angle_deg": 90.0, "axis": [1.0, 0.0, 0.0]}


def test_a_last_shape_of_vehicles_above_each_other_cannot_land(simulation1: Scenario) -> None:
    error = refusal(fleet(simulation1, 5, "row", (at(UPRIGHT, 3.0),), **HIGH))
    assert isinstance(error, Infeasible)
    assert "end above each other and would land 0.00 m apart; separation_min_m is 1 m" in error.message
    assert "add a [[formation.change]]" in error.hint


@pytest.mark.long
def test_a_last_shape_too_high_to_come_down_in_time_says_how_long_it_takes(simulation1: Scenario) -> None:
    """12 m and another 4.24 m at 1.5 m/s, the quintic's peak being 15/8 of the mean."""
    tilted = at({**UPRIGHT, "angle_deg": 45.0}, 3.0)
    short = HIGH["ground_phases"] | {"landing_s": 20.0}
    error = refusal(fleet(simulation1, 5, "row", (tilted,), **HIGH | {"ground_phases": short}))
    assert "landing_s = 20 is too short: the highest vehicle descends 16.2 m" in error.message
    needed_s = float(error.hint.split("landing_s to ")[1].split()[0])
    assert needed_s == 21.0
    enough = HIGH["ground_phases"] | {"landing_s": needed_s}
    assert verify(make_plan(fleet(simulation1, 5, "row", (tilted,), **HIGH | {"ground_phases": enough}))).ok


@pytest.mark.slow
def test_a_gate_that_never_settles_says_so(simulation1: Scenario, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shape_schedule, "_LATE_S", 0.0)
    monkeypatch.setattr(shape_schedule, "_TRIES", 2)
    problem = flight_problem(fleet(simulation1, changes=({**LITTLE, "gate_m": GATE},)))
    with pytest.raises(PlanningError, match=r"after 2 iterations the leader crosses a gate \d\.\d\d s from") as caught:
        optimise_on_schedule(problem, along(problem, straight_route(problem)))
    assert "trigger the change by a time (at_s)" in caught.value.hint


@pytest.mark.parametrize("north_m", [6.0, 6.9])
def test_changes_that_overlap_in_the_guess_alone_are_flown(simulation1: Scenario, north_m: float) -> None:
    """At constant speed from the first instant the gate would come before the first change has ended."""
    gate = [[north_m, -20.0], [north_m, 40.0]]
    plan = make_plan(fleet(simulation1, changes=(at(LITTLE, 0.0), {**LITTLE, "gate_m": gate})))
    assert verify(plan).ok
    first, second = plan.moves
    assert (north_m - 2.0) / 38.0 * 30.0 < first.end_s <= second.start_s


def test_a_scheduled_change_opens_the_way_that_it_is_there_for(simulation1: Scenario) -> None:
    """A gap is not refused because the formation does not pass it in its first shape."""
    narrow = gap(simulation1, 5.0, (at(SHRINK, 2.0),))
    assert find_routes(flight_problem(narrow), survey(flight_problem(narrow)))
    too_narrow = gap(simulation1, 2.5, (at(SHRINK, 2.0),))
    with pytest.raises(Infeasible, match="no-fly zones block all routes"):
        make_plan(too_narrow)


def test_an_end_in_a_disk_has_a_way_that_the_optimiser_then_refuses(simulation1: Scenario) -> None:
    """`gcs check` says so before; without it there is still a sentence."""
    problem = flight_problem(fleet(simulation1, no_fly=[{"north_m": 40.0, "east_m": 14.0, "radius_m": 3.0}]))
    assert find_routes(problem, survey(problem))


def test_stops_are_the_shapes_of_the_schedule_alone(simulation1: Scenario) -> None:
    scenario = fleet(simulation1, 3, "row", (at(TURN, 1.0), auto(TO_ROW), at(SHRINK, 20.0)))
    start, turned, shrunk = stops_ned_m(scenario)
    np.testing.assert_array_equal(start, offsets_ned_m(scenario))
    np.testing.assert_allclose(turned, start[:, [1, 0, 2]] * [-1.0, 1.0, 1.0], atol=1e-12)
    np.testing.assert_allclose(shrunk, 0.5 * turned, atol=1e-12)


def test_guessed_times_are_put_in_turn_and_told_ones_are_not(simulation1: Scenario) -> None:
    gated: dict[str, Any] = {**LITTLE, "gate_m": GATE}
    scenario = fleet(simulation1, changes=(gated, at(LITTLE, 10.0), gated, gated), time={"flight_s": 60.0})
    lengths = [move.end_s - move.start_s for move in lay(scenario, (0.0, 10.0, 20.0, 30.0), 0.0, 60.0).moves]
    random = np.random.default_rng(1)
    for _ in range(50):
        guessed = random.uniform(-5.0, 70.0, 4)
        guessed[1] = 10.0
        starts = in_turn(scenario, tuple(guessed.tolist()), 60.0)
        assert starts[1] == 10.0
        assert len(lay(scenario, starts, 0.0, 60.0).moves) == 4
    wanted = (1.0, 10.0, 20.0, 40.0)
    assert in_turn(scenario, wanted, 60.0) == wanted
    assert in_turn(scenario, (9.0, 10.0, 10.0, 11.0), 60.0) == pytest.approx(
        (10.0 - lengths[0], 10.0, 10.0 + lengths[1], 10.0 + lengths[1] + lengths[2])
    )
