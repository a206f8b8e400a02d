"""Plans in wind: hovers lean against it, drag follows the air, and wind that is too strong is refused before."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import root

from gcs.errors import PlanningError, ScenarioError
from gcs.physics.quadrotor import derivative, hover_trim
from gcs.physics.wind import SteadyWind
from gcs.plan.ocp import stage_functions
from gcs.plan.ocp.active_vehicles import active_vehicles
from gcs.plan.ocp.problem import flight_problem
from gcs.plan.planner import make_plan
from gcs.plan.trajectory.ground_phases import vertical
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.verify import verify
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.sources.load import load_scenario
from gcs.scenario.values.si import quadrotor, steady_wind
from gcs.types import Array
from tests.unit.plan.problems import changed, meadow

ROOM = {"north_m": [-20.0, 80.0], "east_m": [-40.0, 60.0]}
BREEZE = {"speed_mps": 2.5, "from_deg": 300.0, "shear": 0.2}


def in_wind(scenario: Scenario, wind: dict[str, Any], **tables: Any) -> Scenario:
    slowly = {"takeoff_s": 12.0, "hover_s": 2.3, "landing_s": 15.0}  # an F150 has hardly any thrust to spare
    return meadow(scenario, limits=ROOM, wind=wind, ground_phases=slowly, **tables)


@pytest.fixture(scope="module")
def breezy(simulation1: Scenario) -> Plan:
    return make_plan(in_wind(simulation1, BREEZE))


def test_wind_comes_from_where_it_is_said(simulation1: Scenario) -> None:
    wind = steady_wind(in_wind(simulation1, {"speed_mps": 3.0, "from_deg": 270.0}))
    assert wind.at(50.0) == pytest.approx((0.0, 3.0, 0.0), abs=1e-12)


@given(st.floats(-3.0, 120.0), st.floats(0.05, 1.0))
def test_shear_is_the_power_law_with_its_own_derivatives(height_m: float, exponent: float) -> None:
    wind, step = SteadyWind(3.0, 4.0, 10.0, exponent), 1e-4
    value, slope, bend = wind.shares(height_m)
    if height_m > 20.0:
        assert value == pytest.approx((height_m / 10.0) ** exponent, rel=1e-3)
    low, high = wind.share(height_m - step), wind.share(height_m + step)
    assert slope == pytest.approx((high - low) / (2.0 * step), rel=1e-4, abs=1e-8)
    assert bend == pytest.approx((high - 2.0 * value + low) / step**2, rel=1e-2, abs=1e-5)


def test_a_hover_in_wind_stays_where_it_is(simulation1: Scenario) -> None:
    vehicle = quadrotor(in_wind(simulation1, BREEZE))
    thrust, roll, pitch = hover_trim(7.0, 0.4, vehicle)
    state = np.array([1.0, 2.0, -7.0, 0.0, 0.0, 0.0, roll, pitch, 0.4, 0.0, 0.0, 0.0])
    assert derivative(state, np.array([thrust, 0.0, 0.0, 0.0]), vehicle) == pytest.approx(np.zeros(12), abs=1e-12)


def test_straight_up_in_wind_solves_eq_1(simulation1: Scenario) -> None:
    vehicle = quadrotor(in_wind(simulation1, BREEZE))
    up = vertical(3.0, 9.0, np.array([1.0, 2.0, -0.2]), -8.0, 0.7, vehicle)
    times = np.linspace(3.0, 9.0, 500)[:-1]
    moved = derivative(up.state(times), up.control(times), vehicle)
    assert moved == pytest.approx(up.state(times, nu=1), abs=1e-6)
    ends = up.state(np.array([3.0, np.nextafter(9.0, 0.0)]))
    assert ends[:, 3:6] == pytest.approx(np.zeros((2, 3)), abs=1e-9)
    assert ends[:, 9:] == pytest.approx(np.zeros((2, 3)), abs=1e-6)


def test_a_plan_in_wind_holds_and_one_for_still_air_does_not(breezy: Plan, simulation1: Scenario) -> None:
    report = verify(breezy)
    assert report.ok, report.failures
    still = make_plan(breezy.scenario.model_copy(update={"wind": None}))
    failed = {check.name for check in verify(replace(still, scenario=breezy.scenario)).failures}
    assert "Eq. 1 re-integrated over 5 s" in failed


@pytest.mark.slow
def test_who_flies_higher_leans_more_against_more_wind(breezy: Plan) -> None:
    """Every vehicle is integrated by Eq. 1 in its own wind, to millimetres."""
    apart = changed(
        breezy.scenario,
        formation={
            "vehicle": [
                vehicle.model_dump() | {"position_m": [*vehicle.position_m[:2], 3.0 + (vehicle.sysid > 3) * 2.0]}
                for vehicle in breezy.scenario.formation.vehicle
            ]
        },
    )
    plan = make_plan(apart)
    assert verify(plan).ok, verify(plan).failures
    lean = np.hypot(*plan.states(np.array([-1.0]))[:, 0, 6:8].T)
    low, high = lean[:3], lean[3:]
    assert np.all(high > 1.02 * low.max())


def test_energy_is_spent_against_the_air(simulation1: Scenario) -> None:
    """The same way costs more into the wind than with it."""
    costs = [
        make_plan(in_wind(simulation1, {"speed_mps": 1.0, "from_deg": from_deg})).objective
        for from_deg in (20.0, 200.0)
    ]
    assert costs[0] > 1.5 * costs[1]


@pytest.mark.long
def test_wind_can_close_the_straight_way(simulation1: Scenario) -> None:
    """At 2.4 m/s north the vehicle has no tilt left for 4 m/s of wind on its nose; in still air it has."""
    short = {"time": {"flight_s": 20.0}}
    tight = {**ROOM, "roll_pitch_yaw_deg": [5.0, 5.0, 60.0]}
    calm = meadow(simulation1, limits=tight, **short)
    assert verify(make_plan(calm)).ok
    with pytest.raises(PlanningError):
        make_plan(changed(calm, wind={"speed_mps": 4.0, "from_deg": 0.0}))


def test_wind_stronger_than_the_vehicle_is_refused_in_a_sentence(tmp_path: Path, repo_root: Path) -> None:
    text = (repo_root / "missions" / "field" / "scenario.toml").read_text()
    storm = "\n[wind]\nspeed_mps = 30.0\nfrom_deg = 90.0\nshear = 0.3\n"
    (tmp_path / "scenario.toml").write_text(text + storm)
    told = r"wind.speed_mps = 30.0: too strong: to hover at 40 m the vehicle tilts by 34.\d degrees"
    with pytest.raises(ScenarioError, match=told):
        load_scenario(tmp_path)


def in_shear(repo_root: Path) -> Scenario:
    """The first 200 m of the bundled field, with vehicles up to 8 m above the leader, into a wind that leaves it little
    tilt."""
    return changed(
        load_scenario(repo_root / "missions" / "field"),
        wind={"speed_mps": 8.0, "from_deg": 0.0, "shear": 0.4},
        ground_phases={"takeoff_s": 60.0, "landing_s": 90.0},
        no_fly=[],
        time={"flight_s": 62.0},
        end={"position_m": [200.0, 0.0, 25.0]},
    )


@pytest.fixture(scope="module")
def sheared(repo_root: Path) -> Plan:
    return make_plan(in_shear(repo_root))


def flown_by_hand(plan: Plan, vehicle: int, t_s: float) -> tuple[float, float]:
    """Roll and pitch, deg, that fly a vehicle's motion, from the leader's place, velocity and yaw and the offset."""
    step = 0.02
    leader = plan.leader_trajectory.state(t_s + step * np.array([-1.0, 0.0, 1.0]))
    acceleration = (leader[2, 3:6] - leader[0, 3:6]) / (2.0 * step)
    height_m = -float(leader[1, 2] + plan.offsets(np.array([t_s]))[vehicle, 0, 2])
    return tilt_by_hand(plan.scenario, height_m, leader[1, 3:6], acceleration, float(leader[1, 8]))[1:]


def tilt_by_hand(
    scenario: Scenario, height_m: float, speed: Array, acceleration: Array, yaw: float
) -> tuple[float, float, float]:
    """Thrust in N, roll and pitch in deg that fly a motion in the wind at its height: Eq. 1 solved by a root finder."""
    body, wind = scenario.vehicle, scenario.wind
    assert wind is not None
    toward = np.radians(wind.from_deg + 180.0)
    smooth_m = 0.5 * (height_m + np.hypot(height_m, 1.0))  # the power law, without its infinite slope at the ground
    air = wind.speed_mps * (smooth_m / wind.height_m) ** wind.shear * np.array([np.cos(toward), np.sin(toward), 0.0])

    def unbalanced(unknown: Array) -> Array:
        thrust, roll, pitch = unknown
        lift = np.array(
            [
                np.cos(yaw) * np.sin(pitch) * np.cos(roll) + np.sin(yaw) * np.sin(roll),
                np.sin(yaw) * np.sin(pitch) * np.cos(roll) - np.cos(yaw) * np.sin(roll),
                np.cos(pitch) * np.cos(roll),
            ]
        )
        drag = np.array(body.drag_Nspm) * (speed - air)
        weight = np.array([0.0, 0.0, body.mass_kg * body.gravity_mps2])
        return np.asarray(weight - thrust * lift - drag - body.mass_kg * acceleration)

    found = root(unbalanced, [body.mass_kg * body.gravity_mps2, 0.0, 0.0], tol=1e-12)
    assert found.success
    return float(found.x[0]), float(np.degrees(found.x[1])), float(np.degrees(found.x[2]))


def test_the_program_limits_tilt_and_thrust_of_the_highest_and_the_lowest_vehicle(repo_root: Path) -> None:
    """Each constraint is zero exactly where Eq. 1, solved by hand at the vehicle's own height, is at its limit."""
    scenario = in_shear(repo_root)
    problem = flight_problem(scenario)
    random = np.random.default_rng(3)
    times = np.array([20.0])
    for _ in range(10):
        z = np.zeros(16)
        z[:3], z[3:6] = random.uniform([20.0, -5.0, -20.0], [90.0, 5.0, -12.0]), random.uniform(-3.0, 3.0, 3)
        z[6:9], z[12] = random.uniform(-0.4, 0.4, 3), random.uniform(15.0, 30.0)
        chosen = active_vehicles(problem, times, z[None, :12])
        counts = chosen.ground.shape[1], max(rows.shape[1] for rows in (*chosen.zones, chosen.moving[:, :0]))
        path = stage_functions.functions(problem, *counts, chosen.moving.shape[1]).path
        values = np.array(path(z, chosen.parameters[0])).ravel()
        found = dict(zip(map(str, stage_functions.path_ids(problem, chosen)[0]), values, strict=True))
        free = dict(zip(found, stage_functions.path_is_free(problem, chosen)[0], strict=True))
        acceleration = derivative(z[:12], z[12:], problem.quadrotor)[3:6]
        for vehicle in (0, 2):  # the leader is among the lowest, vehicle 3 among the highest
            height_m = -(z[2] + problem.shape.at(20.0)[vehicle, 2])
            thrust, roll, pitch = tilt_by_hand(scenario, height_m, z[3:6], acceleration, z[8])
            who, weight = f" of vehicle {vehicle + 1}", problem.quadrotor.weight_N
            if vehicle:
                assert not any(free[name + who] for name in ("roll", "pitch", "least thrust", "largest thrust"))
            low, high = scenario.limits.thrust_N
            share = np.sin(np.radians(roll)) / np.sin(np.radians(25.0))
            assert found[f"roll{who}"] == pytest.approx((thrust / weight) ** 2 * (1.0 - share**2), rel=1e-6)
            down = thrust * np.cos(np.radians(roll)) * np.cos(np.radians(pitch)) / weight
            share = np.tan(np.radians(pitch)) / np.tan(np.radians(25.0))
            assert found[f"pitch{who}"] == pytest.approx(down**2 * (1.0 - share**2), rel=1e-6)
            assert found[f"least thrust{who}"] == pytest.approx((thrust**2 - low**2) / weight**2)
            assert found[f"largest thrust{who}"] == pytest.approx((high**2 - thrust**2) / weight**2)


