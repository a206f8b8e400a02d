"""Conflicts seen before they happen, and none where the plan is flown as it was verified."""

from __future__ import annotations

import itertools
from collections.abc import Callable

import numpy as np
import pytest

from gcs.flight.contingency.conflict_prediction import SeparationWatch, _pairs
from gcs.flight.monitoring.monitor import VehicleView
from gcs.flight.monitoring.predicted_tracks import PredictedTracks
from gcs.physics.states import POSITION, VELOCITY
from gcs.plan.trajectory.plan import Plan
from tests.unit.flight.contingency.straight_plan import reported, straight_plan

T0, MICROSECOND_S = 1_700_000_000.0, 1e-6
ALL = (1, 2, 3, 4, 5, 6)


def views_at(plan: Plan, t_s: float, age_s: float = 0.1, noise_m: float = 0.0, seed: int = 0) -> dict[int, VehicleView]:
    """What six vehicles that fly the plan tell at `t_s`, a little old."""
    rng = np.random.default_rng(seed)
    states = plan.states(np.array([t_s - age_s]))[:, 0]
    return {
        sysid: VehicleView(
            sysid,
            states[row, POSITION] + rng.normal(0.0, noise_m, 3),
            states[row, VELOCITY] + rng.normal(0.0, noise_m, 3),
            T0 + t_s - age_s,
        )
        for row, sysid in enumerate(plan.sysids)
    }


def test_a_verified_plan_flown_with_noise_has_no_conflicts(simulation1_plan: Plan) -> None:
    ours = SeparationWatch(simulation1_plan, 0.3)
    for n, t_s in enumerate(np.arange(-15.0, 275.0, 1.0)):
        views = views_at(simulation1_plan, t_s, noise_m=0.02, seed=n)
        assert ours.look(views, t_s, T0 + t_s, ALL, ALL) == []


def test_two_who_drift_together_are_seen_in_time(simulation1_plan: Plan) -> None:
    plan, ours = simulation1_plan, SeparationWatch(simulation1_plan, 0.3)
    found = []
    for t_s in np.arange(50.0, 50.31, 0.1):
        views = views_at(plan, t_s)
        between = views[2].position_ned_m - views[5].position_ned_m
        views[5].position_ned_m = views[5].position_ned_m + 0.25 * between / np.linalg.norm(between)
        found = ours.look(views, t_s, T0 + t_s, ALL, ALL)
        if t_s < 50.15:
            assert found == []  # one sample is no conflict
    (conflict,) = found
    assert conflict.pair == (2, 5)
    assert conflict.distance_m == pytest.approx(0.25, abs=0.02)
    assert conflict.in_s == 0.0


def test_who_stands_in_the_way_is_seen_seconds_ahead(simulation1_plan: Plan) -> None:
    plan, ours = simulation1_plan, SeparationWatch(simulation1_plan, 0.3)
    ahead = plan.states(np.array([52.0]))[3, 0, POSITION]
    for t_s in (50.0, 50.1, 50.2):
        views = views_at(plan, t_s)
        views[6] = VehicleView(6, ahead, np.zeros(3), T0 + t_s)
        found = ours.look(views, t_s, T0 + t_s, ALL[:5], ALL)
    mine = next(c for c in found if c.pair == (4, 6))
    assert 1.4 < mine.in_s < 2.0
    assert ours.look(views, t_s, T0 + t_s, ALL[:5], ALL[:5]) == []  # once it is down, it is no conflict


def straight(
    t_s: float,
    limit_m: float,
    ages_s: dict[int, float] | float = 0.0,
    *,
    move: Callable[[dict[int, VehicleView]], None] = lambda views: None,
    on_plan: tuple[int, ...] = (1, 2, 3),
    aloft: tuple[int, ...] = (1, 2, 3),
    starting: tuple[int, ...] = (),
    tracks: PredictedTracks | None = None,
    streamed: bool = False,
) -> dict[tuple[int, int], tuple[float, float]]:
    """Conflicts of the straight plan at the third look, as (seconds ahead, metres) by pair."""
    ours = SeparationWatch(straight_plan(), limit_m, tracks, streamed=streamed)
    for looks in range(3):
        views = reported(t_s, T0, ages_s)
        move(views)
        views[1].unix_s += MICROSECOND_S * looks
        found = ours.look(views, t_s, T0 + t_s, on_plan, aloft, starting)
        assert looks == 2 or not found
    return {one.pair: (one.in_s, round(one.distance_m, 3)) for one in found}


