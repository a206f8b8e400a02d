"""Energy of plans: hover in closed form, at the sea and in thin air, and real plans beside it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import PPoly

from gcs.physics.quadrotor import Quadrotor, air_density_kgpm3, drawn_power_W, induced_power_W
from gcs.plan.formation.shape import Shape
from gcs.plan.trajectory.energy import drag_energy_J, energy_Wh
from gcs.plan.trajectory.phases import Phase
from gcs.plan.trajectory.plan import Plan
from gcs.plan.trajectory.trajectory import Trajectory
from gcs.scenario.schema.scenario import Power

POWER = Power(battery_Wh=80.0, rotor_radius_m=0.04, figure_of_merit=0.6)
HOVER_S = 600.0


def hover_W(q: Quadrotor, density: float) -> float:
    """Four rotors with a quarter of the weight each: W^(3/2) / (2 sqrt(2 rho pi r^2)) over the figure of merit."""
    return q.weight_N**1.5 / (2.0 * np.sqrt(2.0 * density * np.pi * POWER.rotor_radius_m**2)) / POWER.figure_of_merit


def described(plan: Plan, alt_amsl_m: float = 0.0) -> Plan:
    scenario = plan.scenario
    vehicle = scenario.vehicle.model_copy(update={"power": POWER})
    origin = scenario.origin.model_copy(update={"alt_amsl_m": alt_amsl_m})
    return replace(plan, scenario=scenario.model_copy(update={"vehicle": vehicle, "origin": origin}))


def hovering(plan: Plan, alt_amsl_m: float) -> Plan:
    """All of the plan's vehicles over their places, at height 0, for ten minutes."""
    joints = np.array([0.0, HOVER_S])
    thrust = np.array([plan.quadrotor.weight_N, 0.0, 0.0, 0.0])
    motion = Trajectory(PPoly(np.zeros((1, 1, 12)), joints), PPoly(thrust.reshape(1, 1, 4), joints))
    places = plan.offsets(np.zeros(1))[:, 0] * np.array([1.0, 1.0, 0.0])
    still = Shape(PPoly(np.ones((1, 1, 1)), joints), places[None])
    level = replace(plan, leader_trajectory=motion, shape=still, phases=(Phase("mission", 0.0, HOVER_S),))
    return described(level, alt_amsl_m)


@pytest.mark.parametrize(("alt_amsl_m", "density"), [(0.0, 1.225), (3000.0, 0.9093), (5000.0, 0.7361)])
def test_hover_is_momentum_theory(simulation1_plan: Plan, alt_amsl_m: float, density: float) -> None:
    assert float(air_density_kgpm3(alt_amsl_m)) == pytest.approx(density, rel=2e-4)  # the tables of ISO 2533
    plan = hovering(simulation1_plan, alt_amsl_m)
    found = energy_Wh(plan)
    assert found is not None
    assert found.shape == (6,)
    assert found == pytest.approx(hover_W(plan.quadrotor, density) * HOVER_S / 3600.0, rel=2e-4)


def test_a_rotor_moves_air() -> None:
    """T v with v the solution of T = 2 rho A v^2."""
    thrust_N, radius_m = 5.0, 0.1
    disk_m2 = np.pi * radius_m**2
    air_mps = np.sqrt(thrust_N / (2.0 * 1.225 * disk_m2))
    assert float(induced_power_W(thrust_N, radius_m)) == pytest.approx(thrust_N * air_mps, rel=1e-12)


def test_turning_takes_more_than_hovering(simulation1_plan: Plan) -> None:
    """Power is convex in thrust: the same sum of thrusts costs least where all rotors share it."""
    q = simulation1_plan.quadrotor
    even, uneven = (np.array([q.weight_N, roll, 0.0, 0.0]) for roll in (0.0, 0.05))
    assert drawn_power_W(uneven, q, 0.04, 0.6) > drawn_power_W(even, q, 0.04, 0.6)


def test_a_real_plan_takes_a_little_more_than_hovering_as_long(simulation1_plan: Plan) -> None:
    plan = described(simulation1_plan)
    found = energy_Wh(plan)
    assert found is not None
    hover_Wh = hover_W(plan.quadrotor, 1.225) * (plan.t_end_s - plan.t_start_s) / 3600.0
    assert (found > hover_Wh).all()
    assert (found < 1.05 * hover_Wh).all()


def test_energy_against_drag_is_that_of_each_vehicle(simulation1_plan: Plan) -> None:
    """Eq. 32 by differences of places; vehicles that drift apart have different energies."""
    plan, k_f = simulation1_plan, simulation1_plan.scenario.objective.drag_power_Ns2pm2
    joints = np.array([0.0, plan.flight_s])
    functions = np.array([[[1.0 / plan.flight_s]], [[1.0]]])  # twice as far at the end
    spread = replace(plan, shape=Shape(PPoly(functions, joints), 20.0 * plan.offsets(np.zeros(1))[None, :, 0]))
    for flown in (plan, spread):
        t_s = np.linspace(0.0, plan.flight_s - 1e-6, 20001)
        places = flown.states(t_s)[..., :3]
        speed = np.linalg.norm(np.diff(places, axis=1), axis=2) / np.diff(t_s)
        expected = k_f * (speed**3).mean(axis=1) * plan.flight_s
        np.testing.assert_allclose(drag_energy_J(flown), expected, rtol=1e-3)
    assert np.ptp(drag_energy_J(plan)) == pytest.approx(0.0, abs=1e-6)
    assert np.ptp(drag_energy_J(spread)) > 1.0


def test_nobody_guesses_where_the_scenario_says_nothing(simulation1_plan: Plan) -> None:
    scenario = simulation1_plan.scenario
    vehicle = scenario.vehicle.model_copy(update={"power": None})
    plan = replace(simulation1_plan, scenario=scenario.model_copy(update={"vehicle": vehicle}))
    assert energy_Wh(plan) is None
    assert "power" not in plan.scenario.vehicle.model_dump()  # plans made before keep their hash
