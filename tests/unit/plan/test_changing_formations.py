"""Flights whose formation changes, from scenario to plan: what was asked for happens, when, and within every limit."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.distance import pdist
from scipy.spatial.transform import Rotation

from gcs.errors import Infeasible
from gcs.plan.plan_file import load_plan, save_plan
from gcs.plan.planner import make_plan
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.verify import Report, verify
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.values.si import offsets_ned_m
from gcs.types import Array
from tests.unit.plan.formations import BEYOND, FLIGHTS, GATE, PASS, SHRINK, TURN, Planned, at, auto, fleet, gap
from tests.unit.plan.problems import changed

AUTOMATIC = ["auto shrink", "auto turn", "auto reshape", "auto shrink in a pass"]
LONG = ("course", "course and schedule", "auto turn", "auto reshape", "auto shrink in a pass")  # to plan


def by_length(names: Iterable[str]) -> list[Any]:
    return [pytest.param(name, marks=pytest.mark.slow) if name in LONG else name for name in names]


@pytest.fixture(params=by_length(FLIGHTS))
def case(request: pytest.FixtureRequest, planned: Planned) -> tuple[Plan, Report]:
    return planned(request.param)


def in_flight(plan: Plan, step_s: float) -> Array:
    """Instants of the mission, its end left out."""
    return np.arange(0.0, plan.flight_s, step_s)


def test_the_verifier_passes_it(case: tuple[Plan, Report]) -> None:
    _, report = case
    assert report.ok, [str(check) for check in report.failures]


def test_no_vehicle_is_faster_or_accelerates_more_than_it_may(case: tuple[Plan, Report]) -> None:
    """By finite differences every 10 ms, and by Eq. 1 from states and controls."""
    plan, _ = case
    limits, step = plan.scenario.limits, 0.01
    t = in_flight(plan, step)
    states = plan.states(t)
    speed, rise = (np.abs(part[:, 2:] - part[:, :-2]) / (2.0 * step) for part in (states[..., :3], states[..., 3:6]))
    assert (speed.max(axis=(0, 1)) <= 1.001 * np.array(limits.speed_ned_mps)).all()
    assert limits.accel_max_mps2 is not None
    assert np.linalg.norm(plan.accelerations(t), axis=-1).max() <= 1.001 * limits.accel_max_mps2
    assert (
        np.linalg.norm(rise, axis=-1).max() <= 1.003 * limits.accel_max_mps2
    )  # polynomials of Eq. 1, not its solution


@pytest.mark.parametrize("name", ["tight turn", "tight shrink"])
def test_limits_bind_where_they_are_tight(planned: Planned, name: str) -> None:
    """So that the test above is about something: of every vehicle's motion the limit is used up."""
    plan, _ = planned(name)
    t = in_flight(plan, 0.01)
    fastest = np.abs(plan.states(t)[..., 3]).max()
    hardest = np.linalg.norm(plan.accelerations(t), axis=-1).max()
    assert fastest > 0.99 * 2.2 or hardest > 0.99 * 0.5


def test_own_motion_in_the_shape_keeps_its_limits(case: tuple[Plan, Report]) -> None:
    plan, _ = case
    t = in_flight(plan, 0.01)
    wanted = plan.scenario.formation
    assert np.linalg.norm(plan.offsets(t, 1), axis=-1).max() <= 1.001 * wanted.change_speed_mps
    assert np.linalg.norm(plan.offsets(t, 2), axis=-1).max() <= 1.001 * wanted.change_accel_mps2


def test_vehicles_keep_apart(case: tuple[Plan, Report]) -> None:
    plan, _ = case
    places = plan.states(in_flight(plan, 0.1))[..., :3]
    least = min(pdist(at_once).min() for at_once in np.moveaxis(places, 1, 0))
    assert least >= plan.scenario.limits.separation_min_m - 1e-3


def test_offsets_go_on_at_every_joint_to_the_jerk(case: tuple[Plan, Report]) -> None:
    plan, _ = case
    joints = plan.shape.joints_s
    joints = joints[(joints >= 0.0) & (joints <= plan.flight_s)]  # on the way from uneven ground its jerk may jump
    for order, tolerance in enumerate((1e-8, 1e-7, 1e-6, 1e-4)):
        left = plan.offsets(np.nextafter(joints, -np.inf), order)
        np.testing.assert_allclose(plan.offsets(joints, order), left, atol=tolerance)