def moved(
    sysid: int, off_m: tuple[float, ...] = (0.0,) * 3, off_mps: tuple[float, ...] = (0.0,) * 3
) -> Callable[[dict[int, VehicleView]], None]:
    def move(views: dict[int, VehicleView]) -> None:
        views[sysid].position_ned_m = views[sysid].position_ned_m + np.array(off_m)
        views[sysid].velocity_ned_mps = views[sysid].velocity_ned_mps + np.array(off_mps)

    return move


@pytest.mark.parametrize("ages_s", [0.0, 1.5, {1: 1.5}, {2: 1.5}, {3: 0.4, 1: 1.0}])
@pytest.mark.parametrize("t_s", [0.0, 30.0])
def test_a_report_counts_at_its_own_time_however_old_it_is(t_s: float, ages_s: dict[int, float] | float) -> None:
    """They fly 5 m one behind the other at 2 m/s, and as planned: reports of any age change nothing."""
    apart_m = round(float(np.hypot(5.0, 0.1 * t_s)), 3)
    near = {(1, 2): (0.0, apart_m), (1, 3): (0.0, apart_m)}
    assert straight(t_s, apart_m + 0.1, ages_s) == near
    assert straight(t_s, apart_m - 0.01, ages_s) == {}


@pytest.mark.parametrize("age_s", [0.0, 0.5])
def test_who_is_off_the_plan_goes_straight_on_from_its_report(age_s: float) -> None:
    """Vehicle 1 left the plan and catches up 1.2 m/s on vehicle 3: 3 m are left 1.67 s after its report."""
    found = straight(0.0, 3.0, {1: age_s}, move=moved(1, off_mps=(1.2, 0.0, 0.0)), on_plan=(2, 3))
    least_m = float(np.hypot(5.0 - 1.2 * (3.0 + age_s), 0.3))  # and 0.1 m/s further east
    assert found == {(1, 3): (1.5 - age_s, round(least_m, 3))}


def test_a_deviations_rate_fades_with_half_a_second() -> None:
    """5 m less 4 m/s for 0.5 s (1 - e^(-t / 0.5 s)) is 4 m after 0.35 s; 3 m in the end."""
    found = straight(0.0, 4.0, move=moved(1, off_mps=(4.0, 0.0, 0.0)))
    assert found == {(1, 3): (0.25, round(float(np.hypot(5.0 - 2.0 * (1.0 - np.exp(-6.0)), 0.3)), 3))}
    assert straight(0.0, 3.0, move=moved(1, off_mps=(4.0, 0.0, 0.0))) == {}
    assert straight(0.0, 2.0, move=moved(1, (3.5, 0.0, 0.0))) == {(1, 3): (0.0, 1.5)}  # a deviation stays as it is
    assert straight(0.0, 2.0, move=moved(1, (3.5, 0.0, 0.0)), on_plan=()) == {(1, 3): (0.0, 1.5)}


@pytest.mark.parametrize("age_s", [0.0, 0.5])
def test_two_who_fly_towards_each_other_are_seen_six_seconds_ahead(age_s: float) -> None:
    """Vehicle 1 catches up 0.6 m/s on vehicle 3, which is 5 m ahead: 2 m are left after 5 s."""
    found = straight(0.0, 2.0, {1: age_s}, move=moved(1, off_mps=(0.6, 0.0, 0.0)))
    assert found == {(1, 3): (pytest.approx(5.1 - age_s, abs=0.1), pytest.approx(1.52 - 0.54 * age_s, abs=0.01))}
    assert straight(0.0, 2.0, move=moved(1, off_mps=(0.45, 0.0, 0.0))) == {}, "that takes longer"
    assert straight(0.0, 2.0, move=moved(1, off_mps=(0.6, 0.0, 0.0)), on_plan=(2, 3)) == {}, "it has an order"
    assert straight(0.0, 2.55, move=moved(1, off_mps=(1.0, 0.0, 0.0))) == {}, "the plan's own 5 m are too near"


def test_a_vehicle_that_its_setpoints_brake_is_no_conflict() -> None:
    """Vehicle 1 catches up 2.5 m/s from 5 m behind, but has its own speed after a second; 3.5 m/s are too fast."""
    assert (1, 3) in straight(0.0, 2.0, move=moved(1, off_mps=(2.5, 0.0, 0.0)))
    assert straight(0.0, 2.0, move=moved(1, off_mps=(2.5, 0.0, 0.0)), streamed=True) == {}
    assert (1, 3) in straight(0.0, 2.0, move=moved(1, off_mps=(3.5, 0.0, 0.0)), streamed=True)


