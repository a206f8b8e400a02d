"""The verifier knows what every change must lead to: each kind of spoiled shape fails, and for its reason."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import PPoly
from scipy.spatial.distance import pdist

from gcs.plan import planner
from gcs.plan.formation import followers
from gcs.plan.formation.shape import Shape, joined, rigid, stretched
from gcs.plan.formation.timeline import lay
from gcs.plan.formation.transforms import rotation, shrinking, straight
from gcs.plan.replanning.remaining_plan import shape_part, trajectory_part
from gcs.plan.trajectory.phases import PhaseKind
from gcs.plan.trajectory.plan import Plan
from gcs.plan.trajectory.trajectory import Trajectory
from gcs.plan.verification.constraints.formation_checks import crossing_s, nearest_pair_m
from gcs.plan.verification.verify import verify
from gcs.scenario.values.si import offsets_ned_m
from tests.unit.plan.formations import GATE, SHRINK, TO_FILE, TURN, Planned, at, auto
from tests.unit.plan.problems import changed

ASSIGNMENT = "shortest assignment of a reshape (Eq. 14)"
PLACE, BEGINS, COURSE = "place in formation", "changes begin when they should", "heading along the course"
DOWN = np.array([0.0, 0.0, 1.0])


def failing(plan: Plan) -> set[str]:
    return {check.name for check in verify(plan).failures}


def in_shape(plan: Plan, mission: Shape) -> Plan:
    """The plan with another shape from T0 to the arrival."""
    return replace(plan, shape=planner._whole_shape(plan.scenario, mission, plan.phases))


def in_three(plan: Plan, leg: Shape, start_s: float, end_s: float) -> Plan:
    """Rigid, one change, rigid."""
    return in_shape(
        plan,
        joined(
            [rigid(leg.at(0.0), 0.0, start_s), stretched(leg, start_s, end_s), rigid(leg.at(1.0), end_s, plan.flight_s)]
        ),
    )


def nudged(plan: Plan, vehicle: int, by_m: float, start_s: float, end_s: float) -> Plan:
    """One vehicle there and back, as gently as it takes to change nothing but its place."""
    shape, columns = plan.shape, len(plan.shape.basis_ned_m)
    joints = np.union1d(shape.joints_s, [start_s, end_s])
    degree = max(len(shape.functions.c) - 1, 8)
    c = np.zeros((degree + 1, len(joints) - 1, columns + 1))
    for power in range(len(shape.functions.c)):  # the same functions, expanded about the new joints
        factorial = float(np.prod(np.arange(1.0, power + 1)))
        c[degree - power, :, :columns] = shape.functions(joints[:-1], nu=power) / factorial
    inside = int(np.searchsorted(joints, start_s))
    assert joints[inside + 1] == end_s
    bump = np.polynomial.Polynomial([0, 1, -1]) ** 4 * 256.0 / (1.0)
    length = end_s - start_s
    c[degree - 8 :, inside, columns] = bump.coef[::-1] / length ** np.arange(8.0, -1.0, -1.0)
    table = np.zeros((1, *shape.basis_ned_m.shape[1:]))
    table[0, vehicle, 1] = by_m
    return replace(plan, shape=Shape(PPoly(c, joints), np.concatenate([shape.basis_ned_m, table])))


def rest_of(plan: Plan, from_s: float) -> Plan:
    """What is left of a plan at an instant of its mission, as a re-plan has it."""
    mission = plan.phase(PhaseKind.MISSION)
    return replace(
        plan,
        leader_trajectory=trajectory_part(plan.leader_trajectory, from_s, plan.t_end_s),
        shape=shape_part(plan.shape, from_s, plan.t_end_s),
        phases=(replace(mission, start_s=from_s), *(p for p in plan.phases if p.start_s >= mission.end_s)),
        begin_state=tuple(plan.leader_trajectory.state(from_s).tolist()),
    )


@pytest.mark.parametrize("flight", [pytest.param("reshape and turn", marks=pytest.mark.slow), "lanes"])
def test_what_is_left_of_a_plan_passes_before_during_and_after_a_change(planned: Planned, flight: str) -> None:
    """What has flown is in no track any more: not the places before the change, nor where its first legs ended."""
    plan, _ = planned(flight)
    move = plan.moves[-1]
    inside = plan.shape.joints_s[(plan.shape.joints_s > move.start_s) & (plan.shape.joints_s < move.end_s)]
    edges = [move.start_s, *inside.tolist(), move.end_s]
    during = [0.3 * a + 0.7 * b for a, b in pairwise(edges)]
    assert len(during) > 1 or flight != "lanes"
    for from_s in (0.5 * move.start_s, *during, move.end_s + 2.0, plan.flight_s - 1.0):
        assert failing(rest_of(plan, from_s)) == set(), from_s
    off = nudged(rest_of(plan, move.end_s + 2.0), 1, 1.5e-3, move.end_s + 3.0, move.end_s + 4.0)
    assert PLACE in failing(off)


@pytest.mark.parametrize(("late_s", "said"), [(0.0, set()), (0.1, {BEGINS})])
def test_a_change_is_complete_when_it_should_be(planned: Planned, late_s: float, said: set[str]) -> None:
    plan, _ = planned("turn")
    (move,) = plan.moves
    done = {**TURN, "done_at_s": move.end_s - late_s}
    assert failing(replace(plan, scenario=changed(plan.scenario, formation={"change": [done]}))) == said


def test_a_vehicle_out_of_place_after_a_change_fails(planned: Planned) -> None:
    plan, _ = planned("turn")
    (move,) = plan.moves
    start_s, end_s = move.end_s + 3.0, move.end_s + 10.0
    assert failing(nudged(plan, 1, 0.7e-3, start_s, end_s)) == set()  # 0.8 mm is tolerated
    spoiled = verify(nudged(plan, 1, 1.5e-3, start_s, end_s))
    assert {check.name for check in spoiled.failures} == {PLACE}
    (failure,) = spoiled.failures
    assert (failure.phase, failure.sysid, failure.unit) == ("mission", 2, "m")
    assert failure.worst == pytest.approx(-1.5e-3, abs=1e-5)
    assert failure.t_s == pytest.approx(0.5 * (start_s + end_s), abs=0.2)  # its top is flat


@pytest.mark.slow
def test_a_vehicle_out_of_place_before_a_change_fails(planned: Planned) -> None:
    plan, _ = planned("gates")
    assert failing(nudged(plan, 2, 0.01, 1.0, 9.0)) == {PLACE}


@pytest.mark.parametrize(
    "angle_deg", [90.1, 450.0, *(pytest.param(angle, marks=pytest.mark.slow) for angle in (89.9, -90.0, 0.0))]
)
def test_another_angle_fails(planned: Planned, angle_deg: float) -> None:
    plan, _ = planned("turn")
    (move,) = plan.moves
    start = offsets_ned_m(plan.scenario)
    turned = in_three(plan, rotation(start, DOWN, np.radians(angle_deg)), move.start_s, move.end_s)
    fails = failing(turned)
    if angle_deg == 450.0:  # one turn more ends in the right place, too fast
        assert PLACE not in fails
        assert "speed in the shape" in fails
    else:
        assert fails - {"acceleration in the shape"} == {PLACE, "landing point"}


def test_about_another_axis_fails(planned: Planned) -> None:
    plan, _ = planned("turn")
    about = changed(plan.scenario, formation={"change": [at({**TURN, "axis": [0.0, 0.05, -1.0]}, 2.0)]})
    assert PLACE in failing(replace(plan, scenario=about))
    down = changed(plan.scenario, formation={"change": [at({**TURN, "axis": [0.0, 0.0, -2.0]}, 2.0)]})
    assert failing(replace(plan, scenario=down)) == set()  # straight down, right-handed, is what is left out


@pytest.mark.parametrize(
    "scale", [pytest.param(2.99, marks=pytest.mark.slow), 3.01, pytest.param(1.0, marks=pytest.mark.slow)]
)
def test_another_scale_fails(planned: Planned, scale: float) -> None:
    plan, _ = planned("tight shrink")
    (move,) = plan.moves
    start = offsets_ned_m(plan.scenario)
    fails = failing(in_three(plan, shrinking(start, scale), move.start_s, move.end_s))
    assert {PLACE, "landing point"} <= fails
    assert fails <= {PLACE, "landing point", "acceleration", "speed in the shape", "acceleration in the shape"}


def test_two_who_change_places_fail_where_everyone_has_his_own(planned: Planned) -> None:
    """Both stay where they are, which is the other's place."""
    plan, _ = planned("lanes")
    start = offsets_ned_m(plan.scenario)
    stayed = in_shape(plan, joined([rigid(start, 0.0, 2.0), rigid(start, 2.0, plan.flight_s)]))
    assert failing(stayed) == {PLACE, "landing point"}
    free = changed(plan.scenario, formation={"change": [at({"kind": "reshape", "to": "b"}, 2.0)]})
    assert failing(replace(stayed, scenario=free)) == set()
    assert failing(replace(plan, scenario=free)) == {ASSIGNMENT}  # to stay is the shortest way


