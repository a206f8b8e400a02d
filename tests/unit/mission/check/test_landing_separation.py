"""Separation while the autopilots land their vehicles: closed forms, a fine grid of times, and whole plans."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs.autopilots.columns import LandingProfile
from gcs.autopilots.traits import Autopilot
from gcs.errors import VerificationError
from gcs.mission.check import landing_separation as module
from gcs.mission.check.findings import Rule
from gcs.mission.check.fleet_check import check_fleet
from gcs.mission.check.landing_separation import (
    LandingDescent,
    closest_in_descent,
    planned_descents,
    refuse_close_landing,
)
from gcs.mission.export.export import export
from gcs.mission.flight_limits import FlightLimits, Surroundings
from gcs.mission.formats.mission_file import MissionFile
from gcs.mission.predicted.planned_flight import fly
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.verify import verify
from tests.unit.mission.fleets import ORIGIN, at, mission, speed

AUTOPILOTS = st.sampled_from(Autopilot)


def steady(
    mps: float, over_m: tuple[float, float], from_m: float, ground_m: float, home_m: float = 0.0
) -> LandingDescent:
    return LandingDescent.of(LandingProfile((0.0,), (mps,)), over_m, from_m, ground_m, home_m)


def test_one_above_the_flank_of_the_other_with_equal_speeds_keeps_its_distance() -> None:
    """3 m beside and 4 m above, to ground that is 4 m higher."""
    pair = [steady(1.5, (0.0, 0.0), 30.0, 0.0), steady(1.5, (3.0, 0.0), 34.0, 4.0)]
    closest = closest_in_descent(pair, 6.0)
    assert closest is not None
    assert closest.distance_m == pytest.approx(5.0)
    assert closest_in_descent(pair, 2.9) is None


def test_other_heights_above_the_same_step_of_ground_are_nearest_at_the_end() -> None:
    """From one height the vehicle over the upper step is down first; the other one falls on below it."""
    closest = closest_in_descent([steady(1.0, (0.0, 0.0), 30.0, 0.0), steady(1.0, (3.0, 0.0), 30.0, 4.0)], 6.0)
    assert closest is not None
    assert closest.distance_m == pytest.approx(3.0)
    assert closest.t_s == 0.0


def test_equal_speeds_pass_where_the_real_ones_fail() -> None:
    """The upper one, at 1.5 m/s, passes the lower one, at 0.7 m/s: after 8 m / 0.8 m/s they are level."""
    lower, upper = (0.0, 0.0), (3.0, 0.0)
    planned = [steady(1.0, lower, 30.0, 0.0), steady(1.0, upper, 38.0, 8.0)]
    real = [steady(0.7, lower, 30.0, 0.0), steady(1.5, upper, 38.0, 8.0)]
    distances = [closest_in_descent(pair, 5.0) for pair in (planned, real)]
    assert distances[0] is not None
    assert distances[0].distance_m == pytest.approx(np.hypot(3.0, 8.0))
    assert distances[1] is not None
    assert distances[1].distance_m == pytest.approx(3.0)
    assert distances[1].t_s <= 10.0


def test_an_order_that_comes_later_brings_them_nearer() -> None:
    """The upper one begins up to 2 s before the lower one: 3 m of 8 m are gone."""
    pair = [steady(1.5, (0.0, 0.0), 30.0, 0.0), steady(1.5, (3.0, 0.0), 38.0, 8.0)]
    closest = closest_in_descent(pair, 9.0, (0.0, 2.0))
    assert closest is not None
    assert closest.distance_m == pytest.approx(np.hypot(3.0, 5.0))


@given(
    st.lists(
        st.tuples(AUTOPILOTS, st.floats(5.0, 60.0), st.floats(-10.0, 4.0), st.floats(-5.0, 5.0), st.floats(0.0, 4.0)),
        min_size=2,
        max_size=4,
    ),
    st.floats(0.0, 3.0),
)
def test_no_instant_of_a_fine_grid_is_nearer(
    rows: list[tuple[Autopilot, float, float, float, float]], apart_s: float
) -> None:
    descents = [
        LandingDescent.of(known.traits.landing.profile(), (north_m, 0.0), from_m, ground_m, home_m)
        for known, from_m, ground_m, home_m, north_m in rows
    ]
    closest = closest_in_descent(descents, 100.0, (apart_s,) * len(rows))
    assert closest is not None
    least_m, pair_m = np.inf, np.inf
    for i, one in enumerate(descents):
        for j, other in enumerate(descents[:i]):
            beside_m = one.over_m[0] - other.over_m[0]
            for shift_s in np.linspace(-apart_s, apart_s, 9):
                t_s = np.linspace(0.0, max(one.t_s[-1], other.t_s[-1] - shift_s), 700)
                apart_m = np.hypot(beside_m, one.at(t_s) - other.at(t_s + shift_s)).min()
                least_m = min(least_m, float(apart_m))
                if (j, i) == closest.pair:
                    pair_m = min(pair_m, float(apart_m))
    assert closest.distance_m <= least_m + 1e-9
    # Between two instants and two shifts of the grid vehicles come nearer by less than this.
    assert pair_m - closest.distance_m < 2.0 * (apart_s / 8 + 0.15)


@given(AUTOPILOTS, st.floats(12.0, 60.0), st.floats(-5.0, 5.0))
def test_a_mission_lands_as_its_autopilot_does(known: Autopilot, up_m: float, ground_m: float) -> None:
    step = Surroundings(ORIGIN, lambda north, east: np.where(north > 20.0, ground_m, 0.0) + 0.0 * east)
    items = (at(22, 0, 0, up_m), at(16, 40, 0, up_m), at(21, 40, 0, 0))
    flight = fly(mission(items, firmware=known), step)
    profile = known.traits.landing.profile()
    t_s = np.linspace(0.0, flight.ends_s - flight.down_s, 50)
    flown_m = -np.interp(flight.down_s + t_s, flight.t_s, flight.ned_m[:, 2])
    np.testing.assert_allclose(flown_m, profile.height_m(up_m, ground_m, t_s), atol=0.03)
    assert flight.ends_s - flight.down_s == pytest.approx(profile.duration_s(up_m, ground_m), abs=0.1)


def test_a_mission_lands_with_the_parameters_of_its_vehicle() -> None:
    items = (at(22, 0, 0, 30), at(21, 0, 0, 0))
    fast = replace(mission(items), parameters={"LAND_SPEED": 100.0, "WPNAV_SPEED_DN": 100.0})
    flat = Surroundings(ORIGIN)
    assert fly(fast, flat).ends_s - fly(fast, flat).down_s == pytest.approx(0.5 + 30.0 / 1.0, abs=0.02)


CLIFF = Surroundings(ORIGIN, lambda north, east: np.where(east > 2.0, 8.0, 0.0) + 0.0 * north)


def on_the_cliff(*autopilots: Autopilot) -> list[MissionFile]:
    """One lands below an edge of 8 m, the other one 3.5 m beside it above the edge. They arrive from two sides."""
    rows = zip(autopilots, (0.0, 3.5), (30.0, 38.0), (-40.0, 40.0), strict=True)
    return [
        mission(
            [at(22, from_m, east_m, up_m), speed(5.0), at(16, 0, east_m, up_m), at(21, 0, east_m, 0)],
            name=f"{known.key}{n}.plan",
            firmware=known,
            home=(from_m, east_m, 0.0),
        )
        for n, (known, east_m, up_m, from_m) in enumerate(rows)
    ]


def test_a_mixed_fleet_fails_where_one_autopilot_passes() -> None:
    limits = FlightLimits(4.2)
    same = check_fleet(on_the_cliff(Autopilot.ARDUPILOT, Autopilot.ARDUPILOT), CLIFF, limits)
    assert [f for f in same.errors if f.rule is Rule.SEPARATION] == []
    mixed = check_fleet(on_the_cliff(Autopilot.ARDUPILOT, Autopilot.PX4), CLIFF, limits)
    (found,) = [f for f in mixed.errors if f.rule is Rule.SEPARATION]
    assert "m from the vehicle of px41.plan; at least 4.2 m required" in found.message
    assert found.item == 4  # the landing
    assert same.closest is not None
    assert mixed.closest is not None
    assert mixed.closest.distance_m < 4.2 <= same.closest.distance_m


def test_missions_that_may_end_seconds_apart_need_more_height_between_their_landings(
    simulation1_plan: Plan, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Both sink at 1 m/s, one 8 m above the other and 0.1 m beside it: 8 s apart they meet."""
    t_s, sinks_m = np.array([0.0, 30.0]), np.array([0.0, -30.0])
    descents = tuple(LandingDescent((0.0, east_m), t_s, up_m + sinks_m) for east_m, up_m in ((0.0, 30.0), (0.1, 38.0)))
    monkeypatch.setattr(module, "planned_descents", lambda *_: descents)
    each = (Autopilot.ARDUPILOT,) * 2
    refuse_close_landing(simulation1_plan, each, [{}, {}], 3.5)
    with pytest.raises(VerificationError, match=r"may begin 8.02 s apart\."):
        refuse_close_landing(simulation1_plan, each, [{}, {}], 4.0)


