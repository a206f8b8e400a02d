"""Active vehicles: the few of many whose constraints can bind, against a check of every one of them."""

from __future__ import annotations

import itertools
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import PPoly

from gcs.physics.quadrotor import derivative
from gcs.physics.states import VELOCITY
from gcs.plan.formation.coordinates import composed
from gcs.plan.formation.timeline import lay
from gcs.plan.nlp.mesh import end_refined
from gcs.plan.nlp.mesh_refinement import FROM_SOLUTION
from gcs.plan.nlp.transcription import transcribe
from gcs.plan.ocp import stage_functions
from gcs.plan.ocp.active_vehicles import FOOT, LIFT, NEAR_GROUND, NEAR_ZONE, SLOT, active_vehicles, offsets_at
from gcs.plan.ocp.problem import Problem, flight_problem
from gcs.plan.planner import make_plan
from gcs.plan.search.initial_guess import along, straight_route
from gcs.plan.trajectory.constraint_id import ConstraintId, Kind
from gcs.plan.verification.verify import verify
from gcs.scenario.environment.clearance_floor import FEET
from gcs.scenario.environment.terrain import ground_envelope_m
from gcs.scenario.schema.scenario import Scenario
from gcs.types import Array
from tests.unit.plan.formations import SHAPES, SHRINK, TO_FILE, TURN, at, auto, block, fleet, gap

TIMES = np.linspace(0.0, 59.9, 41)
BEND = (auto(SHRINK), auto({**TURN, "angle_deg": 60.0}))


def wandering(problem: Problem, times: Array) -> Array:
    """States (T, nx) along the way and far beside it, in any pose."""
    random = np.random.default_rng(4)
    states = np.zeros((len(times), 12 + 4 * len(problem.coordinates)))
    states[:, 0] = random.uniform(-10.0, 110.0, len(times))
    states[:, 1] = random.uniform(-40.0, 40.0, len(times))
    states[:, 2] = -random.uniform(2.0, 14.0, len(times))
    for i, c in enumerate(problem.coordinates):
        states[:, 12 + 4 * i] = random.uniform(max(c.low, -2.0), min(c.high, 2.0), len(times))
    return states


def by_schedule(scenario: Scenario) -> Problem:
    """The problem with its changes laid where they say."""
    problem = flight_problem(scenario)
    starts = tuple(float(c.at_s) for c in scenario.formation.change if c.at_s is not None)
    return replace(problem, shape=lay(scenario, starts, problem.start_s, problem.end_s).shape)


@pytest.fixture(params=["rigid", "scheduled", "bending"])
def problem(request: pytest.FixtureRequest, simulation1: Scenario) -> Problem:
    changes: dict[str, tuple[dict[str, Any], ...]] = {
        "rigid": (),
        "scheduled": (at({**TURN, "angle_deg": 40.0}, 2.0), at({**SHRINK, "scale": 0.9}, 48.0)),
        "bending": BEND,
    }
    return by_schedule(block(simulation1, changes[request.param]))


def places(problem: Problem, times: Array, states: Array) -> Array:
    """Positions of all vehicles (V, T, 3)."""
    return states[:, :3] + offsets_at(problem, problem.shape.offsets(times), states)


def spare_m(problem: Problem, at_all: Array) -> Array:
    """Height (V, T) over a ball that touches the smooth ground, from 300 points of the ground around each place."""
    kept_m = problem.scenario.limits.clearance_min_m
    floor = np.full(at_all.shape[:2], -np.inf)
    for radius in np.linspace(0.0, 0.99, 13):
        for angle in np.linspace(0.0, 2.0 * np.pi, 25)[:-1]:
            north, east = (at_all[..., i] + kept_m * radius * f(angle) for i, f in enumerate((np.cos, np.sin)))
            ground = ground_envelope_m(problem.scenario.terrain, north, east)
            floor = np.maximum(floor, ground + kept_m * np.sqrt(1.0 - radius**2))
    return -at_all[..., 2] - floor


