"""What is checked at instants: margins, vehicles and times of plans that are spoiled by known amounts."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import PPoly

from gcs.errors import OutOfTime
from gcs.plan.formation.shape import Shape
from gcs.plan.trajectory.energy import energy_Wh
from gcs.plan.trajectory.phases import Phase
from gcs.plan.trajectory.plan import Plan
from gcs.plan.trajectory.trajectory import Trajectory
from gcs.plan.verification import exact_checks as exact_checks_module
from gcs.plan.verification.exact_checks import exact_checks
from gcs.plan.verification.proof.verdict import Check
from gcs.types import Array
from gcs.util.long_work import within
from tests.unit.plan.problems import changed


def found(plan: Plan) -> dict[str, Check]:
    checks, _ = exact_checks(plan)
    assert len({check.name for check in checks}) == len(checks)
    assert all(check.proved == check.worst for check in checks)
    return {check.name: check for check in checks}


def shifted(plan: Plan, piece: int, state: dict[int, float], control: dict[int, float]) -> Plan:
    """One polynomial of the leader moved by constants, by their columns."""
    old = plan.leader_trajectory
    x, u = old.state.c.copy(), old.control.c.copy()
    for part, moved in ((x, state), (u, control)):
        for column, by in moved.items():
            part[-1, piece, column] += by
    return replace(plan, leader_trajectory=Trajectory(PPoly(x, old.joints_s), PPoly(u, old.joints_s)))


def inner(plan: Plan) -> int:
    """A polynomial in the middle of the mission."""
    return int(np.searchsorted(plan.leader_trajectory.joints_s, 10.0)) - 1


def joint_s(plan: Plan, number: int) -> Any:
    return pytest.approx(float(plan.leader_trajectory.joints_s[number]))


def test_a_good_plan_has_no_margin_below_its_tolerance(meadow_plan: Plan) -> None:
    checks = found(meadow_plan)
    assert all(check.ok for check in checks.values())
    assert set(checks) == {
        *("state continuous at joints", "control continuous at joints", "separation over the pads", "arrival time"),
        *(f"{end} {what}" for end in ("start", "end") for what in ("position", "velocity", "attitude")),
        *("take-off point", "landing point", "battery at the last touch-down, above its reserve"),
    }
    assert exact_checks(meadow_plan)[1] == -checks["end position"].worst


@pytest.mark.parametrize(("spare", "ok"), [(0.01, True), (-0.01, False)])
def test_a_battery_that_does_not_end_with_its_reserve_fails(meadow_plan: Plan, spare: float, ok: bool) -> None:
    assert meadow_plan.scenario.vehicle.power is not None
    used_Wh = energy_Wh(meadow_plan)
    assert used_Wh is not None
    power = meadow_plan.scenario.vehicle.power.model_dump() | {"battery_Wh": float(used_Wh.max()) / (0.6 - spare)}
    small = changed(meadow_plan.scenario, vehicle={"power": power}, preflight={"reserve": 0.4})
    check = found(replace(meadow_plan, scenario=small))["battery at the last touch-down, above its reserve"]
    assert check.ok is ok
    assert check.worst == pytest.approx(spare, abs=1e-9)
    assert (check.phase, check.t_s) == ("landing", meadow_plan.t_end_s)
    in_the_air = replace(meadow_plan, scenario=small, begin_state=(0.0,) * 12)  # what it used before is not known
    assert not any("battery" in check.name for check in exact_checks(in_the_air)[0])


def test_the_largest_jump_of_a_state_is_told_at_its_joint(meadow_plan: Plan) -> None:
    number = inner(meadow_plan)
    jumped = found(shifted(meadow_plan, number, {7: -0.02}, {}))["state continuous at joints"]
    assert (jumped.worst, jumped.tolerance) == (pytest.approx(-0.02, rel=1e-3), 0.8e-3)
    assert jumped.t_s in (joint_s(meadow_plan, number), joint_s(meadow_plan, number + 1))
    assert jumped.sysid is None


@pytest.mark.parametrize(("column", "by"), [(0, 0.1), (1, -0.01), (3, 0.002)])
def test_a_step_of_a_control_is_told_as_a_share_of_its_limit(meadow_plan: Plan, column: int, by: float) -> None:
    number, limits = inner(meadow_plan), meadow_plan.scenario.limits
    assert limits.yaw_moment_Nm is not None
    size = (max(limits.thrust_N), *limits.roll_pitch_force_N, limits.yaw_moment_Nm)[column]
    stepped = found(shifted(meadow_plan, number, {}, {column: by}))["control continuous at joints"]
    assert stepped.worst == pytest.approx(-abs(by) / size, rel=0.02)
    assert stepped.t_s in (joint_s(meadow_plan, number), joint_s(meadow_plan, number + 1))
    assert stepped.tolerance == 0.01


def test_where_phases_join_a_control_may_step(meadow_plan: Plan) -> None:
    """The whole mission with another moment: it steps at both its ends only."""
    old = meadow_plan.leader_trajectory
    u = old.control.c.copy()
    u[-1, (old.joints_s[:-1] >= 0.0) & (old.joints_s[:-1] < 20.0), 1] += 0.02
    moved = replace(meadow_plan, leader_trajectory=Trajectory(old.state, PPoly(u, old.joints_s)))
    assert found(moved)["control continuous at joints"].ok


def test_where_a_change_of_shape_begins_moments_may_step_and_thrust_may_not(meadow_plan: Plan) -> None:
    number = inner(meadow_plan)
    low_s, high_s = meadow_plan.leader_trajectory.joints_s[number : number + 2].tolist()
    joints = np.array([meadow_plan.t_start_s, low_s, high_s, meadow_plan.t_end_s])
    shape = Shape(PPoly(np.ones((1, 3, 1)), joints), meadow_plan.shape.at(0.0)[None])
    changing = replace(meadow_plan, shape=shape)
    assert found(shifted(changing, number, {}, {1: 0.02}))["control continuous at joints"].ok
    assert not found(shifted(changing, number, {}, {0: 0.2}))["control continuous at joints"].ok


def test_a_step_of_the_acceleration_counts_where_the_jerk_is_limited(meadow_plan: Plan) -> None:
    """A step of the thrust over the mass; the largest jerk may act for 10 ms."""
    number, by_N = inner(meadow_plan), 1.0
    limited = replace(meadow_plan, scenario=changed(meadow_plan.scenario, limits={"jerk_max_mps3": 3.0}))
    check = found(shifted(limited, number, {}, {0: by_N}))["acceleration continuous at joints"]
    assert check.worst == pytest.approx(-by_N / limited.scenario.vehicle.mass_kg, rel=0.02)
    assert (check.unit, check.tolerance) == ("m/s2", pytest.approx(0.03))
    assert check.t_s in (joint_s(meadow_plan, number), joint_s(meadow_plan, number + 1))
    assert check.sysid in meadow_plan.sysids


@pytest.mark.parametrize("end", ["start", "end"])
@pytest.mark.parametrize(
    ("columns", "by", "name", "worst", "unit", "tolerance"),
    [
        ((0, 1, 2), (0.02, -0.03, 0.06), "position", -0.07, "m", 0.8e-3),
        ((3, 4, 5), (0.02, -0.03, 0.01), "velocity", -0.03, "m/s", 1e-3),
        ((6, 7, 8), (0.02, -0.03, 0.01), "attitude", -np.degrees(0.03), "deg", 0.01),
    ],
)
def test_ends_are_compared_with_the_scenarios(
    meadow_plan: Plan,
    end: str,
    columns: tuple[int, ...],
    by: tuple[float, ...],
    name: str,
    worst: float,
    unit: str,
    tolerance: float,
) -> None:
    joints = meadow_plan.leader_trajectory.joints_s
    piece = int(np.searchsorted(joints, 0.0 if end == "start" else 20.0)) - (end == "end")
    moved = shifted(meadow_plan, piece, dict(zip(columns, by, strict=True)), {})
    checks, terminal_m = exact_checks(moved)
    (check,) = (one for one in checks if one.name == f"{end} {name}")
    assert check.worst == pytest.approx(worst, rel=1e-4)
    assert (check.unit, check.tolerance, check.sysid) == (unit, tolerance, moved.sysids[moved.leader])
    assert check.t_s == pytest.approx(0.0 if end == "start" else 20.0)
    others = {one.name for one in checks if not one.ok and one.name.startswith(("start", "end"))}
    assert others == {check.name}
    assert terminal_m == pytest.approx(0.07 if (end, name) == ("end", "position") else 0.0, abs=1e-3)


def test_the_arrival_is_early_or_late_by_as_much(meadow_plan: Plan) -> None:
    for by_s in (-0.5, 0.25):
        phases = [replace(p, end_s=p.end_s + by_s) if p.name == "mission" else p for p in meadow_plan.phases]
        check = found(replace(meadow_plan, phases=tuple(phases)))["arrival time"]
        assert (check.worst, check.tolerance, check.t_s) == (pytest.approx(-abs(by_s)), 0.0, 20.0 + by_s)


def test_pads_and_landing_points_are_those_of_the_vehicle_that_is_farthest_from_its_own(meadow_plan: Plan) -> None:
    tables = meadow_plan.shape.basis_ned_m.copy()
    tables[:, 1] += [0.03, 0.04, 0.0]
    tables[:, 2] += [0.0, 0.0, 0.01]
    checks = found(replace(meadow_plan, shape=replace(meadow_plan.shape, basis_ned_m=tables)))
    for name, t_s in (("take-off point", meadow_plan.t_start_s), ("landing point", meadow_plan.t_end_s)):
        check = checks[name]
        assert (check.worst, check.sysid, check.t_s) == (pytest.approx(-0.05, rel=1e-6), meadow_plan.sysids[1], t_s)


def test_columns_over_the_pads_are_apart_by_what_the_judge_asks(meadow_plan: Plan) -> None:
    pads: Array = meadow_plan.pads_ned_m[:, :2]
    least_m = min(float(np.linalg.norm(pads[a] - pads[b])) for a in range(3) for b in range(a))
    check = found(meadow_plan)["separation over the pads"]
    assert check.worst == pytest.approx(least_m - meadow_plan.scenario.judge.separation_min_m)
    assert (check.phase, check.t_s, check.sysid) == ("takeoff", meadow_plan.t_start_s, None)


def test_a_plan_that_begins_in_the_air_is_compared_with_its_own_begin(meadow_plan: Plan) -> None:
    """It takes off from no pad and climbs over none."""
    begin = meadow_plan.leader_trajectory.state(5.0)
    phases = (Phase("mission", 5.0, 20.0), *meadow_plan.phases[-2:])
    begun = replace(meadow_plan, phases=phases, begin_state=tuple(begin.tolist()))
    checks = found(begun)
    assert not {"take-off point", "separation over the pads"} & set(checks)
    assert checks["start position"].ok and checks["start velocity"].ok and checks["start attitude"].ok
    assert "landing point" in checks
    elsewhere = replace(begun, begin_state=(float(begin[0]) + 0.5, *begin.tolist()[1:]))
    assert found(elsewhere)["start position"].worst == pytest.approx(-0.5)


@pytest.mark.parametrize(("late_s", "passes"), [(0.059, True), (0.061, False)])
def test_a_change_may_begin_60_ms_late(
    meadow_plan: Plan, monkeypatch: pytest.MonkeyPatch, late_s: float, passes: bool
) -> None:
    monkeypatch.setattr(exact_checks_module, "late_s", lambda plan: [(0.01, 3.0), (late_s, 8.0), (0.02, 12.0)])
    check = found(meadow_plan)["changes begin when they should"]
    assert (check.ok, check.worst, check.t_s, check.unit) == (passes, -late_s, 8.0, "s")


def test_comparing_ways_ends_at_a_time_limit(meadow_plan: Plan) -> None:
    """Of a large fleet that takes seconds."""
    with within(-1.0), pytest.raises(OutOfTime, match="while comparing the ways of all vehicles"):
        exact_checks(meadow_plan)