@pytest.mark.long
def test_no_vehicle_of_a_rigid_formation_leans_beyond_its_limit_in_sheared_wind(sheared: Plan) -> None:
    """Every vehicle by Eq. 1 in the wind at its own height, with the code's own followers left out."""
    most_deg = sheared.scenario.limits.roll_pitch_yaw_deg[:2]
    mission = sheared.phase("mission")
    steepest = np.zeros((len(sheared.sysids), 2))
    for t_s in np.concatenate(
        [np.linspace(mission.start_s + 0.1, 6.0, 60), np.linspace(6.0, mission.end_s - 0.1, 150)]
    ):
        for vehicle in range(len(sheared.sysids)):
            tilt = np.abs(flown_by_hand(sheared, vehicle, float(t_s)))
            steepest[vehicle] = np.maximum(steepest[vehicle], tilt)
    assert np.all(steepest <= 1.001 * np.array(most_deg)), steepest
    # The limit binds, and those above the leader reach it first.
    assert steepest[:, 1].max() > 0.98 * most_deg[1]
    assert steepest[2, 1] > steepest[0, 1] + 0.5
    report = verify(sheared)
    assert report.ok, report.failures


@pytest.mark.long
def test_verification_sees_a_higher_vehicle_that_leans_too_far(sheared: Plan) -> None:
    """The same motion under a limit that the leader keeps and the highest vehicles do not."""
    times = np.linspace(0.0, sheared.flight_s, 20_000)[:-1]
    leader_deg = float(np.degrees(np.abs(sheared.leader_trajectory.state(times)[:, 7])).max())
    limits = sheared.scenario.limits
    tight = limits.model_copy(update={"roll_pitch_yaw_deg": (limits.roll_pitch_yaw_deg[0], leader_deg + 0.3, 180.0)})
    report = verify(replace(sheared, scenario=sheared.scenario.model_copy(update={"limits": tight})))
    assert {"pitch"} == {check.name for check in report.failures}
    assert {check.sysid for check in report.failures} <= {3, 4}