def test_a_vehicle_that_comes_back_to_its_hover_is_no_conflict(hop: Plan) -> None:
    """5 m apart, vehicle 2 moves at 0.8 m/s towards vehicle 1; recorded PX4s did so for a second."""

    def found(t_s: float) -> int:
        ours = SeparationWatch(hop, 2.0)
        for looks in range(3):
            views = views_at(hop, t_s, age_s=0.01 * looks)
            between_m = views[1].position_ned_m - views[2].position_ned_m
            views[2].velocity_ned_mps = views[2].velocity_ned_mps + 0.8 * between_m / np.linalg.norm(between_m)
            conflicts = ours.look(views, t_s, T0 + t_s, (1, 2, 3), (1, 2, 3))
        return len(conflicts)

    assert found(0.5 * hop.flight_s) == 1
    assert found(hop.flight_s + 1.0) == 0


def test_vehicles_on_missions_go_on_along_their_own_tracks_at_their_own_speeds() -> None:
    """Vehicle 3 flies at half its predicted speed, and vehicle 1 comes 1 m/s nearer from 5 m behind: 3 m after 2 s."""
    t_s = np.arange(0.0, 60.0, 0.1)
    tracks = PredictedTracks((3, 1, 2), 0.0, straight_plan().states(t_s)[..., :3])
    slow = moved(3, off_mps=(-1.0, 0.0, 0.0))
    assert straight(1.0, 3.0, move=slow) == {}, "by setpoints it keeps its time"
    found = straight(1.0, 3.0, move=slow, tracks=tracks)
    assert found == {(1, 3): (2.0, pytest.approx(np.hypot(1.0, 0.1), abs=0.7))}
    late = moved(3, (-2.5, 0.0, 0.0))
    assert straight(0.0, 2.0, move=late, tracks=tracks) == {}, "late at full speed it comes no nearer"


def test_only_vehicles_aloft_with_a_position_count() -> None:
    near = moved(1, (3.5, 0.0, 0.0))
    assert straight(0.0, 2.0, move=near, aloft=(1, 2)) == straight(0.0, 2.0, move=near, aloft=(3,)) == {}
    assert straight(0.0, 2.0, move=near, aloft=(3, 1)) == {(3, 1): (0.0, 1.5)}
    assert straight(0.0, 2.0, move=moved(1, (np.nan, 0.0, 0.0))) == {}
    assert straight(0.0, 5.5, move=moved(3, (np.nan, 0.0, 0.0))) == {(1, 2): (0.0, 5.0)}


def test_three_looks_in_a_row_are_a_conflict_and_one_without_it_begins_anew() -> None:
    ours = SeparationWatch(straight_plan(), 2.0)
    told = []
    for n, near in enumerate((True, True, False, True, True, True, True, False, True)):
        views = reported(0.0, T0)
        views[1].unix_s += MICROSECOND_S * n
        moved(1, (3.5 * near, 0.0, 0.0))(views)
        told.append(len(ours.look(views, 0.0, T0, (1, 2, 3), (1, 2, 3))))
    assert told == [0, 0, 0, 0, 0, 1, 1, 0, 0]


def test_one_report_that_is_looked_at_again_is_one_sample() -> None:
    """A link that stalls, or a log that ends, leaves the last noisy report; one new report of either vehicle counts."""
    ours = SeparationWatch(straight_plan(), 2.0)
    views = reported(0.0, T0)
    moved(1, (3.5, 0.0, 0.0))(views)
    for later_s in (0.0, 0.1, 0.2, 0.3):
        assert ours.look(views, later_s, T0 + later_s, (1, 2, 3), (1, 2, 3)) == []
    views[1].unix_s += 0.01
    assert ours.look(views, 0.4, T0 + 0.4, (1, 2, 3), (1, 2, 3)) == []
    views[3].unix_s += 0.02
    assert len(ours.look(views, 0.4, T0 + 0.4, (1, 2, 3), (1, 2, 3))) == 1


@pytest.mark.parametrize("t_s", [-20.5, 59.0, 61.0])
def test_before_its_beginning_and_after_its_end_a_plan_stands_still(t_s: float) -> None:
    ours = SeparationWatch(straight_plan(), 5.0)
    views = reported(min(max(t_s, -20.0), 60.0), T0)
    for view in views.values():
        view.unix_s = T0 + t_s
    assert [ours.look(views, t_s, T0 + t_s, (1, 2, 3), (1, 2, 3)) for _ in range(3)] == [[], [], []]


