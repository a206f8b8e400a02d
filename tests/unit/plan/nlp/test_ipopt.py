"""What the solver is given for each kind of program, and what is said when it fails; it is not run here."""

from __future__ import annotations

import io
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from gcs.errors import Infeasible
from gcs.plan.nlp import ipopt
from gcs.plan.nlp.ipopt import OPTIONS, Solution, _failure, _opposing, _WithoutInterrupts, solve
from gcs.plan.nlp.mesh import Mesh
from gcs.plan.trajectory.constraint_id import ConstraintId, Form, Kind
from gcs.scenario.environment.no_fly import ZoneName

ROLL, ZONE = ConstraintId(Kind.ROLL, Form.BOUND), ConstraintId(Kind.ZONE, of=ZoneName(1))


def program(**kinds: Any) -> Any:
    """Three unknowns, the last one fixed, and three rows, the first an equation."""
    mesh = Mesh(np.array([0.0, 1.0, 2.0]), (2, 2), legs=kinds.pop("legs", ()))
    names: dict[str, Any] = {
        "layout": SimpleNamespace(coordinates=kinds.pop("coordinates", ()), mesh=mesh),
        "y_low": np.array([-1.0, -1.0, 0.0]),
        "y_high": np.array([1.0, 1.0, 0.0]),
        "y_ids": (ROLL, ConstraintId(Kind.PITCH, Form.BOUND), ConstraintId(Kind.YAW, Form.BOUND)),
        "g_low": np.array([0.0, -np.inf, 0.0]),
        "g_high": np.array([0.0, 2.0, np.inf]),
        "g_ids": ((ConstraintId(Kind.ROLL, Form.MOTION), 3.0), (ROLL, 5.0), (ZONE, 7.0)),
        "nlp": lambda y, _: (0.0, y),
        "derivatives": {},
        "parameters": np.zeros(0),
        "moving_shape": False,
        "free_time": False,
        "leg_at": lambda t_s: "",
    }
    return SimpleNamespace(**names | kinds)


FOUND = Solution(np.array([1.0, 2.0, 3.0]), np.array([4.0, 5.0, 6.0]), {(ZONE, 7.0000001): 8.0}, 9.0, 10, 11.0)


@pytest.fixture
def given(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """The options and the guess of the last solve, which takes 2 s in all."""
    seen: dict[str, Any] = {}
    clock = iter((100.0, 102.0))
    monkeypatch.setattr(ipopt, "solver", lambda nlp, derivatives, options: seen.update(options=options))
    monkeypatch.setattr(ipopt, "run", lambda solver, program, guess: seen.update(guess=guess) or FOUND)
    monkeypatch.setattr(ipopt.time, "perf_counter", lambda: next(clock))
    return seen


@pytest.mark.parametrize(
    ("kinds", "near", "options"),
    [
        ({}, False, {}),
        ({"coordinates": ("scale",), "moving_shape": True}, False, {"ipopt.mumps_pivot_order": 0}),
        ({"moving_shape": True}, False, {"ipopt.dual_inf_tol": 1e-8}),
        ({"free_time": True}, False, {"ipopt.mu_strategy": "adaptive"}),
        ({"legs": (0, 1)}, False, {"ipopt.fast_step_computation": "yes"}),
        ({"legs": (0, 0)}, True, {"ipopt.mu_init": 1e-3}),
    ],
)
def test_each_kind_of_program_has_its_options(
    given: dict[str, Any], kinds: dict[str, Any], near: bool, options: dict[str, Any]
) -> None:
    found = solve(program(**kinds), np.zeros(3), near=near)
    assert given["options"] == {**OPTIONS, **options}
    assert list(given["guess"]) == ["x0"]
    assert found == replace(FOUND, seconds=2.0)


@pytest.mark.parametrize("unknowns", [3, 4])
def test_a_warm_start_knows_the_multipliers_of_the_rows_that_are_still_there(
    given: dict[str, Any], unknowns: int
) -> None:
    solve(program(), np.zeros(unknowns), FOUND)
    assert given["options"]["ipopt.warm_start_init_point"] == "yes"
    assert given["guess"]["lam_g0"] == [0.0, 0.0, 8.0]
    assert ("lam_x0" in given["guess"]) == (unknowns == 3)


def test_a_failure_names_the_row_that_is_off_by_most() -> None:
    for y, name, t_s in (
        ([0.4, 2.3, 0.0], "Eq. 1 for roll", 3.0),
        ([-0.4, 2.3, 0.0], "Eq. 1 for roll", 3.0),
        ([0.1, 2.3, 0.0], "limit of roll", 5.0),
        ([0.1, 2.3, -0.5], "no-fly zone 1", 7.0),
        ([0.1, 2.3, np.nan], "no-fly zone 1", 7.0),
    ):
        none = np.zeros(3)
        failure = _failure(program(leg_at=lambda _: "leg 2"), np.array(y), none, none, "Infeasible_Problem_Detected")
        assert isinstance(failure, Infeasible)
        assert f"the largest violation is of {name} at t = {t_s:.1f} s in leg 2" in failure.message
    other = _failure(program(), none, none, none, "Something_Else")
    assert not isinstance(other, Infeasible)
    assert "the solver stopped without a solution (IPOPT: Something_Else)" in other.message
    assert " in leg" not in other.message and "against" not in other.message


@pytest.mark.parametrize(
    ("y_multipliers", "g_multipliers", "against"),
    [
        ([3.0, -2.0, 99.0], [99.0, 0.0, 0.5], "limit of roll and the no-fly zone 1"),  # what is fixed opposes nothing
        ([3.0, -5.0, 0.0], [0.0, -4.0, -0.5], "limit of roll and the no-fly zone 1"),  # summed over the flight
        ([3.0, -5.0, 0.0], [0.0, 0.0, 0.0], "limit of pitch"),
        ([0.0, 0.01, 0.0], [0.0, 0.0, 2.0], "no-fly zone 1"),  # less than a hundredth of the largest
        ([0.0, 0.03, 0.0], [0.0, 0.0, 2.0], "limit of pitch and the no-fly zone 1"),
        ([0.0, 0.0, 0.0], [0.0, 0.0, 0.0], ""),
    ],
)
def test_the_limit_and_the_obstacle_with_the_largest_multipliers_stand_in_the_way(
    y_multipliers: list[float], g_multipliers: list[float], against: str
) -> None:
    assert _opposing(program(), np.array(y_multipliers), np.array(g_multipliers)) == against


def test_of_what_the_library_writes_only_its_words_for_ctrl_c_are_left_out() -> None:
    shown = io.StringIO()
    stream = _WithoutInterrupts(shown)
    for piece in ("one\n", "CasADi - ", "2026 WARNING ", "KeyboardInterruptException\n", "CasADi - ", "real\n", "two"):
        assert stream.write(piece) == len(piece)
    assert shown.getvalue() == "one\nCasADi - real\ntwo"
    assert stream.getvalue() == shown.getvalue()  # all else is the stream's own
