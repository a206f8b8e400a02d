"""Every scenario under missions/ ends in a plan that the verifier passes, with the figures asked of Simulation 1."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely

from gcs.frames import geodetic_to_ned
from gcs.mission.drawings.drawing import Datum
from gcs.mission.drawings.route_formats import read_drawing
from gcs.plan.planner import make_plan
from gcs.plan.replanning.formation_rest import rest_of
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.coverage import coverage
from gcs.plan.verification.verify import verify
from gcs.scenario.schema.scenario import Terrain
from gcs.scenario.sources.load import load_scenario
from gcs.scenario.values.si import NED_FROM_UP, local_origin
from gcs.types import Array
from tests.unit.plan.route_flights import route_ned_m

MISSIONS = Path(__file__).resolve().parents[3] / "missions"
# One formation at each scale, and one vehicle; the README of every mission plans it as well.
FEW = ("field/scenario.toml", "simulation1/scenario.toml", "terminal_weighting/scenario.toml")
SCENARIOS = sorted(
    str(file.relative_to(MISSIONS)) for file in MISSIONS.glob("*/*.toml") if file.parent.name != "campaigns"
)


def test_the_missions_are_found() -> None:
    folders = {name.split("/")[0] for name in SCENARIOS}
    assert folders == {file.parent.name for file in MISSIONS.glob("*/README.md")}
    assert {
        "changes",
        "circuit",
        "field",
        "gap",
        "hundred",
        "ridge",
        "simulation1",
        "simulation2",
        "survey",
        "terminal_weighting",
    } <= folders


@pytest.mark.parametrize(
    "name", [name if name in FEW else pytest.param(name, marks=pytest.mark.slow) for name in SCENARIOS]
)
def test_it_is_verified(plan_of: Callable[[str], Plan], name: str) -> None:
    plan = plan_of(name)
    report = verify(plan)
    limits = plan.scenario.limits
    assert report.ok, report.failures
    assert report.clearance_min_m >= limits.clearance_min_m - 1e-3
    assert report.window_error_max_m <= 10e-3
    assert report.terminal_error_m <= 1e-3
    if report.separation_min_m is not None:
        assert report.separation_min_m >= limits.separation_min_m - 1e-3


def test_names_are_folders_and_files(repo_root: Path) -> None:
    """Plans are written under the scenario's name: no two may share it."""
    names = [load_scenario(MISSIONS / name).name for name in SCENARIOS]
    assert len(set(names)) == len(names)
    for name, file in zip(names, SCENARIOS, strict=True):
        folder, stem = file.removesuffix(".toml").split("/")
        assert name == (folder if stem == "scenario" else f"{folder}_{stem}")


def test_field_turns_twice_and_changes_its_height_once(plan_of: Callable[[str], Plan]) -> None:
    plan = plan_of("field/scenario.toml")
    states = plan.states(np.arange(5.0, plan.flight_s - 5.0, 0.1))[plan.leader]
    course = np.degrees(np.unwrap(np.arctan2(states[:, 4], states[:, 3])))
    right, left = course.max() - course[0], course.max() - course[-1]
    assert 60.0 < right < 120.0
    assert 60.0 < left < 120.0
    assert 180.0 <= plan.flight_s <= 240.0
    height = -states[:, 2]
    assert height[-1] - height[0] > 5.0
    assert np.min(np.diff(height)) > -0.01
    places = plan.offsets(np.array([0.0]))[:, 0, :2]
    nearest = np.sort(np.linalg.norm(places[:, None] - places, axis=-1))[:, 1]
    assert nearest == pytest.approx(np.full(6, 5.0), abs=0.01)


@pytest.mark.slow
def test_gap_is_passed_by_shrinking_and_only_so(plan_of: Callable[[str], Plan]) -> None:
    """A rigid formation has to fly round a mountain, and that costs more."""
    plan = plan_of("gap/scenario.toml")
    rigid = make_plan(
        plan.scenario.model_copy(update={"formation": plan.scenario.formation.model_copy(update={"change": ()})})
    )
    times = np.arange(0.0, plan.flight_s, 0.5)
    assert np.abs(plan.states(times)[plan.leader, :, 1]).max() < 1.0
    assert np.abs(rigid.states(times)[rigid.leader, :, 1]).max() > 80.0
    assert verify(rigid).ok
    assert rigid.objective > 1.3 * plan.objective
    (move,) = plan.moves
    assert (move.kind, move.trigger) == ("shrink", "auto")
    sizes = np.linalg.norm(plan.offsets(times), axis=2).max(axis=0)
    assert 0.55 < sizes.min() / sizes[0] < 0.65
    assert sizes[-1] == pytest.approx(sizes[0], rel=1e-3)


