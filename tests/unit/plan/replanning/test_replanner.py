"""Plans that change in flight: from any state, round new disks, on programs that are built once."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
from scipy.interpolate import PPoly

import gcs
from gcs.errors import Infeasible, UsageError
from gcs.physics.states import POSITION
from gcs.plan.nlp.ipopt import run
from gcs.plan.nlp.mesh import counted
from gcs.plan.nlp.transcription import Program
from gcs.plan.nlp.violations import Violation
from gcs.plan.ocp.problem import flight_problem
from gcs.plan.plan_file import load_plan, save_plan
from gcs.plan.planner import make_plan
from gcs.plan.replanning.formation_rest import plan_of, rest_of
from gcs.plan.replanning.parametric_nlp import parametric_nlp, tightened
from gcs.plan.replanning.plan_pieces import continued
from gcs.plan.replanning.remaining_plan import shape_part, trajectory_part
from gcs.plan.replanning.replanner import Replanner
from gcs.plan.replanning.warm_start import multipliers
from gcs.plan.trajectory.constraint_id import ConstraintId, Kind
from gcs.plan.trajectory.energy import charge_needed, used_until
from gcs.plan.trajectory.plan import Plan
from gcs.plan.trajectory.trajectory import Trajectory
from gcs.plan.verification.verify import verify
from gcs.scenario.environment.no_fly import ZoneName, outside_m
from gcs.scenario.schema.scenario import NoFlyZone, Scenario
from gcs.types import Array
from tests.unit.plan.problems import changed, meadow

AT_S = 12.0


def crossing(scenario: Scenario, **tables: Any) -> Scenario:
    """120 m in 60 s: time enough to come back from anywhere."""
    away = {"time": {"flight_s": 60.0}, "end": {"position_m": [110.0, 44.0, 5.0]}}
    start = {"start": {"position_m": [12.0, 31.0, 3.0]}}
    return meadow(scenario, **{**away, **start, **tables})


@pytest.fixture(scope="module")
def plan(simulation1: Scenario) -> Plan:
    return make_plan(crossing(simulation1))


@pytest.fixture(scope="module")
def replanner(plan: Plan) -> Replanner:
    return Replanner(plan)


def planned(plan: Plan, t_s: float = AT_S, off_m: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Array:
    state = np.array(plan.leader_trajectory.state(t_s))
    state[POSITION] += off_m
    return state


def ahead(plan: Plan, radius_m: float = 6.0, t_s: float = 32.0) -> NoFlyZone:
    north_m, east_m, _ = plan.leader_trajectory.state(t_s)[:3].tolist()
    return NoFlyZone(north_m=north_m, east_m=east_m, radius_m=radius_m)


def test_who_is_where_the_plan_has_him_goes_on_as_planned(plan: Plan, replanner: Replanner) -> None:
    """What is left of an optimal flight is optimal, in the units of the whole."""
    new = replanner.replan(planned(plan), AT_S)
    assert verify(new).ok, verify(new).failures
    t_s = np.linspace(AT_S, plan.t_end_s - 1e-6, 300)
    np.testing.assert_allclose(new.states(t_s)[..., POSITION], plan.states(t_s)[..., POSITION], atol=0.2)
    assert new.objective < plan.objective
    assert sum(r.iterations for r in new.mesh_history) < 15


def test_nothing_is_built_after_the_replanner(plan: Plan, monkeypatch: pytest.MonkeyPatch) -> None:
    built: list[str] = []
    nlpsol = ca.nlpsol

    def counting(name: str, *arguments: Any) -> Any:
        built.append(name)
        return nlpsol(name, *arguments)

    monkeypatch.setattr(ca, "nlpsol", counting)
    replanner = Replanner(plan)
    before = len(built)
    assert 0 < before <= 10
    replanner.replan(planned(plan), AT_S)
    replanner.replan(planned(plan, off_m=(2.0, -9.0, -1.0)), AT_S, [ahead(plan)])
    replanner.replan(planned(plan, 40.0, (0.0, 2.0, 0.0)), 40.0)
    assert len(built) == before


@pytest.mark.parametrize("off_m", [(8.0, -15.0, -1.0), (-8.0, 12.0, 0.5)])
def test_a_state_off_the_plan_is_where_the_new_one_begins(
    plan: Plan, replanner: Replanner, off_m: tuple[float, float, float]
) -> None:
    state = planned(plan, off_m=off_m)
    state[3:5] += [0.4, -0.3]
    new = replanner.replan(state, AT_S)
    assert verify(new).ok, verify(new).failures
    assert new.t_start_s == AT_S
    np.testing.assert_allclose(new.leader_trajectory.state(AT_S), state, atol=1e-6)
    assert new.t_end_s == plan.t_end_s
    assert new.phases[-1] == plan.phases[-1]
    assert new.scenario == plan.scenario


def test_a_fleet_is_where_its_leader_is(plan: Plan, replanner: Replanner) -> None:
    states = plan.states(np.array([AT_S]))[:, 0].copy()
    states[1, :3] += 1.0  # a follower that is off comes back to its place by itself
    new = replanner.replan(states, AT_S)
    np.testing.assert_allclose(new.leader_trajectory.state(AT_S), states[plan.leader], atol=1e-6)


def test_a_new_disk_is_flown_round_by_everybody(plan: Plan, replanner: Replanner) -> None:
    zone = ahead(plan)
    t_s = np.arange(AT_S, plan.flight_s, 0.05)
    before = plan.states(t_s)
    assert outside_m(zone, t_s, before[..., 0], before[..., 1]).min() < -5.0
    new = replanner.replan(planned(plan), AT_S, [zone])
    assert verify(new).ok, verify(new).failures
    assert new.scenario.no_fly[-1] == zone
    places = new.states(t_s)
    assert outside_m(zone, t_s, places[..., 0], places[..., 1]).min() >= -1e-3


def test_two_disks_and_one_that_moves(plan: Plan, replanner: Replanner) -> None:
    moving = ahead(plan, 3.0, 45.0).model_copy(update={"moves": ((0.0, 0.0, -20.0), (60.0, 0.0, 8.0))})
    new = replanner.replan(planned(plan), AT_S, [ahead(plan, 4.0, 28.0), moving])
    assert verify(new).ok, verify(new).failures


def test_the_verifier_knows_where_the_plan_begins(plan: Plan, replanner: Replanner) -> None:
    new = replanner.replan(planned(plan), AT_S)
    assert new.begin_state is not None
    moved = (new.begin_state[0] + 0.01, *new.begin_state[1:])
    assert [c.name for c in verify(replace(new, begin_state=moved)).failures] == ["start position"]


def test_a_new_plan_is_stored_and_exported_as_any(plan: Plan, replanner: Replanner, tmp_path: Path) -> None:
    new = replanner.replan(planned(plan), AT_S, [ahead(plan)])
    save_plan(new, verify(new), tmp_path / "new.skein")
    read, report = load_plan(tmp_path / "new.skein")
    assert report.ok
    assert (read.hash, read.begin_state) == (new.hash, new.begin_state)
    assert verify(read).ok
    index = gcs.export(read, tmp_path / "out", formats=["setpoints"])
    assert sorted(index.sha256) == [f"uav{sysid}.setpoints" for sysid in plan.sysids]
    assert gcs.build_stream(read, 5.0).t_s[0] == AT_S
    with pytest.raises(gcs.GcsError, match="begins in the air"):
        gcs.export(read, tmp_path / "missions", formats=["plan"])


def test_what_was_flown_before_counts_for_the_battery(plan: Plan, replanner: Replanner) -> None:
    new = replanner.replan(planned(plan), AT_S)
    (check,) = [each for each in verify(new).checks if each.constraint.kind is Kind.BATTERY]
    assert 1.0 - plan.scenario.preflight.reserve - check.worst == pytest.approx(charge_needed(plan).max(), rel=0.01)
    assert new.used_before == rest_of(plan, AT_S).used_before
    assert plan_of(plan, plan.sysids[1:2], AT_S).used_before == new.used_before[1:2]
    flown = continued(plan, new)  # from the ground on
    assert not flown.used_before
    assert used_until(flown, AT_S) == pytest.approx(new.used_before)


def test_a_new_plan_is_changed_again(plan: Plan, replanner: Replanner) -> None:
    once = replanner.replan(planned(plan, off_m=(0.0, 6.0, 0.0)), AT_S, [ahead(plan)])
    twice = Replanner(once).replan(planned(once, 25.0), 25.0)
    assert verify(twice).ok, verify(twice).failures
    assert twice.scenario.no_fly == once.scenario.no_fly


@pytest.mark.parametrize(
    ("number", "by", "words"),
    [(4, 5.5, "east speed"), (2, -40.0, "height"), (2, 4.0, "height"), (7, 1.2, "pitch")],
)
def test_a_state_that_breaks_a_limit_is_told(
    plan: Plan, replanner: Replanner, number: int, by: float, words: str
) -> None:
    state = planned(plan)
    state[number] += by
    with pytest.raises(Infeasible, match=f"the state at t = 12 s violates {words}.* by "):
        replanner.replan(state, AT_S)


def test_who_is_inside_of_a_new_disk_is_told(plan: Plan, replanner: Replanner) -> None:
    with pytest.raises(Infeasible, match=r"violates no-fly zone 1 for vehicle \d by"):
        replanner.replan(planned(plan), AT_S, [ahead(plan, t_s=AT_S)])


def test_too_little_time_is_told(plan: Plan, replanner: Replanner) -> None:
    with pytest.raises(Infeasible, match="east alone needs"):
        replanner.replan(planned(plan, 54.0, (0.0, 60.0, 0.0)), 54.0)


def test_no_way_in_the_time_that_is_left_is_told(plan: Plan, replanner: Replanner) -> None:
    with pytest.raises(gcs.GcsError, match=r"no plan from t = 54 s in the remaining 6 s: .* the largest violation"):
        replanner.replan(planned(plan, 54.0, (0.0, -22.0, 0.0)), 54.0)


def test_what_nobody_can_plan_from_is_refused(plan: Plan, replanner: Replanner) -> None:
    for t_s in (-1.0, 57.0, 61.0):
        with pytest.raises(UsageError, match="not within the mission"):
            replanner.replan(planned(plan, 20.0), t_s)
    with pytest.raises(UsageError, match="12 numbers"):
        replanner.replan(np.zeros(6), AT_S)
    with pytest.raises(UsageError, match="not finite"):
        replanner.replan(np.full(12, np.nan), AT_S)
    with pytest.raises(UsageError, match="room for 2"):
        replanner.replan(planned(plan), AT_S, [ahead(plan)] * 3)
    square = NoFlyZone(polygon_m=((40.0, 30.0), (50.0, 30.0), (50.0, 40.0)))
    with pytest.raises(UsageError, match="only for disks"):
        replanner.replan(planned(plan), AT_S, [square])


@pytest.mark.slow
def test_changes_of_shape_keep_their_times(simulation1: Scenario) -> None:
    changes = [
        {"kind": "rotate", "angle_deg": 40.0, "at_s": 8.0},
        {"kind": "shrink", "scale": 0.9, "gate_m": [[80.0, 0.0], [80.0, 90.0]]},
    ]
    plan = make_plan(crossing(simulation1, formation={"change": changes}))
    new = Replanner(plan).replan(planned(plan, 20.0, (0.0, 7.0, 0.0)), 20.0)
    assert verify(new).ok, verify(new).failures
    t_s = np.arange(20.0, 60.0, 0.1)
    np.testing.assert_allclose(new.offsets(t_s), plan.offsets(t_s), atol=1e-9)
    assert new.scenario.formation.change[1].at_s == plan.moves[1].start_s


def test_parts_of_polynomials_are_what_they_were() -> None:
    rng = np.random.default_rng(3)
    joints = np.array([0.0, 1.0, 2.5, 4.0])
    whole = Trajectory(PPoly(rng.normal(size=(6, 3, 12)), joints), PPoly(rng.normal(size=(2, 3, 4)), joints))
    for start_s, end_s in ((0.0, 4.0), (0.4, 3.1), (1.0, 2.5), (1.2, 1.9)):
        part = trajectory_part(whole, start_s, end_s)
        t_s = np.linspace(start_s, np.nextafter(end_s, 0.0), 17)
        np.testing.assert_allclose(part.state(t_s), whole.state(t_s), atol=1e-9)
        np.testing.assert_allclose(part.control(t_s), whole.control(t_s), atol=1e-9)
        assert (part.start_s, part.end_s) == (start_s, end_s)


def test_rewording_every_constraint_changes_no_re_plan(
    plan: Plan, replanner: Replanner, monkeypatch: pytest.MonkeyPatch
) -> None:
    new = replanner.replan(planned(plan), AT_S, [ahead(plan)])
    words = itertools.count()
    monkeypatch.setattr(ConstraintId, "__str__", lambda _: f"no-fly zone {next(words)}")
    assert replanner.replan(planned(plan), AT_S, [ahead(plan)]).hash == new.hash


IDS = range(1, 7)
CORNER = [[50.0, 60.0], [60.0, 60.0], [60.0, 65.0], [55.0, 65.0], [55.0, 75.0], [50.0, 75.0]]  # of two pieces
FEET = {f"clearance of vehicle {v}{foot}" for v in IDS for foot in ("", ", other side")}


@pytest.fixture(scope="module")
def program(plan: Plan) -> Program:
    """On eight intervals, with zones and all limits of motion."""
    zones = [{"polygon_m": CORNER}, {"north_m": 20.0, "east_m": 70.0, "radius_m": 5.0}]
    strict = changed(plan.scenario, limits={"accel_max_mps2": 2.0, "jerk_max_mps3": 4.0}, no_fly=zones)
    whole = replace(flight_problem(strict), shape=shape_part(plan.shape, 0.0, plan.flight_s))
    mesh = counted(0.0, plan.flight_s, 8, 1.0, 5)
    return parametric_nlp(whole, mesh, 1).program(whole, mesh, plan.leader_trajectory)


@pytest.mark.parametrize(
    ("violation", "by", "rows"),
    [
        (ConstraintId(Kind.CLEARANCE), 0.125, FEET),
        (ConstraintId(Kind.ZONE, of=ZoneName(1)), 0.125, {f"no-fly zone 1, part {p}" for p in (1, 2)}),
        (ConstraintId(Kind.ZONE, of=ZoneName(2)), 0.125, {"no-fly zone 2"}),
        (ConstraintId(Kind.TURNING), 0.025, {"turning radius of vehicle 1"}),
        (ConstraintId(Kind.ACCELERATION), 0.025, {"acceleration of vehicle 1"}),
        (ConstraintId(Kind.JERK), 0.025, {"jerk of the formation"}),
        (ConstraintId(Kind.U1), 0.0, set()),
    ],
)
def test_a_violation_tightens_the_rows_of_its_constraint_beside_it(
    plan: Plan, program: Program, violation: ConstraintId, by: float, rows: set[str]
) -> None:
    missed = Violation(violation, "m", 30.1, 0.1, 0.01, 9.0)
    tighter = tightened(program, plan.leader_trajectory, (missed,))
    raised = np.flatnonzero(tighter.g_low != program.g_low)
    np.testing.assert_allclose(tighter.g_low[raised] - program.g_low[raised], by)
    assert {str(program.g_ids[row][0]).partition(" for vehicle")[0] for row in raised} == rows
    assert len({program.g_ids[row][1] for row in raised}) == 2 * bool(rows)
    np.testing.assert_array_equal(tighter.y_low, program.y_low)


@pytest.mark.parametrize(("kind", "by_si"), [(Kind.NORTH_SPEED, 0.1), (Kind.PITCH, np.radians(0.1))])
def test_a_violation_of_the_leaders_state_tightens_the_bound_on_its_side(
    plan: Plan, program: Program, kind: Kind, by_si: float
) -> None:
    missed = Violation(ConstraintId(kind), "", 30.1, 0.1, 0.01, 9.0)
    tighter = tightened(program, plan.leader_trajectory, (missed,))
    off = np.concatenate([tighter.y_low - program.y_low, program.y_high - tighter.y_high]) * np.tile(program.unit, 2)
    np.testing.assert_allclose(off[off != 0.0], 1.25 * by_si)
    assert {program.y_ids[n % len(program.y_ids)].kind for n in np.flatnonzero(off)} == {kind}
    assert np.count_nonzero(off) == 2


def test_multipliers_come_back_on_the_same_mesh(plan: Plan) -> None:
    whole = flight_problem(plan.scenario)
    mesh = counted(0.0, whole.end_s, 16, 1.0, 5)
    programs = parametric_nlp(replace(whole, shape=shape_part(plan.shape, 0.0, whole.end_s)), mesh, 1)
    program = programs.program(programs.whole, mesh, plan.leader_trajectory)
    found = run(programs.afresh, program, {"x0": program.scaled(plan.leader_trajectory)})
    _, rows = multipliers(program, found).on(program)
    np.testing.assert_allclose(rows, list(found.g_multipliers.values()), atol=1e-12)


@pytest.mark.parametrize("duration_s", [4.0, 30.0, 275.0, 900.0])
def test_a_mesh_has_as_many_intervals_as_it_is_asked_for(duration_s: float) -> None:
    lengths = np.diff(counted(7.0, 7.0 + duration_s, 18, 1.0, 5).joints_s)
    assert len(lengths) == 18
    assert lengths.sum() == pytest.approx(duration_s)
    np.testing.assert_allclose(lengths, lengths[::-1])
    assert (np.diff(lengths[:9]) >= -1e-9).all()


@pytest.mark.long
def test_a_gentle_flight_is_changed_gently(simulation1: Scenario) -> None:
    limits = {"accel_max_mps2": 0.9, "jerk_max_mps3": 0.7}
    gentle = make_plan(crossing(simulation1, limits=limits))
    changed = Replanner(gentle).replan(planned(gentle), AT_S, [ahead(gentle)])
    report = verify(changed)
    assert report.ok, report.failures
    assert min(c.worst for c in report.checks if c.name == "jerk") >= -1e-3 * limits["jerk_max_mps3"]


@pytest.mark.parametrize(
    "at_s", [pytest.param(48.0, marks=pytest.mark.slow), 72.0, pytest.param(167.0, marks=pytest.mark.slow)]
)
def test_beside_a_zone_that_the_plan_touches_it_goes_on_as_planned(plan_of: Callable[[str], Plan], at_s: float) -> None:
    plan = plan_of("field/scenario.toml")
    assert plan.zone_distances_m(np.array([at_s])).min() < 30.0
    new = Replanner(plan).replan(plan.leader_trajectory.state(at_s), at_s)
    assert verify(new).ok, verify(new)
    t_s = np.linspace(at_s, plan.flight_s, 200)
    np.testing.assert_allclose(new.states(t_s)[..., :3], plan.states(t_s)[..., :3], atol=0.5)
