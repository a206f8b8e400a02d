"""The check between the nodes finds all violations that a check of all vehicles at all instants finds."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import PPoly

from gcs.plan.formation.shape import Shape, joined, rigid, stretched
from gcs.plan.formation.transforms import straight as straight_leg
from gcs.plan.nlp.violations import (
    Violation,
    accel_reserve_mps2,
    find_violations,
    jerk_reserve_mps3,
    tightenings,
    turning_reserve_g,
)
from gcs.plan.nlp.violations import complaints as complaints_of
from gcs.plan.ocp.bounds import leader_control_bounds
from gcs.plan.ocp.problem import Problem, control_bounds, flight_problem
from gcs.plan.ocp.stage_functions import functions
from gcs.plan.trajectory.constraint_id import ConstraintId, Kind
from gcs.plan.trajectory.trajectory import Trajectory
from gcs.scenario.schema.scenario import Scenario
from gcs.types import Array
from tests.unit.plan.formations import SHRINK, auto, fleet
from tests.unit.plan.problems import straight

HILLS = {
    "north_m": [40.0, 75.0],
    "east_m": [-8.0, 10.0],
    "height_m": [6.0, 5.0],
    "spread_north_m": [6.0, 5.0],
    "spread_east_m": [5.0, 5.0],
}
FLIGHT: dict[str, Any] = {
    "time": {"flight_s": 25.0},
    "start": {"position_m": [0.0, 0.0, 5.0]},
    "end": {"position_m": [100.0, 0.0, 5.0]},
    "limits": {"speed_ned_mps": [4.5, 4.0, 1.5]},
}
BLOCK = ({"name": "row", "generator": "grid", "spacing_m": 4.0},)


SHEAR = {"speed_mps": 3.0, "from_deg": 0.0, "shear": 0.3}


def crossing(scenario: Scenario, count: int, **tables: Any) -> Problem:
    """`count` vehicles that cross 100 m of level ground in 25 s: 2 m from glance to glance."""
    limits = FLIGHT["limits"] | tables.pop("limits", {})
    return flight_problem(fleet(scenario, count, "row", (), BLOCK, **FLIGHT | {"limits": limits} | tables))


def found(problem: Problem, shape: Shape | None = None, trajectory: Trajectory | None = None) -> dict[str, str]:
    """Complaints by the constraint they name."""
    shape = problem.shape if shape is None else shape
    found = find_violations(problem, straight(problem) if trajectory is None else trajectory, shape)
    return {text.split(" violated by")[0]: text for text in complaints_of(found)}


STEP_S = 0.01
TOLERANCE_M, TOLERANCE = 0.4e-3, 0.5e-3  # in m, and as a share of a limit


def differences(values: Array, order: int, step_s: float) -> Array:
    """A derivative of values (..., N, K) over time by central differences, straight on at both ends."""
    for _ in range(order):
        values = np.gradient(values, step_s, axis=-2, edge_order=2)
    return values


def everything(problem: Problem, trajectory: Trajectory, shape: Shape, step_s: float = STEP_S) -> dict[str, float]:
    """Least value of every violated constraint of all vehicles, every `step_s`, from positions alone.

    Written apart from the code: formulas of the paper on positions and their differences, for a leader that flies
    level with its weight as thrust.
    """
    scenario, limits, body = problem.scenario, problem.scenario.limits, problem.scenario.vehicle
    times = np.arange(problem.start_s, problem.end_s, step_s)
    leader = trajectory.vehicle.state(times)
    offsets = shape.offsets(times)
    place = leader[:, :3] + offsets
    velocity = leader[:, 3:6] + differences(offsets, 1, step_s)
    drag, m, g = np.array(body.drag_Nspm), body.mass_kg, body.gravity_mps2
    acceleration = -drag / m * leader[:, 3:6] + differences(offsets, 2, step_s)
    force = m * (np.array([0.0, 0.0, g]) - acceleration) - drag * velocity
    pitch = np.arctan2(force[..., 0], force[..., 2])
    roll = np.arctan2(-force[..., 1], np.hypot(force[..., 0], force[..., 2]))
    tilt = np.stack([roll, pitch], axis=-1)
    rates, angular = differences(tilt, 1, step_s), differences(tilt, 2, step_s)
    moments = (np.array(body.inertia_kgm2[:2]) * angular + np.array(body.drag_moment_Nms[:2]) * rates) / body.arm_m
    speed = np.hypot(velocity[..., 0], velocity[..., 1])
    turn = np.abs(velocity[..., 0] * acceleration[..., 1] - velocity[..., 1] * acceleration[..., 0])
    lower, upper = control_bounds(scenario)
    margin: dict[str, tuple[Array, float]] = {
        "clearance above ground": (clearance_m(problem, place), TOLERANCE_M),
        "height": (
            np.minimum(-place[..., 2] - limits.height_m[0], limits.height_m[1] + place[..., 2]),
            TOLERANCE_M,
        ),
        "thrust U1": (
            np.minimum(np.linalg.norm(force, axis=-1) - lower[0], upper[0] - np.linalg.norm(force, axis=-1)),
            0,
        ),
        "turning load factor": (
            limits.load_factor_max - turn / np.maximum(speed, 0.1) / g,
            TOLERANCE * limits.load_factor_max,
        ),
    }
    for number, disk in enumerate(scenario.no_fly, start=1):
        away = np.hypot(place[..., 0] - disk.north_m, place[..., 1] - disk.east_m) - disk.radius_m
        margin[f"no-fly zone {number}"] = away, TOLERANCE_M
    for axis, (name, (low, high)) in enumerate((("north", limits.north_m), ("east", limits.east_m))):
        margin[f"{name} position"] = np.minimum(place[..., axis] - low, high - place[..., axis]), TOLERANCE_M
    for axis, name in enumerate(("north speed", "east speed", "vertical speed")):
        most = limits.speed_ned_mps[axis]
        margin[name] = most - np.abs(velocity[..., axis]), TOLERANCE * most
    for axis, name in enumerate(("roll", "pitch")):
        most, fast = limits.roll_pitch_yaw_deg[axis], limits.rates_degps[axis]
        margin[name] = most - np.degrees(np.abs(tilt[..., axis])), TOLERANCE * most
        margin[f"{name} rate"] = fast - np.degrees(np.abs(rates[..., axis])), TOLERANCE * fast
        margin[f"control U{axis + 2}"] = upper[axis + 1] - np.abs(moments[..., axis]), TOLERANCE * upper[axis + 1]
    if (most_mps2 := limits.accel_max_mps2) is not None:
        margin["acceleration"] = most_mps2 - np.linalg.norm(acceleration, axis=-1), TOLERANCE * most_mps2
    fast, hard = scenario.formation.change_speed_mps, scenario.formation.change_accel_mps2
    margin["speed in the shape"] = fast - np.linalg.norm(differences(offsets, 1, step_s), axis=-1), TOLERANCE * fast
    margin["acceleration in the shape"] = (
        hard - np.linalg.norm(differences(offsets, 2, step_s), axis=-1),
        TOLERANCE * hard,
    )
    return {name: float(value.min()) for name, (value, tolerance) in margin.items() if value.min() < -tolerance}


def clearance_m(problem: Problem, place: Array) -> Array:
    """Distance (V, N) to the mountains minus the least clearance, from points of the ground 2 cm apart."""
    mountains, least = problem.scenario.terrain.mountains, problem.scenario.limits.clearance_min_m
    columns = (mountains.height_m, mountains.north_m, mountains.east_m)
    spreads = (mountains.spread_north_m, mountains.spread_east_m)

    def ground(north: Array, east: Array) -> Array:
        total = np.zeros_like(north)
        for height, n, e, spread_n, spread_e in zip(*columns, *spreads, strict=True):
            total += height * np.exp(-(((north - n) / spread_n) ** 2) - ((east - e) / spread_e) ** 2)
        return total

    above = -place[..., 2] - ground(place[..., 0], place[..., 1])
    near = (above > 0.0) & (above < 3.0 * least)
    axis = np.arange(-1.2 * least, 1.2 * least, 0.02)
    a, b = (part.ravel() for part in np.meshgrid(axis, axis))
    for row, instant in np.argwhere(near):
        north, east, down = place[row, instant]
        away = np.sqrt(a**2 + b**2 + (down + ground(north + a, east + b)) ** 2)
        above[row, instant] = min(above[row, instant], away.min())
    return np.asarray(above - least)


@pytest.mark.parametrize("count", [5, 60])
def test_where_nothing_is_broken_nothing_is_found(simulation1: Scenario, count: int) -> None:
    problem = crossing(simulation1, count)
    found = find_violations(problem, straight(problem), problem.shape)
    instants, complaints = np.array(sorted({miss.t_s for miss in found})), complaints_of(found)
    assert complaints == ()
    assert len(instants) == 0


@pytest.mark.parametrize("count", [3, 16, 17])
def test_hills_are_found_under_any_number(simulation1: Scenario, count: int) -> None:
    problem = crossing(simulation1, count, terrain={"ripple": None, "mountains": HILLS})
    complaints, brute = found(problem), everything(problem, straight(problem), problem.shape)
    assert set(complaints) == set(brute)
    if brute:
        by_m = float(complaints["clearance above ground"].split("by ")[1].split(" m")[0])
        assert by_m == pytest.approx(-brute["clearance above ground"], rel=5e-3)


def track(problem: Problem, vehicle: int, at_s: float = 12.25) -> Array:
    """Where a vehicle is at a time, (3,)."""
    return np.asarray(straight(problem).state(np.array([at_s]))[0, :3] + problem.shape.at(at_s)[vehicle])


@pytest.mark.parametrize(("count", "vehicle"), [(5, 3), (60, 0), (60, -1)])
def test_a_single_vehicle_over_a_needle_is_found(simulation1: Scenario, count: int, vehicle: int) -> None:
    """A spike 5 m wide, a few centimetres too high."""
    at_all = track(crossing(simulation1, count), vehicle)
    spike = {
        "north_m": [float(at_all[0])],
        "east_m": [float(at_all[1])],
        "height_m": [4.1],
        "spread_north_m": [4.0],
        "spread_east_m": [2.0],
    }
    problem = crossing(simulation1, count, terrain={"ripple": None, "mountains": spike})
    complaints, brute = found(problem), everything(problem, straight(problem), problem.shape)
    assert set(complaints) == set(brute) == {"clearance above ground"}
    by_m = float(complaints["clearance above ground"].split("by ")[1].split(" m")[0])
    assert by_m == pytest.approx(-brute["clearance above ground"], rel=5e-3)


@pytest.mark.parametrize(
    ("count", "vehicle", "radius_m"),
    [(5, 0, 0.2), (5, 3, 8.0), (5, -1, 1.0), (60, 0, 1.0), (60, 3, 0.2), (60, -1, 8)],
)
def test_a_disk_between_two_glances_is_found(simulation1: Scenario, count: int, vehicle: int, radius_m: float) -> None:
    """A zone as small as a mast, passed at half its radius, wherever this is between two coarse instants."""
    level = crossing(simulation1, count)
    for at_s in (12.0, 12.12, 12.26):
        at_all = track(level, vehicle, at_s)
        mast = {"north_m": float(at_all[0]), "east_m": float(at_all[1]) + 0.5 * radius_m, "radius_m": radius_m}
        (complaint,) = found(crossing(simulation1, count, no_fly=[mast])).values()
        assert complaint.startswith("no-fly zone 1 violated by")
        by_m = float(complaint.split("by ")[1].split(" m")[0])
        # Samples are 0.2 m apart; it is more where another vehicle passes nearer to the middle.
        assert by_m >= radius_m - np.hypot(0.5 * radius_m, 0.1) - 1e-3


@pytest.mark.parametrize("count", [5, 60])
def test_the_box_is_found_of_the_one_who_leaves_it(simulation1: Scenario, count: int) -> None:
    east_m = float(crossing(simulation1, count).shape.at(0.0)[:, 1].max())
    problem = crossing(simulation1, count, limits={"east_m": [-60.0, east_m - 0.01]})
    assert set(found(problem)) == {"east position"}


@pytest.mark.parametrize("count", [5, 60])
@pytest.mark.parametrize("vehicle", [0, -1])
def test_the_ceiling_is_found_of_the_one_who_is_above_it(simulation1: Scenario, count: int, vehicle: int) -> None:
    """High over level ground, far from everything else."""
    problem = crossing(simulation1, count, limits={"height_m": [0.0, 7.0]})
    places = problem.shape.at(0.0)
    places[vehicle, 2] -= 2.05
    complaints = found(problem, rigid(places, problem.start_s, problem.end_s))
    assert set(complaints) == {"height"}


@pytest.mark.parametrize("count", [5, 60])
def test_the_leaders_own_limits_are_found(simulation1: Scenario, count: int) -> None:
    problem = crossing(simulation1, count, limits={"speed_ned_mps": [3.9, 4.0, 1.5]})
    assert set(found(problem)) == {"north speed"}


def one_goes_elsewhere(problem: Problem, vehicle: int, by_ned_m: tuple[float, float, float], seconds: float) -> Shape:
    """All vehicles rigid but one, which leaves its place from 10 s on."""
    start = problem.shape.at(problem.start_s)
    there = start.copy()
    there[vehicle] += by_ned_m
    return joined(
        [
            rigid(start, problem.start_s, 10.0),
            stretched(straight_leg(start, there), 10.0, 10.0 + seconds),
            rigid(there, 10.0 + seconds, problem.end_s),
        ]
    )


# Between the eight directions in which the farthest is looked for, straight up, and along an axis.
WAYS = [(3.0, 3.0 * np.tan(np.pi / 8.0), 0.0), (0.0, -3.0, 0.0), (0.0, 0.0, -3.0), (2.0, 2.0, -2.0)]


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize(("count", "vehicle"), [(5, 1), (60, 2), (60, -1)])
def test_one_who_moves_too_fast_in_the_shape_is_found(
    simulation1: Scenario, count: int, vehicle: int, way: tuple[float, float, float]
) -> None:
    """While all others move half as far in the other direction, or not at all.

    The septic step reaches 35/16 of the mean speed, and 84 sqrt(5) / 25 lengths over the time squared.
    """
    problem = crossing(simulation1, count, limits={"accel_max_mps2": 30.0, "load_factor_max": 3.0})
    way_m, limit_mps2 = float(np.linalg.norm(way)), problem.scenario.formation.change_accel_mps2
    for others in (0.0, -0.5):
        shape = one_goes_elsewhere(problem, vehicle, way, 5.0)
        tables = shape.basis_ned_m.copy()
        tables[2:] += others * np.array(way)
        tables[2:, vehicle] -= others * np.array(way)
        tables[2:, problem.leader] = 0.0
        tables[-1] = tables[2]
        complaints = found(problem, replace(shape, basis_ned_m=tables))
        by_mps = way_m / 5.0 * 35.0 / 16.0 - problem.scenario.formation.change_speed_mps
        assert float(complaints["speed in the shape"].split("by ")[1].split()[0]) == pytest.approx(by_mps, rel=6e-3)
        by_mps2 = way_m / 25.0 * 84.0 * 5.0**0.5 / 25.0 - limit_mps2
        assert ("acceleration in the shape" in complaints) == (by_mps2 > TOLERANCE * limit_mps2)


@pytest.mark.parametrize("count", [5, 60])
def test_the_fastest_is_found_beside_others_who_are_faster_along_every_axis(simulation1: Scenario, count: int) -> None:
    """Half way between two directions in which the farthest is looked for, with one almost as fast along each."""
    problem = crossing(simulation1, count, limits={"accel_max_mps2": 30.0, "load_factor_max": 3.0})
    start = problem.shape.at(problem.start_s)
    there = start.copy()
    # From a step in 8 s: 35/16 of the mean speed, so 1 m/s at the most is 3.66 m.
    for vehicle, angle_deg, way_m in ((2, 22.5, 3.7), (3, 0.0, 3.55), (4, 45.0, 3.55)):
        there[vehicle, :2] += way_m * np.array([np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))])
    shape = joined(
        [rigid(start, 0.0, 10.0), stretched(straight_leg(start, there), 10.0, 18.0), rigid(there, 18.0, problem.end_s)]
    )
    brute = everything(problem, straight(problem), shape)
    complaints = found(problem, shape)
    assert set(complaints) == set(brute)
    assert "speed in the shape" in brute


@pytest.mark.parametrize("count", [5, 60])
def test_the_fastest_along_an_axis_is_found_beside_one_who_is_faster_across(simulation1: Scenario, count: int) -> None:
    """One moves north in the shape and one west; one moves north-east, and one south-west, a little farther."""
    problem = crossing(simulation1, count, limits={"speed_ned_mps": [4.85, 0.85, 1.5]})
    start = problem.shape.at(problem.start_s)
    there = start.copy()
    for vehicle, ways_m in ((1, (3.4, 0.0)), (2, (0.0, -3.4)), (3, (2.5, 2.5)), (4, (-2.6, -2.6))):
        there[vehicle, :2] += ways_m
    shape = joined(
        [rigid(start, 0.0, 10.0), stretched(straight_leg(start, there), 10.0, 18.0), rigid(there, 18.0, problem.end_s)]
    )
    brute = everything(problem, straight(problem), shape)
    assert {"north speed", "east speed"} <= set(brute)
    assert set(found(problem, shape)) == set(brute)


@pytest.mark.parametrize("seed", range(4))
def test_of_a_few_everything_is_found_that_a_look_at_everyone_finds(simulation1: Scenario, seed: int) -> None:
    """Random motions of random shapes under random limits: the same constraints, to the same amount."""
    random = np.random.default_rng(seed)
    limits = {
        "speed_ned_mps": random.uniform([3.8, 0.2, 0.2], [4.5, 1.0, 1.0]).tolist(),
        "accel_max_mps2": float(random.uniform(0.3, 1.0)),
        "east_m": [-20.0, float(random.uniform(5.0, 12.0))],
        "height_m": [0.0, float(random.uniform(5.5, 8.0))],
        "roll_pitch_yaw_deg": [5.0, 5.0, 180.0],
        "load_factor_max": 0.05,
    }
    disk = {"north_m": 50.0, "east_m": float(random.uniform(-12.0, 12.0)), "radius_m": 2.0}
    problem = crossing(simulation1, 6, limits=limits, no_fly=[disk], terrain={"ripple": None, "mountains": HILLS})
    start = problem.shape.at(0.0)
    there = start + random.normal(size=start.shape) * [3.0, 3.0, 1.0]
    there[problem.leader] = 0.0
    shape = joined([rigid(start, 0.0, 6.0), stretched(straight_leg(start, there), 6.0, 14.0), rigid(there, 14.0, 25.0)])
    complaints, brute = found(problem, shape), everything(problem, straight(problem), shape)
    assert set(complaints) == set(brute)
    assert len(brute) >= 3
    for name, least in brute.items():
        assert float(complaints[name].split("violated by ")[1].split()[0]) == pytest.approx(-least, rel=6e-3)


@pytest.mark.parametrize("count", [5, 60])
@pytest.mark.parametrize("at_s", [12.01, 12.026, 12.04])
def test_a_wall_that_is_crossed_between_two_samples_is_found(simulation1: Scenario, count: int, at_s: float) -> None:
    """A wall 4 cm thick across the whole box: samples stand 0.2 m apart."""
    north = float(track(crossing(simulation1, count), 0, at_s)[0])
    wall = {"polygon_m": [[north, -60.0], [north + 0.04, -60.0], [north + 0.04, 60.0], [north, 60.0]]}
    problem = crossing(simulation1, count, no_fly=[wall])
    assert set(found(problem)) == {"no-fly zone 1"}


@pytest.mark.parametrize("count", [1, 60])
def test_a_peak_between_two_samples_is_found_to_its_full_height(simulation1: Scenario, count: int) -> None:
    """A needle of ground, 2 mm too high and passed half way between two samples."""
    level = crossing(simulation1, count)
    north, east, _ = track(level, 0, 12.025)
    least_m = level.scenario.limits.clearance_min_m
    needle = {"north_m": [float(north)], "east_m": [float(east)], "height_m": [5.002 - least_m]}
    needle |= {"spread_north_m": [0.15], "spread_east_m": [3.0]}
    problem = crossing(simulation1, count, terrain={"ripple": None, "mountains": needle})
    by_m = float(found(problem)["clearance above ground"].split("by ")[1].split(" m")[0])
    assert by_m == pytest.approx(0.002, abs=5e-5)


def test_controls_of_followers_are_found_and_tighten_the_leaders_bounds(simulation1: Scenario) -> None:
    """A vehicle that changes its place fast needs moments that the leader does not; the next round leaves room."""
    problem = crossing(simulation1, 5, limits={"accel_max_mps2": 30.0, "load_factor_max": 3.0})
    for seconds in np.arange(6.0, 1.0, -0.1):
        shape = one_goes_elsewhere(problem, 2, (0.0, 3.0, 0.0), float(seconds))
        missed = find_violations(problem, straight(problem), shape)
        if any(miss.constraint.kind is Kind.U2 and miss.share > 0.05 for miss in missed):
            break
    worst = max(miss.by for miss in missed if miss.constraint.kind is Kind.U2)
    # Its peak is where the motion begins, and differences smooth it.
    assert everything(problem, straight(problem), shape, 0.002)["control U2"] == pytest.approx(-worst, rel=0.2)
    tighter = replace(problem, tightenings=tightenings(problem, missed))
    times = np.array([5.0, next(miss.t_s for miss in missed if miss.constraint.kind is Kind.U2), 20.0])
    before, after = (leader_control_bounds(p, times)[1][:, 1] for p in (problem, replace(tighter, shape=problem.shape)))
    assert after[1] < before[1]
    np.testing.assert_array_equal(after[[0, 2]], before[[0, 2]])


# A violation by 0.1 in its unit, 0.06 of it beyond the leader's own; the column and the bound's size that prevent it.
BOUNDS: list[tuple[Kind, str, int | None, float]] = [
    (Kind.ROLL, "deg", 6, np.radians(0.072)),
    (Kind.PITCH, "deg", 7, np.radians(0.072)),
    (Kind.ROLL_RATE, "deg/s", 9, np.radians(0.072)),
    (Kind.PITCH_RATE, "deg/s", 10, np.radians(0.072)),
    (Kind.U1, "N", 12, 0.072),
    (Kind.U2, "N", 13, 0.072),
    (Kind.U3, "N", 14, 0.072),
    (Kind.U4, "N m", 15, 0.072),
    (Kind.YAW, "deg", None, 0.0),
    (Kind.NORTH_SPEED, "m/s", None, 0.0),
    (Kind.ACCELERATION, "m/s2", None, 0.0),
]


@pytest.mark.parametrize(("kind", "unit", "column", "by"), BOUNDS, ids=[row[0].value for row in BOUNDS])
def test_a_followers_violation_tightens_the_leaders_bound_by_a_fifth_more_and_a_second_longer(
    simulation1: Scenario, kind: Kind, unit: str, column: int | None, by: float
) -> None:
    problem = crossing(simulation1, 5)
    missed = Violation(ConstraintId(kind), unit, 6.0, 0.1, 0.01, 9.0, (5.0, 8.0), beyond_leader=0.06)
    made = tightenings(problem, (missed,))
    assert len(made) == (column is not None)
    for tighter in made:
        assert (tighter.column, tighter.start_s, tighter.end_s) == (column, 4.0, 9.0)
        assert tighter.by == pytest.approx(by)
    assert tightenings(problem, (replace(missed, beyond_leader=0.0),)) == ()  # the program's own bounds prevent it
    uneven = crossing(simulation1, 5, wind=SHEAR)
    uneven = replace(uneven, shape=rigid(np.arange(15.0).reshape(5, 3), 0.0, 25.0))
    assert len(tightenings(uneven, (missed,))) == (column in (9, 10, 13, 14, 15))


def test_rotors_that_are_too_slow_tighten_all_controls_by_a_share_of_their_limits(simulation1: Scenario) -> None:
    problem = crossing(simulation1, 5)
    missed = Violation(ConstraintId(Kind.ROTOR_SPEED), "of a control's limit", 6.0, 0.1, 0.1, 9.0, (5.0, 8.0))
    made = tightenings(problem, (missed,))
    assert [(tighter.column, tighter.start_s, tighter.end_s) for tighter in made] == [
        (column, 4.0, 9.0) for column in (12, 13, 14, 15)
    ]
    np.testing.assert_allclose([tighter.by for tighter in made], 0.12 * control_bounds(problem.scenario)[1])


def test_reserves_are_a_fifth_more_than_the_largest_that_was_missing() -> None:
    many = [
        Violation(ConstraintId(kind), "", 1.0, by, 0.1, 9.0, beyond_leader=beyond)
        for kind, by, beyond in (
            (Kind.ACCELERATION, 0.9, 0.2),
            (Kind.ACCELERATION, 0.3, 0.3),
            (Kind.JERK, 0.4, 0.0),
            (Kind.JERK, 0.5, 0.0),
            (Kind.PITCH, 7.0, 7.0),
        )
    ]
    assert accel_reserve_mps2(tuple(many)) == pytest.approx(0.36)
    assert jerk_reserve_mps3(tuple(many)) == pytest.approx(0.6)
    assert accel_reserve_mps2(tuple(many[2:])) == jerk_reserve_mps3(tuple(many[:2])) == 0.0


def test_a_turning_limit_that_is_missed_again_and_again_becomes_a_little_tighter(simulation1: Scenario) -> None:
    def missed(by: float, kind: Kind = Kind.TURNING) -> tuple[Violation, ...]:
        return (Violation(ConstraintId(kind), "g", 7.0, by, 0.1, 3.0),)

    once_g = turning_reserve_g(simulation1, 0.0, missed(0.003) + missed(0.002))
    assert once_g == pytest.approx(0.0036)
    assert turning_reserve_g(simulation1, once_g, missed(0.001)) == pytest.approx(0.0048)
    assert turning_reserve_g(simulation1, once_g, missed(5.0, Kind.ROLL)) == once_g
    most_g = 0.2 * simulation1.limits.load_factor_max
    assert turning_reserve_g(simulation1, once_g, missed(1.0)) == pytest.approx(most_g)


def test_the_program_keeps_the_turning_reserve(simulation1: Scenario) -> None:
    """At 2 m/s, turned by its roll: the row is 1 - (load factor / limit)^2."""
    problem = flight_problem(simulation1)
    z = np.array([0.0, 0.0, -20.0, 2.0, 0.0, 0.0, 0.1, 0.0, 0.0, 0.0, 0.0, 0.0, 15.0, 0.0, 0.0, 0.0])

    def row(reserve_g: float) -> float:
        path = functions(replace(problem, turning_reserve_g=reserve_g)).path
        return float(path(z, np.zeros(path.size1_in(1)))[-1])

    most = simulation1.limits.load_factor_max
    assert (1.0 - row(0.02)) / (1.0 - row(0.0)) == pytest.approx((most / (most - 0.02)) ** 2)


def test_of_each_constraint_the_worst_violation_is_told_and_none_that_is_tolerated() -> None:
    def one(kind: Kind, by: float, tolerated: float) -> Violation:
        return Violation(ConstraintId(kind), "m", 3.0, by, 0.1, tolerated)

    many = (
        one(Kind.ROLL, 2.0, 1.5),
        one(Kind.PITCH, 0.5, 0.99),
        one(Kind.ROLL, 1.0, 2.5),
        one(Kind.ROLL, 3.0, 2.0),
        one(Kind.YAW, 4.0, 1.01),
    )
    assert complaints_of(many) == ("roll violated by 1 m at t = 3.0 s", "yaw violated by 4 m at t = 3.0 s")


def test_a_violation_has_its_period_its_share_and_what_is_beyond_the_leader(simulation1: Scenario) -> None:
    """The leader climbs and sinks through a ceiling of 7 m, to 8 m; one vehicle flies half a metre higher."""
    problem = crossing(simulation1, 3, limits={"height_m": [0.0, 7.0]})
    places = problem.shape.at(0.0)
    places[2, 2] = -0.5
    flat = straight(problem)
    joints = np.array([0.0, 10.0, 15.0, 25.0])
    state = np.concatenate([np.zeros((1, 3, 12)), np.stack([flat.state(joints[:-1], nu=1), flat.state(joints[:-1])])])
    state[:, :, 2] = np.transpose([[0.0, 0.0, -5.0], [3.0 / 6.25, -3.0 / 6.25 * 5.0, -5.0], [0.0, 0.0, -5.0]])
    bump = Trajectory(PPoly(state, joints), PPoly(np.repeat(flat.control.c, 3, axis=1), joints))
    (miss,) = [m for m in find_violations(problem, bump, rigid(places, 0.0, 25.0)) if m.constraint.kind is Kind.HEIGHT]
    # 5 + 3 (1 - (t - 12.5)^2 / 6.25): at 12.5 s 8 m, and more than 6.5 m for 1.77 s before and after
    assert (miss.t_s, miss.by, miss.unit) == (pytest.approx(12.5), pytest.approx(1.5), "m")
    assert miss.beyond_leader == pytest.approx(0.5)
    assert miss.share == pytest.approx(1.5 / 7.0)
    assert miss.tolerated == pytest.approx(1.5 / TOLERANCE_M)
    assert miss.by_si == miss.by
    half_s = float(np.sqrt(6.25 * 0.5))
    np.testing.assert_allclose(miss.period_s, [12.5 - half_s, 12.5 + half_s], atol=0.05)


def test_the_jerk_of_all_is_looked_at_where_it_is_limited(simulation1: Scenario) -> None:
    """One metre of 35 s^4 - 84 s^5 + 70 s^6 - 20 s^7 has 52.5 at the middle, over the time cubed."""
    limits = {"accel_max_mps2": 30.0, "load_factor_max": 3.0, "jerk_max_mps3": 8.0}
    problem = crossing(simulation1, 5, limits=limits)
    for seconds, passes in ((6.0, True), (1.5, False)):
        shape = one_goes_elsewhere(problem, 3, (0.0, 0.0, -1.0), seconds)
        jerks = [m.by for m in find_violations(problem, straight(problem), shape) if m.constraint.kind is Kind.JERK]
        assert (not jerks) == passes
    assert max(jerks) == pytest.approx(52.5 / 1.5**3 - 8.0, rel=1e-4)  # and a little drag


def test_in_a_wind_that_grows_with_height_the_highest_of_many_is_looked_at(simulation1: Scenario) -> None:
    """It leans against more wind than the others: in a rigid shape nothing else tells it from them."""
    problem = crossing(simulation1, 60, wind=SHEAR)

    def pitch_over_deg(places: Array, most_deg: float) -> float:
        limits = {"roll_pitch_yaw_deg": [25.0, most_deg, 180.0]}
        shape = rigid(places, 0.0, 25.0)
        judged = replace(crossing(simulation1, 60, wind=SHEAR, limits=limits), shape=shape)
        return max(
            (m.by for m in find_violations(judged, straight(judged), shape) if m.constraint.kind is Kind.PITCH),
            default=0.0,
        )

    flat = problem.shape.at(0.0)
    flat[:, 2] = 0.0
    level_deg = 0.1 + pitch_over_deg(flat, 0.1)
    for vehicle in (7, 43):
        lifted = flat.copy()
        lifted[vehicle, 2] = -15.0
        assert pitch_over_deg(lifted, level_deg + 0.1) > 0.1


def test_the_worst_instant_of_every_stretch_is_named(simulation1: Scenario) -> None:
    """Two hills, one after the other: two instants, each over a summit."""
    problem = crossing(simulation1, 1, terrain={"ripple": None, "mountains": {**HILLS, "east_m": [0.0, 0.0]}})
    found = find_violations(problem, straight(problem), problem.shape)
    instants, complaints = np.array(sorted({miss.t_s for miss in found})), complaints_of(found)
    np.testing.assert_allclose(instants, [10.0, 18.75], atol=0.06)
    assert len(complaints) == 1
    assert "violated by 2 m at t = 10.0 s" in complaints[0]


@pytest.mark.parametrize("count", [5, 60])
def test_a_coordinate_beyond_its_range_is_found(simulation1: Scenario, count: int) -> None:
    scenario = fleet(simulation1, count, "row", (auto(SHRINK),), BLOCK, **FLIGHT)
    problem = flight_problem(scenario)

    def at_scale(value: float) -> Trajectory:
        flat = straight(replace(problem, coordinates=()))
        state = np.concatenate([flat.state.c, np.zeros((2, 1, 4))], axis=2)
        state[-1, 0, 12] = value
        control = np.concatenate([flat.control.c, np.zeros((1, 1, 1))], axis=2)
        return Trajectory(PPoly(state, flat.joints_s), PPoly(control, flat.joints_s))

    assert found(problem, trajectory=at_scale(0.5)) == {}
    assert set(found(problem, trajectory=at_scale(0.499))) == {"scale"}
    assert set(found(problem, trajectory=at_scale(1.03))) == {"scale"}


def turning(problem: Problem, lag_deg: float, speed_mps: float) -> Trajectory:
    """North-east at one speed, the heading of the formation behind by so much."""
    flat = straight(replace(problem, coordinates=()))
    state = np.concatenate([flat.state.c, np.zeros((2, 1, 4))], axis=2)
    state[-1, 0, 3:5] = speed_mps * np.sqrt(0.5)
    state[-1, 0, 12] = np.radians(45.0 - lag_deg)
    control = np.concatenate([flat.control.c, np.zeros((1, 1, 1))], axis=2)
    return Trajectory(PPoly(state, flat.joints_s), PPoly(control, flat.joints_s))


@pytest.mark.parametrize(
    ("lag_deg", "speed_mps", "complains"), [(4.99, 2.0, False), (5.1, 2.0, True), (-5.1, 2.0, True), (90.0, 0.9, False)]
)
def test_a_formation_that_faces_away_from_its_course_is_found(
    simulation1: Scenario, lag_deg: float, speed_mps: float, complains: bool
) -> None:

    problem = flight_problem(fleet(simulation1, 5, "row", (), BLOCK, **FLIGHT, formation={"frame": "course"}))
    complaints = found(problem, trajectory=turning(problem, lag_deg, speed_mps))
    assert ("heading along the course" in complaints) == complains


def test_a_coordinate_leaves_its_range_by_a_share_of_it_without_complaint(simulation1: Scenario) -> None:
    """The tolerance is half of the verifier's 0.1 %: of a heading's range of 4 pi, that is 6 mrad."""
    problem = flight_problem(fleet(simulation1, 5, "row", (), BLOCK, **FLIGHT, formation={"frame": "course"}))
    (heading,) = problem.coordinates

    def complaints(share: float) -> set[str]:
        lag_deg = 45.0 - np.degrees(share * heading.high)
        return set(found(problem, trajectory=turning(problem, lag_deg, 0.9)))  # too slow to face along a course

    for side in (1.0, -1.0):
        assert complaints(side * 1.0004) == set()
        assert complaints(side * 1.0006) == {"heading"}