def test_the_nearest_to_the_ground_is_always_watched(problem: Problem) -> None:
    states = wandering(problem, TIMES)
    chosen = active_vehicles(problem, TIMES, states)
    spare = spare_m(problem, places(problem, TIMES, states))
    first = np.take_along_axis(spare, chosen.ground[None, :, 0], axis=0)[0]
    np.testing.assert_allclose(first, spare.min(axis=0), atol=0.05)
    assert chosen.ground.shape == (len(TIMES), FEET * NEAR_GROUND)
    for rows in chosen.ground[:, ::FEET]:
        assert len(set(rows.tolist())) == NEAR_GROUND
    assert len(np.unique(chosen.ground[:, 0])) > 10  # not always the same one


def test_so_is_the_nearest_a_little_beside_where_the_leader_was_seen(problem: Problem) -> None:
    states = wandering(problem, TIMES)
    chosen = active_vehicles(problem, TIMES, states)
    for aside in ([8.0, 8.0], [8.0, -8.0], [-8.0, 8.0], [-8.0, -8.0]):
        moved = states.copy()
        moved[:, :2] += aside
        at_all = places(problem, TIMES, moved)
        spare = -at_all[..., 2] - ground_envelope_m(problem.scenario.terrain, at_all[..., 0], at_all[..., 1])
        for rows, nearest in zip(chosen.ground, spare.argmin(axis=0), strict=True):
            assert nearest in rows


def test_the_nearest_to_every_disk_is_watched(simulation1: Scenario) -> None:
    two = [{"north_m": 50.0, "east_m": -27.0, "radius_m": 14.0}, {"north_m": 20.0, "east_m": 30.0, "radius_m": 5.0}]
    problem = flight_problem(block(simulation1, no_fly=two))
    states = wandering(problem, TIMES)
    chosen = active_vehicles(problem, TIMES, states)
    at_all = places(problem, TIMES, states)
    assert len(chosen.zones) == 2
    for rows, disk in zip(chosen.zones, two, strict=True):
        assert rows.shape == (len(TIMES), NEAR_ZONE)
        distance = np.hypot(at_all[..., 0] - disk["north_m"], at_all[..., 1] - disk["east_m"])
        np.testing.assert_array_equal(rows[:, 0], distance.argmin(axis=0))


def test_of_a_few_everyone_is_watched(simulation1: Scenario) -> None:
    problem = flight_problem(fleet(simulation1, 5, "row", no_fly=[{"north_m": 9.0, "east_m": 9.0, "radius_m": 1.0}]))
    chosen = active_vehicles(problem, TIMES[:3], wandering(problem, TIMES[:3]))
    assert [set(rows.tolist()) for rows in chosen.ground] == [set(range(5))] * 3
    assert chosen.zones[0].shape == (3, 3)


def test_the_leader_alone_moves_where_all_move_alike(simulation1: Scenario) -> None:
    rigid = flight_problem(block(simulation1))
    chosen = active_vehicles(rigid, TIMES, wandering(rigid, TIMES))
    assert chosen.moving.tolist() == [[rigid.leader]] * len(TIMES)
    assert chosen.moving_used.all()
    scheduled = by_schedule(block(simulation1, (at(SHRINK, 20.0),)))
    chosen = active_vehicles(scheduled, TIMES, wandering(scheduled, TIMES))
    assert (chosen.moving[:, 0] == scheduled.leader).all()
    assert chosen.moving_used[:, 0].all()
    ((start_s, end_s),) = scheduled.shape.moving_s
    during = np.array([start_s < t < end_s for t in TIMES])
    assert 0 < during.sum() < len(TIMES)
    np.testing.assert_array_equal(chosen.moving_used[:, 1:].any(axis=1), during)


def test_who_is_farthest_out_moves_most_and_is_watched(simulation1: Scenario) -> None:
    problem = flight_problem(block(simulation1, BEND))
    chosen = active_vehicles(problem, TIMES, wandering(problem, TIMES))
    base = problem.shape.offsets(TIMES)
    for axis, sign in ((0, 1.0), (0, -1.0), (1, 1.0), (1, -1.0)):
        extreme = (sign * base[..., axis]).max(axis=0)
        reached = (sign * base[chosen.moving, np.arange(len(TIMES))[:, None], axis]).max(axis=1)
        np.testing.assert_allclose(reached, extreme)