@pytest.mark.slow
def test_two_on_one_place_fail_wherever_they_may_go(planned: Planned) -> None:
    plan, _ = planned("reshape")
    (move,) = plan.moves
    end = plan.shape.at(move.end_s)
    end[3] = end[4] + [0.0, 0.0, -1.5]
    fails = failing(in_three(plan, straight(offsets_ned_m(plan.scenario), end), move.start_s, move.end_s))
    assert {PLACE, "landing point"} <= fails


def test_two_who_meet_on_the_way_fail(planned: Planned) -> None:
    """Straight through the leader, as slowly as you like."""
    plan, _ = planned("lanes")
    (move,) = plan.moves
    start = offsets_ned_m(plan.scenario)
    spoiled = verify(in_three(plan, straight(start, start * [1.0, -1.0, 1.0]), move.start_s, move.end_s))
    assert {check.name for check in spoiled.failures} == {"separation"}
    (failure,) = spoiled.failures
    assert failure.worst == pytest.approx(-1.0, abs=0.05)
    assert failure.t_s == pytest.approx(0.5 * (move.start_s + move.end_s), abs=0.1)
    assert spoiled.separation_min_m == pytest.approx(0.0, abs=0.05)


@pytest.mark.parametrize(("share", "fails"), [(0.97, {"acceleration in the shape"}), (0.5, {"speed in the shape"})])
def test_a_change_in_too_little_time_fails(planned: Planned, share: float, fails: set[str]) -> None:
    plan, _ = planned("turn")
    (move,) = plan.moves
    leg = rotation(offsets_ned_m(plan.scenario), DOWN, np.pi / 2.0)
    length = share * (move.end_s - move.start_s)
    found = failing(in_three(plan, leg, move.start_s, move.start_s + length))
    assert fails <= found
    if share > 0.9:
        assert found == fails


