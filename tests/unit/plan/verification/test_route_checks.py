"""The verifier on routes: points on the leader's track pass, and each kind of wrong point fails by number and name."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import PPoly

from gcs.physics.states import ATTITUDE, VELOCITY
from gcs.plan.trajectory.leg_lines import NO_LIMITS, LegLimits
from gcs.plan.trajectory.phases import Phase
from gcs.plan.trajectory.plan import Plan
from gcs.plan.trajectory.trajectory import Trajectory
from gcs.plan.verification.route_checks import route_checks
from gcs.plan.verification.verify import verify
from gcs.scenario.schema.scenario import Mountains, Terrain
from tests.unit.plan.routed import with_route

AT_S = (4.0, 10.0, 15.0)


def failed(plan: Plan) -> list[str]:
    return sorted(check.name for check in route_checks(plan) if not check.ok)


def aside(plan: Plan, metres: float, **keys: Any) -> Plan:
    """The second point is moved to the east, and has other keys."""
    route = list(plan.scenario.route)
    north, east, up = route[1].position_m
    route[1] = route[1].model_copy(update={"position_m": (north, east + metres, up), **keys})
    return replace(plan, scenario=plan.scenario.model_copy(update={"route": tuple(route)}))


@pytest.fixture(scope="module")
def routed(meadow_plan: Plan) -> Plan:
    """Through three points of the track, with speed and heading as they are flown there."""
    state = meadow_plan.leader_trajectory.state(10.0)
    speed_mps, heading_deg = np.linalg.norm(state[VELOCITY]), np.degrees(state[ATTITUDE][2])
    middle = {"name": "gate", "at_s": 10.0, "speed_mps": speed_mps, "heading_deg": heading_deg - 360.0}
    return with_route(meadow_plan, {4.0: {"after_s": 3.0, "by_s": 4.5}, 10.0: middle, 15.0: {}})


def test_a_route_that_is_flown_is_proved(routed: Plan) -> None:
    report = verify(routed)
    assert report.ok, [str(check) for check in report.failures]
    found = {check.name.partition(": ")[2]: check for check in report.checks if check.name.startswith("route point")}
    assert set(found) == {"order", "distance", "time", "speed", "heading"}
    assert {check.verdict for check in found.values()} == {"proved"}
    assert found["speed"].name == 'route point 2 ("gate"): speed'
    assert found["order"].worst == pytest.approx(4.0)  # from T0 to the first point


@pytest.mark.parametrize(
    ("metres", "keys", "said"),
    [
        (0.9e-3, {}, ["distance"]),
        (0.7e-3, {}, []),
        (2.0, {"radius_m": 2.001}, []),
        (2.0, {"radius_m": 1.998}, ["distance"]),
        (0.0, {"at_s": 10.01}, ["time"]),
        (0.0, {"at_s": None, "after_s": 10.5}, ["time"]),
        (0.0, {"at_s": None, "by_s": 9.5}, ["time"]),
        (0.0, {"speed_mps": 0.5}, ["speed"]),
        (0.0, {"heading_deg": 5.0}, ["heading"]),
        (3.0, {"at_s": 2.0, "heading_deg": 90.0}, ["distance", "heading", "time"]),
    ],
)
def test_a_point_that_is_not_met_is_named(routed: Plan, metres: float, keys: dict[str, Any], said: list[str]) -> None:
    assert failed(aside(routed, metres, **keys)) == [f'route point 2 ("gate"): {kind}' for kind in said]


@pytest.mark.parametrize("share", [0.9, 1.1])
@pytest.mark.parametrize(
    ("key", "tolerance", "kind"),
    [
        ("at_s", 1e-3, "time"),
        ("at_s", -1e-3, "time"),
        ("after_s", 1e-3, "time"),
        ("by_s", -1e-3, "time"),
        ("speed_mps", 1e-3, "speed"),
        ("speed_mps", -1e-3, "speed"),
        ("heading_deg", 0.01, "heading"),
        ("heading_deg", -0.01, "heading"),
    ],
)
def test_a_point_may_be_missed_by_its_tolerance_and_no_more(
    routed: Plan, key: str, tolerance: float, kind: str, share: float
) -> None:
    met = routed.scenario.route[1].model_dump() | {"after_s": 10.0, "by_s": 10.0}
    found = failed(aside(routed, 0.0, **({"at_s": None} | {key: met[key] + share * tolerance})))
    assert found == ([] if share < 1.0 else [f'route point 2 ("gate"): {kind}'])


def test_the_margin_of_a_missed_point_is_its_distance(routed: Plan) -> None:
    check = next(c for c in route_checks(aside(routed, 3.0, radius_m=1.0)) if c.name.endswith("distance"))
    assert (check.worst, check.t_s, check.sysid) == (pytest.approx(-2.0), 10.0, routed.sysids[routed.leader])


def test_points_out_of_order_and_missing_times_fail(routed: Plan) -> None:
    swapped = replace(routed, route_s=(10.0, 4.0, 15.0))
    assert "route point 1: order" in failed(swapped)
    assert failed(replace(routed, route_s=(4.0, 10.0))) == ["route points passed"]
    assert "route points passed" in {check.name for check in verify(replace(routed, route_s=())).failures}
    late = replace(routed, route_s=(4.0, 10.0, 20.5))
    assert "route point 3: order" in failed(late)


def hovering(plan: Plan, wobble_m: float) -> Plan:
    """North at 1 m/s for 10 s, a hold of 4 s that moves by up to `wobble_m` to the east, and on."""
    joints = np.array([0.0, 10.0, 14.0, 20.0])
    state = np.zeros((5, 3, 12))
    state[-1, :, 0], state[-2, :, 0] = (0.0, 10.0, 10.0), (1.0, 0.0, 1.0)
    state[-1, :, 3] = (1.0, 0.0, 1.0)
    # 4 s (4 - s) / 16 is 1 in the middle, and 0 at both ends
    state[-2, 1, 1], state[-3, 1, 1] = wobble_m, -wobble_m / 4.0
    state[-1, 1, 4], state[-2, 1, 4] = wobble_m, -wobble_m / 2.0
    motion = Trajectory(PPoly(state, joints), PPoly(np.zeros((1, 3, 4)), joints))
    held = replace(plan, leader_trajectory=motion)
    return with_route(held, {5.0: {}, 10.0: {"hold_s": 4.0, "name": "look"}})


@pytest.mark.parametrize(
    ("wobble_m", "said"),
    [
        (0.0, []),
        (0.7e-3, []),
        (0.9e-3, ["distance"]),
        (5e-3, ["distance", "speed"]),
    ],
)
def test_a_hold_is_bounded_at_every_instant(meadow_plan: Plan, wobble_m: float, said: list[str]) -> None:
    plan = hovering(meadow_plan, wobble_m)
    assert failed(plan) == [f'route point 2 ("look"): {kind} during the hold' for kind in said]
    held = next(c for c in route_checks(plan) if c.name.endswith("distance during the hold"))
    assert held.proved is not None
    assert -held.proved >= wobble_m >= -held.worst
    assert -held.proved == pytest.approx(wobble_m, rel=0.02, abs=1e-9)


def test_a_hold_that_is_left_too_early_fails(meadow_plan: Plan) -> None:
    plan = aside(hovering(meadow_plan, 0.0), 0.0, hold_s=4.5)
    assert failed(plan) == [f'route point 2 ("look"): {kind} during the hold' for kind in ("distance", "speed")]


def test_a_plan_that_begins_in_the_air_answers_for_the_points_ahead(meadow_plan: Plan, routed: Plan) -> None:
    rest = replace(routed, route_s=AT_S[1:], begin_state=(0.0,) * 12)
    assert failed(rest) == []
    assert failed(replace(rest, route_s=())) == []
    assert failed(replace(rest, route_s=(10.0, 11.0))) == ["route point 3: distance"]
    in_a_hold = hovering(meadow_plan, 0.0)
    phases = (Phase("mission", 12.0, 20.0), *in_a_hold.phases[-2:])
    assert failed(replace(in_a_hold, phases=phases, route_s=(10.0,), begin_state=(0.0,) * 12)) == []
    early = aside(in_a_hold, 0.0, at_s=9.0)  # it arrived before this plan
    assert failed(replace(early, phases=phases, route_s=(10.0,), begin_state=(0.0,) * 12)) == []
    assert failed(early) == ['route point 2 ("look"): time']
    over = replace(in_a_hold, phases=phases, route_s=(7.0,), begin_state=(0.0,) * 12)
    assert 'route point 2 ("look"): order' in failed(over)


@pytest.mark.parametrize(
    ("limits", "said"),
    [
        (LegLimits(1.5, 50.0), ["leg 2: distance beside the line"]),
        (LegLimits(2.1, 50.0), []),
        (LegLimits(50.0, 1e-4), ["leg 2: distance above or below the line"]),
        (LegLimits(50.0, 50.0, 1e-4), ["leg 2: yaw"]),
        (LegLimits(50.0, 50.0, 3.0), []),
    ],
)
def test_who_leaves_the_line_fails_by_leg(meadow_plan: Plan, limits: LegLimits, said: list[str]) -> None:
    """Leg 2 leads to a point 2 m beside the track, which is passed within 2.1 m."""
    beside = aside(with_route(meadow_plan, {4.0: {}, 10.0: {}}), 2.0, radius_m=2.1)
    assert failed(replace(beside, leg_limits=(NO_LIMITS, limits, NO_LIMITS))) == said
    assert failed(beside) == []  # an older plan says nothing of its legs


def test_what_the_scenario_says_of_a_leg_no_plan_gives_away(meadow_plan: Plan) -> None:
    beside = aside(with_route(meadow_plan, {4.0: {}, 10.0: {}}), 2.0, radius_m=2.1, corridor_m=1.5)
    assert failed(replace(beside, leg_limits=(NO_LIMITS,) * 3)) == ["leg 2: distance beside the line"]


@pytest.mark.parametrize("axis", [0, 2])
@pytest.mark.parametrize(("limit_m", "said"), [(1.9, ["leg 1: distance beyond its ends"]), (2.1, [])])
def test_who_flies_past_the_end_of_a_leg_and_comes_back_fails(
    meadow_plan: Plan, axis: int, limit_m: float, said: list[str]
) -> None:
    """By 2 m along the line, north or straight up: beside it the leader is nowhere."""
    state = np.zeros((2, 3, 12))
    sign = 1.0 if axis == 0 else -1.0
    state[1, :, 2] = -8.0
    state[0, :, axis] = sign * np.array([1.2, -1.0, 1.25])
    state[1, :, axis] += sign * np.array([0.0, 12.0, 10.0])
    times_s = [0.0, 10.0, 12.0, 20.0]
    motion = Trajectory(PPoly(state, times_s), PPoly(np.zeros((1, 3, 4)), times_s))
    start, end = (motion.state(t_s)[:3] * [1.0, 1.0, -1.0] for t_s in (0.0, 20.0))
    plan = with_route(replace(meadow_plan, leader_trajectory=motion), {12.0: {}})
    ends = {
        "start": plan.scenario.start.model_copy(update={"position_m": tuple(start.tolist())}),
        "end": plan.scenario.end.model_copy(update={"position_m": tuple(end.tolist())}),
    }
    limits = LegLimits(limit_m, 50.0) if axis == 0 else LegLimits(50.0, limit_m)
    drawn = replace(plan, scenario=plan.scenario.model_copy(update=ends), leg_limits=(limits, limits))
    assert [name for name in failed(drawn) if name.startswith("leg")] == said


def over_a_bump(plan: Plan, height_m: float, spread_m: float) -> Plan:
    """Level at 8 m above height 0 for 20 s at 1 m/s, over a bump at 10.3 m, drawn 8 m above the ground."""
    state = np.zeros((2, 1, 12))
    state[0, 0, 0], state[1, 0, 2], state[1, 0, 3] = 1.0, -8.0, 1.0
    motion = Trajectory(PPoly(state, [0.0, 20.0]), PPoly(np.zeros((1, 1, 4)), [0.0, 20.0]))
    level = with_route(replace(plan, leader_trajectory=motion), {5.0: {"height_above_ground_m": 8.0}})
    bump = Mountains(
        north_m=(10.3,), east_m=(0.0,), height_m=(height_m,), spread_north_m=(spread_m,), spread_east_m=(1.0,)
    )
    ends = {
        name: end.model_copy(update={"position_m": place, "height_above_ground_m": 8.0})
        for name, end, place in (
            ("start", level.scenario.start, (0.0, 0.0, 8.0)), ("end", level.scenario.end, (20.0, 0.0, 8.0)),
        )
    }  # fmt: skip
    scenario = level.scenario.model_copy(update=ends | {"terrain": Terrain(mountains=bump)})
    return replace(level, scenario=scenario, leg_limits=(LegLimits(1.0, 0.5), LegLimits(1.0, 0.5)))


@pytest.mark.parametrize("spread_m", [1.0, 0.2, 0.01])
@pytest.mark.parametrize(("height_m", "said"), [(0.49, []), (0.51, ["leg 2: distance above or below the line"])])
def test_a_bump_that_no_sample_meets_is_found(
    meadow_plan: Plan, spread_m: float, height_m: float, said: list[str]
) -> None:
    plan = over_a_bump(meadow_plan, height_m, spread_m)
    assert failed(plan) == said
    check = next(c for c in route_checks(plan) if c.name == "leg 2: distance above or below the line")
    assert check.proved is not None
    assert check.proved <= 0.5 - height_m <= check.worst + 1e-6
    assert check.proved == pytest.approx(0.5 - height_m, abs=2.5e-3)
