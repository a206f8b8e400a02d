"""Plans of one content have one verdict: whatever a verdict depends on makes another content."""

from __future__ import annotations

from dataclasses import replace

from gcs.plan.trajectory.plan import Plan


def test_all_that_a_verdict_depends_on_is_content(meadow_plan: Plan) -> None:
    plan = meadow_plan
    leader = plan.leader_trajectory
    bent = leader.state.c.copy()
    bent[0, 0, 0] += 1e-9
    others = [
        replace(plan, leader_trajectory=replace(leader, state=type(leader.state)(bent, leader.state.x))),
        replace(plan, begin_state=(0.0,) * 12),
        replace(plan, route_s=(1.0,)),
        replace(plan, scenario=plan.scenario.model_copy(update={"name": "another"})),
    ]
    assert replace(plan).content == plan.content
    assert len({plan.content, *(other.content for other in others)}) == 5
