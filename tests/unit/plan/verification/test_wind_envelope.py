"""The winds in which a plan can be flown: closed forms of a hover, and winds inside and outside against Eq. 1."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import PPoly

from gcs.physics.quadrotor import thrust_and_tilt
from gcs.physics.states import ATTITUDE, POSITION, VELOCITY
from gcs.plan.formation.shape import rigid
from gcs.plan.planner import make_plan
from gcs.plan.trajectory.energy import ChargeInWind, charge_needed
from gcs.plan.trajectory.plan import Plan
from gcs.plan.trajectory.trajectory import Trajectory
from gcs.plan.verification.constraints.wind_limits import WindLimits, wind_directions
from gcs.plan.verification.proof.polynomials import enclosed
from gcs.plan.verification.proof.subdivision import plain_cells
from gcs.plan.verification.proof.vehicle_tree import vehicle_tree
from gcs.plan.verification.proof.verdict import LIMIT_TOLERANCE
from gcs.plan.verification.wind_envelope import BATTERY, POSITION_ERROR, wind_envelope
from gcs.scenario.schema.scenario import Scenario
from gcs.types import Array
from tests.unit.plan.formations import Planned
from tests.unit.plan.problems import changed
from tests.unit.plan.test_wind import BREEZE, in_wind

NEVER = {"thrust_N": [0.0, 1000.0], "roll_pitch_yaw_deg": [30.0, 20.0, 180.0]}


@pytest.fixture(scope="module")
def sheared(simulation1: Scenario) -> Plan:
    return make_plan(in_wind(simulation1, BREEZE))


def hovering(plan: Plan, yaw_rad: float = 0.0, **tables: Any) -> Plan:
    """A hover of all vehicles for as long as the plan, in still air."""
    joints = np.array([plan.t_start_s, plan.t_end_s])
    state, control = np.zeros((1, 1, 12)), np.zeros((1, 1, 4))
    state[0, 0, :3] = 2.0, 1.0, -20.0
    state[0, 0, 8] = yaw_rad
    control[0, 0, 0] = plan.quadrotor.weight_N
    still = rigid(plan.shape.at(0.0), plan.t_start_s, plan.t_end_s)
    scenario = changed(plan.scenario, **tables)
    return replace(
        plan, scenario=scenario, leader_trajectory=Trajectory(PPoly(state, joints), PPoly(control, joints)), shape=still
    )


def test_hover_leans_by_its_drag_over_its_weight(meadow_plan: Plan) -> None:
    envelope = wind_envelope(hovering(meadow_plan, limits=NEVER))
    q = meadow_plan.quadrotor
    for border, most_deg, limit in ((envelope.borders[0], 20.0, "pitch"), (envelope.borders[6], 30.0, "roll")):
        expected = q.weight_N * np.tan(np.radians(most_deg * (1.0 + LIMIT_TOLERANCE))) / q.drag_Nspm[0]
        expected = min(expected, 30.0)
        assert border.speed_mps == pytest.approx(expected, rel=1e-9)
        assert border.limit == (limit if expected < 30.0 else None)


@pytest.mark.parametrize("yaw_deg", [45.0, -120.0])
def test_pitch_and_roll_are_those_of_the_heading(meadow_plan: Plan, yaw_deg: float) -> None:
    limits = {"thrust_N": [0.0, 1000.0], "roll_pitch_yaw_deg": [8.0, 6.0, 180.0]}
    envelope, q = wind_envelope(hovering(meadow_plan, np.radians(yaw_deg), limits=limits)), meadow_plan.quadrotor
    for turn_deg, most_deg, limit in ((0.0, 6.0, "pitch"), (90.0, 8.0, "roll"), (180.0, 6.0, "pitch")):
        border = envelope.borders[round((yaw_deg + turn_deg) % 360.0 / 15.0)]
        expected = q.weight_N * np.tan(np.radians(most_deg * (1.0 + LIMIT_TOLERANCE))) / q.drag_Nspm[0]
        assert (border.speed_mps, border.limit) == (pytest.approx(expected, rel=1e-9), limit)


def test_force_is_that_of_each_vehicle_at_its_own_height_and_speed(sheared: Plan, planned: Planned) -> None:
    offsets_m = sheared.shape.at(0.0) + np.outer(np.arange(len(sheared.sysids)), [0.0, 0.0, -1.5])
    climbing = replace(sheared, shape=rigid(offsets_m - offsets_m[sheared.leader], sheared.t_start_s, sheared.t_end_s))
    for plan in (sheared, climbing, planned("reshape")[0]):
        tree = vehicle_tree(plan.shape)
        t_s = np.linspace(plan.t_start_s + 0.1, plan.t_end_s - 0.1, 200)
        t_s = t_s[np.abs(t_s[:, None] - plan.joints_s).min(axis=1) > 1e-3]
        for leaf in tree.leaves:
            cells = plain_cells(np.full((len(t_s), 1), leaf), t_s - 1e-4, t_s + 1e-4)
            x = enclosed(plan.leader_trajectory.state, cells.start_s, cells.end_s, 2)
            thrust = enclosed(plan.leader_trajectory.control, cells.start_s, cells.end_s, 2)[0]
            force, _ = WindLimits(plan, tree, wind_directions(4))._force(cells, x, thrust)
            wind = np.array([plan.quadrotor.wind.north_mps, plan.quadrotor.wind.east_mps])
            expected = effort(plan, t_s, wind)[0][tree.row[leaf]]
            np.testing.assert_allclose(np.linalg.norm([part.middle for part in force], axis=0), expected, rtol=1e-7)


def test_hover_has_the_thrust_for_its_weight_and_its_drag(meadow_plan: Plan) -> None:
    q, most_N = meadow_plan.quadrotor, 1.02 * meadow_plan.quadrotor.weight_N
    envelope = wind_envelope(hovering(meadow_plan, limits={**NEVER, "thrust_N": [0.0, most_N]}))
    expected = np.sqrt((most_N * (1.0 + LIMIT_TOLERANCE)) ** 2 - q.weight_N**2) / q.drag_Nspm[0]
    for border in envelope.borders:
        assert border.speed_mps == pytest.approx(expected, rel=1e-9)
        assert border.limit == "largest thrust"
    # A circle of 24 corners holds a disk that is smaller by the cosine of half the angle between two.
    assert envelope.wind_ok_mps == pytest.approx(expected * np.cos(np.pi / 24.0), rel=1e-9)


def test_hover_lasts_while_thrust_to_the_power_of_three_halves_does(meadow_plan: Plan) -> None:
    power = {"battery_Wh": 20.0, "rotor_radius_m": 0.06, "figure_of_merit": 0.6}
    hover = hovering(meadow_plan, limits=NEVER, vehicle={"power": power})
    needed = float(charge_needed(hover).max())
    assert ChargeInWind(hover).needed(np.zeros(2)).max() == pytest.approx(needed, rel=1e-12)
    hover = hovering(meadow_plan, limits=NEVER, vehicle={"power": power}, preflight={"reserve": 1.0 - 1.02 * needed})
    envelope, q = wind_envelope(hover), meadow_plan.quadrotor
    expected = q.weight_N * np.sqrt(1.02 ** (4.0 / 3.0) - 1.0) / q.drag_Nspm[0]
    assert envelope.knows_battery
    for border in envelope.borders:
        assert border.limit == BATTERY
        assert expected * 0.99 < border.speed_mps <= expected


def test_gusts_come_off_the_wind_and_are_bounded_by_the_position_error(meadow_plan: Plan) -> None:
    judge = {"position_rms_m": 100.0}
    most_N = 1.02 * meadow_plan.quadrotor.weight_N
    hover = hovering(meadow_plan, limits={**NEVER, "thrust_N": [0.0, most_N]}, judge=judge)
    steady, gusty = wind_envelope(hover), wind_envelope(hover, 0.5)
    assert gusty.wind_ok_mps == pytest.approx(steady.wind_ok_mps / 1.5, rel=1e-9)
    assert gusty.allows(0.999 * gusty.wind_ok_mps, 77.0)
    assert not gusty.allows(0.999 * steady.wind_ok_mps, 77.0)
    little = wind_envelope(hovering(meadow_plan, limits=NEVER, judge={"position_rms_m": 0.2}), 0.5)
    assert {border.limit for border in little.borders} == {POSITION_ERROR}
    assert little.wind_ok_mps == pytest.approx(little.gust_ok_mps / 0.5, rel=1e-9)


def effort(plan: Plan, t_s: Array, wind: Array) -> tuple[Array, Array, Array]:
    """Thrust, roll and pitch (V, N) that the planned motion needs in a wind (2,) at the reference height."""
    states = plan.states(t_s)
    share = plan.quadrotor.wind.share(-states[..., POSITION][..., 2])
    air = states[..., VELOCITY] - np.stack(np.broadcast_arrays(share * wind[0], share * wind[1], 0.0), axis=-1)
    # The acceleration of the leader by Eq. 1 and that of the offsets: followers' own has the rounded thrust in it.
    row = plan.leader
    own = plan.accelerations(t_s)[row] - plan.offsets(t_s, 2)[row]
    return thrust_and_tilt(own + plan.offsets(t_s, 2), air, states[..., ATTITUDE][..., 2], plan.quadrotor)


def excess(plan: Plan, t_s: Array, wind: Array) -> float:
    """The largest share of a limit that is used, less one."""
    thrust, roll, pitch = effort(plan, t_s, wind)
    limits = plan.scenario.limits
    used = (
        thrust.max() / limits.thrust_N[1],
        limits.thrust_N[0] / max(thrust.min(), 1e-9),
        np.abs(np.degrees(roll)).max() / limits.roll_pitch_yaw_deg[0],
        np.abs(np.degrees(pitch)).max() / limits.roll_pitch_yaw_deg[1],
    )
    return float(max(used)) - 1.0


@pytest.mark.parametrize("name", ["meadow", "sheared", "reshape"])
@settings(max_examples=25)
@given(data=st.data())
def test_no_limit_is_violated_inside(
    name: str, meadow_plan: Plan, sheared: Plan, planned: Planned, data: st.DataObject
) -> None:
    plan = {"meadow": meadow_plan, "sheared": sheared}.get(name) or planned(name)[0]
    envelope = wind_envelope(plan)
    from_deg, share = data.draw(st.floats(0.0, 360.0)), data.draw(st.floats(0.0, 1.0))
    speed = share * envelope.ok_from(from_deg)
    assert envelope.allows(speed, from_deg)
    from_rad = np.radians(from_deg)
    wind = -speed * np.array([np.cos(from_rad), np.sin(from_rad)])
    t_s = np.linspace(plan.t_start_s, plan.t_end_s, 1500, endpoint=False)
    assert excess(plan, t_s, wind) <= 1.5 * LIMIT_TOLERANCE


@pytest.mark.parametrize("name", ["meadow", "sheared", "reshape"])
def test_the_named_limit_is_violated_little_outside(
    name: str, meadow_plan: Plan, sheared: Plan, planned: Planned
) -> None:
    plan = {"meadow": meadow_plan, "sheared": sheared}.get(name) or planned(name)[0]
    envelope = wind_envelope(plan)
    assert envelope.wind_ok_mps > 0.0
    for border in envelope.borders:
        if border.t_s is None:
            continue
        from_rad = np.radians(border.from_deg)
        # The half-plane of the roll is too cautious where the pitch of the wind is far from the planned one.
        speed_mps = (1.25 if border.limit == "roll" else 1.05) * border.speed_mps + 0.1
        wind = -speed_mps * np.array([np.cos(from_rad), np.sin(from_rad)])
        assert excess(plan, np.linspace(plan.t_start_s, plan.t_end_s, 4000, endpoint=False), wind) > 0.0
        assert not envelope.allows(speed_mps, border.from_deg)
