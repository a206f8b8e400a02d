"""State and control histories: what is in them."""

from __future__ import annotations

import numpy as np

from gcs.mission.formats.tables.history_csv import COLUMNS, build_histories
from gcs.physics.quadrotor import derivative
from gcs.physics.states import NU, NX
from gcs.plan.trajectory.plan import Plan


def test_columns_are_the_states_and_controls_of_eq_1() -> None:
    assert len(COLUMNS) == 1 + NX + NU


def test_the_history_solves_eq_1(simulation1_plan: Plan) -> None:
    """Differences of what is written agree with the equations of motion, whole seconds included."""
    histories = build_histories(simulation1_plan, 25.0)
    assert [h.sysid for h in histories] == list(simulation1_plan.sysids)
    for history in histories:
        assert {0.0, 1.0, -1.0} <= set(history.t_s)
        rate = derivative(history.states, history.controls, simulation1_plan.quadrotor)
        change = np.diff(history.states, axis=0) / np.diff(history.t_s)[:, None]
        joints = np.searchsorted(history.t_s, simulation1_plan.joints_s)
        smooth = np.setdiff1d(np.arange(len(change)), np.concatenate([joints - 1, joints]))
        assert np.abs(change - 0.5 * (rate[1:] + rate[:-1]))[smooth].max() < 2e-3


def test_some_vehicles_are_the_same_as_among_all(simulation1_plan: Plan) -> None:
    whole, part = build_histories(simulation1_plan, 2.0), build_histories(simulation1_plan, 2.0, slice(4, 6))
    for ours, among_all in zip(part, whole[4:], strict=True):
        assert ours.sysid == among_all.sysid
        assert np.array_equal(ours.states, among_all.states)
        assert np.array_equal(ours.controls, among_all.controls)