def test_states_and_speeds_belong_together(case: tuple[Plan, Report]) -> None:
    plan, _ = case
    t, step = in_flight(plan, 0.037)[1:-1], 1e-4
    rate = (plan.states(t + step) - plan.states(t - step)) / (2.0 * step)
    states = plan.states(t)
    np.testing.assert_allclose(rate[..., :3], states[..., 3:6], atol=3e-3)
    np.testing.assert_allclose(rate[..., 6:9], states[..., 9:12], atol=2e-3)
    np.testing.assert_allclose(plan.states(t)[plan.leader], plan.leader_trajectory.state(t), atol=1e-9)


def expected_end(name: str, plan: Plan) -> Array:
    """Offsets (V, 3) after everything, written down without the planner's functions."""
    start = offsets_ned_m(plan.scenario)
    turned = Rotation.from_euler("z", 90.0, degrees=True).apply(start)
    after: dict[str, Array] = {
        "turn": turned,
        "tight turn": turned,
        "shrink": 0.5 * start,
        "tight shrink": 3.0 * start,
        "lanes": start * [1.0, -1.0, 1.0],
        "gates": 0.5 * turned,
        "scheduled shrink before a gap": 0.5 * start,
    }
    return after.get(name, start)


@pytest.mark.parametrize(
    "name",
    by_length(
        n
        for n in FLIGHTS
        if n in AUTOMATIC or n not in ("reshape", "reshape and turn", "course", "course and schedule")
    ),
)
def test_it_begins_in_its_first_shape_and_lands_under_its_last(planned: Planned, name: str) -> None:
    plan, _ = planned(name)
    start, end = offsets_ned_m(plan.scenario), expected_end(name, plan)
    arrived = np.array(plan.scenario.end.position_m) * [1.0, 1.0, -1.0]
    np.testing.assert_allclose(plan.offsets(np.array([0.0]))[:, 0], start, atol=1e-6)
    np.testing.assert_allclose(plan.states(np.array([plan.flight_s]))[:, 0, :3], arrived + end, atol=1e-4)
    ground = plan.states(np.array([plan.t_end_s]))[:, 0, :3]
    np.testing.assert_allclose(ground[:, :2], (arrived + end)[:, :2], atol=1e-4)
    np.testing.assert_allclose(plan.landing_points_ned_m, ground, atol=1e-6)
    np.testing.assert_allclose(ground[:, 2], -plan_ground_m(plan, ground), atol=1e-6)


def plan_ground_m(plan: Plan, places: Array) -> Array:
    """Mountains alone (Eq. 53)."""
    m = plan.scenario.terrain.mountains
    height = np.zeros(len(places))
    for n, e, h, sn, se in zip(m.north_m, m.east_m, m.height_m, m.spread_north_m, m.spread_east_m, strict=True):
        height += h * np.exp(-(((places[:, 0] - n) / sn) ** 2) - ((places[:, 1] - e) / se) ** 2)
    return height


def test_a_free_reshape_ends_with_every_place_taken(planned: Planned) -> None:
    plan, _ = planned("reshape")
    end = plan.offsets(np.array([plan.flight_s]))[:, 0]
    row = [[0.0, 3.0 * i, 0.0] for i in (-2, -1, 0, 1, 2)]
    np.testing.assert_allclose(sorted(end.tolist(), key=lambda place: place[1]), row, atol=1e-9)
    np.testing.assert_array_equal(end[plan.leader], 0.0)


@pytest.mark.parametrize("name", ["turn", "shrink", "reshape", "lanes"])
def test_a_change_at_a_time_begins_then_and_not_before(planned: Planned, name: str) -> None:
    plan, _ = planned(name)
    (move,) = plan.moves
    (change,) = plan.scenario.formation.change
    assert change.at_s is not None
    assert move.start_s == change.at_s
    before, after = np.array([move.start_s - 1e-6, move.end_s + 1e-6])
    np.testing.assert_array_equal(plan.offsets(np.array([0.0, before]), 1), 0.0)
    np.testing.assert_allclose(plan.offsets(np.array([before]))[:, 0], offsets_ned_m(plan.scenario), atol=1e-12)
    assert np.abs(plan.offsets(np.array([0.5 * (move.start_s + move.end_s)]), 1)).max() > 0.05
    np.testing.assert_allclose(plan.offsets(np.array([after, plan.flight_s]), 1), 0.0, atol=1e-9)
    assert plan.shape.moving_s == ((move.start_s, move.end_s),)


