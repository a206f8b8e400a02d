"""Any schedule of changes ends in a plan that holds, or in a sentence."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, assume, given, settings
from hypothesis import strategies as st

from gcs.errors import Infeasible
from gcs.plan.planner import make_plan
from gcs.plan.verification.verify import verify
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.validation.cross_table import check
from tests.unit.plan.formations import fleet

kinds = st.sampled_from(["rotate", "shrink", "reshape"])
spacings = st.floats(2.2, 5.0).map(lambda spacing: round(spacing, 2))
generators = st.sampled_from(["triangle", "line", "column", "vee", "grid", "circle", "sphere"])


@st.composite
def shapes(draw: st.DrawFn) -> tuple[dict[str, Any], ...]:
    """Four shapes by name."""
    return tuple(
        {"name": f"s{number}", "generator": draw(generators), "spacing_m": draw(spacings)} for number in range(4)
    )


@st.composite
def schedules(draw: st.DrawFn) -> tuple[dict[str, Any], ...]:
    """One to three changes, by times in order or by gates across the way."""
    changes: list[dict[str, Any]] = []
    at_s = 0.0
    for _ in range(draw(st.integers(1, 3))):
        kind = draw(kinds)
        change: dict[str, Any] = {"kind": kind}
        if kind == "rotate":
            change["angle_deg"] = round(draw(st.floats(-200.0, 200.0)), 1)
            if draw(st.booleans()):
                change["axis"] = [round(draw(st.floats(-1.0, 1.0)), 2), 0.5, round(draw(st.floats(-1.0, 1.0)), 2)]
        elif kind == "shrink":
            change["scale"] = round(draw(st.floats(0.5, 1.8)), 2)
        else:
            change["to"] = draw(st.sampled_from(["s1", "s2", "s3", "start"]))
            change["assignment"] = draw(st.sampled_from(["free", "fixed"]))
        if draw(st.booleans()):
            north_m = draw(st.floats(8.0, 30.0))
            change["gate_m"] = [[north_m, -60.0], [north_m, 60.0]]
        else:
            at_s = round(at_s + draw(st.floats(0.0, 40.0)), 2)
            change["at_s"] = at_s
        changes.append(change)
    return tuple(changes)


@pytest.mark.long
@settings(
    max_examples=10,
    deadline=None,
    derandomize=True,
    phases=[Phase.explicit, Phase.generate],  # an example takes seconds: one that fails is enough
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.filter_too_much],
)
@given(count=st.integers(3, 12), named=shapes(), changes=schedules())
def test_a_random_schedule_is_flown_or_refused_in_a_sentence(
    simulation1: Scenario, count: int, named: tuple[dict[str, Any], ...], changes: tuple[dict[str, Any], ...]
) -> None:
    scenario = fleet(
        simulation1,
        count,
        "s0",
        changes,
        named,
        time={"flight_s": 80.0},
        start={"position_m": [2.0, 1.0, 14.0]},
        end={"position_m": [40.0, 14.0, 14.0]},
        limits={"height_m": [0.0, 60.0], "east_m": [-150.0, 150.0], "north_m": [-150.0, 250.0]},
        ground_phases={"takeoff_s": 40.0, "landing_s": 40.0, "hover_s": 2.0},
        formation={"change_speed_mps": 2.0, "change_accel_mps2": 0.8},
    )
    assume(not check(scenario))
    try:
        plan = make_plan(scenario)
    except Infeasible as refused:
        assert len(refused.message.split()) > 5
        assert len(refused.hint.split()) > 3
        return
    report = verify(plan)
    assert report.ok, [str(check) for check in report.failures]
    t = np.linspace(0.0, 80.0, 801)[:-1]
    for order, most in ((1, 2.0), (2, 0.8)):
        assert np.linalg.norm(plan.offsets(t, order), axis=-1).max() <= 1.001 * most
    for change, move in zip(changes, plan.moves, strict=True):
        if "at_s" in change:
            assert move.start_s == change["at_s"]
        else:
            north_m = plan.leader_trajectory.state(np.array([move.start_s]))[0, 0]
            assert north_m == pytest.approx(change["gate_m"][0][0], abs=0.06 * 4.0)