@pytest.mark.slow
def test_changes_come_in_order_at_their_time_or_place(plan_of: Callable[[str], Plan]) -> None:
    plan = plan_of("changes/scenario.toml")
    line, column, smaller, back = plan.moves
    assert [move.kind for move in plan.moves] == ["reshape", "rotate", "shrink", "reshape"]
    assert [line.start_s, smaller.start_s, back.start_s] == [10.0, 105.0, 180.0]
    assert plan.states(np.array([column.start_s]))[plan.leader, 0, 0] == pytest.approx(110.0, abs=0.2)
    assert all(move.end_s - move.start_s > move.paper_time_s for move in plan.moves)

    def extent_m(t_s: float) -> Array:
        return np.ptp(plan.offsets(np.array([t_s]))[:, 0], axis=0)

    assert extent_m(line.end_s) == pytest.approx([0.0, 60.0, 0.0], abs=1e-6)
    assert extent_m(column.end_s) == pytest.approx([60.0, 0.0, 0.0], abs=1e-6)
    assert extent_m(smaller.end_s) == pytest.approx([36.0, 0.0, 0.0], abs=1e-6)
    room_m = np.ptp([disk.east_m for disk in plan.scenario.no_fly]) - 2.0 * plan.scenario.no_fly[0].radius_m
    assert extent_m(line.end_s)[1] > room_m
    before, after = (plan.offsets(np.array([t]))[:, 0] for t in (0.0, back.end_s))
    assert sorted(map(tuple, np.round(after, 6) + 0.0)) == sorted(map(tuple, np.round(before, 6) + 0.0))


@pytest.mark.slow
def test_ridge_is_crossed_where_the_elevation_model_is_low(plan_of: Callable[[str], Plan]) -> None:
    """Planned as if the ground were level, six vehicles fly into the ridge, which stands between two nodes."""
    plan = plan_of("ridge/scenario.toml")
    blind = make_plan(plan.scenario.model_copy(update={"terrain": Terrain()}))
    report = verify(replace(blind, scenario=plan.scenario))
    (worst,) = (c for c in report.failures if c.name == "clearance above ground" and c.phase == "mission")
    assert worst.worst < -10.0
    crossing = plan.states(np.arange(0.0, plan.flight_s, 0.5))[plan.leader]
    over = crossing[np.argmin(np.abs(crossing[:, 0] - 350.0))]
    assert 20.0 < over[1] < 100.0  # the pass is 60 m east
    assert report.clearance_min_m < 0.0 < verify(plan).clearance_min_m


def test_circuit_has_the_route_of_the_drawing_beside_it() -> None:
    scenario = load_scenario(MISSIONS / "circuit")
    drawing = read_drawing(MISSIONS / "circuit" / "circuit.plan")
    assert all(point.datum is Datum.HOME for point in drawing.points)
    assert drawing.home is not None
    origin = local_origin(scenario)
    assert (drawing.home.lat_deg, drawing.home.lon_deg, drawing.home.alt_amsl_m) == (
        pytest.approx((origin.lat_deg, origin.lon_deg, origin.alt_amsl_m))
    )
    drawn_m = [geodetic_to_ned(*p.place, drawing.home.alt_amsl_m + p.height_m, origin) for p in drawing.points]
    start_m = np.array(scenario.start.position_m) * NED_FROM_UP
    route_m = np.vstack([start_m, route_ned_m(scenario)])
    assert route_m.shape == (13, 3)
    assert np.linalg.norm(route_m - np.array(drawn_m), axis=1).max() < 0.1
    assert [point.hold_s or 0.0 for point in scenario.route] == [point.hold_s for point in drawing.points[1:]]
    assert scenario.end.position_m == scenario.start.position_m
    (inside,) = scenario.keep_in
    (fence,) = drawing.areas
    corners_m = np.array([geodetic_to_ned(*place, origin.alt_amsl_m, origin)[:2] for place in fence.corners])
    np.testing.assert_allclose(inside.polygon_m, corners_m, atol=0.1)