def close(plan: Plan, beside_m: float) -> Plan:
    """The plan under a judge who requires more than the horizontal distance of its landing points."""
    judge = plan.scenario.judge.model_copy(update={"separation_min_m": beside_m})
    return replace(plan, scenario=plan.scenario.model_copy(update={"judge": judge}))


@pytest.mark.slow
def test_a_stream_that_ends_in_a_close_landing_is_not_written(simulation1_plan: Plan, tmp_path: Path) -> None:
    points = simulation1_plan.landing_points_ned_m[:, :2]
    first, second = sorted(
        ((i, j) for i in range(len(points)) for j in range(i)), key=lambda p: np.hypot(*(points[p[0]] - points[p[1]]))
    )[0][::-1]
    required_m = float(np.hypot(*(points[first] - points[second]))) + 0.1
    plan = close(simulation1_plan, required_m)
    sysids = sorted(plan.sysids[row] for row in (first, second))
    flown = verify(simulation1_plan)  # the pads of the changed plan are as close as its landing points
    with pytest.raises(VerificationError) as caught:
        export(plan, tmp_path / "out", formats=["setpoints"], report=flown)
    message = caught.value.message
    assert f"vehicles {sysids[0]} and {sysids[1]} may come within {required_m - 0.1:.2f} m" in message
    assert f"({required_m:g} m required)" in message
    assert f"at {plan.phase('landing').start_s:.1f} s" <= message[message.index("at ") :]
    assert "apart horizontally" in caught.value.hint
    assert not (tmp_path / "out").exists()
    export(close(simulation1_plan, required_m - 0.2), tmp_path / "out", formats=["setpoints"])


def test_a_plan_of_both_autopilots_has_the_descents_of_both(simulation1_plan: Plan) -> None:
    each = tuple(list(Autopilot)[row % 2] for row in range(len(simulation1_plan.sysids)))
    descents = planned_descents(simulation1_plan, each, [{}] * len(each))
    over = simulation1_plan.states(np.array([simulation1_plan.phase("landing").start_s]))[:, 0]
    for row, (known, descent) in enumerate(zip(each, descents, strict=True)):
        home_m, ground_m = -simulation1_plan.pads_ned_m[row, 2], -simulation1_plan.landing_points_ned_m[row, 2]
        duration_s = known.traits.landing.profile().duration_s(-over[row, 2] - home_m, ground_m - home_m)
        assert descent.t_s[-1] == pytest.approx(duration_s)
        assert (descent.up_m[0], descent.up_m[-1]) == pytest.approx((-over[row, 2], ground_m))
        assert descent.over_m == pytest.approx(over[row, :2], abs=1e-3)
    refuse_close_landing(simulation1_plan, each, [{}] * len(each))
