"""What is proved between samples: against a brute grid of 0.1 ms, and against missions bent between the old samples."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs.mission.check.between_samples import bound_along, clearance_along, outside_along, parts_beside
from gcs.mission.check.flight_checks import check_ground, check_limits, check_separation, check_zones
from gcs.mission.flight_limits import FlightLimits, Surroundings
from gcs.mission.predicted.closest_approach import closest_approach
from gcs.mission.predicted.planned_flight import PredictedFlight
from gcs.scenario.environment.ground_bounds import from_heights, highest_ground
from gcs.scenario.environment.terrain import ground_height_m
from gcs.scenario.schema.scenario import NoFlyZone, Scenario
from gcs.types import Array
from tests.unit.mission.fleets import ORIGIN, mission, out_and_land

FLEET = [mission(out_and_land(10.0), name=f"{name}.plan") for name in "ab"]
brief = settings(max_examples=12, deadline=None)


def flight(t_s: list[float], ned_m: list[list[float]], bent_m: float = 0.0) -> PredictedFlight:
    count = len(t_s)
    bends = None if bent_m == 0.0 else np.full(count - 1, bent_m)
    return PredictedFlight(np.array(t_s), np.array(ned_m), np.zeros(count), t_s[0], t_s[-1], np.inf, bends_m=bends)


def dip(at_s: float, lasts_s: float, depth_m: float, axis: int, base: float) -> PredictedFlight:
    """North at 5 m/s, and for a moment aside along one axis: there and back in `lasts_s`."""
    times = [0.0, at_s - 0.5 * lasts_s, at_s, at_s + 0.5 * lasts_s, 20.0]
    places = [[5.0 * t, 0.0, -10.0] for t in times]
    for row in places:
        row[axis] = base
    places[2][axis] += depth_m
    return flight(times, places)


@brief
@given(st.floats(0.1, 19.9), st.floats(0.001, 0.02), st.floats(0.011, 0.1))
def test_a_dip_of_a_centimetre_for_20_ms_is_found(at_s: float, lasts_s: float, depth_m: float) -> None:
    """The limit is met by 1 mm but for the dip; `LENGTH_TOLERANCE_M` is 1 cm."""
    ground = Surroundings(ORIGIN, lambda north, east: 0.0 * north + 0.0 * east, slope_max=0.0)
    low = dip(at_s, lasts_s, depth_m, 2, -10.0)
    _, found = check_ground(FLEET[0], low, ground, FlightLimits(clearance_m=10.0 - 0.0005))
    assert [f.t_s for f in found] == [pytest.approx(at_s, abs=0.011)]
    high = dip(at_s, lasts_s, -depth_m, 2, -10.0)
    assert len(list(check_limits(FLEET[0], high, FlightLimits(height_max_m=10.0)))) == 1
    other = flight([0.0, 20.0], [[0.0, 3.0, -10.0], [100.0, 3.0, -10.0]])
    near = dip(at_s, lasts_s, depth_m, 1, 0.0)
    closest, found = check_separation(FLEET, [near, other], FlightLimits(3.0))
    assert closest is not None
    assert closest.distance_m == pytest.approx(3.0 - depth_m, abs=1e-6)
    assert len(found) == 1
    zone = NoFlyZone(north_m=50.0, east_m=1000.0, radius_m=1000.0, moves=((0.0, -500.0, 0.0), (20.0, 500.0, 0.0)))
    beside = dip(at_s, lasts_s, depth_m + 0.2, 1, -0.2)
    straight = flight([0.0, 20.0], [[0.0, -0.2, -10.0], [100.0, -0.2, -10.0]])
    wall = NoFlyZone(polygon_m=((0, 0), (100, 0), (100, 5), (0, 5)))
    limits = FlightLimits(no_fly=(wall,))
    assert check_zones(FLEET[0], straight, FlightLimits(no_fly=(wall, zone)))[1] == []
    assert len(check_zones(FLEET[0], beside, limits)[1]) == 1


def test_a_thin_wall_that_all_old_samples_step_over_is_found() -> None:
    wall = NoFlyZone(polygon_m=((50.2, -50), (50.3, -50), (50.3, 50), (50.2, 50)))
    through = flight([0.0, 20.0], [[0.0, 0.0, -10.0], [100.0, 0.0, -10.0]])
    found = check_zones(FLEET[0], through, FlightLimits(no_fly=(wall,)))[1]
    assert [f.t_s for f in found] == [pytest.approx(10.05, abs=0.02)]


def test_a_track_along_the_seam_of_a_bent_zone_is_inside() -> None:
    """Convex parts of the zone meet in a seam: a place on it is on the edge of both, and deep inside of the zone."""
    zone = NoFlyZone(polygon_m=((0, 0), (60, 0), (60, 30), (30, 30), (30, 60), (0, 60)))
    for seam in ([[1.0, 1.0], [29.0, 29.0]], [[30.0, 1.0], [30.0, 29.0]], [[1.0, 30.0], [29.0, 30.0]]):
        along = flight([0.0, 20.0], [[*seam[0], -10.0], [*seam[1], -10.0]])
        assert len(check_zones(FLEET[0], along, FlightLimits(no_fly=(zone,)))[1]) == 1


def test_a_moving_zone_is_bounded_across_its_turns() -> None:
    """A zone that jumps aside for 30 ms while the vehicle passes: only then are they together."""
    zone = NoFlyZone(
        north_m=50.0, east_m=20.0, radius_m=5.0, moves=((0, 0, 0), (9.985, 0, 0), (10, 0, -16), (10.015, 0, 0))
    )
    passing = flight([0.0, 20.0], [[0.0, 0.0, -10.0], [100.0, 0.0, -10.0]])
    found = check_zones(FLEET[0], passing, FlightLimits(no_fly=(zone,)))[1]
    assert [f.t_s for f in found] == [pytest.approx(10.0, abs=0.01)]


@pytest.mark.parametrize("seed", range(4))
def test_bounds_are_below_a_brute_grid_and_near_it(simulation1: Scenario, seed: int) -> None:
    """The distance to the ground, to a moving zone and of two vehicles, every 0.1 ms for half a second."""
    random = np.random.default_rng(seed)
    terrain = simulation1.terrain
    begin = np.array([*random.uniform(200.0, 1200.0, 2), 0.0])
    end = begin + np.array([*random.uniform(-4.0, 4.0, 2), 0.0])
    for place in (begin, end):
        place[2] = -float(ground_height_m(terrain, *place[:2])) - random.uniform(0.5, 1.0)
    shares = np.linspace(0.0, 1.0, 5001)
    places = begin + shares[:, None] * (end - begin)
    one, none = np.full(1, 0.5), np.zeros(1)
    bound = clearance_along(highest_ground(terrain), begin[None], end[None], 0.1, slack=none, duration_s=one)
    brute_m = min(_distance_m(lambda n, e: ground_height_m(terrain, n, e), place) for place in places[::100])
    assert bound.proved <= brute_m + 1e-3
    assert bound.least <= brute_m + 0.02
    assert bound.proved >= min(brute_m, bound.least) - 0.11
    zone = NoFlyZone(
        polygon_m=tuple((begin[0] + n, begin[1] + e) for n, e in ((3, 0), (8, 1), (7, 6), (2, 5))),
        moves=((0.0, 0.0, 0.0), (0.2, 1.0, 0.5), (0.5, -1.0, 0.0)),
    )
    parts = parts_beside(zone, begin[None], end[None], np.zeros(1), one)
    outside = outside_along(zone, parts, -100.0, slack=none[parts.piece])
    from gcs.scenario.environment.no_fly import displacement_m, signed_distance_m

    seen = places[:, :2] - displacement_m(zone, 0.5 * shares)
    grid_m = float(signed_distance_m(zone, *seen.T).min())
    assert outside.proved <= grid_m + 1e-9
    assert outside.least == pytest.approx(grid_m, abs=0.1)
    fleet = [flight([0.0, 0.5], random.uniform(-3, 3, (2, 3)).tolist(), bent_m=0.01) for _ in range(2)]
    closest = closest_approach(fleet)
    assert closest is not None
    line = [f.ned_m[0] + shares[:, None] * (f.ned_m[1] - f.ned_m[0]) for f in fleet]
    apart_m = float(np.linalg.norm(line[1] - line[0], axis=1).min())
    assert closest.distance_m <= apart_m + 1e-9
    assert closest.proved_m == pytest.approx(closest.distance_m - 0.02, abs=1e-9)


def test_what_is_neither_proved_nor_violated_is_an_error() -> None:
    """Flights that may be 5 cm beside their pieces, and 2 cm more than the limit apart."""
    one = flight([0.0, 10.0], [[0.0, 0.0, -10.0], [50.0, 0.0, -10.0]], bent_m=0.05)
    other = flight([0.0, 10.0], [[0.0, 3.02, -10.0], [50.0, 3.02, -10.0]], bent_m=0.05)
    _, found = check_separation(FLEET, [one, other], FlightLimits(3.0))
    assert [f.message for f in found] == ["proved only 2.920 m from the vehicle of b.plan; at least 3 m required"]
    flat = Surroundings(ORIGIN, lambda north, east: 0.0 * north + 0.0 * east, slope_max=0.0)
    lowest, found = check_ground(FLEET[0], one, flat, FlightLimits(clearance_m=9.98))
    assert "proved only 9.9" in found[0].message
    assert lowest is not None
    assert lowest.clearance_m == pytest.approx(10.0)
    assert lowest.proved_m < 9.97


def test_a_place_beside_a_cliff_is_near_the_ground() -> None:
    """50 m above the plain and 0.4 m beside a wall."""
    wall = from_heights(lambda north, east: np.where(east > 0.4, 100.0, 0.0) + 0.0 * north, 0.0)
    begin, end = np.array([[0.0, 0.0, -50.0]]), np.array([[20.0, 0.0, -50.0]])

    def highest(low_m: Array, high_m: Array) -> Array:
        return np.maximum(wall(low_m, low_m), wall(high_m, high_m))

    bound = clearance_along(highest, begin, end, 0.3, slack=np.zeros(1), duration_s=np.ones(1))
    assert bound.verdict == "proved"
    assert 0.3 <= bound.proved <= 0.4
    near = clearance_along(highest, begin, end, 0.5, slack=np.zeros(1), duration_s=np.ones(1))
    assert near.verdict == "violated"


def test_a_value_that_is_not_known_is_not_proved() -> None:
    one, none = np.ones(1), np.zeros(1)
    unknown = bound_along(lambda part, _: np.full(len(part), np.nan), one, 1.0, slack=none, duration_s=one)
    assert unknown.verdict == "violated"
    nowhere, flat = np.full((1, 3), np.nan), lambda low_m, _: 0.0 * low_m[:, 0]
    assert clearance_along(flat, nowhere, nowhere, 1.0, slack=none, duration_s=one).verdict == "violated"


def test_a_value_that_only_touches_its_limit_is_undecided_or_proved() -> None:
    bound = bound_along(
        lambda piece, share: np.abs(share - 1 / 3) + 0.0 * piece,
        np.ones(1),
        0.0,
        slack=np.zeros(1),
        duration_s=np.ones(1),
    )
    assert bound.verdict in ("proved", "undecided")
    assert -1e-3 <= bound.proved <= bound.least <= 0.01


def _distance_m(height, place: Array) -> float:  # type: ignore[no-untyped-def]
    away = np.linspace(-1.2, 1.2, 121)
    north, east = np.meshgrid(place[0] + away, place[1] + away, indexing="ij")
    over = np.maximum(-place[2] - height(north, east), 0.0)
    return float(np.sqrt((north - place[0]) ** 2 + (east - place[1]) ** 2 + over**2).min())
