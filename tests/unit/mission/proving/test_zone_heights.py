"""Zones with heights and times against brute force, and a centimetre and a hundredth of a second beside each end."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import gcs
from gcs.mission.proving.timed_samples import through
from gcs.scenario.environment.no_fly import nearest_zone_m
from gcs.scenario.schema.scenario import NoFlyZone
from gcs.types import Array
from tests.unit.mission.proving.test_prove import check_of
from tests.unit.plan.problems import FLAT, changed

NAME = "distance to no-fly zone 1"
L_SHAPE = [[20.0, -20.0], [60.0, -20.0], [60.0, 0.0], [40.0, 0.0], [40.0, 20.0], [20.0, 20.0]]
SHAPES: tuple[dict[str, Any], ...] = ({"north_m": 40.0, "east_m": 0.0, "radius_m": 12.0}, {"polygon_m": L_SHAPE})


def flown(*places: tuple[float, float, float]) -> gcs.PolynomialTrack:
    """From place to place, north, east and up, in 10 s each."""
    t_s = 10.0 * np.arange(len(places))
    return gcs.PolynomialTrack("one", through(t_s, np.array(places) * [1.0, 1.0, -1.0]))


def proved(scenario: gcs.Scenario, zone: dict[str, Any], track: gcs.PolynomialTrack, **keys: Any) -> gcs.TrackReport:
    place = changed(scenario, terrain=FLAT, no_fly=[zone])
    return gcs.prove([track], gcs.TrackLimits(height_m=(-1.0, 500.0)), place, **keys)


@pytest.mark.parametrize("height_m", [(20.0, 30.0), (-1000.0, 24.99), (25.01, 1000.0), (24.99, 25.005)])
@pytest.mark.parametrize("shape", SHAPES, ids=["disk", "polygon"])
def test_a_level_flight_passes_over_or_under_a_zone_by_a_centimetre(
    simulation1: gcs.Scenario, shape: dict[str, Any], height_m: tuple[float, float]
) -> None:
    track = flown((0.0, -1.0, 25.0), (80.0, -1.0, 25.0))
    check = check_of(proved(simulation1, shape | {"height_m": height_m}, track), NAME)
    low_m, high_m = height_m
    if low_m <= 25.0 <= high_m:
        assert check.verdict == "violated"
    else:
        assert check.verdict == "proved"
        assert check.proved == pytest.approx(0.01, abs=1e-3)


@pytest.mark.parametrize(
    ("in_force_s", "inside"), [((0.0, 3.49), 0), ((0.0, 3.51), 1), ((6.51, 9.0), 0), ((6.49, 9.0), 1)]
)
def test_a_zone_that_begins_or_ends_is_passed_by_a_hundredth_of_a_second(
    simulation1: gcs.Scenario, in_force_s: tuple[float, float], inside: int
) -> None:
    """The disk is entered at t = 3.5 s and left at t = 6.5 s."""
    zone = {"north_m": 40.0, "east_m": 0.0, "radius_m": 12.0, "in_force_s": in_force_s}
    check = check_of(proved(simulation1, zone, flown((0.0, 0.0, 25.0), (80.0, 0.0, 25.0))), NAME)
    assert check.verdict == ("violated" if inside else "proved")
    assert inside or check.proved == pytest.approx(0.08, abs=2e-3)


def test_a_zone_that_no_look_of_the_time_limit_met_in_force_is_undecided(simulation1: gcs.Scenario) -> None:
    """It holds inside the zone when that begins, half a minute after the flight."""
    zone = SHAPES[0] | {"in_force_s": (50.0, 51.0)}
    track = flown((35.0, 0.0, 25.0), (45.0, 0.0, 25.0))
    report = proved(simulation1, zone, track, abort=gcs.BreakOff("hold"), limit_s=1e-9)
    check = check_of(report, f"{NAME}, broken off to hold")
    assert (check.verdict, check.vehicles, report.ok) == ("undecided", (), False)
    assert "undecided, perhaps" in str(check)


@pytest.mark.parametrize("seed", range(12))
def test_distances_are_those_of_brute_force(simulation1: gcs.Scenario, seed: int) -> None:
    rng = np.random.default_rng(seed)
    zone = SHAPES[seed % 2] | {"height_m": [15.0, 30.0]}
    if seed % 3:
        zone |= {"in_force_s": sorted(rng.uniform(0.0, 60.0, 2).tolist())}
    if seed % 4:
        zone |= {"moves": [[0.0, 0.0, 0.0], [60.0, 10.0, -15.0]]}
    track = flown(*(tuple(place) for place in rng.uniform((0.0, -40.0, 1.0), (80.0, 40.0, 60.0), (7, 3)).tolist()))
    t_s = np.linspace(0.0, 60.0, 60_001)
    north, east, down = track.position_ned_m(t_s).T
    least_m = float(nearest_zone_m((NoFlyZone.model_validate(zone),), t_s, north, east, -down).min())
    found = [check for check in proved(simulation1, zone, track).checks if check.name == NAME]
    if np.isinf(least_m):
        assert not found
        return
    (check,) = found
    assert (check.verdict == "violated") == (least_m < -1e-3)
    if least_m > 0.0:  # beside an edge its two faces are nearer than it is, never farther
        assert 0.97 * least_m / np.sqrt(2.0) - 5e-3 <= check.proved <= least_m + 1e-3


def test_who_lands_below_a_zone_may_and_who_lands_through_one_must_not(simulation1: gcs.Scenario) -> None:
    zone = SHAPES[0] | {"height_m": [15.0, 20.0]}
    for up_m, manoeuvre, verdict in (
        (10.0, "land", "proved"),
        (25.0, "land", "violated"),
        (25.0, "hold", "proved"),
        (10.0, "hold", "proved"),
    ):
        track = flown((0.0, 0.0, up_m), (80.0, 0.0, up_m))
        how = gcs.BreakOff(manoeuvre)  # type: ignore[arg-type]
        check = check_of(proved(simulation1, zone, track, abort=how), f"{NAME}, broken off to {manoeuvre}")
        assert check.verdict == verdict, (up_m, manoeuvre)


def test_one_that_holds_is_reached_by_a_zone_that_begins(simulation1: gcs.Scenario) -> None:
    zone = SHAPES[0] | {"in_force_s": [30.0, 40.0]}
    track = flown((0.0, 0.0, 20.0), (80.0, 0.0, 20.0))  # through it from t = 3.5 s to 6.5 s, and away before it begins
    report = proved(simulation1, zone, track, abort=gcs.BreakOff("hold"))
    assert check_of(report, f"{NAME}, broken off to hold").verdict == "violated"
    rest_m = 8.0**2 / 3.0
    inside_s = (28.0 - rest_m) / 8.0, (52.0 - rest_m) / 8.0  # instants whose brake ends in the disk
    spans = [span for span in report.unsafe if "zone" in span.name]
    assert min(span.start_s for span in spans) == pytest.approx(inside_s[0], abs=0.03)
    assert max(span.end_s for span in spans) == pytest.approx(inside_s[1], abs=0.03)


def test_zones_that_the_planned_flight_does_not_meet_count(simulation1: gcs.Scenario) -> None:
    zone = SHAPES[0] | {"height_m": [200.0, 300.0]}
    place = changed(simulation1, terrain=FLAT, no_fly=[], no_fly_beyond=[zone])
    track = flown((0.0, 0.0, 250.0), (80.0, 0.0, 250.0))
    report = gcs.prove([track], gcs.TrackLimits(height_m=(0.0, 400.0)), place)
    assert check_of(report, NAME).verdict == "violated"


def test_the_judge_and_the_live_view_see_the_true_distance() -> None:
    zone = NoFlyZone.model_validate(SHAPES[0] | {"height_m": [15.0, 20.0], "in_force_s": [0.0, 10.0]})

    def away_m(t_s: float, east_m: float, up_m: float) -> float:
        at: tuple[Array, ...] = tuple(np.array([value]) for value in (t_s, 40.0, east_m, up_m))
        return float(nearest_zone_m((zone,), *at)[0])

    assert away_m(5.0, 0.0, 17.0) == pytest.approx(-2.0)
    assert away_m(5.0, 0.0, 24.0) == pytest.approx(4.0)
    assert away_m(5.0, 15.0, 24.0) == pytest.approx(5.0)
    assert away_m(5.0, 15.0, 18.0) == pytest.approx(3.0)
    assert away_m(10.5, 0.0, 17.0) == np.inf
