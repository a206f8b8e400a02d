"""Flights that a verifier that samples called verified, though a vehicle was out of its limits: each is refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gcs.plan.formation.shape import joined, rigid
from gcs.plan.formation.timeline import Move
from gcs.plan.planner import make_plan
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.verify import Check, verify
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.sources.load import load_scenario
from gcs.types import Array
from tests.property.plan.adversary import humps
from tests.property.plan.adversary.missions import STAIRS, mission
from tests.property.plan.adversary.oracle import CLEARANCE, HEADING, PAD, Oracle, window
from tests.unit.plan.formations import SHAPES, TO_ROW, at, fleet
from tests.unit.plan.problems import changed

PLACE = "place in formation"
SHEARED = {"speed_mps": 7.0, "from_deg": 180.0, "shear": 0.4}


def failed(plan: Plan) -> dict[str, Check]:
    return {check.name: check for check in verify(plan).failures}


def tilt_deg(plan: Plan, t_s: Array) -> Array:
    """The angle (V, N) between thrust and straight up that flying in step takes, each vehicle in the wind it meets.

    m a = m g + thrust - K (v - w); a and v are the leader's, because the formation is rigid.
    """
    q, x = plan.quadrotor, plan.leader_trajectory.state
    velocity, acceleration = x(t_s)[:, 3:6], x(t_s, nu=1)[:, 3:6]
    height = -Oracle(plan).places_ned_m(t_s)[..., 2]
    share = (0.5 * (height + np.sqrt(height**2 + 1.0)) / q.wind.reference_m) ** q.wind.exponent
    wind = share[..., None] * np.array([q.wind.north_mps, q.wind.east_mps, 0.0])
    force = np.array([0.0, 0.0, q.mass_kg * q.gravity_mps2]) - q.mass_kg * acceleration
    force = force - np.array(q.drag_Nspm) * (velocity - wind)
    return np.asarray(np.degrees(np.arctan2(np.hypot(force[..., 0], force[..., 1]), force[..., 2])))


def leaning(scenario: Scenario) -> Plan:
    """A rigid formation at four heights that flies slowly before the wind: the higher a vehicle, the more it leans."""
    return make_plan(
        fleet(
            scenario,
            4,
            "stairs",
            (),
            ({**STAIRS[0], "offsets_m": [[0, 0, 0], [-3, -3, 4], [-3, 3, 8], [-6, 0, 1]]},),
            wind=SHEARED,
            limits={"height_m": [0.0, 40.0], "accel_max_mps2": 3.0},
            time={"flight_s": 40.0},
            ground_phases={"takeoff_s": 25.0, "hover_s": 2.0, "landing_s": 25.0},
        )
    )


@pytest.mark.slow
def test_in_sheared_wind_a_vehicle_above_the_leader_leans_too_far(simulation1: Scenario) -> None:
    """The limit is met by the leader, and by all in a wind that is the same everywhere."""
    plan = leaning(simulation1)
    assert verify(plan).ok
    times = np.arange(plan.phase("mission").start_s + 1e-3, plan.phase("mission").end_s - 1e-3, 0.01)
    most = tilt_deg(plan, times).max(axis=1)
    limit = float(np.mean([most[plan.leader], most.max()]))
    assert most[plan.leader] < 0.95 * limit < 1.05 * limit < most.max()
    strict = changed(plan.scenario, limits={"roll_pitch_yaw_deg": [limit, limit, 180.0]})
    failure = failed(replace(plan, scenario=strict))["pitch"]
    assert failure.sysid == plan.sysids[int(np.argmax(most))]
    assert failure.worst <= 0.95 * (limit - most.max())  # roll takes a little of the tilt


@pytest.mark.long
def test_the_field_in_sheared_wind_with_vehicles_that_lean_too_far(repo_root: Path) -> None:
    """8 m/s at 10 m with an exponent of 0.4: planned with 35 degrees, it is refused with 25."""
    field = load_scenario(repo_root / "missions" / "field")
    windy: dict[str, Any] = {
        "wind": {"speed_mps": 8.0, "from_deg": 0.0, "shear": 0.4},
        "ground_phases": {"takeoff_s": 60.0, "landing_s": 90.0},
        "limits": {"roll_pitch_yaw_deg": [35.0, 35.0, 180.0]},
    }
    plan = make_plan(changed(field, **windy))
    times = np.arange(plan.t_start_s + 1e-3, plan.t_end_s - 1e-3, 0.02)
    assert tilt_deg(plan, times).max() > 25.5
    strict = changed(plan.scenario, limits={"roll_pitch_yaw_deg": [25.0, 25.0, 180.0]})
    assert "pitch" in failed(replace(plan, scenario=strict))


def test_a_thin_wall_across_the_whole_box_that_all_fly_through() -> None:
    """0.1 m thick: where nobody is in it at any multiple of 0.05 s, and each vehicle for tens of milliseconds."""
    plan = mission("meadow")
    times = np.arange(0.0, plan.flight_s, 0.05)
    north = Oracle(plan).places_ned_m(times)[..., 0]
    walls = np.arange(10.0, 32.0, 0.01)
    free = [w for w in walls if not np.any((north > w - 0.005) & (north < w + 0.105))]
    assert free
    wall = [[free[0], -500.0], [free[0] + 0.1, -500.0], [free[0] + 0.1, 500.0], [free[0], 500.0]]
    walled = replace(plan, scenario=changed(plan.scenario, no_fly=[{"polygon_m": wall}]))
    inside = Oracle(walled).margin("no-fly zone 1", window(0.0, plan.flight_s)).min(axis=1)
    assert np.all(inside < -0.045)
    assert Oracle(walled).margin("no-fly zone 1", times).min() > 0.0
    assert "no-fly zone 1" in failed(walled)


def test_a_corner_that_is_cut_between_samples() -> None:
    plan = mission("meadow")
    at_s = 10.025
    before, place, after = Oracle(plan).places_ned_m(np.array([at_s - 0.02, at_s, at_s + 0.02]))[plan.leader, :, :2]
    ahead = (after - before) / np.linalg.norm(after - before)
    side = np.array([-ahead[1], ahead[0]])
    half = 0.4 * float(np.linalg.norm(after - before))
    top = place - 0.12 * side  # deep, and a fifth of that wide
    corners = [top, place + 0.12 * side + half * ahead, place + 0.12 * side - half * ahead]
    cut = replace(plan, scenario=changed(plan.scenario, no_fly=[{"polygon_m": [c.tolist() for c in corners]}]))
    seen = Oracle(cut)
    assert seen.margin("no-fly zone 1", window(at_s - 0.025, at_s + 0.025))[plan.leader].min() < -1e-2
    assert seen.margin("no-fly zone 1", np.arange(0.0, plan.flight_s, 0.05)).min() > 0.0
    assert "no-fly zone 1" in failed(cut)


@pytest.mark.parametrize("phase", ["takeoff", "hover", "arrival-hover", "landing"])
def test_the_box_holds_from_the_ground_to_the_ground(phase: str) -> None:
    """The leader flies out of it, beyond all pads too, and comes back within 30 ms."""
    plan = mission("meadow")
    span = plan.phase(phase)
    here = Oracle(plan).places_ned_m(np.array([span.start_s + 1.0]))[plan.leader, 0, 1]
    aside = plan.scenario.limits.east_m[1] - float(here) + 0.5
    top = humps.hump(span.start_s + 1.011, 0.03, 2)
    out = humps.leader_state(plan, 1, aside, top)
    failures = [check for check in verify(out).failures if check.name == "east position"]
    assert {check.phase for check in failures} == {phase}


@pytest.mark.slow
def test_a_vehicle_out_of_its_way_during_a_change() -> None:
    """2 cm beside where the turn has it, for 20 ms."""
    plan = mission("stairs")
    (move,) = plan.moves
    at_s = 0.5 * (move.start_s + move.end_s) + 0.013
    aside = humps.offset(plan, 2, np.array([0.0, 0.0, 0.02]), humps.hump(at_s, 0.02, 3))
    assert "place in formation" in failed(aside)


def reshaped(plan: Plan, after: Array, move: Move) -> Plan:
    """The flight with another shape after its change, reached on straight ways in the same time."""
    from gcs.plan import planner
    from gcs.plan.formation.shape import stretched
    from gcs.plan.formation.transforms import straight

    before = plan.shape.at(0.0)
    parts = [rigid(before, 0.0, move.start_s)] if move.start_s > 0.0 else []
    parts.append(stretched(straight(before, after), move.start_s, move.end_s))
    parts.append(rigid(after, move.end_s, plan.flight_s))
    return replace(plan, shape=planner._whole_shape(plan.scenario, joined(parts), plan.phases))


@pytest.mark.slow
def test_an_assignment_that_is_not_the_fastest(simulation1: Scenario) -> None:
    """Eq. 14: the two vehicles at the ends of a wedge go to the far ends of a row, each past the other."""
    plan = make_plan(fleet(simulation1, 5, changes=(at(TO_ROW, 2.0),), shapes=SHAPES, time={"flight_s": 40.0}))
    assert verify(plan).ok
    (move,) = plan.moves
    before, after = plan.shape.at(0.0), plan.shape.at(move.end_s)
    longest = float(np.linalg.norm(after - before, axis=1).max())
    others = [v for v in range(len(after)) if v != plan.leader]
    swaps = [(i, j) for i in others for j in others if i < j]

    def swapped(i: int, j: int) -> Array:
        places = after.copy()
        places[[i, j]] = after[[j, i]]
        return places

    far = max(swaps, key=lambda pair: np.linalg.norm(swapped(*pair) - before, axis=1).max())
    slow = swapped(*far)
    assert np.linalg.norm(slow - before, axis=1).max() > longest + 1.0
    assert any("assignment" in name for name in failed(reshaped(plan, slow, move)))


def test_a_control_that_jumps_at_a_joint(simulation1: Scenario) -> None:
    """The thrust jumps by half a newton at a joint, within its limits, and jumps back at the next one."""
    plan = mission("meadow")
    cut = humps.leader_control(plan, 0, 0.0, humps.hump(9.9871, 0.004, 0)).leader_trajectory
    piece = int(np.searchsorted(cut.joints_s, 9.9871))
    c = cut.control.c.copy()
    c[-1, piece, 0] -= 0.5
    jumping = replace(plan, leader_trajectory=replace(cut, control=type(cut.control)(c, cut.control.x)))
    assert any("control" in name and "joint" in name for name in failed(jumping))


def test_a_cliff_beside_a_vehicle_that_is_high_above_the_ground_below(simulation1: Scenario) -> None:
    """A rock 20 m high, 0.1 m to the side of the way; straight below there are three metres of air."""
    plan = mission("meadow")
    here = Oracle(plan).places_ned_m(np.array([10.0]))[plan.leader, 0]
    height, spread = -float(here[2]), 0.2
    aside = spread * np.sqrt(np.log(20.0 / height)) + 0.1
    rock = {
        "north_m": [float(here[0])],
        "east_m": [float(here[1]) + aside],
        "height_m": [20.0],
        "spread_north_m": [spread],
        "spread_east_m": [spread],
    }
    beside = replace(plan, scenario=changed(plan.scenario, terrain={"mountains": rock}))
    below = 20.0 * np.exp(-((aside / spread) ** 2))
    assert height - below > 2.0 * plan.scenario.limits.clearance_min_m
    least = Oracle(beside).margin(CLEARANCE, np.array([10.0]), plan.leader)[0, 0] + plan.scenario.limits.clearance_min_m
    assert 0.05 < least < 0.11
    failure = failed(beside)[CLEARANCE]
    assert failure.worst <= least - plan.scenario.limits.clearance_min_m + 1e-3


def test_a_cliff_beside_a_pad() -> None:
    """A rock 20 m high, 0.1 m beside the way up of one vehicle; an eighth of a metre is the least there."""
    plan = mission("meadow")
    here = plan.pads_ned_m[1]
    spread = 0.1
    aside = spread * np.sqrt(np.log(20.0 / 2.0)) + 0.1
    rock = {
        "north_m": [float(here[0])],
        "east_m": [float(here[1]) + aside],
        "height_m": [20.0],
        "spread_north_m": [spread],
        "spread_east_m": [spread],
    }
    beside = replace(plan, scenario=changed(plan.scenario, terrain={"mountains": rock}))
    times = np.linspace(plan.t_start_s, plan.airborne_s, 400)
    assert Oracle(beside).margin(PAD, times, 1).min() < -0.04
    assert {check.phase for check in verify(beside).failures if check.name == PAD} >= {"takeoff"}


SAMPLES_S = 0.01


def seen_by_samples(plan: Plan, name: str) -> float:
    """The least margin at every multiple of 0.01 s from the begin of the mission."""
    return float(Oracle(plan).margin(name, np.arange(0.0, plan.flight_s, SAMPLES_S)).min())


@pytest.mark.parametrize(
    "name", [pytest.param("course", marks=pytest.mark.slow), pytest.param("breathing", marks=pytest.mark.slow)]
)
def test_a_vehicle_out_of_a_shape_that_may_bend_for_four_milliseconds(name: str) -> None:
    """5 cm down, between two samples: neither a scale nor a turn does that."""
    plan = mission(name)
    down = humps.offset(plan, 2, np.array([0.0, 0.0, 0.05]), humps.hump(10.003, 4e-3, 2))
    assert seen_by_samples(down, PLACE) > -1e-9
    failures = [check for check in verify(down).failures if check.name == PLACE]
    assert [(check.phase, check.sysid) for check in failures] == [("mission", plan.sysids[2])]
    assert failures[0].verdict == "violated"
    assert -0.0501 < failures[0].worst < -0.8e-3
    assert failures[0].t_s == pytest.approx(10.005, abs=2e-3)


def test_a_heading_beside_the_course_for_six_milliseconds() -> None:
    """The leader slips aside, about a degree farther from the formation's heading than it may."""
    plan = mission("course")
    now = np.array([12.005])
    left_deg = float(Oracle(plan).margin(HEADING, now).min())
    assert left_deg > 0.0
    north, east = plan.leader_trajectory.state(now)[0, 3:5]
    aside = np.radians(left_deg + 0.5) * float(np.hypot(north, east)) ** 2 / float(north)
    tops = [humps.leader_state(plan, 4, sign * aside, humps.hump(12.002, 6e-3, 2)) for sign in (1.0, -1.0)]
    slipped = min(tops, key=lambda bent: float(Oracle(bent).margin(HEADING, now).min()))
    assert -1.5 < Oracle(slipped).margin(HEADING, now).min() < -0.3
    assert seen_by_samples(slipped, HEADING) == seen_by_samples(plan, HEADING)
    failure = failed(slipped)[HEADING]
    assert failure.verdict == "violated"
    assert failure.t_s == pytest.approx(12.005, abs=3e-3)
