"""Plans in wind: hovers lean against it, drag follows the air, and wind that is too strong is refused before."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs.errors import PlanningError, ScenarioError
from gcs.physics.quadrotor import derivative, hover_trim
from gcs.physics.wind import SteadyWind
from gcs.plan.planner import make_plan
from gcs.plan.trajectory.ground_phases import vertical
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.verify import verify
from gcs.scenario.load import load_scenario
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.si import quadrotor, steady_wind
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
