"""The choice at a low battery: properties of the rule, needs in closed form, and a recorded flight."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs.autopilots.columns import LandingProfile
from gcs.autopilots.traits import Autopilot
from gcs.flight.contingency.energy_choice import (
    Discharge,
    EnergyAdviser,
    EnergyOption,
    EnergySituation,
    Outcome,
    SafePoint,
    choose,
)
from gcs.mission.returns.rtl_altitudes import ReturnPlan, plan_returns
from gcs.plan.trajectory.energy import battery_model, energy_Wh
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.environment.terrain import ground_envelope_m
from gcs.types import Array
from tests.real_flights import Flight, plan_of, unpacked

RECORDED = "arducopter-4.5.6-mission"
needs = st.floats(0.0, 150.0) | st.just(math.inf)
fleets = st.lists(st.tuples(st.sampled_from(list(Outcome)), needs), min_size=1, max_size=7).map(
    lambda found: tuple(EnergyOption(outcome, "", need, need, need) for outcome, need in found)
)
percent = st.floats(0.0, 100.0)


@given(fleets, percent, percent)
def test_an_alternative_out_of_reach_is_never_chosen_while_one_is_within(
    found: tuple[EnergyOption, ...], left_pct: float, reserve_pct: float
) -> None:
    choice = choose(found, left_pct, reserve_pct)
    within = [one for one in choice.alternatives if one.reachable]
    assert all(one.need_pct + reserve_pct <= left_pct for one in within)
    assert choice.chosen.reachable == bool(within)
    if not within:
        assert choice.chosen.need_pct == min(one.need_pct for one in found)


@given(fleets, percent, percent, percent)
def test_more_charge_never_gives_a_shorter_choice(
    found: tuple[EnergyOption, ...], one_pct: float, other_pct: float, reserve_pct: float
) -> None:
    less, more = sorted((one_pct, other_pct))
    assert choose(found, less, reserve_pct).chosen.need_pct <= choose(found, more, reserve_pct).chosen.need_pct


@given(fleets, percent, percent)
def test_the_rest_of_the_plan_is_preferred(
    found: tuple[EnergyOption, ...], left_pct: float, reserve_pct: float
) -> None:
    choice = choose(found, left_pct, reserve_pct)
    if any(one.reachable and one.outcome is Outcome.FINISH for one in choice.alternatives):
        assert choice.chosen.outcome is Outcome.FINISH
    json.dumps(choice.data(), allow_nan=False)
    assert str(choice)


@given(st.floats(0.4, 5.0), st.integers(200, 900))
def test_the_measured_discharge_scales_the_needs(scale: float, endurance_s: int) -> None:
    """Whole percents, twice a second."""
    discharge = Discharge()
    for n in range(2 * int(0.6 * endurance_s / scale)):
        discharge.expect(0.5 / endurance_s)
        discharge.report(math.floor(100.0 * (1.0 - scale * 0.5 * n / endurance_s)) / 100.0)
    assert discharge.scale == pytest.approx(scale, rel=0.12)


def test_another_battery_reading_is_no_discharge() -> None:
    discharge = Discharge()
    for share in (1.0, 0.99, 0.18, 0.17):
        discharge.expect(0.01)
        discharge.report(share)
    assert discharge.scale == pytest.approx(1.0)
    assert Discharge().scale == 1.0


def test_a_gauge_that_stands_still_makes_no_need_smaller() -> None:
    """The battery of PX4's simulator falls to 51 % within a minute of arming, and stays there."""
    discharge = Discharge(prior=1.2)
    for _ in range(300):
        discharge.expect(0.001)
        discharge.report(0.51)
        assert discharge.scale > 0.4
    assert discharge.scale == pytest.approx(1.2)


@pytest.fixture(scope="module")
def field() -> tuple[Plan, ReturnPlan]:
    plan = plan_of(RECORDED)
    return plan, plan_returns(plan, Autopilot.ARDUPILOT)


@pytest.fixture(scope="module")
def straight(field: tuple[Plan, ReturnPlan]) -> EnergyAdviser:
    """Returns are straight."""
    plan, returns = field
    return EnergyAdviser(plan, battery_model(plan), returns)


def adviser(field: tuple[Plan, ReturnPlan], way_m: float | None = None) -> EnergyAdviser:
    plan, returns = field
    model = battery_model(plan)
    if way_m is None:
        return EnergyAdviser(plan, model, returns)
    return EnergyAdviser(plan, model, returns, lambda start, end: way_m)


def at(plan: Plan, t_s: float, left_pct: float, scale: float = 1.0, row: int = 0) -> EnergySituation:
    place = plan.states(np.array([t_s]))[row, 0]
    return EnergySituation(row, place[:3], place[3:6], left_pct, t_s, scale)