def test_a_change_at_a_gate_begins_when_the_leader_crosses_it(planned: Planned) -> None:
    plan, _ = planned("gates")
    first, second = plan.moves
    t = in_flight(plan, 1e-3)
    north = plan.leader_trajectory.state(t)[:, 0]
    for move, gate_m in ((first, GATE[0][0]), (second, BEYOND[0][0])):
        crossed_s = t[np.flatnonzero(north >= gate_m)[0]]
        assert abs(move.start_s - crossed_s) <= 0.05
        assert (move.start_s, move.end_s) in plan.shape.moving_s
    assert "gate (15, -20)-(15, 40)" in first.trigger


@pytest.mark.parametrize("name", by_length(["course", "course and schedule"]))
def test_with_the_course_the_formation_faces_where_it_flies(planned: Planned, name: str) -> None:
    plan, _ = planned(name)
    t = in_flight(plan, 0.02)
    v = plan.leader_trajectory.state(t)[:, 3:6]
    # Its own turn: the direction of vehicles that were behind the leader at the start. A free reshape exchanges places.
    start = offsets_ned_m(plan.scenario)[:, 0] + 1j * offsets_ned_m(plan.scenario)[:, 1]
    rigid = t < (10.0 if "schedule" in name else np.inf)
    seen = plan.offsets(t)[..., 0] + 1j * plan.offsets(t)[..., 1]
    facing = np.angle(np.conj(start) @ seen)
    away = np.degrees(np.abs(np.angle(np.exp(1j * (np.arctan2(v[:, 1], v[:, 0]) - facing)))))
    moves = (np.hypot(v[:, 0], v[:, 1]) > 1.0) & rigid
    assert moves.sum() > 100
    assert away[moves].max() <= 1.01 * plan.scenario.formation.course_tolerance_deg
    if name == "course":
        assert np.degrees(np.ptp(facing)) > 25.0
        np.testing.assert_allclose(np.abs(seen), np.abs(start)[:, None].repeat(len(t), axis=1), atol=1e-6)


def scales(plan: Plan, t: Array) -> Array:
    """Size of the formation relative to its start (N,)."""
    start = offsets_ned_m(plan.scenario)
    return np.asarray(np.linalg.norm(plan.offsets(t), axis=-1).max(axis=0) / np.linalg.norm(start, axis=1).max())


@pytest.mark.parametrize("name", ["auto shrink", "auto shrink in a pass"])
def test_an_automatic_shrink_is_there_in_the_gap_and_nowhere_else(planned: Planned, name: str) -> None:
    plan, _ = planned(name)
    t = in_flight(plan, 0.1)
    size = scales(plan, t)
    north = plan.leader_trajectory.state(t)[:, 0]
    inside = np.abs(north - 40.0) < 1.0
    assert size[inside].max() < 0.9
    assert size.min() >= 0.5 - 1e-6
    assert size.max() <= 1.025 + 1e-6
    assert scales(plan, np.array([0.0, plan.flight_s - 1e-9])) == pytest.approx(1.0, abs=1e-6)
    assert np.abs(size[np.abs(north - 40.0) > 35.0] - 1.0).max() < 0.05
    # No formation but a smaller or larger one: each vehicle in line with its place.
    start = offsets_ned_m(plan.scenario)
    np.testing.assert_allclose(plan.offsets(t), size[:, None] * start[:, None], atol=1e-6)
    (move,) = plan.moves
    assert (move.kind, move.trigger) == ("shrink", "auto")
    assert move.start_s < t[inside].min() < t[inside].max() < move.end_s


@pytest.mark.slow
def test_an_automatic_turn_brings_the_row_through_and_back(planned: Planned) -> None:
    plan, _ = planned("auto turn")
    t = in_flight(plan, 0.1)
    offsets = plan.offsets(t)
    np.testing.assert_allclose(
        np.linalg.norm(offsets, axis=-1), np.linalg.norm(offsets[:, :1], axis=-1).repeat(len(t), 1), atol=1e-6
    )
    inside = np.abs(plan.leader_trajectory.state(t)[:, 0] - 40.0) < 1.0
    assert np.abs(offsets[..., 1]).max(axis=0)[inside].max() < 5.5  # of 6 m
    np.testing.assert_allclose(plan.offsets(np.array([plan.flight_s]))[:, 0], offsets_ned_m(plan.scenario), atol=1e-6)
    assert [move.kind for move in plan.moves] == ["rotate"]