@pytest.mark.slow
def test_circuit_goes_round_the_hill_in_two_shapes_and_back_to_its_pads(plan_of: Callable[[str], Plan]) -> None:
    plan = plan_of("circuit/scenario.toml")
    assert [(move.kind, move.start_s) for move in plan.moves] == [
        ("reshape", pytest.approx(plan.route_s[3])),
        ("reshape", pytest.approx(plan.route_s[8])),
    ]
    leader = plan.states(np.arange(0.0, plan.flight_s, 0.5))[plan.leader]
    bearing = np.unwrap(np.arctan2(leader[:, 1], leader[:, 0] - 95.0))
    assert bearing[-1] - bearing[0] == pytest.approx(-2.0 * np.pi, abs=0.05)  # once round it, to the left
    passed_m = plan.states(np.array(plan.route_s))[plan.leader, :, :3]
    np.testing.assert_allclose(passed_m, route_ned_m(plan.scenario), atol=0.01)
    first, last = (plan.offsets(np.array([t_s]))[:, 0] for t_s in (0.0, plan.flight_s - 0.01))
    np.testing.assert_allclose(last, first, atol=1e-6)


def test_survey_mows_the_area_of_the_drawing_beside_it() -> None:
    scenario = load_scenario(MISSIONS / "survey")
    (drawn,) = read_drawing(MISSIONS / "survey" / "area.geojson").areas
    origin = local_origin(scenario)
    rings_m = [
        np.array([geodetic_to_ned(*place, origin.alt_amsl_m, origin)[:2] for place in ring])
        for ring in (drawn.corners, *drawn.holes)
    ]
    assert scenario.survey is not None
    assert len(scenario.survey.area.interiors) == 1
    assert scenario.survey.area.hausdorff_distance(shapely.Polygon(rings_m[0], rings_m[1:])) < 0.05
    assert np.hypot(*rings_m[0][0]) < 0.01  # the origin is the first corner
    assert scenario.end.position_m == scenario.start.position_m


@pytest.mark.slow
def test_survey_is_proved_to_see_all_of_it_and_to_turn_outside(plan_of: Callable[[str], Plan]) -> None:
    plan = plan_of("survey/scenario.toml")
    found = coverage(plan)
    assert found is not None
    assert found.is_complete, found.gaps()
    names = [point.name for point in plan.scenario.route]
    turns = [number for number, name in enumerate(names) if name is not None and name.startswith(("after", "before"))]
    places = plan.states(np.array(plan.route_s)[turns])[..., :2].reshape(-1, 2)
    assert not shapely.contains_xy(found.area, *places.T).any()


@pytest.mark.slow
def test_hundred_becomes_a_sphere_and_a_picture_of_geese(plan_of: Callable[[str], Plan]) -> None:
    plan = plan_of("hundred/scenario.toml")
    assert [(move.kind, move.start_s) for move in plan.moves] == [
        ("reshape", 5.0),
        ("reshape", 55.0),
        ("reshape", 115.0),
    ]
    first, sphere, picture, last = (
        plan.offsets(np.array([t_s]))[:, 0] for t_s in (0.0, *(move.end_s for move in plan.moves))
    )
    away_m = np.linalg.norm(sphere - 0.5 * (sphere.max(axis=0) + sphere.min(axis=0)), axis=1)
    assert np.ptp(away_m) < 0.1 * away_m.max()
    assert np.ptp(picture, axis=0) == pytest.approx([0.0, 142.8, 46.8], abs=0.01)
    assert sorted(map(tuple, np.round(last, 6) + 0.0)) == sorted(map(tuple, np.round(first, 6) + 0.0))


@pytest.mark.slow
def test_the_rest_of_a_plan_after_its_last_change_is_verified_in_the_places_that_vehicles_took(
    plan_of: Callable[[str], Plan],
) -> None:
    """Who took which place is seen in the shape in which the rest begins."""
    plan = plan_of("changes/scenario.toml")
    assert verify(rest_of(plan, plan.scheduled_moves[-1].end_s + 1.0)).ok