def test_the_highest_and_the_lowest_are_watched_where_the_shape_bends_by_itself(simulation1: Scenario) -> None:
    shapes = ({"name": "ball", "generator": "sphere", "spacing_m": 3.0},)
    problem = flight_problem(fleet(simulation1, 20, "ball", (auto(SHRINK),), shapes, start={"position_m": [2, 1, 9]}))
    assert problem.has_heights
    chosen = active_vehicles(problem, TIMES[:5], wandering(problem, TIMES[:5]))
    height = -problem.shape.at(0.0)[:, 2]
    for rows in chosen.moving:
        assert {height[rows].max(), height[rows].min()} == {height.max(), height.min()}
    assert not flight_problem(block(simulation1, BEND)).has_heights


def rows_left(problem: Problem, times: Array, states: Array) -> list[set[str]]:
    """Names of the rows of the path that may bind at each instant."""
    chosen = active_vehicles(problem, times, states)
    counts = (chosen.ground.shape[1], max((d.shape[1] for d in chosen.zones), default=0), chosen.moving.shape[1])
    path = stage_functions.functions(problem, *counts).path.map(len(times))
    controls = np.zeros((len(times), 4 + len(problem.coordinates)))
    controls[:, 0] = problem.quadrotor.weight_N
    values = np.asarray(path(np.hstack([states, controls]).T, chosen.parameters.T)).T
    used = stage_functions.path_may_bind(problem, chosen, values, FROM_SOLUTION, len(times))
    rows = stage_functions.path_ids(problem, chosen)
    return [set(map(str, itertools.compress(row, kept))) for row, kept in zip(rows, used, strict=True)]


def test_with_the_course_only_rows_that_can_bind_are_in_the_program(simulation1: Scenario) -> None:
    zone = {"north_m": 30.0, "east_m": 30.0, "radius_m": 5.0}
    problem = flight_problem(fleet(simulation1, 5, "row", formation={"frame": "course"}, no_fly=[zone]))
    limits, most_mps = problem.scenario.limits, problem.scenario.limits.speed_ned_mps[0]
    low, high = limits.north_m
    states = np.zeros((5, 16))
    states[:, :3] = [0.5 * (low + high), 0.5 * sum(limits.east_m), -limits.clearance_min_m - 20.0]
    states[:, 3] = 1.0
    states[1, 3] = 0.9 * most_mps
    states[2, 2] = -limits.clearance_min_m - 1.0
    states[3, 0] = high - 1.0
    states[4, :2] = [30.0, 20.0]
    calm, fast, lowly, aside, near = rows_left(problem, TIMES[:5], states)
    leaders = {f"{name} of vehicle 1" for name in ("turning radius", "acceleration")}
    ways = {
        "jerk of the formation",
        "heading of the formation along its course",
        "flight towards the formation's front",
    }
    assert leaders | ways >= {name for name in calm if "zone" not in name}
    assert ways - {"jerk of the formation"} <= calm
    assert {f"north speed of vehicle {v}" for v in range(2, 6)} <= fast
    assert "north speed of vehicle 1" not in fast  # the leader's is a bound
    assert {f"clearance of vehicle {v}" for v in range(1, 6)} <= lowly
    assert any(name.startswith("north of vehicle") for name in aside)
    assert any(name.startswith("no-fly zone 1") for name in near)


def test_slots_hold_the_watched_vehicles_motion(simulation1: Scenario) -> None:
    problem = by_schedule(block(simulation1, (at(SHRINK, 20.0),)))
    chosen = active_vehicles(problem, TIMES, wandering(problem, TIMES))
    rows = np.hstack([chosen.ground, *chosen.zones, chosen.moving])
    slots = chosen.parameters.reshape(len(TIMES), rows.shape[1], SLOT)
    for t, at_s in enumerate(TIMES):
        for order in range(3):
            np.testing.assert_array_equal(
                slots[t, :, 3 * order : 3 * order + 3], problem.shape.at(float(at_s), order)[rows[t]]
            )
        np.testing.assert_array_equal(slots[t, :, 9:12], problem.target_ned_m[rows[t]])


