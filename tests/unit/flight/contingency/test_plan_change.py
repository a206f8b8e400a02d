"""Orders that change the plan, without clocks: from which instant, late plans, refusals, and braking in time."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs.errors import FlightError
from gcs.flight.contingency.plan_change import ATTEMPTS, MARGIN_S, SLOWER, PlanChange, enters_at_s
from gcs.physics.states import VELOCITY
from gcs.plan.formation_orders import Avoid, CloseRanks, FlyHome, GoOn, Hold, PlanOrder, Scale, Slower
from gcs.plan.trajectory.plan import Plan

LEAD_S = 0.2
FAR = Avoid(1000.0, 1000.0, 10.0)


def ahead(plan: Plan, t_s: float = 20.0, radius_m: float = 4.0) -> Avoid:
    north_m, east_m, _ = plan.leader_trajectory.state(t_s)[:3].tolist()
    return Avoid(north_m, east_m, radius_m)


@given(
    now_s=st.floats(0.0, 500.0),
    took_s=st.floats(0.0, 5.0),
    rate_hz=st.sampled_from([4.0, 10.0, 25.0, 30.0, 50.0]),
)
def test_a_plan_begins_on_the_grid_after_the_time_that_planning_takes(
    hop: Plan, now_s: float, took_s: float, rate_hz: float
) -> None:
    begins_s = PlanChange(rate_hz, LEAD_S, took_s).ask(FAR, "a test", now_s, hop).begin_s
    least_s = now_s + SLOWER * took_s + LEAD_S + MARGIN_S
    assert least_s - 1e-9 <= begins_s < least_s + 1.0 / rate_hz + 1e-9
    assert begins_s * rate_hz == pytest.approx(round(begins_s * rate_hz), abs=1e-9)


def test_a_second_order_waits_for_the_answer_to_the_first(hop: Plan) -> None:
    ours = PlanChange(10.0, LEAD_S, 0.5)
    ours.ask(FAR, "a test", 10.0, hop)
    with pytest.raises(FlightError, match="still being asked to avoid 10 m"):
        ours.ask(Scale(0.6), "a test", 10.2, hop)
    assert ours.in_time(10.4)
    assert ours.ask(Scale(0.6), "a test", 10.5, hop).order == Scale(0.6)


def test_a_late_plan_is_made_again_from_a_later_instant_then_refused(hop: Plan) -> None:
    ours = PlanChange(10.0, LEAD_S, 0.5)
    first = ours.ask(FAR, "a test", 10.0, hop)
    now_s = first.begin_s
    begins_s = [first.begin_s]
    for _ in range(ATTEMPTS - 1):
        assert not ours.in_time(now_s)
        assert ours.pending is not None
        begins_s.append(ours.pending.begin_s)
        assert ours.pending.begin_s > now_s + LEAD_S + MARGIN_S
        now_s = ours.pending.begin_s
    assert not ours.in_time(now_s)
    assert ours.pending is None
    assert begins_s == sorted(begins_s)


def test_planning_that_took_long_gets_more_time_next(hop: Plan) -> None:
    ours = PlanChange(10.0, LEAD_S, 0.1)
    ours.ask(FAR, "a test", 10.0, hop)
    ours.in_time(13.0)
    assert ours.pending is not None
    assert ours.pending.begin_s >= 13.0 + SLOWER * 3.0


def test_an_order_that_waited_for_the_planner_is_planned_from_a_later_instant_at_once(hop: Plan) -> None:
    """The planner may still be at the ways back of the plan before."""
    ours = PlanChange(10.0, LEAD_S, 1.0)
    ours.ask(FAR, "a test", 10.0, hop)
    ours.begin(34.0)
    assert ours.pending is not None
    assert 34.0 + SLOWER <= ours.pending.begin_s <= 34.0 + SLOWER + LEAD_S + MARGIN_S + 0.1 + 1e-9
    assert ours.in_time(34.8)
    assert ours.ask(FAR, "a test", 40.0, hop).begin_s < 40.0 + SLOWER + LEAD_S + MARGIN_S + 0.1 + 1e-9


def test_a_refused_zone_that_the_plan_enters_makes_the_formation_brake_before_it(hop: Plan) -> None:
    ours, zone = PlanChange(10.0, LEAD_S), ahead(hop)
    ours.ask(zone, "a test", 3.0, hop)
    words = ours.refused(zone, hop, 4.0)
    enters_s = enters_at_s(hop, zone, 4.0)
    speed_mps = np.linalg.norm(hop.states(np.array([enters_s]))[:, 0, VELOCITY], axis=1).max()
    assert "all brake at" in words
    assert 4.0 < ours.brakes_at_s < enters_s - speed_mps / 1.5
    assert not ours.brakes(ours.brakes_at_s - 0.01)
    due_s = ours.brakes_at_s
    assert ours.brakes(due_s)
    assert not ours.brakes(due_s + 1.0), "once"
    assert "enters the new no-fly zone" in ours.blocked


def test_a_zone_that_is_refused_too_late_makes_the_formation_brake_at_once(hop: Plan) -> None:
    ours, zone = PlanChange(10.0, LEAD_S), ahead(hop)
    now_s = enters_at_s(hop, zone, 0.0) - 1.0
    ours.ask(zone, "a test", now_s, hop)
    ours.refused(zone, hop, now_s)
    assert ours.brakes(now_s)


def test_a_zone_that_the_plan_enters_while_another_one_is_made_makes_the_formation_brake_before_it(hop: Plan) -> None:
    """Six PX4 flew 1.5 m into a zone that they were told of 24 s before: the plan round it began 10 s after that."""
    ours, zone = PlanChange(10.0, LEAD_S, 30.0), ahead(hop)
    enters_s = enters_at_s(hop, zone, 3.0)
    planning = ours.ask(zone, "a test", 3.0, hop)
    assert planning.begin_s < enters_s - 2.0, "as soon as it has to, though planning may take longer"
    due_s = ours.brakes_at_s
    assert planning.begin_s <= due_s + 0.1 < enters_s
    assert ours.brakes(due_s)
    assert "enters the new no-fly zone" in ours.blocked
    assert "all have braked" in ours.refused(zone, hop, enters_s + 30.0), "the old plan would have left the zone again"
    assert ours.blocked, "to go on would lead into it"


def test_a_plan_that_leads_round_another_zone_only_still_brakes_before_the_first(hop: Plan) -> None:
    ours, zone = PlanChange(10.0, LEAD_S), ahead(hop)
    ours.ask(zone, "a test", 3.0, hop)
    ours.refused(zone, hop, 3.5)
    due_s = ours.brakes_at_s
    ours.ask(Scale(0.9), "a test", 4.0, hop)
    assert ours.in_time(4.1)
    ours.changed(Scale(0.9), hop, 4.5, 4.1)
    assert ours.brakes(due_s)


@pytest.mark.parametrize("order", [FAR, Scale(0.5)])
def test_what_the_old_plan_does_not_meet_lets_it_be_flown_on(hop: Plan, order: Avoid | Scale) -> None:
    ours = PlanChange(10.0, LEAD_S)
    ours.ask(order, "a test", 3.0, hop)
    assert "the old plan is flown on" in ours.refused(order, hop, 4.0)
    assert ours.brakes_at_s == math.inf
    assert not ours.blocked


def test_a_new_plan_takes_back_the_order_to_brake(hop: Plan) -> None:
    ours = PlanChange(10.0, LEAD_S)
    ours.ask(ahead(hop), "a test", 3.0, hop)
    assert ours.in_time(3.1)
    ours.changed(ahead(hop), hop, 4.0, 3.1)
    assert not ours.brakes(1000.0)
    assert not ours.blocked


@pytest.mark.parametrize(
    ("last", "order", "waits"),
    [
        (FlyHome(), FAR, True),
        (FlyHome(), Hold(), False),
        (Hold(), FAR, False),
        (Hold(), GoOn(), False),
        (CloseRanks((1, 2), ()), Slower(0.7), True),
    ],
)
def test_an_order_to_a_formation_whose_last_new_plan_has_not_begun_waits_for_it_where_it_must(
    hop: Plan, last: PlanOrder, order: PlanOrder, waits: bool
) -> None:
    """A return begins up to 15 s ahead: programs of its own know nothing before that."""
    ours = PlanChange(10.0, LEAD_S, 0.5)
    ours.changed(last, hop, 24.0, 10.0)
    begins_s = ours.ask(order, "a test", 10.0, hop).begin_s
    assert begins_s == 24.0 if waits else begins_s < 12.0


def test_before_a_zone_that_a_plan_comes_too_late_for_because_a_return_has_not_begun_the_brake_is_first(
    hop: Plan,
) -> None:
    ours, zone = PlanChange(10.0, LEAD_S, 0.1), ahead(hop)
    ours.changed(FlyHome(), hop, 24.0, 3.0)
    ours.ask(zone, "a test", 3.0, hop)
    assert ours.brakes_at_s < 24.0
    assert ours.would_be_late(3.0)


def test_a_plan_that_was_verified_with_a_zone_is_flown_past_it_as_near_as_it_is(hop: Plan) -> None:
    """One that goes on after a brake answers no `avoid`."""
    ours, zone = PlanChange(10.0, LEAD_S), ahead(hop)
    ours.ask(zone, "a test", 3.0, hop)
    ours.changed(GoOn(), hop, 4.0, 3.5)
    assert ours.zones == (zone.zone,)
    assert ours.blocked
    past = replace(hop, scenario=hop.scenario.model_copy(update={"no_fly": (zone.zone,)}))
    ours.changed(GoOn(), past, 4.0, 3.5)
    ours.note(zone, 4.0, past)
    assert not ours.zones
    assert not ours.blocked
    assert not ours.brakes(1000.0)


def test_a_zone_has_the_time_at_which_it_was_given_first(hop: Plan) -> None:
    ours, zone = PlanChange(10.0, LEAD_S), ahead(hop)
    ours.note(zone, 3.0, hop)
    ours.ask(zone, "a test", 7.0, hop)
    assert ours.given == ((zone.zone, 3.0),)
    assert ours.instead == f"all brake at t = {ours.brakes_at_s:.1f} s: {ours.blocked}"
    assert ours.brakes(ours.brakes_at_s)
    assert ours.has_braked
    assert ours.instead == ""


@pytest.mark.parametrize(
    ("brakes", "instead"), [(False, "the old plan is flown on"), (True, "all brake as one, from t = 12.5 s on")]
)
def test_a_refusal_says_which_plan_is_flown(hop: Plan, brakes: bool, instead: str) -> None:
    """A brake that was made first leads no more into the zone; it does not lead on either."""
    ours, zone = PlanChange(10.0, LEAD_S, 0.5), ahead(hop)
    ours.ask(zone, "a test", 1.0, hop)
    past_s = hop.flight_s  # the flown plan does not enter the zone any more
    if brakes:
        ours.changed(Hold((zone.zone,)), hop, 12.5, past_s)
    assert ours.refused(zone, hop, past_s).startswith(instead)