def standing(off_m: tuple[float, ...], off_mps: tuple[float, ...], age_s: float = 0.0) -> Callable[..., None]:
    """All stand on their pads, and vehicle 1 has moved so since it was armed, by an old report of a bad receiver."""

    def move(views: dict[int, VehicleView]) -> None:
        plan = straight_plan()
        for row, sysid in enumerate(plan.sysids):
            view = views[sysid]
            view.position_ned_m = plan.pads_ned_m[row] + np.array([row, -2.0, 3.0])
            view.velocity_ned_mps = np.zeros(3)
            view.unix_s = T0 - 30.0
            view.stands_on(plan.pads_ned_m[row])
        moved(1, off_m, off_mps)(views)
        views[1].unix_s -= age_s

    return move


@pytest.mark.parametrize(
    ("off_m", "off_mps", "age_s", "found"),
    [
        ((1.1, 0.0, 0.0), (1.0, 0.0, 0.0), 0.0, {(1, 3): (1.75, 0.9)}),  # 3.9 m, less than 2 m after 1.9 s
        ((1.1, 0.0, 0.0), (1.0, 0.0, 0.0), 1.0, {(1, 3): (0.75, 0.0)}),
        ((1.1, 0.0, 0.0), (1.0, 0.0, 0.0), -5.0, {(1, 3): (1.75, 0.9)}),  # no report is from the future
        ((0.9, 0.0, 0.0), (1.0, 0.0, 0.0), 0.0, {}),  # within a metre of its pad's column it comes back
        ((0.7, 0.7, 0.0), (1.0, 0.0, 0.0), 0.0, {}),
        ((0.8, 0.8, 0.0), (1.0, 0.0, 0.0), 0.0, {(1, 3): (2.25, 1.442)}),
        ((3.5, 0.0, -1.0), (0.0, 0.0, -2.0), 0.0, {(1, 3): (0.0, 1.803)}),  # it climbs out of the way
        ((3.5, 0.0, -7.5), (0.0, 0.0, 3.0), 0.0, {(1, 3): (2.0, 1.5)}),  # it comes down
    ],
)
def test_before_t0_vehicles_climb_and_drift_from_their_pads(
    off_m: tuple[float, ...], off_mps: tuple[float, ...], age_s: float, found: object
) -> None:
    everyone = {"on_plan": (), "starting": (1, 2, 3)}
    assert straight(-30.0, 2.0, move=standing(off_m, off_mps, age_s), **everyone) == found  # type: ignore[arg-type]


@pytest.mark.parametrize(("down_m", "found"), [(-7.0, {}), (-8.5, {(1, 3): (0.0, 1.7)})])
def test_a_climb_ends_at_the_hover_or_where_the_vehicle_is_already(down_m: float, found: object) -> None:
    """Vehicle 1 climbs at 2 m/s beneath vehicle 3, which was blown near it at 9.3 m; they hover at 8 m."""

    def passing(views: dict[int, VehicleView]) -> None:
        standing((3.5, 0.0, down_m), (0.0, 0.0, -2.0))(views)
        moved(3, (0.0, 0.0, -9.3))(views)

    assert (
        straight(-30.0, 1.98, move=passing, on_plan=(), starting=(1, 2, 3)) == found
    )  # hypot(1.5, 1.3) m is no conflict


def test_the_distance_to_the_pad_is_level_and_by_what_a_vehicle_moved() -> None:
    views = reported(-30.0, T0)
    standing((3.0, 4.0, -12.0), (0.0, 0.0, 0.0))(views)
    assert SeparationWatch(straight_plan(), 2.0).off_pad_m(views[1]) == pytest.approx(5.0)


def test_every_vehicle_climbs_to_its_own_hover() -> None:
    ours = SeparationWatch(straight_plan(), 2.0)
    ours._hover_down_m = np.array([-6.0, -8.0, -10.0])  # of 3, 1 and 2
    views = reported(-30.0, T0)
    standing((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))(views)
    for sysid, hover_down_m in ((3, -6.0), (1, -8.0), (2, -10.0)):
        views[sysid].velocity_ned_mps = np.array([0.5, 0.5, -4.0])
        pad = straight_plan().pads_ned_m[straight_plan().sysids.index(sysid)]
        path = ours._climb(views[sysid], 0.25)
        np.testing.assert_allclose(path[:, :2], np.tile(pad[:2], (len(path), 1)))
        np.testing.assert_allclose(path[:, 2], np.maximum(-4.0 * (0.25 * np.arange(25) + 0.25), hover_down_m))


@pytest.mark.parametrize("count", [0, 1, 2, 3, 33, 40])
def test_all_pairs_are_looked_at_once_however_many(count: int) -> None:
    found = [pair for one, other in _pairs(count) for pair in zip(one.tolist(), other.tolist(), strict=True)]
    assert found == list(itertools.combinations(range(count), 2))