def test_feet_are_where_the_ground_requires_most_height(problem: Problem) -> None:
    """Both feet of each vehicle require what the densest grid of feet requires."""
    states = wandering(problem, TIMES)
    chosen = active_vehicles(problem, TIMES, states)
    slots = chosen.parameters.reshape(len(TIMES), -1, SLOT)[:, : chosen.ground.shape[1]]
    at_all = places(problem, TIMES, states)
    at_foot = at_all[chosen.ground, np.arange(len(TIMES))[:, None]]
    feet = slots[..., FOOT]
    ground = ground_envelope_m(problem.scenario.terrain, at_foot[..., 0] + feet[..., 0], at_foot[..., 1] + feet[..., 1])
    spare = -at_foot[..., 2] - ground - slots[..., LIFT]
    kept_m = problem.scenario.limits.clearance_min_m
    np.testing.assert_allclose(np.hypot(np.linalg.norm(feet, axis=2), slots[..., LIFT]), kept_m, atol=1e-9)
    least = np.take_along_axis(spare_m(problem, at_all).T, chosen.ground, axis=1)
    found = np.minimum(spare[:, ::FEET], spare[:, 1::FEET])
    assert np.all(found <= least[:, ::FEET] + 1e-6)
    assert np.all(found >= least[:, ::FEET] - 0.05)


TALL = auto({"kind": "reshape", "to": "ball"})


@pytest.mark.parametrize(
    "changes", [(at({**TURN, "angle_deg": 50.0}, 0.0), *BEND), (auto(TO_FILE), auto(SHRINK)), (TALL, auto(SHRINK))]
)
def test_constraints_are_those_of_each_watched_vehicles_own_flight(
    simulation1: Scenario, changes: tuple[dict[str, Any], ...]
) -> None:
    """What the program asks of an instant, from the shape over time by differences, and Eq. 1 for the leader."""
    ball = {"name": "ball", "generator": "sphere", "spacing_m": 3.0}
    problem = by_schedule(gap(simulation1, 5.0, changes, formation={"shape": (*SHAPES, ball)}))
    assert problem.has_heights == (TALL in changes)
    names = [c.name for c in problem.coordinates]
    chains = len(names)
    random = np.random.default_rng(6)
    parts = stage_functions.functions(problem, FEET * 5, 3, 5)
    scenario, limits = problem.scenario, problem.scenario.limits
    for at_s in (1.0, 5.0, 8.0):
        z = np.zeros(16 + 5 * chains)
        z[:3] = random.uniform([10.0, -5.0, -9.0], [40.0, 5.0, -4.0])
        z[3:6] = random.uniform(-2.0, 2.0, 3)
        z[6:12] = random.uniform(-0.1, 0.1, 6)
        for i, c in enumerate(problem.coordinates):
            z[12 + 4 * i] = random.uniform(c.low, c.high)
            z[13 + 4 * i : 16 + 4 * i] = random.uniform(-1.0, 1.0, 3) * c.most[:3]
        z[12 + 4 * chains] = problem.quadrotor.weight_N
        # The coordinates as polynomials that have these derivatives at the instant.
        series = np.zeros((4, 1, chains))
        for i in range(chains):
            series[:, 0, i] = z[12 + 4 * i : 16 + 4 * i][::-1] / [6.0, 2.0, 1.0, 1.0]
        shifted = PPoly(series, np.array([at_s, at_s + 0.5]))
        base = problem.shape
        inside = replace(base, functions=PPoly(_expanded(base.functions, at_s), np.array([at_s, at_s + 0.5])))
        flown = composed(inside, problem.target_ned_m, names, shifted)
        place, speed, acceleration = (flown.at(at_s, order) for order in range(3))
        chosen = active_vehicles(problem, np.array([at_s]), z[None, : 12 + 4 * chains])
        values = np.array(parts.path(z, chosen.parameters[0])).ravel()
        rows = iter(zip(map(str, stage_functions.path_ids(problem, chosen)[0]), values, strict=True))
        slots = chosen.parameters.reshape(-1, SLOT)
        for row, vehicle in enumerate(chosen.ground[0]):
            at_all = z[:3] + place[vehicle]
            under = at_all[:2] + slots[row, FOOT]
            spare = -at_all[2] - ground_envelope_m(scenario.terrain, under[0], under[1]) - slots[row, LIFT]
            side = ", other side" if row % 2 else ""
            assert next(rows) == (f"clearance of vehicle {vehicle + 1}{side}", pytest.approx(spare, abs=1e-9))
        for number, disk in enumerate(scenario.no_fly):
            for vehicle in chosen.zones[number][0]:
                name, value = next(rows)
                away = np.hypot(*(z[:2] + place[vehicle, :2] - [disk.north_m, disk.east_m]))
                assert name == f"no-fly zone {number + 1} for vehicle {vehicle + 1}"
                assert value == pytest.approx((away**2 - disk.radius_m**2) / (2.0 * disk.radius_m), abs=1e-9)
        leader = derivative(z[:12], z[12 + 4 * chains : 16 + 4 * chains], problem.quadrotor)[VELOCITY]
        for vehicle in chosen.moving[0]:
            found = dict(next(rows) for _ in range(7 + problem.has_heights))
            who = f" of vehicle {vehicle + 1}"
            v, a = z[3:6] + speed[vehicle], leader + acceleration[vehicle]
            turn = (v[0] * a[1] - v[1] * a[0]) ** 2 / (v[0] ** 2 + v[1] ** 2 + stage_functions.REST_SMOOTHING_MPS**2)
            most = limits.load_factor_max * problem.quadrotor.gravity_mps2
            assert limits.accel_max_mps2 is not None
            wanted = {
                "turning radius": 1.0 - turn / most**2,
                "acceleration": 1.0 - a @ a / limits.accel_max_mps2**2,
                "north": 1.0 - ((z[0] + place[vehicle, 0] - np.mean(limits.north_m)) * 2 / np.ptp(limits.north_m)) ** 2,
                "east": 1.0 - ((z[1] + place[vehicle, 1] - np.mean(limits.east_m)) * 2 / np.ptp(limits.east_m)) ** 2,
                **{
                    word: 1.0 - (v[axis] / limits.speed_ned_mps[axis]) ** 2
                    for axis, word in enumerate(("north speed", "east speed", "vertical speed"))
                },
            }
            if problem.has_heights:
                low, high = limits.height_m
                middle, half = 0.5 * (low + high), 0.5 * (high - low)
                wanted["height"] = 1.0 - ((-(z[2] + place[vehicle, 2]) - middle) / half) ** 2
            assert found == {word + who: pytest.approx(value, abs=1e-8) for word, value in wanted.items()}