def test_the_model_is_the_plans_energy(field: tuple[Plan, ReturnPlan]) -> None:
    plan, _ = field
    taken_Wh, power = energy_Wh(plan), plan.scenario.vehicle.power
    assert taken_Wh is not None
    assert power is not None
    model = battery_model(plan)
    for row, taken in enumerate(taken_Wh / power.battery_Wh):
        assert model.planned_use(row, plan.t_start_s, plan.t_end_s) == pytest.approx(taken, rel=1e-6)
    assert model.planned_use(0, plan.t_start_s - 100.0, plan.t_start_s) == pytest.approx(100.0 * model.hover_per_s)
    assert model.use_per_s(0.0) == pytest.approx(model.hover_per_s)
    assert model.use_per_s(3.0, 1.5) > model.hover_per_s


def test_a_return_takes_the_time_of_its_parts(field: tuple[Plan, ReturnPlan]) -> None:
    """A way that is 40 m longer takes as much longer at the speed of the return, and a faster start longer to brake.

    Where there is nothing to brake, climb or fly, what is left is the wait, and a landing from there.
    """
    plan, returns = field
    near, far = (adviser(field, way_m) for way_m in (20.0, 60.0))
    here = at(plan, 100.0, 80.0)

    def returns_s(ours: EnergyAdviser, state: EnergySituation) -> float:
        return next(o.duration_s for o in ours.alternatives(state) if o.outcome is Outcome.RETURN)

    gained_s = returns_s(far, here) - returns_s(near, here)
    assert 2.0 < 40.0 / gained_s < 15.0  # the speed of the return, m/s
    lower = replace(here, place_ned_m=np.add(here.place_ned_m, [0.0, 0.0, 5.0]))
    assert returns_s(near, lower) > returns_s(near, here)  # it has to climb
    faster = replace(here, velocity_ned_mps=2.0 * here.velocity_ned_mps)
    assert returns_s(near, faster) > returns_s(near, here)
    above_ned_m = plan.pads_ned_m[0] - [0.0, 0.0, returns.altitudes_m[0] + 10.0]
    still = replace(here, place_ned_m=above_ned_m, velocity_ned_mps=np.zeros(3))
    lands_s = next(o.duration_s for o in near.alternatives(still) if o.outcome is Outcome.LAND)
    assert returns.speeds.wait_s > 0.0
    assert returns_s(adviser(field, 0.0), still) == pytest.approx(returns.speeds.wait_s + lands_s, abs=1.0)


def test_the_rest_of_the_plan_needs_its_own_energy(field: tuple[Plan, ReturnPlan]) -> None:
    plan, _ = field
    ours = adviser(field)
    finish = ours.alternatives(at(plan, 100.0, 50.0))[0]
    cruise = ours.model.planned_use(0, 100.0, plan.phase("landing").start_s)
    assert 100.0 * cruise < finish.need_pct < 100.0 * cruise + 5.0
    assert ours.alternatives(at(plan, 100.0, 50.0, scale=2.0))[0].need_pct == pytest.approx(2.0 * finish.need_pct)


@settings(max_examples=30, deadline=None)
@given(t_s=st.floats(-8.0, 227.0), left_pct=percent, scale=st.floats(0.5, 4.0), row=st.integers(0, 5))
def test_more_charge_more_discharge(
    field: tuple[Plan, ReturnPlan], straight: EnergyAdviser, t_s: float, left_pct: float, scale: float, row: int
) -> None:
    ours, plan = straight, field[0]
    choice = ours.decide(at(plan, t_s, left_pct, scale, row), 10.0)
    more = ours.decide(at(plan, t_s, min(left_pct + 7.0, 100.0), scale, row), 10.0)
    assert choice.chosen.need_pct <= more.chosen.need_pct
    hungrier = ours.decide(at(plan, t_s, left_pct, 1.3 * scale, row), 10.0)
    assert hungrier.chosen.duration_s <= choice.chosen.duration_s + 1e-6


@settings(max_examples=30, deadline=None)
@given(
    t_s=st.floats(228.0, 400.0),
    left_pct=percent,
    scale=st.floats(0.5, 6.0),
    row=st.integers(0, 5),
    off_m=st.tuples(st.floats(-5.0, 5.0), st.floats(-5.0, 5.0)),
)
def test_over_its_landing_point_in_the_landing_phase_it_lands_there(
    field: tuple[Plan, ReturnPlan],
    straight: EnergyAdviser,
    t_s: float,
    left_pct: float,
    scale: float,
    row: int,
    off_m: tuple[float, float],
) -> None:
    plan, _ = field
    place = plan.landing_points_ned_m[row] + np.array([*off_m, -25.0])
    for reserve_pct in (10.0, 4.0):
        now = EnergySituation(row, place, np.zeros(3), left_pct, t_s, scale)
        assert straight.decide(now, reserve_pct).chosen.outcome is Outcome.FINISH


