"""By how much waypoints are raised over a step in the ground, and what is left to no-fly zones."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import PPoly

from gcs.autopilots.waypoint_models.predict import Prediction
from gcs.mission.flight_limits import limits_of
from gcs.mission.waypoints import arrival_times
from gcs.mission.waypoints.arrival_times import TerrainRaise
from gcs.mission.waypoints.leg_profile import LegProfile
from gcs.mission.waypoints.placement import short_of_m
from gcs.mission.waypoints.speed_correction import Corrected
from gcs.plan.formation.shape import Shape, rigid
from gcs.plan.trajectory.phases import phases_of
from gcs.plan.trajectory.plan import Plan
from gcs.plan.trajectory.trajectory import Trajectory
from gcs.scenario.schema.scenario import Scenario, Terrain
from gcs.types import Array
from tests.unit.plan.problems import alone, meadow

WALL_M = 6.0  # of a ridge across the way at north = 50 m, which is gone a few metres beside it
RIDGE = {"north_m": [50.0], "east_m": [0.0], "height_m": [WALL_M], "spread_north_m": [4.0], "spread_east_m": [4000.0]}


@dataclass
class Model:
    """Stands for the autopilot: it flies every leg straight, at 5 m/s, and tells each way that it was given."""

    step_s: float = 0.1

    def predict(self, _: Any, orders: Any) -> Prediction:
        return flown(np.array([orders.start_ned_m, *orders.waypoints_ned_m]))


def flown(points_ned_m: Array, step_s: float = 0.1) -> Prediction:
    lengths = np.linalg.norm(np.diff(points_ned_m[:, :2], axis=0), axis=1)
    ends_s = np.concatenate([[0.0], np.cumsum(lengths)]) / 5.0
    t_s = np.arange(0.0, ends_s[-1] + 0.5 * step_s, step_s)
    places = np.stack([np.interp(t_s, ends_s, points_ned_m[:, axis]) for axis in range(3)], axis=1)
    return Prediction(t_s, places, np.gradient(places, t_s, axis=0), ends_s[1:], ends_s[1:], np.ones(len(ends_s) - 1))


def plan_of(scenario: Scenario, shape: Shape | None = None) -> Plan:
    phases = phases_of(scenario)
    joints = np.array([phases[0].start_s, phases[-1].end_s])
    still = Trajectory(PPoly(np.zeros((1, 1, 12)), joints), PPoly(np.zeros((1, 1, 4)), joints))
    count = len(scenario.formation.vehicle)
    return Plan(scenario, still, rigid(np.zeros((count, 3)), *joints) if shape is None else shape, phases, 0.0)


def ridge(simulation1: Scenario, **tables: Any) -> Scenario:
    hills: dict[str, Any] = {"terrain": {"ripple": None, "mountains": RIDGE}, "time": {"flight_s": 60.0}}
    return meadow(alone(simulation1), **hills | {"limits": {"clearance_min_m": 1.0}} | tables)


def raised(
    monkeypatch: pytest.MonkeyPatch,
    plan: Plan,
    points_ned_m: Array,
    legs: list[int],
    count: int,
    row: int | None = None,
) -> tuple[TerrainRaise, float]:
    """By a flight through points (N + 1, 3), whose legs have these numbers of `count`."""
    monkeypatch.setattr(arrival_times, "predict", Model().predict)
    profile = LegProfile(points_ned_m, np.zeros((len(legs), 3)), np.zeros(len(legs)), 0.5, np.full(len(legs), 8.0))
    made = TerrainRaise(plan, np.linspace(10.0, 40.0, count + 1))
    found = Corrected(np.full(len(legs), 5.0), 0.0, flown(points_ned_m), np.zeros(len(legs)), None)  # type: ignore[arg-type]
    return made, made.raise_over_ground(None, profile, legs, found, row)  # type: ignore[arg-type]


def along(*north_and_up_m: tuple[float, float]) -> Array:
    return np.array([[north, 0.0, -up] for north, up in north_and_up_m])


def test_ends_of_a_leg_over_the_ridge_are_raised_until_it_is_clear(
    simulation1: Scenario, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A level leg 1 m above the crest where 1 m is required: as far as the ridge's flanks and 2 cm ask, and no more."""
    scenario = ridge(simulation1)
    required_m = limits_of(scenario).clearance_m + 0.02
    points = along((0.0, 9.0), (30.0, 5.5), (70.0, 5.5), (100.0, 9.0))
    made, too_near_m = raised(monkeypatch, plan_of(scenario), points, [0, 1, 2], 3)
    by_m = made.by_waypoint_m
    assert too_near_m == 0.0  # there is no zone
    assert by_m[0] == by_m[-1] == 0.0
    assert by_m[1] == by_m[2]
    assert np.array_equal(by_m, np.round(by_m * 64.0) / 64.0)
    after = points.copy()
    after[:, 2] -= by_m

    def short_m(way: Array) -> float:
        return float(short_of_m(scenario.terrain, flown(way).position_ned_m[None, ::4], required_m).max())

    assert short_m(points) > 1.0
    assert short_m(after) <= 0.0
    lower = after + np.array([[0, 0, 0], [0, 0, 0.1], [0, 0, 0.1], [0, 0, 0]])
    assert short_m(lower) > 0.0


