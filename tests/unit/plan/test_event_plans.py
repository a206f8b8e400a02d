"""Answers to the events of a scenario, planned before the take-off."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from gcs.cli.main import run
from gcs.errors import OutOfTime, UsageError
from gcs.plan import event_plans
from gcs.plan.event_plans import plan_events
from gcs.plan.formation_orders import FlyHome, GoTo, Hold, Scale, Slower
from gcs.plan.plan_file import save_plan
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.verify import verify
from gcs.scenario.schema.scenario import EventTable
from gcs.util.long_work import within

ROWS = (
    EventTable(battery_below_percent=30.0, order="home"),
    EventTable(event="storm", order="land"),
    EventTable(at_s=4.0, order="scale", factor=1.3),
    EventTable(event="wide", order="scale", factor=9.0, otherwise="hold"),
)


def with_events(plan: Plan, *rows: EventTable) -> Plan:
    return replace(plan, scenario=plan.scenario.model_copy(update={"on": rows}))


def test_each_planned_order_has_a_verified_plan_or_a_reason_at_each_instant(hop: Plan) -> None:
    found = plan_events(with_events(hop, *ROWS), 12.0)
    assert [(one.row, one.at_s) for one in found] == [(0, 6.0), (0, 18.0), (2, 4.0), (3, 6.0), (3, 18.0)]
    home, scaled, wide = found[0], found[2], found[3]
    assert home.order == FlyHome()
    assert home.proposal is not None
    assert home.proposal.report.ok
    assert home.proposal.plan.t_start_s == 6.0
    assert scaled.order == Scale(1.3)
    assert scaled.proposal is not None
    assert wide.proposal is None
    assert wide.why_not
    with pytest.raises(UsageError, match="no time between"):
        plan_events(hop, 0.0)


def test_a_formation_that_flies_slower_goes_elsewhere_or_holds_is_planned_too(hop: Plan) -> None:
    rows = (
        EventTable(wind_above_mps=8.0, order="slower", factor=0.6),
        EventTable(event="look", order="go", position_m=(20.0, 15.0, 10.0)),
        EventTable(event="stop", order="hold"),
        EventTable(silent_for_s=3.0, order="hold"),  # one that is not heard gets no plan: each brakes by itself
        EventTable(event="on", order="resume"),
    )
    found = plan_events(with_events(hop, *rows), 29.0)
    assert [one.order for one in found] == [Slower(0.6), GoTo(20.0, 15.0, 10.0), Hold()]
    for one in found:
        assert one.proposal is not None, one.why_not
        assert one.proposal.report.ok


@pytest.mark.parametrize(
    ("rows", "code"),
    [
        (ROWS[2:], 0),
        ((EventTable(event="wide", order="scale", factor=9.0),), 4),
        ((EventTable(at_s=29.5, order="hold"),), 0),
    ],
)
def test_the_command_ends_with_4_where_a_row_has_neither_a_plan_nor_another_order(
    hop: Plan, tmp_path: Path, rows: tuple[EventTable, ...], code: int, capsys: pytest.CaptureFixture[str]
) -> None:
    plan = with_events(hop, *rows)
    save_plan(plan, verify(plan), tmp_path / "hop.skein")
    assert run(["check-events", str(tmp_path / "hop.skein"), "--every", "20"]) == code
    told = capsys.readouterr()
    assert "answers verified" in told.out
    assert ("has no plan at t = 10" in told.err) == bool(code)
    if rows[0].order == "hold":
        assert "0 of 1 answers verified" in told.out, "each brakes by itself there"


def test_answers_that_are_not_planned_in_time_are_told_from_those_without_a_plan(
    hop: Plan, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    plan = with_events(hop, ROWS[0])
    save_plan(plan, verify(plan), tmp_path / "hop.skein")
    with within(0.0):
        late = plan_events(plan, 12.0)
    assert [(one.at_s, one.in_time, one.proposal) for one in late] == [(6.0, False, None), (18.0, False, None)]
    monkeypatch.setattr(event_plans, "plan_events", lambda *_: late)
    assert run(["check-events", str(tmp_path / "hop.skein"), "--limit", "5"]) == OutOfTime.exit_code
    told = capsys.readouterr().err
    assert "2 of 2 answers were not planned in time: the time limit has passed, while planning the answer to" in told
    assert "give more time (--limit), or look at fewer instants (--every)" in told


def test_a_scenario_without_events_is_told_what_to_write(
    hop: Plan, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    save_plan(hop, verify(hop), tmp_path / "hop.skein")
    assert run(["check-events", str(tmp_path / "hop.skein")]) == 2
    assert "write [[on]] into it" in capsys.readouterr().err
