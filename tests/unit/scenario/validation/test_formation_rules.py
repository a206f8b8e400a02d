"""Formations that change, against limits and times: each rule is broken alone, and kept to the last bit."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs.scenario.schema.mistake import Mistake
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.validation.cross_table import check, least_acceleration_mps2
from tests.unit.scenario.variants import Data, changed, counted, counted_scenario, with_changes

# Simulation 1 keeps 0.4 m; its vehicles 2 and 5 are the nearest, 0.5 m apart.
GRID = {"name": "grid", "generator": "grid", "spacing_m": 2.0}
TURN = {"kind": "rotate", "angle_deg": 30.0, "at_s": 50.0}


@pytest.fixture(scope="module")
def data(repo_root: Path) -> Data:
    return tomllib.loads((repo_root / "missions" / "simulation1" / "scenario.toml").read_text(encoding="utf-8"))


def sentences(data: Data) -> list[str]:
    return [str(mistake) for mistake in check(Scenario.model_validate(data))]


def shrink(scale: float, **when: Any) -> Data:
    return {"kind": "shrink", "scale": scale, **(when or {"at_s": 50.0})}


def test_six_vehicles_that_turn_and_shrink_are_clean(data: Data) -> None:
    grid = {**GRID, "spacing_m": 0.4}
    gate = {**TURN, "gate_m": [[-5.0, 10.0], [5.0, 10.0]], "at_s": None}
    back = {"kind": "reshape", "to": "start", "at_s": 200.0}
    to_grid = {"kind": "reshape", "to": "grid", "at_s": 100.0}
    # 0.8 of 0.5 m is the 0.4 m asked for, twice over: growing back comes between.
    changes = [gate, shrink(0.8), shrink(1.25, at_s=60.0), to_grid, back, shrink(0.8, at_s=220.0)]
    assert sentences(with_changes(data, *changes, shape=[grid])) == []


@pytest.mark.parametrize("generator", ["triangle", "line", "column", "vee", "grid", "circle"])
def test_a_thousand_vehicles_are_clean(data: Data, generator: str) -> None:
    shape = {"name": "all", "generator": generator, "spacing_m": 0.4}
    assert sentences(counted(data, 1000, shape, change=[TURN], frame="course")) == []


def test_a_counted_formation_starts_where_start_says(data: Data) -> None:
    """A leader in the middle of the list, and a table whose leader is not at its origin."""
    table = {"name": "row", "offsets_m": [[10.0, 0.0, 5.0], [10.0, 2.0, 5.0], [10.0, 4.0, 5.0]]}
    edge = changed(counted(data, 3, table, leader=2), "limits", "east_m", [5.0, 1600.0])
    assert sentences(changed(edge, "start", "position_m", [2.0, 7.0, 3.0])) == []
    (sentence,) = sentences(changed(edge, "start", "position_m", [2.0, 6.0, 3.0]))
    assert sentence.startswith("start.position_m[1] = 6.0: puts vehicle 1 outside the box, east 5 to 1600 m")
    assert sentence.endswith("vehicle 1 would be at 4. Set start.position_m[1] to 7, or limits.east_m to [4, 1600]")


def test_shapes_keep_vehicles_apart(data: Data) -> None:
    grid = {**GRID, "spacing_m": 0.39}
    assert sentences(counted(data, 6, grid)) == [
        "formation.shape[0].spacing_m = 0.39: vehicles 1 and 2 are 0.39 m apart; limits.separation_min_m requires "
        "0.4 m; 6 more pairs are too close. Set formation.shape[0].spacing_m to 0.4 or more"
    ]
    table = {
        "name": "table",
        "offsets_m": [[0, 0, 0], [1, 0, 0], [2, 0, 0], [2, 0.25, 0], [-1, 0, 0], [-1, 0, 0]],
    }
    assert sentences(with_changes(data, shape=[GRID, table])) == [
        "formation.shape[1].offsets_m[5] = [-1.0, 0.0, 0.0]: vehicles 5 and 6 are 0.00 m apart; "
        "limits.separation_min_m requires 0.4 m. Move vehicle 6 away by 0.4 m or more",
        "formation.shape[1].offsets_m[3] = [2.0, 0.25, 0.0]: vehicles 3 and 4 are 0.25 m apart; "
        "limits.separation_min_m requires 0.4 m. Move vehicle 4 away by 0.15 m or more",
    ]


def test_many_pairs_too_near_are_counted_and_the_nearest_told(data: Data) -> None:
    found = sentences(changed(data, "limits", "separation_min_m", 3.0))
    assert "formation.vehicle[4].position_m = [0.0, 0.5, 3.0]: vehicles 2 and 5 are 0.50 m apart" in found[0]
    pairs = [text for text in found if text.startswith("formation.vehicle")]
    assert len(pairs) == 11
    assert pairs[-1] == ("formation.vehicle: 5 more pairs of vehicles are closer than limits.separation_min_m allows")


def test_scheduled_shrinking_keeps_vehicles_apart(data: Data) -> None:
    assert sentences(with_changes(data, shrink(0.9), shrink(0.85))) == [
        "formation.change[1].scale = 0.85: would bring vehicles 2 and 5 from 0.45 m to 0.38 m; "
        "limits.separation_min_m requires 0.4 m. Give a scale of at least 0.889"
    ]
    tight = {**GRID, "spacing_m": 0.4}
    to_grid = {"kind": "reshape", "to": "grid", "at_s": 60.0}
    (sentence,) = sentences(with_changes(data, to_grid, shrink(0.99, at_s=70.0), shape=[tight]))
    assert sentence.endswith(
        "from 0.40 m to 0.40 m; limits.separation_min_m requires 0.4 m. Remove the change: the shape cannot shrink here"
    )


def test_one_shape_too_tight_is_told_once(data: Data) -> None:
    """Not again by every change that begins in it, nor by those that wait to see it."""
    to_grid = {"kind": "reshape", "to": "grid", "at_s": 60.0}
    changes = [to_grid, shrink(0.9, at_s=70.0), shrink(0.9, auto=True)]
    (sentence,) = sentences(with_changes(data, *changes, shape=[{**GRID, "spacing_m": 0.3}]))
    assert sentence.startswith("formation.shape[0].spacing_m = 0.3")
    (sentence,) = sentences(with_changes(data, shrink(0.7), shrink(0.9)))
    assert sentence.startswith("formation.change[0].scale = 0.7")


def test_what_changes_by_itself_does_not_stay(data: Data) -> None:
    """Shrinking on schedule begins in the scheduled shape, however tight the one is that may come between."""
    to_grid = {"kind": "reshape", "to": "grid", "auto": True}
    tight = {**GRID, "spacing_m": 0.4}
    assert sentences(with_changes(data, to_grid, shrink(0.8), shape=[tight])) == []


def test_the_least_scale_told_is_allowed(data: Data) -> None:
    (sentence,) = sentences(with_changes(data, shrink(0.7), shape=[{**GRID, "spacing_m": 0.7}]))
    assert sentence.endswith("Give a scale of at least 0.8")
    assert sentences(with_changes(data, shrink(0.8))) == []


def test_automatic_shrinking_is_held_by_the_tightest_shape_it_may_meet(data: Data) -> None:
    auto = shrink(0.75, auto=True)
    (sentence,) = sentences(with_changes(data, auto))
    assert sentence == (
        "formation.change[0].scale = 0.75: may bring vehicles 2 and 5 from 0.50 m to 0.38 m; "
        "limits.separation_min_m requires 0.4 m. Give a scale of at least 0.8"
    )
    # A schedule that is tight only for a while counts, before or behind in the list.
    wide = {**GRID, "spacing_m": 2.0}
    to_wide = {"kind": "reshape", "to": "grid", "at_s": 20.0}
    schedule = [to_wide, shrink(0.25), shrink(8.0, at_s=100.0)]
    for changes, index in (([auto, *schedule], 0), ([*schedule, auto], 3)):
        grown = counted(data, 6, {**GRID, "name": "start-grid"}, change=changes)
        grown["formation"]["shape"].append(wide)
        (sentence,) = sentences(grown)
        assert sentence.startswith(f"formation.change[{index}].scale = 0.75: may bring vehicles 1 and 2 from 0.50 m")


def test_changes_begin_before_the_flight_ends(data: Data) -> None:
    assert sentences(with_changes(data, {**TURN, "at_s": 274.9})) == []
    assert sentences(with_changes(data, {**TURN, "at_s": 275.0})) == [
        "formation.change[0].at_s = 275.0: is after the flight, which ends at time.flight_s = 275. "
        "Set formation.change[0].at_s to less than 275"
    ]


@pytest.mark.parametrize(
    ("gate_m", "inside"),
    [
        ([[10.0, 10.0], [20.0, 10.0]], True),
        ([[-10.0, 10.0], [2000.0, 10.0]], True),  # both ends outside, the middle inside
        ([[-10.0, 10.0], [10.0, -10.0]], True),  # through the corner
        ([[-10.0, 9.0], [9.0, -10.0]], False),  # just past the corner
        ([[0.0, -10.0], [0.0, 2000.0]], True),  # along an edge
        ([[-0.1, 0.0], [-0.1, 1500.0]], False),
        ([[100.0, 1500.1], [200.0, 1500.1]], False),
    ],
)
def test_gates_are_where_somebody_may_fly(data: Data, gate_m: list[list[float]], inside: bool) -> None:
    for gate in (gate_m, gate_m[::-1]):
        found = sentences(with_changes(data, {**TURN, "at_s": None, "gate_m": gate}))
        assert len(found) == (0 if inside else 1)
        for sentence in found:
            assert sentence.startswith(
                f"formation.change[0].gate_m = {gate}: lies outside the box of [limits], north 0 to 1500 m"
            )


def test_changes_ask_no_more_of_a_vehicle_than_it_may(data: Data) -> None:
    limited = changed(data, "limits", "accel_max_mps2", 0.5)
    asks = {"change_speed_mps": 8.0, "change_accel_mps2": 0.6}
    assert sentences(with_changes(limited, **asks)) == []  # without a change the rule does not apply
    assert sentences(with_changes(limited, TURN, **asks)) == [
        "formation.change_speed_mps = 8.0: faster than any vehicle: limits.speed_ned_mps allows 7.35 m/s",
        "formation.change_accel_mps2 = 0.6: more than any vehicle: limits.accel_max_mps2 allows 0.5 m/s²",
    ]


@pytest.mark.parametrize(
    ("formation", "all_vehicles"),
    [
        ({}, True),
        ({"change": [shrink(0.9, auto=True)]}, True),
        ({"change": [shrink(0.9)]}, False),
        ({"frame": "course"}, False),
    ],
)
def test_the_end_of_followers_is_judged_where_it_is_known(data: Data, formation: Data, all_vehicles: bool) -> None:
    """Vehicle 3 has the highest ground at the end, is outside the box there, and in the disk; the leader is not."""
    narrow = changed(data, "limits", "east_m", [0.0, 1000.5])
    beside = [{"north_m": 1198.0, "east_m": 1001.0, "radius_m": 0.5}]
    hill = {"north_m": [1198.0], "east_m": [1001.5], "height_m": [6.0], "spread_north_m": [1.0], "spread_east_m": [1.0]}
    for broken in (narrow, {**data, "no_fly": beside}, changed(data, "terrain", "mountains", hill)):
        assert bool(sentences(with_changes(broken, **formation))) == all_vehicles


@pytest.mark.parametrize("formation", [{}, {"change": [TURN]}])
def test_the_end_of_the_leader_is_always_judged(data: Data, formation: Data) -> None:
    high = changed(with_changes(data, **formation), "end", "position_m", [1200.0, 1000.0, 36.0])
    (sentence,) = [text for text in sentences(high) if text.startswith("end.position_m[2]")]
    assert ("puts vehicle 1 outside" in sentence) == bool(formation)


def test_vehicles_above_each_other_have_no_pads(data: Data) -> None:
    stack = {"name": "stack", "offsets_m": [[0.0, 0.0, 0.0], [0.0, 0.1, 3.0], [5.0, 0.0, 0.0]]}
    (sentence,) = sentences(changed(counted(data, 3, stack), "ground_phases", "takeoff_s", 25.0))
    assert sentence == (
        'formation.start_shape = "stack": vehicles 1 and 2 fly above each other and would take off 0.10 m apart; '
        "limits.separation_min_m requires 0.4 m"
    )
    # Once up, a formation may take any shape: its landing points are not known yet.
    row = {"name": "row", "generator": "line", "spacing_m": 2.0}
    to_stack = {"kind": "reshape", "to": "stack", "at_s": 50.0}
    changing = counted(data, 3, row, change=[to_stack])
    changing["formation"]["shape"].append(stack)
    assert sentences(changing) == []


def test_landing_points_are_apart_where_they_are_known(data: Data) -> None:
    """Two pads on a slope too steep to be near each other; where both would land, the ground is flat."""
    stack = {"name": "stack", "offsets_m": [[0.0, 0.0, 0.0], [0.0, 0.1, 3.0]]}
    hill = {"north_m": [-15.7], "east_m": [-17.3], "height_m": [6.0], "spread_north_m": [1.0], "spread_east_m": [1.0]}
    for change, known in (([], True), ([TURN], False)):
        steep = changed(counted(data, 2, stack, change=change), "terrain", "mountains", hill)
        found = [text for text in sentences(steep) if "above each other" in text]
        assert len(found) == known
        assert all("would land 0.10 m apart" in text for text in found)


def test_a_long_list_of_vehicles_outside_is_cut(data: Data) -> None:
    line = {"name": "line", "generator": "line", "spacing_m": 2.0}
    found = sentences(changed(counted(data, 1000, line), "limits", "east_m", [-600.0, 1500.0]))
    assert (
        "puts vehicles 603, 605, 607, 609, 611, 613, 615, 617, and 191 more outside the box, east -600 to 1500 m"
        in found[0]
    )


def test_acceleration_is_enough_for_takeoff_run_up_and_flight(data: Data) -> None:
    def found(most_mps2: float) -> set[str]:
        limited = changed(data, "limits", "accel_max_mps2", most_mps2)
        return {str(mistake).partition(";")[0] for mistake in check(Scenario.model_validate(limited))}

    assert found(0.16) == set()
    assert found(0.15) == {
        "limits.accel_max_mps2 = 0.15: too little for a run-up of 25 m in 20 s, which takes at least 0.159 m/s². "
        "Set limits.accel_max_mps2 to 0.159 or more"
    }
    # From 2.83 m/s to rest over 1560 m in 275 s.
    flight = "too little to cover 1560 m in time.flight_s, which takes at least 0.064 m/s²"
    assert any(text.startswith(f"limits.accel_max_mps2 = 0.06: {flight}") for text in found(0.06))
    takeoff = [text for text in found(0.06) if text.startswith("ground_phases.takeoff_s")]
    assert takeoff == ["ground_phases.takeoff_s = 12.0: too short for 2.8 m from rest to rest"]


@given(st.floats(0.0, 5.0), st.floats(1.0, 300.0), st.floats(0.0, 1.0))
def test_least_acceleration_is_that_of_full_thrust_and_full_braking(speed: float, time_s: float, share: float) -> None:
    """Accelerate for a share of the time, then brake to rest at the same rate: no less does."""
    first_s = share * 0.499 * time_s
    accel = speed / (time_s - 2.0 * first_s)  # from `speed` to rest, by v + a t1 = a (T - t1)
    peak = speed + accel * first_s
    way = (speed + peak) / 2.0 * first_s + peak / 2.0 * (time_s - first_s)
    along = np.array([0.6, -0.8, 0.0])
    assert least_acceleration_mps2(way * along, speed * along, time_s) == pytest.approx(accel, abs=1e-12)


@given(st.lists(st.tuples(*[st.floats(-3.0, 3.0)] * 3), min_size=1, max_size=8), st.floats(1.0, 100.0))
def test_no_motion_does_with_less_than_the_least_acceleration(accel: list[tuple[float, ...]], time_s: float) -> None:
    pieces, step_s = np.array(accel), time_s / len(accel)
    before = -pieces.sum(axis=0) * step_s  # so that the motion ends at rest
    velocity, way = before, np.zeros(3)
    for piece in pieces:
        way = way + velocity * step_s + piece * step_s**2 / 2.0
        velocity = velocity + piece * step_s
    most = np.linalg.norm(pieces, axis=1).max()
    assert least_acceleration_mps2(way, before, time_s) <= most * (1.0 + 1e-9) + 1e-12
    # The same motion backwards goes from rest to a velocity.
    assert least_acceleration_mps2(-way, -before, time_s) <= most * (1.0 + 1e-9) + 1e-12


def test_a_way_aside_takes_as_much_as_the_worse_of_two_directions() -> None:
    """Uniform braking from 4 m/s in 10 s leads 20 m ahead. What is needed beside that is 4 times the way / time^2."""
    velocity = np.array([4.0, 0.0, 0.0])
    for aside_m in (0.0, 5.0, 15.0, 40.0):
        way = np.array([20.0, 0.6 * aside_m, -0.8 * aside_m])
        needed = max(4.0 / 10.0, 4.0 * aside_m / 10.0**2)
        assert least_acceleration_mps2(way, velocity, 10.0) == pytest.approx(needed, rel=1e-12)


def test_rules_of_the_formation_wait_for_their_tables(data: Data) -> None:
    late = Scenario.model_validate(with_changes(data, {**TURN, "at_s": 300.0}))
    assert check(late, ("formation", "limits", "start", "end")) == []
    found: list[Mistake] = check(late, ("formation", "time"))
    assert [mistake.key for mistake in found] == [("formation", "change", 0, "at_s")]


def test_a_lone_vehicle_has_nobody_to_be_near(data: Data) -> None:
    assert check(counted_scenario(data, 1, GRID, change=[shrink(0.01), shrink(0.01, auto=True)])) == []
