"""Flights that are broken off at any instant: closed forms, a search by brute force, and instants drawn at random."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import gcs
from gcs.errors import UsageError
from gcs.mission.proving.timed_samples import through
from gcs.types import Array
from tests.unit.mission.proving.test_prove import check_of, line
from tests.unit.plan.problems import FLAT, changed

HOLD, LAND = gcs.BreakOff("hold"), gcs.BreakOff("land")


def head_on(speeds_mps: tuple[float, float], until_s: float) -> list[gcs.PolynomialTrack]:
    """Two vehicles that fly toward each other along north, 40 m apart at first."""
    first, second = speeds_mps
    return [
        line("a", (0.0, 0.0, -10.0), (first, 0.0, 0.0), (0.0, 0.3 * until_s, until_s)),
        line("b", (40.0, 0.0, -10.0), (-second, 0.0, 0.0), (0.0, until_s)),
    ]


@pytest.mark.parametrize("how", [HOLD, LAND, gcs.BreakOff("hold", 0.7)], ids=str)
@pytest.mark.parametrize("speeds_mps", [(3.0, 2.0), (0.5, 4.0), (0.0, 3.0)])
def test_brakes_head_on_overlap_from_the_instant_that_the_formula_says(
    speeds_mps: tuple[float, float], how: gcs.BreakOff
) -> None:
    brakes_m = sum(speed**2 / (2.0 * how.brake_mps2) for speed in speeds_mps)
    until_s = (39.0 - brakes_m) / sum(speeds_mps)
    last_m = 40.0 - until_s * sum(speeds_mps) - brakes_m  # 1 m
    tracks = head_on(speeds_mps, until_s)
    proved = gcs.prove(tracks, gcs.TrackLimits(last_m - 0.01), abort=how)
    assert proved.ok, proved
    assert check_of(proved, f"separation, broken off to {how.manoeuvre}").proved == pytest.approx(last_m, abs=0.011)
    assert not proved.unsafe
    report = gcs.prove(tracks, gcs.TrackLimits(3.5), abort=how)
    (check,) = report.failures
    assert (check.name, check.verdict) == (f"separation, broken off to {how.manoeuvre}", "violated")
    assert check.seen == pytest.approx(last_m, abs=0.1)
    (span,) = report.unsafe
    assert span.start_s == pytest.approx((36.5 - brakes_m) / sum(speeds_mps), abs=0.011)
    assert span.end_s == pytest.approx(until_s, abs=1e-9)
    assert (span.vehicles, span.verdict) == (("a", "b"), "violated")
    assert span.seen == pytest.approx(40.0 - brakes_m - span.t_s * sum(speeds_mps), abs=1e-6)


def test_vehicles_one_above_the_other_may_hold_but_not_land() -> None:
    tracks = [
        line("low", (0.0, 0.0, -5.0), (1.0, 0.0, 0.0)),
        line("high", (0.0, 0.0, -9.0), (1.0, 0.0, 0.0)),
    ]
    assert gcs.prove(tracks, gcs.TrackLimits(3.0), abort=HOLD).ok
    report = gcs.prove(tracks, gcs.TrackLimits(3.0), abort=LAND)
    (span,) = report.unsafe
    assert (span.start_s, span.end_s, span.seen) == (0.0, 10.0, pytest.approx(0.0, abs=1e-9))


def test_one_that_still_brakes_is_below_one_that_descends_already() -> None:
    """At rest they are farther apart than 0.9 m if they break off after 13.9 m / 3 m/s, or before 12.1 m / 3 m/s."""
    tracks = [
        line("slow", (0.0, 0.0, -12.0), (0.0, 0.0, 0.0), (0.0, 8.0)),
        line("fast", (-16.0, 0.0, -10.0), (3.0, 0.0, 0.0), (0.0, 8.0)),
    ]
    limits = gcs.TrackLimits(0.9)
    assert gcs.prove(tracks, limits, abort=HOLD).ok
    (slow,) = gcs.prove(tracks, limits, abort=gcs.BreakOff("land", 1.5, 0.1)).unsafe
    assert (slow.start_s, slow.end_s) == (pytest.approx(12.1 / 3.0, abs=0.011), pytest.approx(13.9 / 3.0, abs=0.011))
    assert slow.seen == pytest.approx(0.0, abs=0.2)
    (quick,) = gcs.prove(tracks, limits, abort=gcs.BreakOff("land", 1.5, 2.0)).unsafe
    assert quick.start_s == slow.start_s
    assert slow.end_s + 0.05 < quick.end_s < 16.0 / 3.0


def brute_m(tracks: list[gcs.PolynomialTrack], s: Array, how: gcs.BreakOff, scale: float, steps: int) -> Array:
    """The least distances (S,) of all pairs of vehicles that break off at instants (S,), by integrating their motion.

    Written apart from the proof: velocities are made smaller step by step, and places added up.
    """
    place, velocity = (np.stack([each.position_ned_m(s, n) for each in tracks]) for n in (0, 1))
    longest_s = np.linalg.norm(velocity, axis=2).max() / how.brake_mps2
    step_s = longest_s / steps
    sunk = np.zeros(place.shape[:2])
    least = np.full(len(s), np.inf)
    first, second = np.triu_indices(len(tracks), 1)
    for _ in range(steps + 2):
        apart = place[first] - place[second]
        gap = np.maximum(np.maximum(apart[..., 2] - sunk[second], -apart[..., 2] - sunk[first]), 0.0)
        distance = np.sqrt(apart[..., 0] ** 2 + apart[..., 1] ** 2 + (gap / scale) ** 2)
        least = np.minimum(least, distance.min(axis=0))
        speed = np.linalg.norm(velocity, axis=2)
        slower = np.maximum(speed - how.brake_mps2 * step_s, 0.0)
        braked_s = np.minimum(speed / how.brake_mps2, step_s)
        way = velocity / np.maximum(speed, 1e-12)[..., None]
        place = place + way * (0.5 * (speed + slower) * braked_s)[..., None]
        velocity = way * slower[..., None]
        if how.manoeuvre == "land":
            sunk = sunk + how.sink_mps * (step_s - braked_s)
    if how.manoeuvre == "land":
        level = np.linalg.norm((place[first] - place[second])[..., :2], axis=2)
        least = np.minimum(least, level.min(axis=0))
    return least


def swarm(seed: int, vehicles: int = 4, *, straight: bool = False) -> list[gcs.PolynomialTrack]:
    """Vehicles that wander through each other, some of them standing for a while."""
    rng = np.random.default_rng(seed)
    t_s = np.concatenate([[0.0], np.cumsum(rng.uniform(0.5, 1.5, 10))])
    tracks = []
    for name in "abcdef"[:vehicles]:
        places = np.cumsum(rng.normal(0.0, 2.5, (len(t_s), 3)), axis=0) + rng.normal(0.0, 6.0, 3)
        places[4] = places[5]
        velocity = None if straight else np.gradient(places, t_s, axis=0) * (np.arange(len(t_s)) != 5)[:, None]
        tracks.append(gcs.PolynomialTrack(name, through(t_s, places, velocity)))
    return tracks


@pytest.mark.parametrize("how", [HOLD, gcs.BreakOff("land", 2.0, 0.8)], ids=str)
@pytest.mark.parametrize("seed", range(3))
def test_distances_are_bounded_as_brute_force_finds_them(seed: int, how: gcs.BreakOff) -> None:
    tracks, scale = swarm(seed, straight=seed % 2 == 1), (1.0, 2.0)[seed % 2]
    s = np.linspace(0.0, tracks[0].position_ned_m.x[-1] * (1 - 1e-12), 4001)
    least_m = brute_m(tracks, s, how, scale, 200)
    check = gcs.prove(tracks, gcs.TrackLimits(0.05, scale), abort=how).checks[-1]
    gap_m = max(0.02 * abs(least_m.min() - 0.05), 0.011)
    assert check.proved <= least_m.min() + 1e-6
    assert check.proved >= least_m.min() - gap_m - 0.03  # the search looks every few milliseconds only
    assert check.seen >= check.proved


@pytest.mark.parametrize("how", [HOLD, LAND], ids=str)
@pytest.mark.parametrize("seed", [1, 3, 5, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (0, 2, 4, 6, 7))])
def test_any_instant_outside_of_the_spans_is_safe(seed: int, how: gcs.BreakOff) -> None:
    tracks = swarm(seed, straight=seed % 2 == 1)
    rng = np.random.default_rng(seed)
    s = rng.uniform(0.0, tracks[0].position_ned_m.x[-1], 3000)
    least_m = brute_m(tracks, s, how, 1.0, 100)
    limit_m = float(np.quantile(least_m, 0.2))
    report = gcs.prove(tracks, gcs.TrackLimits(limit_m), abort=how)
    assert check_of(report, f"separation, broken off to {how.manoeuvre}").verdict == "violated"
    inside = np.any([(s >= span.start_s) & (s <= span.end_s) for span in report.unsafe], axis=0)
    assert (least_m[~inside] >= limit_m - 1e-3).all()
    assert (least_m[inside] < limit_m + 0.2).all()  # spans end within a hundredth of a second
    assert inside.any()
    for span in report.unsafe:
        assert span.start_s <= span.t_s <= span.end_s
        if span.verdict == "violated":
            assert brute_m(tracks, np.array([span.t_s]), how, 1.0, 3000)[0] <= span.seen + 1e-3


def test_zones_and_the_ground_are_kept_on_the_way_to_rest(simulation1: gcs.Scenario) -> None:
    """4 m/s toward a disk, whose edge is 45 m north, take 16/3 m to brake; 3 m/s down take 3 m."""
    disk = {"north_m": 50.0, "east_m": 0.0, "radius_m": 5.0}
    scenario = changed(simulation1, terrain=FLAT, no_fly=[disk])
    up = np.array([0.0, 0.0, -20.0])
    north = gcs.PolynomialTrack(
        "a", through(np.array([0.0, 11.0, 21.0]), np.array([[0, 0, 0], up, up + np.array([40, 0, 0])]))
    )
    report = gcs.prove([north], None, scenario, abort=HOLD)
    margin_m = scenario.limits.zone_margin_m or 0.0
    (check,) = report.failures
    assert check.name == "distance to no-fly zone 1, broken off to hold"
    (span,) = report.unsafe
    assert span.start_s == pytest.approx(11.0 + (45.0 - margin_m - 16.0 / 3.0) / 4.0, abs=0.011)
    assert span.end_s == 21.0
    clearance_m = scenario.limits.clearance_min_m
    t_s = np.array([0.0, 8.0, 8.0 + (20.0 - clearance_m - 1.0) / 3.0])
    low = gcs.PolynomialTrack("a", through(t_s, np.array([[0, 9, 0], [0, 9, -20], [0, 9, -clearance_m - 1.0]])))
    report = gcs.prove([low], None, scenario, abort=HOLD)
    ground = check_of(report, "clearance above the ground, broken off to hold")
    assert ground.verdict == "violated"
    assert ground.seen == pytest.approx(clearance_m - 2.0, abs=0.1)
    (span,) = report.unsafe
    assert span.start_s == pytest.approx(t_s[-1] - 2.0 / 3.0, abs=0.02)


def test_a_zone_that_comes_later_reaches_one_that_holds(simulation1: gcs.Scenario) -> None:
    moves = [[0.0, 0.0, 0.0], [40.0, 0.0, 0.0], [60.0, -58.0, 0.0]]
    disk = {"north_m": 60.0, "east_m": 0.0, "radius_m": 5.0, "moves": moves}
    scenario = changed(simulation1, terrain=FLAT, no_fly=[disk])
    up = np.array([0.0, 0.0, -20.0])
    t_s = np.array([0.0, 11.0, 18.0])
    places = np.array([up * 0.0, up, up + np.array([0, 30, 0])])
    report = gcs.prove([gcs.PolynomialTrack("a", through(t_s, places))], None, scenario, abort=HOLD)
    (check,) = report.failures
    assert check.name == "distance to no-fly zone 1, broken off to hold"
    assert report.unsafe[0].start_s == 0.0
    assert report.unsafe[-1].end_s < 18.0


@pytest.mark.parametrize("values", [("hover",), ("hold", 0.0), ("land", 1.5, np.nan)])
def test_ways_that_are_none_are_refused(values: Any) -> None:
    with pytest.raises(UsageError):
        gcs.BreakOff(*values)
