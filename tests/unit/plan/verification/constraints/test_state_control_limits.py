"""Limits of motion of a straight flight in a bank, against Eq. 1 worked by hand."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import PPoly

from gcs.plan.trajectory.plan import Plan
from gcs.plan.trajectory.trajectory import Trajectory
from gcs.plan.verification.constraints.state_control_limits import _turning, divided
from gcs.plan.verification.proof.subdivision import SHORTEST_S, plain_cells
from gcs.plan.verification.proof.taylor import Taylor
from tests.unit.plan.problems import changed
from tests.unit.plan.verification.constraints.even_flights import assert_margin, check_of, even

ROLL, THRUST_N, SPEED_MPS = 0.3, 4.6, 2.0


@pytest.fixture(scope="module")
def banked(meadow_plan: Plan) -> Plan:
    """North at 2 m/s with a roll of 0.3 rad, in calm air."""
    limited = changed(meadow_plan.scenario, limits={"accel_max_mps2": 3.2, "speed_ned_mps": [2.1, 1.0, 1.0]})
    plan = replace(meadow_plan, scenario=limited)
    return even(plan, (0.0, 1.0, -4.0), (SPEED_MPS, 0.0, 0.0), (ROLL, 0.0, 0.0), (THRUST_N, 0.01, -0.02, 0.0))


def test_the_acceleration_is_that_of_eq_1(banked: Plan) -> None:
    q = banked.quadrotor
    along = -q.drag_Nspm[0] / q.mass_kg * SPEED_MPS
    across = THRUST_N / q.mass_kg * np.sin(ROLL)
    down = q.gravity_mps2 - THRUST_N / q.mass_kg * np.cos(ROLL)
    size = float(np.sqrt(along**2 + across**2 + down**2))
    assert_margin(check_of(banked, "acceleration"), 3.2 - size)
    factor = across / q.gravity_mps2  # v x a over |v|: only what is across the way turns it
    assert_margin(check_of(banked, "turning load factor"), banked.scenario.limits.load_factor_max - factor)


def test_a_vehicle_that_rolls_on_accelerates_no_more(banked: Plan) -> None:
    """A rate of roll is no part of the acceleration: of Eq. 1 it is the next row."""
    old = banked.leader_trajectory
    c = old.state.c.copy()
    c[-1, 0, 9] = 2.0
    rolling = replace(banked, leader_trajectory=Trajectory(PPoly(c, old.joints_s), old.control))
    assert check_of(rolling, "acceleration").worst == pytest.approx(check_of(banked, "acceleration").worst)


def test_speeds_attitude_and_controls_are_read_off(banked: Plan) -> None:
    limits = banked.scenario.limits
    assert_margin(check_of(banked, "north speed"), 2.1 - SPEED_MPS)
    assert_margin(check_of(banked, "roll"), limits.roll_pitch_yaw_deg[0] - np.degrees(ROLL))
    assert_margin(check_of(banked, "thrust U1"), min(THRUST_N - limits.thrust_N[0], limits.thrust_N[1] - THRUST_N))


def test_the_rotor_speeds_are_those_of_eq_2(banked: Plan) -> None:
    """U1 = K_T sum, U2 and U3 by pairs of rotors over the root of 2: solved as four linear equations."""
    v = banked.scenario.vehicle
    k, half = v.thrust_coeff_Ns2, np.sqrt(0.5) * v.thrust_coeff_Ns2
    mixer = np.array(
        [
            [k] * 4,
            [half, -half, -half, half],
            [half, half, -half, -half],
            [v.moment_coeff_Nms2 * s for s in (1, -1, 1, -1)],
        ]
    )
    share = np.linalg.solve(mixer, [THRUST_N, 0.01, -0.02, 0.0]) / v.rotor_max_radps**2
    assert_margin(check_of(banked, "rotor speed"), float(min(share.min(), (1.0 - share).min())), close=1e-3)


@pytest.mark.parametrize(("excess", "verdict"), [(0.5e-3, "proved"), (2e-3, "violated")])
def test_a_peak_of_a_few_milliseconds_is_seen_to_its_top(banked: Plan, excess: float, verdict: str) -> None:
    """U4 rises to its limit and a share of it more, and falls again, within 3 ms."""
    limit = banked.scenario.limits.yaw_moment_Nm
    assert limit is not None
    old = banked.leader_trajectory
    joints = np.array([banked.t_start_s, 7.0111, 7.0141, banked.t_end_s])
    c = np.zeros((3, 3, 4))
    c[2] = old.control.c[0, 0]
    width = 3e-3
    c[0, 1, 3], c[1, 1, 3] = (value * 4.0 * limit * (1.0 + excess) for value in (-1.0 / width**2, 1.0 / width))
    state = np.stack([old.state(joints[:-1], nu=1), old.state(joints[:-1])])
    peaked = replace(banked, leader_trajectory=Trajectory(PPoly(state, joints), PPoly(c, joints)))
    found = check_of(peaked, "control U4")
    assert found.verdict == verdict
    assert found.worst == pytest.approx(-excess * limit, abs=3e-4 * limit)


def test_the_jerk_of_an_even_flight_is_that_of_its_drag(meadow_plan: Plan) -> None:
    """Thrust and attitude are constant, so only the drag on a velocity that Eq. 1 changes is left: K a / m."""
    plan = replace(meadow_plan, scenario=changed(meadow_plan.scenario, limits={"jerk_max_mps3": 2.0}))
    flown = even(plan, (0.0, 1.0, -4.0), (SPEED_MPS, 0.0, 0.0), (ROLL, 0.0, 0.0), (THRUST_N, 0.01, -0.02, 0.0))
    q = flown.quadrotor
    along = -q.drag_Nspm[0] / q.mass_kg * SPEED_MPS
    across, up = THRUST_N / q.mass_kg * np.sin(ROLL), THRUST_N / q.mass_kg * np.cos(ROLL)
    felt = np.array(q.drag_Nspm) * [along, across, q.gravity_mps2 - up] / q.mass_kg
    assert_margin(check_of(flown, "jerk"), 2.0 - float(np.linalg.norm(felt)))


def test_the_proved_load_factor_holds_at_every_instant_of_an_interval() -> None:
    """North at 2 m/s within 0.5, east at rest, pushed east by 3 m/s2 and up to 1.5 more at either end."""
    zero = Taylor(np.zeros((3, 1)), np.zeros(1))
    north, push = (
        Taylor(np.array([[2.0], [0.5], [0.0]]), zero.remainder),
        Taylor(np.array([[3.0], [0.0], [1.5]]), zero.remainder),
    )
    state, moved = [zero, zero, zero, north, zero], (zero, zero, zero, zero, push)
    for most in (0.2, 0.6):  # violated, and kept
        proved, middle = _turning(state, moved, most, 9.8)
        assert middle == pytest.approx(most - 3.0 / 9.8)
        assert proved[0] <= most - 4.5 / 9.8  # at the ends


def test_cells_are_divided_into_groups_that_are_wide_and_into_times_that_are_long() -> None:
    """Group 0 is 10 m wide and consists of 1 and 2; group 2, of 0.1 m, of 3 and 4. A vehicle flies 5 m in 1 s."""
    tree: Any = SimpleNamespace(
        parts=np.array([[1, 2], [-1, -1], [3, 4], [-1, -1], [-1, -1]]), reach_m=np.array([10.0, 0.0, 0.1, 0.0, 0.0])
    )
    short_s = 0.9 * SHORTEST_S
    rows = [(0, 1.0), (0, 3.0), (2, 1.0), (2, short_s), (1, 1.0), (1, short_s), (0, 1.0)]
    start_s = 10.0 * np.arange(len(rows))
    cells = plain_cells(
        np.array([[who] for who, _ in rows]), start_s, start_s + np.array([length_s for _, length_s in rows])
    )
    wanted = np.array([True] * 6 + [False])

    def parts_of(tree: Any) -> dict[int, list[tuple[int, float, float]]]:
        parts, origin = divided(cells, wanted, tree)
        found: dict[int, list[tuple[int, float, float]]] = {}
        for who, begin_s, end_s, number in zip(parts.who[:, 0], parts.start_s, parts.end_s, origin, strict=True):
            of_cell = begin_s - start_s[number], end_s - start_s[number]
            found.setdefault(int(number), []).append((int(who), *np.round(of_cell, 6).tolist()))
        return found

    assert parts_of(tree) == {
        0: [(1, 0.0, 1.0), (2, 0.0, 1.0)],
        1: [(0, 0.0, 1.5), (0, 1.5, 3.0)],  # it flies farther than it is wide
        2: [(2, 0.0, 0.5), (2, 0.5, 1.0)],
        3: [(3, 0.0, round(short_s, 6)), (4, 0.0, round(short_s, 6))],
        4: [(1, 0.0, 0.5), (1, 0.5, 1.0)],
    }
    assert sorted(parts_of(None)) == [0, 1, 2, 4], "without groups only times are divided"
    assert parts_of(None)[0] == [(0, 0.0, 0.5), (0, 0.5, 1.0)]