@pytest.mark.slow
def test_an_automatic_reshape_goes_some_of_the_way_and_back(planned: Planned) -> None:
    plan, _ = planned("auto reshape")
    t = in_flight(plan, 0.1)
    inside = np.abs(plan.leader_trajectory.state(t)[:, 0] - 40.0) < 1.0
    offsets = plan.offsets(t)
    assert np.abs(offsets[..., 1]).max(axis=0)[inside].max() < 5.5
    assert offsets[..., 0].min() < -0.5  # some fall back, towards the file
    np.testing.assert_allclose(plan.offsets(np.array([plan.flight_s]))[:, 0], offsets_ned_m(plan.scenario), atol=1e-6)
    assert [move.kind for move in plan.moves] == ["reshape"]


@pytest.mark.parametrize("more", [{}, PASS], ids=["disks", "mountains"])
def test_a_rigid_formation_has_no_way_there(simulation1: Scenario, more: dict[str, Any]) -> None:
    with pytest.raises(Infeasible) as caught:
        make_plan(gap(simulation1, 5.0, (), **more))
    assert caught.value.hint


@pytest.mark.slow
def test_a_rigid_formation_goes_round_where_it_can(simulation1: Scenario, planned: Planned) -> None:
    """Room for all vehicles past one of two disks whose gap is too narrow for the row; it costs more than shrinking."""
    disks = [{"north_m": 40.0, "east_m": east, "radius_m": 11.0} for east in (-16.0, 16.0)]
    room = {"east_m": [-60.0, 60.0]}
    plan = make_plan(gap(simulation1, 5.0, (), no_fly=disks, limits=room, time={"flight_s": 50.0}))
    assert verify(plan).ok
    assert np.abs(plan.leader_trajectory.state(in_flight(plan, 0.5))[:, 1]).max() > 27.0
    assert plan.objective > planned("auto shrink")[0].objective


def test_what_the_rigid_formation_could_do_is_told_beside_it(simulation1: Scenario) -> None:
    plan = make_plan(fleet(simulation1, 5, "row", (auto(SHRINK),)), every_way=True)
    changing, rigid = plan.alternatives
    assert rigid.verdict == f"rigid: {changing.verdict}" == "rigid: verified between nodes"
    assert rigid.objective == pytest.approx(plan.objective, abs=1e-4)  # nothing is in the way of either


@pytest.mark.parametrize("name", by_length(["gates", "auto reshape"]))
def test_a_plan_comes_back_from_disk_as_it_was(planned: Planned, name: str, tmp_path: Path) -> None:
    plan, report = planned(name)
    save_plan(plan, report, tmp_path / "plan.skein")
    again, verdict = load_plan(tmp_path / "plan.skein")
    assert again.hash == plan.hash
    assert verdict == report
    assert again.moves == plan.moves
    assert again.shape.moving_s == plan.shape.moving_s
    t = np.linspace(plan.t_start_s, plan.t_end_s, 97)
    for order in range(5):
        np.testing.assert_array_equal(again.offsets(t, order), plan.offsets(t, order))
    np.testing.assert_array_equal(again.states(t), plan.states(t))
    np.testing.assert_array_equal(again.controls(t), plan.controls(t))


def test_another_shape_is_another_plan(planned: Planned) -> None:
    plan, _ = planned("turn")
    tables = plan.shape.basis_ned_m.copy()
    tables[0, 1, 0] += 1e-9
    functions = plan.shape.functions
    curves = functions.c.copy()
    curves[0, -1, 0] += 1e-12
    others = [
        replace(plan, shape=replace(plan.shape, basis_ned_m=tables)),
        replace(plan, shape=replace(plan.shape, functions=type(functions)(curves, functions.x))),
        replace(plan, scenario=changed(plan.scenario, formation={"change": [at({**TURN, "angle_deg": 91.0}, 2.0)]})),
    ]
    assert len({plan.hash, *(other.hash for other in others)}) == 4
