"""The terms of the cost: they add up to what the solver minimised, and change where the scenario does."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import gcs
from gcs.cli import main
from gcs.plan.trajectory.plan import Plan


def test_the_terms_add_up_to_the_cost(simulation1_plan: Plan) -> None:
    terms = {term.name: term for term in gcs.cost_terms(simulation1_plan)}
    assert list(terms) == ["energy", "heading", "height"]
    assert [term.weight for term in terms.values()] == [0.8, 0.1, 0.1]
    total = sum(term.weight * term.value for term in terms.values())
    assert total == pytest.approx(simulation1_plan.objective, rel=1e-5)
    straight_m = float(np.linalg.norm(np.subtract([1200.0, 1000.0, 2.0], [2.0, 1.0, 3.0])))
    assert terms["energy"].reference == f"{straight_m / 275.0:.2f} m/s against the air"
    assert terms["height"].reference == "20 m off 20 m"
    assert terms["energy"].value == pytest.approx(1.028, abs=2e-3)  # a little more than the straight way at one speed


def test_a_plan_that_begins_in_the_air_has_no_terms(simulation1_plan: Plan) -> None:
    assert gcs.cost_terms(replace(simulation1_plan, begin_state=(0.0,) * 12)) == ()


def test_show_prints_the_terms_of_the_cost(
    simulation1_plan: Plan, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    gcs.save_plan(simulation1_plan, gcs.verify(simulation1_plan), tmp_path / "simulation1.skein")
    assert main.run(["show", str(tmp_path / "simulation1.skein")]) == 0
    told = " ".join(capsys.readouterr().out.split())
    assert re.search(
        r"terms of the cost 0\.8 x 1\.02\d\d energy \+ 0\.1 x 0\.\d{4} heading \+ 0\.1 x 0\.\d{4} height", told
    )


def test_states_at_one_instant(simulation1_plan: Plan) -> None:
    assert simulation1_plan.states(10.0).shape == (6, 1, 12)
    assert simulation1_plan.named_states(10.0).height_m.shape == (6, 1)
    assert simulation1_plan.controls(10.0).shape == (6, 1, 4)
