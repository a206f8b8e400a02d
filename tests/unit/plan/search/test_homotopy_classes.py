"""Routes optimised in parallel: the same plan as one after another, no process left, none started in vain."""

from __future__ import annotations

import multiprocessing
import os
import time

import numpy as np
import pytest

from gcs.errors import Infeasible
from gcs.plan.ocp.problem import flight_problem
from gcs.plan.search import homotopy_classes
from gcs.plan.search.homotopy_classes import best_class, is_faster, run_all
from gcs.plan.trajectory.plan import MeshRound
from gcs.scenario.schema.scenario import Scenario
from tests.unit.plan.search.test_routes import DISK, beyond


def double(number: int) -> tuple[int, int]:
    time.sleep(0.05 * (number == 1))  # the first is the last to be done
    return 2 * number, os.getpid()


def refuse(number: int) -> int:
    raise Infeasible(f"no plan for {number}", hint="another")


def test_workers_are_started_where_they_pay() -> None:
    assert not is_faster(4, 1, 100.0)
    assert not is_faster(1, 8, 100.0)
    assert not is_faster(2, 2, 0.9 * homotopy_classes.START_S)
    assert is_faster(2, 2, 1.1 * homotopy_classes.START_S)
    assert is_faster(4, 2, 0.6 * homotopy_classes.START_S)
    assert is_faster(3, 8, 0.6 * homotopy_classes.START_S)


@pytest.mark.slow
def test_results_are_in_order_and_no_process_is_left() -> None:
    found = run_all(double, [1, 2, 3], 2)
    assert [result for result, _ in found] == [2, 4, 6]
    assert os.getpid() not in {pid for _, pid in found}
    with pytest.raises(Infeasible, match="no plan for 1") as failure:
        run_all(refuse, [1, 2], 2)
    assert failure.value.hint == "another"
    assert multiprocessing.active_children() == []


@pytest.mark.slow
def test_the_best_way_is_the_same(simulation1: Scenario, monkeypatch: pytest.MonkeyPatch) -> None:
    problem = flight_problem(beyond(simulation1, no_fly=[{**DISK, "east_m": 44.0}]))
    alone_told: list[MeshRound] = []
    together_told: list[MeshRound] = []
    one, ways = best_class(problem, alone_told.append, all_routes=True)
    assert len(ways) > 1
    monkeypatch.setattr(homotopy_classes, "START_S", -1.0)
    two, same = best_class(problem, together_told.append, all_routes=True, workers=2)
    assert same == ways
    assert two.objective == one.objective
    np.testing.assert_array_equal(two.trajectory.state.c, one.trajectory.state.c)
    assert [r.iterations for r in together_told] == [r.iterations for r in alone_told]
    assert multiprocessing.active_children() == []