def test_waypoints_beside_the_leg_over_the_ridge_stay_where_they_are(
    simulation1: Scenario, monkeypatch: pytest.MonkeyPatch
) -> None:
    points = along((0.0, 9.0), (15.0, 9.0), (30.0, 5.5), (70.0, 5.5), (85.0, 9.0), (100.0, 9.0))
    made, _ = raised(monkeypatch, plan_of(ridge(simulation1)), points, [0, 1, 2, 3, 4], 5)
    assert (made.by_waypoint_m > 0.0).tolist() == [False, False, True, True, False, False]


def test_nothing_is_raised_over_ground_that_is_clear_and_no_first_or_last_waypoint(
    simulation1: Scenario, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan = plan_of(ridge(simulation1))
    high, _ = raised(monkeypatch, plan, along((0.0, 9.0), (50.0, 8.5), (100.0, 9.0)), [0, 1], 2)
    assert not high.by_waypoint_m.any()
    only, _ = raised(monkeypatch, plan, along((0.0, 5.0), (100.0, 5.0)), [0], 1)
    assert not only.by_waypoint_m.any()


def test_both_ends_of_a_rest_are_raised_alike(simulation1: Scenario, monkeypatch: pytest.MonkeyPatch) -> None:
    """Legs 0, 2 and 3 of four; at the second waypoint it rests, and the third one is the same place."""
    points = along((0.0, 9.0), (30.0, 6.0), (60.0, 6.0), (100.0, 9.0))
    made, _ = raised(monkeypatch, plan_of(ridge(simulation1)), points, [0, 2, 3], 4)
    assert made.by_waypoint_m[1] == made.by_waypoint_m[2] > 0.0
    assert made.by_waypoint_m[3] > 0.0
    assert made.by_waypoint_m[4] == 0.0


def three(simulation1: Scenario, offsets_m: list[list[float]], **tables: Any) -> Plan:
    """The leader is the second vehicle."""
    vehicles = [
        {"sysid": number + 1, "position_m": [n + 5.0, e + 20.0, u + 5.0]} for number, (n, e, u) in enumerate(offsets_m)
    ]
    whole: dict[str, Any] = {"formation": {"vehicle": vehicles, "leader": 2}, "time": {"flight_s": 60.0}}
    scenario = meadow(simulation1, **whole | {"limits": {"clearance_min_m": 1.0}} | tables)
    offsets = (np.array(offsets_m) - offsets_m[1]) * [1.0, 1.0, -1.0]
    phases = phases_of(scenario)
    return plan_of(scenario, rigid(offsets, phases[0].start_s, phases[-1].end_s))


def test_the_lowest_vehicle_counts_where_all_fly_the_leaders_legs(
    simulation1: Scenario, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Level ground, the leader 3 m up: another one is 1.5 m lower; 2 m are asked, less the tolerance."""
    places = [[0.0, 4.0, 0.0], [0.0, 0.0, 1.0], [0.0, -4.0, -0.5]]
    plan = three(simulation1, places, limits={"clearance_min_m": 2.0}, mission={"tolerance_m": 0.3})
    points = along((0.0, 3.0), (50.0, 3.0), (100.0, 3.0))
    asked_m = 2.0 - 0.3 + 0.02
    together, _ = raised(monkeypatch, plan, points, [0, 1], 2)
    assert 0.0 <= together.by_waypoint_m[1] - _needed_m(points, asked_m - 1.5) < 0.05
    own, _ = raised(monkeypatch, plan, points, [0, 1], 2, row=2)
    assert not own.by_waypoint_m.any()  # the legs are its own places


def _needed_m(points: Array, short_m: float) -> float:
    """Ends stay where they are, so that no round is enough: a waypoint gains what is short, four times."""
    return 4.0 * (np.ceil(short_m * 64.0) / 64.0)


@pytest.mark.parametrize("margin_m", [None, 1.0])
def test_what_is_too_near_to_a_zone_counts_the_margin_less_the_tolerance(
    simulation1: Scenario, monkeypatch: pytest.MonkeyPatch, margin_m: float | None
) -> None:
    """2.5 m from the leader's way to the disk, 0.5 m from that of a vehicle 2 m east of it."""
    places = [[0.0, 2.0, 0.0], [0.0, 0.0, 0.0], [0.0, -4.0, 0.0]]
    disk = {"north_m": 40.0, "east_m": 6.5, "radius_m": 4.0}
    tables: dict[str, Any] = {"no_fly": [disk], "mission": {"tolerance_m": 0.3}}
    if margin_m is not None:
        tables["limits"] = {"zone_margin_m": margin_m}
    plan = three(simulation1, places, **tables)
    points = along((0.0, 9.0), (100.0, 9.0))
    _, too_near_m = raised(monkeypatch, plan, points, [0], 1)
    assert too_near_m == pytest.approx(max((margin_m or 0.0) - 0.3 - 0.5, 0.0), abs=1e-9)
    _, too_near_m = raised(monkeypatch, plan, points + np.array([0.0, 1.4, 0.0]), [0], 1)
    assert too_near_m == pytest.approx((margin_m or 0.0) - 0.3 + 0.9)
    _, own_m = raised(monkeypatch, plan, points + np.array([0.0, 1.4, 0.0]), [0], 1, row=0)
    assert own_m == pytest.approx(max((margin_m or 0.0) - 0.3 - 1.1, 0.0))


def test_a_zone_is_where_it_is_when_the_vehicle_passes(simulation1: Scenario, monkeypatch: pytest.MonkeyPatch) -> None:
    """The first waypoint is due at 10 s; 8 s later the vehicle is at 40 m, and the disk has come there in 18 s."""
    moving = {"north_m": 40.0, "east_m": 40.0, "radius_m": 4.0, "moves": [[0, 0, 0], [18, 0, -40], [60, 0, -40]]}
    level: dict[str, Any] = {"terrain": {"ripple": None, "mountains": {}}, "mission": {"tolerance_m": 0.3}}
    plan = plan_of(ridge(simulation1, no_fly=[moving], **level))
    _, too_near_m = raised(monkeypatch, plan, along((0.0, 9.0), (100.0, 9.0)), [0], 1)
    assert too_near_m == pytest.approx(4.0 - 0.3)


def test_the_shape_is_that_of_the_time(simulation1: Scenario, monkeypatch: pytest.MonkeyPatch) -> None:
    """One vehicle is 3 m below the leader from 20 s on, 10 s into this flight; the ground is level."""
    places = [[0.0, 4.0, 0.0], [0.0, 0.0, 0.0], [0.0, -4.0, 0.0]]
    plan = three(simulation1, places, mission={"tolerance_m": 0.3})
    start_s, end_s = plan.t_start_s, plan.t_end_s
    level, low = np.array(places), np.array(places)
    low[2, 2] = 3.0
    functions = np.array([[[1.0, 0.0], [0.0, 1.0]]])
    plan = replace(plan, shape=Shape(PPoly(functions, np.array([start_s, 20.0, end_s])), np.stack([level, low])))
    points = along((0.0, 3.5), (20.0, 3.5), (40.0, 3.5), (75.0, 3.5), (100.0, 9.0))
    made, _ = raised(monkeypatch, plan, points, [0, 1, 2, 3], 4)
    assert made.by_waypoint_m[1] == 0.0
    assert made.by_waypoint_m[2] > 0.0  # where the leg ends over which it sinks
    assert made.by_waypoint_m[3] > 0.0


def test_level_ground_is_short_by_the_height_that_is_missing() -> None:
    """NED: down is positive; below the ground is worse than at it."""
    places = np.array([[0.0, 0.0, -3.0], [0.0, 0.0, -1.25], [0.0, 0.0, 0.0], [0.0, 0.0, 2.0]])
    np.testing.assert_allclose(short_of_m(Terrain(), places, 2.0), [-1.0, 0.75, 2.0, 4.0])
