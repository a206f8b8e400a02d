"""State and control histories: what is in them, and what the reader refuses."""

from __future__ import annotations

import numpy as np
import pytest

from gcs.errors import FileFormatError
from gcs.mission.formats.tables.history_csv import COLUMNS, build_histories, read_history, write_history
from gcs.physics.quadrotor import derivative
from gcs.physics.states import CONTROL_NAMES, STATE_NAMES
from gcs.plan.trajectory.plan import Plan


def test_columns_are_the_states_and_controls_of_eq_1() -> None:
    assert len(COLUMNS) == 1 + len(STATE_NAMES) + len(CONTROL_NAMES)


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


@pytest.mark.parametrize(
    ("old", "new", "reason"),
    [
        ("# vehicle: 1\n", "", "comment with the vehicle"),
        ("# vehicle: 1\n", "# vehicle: one\n", "comment with the vehicle"),
        ("U4_Nm", "U5_Nm", "header"),
        (",N m", ",lbf", "units"),
        ("\n-37,", "\n999,", "times do not increase"),
        ("\n-37,", "\nnan,", "finite"),
        ("\n-37,", "\n", "columns"),
        ("# rows: ", "# rows: 1", "announced"),
    ],
)
def test_a_mistake_is_named(simulation1_plan: Plan, old: str, new: str, reason: str) -> None:
    text = write_history(build_histories(simulation1_plan, 0.5, slice(0, 1))[0]).decode()
    assert old in text
    with pytest.raises(FileFormatError, match=f"x: .*{reason}"):
        read_history(text.replace(old, new), "x")
