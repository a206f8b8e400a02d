"""Every bundled mission is planned again at ten instants of its flight: verified, or refused with a reason."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from gcs.errors import PlanningError
from gcs.plan.replanning.replanner import Replanner
from gcs.plan.trajectory.phases import PhaseKind
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.verify import verify

MISSIONS = sorted(
    path.relative_to(Path(__file__).parents[4] / "missions").as_posix()
    for path in (Path(__file__).parents[4] / "missions").glob("*/*.toml")
    if path.name.startswith("scenario") and path.parent.name != "campaigns"
)
_SHARES = np.linspace(0.02, 0.95, 10)  # of the mission


@pytest.mark.long
@pytest.mark.parametrize("mission", MISSIONS)
def test_it_is_planned_again_at_ten_instants(plan_of: Callable[[str], Plan], mission: str) -> None:
    plan = plan_of(mission)
    replanner, flight = Replanner(plan, spare_disks=0), plan.phase(PhaseKind.MISSION)
    verified = 0
    for at_s in np.round(flight.start_s + _SHARES * (flight.end_s - flight.start_s), 1).tolist():
        try:
            new = replanner.replan(plan.leader_trajectory.state(at_s), at_s)
        except PlanningError as refused:
            assert len(refused.message) > 20, at_s
            continue
        report = verify(new)
        assert report.ok, f"t = {at_s:g} s: {report}"
        verified += 1
    assert verified >= 7


@pytest.mark.slow
def test_a_formation_that_shrinks_to_fit_a_gap_is_planned_again(plan_of: Callable[[str], Plan]) -> None:
    """It leaves no more room to the ground than the planner's own reserve."""
    plan = plan_of("gap/scenario.toml")
    assert verify(Replanner(plan, spare_disks=0).replan(plan.leader_trajectory.state(20.0), 20.0)).ok