def test_a_change_that_begins_late_fails_whatever_the_plan_tells_of_it(planned: Planned) -> None:
    plan, _ = planned("turn")
    (move,) = plan.moves
    leg = rotation(offsets_ned_m(plan.scenario), DOWN, np.pi / 2.0)
    late = in_three(plan, leg, move.start_s + 0.5, move.end_s + 0.5)
    assert failing(late) == {BEGINS}
    told = replace(move, start_s=move.start_s + 0.5, end_s=move.end_s + 0.5)
    (failure,) = verify(replace(late, moves=(told,))).failures
    assert (failure.name, failure.unit) == (BEGINS, "s")
    assert failure.worst == pytest.approx(-0.5)


def test_followers_that_do_not_fly_by_eq_1_fail_and_the_leader_does_not(
    planned: Planned, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Tilted for a thrust that is a twentieth too large, while the shape moves."""
    plan, _ = planned("turn")
    exact = followers.rounded_thrust
    monkeypatch.setattr(followers, "rounded_thrust", lambda *given: tuple(1.05 * part for part in exact(*given)))
    failures = {check.name: check for check in verify(replace(plan)).failures}  # a verdict is kept for each object
    check = failures["Eq. 1 re-integrated over 5 s"]
    assert check.sysid != plan.scenario.formation.leader
    assert check.t_s is not None
    (move,) = plan.moves
    assert move.start_s - 5.0 <= check.t_s <= move.end_s


@pytest.mark.parametrize("gate", [[[GATE[0][0] + 1.0, -20.0], [GATE[0][0] + 1.0, 40.0]], [[200.0, 0.0], [201.0, 0.0]]])
def test_a_change_away_from_its_gate_fails(planned: Planned, gate: list[list[float]]) -> None:
    plan, _ = planned("gates")
    turn, shrink = plan.scenario.model_dump()["formation"]["change"]
    moved = changed(plan.scenario, formation={"change": [{**turn, "gate_m": gate}, shrink]})
    assert failing(replace(plan, scenario=moved)) == {BEGINS}


def test_a_plan_that_does_not_tell_of_its_changes_fails(planned: Planned) -> None:
    plan, _ = planned("turn")
    fails = failing(replace(plan, moves=()))
    assert {BEGINS, PLACE} <= fails
    assert BEGINS in failing(replace(plan, moves=plan.moves * 2))


def test_a_change_that_nobody_asked_for_fails(planned: Planned) -> None:
    plan, _ = planned("turn")
    plain = changed(plan.scenario, formation={"change": []})
    assert {BEGINS, PLACE, "landing point"} <= failing(replace(plan, scenario=plain))


def with_changes(plan: Plan, *changes: dict[str, Any]) -> Plan:
    return replace(plan, scenario=changed(plan.scenario, formation={"change": list(changes)}))


AUTOMATIC: list[tuple[str, list[dict[str, Any]], bool]] = [
    ("auto shrink", [auto(SHRINK)], True),
    ("auto shrink", [auto(SHRINK), auto(TURN)], True),
    ("auto shrink", [auto({**SHRINK, "scale": 0.95})], False),
    ("auto shrink", [auto(TURN)], False),
    ("auto shrink", [auto(TO_FILE)], False),
    ("auto shrink", [], False),
    ("auto turn", [auto(TURN)], True),
    ("auto turn", [auto({**TURN, "angle_deg": 10.0})], False),
    ("auto turn", [auto(SHRINK)], False),
    ("auto turn", [], False),
    ("auto reshape", [auto(TO_FILE)], True),
    ("auto reshape", [auto(TO_FILE), auto(SHRINK)], True),
    ("auto reshape", [auto({**TO_FILE, "to": "wedge"})], False),
    ("auto reshape", [auto(SHRINK), auto(TURN)], False),
    ("auto reshape", [], False),
]


@pytest.mark.parametrize(
    ("name", "changes", "ok"),
    [
        row if number in (1, 2, 3) else pytest.param(*row, marks=pytest.mark.slow)
        for number, row in enumerate(AUTOMATIC)
    ],
)
def test_an_automatic_change_goes_no_further_and_no_other_way_than_it_may(
    planned: Planned, name: str, changes: list[dict[str, Any]], ok: bool
) -> None:
    plan, _ = planned(name)
    assert failing(with_changes(plan, *changes)) == (set() if ok else {PLACE})


def test_an_automatic_shrink_that_leaves_one_behind_fails(planned: Planned) -> None:
    plan, _ = planned("auto shrink")
    joints = plan.shape.joints_s
    inner = np.flatnonzero((joints[:-1] > 15.0) & (joints[1:] < 30.0) & (np.diff(joints) > 0.5))[0]
    spoiled = nudged(plan, 2, 2e-3, float(joints[inner]), float(joints[inner + 1]))
    assert PLACE in failing(spoiled)


def test_a_shape_that_stays_small_fails_on_the_ground(planned: Planned) -> None:
    """Allowed while it flies, but an automatic change is undone by the end."""
    plan, _ = planned("auto shrink")
    small = in_shape(plan, rigid(0.8 * offsets_ned_m(plan.scenario), 0.0, plan.flight_s))
    assert failing(small) == {"landing point", "take-off point"}


@pytest.mark.slow
@pytest.mark.parametrize("name", [pytest.param("course", marks=pytest.mark.slow), "course and schedule"])
def test_a_heading_away_from_the_course_fails(planned: Planned, name: str) -> None:
    plan, _ = planned(name)
    strict = changed(plan.scenario, formation={"course_tolerance_deg": 4.0})
    (failure,) = verify(replace(plan, scenario=strict)).failures
    assert (failure.name, failure.unit) == (COURSE, "deg")
    assert -1.06 < failure.worst < -0.04
    assert failure.t_s is not None
    stiff = in_shape(plan, rigid(offsets_ned_m(plan.scenario), 0.0, plan.flight_s))
    assert COURSE in failing(stiff)


@pytest.mark.slow
def test_where_it_turns_with_its_course_other_shapes_still_fail(planned: Planned) -> None:
    plan, _ = planned("course")
    tables = plan.shape.basis_ned_m.copy()
    tables[:, 3] *= 1.01
    spoiled = replace(plan, shape=replace(plan.shape, basis_ned_m=tables))
    assert PLACE in failing(spoiled)


@pytest.mark.parametrize("name", ["turn", pytest.param("auto shrink", marks=pytest.mark.slow)])
def test_what_is_no_number_never_passes(planned: Planned, name: str) -> None:
    plan, _ = planned(name)
    functions = plan.shape.functions.c.copy()
    functions[-1, functions.shape[1] // 2, 0] = np.nan
    spoiled = replace(plan, shape=replace(plan.shape, functions=PPoly(functions, plan.shape.joints_s)))
    assert {"clearance above ground", "state continuous at joints"} <= failing(spoiled)


@pytest.mark.parametrize("count", [2, 39, 41, 300])
def test_the_nearest_two_are_those_of_all_pairs(count: int) -> None:
    places = np.random.default_rng(count).normal(size=(count, 3)) * 20.0
    assert nearest_pair_m(places) == pytest.approx(pdist(places).min(), rel=1e-12)


def test_the_separation_of_a_moving_shape_is_that_of_a_fine_grid(planned: Planned) -> None:
    plan, _ = planned("reshape")
    (move,) = plan.moves
    times = np.linspace(move.start_s, move.end_s, 20001)
    distances = [pdist(at_once).min() for at_once in np.moveaxis(plan.offsets(times), 1, 0)]
    (check,) = (c for c in verify(plan).checks if c.name == "separation" and c.phase == "mission")
    assert check.proved is not None
    least_m = min(distances) - plan.scenario.limits.separation_min_m
    assert check.proved <= least_m <= check.worst + 1e-9
    assert check.worst - check.proved <= max(0.03 * check.worst, 1e-3)


def test_changes_are_worked_out_anew(planned: Planned) -> None:
    """What the timeline lays and what the verifier expects agree, though neither knows the other."""
    plan, _ = planned("gates")
    starts = tuple(move.start_s for move in plan.moves)
    again = lay(plan.scenario, starts, 0.0, plan.flight_s)
    assert failing(in_shape(plan, again.shape)) == set()


@pytest.mark.parametrize(
    ("west_m", "east_m", "crosses"),
    [
        (0.009, 10.009, True),
        (0.011, 10.011, False),
        (-10.009, -0.009, True),
        (-10.011, -0.011, False),
        (-5.0, 5.0, True),
    ],
)
def test_a_gate_ends_a_thousandth_of_its_width_beyond_its_posts(
    meadow_plan: Plan, west_m: float, east_m: float, crosses: bool
) -> None:
    """North at 2 m/s from T0 on: the line of the gate, 12 m ahead, is crossed after 6 s."""
    state = np.zeros((2, 1, 12))
    state[0, 0, 0] = 2.0
    joints = np.array([0.0, 20.0])
    plan = replace(meadow_plan, leader_trajectory=Trajectory(PPoly(state, joints), PPoly(np.zeros((1, 1, 4)), joints)))
    for posts in (((12.0, west_m), (12.0, east_m)), ((12.0, east_m), (12.0, west_m))):
        found = crossing_s(plan, posts)
        assert found == (pytest.approx(6.0) if crosses else None)
    assert crossing_s(plan, ((-2.0, -5.0), (-2.0, 5.0))) is None, "behind it"