def _expanded(functions: PPoly, at_s: float) -> Array:
    """One polynomial's coefficients about `at_s`."""
    degree = len(functions.c) - 1
    factorial = np.cumprod([1.0, *range(1, degree + 1)])
    return np.stack([functions(at_s, nu=n) / factorial[n] for n in range(degree, -1, -1)])[:, None]


@pytest.mark.long
@pytest.mark.parametrize("changes", [(), (at(SHRINK, 5.0),)], ids=["rigid", "shrinking"])
def test_sixty_vehicles_clear_hills_that_a_few_are_watched_over(
    simulation1: Scenario, changes: tuple[dict[str, Any], ...]
) -> None:
    scenario = block(simulation1, changes)
    problem = flight_problem(scenario)
    program = transcribe(problem, end_refined(0.0, 60.0, 9.0, 1.0, 5), along(problem, straight_route(problem)))
    per_instant: dict[float, set[ConstraintId]] = {}
    for constraint, t_s in program.g_ids:
        if constraint.kind is Kind.CLEARANCE:
            per_instant.setdefault(t_s, set()).add(constraint)
    assert {len(rows) for rows in per_instant.values()} == {FEET * NEAR_GROUND}
    plan = make_plan(scenario)
    report = verify(plan)
    assert report.ok, [str(check) for check in report.failures]
    # The hills are in the way: without them it would fly lower, and it comes as near to them as it may.
    assert report.clearance_min_m == pytest.approx(1.0, abs=0.05)
    assert (-plan.leader_trajectory.state(np.linspace(20.0, 50.0, 99))[:, 2]).max() > 6.5