def test_a_landing_needs_the_time_of_the_autopilots_own_descent(field: tuple[Plan, ReturnPlan]) -> None:
    """In closed form at constant speed; else that of the profile, from heights above the vehicle's own home."""
    plan, returns = field
    model, slow = battery_model(plan), LandingProfile((0.0,), (0.25,), 2.0)
    own = {plan.sysids[0]: slow, plan.sysids[1]: Autopilot.PX4.traits.landing.profile()}
    ours = EnergyAdviser(plan, model, returns, landings=own)
    for row, profile in enumerate((slow, own[plan.sysids[1]], Autopilot.ARDUPILOT.traits.landing.profile())):
        home_m = -float(plan.pads_ned_m[row, 2])
        place = np.array([*plan.pads_ned_m[row, :2], -(home_m + 25.0)])
        here = ours.alternatives(EnergySituation(row, place, np.zeros(3), 50.0, 60.0, 2.0))[-1]
        assert here.outcome is Outcome.LAND
        ground_m = float(ground_envelope_m(plan.scenario.terrain, place[0], place[1])) - home_m
        assert here.duration_s == pytest.approx(profile.duration_s(25.0, ground_m))
        assert here.need_pct == pytest.approx(200.0 * here.duration_s * model.hover_per_s)
        if profile is slow:
            assert here.duration_s == pytest.approx(2.0 + (25.0 - ground_m) / 0.25)


def test_a_way_round_zones_counts_with_its_length(field: tuple[Plan, ReturnPlan]) -> None:
    plan, _ = field
    direct = adviser(field).alternatives(at(plan, 60.0, 50.0))
    round_about = adviser(field, 2000.0).alternatives(at(plan, 60.0, 50.0))
    by_outcome = {one.outcome: one for one in round_about}
    assert by_outcome[Outcome.RETURN].distance_m == 2000.0
    assert by_outcome[Outcome.RETURN].need_pct > {one.outcome: one for one in direct}[Outcome.RETURN].need_pct
    nowhere = adviser(field, math.inf).decide(at(plan, 60.0, 12.0), 10.0)
    assert nowhere.chosen.outcome is Outcome.LAND
    assert nowhere.data()["alternatives"][1]["need_pct"] is None


def test_a_free_landing_point_of_another_vehicle_may_be_the_nearest(field: tuple[Plan, ReturnPlan]) -> None:
    plan, _ = field
    now = at(plan, 60.0, 15.0)
    point = SafePoint("landing point of vehicle 4", now.place_ned_m + np.array([20.0, 0.0, 24.0]))
    situation = EnergySituation(0, now.place_ned_m, now.velocity_ned_mps, 16.0, 60.0, points=(point,))
    choice = adviser(field).decide(situation, 10.0)
    assert choice.chosen.outcome is Outcome.NEAREST
    assert choice.chosen.target == "landing point of vehicle 4"


def reached(flight: Flight, sysid: int, percent_left: int) -> tuple[float, Array, Discharge]:
    """Plan time, place and discharge at the instant when a recorded vehicle reported this charge first."""
    plan, discharge, place, before_s = flight.plan, Discharge(), np.zeros(3), math.nan
    row, model = plan.sysids.index(sysid), battery_model(plan)
    for frame, unix_s in zip(flight.log.frames, flight.log.unix_s.tolist(), strict=True):
        message = frame.message
        if message is None or frame.sysid != sysid:
            continue
        fields, t_s = message.fields, unix_s - flight.t0_unix_s
        if message.name == "LOCAL_POSITION_NED":
            place = np.array([fields["x"], fields["y"], fields["z"]]) + plan.pads_ned_m[row]
        elif message.name == "SYS_STATUS":
            if place[2] < -3.0 and not math.isnan(before_s):
                discharge.expect(model.planned_use(row, max(before_s, 0.0), t_s) if t_s > 0 else 0.0)
                discharge.expect(model.hover_per_s * max(min(t_s, 0.0) - before_s, 0.0))
            before_s = t_s
            discharge.report(fields["battery_remaining"] / 100.0)
            if fields["battery_remaining"] <= percent_left:
                return t_s, place, discharge
    raise AssertionError("never")


def test_recorded_vehicles_over_their_landing_points_land_there(field: tuple[Plan, ReturnPlan], tmp_path: Path) -> None:
    """They were called back over 700 m at 20 %, and put down on the way at 10 %."""
    flight = Flight(unpacked(RECORDED, tmp_path))
    ours = adviser(field)
    for row, sysid in enumerate(flight.plan.sysids):
        t_s, place, discharge = reached(flight, sysid, 20)
        assert discharge.scale == pytest.approx(2.8, rel=0.1)  # the recorded battery was smaller than the scenario's
        now = EnergySituation(row, place, np.zeros(3), 20.0, t_s, discharge.scale)
        at_20 = ours.decide(now, 10.0)
        assert at_20.chosen.outcome is Outcome.FINISH
        assert at_20.chosen.need_pct < 11.0
        assert {one.outcome: one for one in ours.alternatives(now)}[Outcome.RETURN].need_pct > 60.0
        later_s, _, discharge = reached(flight, sysid, 10)
        where_it_would_be = EnergySituation(row, place, np.zeros(3), 10.0, later_s, discharge.scale)
        assert ours.decide(where_it_would_be, 4.0).chosen.outcome is Outcome.FINISH
